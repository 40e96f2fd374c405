"""Studies at scattered points: the values are those of single runs, bit for bit, whatever scatters."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import studies
from studies import config, registry, results, runner
from studies.scatter.distributions import parse
from studies.scatter.figure import draw
from studies.scatter.findings import findings, rank_correlation
from studies.scatter.study import scattered
from studies.scatter.table import table
from studies.study import Setting, Study
from studies.tables import text
from sweeps import Axis, InputError, StoreError, Variable

RUN = {"theta": 5.0, "F": 9.0, "duration": 0.05}


def force(points, *, stiffness, words, broken=()):
    """A study's function that knows of nothing but its own axes and constants."""
    assert set(points) == {"x", "y"}
    if stiffness < 1.0:
        raise ValueError(f"stiffness = {stiffness}: too soft")
    value = stiffness * points["x"] * (2.0 if words == "twice" else 1.0)
    return {"force": value, "powers": value[:, None] ** np.arange(1.0, 4.0)}


def constants_of(settings):
    return {"stiffness": settings["k"] * settings["factor"], "words": settings["how"]}


def coords(**fixed):
    return {"power": Axis([1.0, 2.0, 3.0])}


def low(axes, fixed):
    if axes["x"].values.min() < 0.0:
        raise InputError(f"x = {axes['x'].values.min():g}: it must be 0 or above")


SPRING = Study(
    name="spring",
    title="Spring",
    question="How strong is a spring?",
    paper="Nothing.",
    axes={"x": Axis([1.0, 2.0], "m", "length"), "y": Axis([5, 6], "1", "number")},
    settings={
        "k": Setting(3.0, "N m-1", "stiffness"),
        "factor": Setting(1.0, "1", "factor"),
        "how": Setting("once", "1", "how", ("once", "twice")),
    },
    function=force,
    variables={"force": Variable("N", "force"), "powers": Variable("1", "powers", ("power",))},
    constants=constants_of,
    coords=coords,
    check=low,
    draw=lambda data: None,
    findings=lambda data: [],
)


def computed(study, given, **where):
    return scattered(registry.load(study) if isinstance(study, str) else study, given, **where)


def run(study, given, **where):
    return computed(study, given, **where).sweep(given).plan().run("sync")


def single(study, **given):
    """A run of the study itself, at one point."""
    one = registry.load(study) if isinstance(study, str) else study
    return one.sweep(given).plan().run("sync").squeeze()


def same(one, other, names):
    for name in names:
        np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=name)


# Distributions.


def test_what_cannot_be_is_cut_away_and_told():
    scatter = parse("normal:0.05:0.02", "mu")
    share = stats.norm.cdf(-2.5)
    assert scatter.cut == pytest.approx(share, rel=1e-12)
    assert scatter.cut_note("mu") == "mu: 0.62 % of normal:0.05:0.02 is below 0 and was cut away"
    left = stats.truncnorm(-2.5, math.inf, 0.05, 0.02)
    at = np.linspace(0.001, 0.999, 201)
    np.testing.assert_allclose(scatter.ppf(at), left.ppf(at), rtol=1e-9)
    np.testing.assert_allclose(scatter.cdf(scatter.ppf(at)), at, rtol=1e-12)
    assert scatter.ppf(0.0) == 0.0
    assert parse("normal:0.2:0.02", "mu").cut_note("mu") == ""
    both = parse("uniform:-0.5:1.5", "point_b")
    assert both.cut == pytest.approx(0.5)
    assert both.cut_note("point_b") == "point_b: 50 % of uniform:-0.5:1.5 is below 0 or above 1 and was cut away"


def test_draws_keep_to_what_is_left():
    data = run("fig5", {}, scatter={"mu": "normal:0.05:0.05"}, samples=512)
    values = data["mu"].values
    assert values.min() > 0.0
    left = stats.truncnorm(-1.0, math.inf, 0.05, 0.05)
    assert stats.kstest(values, left.cdf).statistic < 0.01
    assert values.mean() == pytest.approx(left.mean(), rel=2e-3)
    assert data["mu"].attrs["distribution"] == "normal:0.05:0.05"
    assert data["mu"].attrs["cut_away"] == pytest.approx(stats.norm.cdf(-1.0))


