"""Any study at draws or at the rows of a table: the values are those of single runs, bit for bit."""

import numpy as np
import pytest

import studies
from studies import registry, runner
from studies.answering import summary
from studies.asking import request
from studies.asking.request import Request
from studies.asking.sweep import sweep_of

RUN = {"theta": 5.0, "F": 9.0, "duration": 0.05}


def run(name, values, **how):
    study, requested = registry.load(name), Request(name, values, **how)
    return sweep_of(study, requested.values_of(study), **requested.points_of(study)).plan().run("sync")


def same(one, other, names):
    for name in names:
        np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=name)


def test_drawn_rigs_are_a_loop_over_runs_and_drawn_axes_values_of_the_grid():
    drawn = {"p1_thickness": "uniform:1.4mm:1.6mm", "theta": "normal:5:1"}
    data = run("fig5", {"mu": [0.1, 0.2, 0.3], **drawn}, samples=3)
    assert data["frequency"].dims == ("sample", "mu", "mode")
    for k in range(3):
        numbers = {name: float(data[name][k]) for name in drawn}
        same(data.isel(sample=k), run("fig5", {"mu": [0.1, 0.2, 0.3], **numbers}), ["frequency", "growth_rate"])
    data = run("fig5", {"mu": "uniform:0.1:0.3"}, samples=2)
    same(data.isel(sample=1), run("fig5", {"mu": float(data["mu"][1])}).squeeze(), ["frequency", "growth_rate"])


def test_motions_at_draws_at_rows_and_alone(tmp_path):
    drawn = {"mu": "normal:0.2:0.02", "p1_thickness": "uniform:1.4e-3:1.6e-3", "V": "lognormal:2e-3:0.3"}
    data = run("scenes", RUN | drawn, samples=4)
    millimetres = [float(f"{1e3 * t:.15g}") for t in data["p1_thickness"].values.tolist()]
    columns = zip(data["mu"].values.tolist(), millimetres, data["V"].values.tolist(), strict=True)
    table = tmp_path / "rows.csv"
    table.write_text("\n".join(["mu,p1_thickness [mm],V", *(",".join(map(repr, row)) for row in columns)]))
    rows = run("scenes", RUN, points=table)
    names = [name for name in data.data_vars if name not in ("wall_time", "error")]
    assert rows["row"].values.tolist() == [1, 2, 3, 4]
    same(data, rows, [*names, *drawn])
    for k in (0, 3):
        numbers = {name: float(data[name][k]) for name in drawn}
        same(data.isel(sample=k).squeeze(), run("scenes", RUN | numbers).squeeze(), names)


def test_equivalent_rows_are_computed_once():
    columns = {"V": [1e-3, 2e-3, 1e-3, 1e-3], "F": [9.0, 18.0, 9.0, 9.0], "p1_length": [0.05, 0.05, 0.06, 0.05]}
    study, fixed = registry.load("scenes"), {"mu": 0.2, "theta": 5.0, "duration": 0.02}
    plan = sweep_of(study, fixed, rows=columns).plan()
    # The second has twice the speed and load of the first, the third another rig, the fourth is the first.
    assert (plan.points, plan.distinct) == (4, 2)
    single = run("scenes", fixed | {"V": 2e-3, "F": 18.0}).squeeze()
    same(plan.run("sync").squeeze().isel(row=1), single, ["mean_normal_force", "velocity_rms", "regime"])


def test_a_draw_that_fails_leaves_the_others_and_all_have_a_summary_and_a_figure():
    data = run("fig5", {"mu": 0.2, "contact_position": "uniform:0.1:0.2"}, samples=16)
    beyond = data["contact_position"].values > 0.15
    assert 0 < beyond.sum() < 16
    np.testing.assert_array_equal(data["status"].squeeze() == 2, beyond)
    assert np.isfinite(data["frequency"].values[~beyond]).any()
    text = summary.text(summary.parts(registry.load("fig5"), data), 100)
    assert f"{16 - beyond.sum()} of 16 points" in text
    assert "contact_position" in text
    assert "No output has one number a point; fiv query prints them." in text
    assert runner.draw(registry.load("fig5"), data)[""].axes


def test_a_result_grows_and_its_file_says_how_to_compute_it_again(tmp_path, undrawn):
    study, drawn = registry.load("fig5"), {"mu": "normal:0.2:0.02", "p1_thickness": "uniform:1.4e-3:1.6e-3"}
    for count, todo in ((4, 4), (10, 6), (3, 0)):
        plan = runner.plan(study, Request("fig5", drawn, samples=count, seed=1), tmp_path)
        assert plan.todo == todo
        runner.execute(study, plan, "sync")
    with studies.open("fig5", tmp_path) as data:
        again = request.of_result(data)
    assert (again.study, again.samples, again.seed) == ("fig5", 10, 1)
    assert drawn.items() <= again.values.items()
    assert runner.plan(study, again, tmp_path).todo == 0


@pytest.mark.parametrize(
    ("study", "values", "how", "message"),
    [
        ("fig5", {"mu": "normal:1:1"}, {"points": {"theta": [5.0]}}, "leave one out"),
        ("fig5", {"nu": "normal:1:1"}, {}, "no such parameter; did you mean mu"),
        ("fig5", {"mu": "normal:1:1"}, {"samples": 0}, "count = 0: it must be a whole"),
        ("fig5", {"p1_elements": "uniform:9:20"}, {}, "p1_elements = uniform:9:20: it has no distribution"),
        ("fig5", {"contact_position": "uniform:1:2"}, {}, "at most P2's length"),
        ("fig7", {"duration": "uniform:1:2"}, {}, "duration: it decides the size of the results of study fig7"),
        ("fig5", {}, {"points": {"p1_elements": [5, 5.5]}}, "p1_elements = 5.5: it must be a whole number"),
        ("fig5", {}, {"points": {"theta": [5.0, 90.0]}}, "row 2: theta = 90.0"),
    ],
)
def test_wrong_draws_and_columns_are_one_line(study, values, how, message):
    with pytest.raises(ValueError, match=message) as refused:
        run(study, values, **how)
    assert "\n" not in str(refused.value)