def test_one_distribution_has_one_text():
    one, other = (computed(SPRING, {}, scatter={"k": t}, samples=4) for t in ("uniform:2e0:4", "uniform: 2.0:4.0"))
    assert one.request == other.request == {"scatter": {"k": "uniform:2:4"}, "seed": 0, "sampling": "sobol"}
    kinds = ["lognormal:2:0.1", "triangular:1:2:4", "normal:-3:1"]
    for kind, median in zip(kinds, (2.0, 4.0 - math.sqrt(3.0), -3.0), strict=True):
        # Of a number that the project does not know nothing is cut.
        assert parse(kind, "z").ppf(0.5) == pytest.approx(median)
        assert parse(kind, "z").cut == 0.0


# Scattered points are single runs.


def test_a_scattered_axis_is_a_grids_value():
    data = run("fig5", {}, scatter={"mu": "uniform:0.1:0.3"}, samples=8, seed=4)
    assert data["frequency"].dims == ("sample", "mode")
    for k in range(8):
        same(data.isel(sample=k), single("fig5", mu=[float(data["mu"][k])]), ["frequency", "growth_rate"])


def test_a_scattered_setting_is_a_loop_over_runs():
    scatter = {"p1_thickness": "uniform:1.4e-3:1.6e-3", "theta": "normal:5:1"}
    data = run("fig5", {"mu": [0.1, 0.2, 0.3]}, scatter=scatter, samples=5)
    assert data["frequency"].dims == ("sample", "mu", "mode")
    for k in range(5):
        own = {name: float(data[name][k]) for name in scatter}
        same(data.isel(sample=k), single("fig5", mu=[0.1, 0.2, 0.3], **own), ["frequency", "growth_rate"])


def test_motions_of_scattered_rigs_and_scenes(tmp_path):
    scatter = {"mu": "normal:0.2:0.02", "p1_thickness": "uniform:1.4e-3:1.6e-3", "V": "lognormal:2e-3:0.3"}
    data = run("scenes", RUN, scatter=scatter, samples=4)
    table = tmp_path / "rows.csv"
    millimetres = [float(f"{1e3 * t:.15g}") for t in data["p1_thickness"].values.tolist()]
    columns = zip(data["mu"].values.tolist(), millimetres, data["V"].values.tolist(), strict=True)
    lines = ["mu,p1_thickness [mm],V", *(",".join(map(repr, row)) for row in columns)]
    table.write_text("\n".join(lines))
    rows = run("scenes", RUN, points=table)
    names = [name for name in data.data_vars if name not in ("wall_time", "error")]
    assert rows["row"].values.tolist() == [1, 2, 3, 4]
    same(data, rows, [*names, *scatter])
    for k in range(4):
        own = {name: float(data[name][k]) for name in scatter}
        same(data.isel(sample=k).squeeze(), single("scenes", **RUN, **own), names)


def test_copies_are_computed_once():
    columns = {"V": [1e-3, 2e-3, 1e-3, 1e-3], "F": [9.0, 18.0, 9.0, 9.0], "p1_length": [0.05, 0.05, 0.06, 0.05]}
    given = {"mu": 0.2, "theta": 5.0, "duration": 0.02}
    plan = computed("scenes", given, points=columns).sweep(given).plan()
    # The second has twice the speed and load of the first, the third another rig, the fourth is the first.
    assert (plan.points, plan.distinct) == (4, 2)
    data = plan.run("sync").squeeze()
    assert data["mean_normal_force"][1] == 2.0 * data["mean_normal_force"][0]
    one = single("scenes", **given, V=2e-3, F=18.0)
    same(data.isel(row=1), one, ["mean_normal_force", "velocity_rms", "regime"])


def test_series_are_kept_of_scattered_scenes():
    made = computed("scenes", RUN, scatter={"mu": "normal:0.2:0.02", "head_mass": "uniform:2:3"}, samples=2)
    given = RUN | {"V": [2e-3]}
    data = made.sweep(given, record=("velocity_B",), sample_rate=1e4).plan().run("sync")
    own = given | {name: float(data[name][1]) for name in ("mu", "head_mass")}
    one = registry.load("scenes").sweep(own, record=("velocity_B",), sample_rate=1e4).plan().run("sync")
    same(data.isel(sample=1).squeeze(), one.squeeze(), ["velocity_B", "velocity_rms"])


def test_words_and_whole_numbers_in_a_table():
    data = run(SPRING, {"x": 2.0}, points={"how": ["once", "twice", "once"], "y": [5, 6, 6], "k": [1, 2, 3.5]})
    assert data["force"].dims == ("row", "x")
    assert data["force"].values.ravel().tolist() == [2.0, 8.0, 7.0]
    assert data["y"].dtype.kind == "i"


def test_a_draw_that_fails_leaves_the_others():
    data = run(SPRING, {}, scatter={"k": "uniform:0:3"}, samples=64)
    soft = data["k"].values < 1.0
    assert 0 < soft.sum() < 64
    np.testing.assert_array_equal((data["status"] == 2).any(("x", "y")), soft)
    assert set(data["error"].values[soft].ravel()) == {
        f"ValueError: stiffness = {k}: too soft" for k in data["k"].values[soft]
    }
    np.testing.assert_array_equal(
        data["force"].values[~soft], (data["k"] * data["x"]).broadcast_like(data["force"])[~soft]
    )
    assert f"{256 - 4 * soft.sum()} points computed, {4 * soft.sum()} failed." in text(findings(data))


# What is found.


def test_findings_and_figure():
    data = run(SPRING, {"x": 1.0, "y": 5}, scatter={"k": "normal:5:1", "factor": "uniform:1:1.2"}, samples=256)
    told = text(findings(data))
    assert told.startswith("256 draws of k, factor: 256 points computed, 0 failed.\n")
    values = np.quantile(data["force"].values, (0.05, 0.5, 0.95))
    assert [f"{value:.4g}" for value in values] == next(
        line for line in told.splitlines() if line.startswith("force ")
    ).split()[-3:]
    rho = stats.spearmanr(data["k"], data["force"].values.ravel()).statistic
    assert f"{rho:+.3f}" in told
    strongest = told.partition("strongest first:")[2].splitlines()[3:]
    numbers = [abs(float(line.split()[-1])) for line in strongest]
    assert numbers == sorted(numbers, reverse=True)
    figure = draw(data)
    assert len(figure.axes) == 4
    assert math.isnan(rank_correlation(np.ones(9), np.arange(9.0)))
    # More values at each point than anybody reads are counted, not told.
    assert "In the file alone, with more than 12 values at each point: powers" in text(
        findings(run(SPRING, {"x": [1.0, 2.0, 3.0]}, scatter={"k": "normal:5:1"}, samples=8))
    )


# How it is kept.


def test_a_result_is_found_grows_and_says_what_makes_it_again(tmp_path, undrawn):
    scatter = {"mu": "normal:0.2:0.02", "p1_thickness": "uniform:1.4e-3:1.6e-3"}
    for count, todo in ((4, 4), (10, 6), (3, 0)):
        plan = runner.plan("fig5", {}, tmp_path, scatter=scatter, samples=count, seed=1)
        assert plan.todo == todo
        runner.execute(plan, "sync")
    data = studies.open("fig5-scatter", tmp_path)
    assert data.sizes["sample"] == 10
    asked = config.of_result(data)
    assert (asked.study, asked.samples, asked.seed, asked.axes) == ("fig5", 10, 1, {})
    assert asked.scatter == {"mu": "normal:0.2:0.02", "p1_thickness": "uniform:0.0014:0.0016"}
    assert "p1_thickness" not in asked.settings
    study = registry.load("fig5")
    assert runner.plan(study, asked.values_of(study), tmp_path, **asked.where).todo == 0
    (tmp_path / "asked.toml").write_text(config.toml(asked))
    assert config.read(tmp_path / "asked.toml") == replace(asked, axes={}, settings=asked.settings)
    # A number of the rig is a column, in its place in the scene too.
    assert data.fiv.query("p1_thickness > 1.5e-3 and mode == 1", show="sample").shape[0] == 5
    assert data.fiv.scene(sample=3).rig.p1.thickness == float(data["p1_thickness"][3])
    assert data.fiv.scene(sample=3).mu == float(data["mu"][3])


def test_a_result_of_ones_own_study_is_shown_by_its_file_alone(tmp_path, undrawn, monkeypatch):
    monkeypatch.setattr(registry, "_registered", {})
    runner.run(SPRING, {"x": 1.0}, tmp_path, scatter={"k": "uniform:2:4"}, samples=8)
    registry._registered.clear()  # as another process would
    with studies.open("spring-scatter", tmp_path) as data:
        shown = results.study_of(data)
        assert shown.title == "spring, at scattered points"
        assert shown.report(data).startswith("8 draws (sobol, seed 0) of k, each at 2 points of y: 16 points")
        assert len(runner.drawn(shown, data).axes) == 2


def test_a_table_that_changed_is_refused(tmp_path, undrawn):
    columns = {"mu": [0.1, 0.2, 0.3], "theta": [5.0, 6.0, 7.0]}
    runner.run("fig5", {}, tmp_path, points=columns)
    longer = {name: [*values, 0.4] for name, values in columns.items()}
    assert runner.plan("fig5", {}, tmp_path, points=longer).todo == 1
    changed = columns | {"mu": [0.1, 0.25, 0.3]}
    with pytest.raises(StoreError, match=r"has other points: mu = 0.2 there, 0.25 here, at row = 2; start over"):
        runner.plan("fig5", {}, tmp_path, points=changed)
    with studies.open("fig5-points", tmp_path) as data:
        assert config.of_result(data).points == columns


# What is refused.


@pytest.mark.parametrize(
    ("study", "given", "where", "message"),
    [
        ("fig5", {}, {"samples": 8}, "--samples 8: it says how numbers are drawn; say which with --scatter"),
        ("fig5", {}, {"scatter": {"mu": "normal:1:1"}, "points": "x.csv"}, "leave one out"),
        ("fig5", {"mu": 0.1}, {"scatter": {"mu": "normal:1:1"}}, "--scatter mu: it is set too"),
        ("fig5", {}, {"scatter": {"nu": "normal:1:1"}}, "no axis and no setting of that name; did you mean mu"),
        ("fig5", {}, {"scatter": {"mu": "normal:-9:1"}}, "100 % of it is beyond what mu can be, 0 to inf"),
        ("fig5", {}, {"scatter": {"mu": "normal:1"}}, "normal takes 2 numbers, not 1; the forms are normal:MEAN"),
        (
            "fig5",
            {},
            {"scatter": {"mu": "uniform:,1:2"}},
            "',' separates no numbers here, ':' does; the forms are",
        ),
        ("fig5", {}, {"scatter": {"mu": "gauss:1:1"}}, "'gauss' is none of normal, uniform, lognormal"),
        ("fig5", {}, {"scatter": {"mu": "normal:1:0"}}, "SD must be above 0, not 0"),
        ("fig5", {}, {"scatter": {"mu": "uniform:1:1"}}, "LOW = 1 must be below HIGH = 1"),
        (
            "fig7",
            {},
            {"scatter": {"V": "uniform:-1e308:1e308"}},
            "HIGH - LOW must be at most 1.8e.308, not 1e",
        ),
        ("fig7", {}, {"scatter": {"V": "triangular:-1e308:0:1e308"}}, "HIGH - LOW must be at most"),
        ("fig5", {}, {"scatter": {"mu": "triangular:1:5:2"}}, "MODE must be from LOW = 1 to HIGH = 2, not 5"),
        ("fig5", {}, {"scatter": {"mu": "lognormal:-1:1"}}, "MEDIAN must be above 0, not -1"),
        ("fig5", {}, {"scatter": {"mu": "normal:a:1"}}, "'a' must be a finite number"),
        ("fig5", {}, {"scatter": {"mu": "normal:1:1"}, "samples": 0}, "--samples = 0: it must be a whole"),
        ("fig5", {}, {"scatter": {"mu": "normal:1:1"}, "sampling": "x"}, "--sampling = 'x': it must be one of"),
        ("fig5", {}, {"scatter": {"mu": "normal:1:1"}, "seed": -1}, "--seed = -1: it must be a whole"),
        ("fig5", {}, {"scatter": {"p1_elements": "uniform:9:20"}}, "p1_elements: it is a whole number"),
        (SPRING, {}, {"scatter": {"y": "uniform:9:20"}}, "y: it is a whole number; choose some with --set"),
        (SPRING, {}, {"scatter": {"how": "uniform:9:20"}}, "how: it is one of once, twice, and no number"),
        (SPRING, {}, {"scatter": {"x": "uniform:-9:1"}}, "x = -[.0-9]*: it must be 0 or above"),
        ("fig5", {}, {"scatter": {"contact_position": "uniform:1:2"}}, "at most P2's length"),
        ("fig7", {}, {"scatter": {"duration": "uniform:1:2"}}, "duration: it decides the shape of what study"),
        ("map", {}, {"scatter": {"mu": "normal:1:1"}}, "map is not one function of its axes"),
        ("fig5-scatter", {}, {"scatter": {"mu": "normal:1:1"}}, "fiv run fig5 --scatter NAME=DISTRIBUTION"),
    ],
)
def test_what_cannot_be_scattered(study, given, where, message):
    with pytest.raises(InputError, match=message) as refused:
        computed(study, given, **where).sweep(given)
    assert "\n" not in str(refused.value)


def test_series_need_one_length():
    made = computed("scenes", {}, scatter={"duration": "uniform:1:2"}, samples=4)
    with pytest.raises(InputError, match="series need one duration, and that scatters; set it"):
        made.sweep({}, record=("velocity_B",))


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("", "it is empty; its first line must name columns, for example mu,theta,"),
        ("mu\n\n", "it has no row below its heads"),
        ("mu;theta\n0,2;5", "line 1: 'mu;theta': its cells are separated by semicolons; separate them by commas"),
        ("mu\ttheta\n1\t2", "separated by tabs"),
        ("contact_position\t[mm]\tmu\n1\t2", "separated by tabs"),
        (
            "mu,thickness\n1,2",
            "line 1, column 'thickness': study fig5 has no axis and no setting of that name; did",
        ),
        ("mu,mu\n1,2", "line 1: the column mu stands there twice"),
        ("mu,theta [mm]\n1,2", r"line 1, column 'theta \[mm\]': \[mm\] measures \[length\], but \[degree\]"),
        ("mu,d1 [wobble]\n1,2", r"\[wobble\] is no unit"),
        ("mu,theta\n0.1,5\n0.2", "line 3: it has 1 cell, '0.2'; it must have 2, one for each of mu, theta"),
        ("mu\n0.1,5", "line 2: it has 2 cells, '0.1', '5'; it must have 1"),
        ("mu\n0.1\nsmall", "line 3, column mu: 'small': it must be a finite number"),
        ('mu\n"0,1"', "line 2, column mu: '0,1': it must be a finite number; write a decimal point"),
        ("mu\nnan", "line 2, column mu: 'nan': it must be a finite number"),
        ("mu,theta\n0.1,\n", "line 2, column theta: '': it must be a finite number"),
        ("mu\n\n\n-0.1", "line 4, column mu: -0.1: it must be 0 or above"),
        ("theta\n5\n90", "line 3, column theta: 90: it must be between -90 and 90 degree"),
        ("contact_position [mm]\n80\n800", "line 3: contact_position = 0.8: it must be above 0 and at most P2's"),
        ("p1_elements\n30\n30.5", "line 3: p1_elements = 30.5: it must be a whole number"),
        ('mu\n"0.1', "it is not CSV: "),
    ],
)
def test_a_bad_table_is_one_line(tmp_path, lines, message):
    file = tmp_path / "rows.csv"
    file.write_text(lines)
    with pytest.raises(InputError, match=message) as refused:
        computed("fig5", {}, points=file).sweep({})
    assert str(refused.value).startswith(f"--points {file}: ")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"x": [1.0, -1.0]}, "points: row 2: x = -1: it must be 0 or above"),
        ({"y": [5, 5.5]}, "points: row 2, column y: 5.5: it must be a whole number"),
        ({"how": ["once", "twic"]}, "points: row 2, column how: 'twic': did you mean twice"),
        ({"x": [1.0], "k": [1.0, 2.0]}, "they must have one for each row"),
    ],
)
def test_a_bad_row_of_columns(columns, message):
    with pytest.raises(InputError, match=message):
        computed(SPRING, {}, points=columns).sweep({})


def test_a_spreadsheets_file(tmp_path):
    file = tmp_path / "rows.csv"
    file.write_bytes("\ufeffmu , p1_thickness [mm]\r\n0.2,1.5\r\n\r\n0.2,1.5\r\n".encode())
    data = run("fig5", {}, points=file)
    assert data["p1_thickness"].values.tolist() == [1.5e-3, 1.5e-3]
    assert data["p1_thickness"].attrs["units"] == "m"
    # Equal rows are two rows.
    np.testing.assert_array_equal(data["frequency"][0], data["frequency"][1])
    for head in ("p1_thickness\t[mm]", "\tp1_thickness \t[\tmm ]\t", "p1_thickness\t[mm],mu"):
        file.write_text(f"{head}\n{'1.5,0.2' if ',' in head else '1.5'}\n")
        assert table(registry.load("fig5"), file).columns["p1_thickness"].tolist() == [1.5e-3]
    file.write_bytes(b"mu\xff\n0.2")
    with pytest.raises(InputError, match="it is not a text in UTF-8"):
        computed("fig5", {}, points=file)
    with pytest.raises(InputError, match=r"none.csv: it cannot be read: No such file"):
        computed("fig5", {}, points=tmp_path / "none.csv")
