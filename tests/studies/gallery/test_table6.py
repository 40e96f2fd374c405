"""Table 6: windows of instability, motion over the inclination, and the paper's text beside."""

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from fivcore import Rig, Scene, simulate, sliding_modes, unstable_windows
from studies import claims, paper, registry, runner
from studies.gallery.table6 import figure, findings, study, windows
from studies.motion import ensembles, regimes, transients
from studies.plotting import figures

# Angles on either side of every bound, and all of which the paper's text gives a number.
ANGLES = [-5.0, 0.0, 0.5, 1.0, 2.5, 5.0, 10.0, 10.5, 11.0, 12.0, 12.5, 15.0]
SHORT = {"members": 2, "least": 0.4, "most": 0.65}
STUDY = registry.load("table6")
STEADY, INTERMITTENT, IRREGULAR = map(transients.REGIMES.index, ("steady sliding", "intermittent", "irregular"))


def vibrates(codes):
    return regimes.is_of(codes, *regimes.VIBRATING)


@pytest.fixture(scope="module")
def computed(computed):
    return lambda **given: computed("table6", **SHORT | {"theta": ANGLES} | given)


@pytest.fixture(scope="module")
def angles(computed):
    return computed()


@pytest.fixture(autouse=True)
def _style():
    with figures.style():
        yield


def shown(dataset):
    """The report of a dataset whose figure can be drawn."""
    STUDY.draw(dataset).canvas.draw()
    return STUDY.report(dataset)


def labels_of(dataset):
    """What the figure's legends name."""
    legends = filter(None, (axes.get_legend() for axes in STUDY.draw(dataset).axes))
    return {text.get_text() for legend in legends for text in legend.get_texts()}


def rows_of(dataset):
    """What the table of claims says: paper, here and difference of each."""
    parts = claims.beside(dataset, findings.CLAIMS)
    return [row[2:5] for row in parts[1].rows] if parts else []


def test_the_rig_vibrates_where_a_mode_is_unstable_and_nowhere_else(angles):
    unstable = angles["unstable_modes"].values > 0
    np.testing.assert_array_equal(angles["theta"].values[unstable], [1.0, 2.5, 5.0, 10.0, 10.5])
    np.testing.assert_array_equal(vibrates(angles["regime"]), unstable)
    np.testing.assert_array_equal(angles["regime"].values[~unstable], STEADY)
    # Where none grows, d1 on the mass is all that the slowest mode decays by.
    slowest = angles["mode_growth_rate"].values[~unstable]
    np.testing.assert_allclose(slowest, -0.5 * Rig().d1, rtol=1e-3)


def test_unstable_pairs_and_windows_are_those_of_the_stability_analysis(angles):
    at = angles.sel(theta=5.0)
    np.testing.assert_allclose(at["frequency"][:2], [398.0, 2794.0], atol=1.0)
    np.testing.assert_allclose(at["growth_rate"][:2], [384.0, 1764.0], atol=1.0)
    for theta in angles["theta"].values:
        here, modes = angles.sel(theta=theta), sliding_modes(Rig(), theta, paper.MU)
        for name in ("frequency", "growth_rate"):
            np.testing.assert_array_equal(here[name].dropna("pair"), getattr(modes, name)[modes.unstable])
        assert int(here["unstable_modes"]) == modes.unstable.sum()
    solver = unstable_windows(Rig(), paper.MU, -5.0, 15.0)
    np.testing.assert_allclose(solver.theta_from, [1.971, 0.623], atol=1e-3)
    for name, (field, _, _) in windows.WINDOWS.items():
        np.testing.assert_array_equal(angles[f"window_{name}"], getattr(solver, field), err_msg=name)


def test_the_mirror_image_is_the_same_rig(computed):
    right = computed(theta=[0.0, 5.0, 12.0])
    left = computed(theta=[-12.0, -5.0, 0.0], V=-paper.ANGLES_SPEED)
    for name in study.VARIABLES:
        np.testing.assert_array_equal(left[name][::-1], right[name], err_msg=name)
    for name, other in (("from", "to"), ("to", "from"), ("peak_theta", "peak_theta")):
        np.testing.assert_allclose(left[f"window_{name}"], -right[f"window_{other}"], rtol=1e-9)
    np.testing.assert_array_equal(left["window_open_from"], right["window_open_to"])
    np.testing.assert_allclose(left["window_frequency_to"], right["window_frequency_from"], rtol=1e-9)
    assert not np.any(np.signbit(left["window_to"]) & (left["window_to"] == 0.0))
    # The paper's text is of V > 0.
    assert rows_of(right)
    assert not rows_of(left)


def test_only_what_vibrates_has_a_dominant_frequency_and_it_is_near_the_measured_one(angles):
    line = angles["member_dominant_frequency"]
    np.testing.assert_array_equal(np.isfinite(line), vibrates(angles["member_regime"]))
    for theta, measured in paper.ANGLES_MEASURED.items():
        assert float(angles["dominant_frequency"].sel(theta=theta)) == pytest.approx(measured, rel=0.05)


def test_members_are_runs_of_their_own_and_make_the_figures_of_their_angle(angles):
    at = angles.sel(theta=5.0)
    duration = float(at["duration"])
    for number, member in enumerate(angles["member"].values, 1):
        scene = Scene(paper.ANGLES_SPEED, 5.0, paper.MU, paper.LOAD)
        given = {"numerical_damping": "published", "ramp": ensembles.ramp_of(number, 1e-3)}
        run = simulate(scene, duration, **given).summary
        assert run["velocity_rms"] == float(at["member_velocity_rms"].sel(member=member))
        assert run["dominant_frequency"] == float(at["member_dominant_frequency"].sel(member=member))
    assert float(at["velocity_rms"]) == pytest.approx(float(at["member_velocity_rms"].mean()))
    shares = sum(at[f"{state}_fraction"] for state in transients.STATES)
    assert float(shares) == pytest.approx(1.0)


def members(monkeypatch, *each):
    """Regime, its share and dominant frequency of an ensemble whose runs have these regimes and frequencies."""
    runs = [dict.fromkeys(study.KEPT, 1.0) | {"regime": r, "dominant_frequency": line} for r, line in each]
    monkeypatch.setattr(transients, "figures_of", lambda run: run)
    values = study.ensemble(runs)
    return values["regime"], values["regime_share"], values["dominant_frequency"]


def test_most_members_decide_and_of_two_rival_lines_one_is_taken(monkeypatch):
    steady = (STEADY, 460.0)  # what is left of a motion that dies is no vibration's line
    runs = [(INTERMITTENT, 2660.0), (IRREGULAR, 1929.0), (INTERMITTENT, 2661.0), steady]
    assert members(monkeypatch, *runs) == (INTERMITTENT, 0.5, 2660.0)
    assert members(monkeypatch, (IRREGULAR, 2660.0), steady) == (IRREGULAR, 0.5, 2660.0)
    assert np.isnan(members(monkeypatch, steady)[2])


@given(st.lists(st.floats(200.0, 1e4) | st.just(np.nan), max_size=9))
def test_the_middle_line_is_one_of_them(lines):
    known = np.array([line for line in lines if np.isfinite(line)])
    middle = ensembles.middle(np.array(lines, dtype=float))
    assert middle in known if len(known) else np.isnan(middle)
    assert max(np.sum(known < middle), np.sum(known > middle)) <= len(known) / 2


def test_of_more_pairs_than_places_the_fastest_are_kept(monkeypatch, angles):
    monkeypatch.setattr(study, "PAIRS", 1)
    values = study.unstable_pairs(Scene(2e-3, 5.0, 0.2, 9.0))
    assert values["unstable_modes"] == 2
    np.testing.assert_allclose(values["frequency"], [2794.0], atol=1.0)
    text = shown(angles.isel(pair=[0]))
    assert "More than 1 modes are unstable, and the 1 fastest are kept: theta = 2.5, 5 degrees." in text


def test_the_papers_text_stands_beside_the_model(angles):
    """At 5 degrees 2700 Hz and pairs at 400 and 2800 Hz; at 10 degrees 2700 Hz; at 15, < 0 and > 12 steady."""
    line, frequency = angles["dominant_frequency"], angles["frequency"]
    pairs = [frequency.sel(theta=5.0, pair=pair) for pair in (1, 2)]
    at = [line.sel(theta=5.0), line.sel(theta=5.0), *pairs, line.sel(theta=10.0)]
    values = zip((2700.0, 2700.0, 400.0, 2800.0, 2700.0), map(float, at), strict=True)
    numbers = [[f"{text:g}", f"{here:.4g}", f"{100.0 * (here / text - 1.0):+.1f} %"] for text, here in values]
    assert rows_of(angles) == [*numbers, *[["steady sliding", "steady sliding", "none"]] * 3]
    assert "Table 6 is not at hand" in shown(angles)
    points = figure.paper_points(angles["theta"].values)
    assert {label: places.tolist() for label, places in points.items()} == {
        "paper: dominant, measured": [[5.0, 2700.0], [10.0, 2700.0]],
        "paper: dominant, simulated": [[5.0, 2700.0]],
        "paper: unstable pair": [[5.0, 400.0], [5.0, 2800.0]],
    }
    assert {*figure.PAPER, "paper: vibrates", "paper: says nothing"} <= labels_of(angles)


def test_another_motion_than_the_papers_is_shown_as_a_difference(angles):
    other = angles.copy(deep=True)
    other["regime"].loc[{"theta": 12.5}] = INTERMITTENT
    other["dominant_frequency"].loc[{"theta": 10.0}] = np.nan
    rows = rows_of(other)
    assert rows[4] == ["2700", "-", "-"]
    assert rows[7] == ["steady sliding", "intermittent, steady sliding", "differs"]
    # At neither end of a range does the text say anything.
    other["regime"].loc[{"theta": [0.0, 12.0]}] = INTERMITTENT
    assert rows_of(other) == rows
    other["status"].loc[{"theta": 15.0}] = 0
    other["regime"] = other["regime"].where(other["status"] == 1)
    assert rows_of(other)[5] == ["steady sliding", "-", "-"]


@pytest.mark.parametrize("other", [{"V": 1e-3}, {"F": 10.0}, {"head_mass": 3.0}])
def test_beside_another_operating_point_the_paper_says_nothing(other, computed):
    data = computed(theta=[5.0, 15.0], most=0.2, **other)
    assert not rows_of(data)
    assert "paper" not in shown(data)
    labels = labels_of(data)
    assert labels
    assert not any("paper" in label for label in labels)


def table(dataset, head):
    """The rows of one table of the report."""
    (part,) = (part for part in findings.findings(dataset) if getattr(part, "heads", [""])[0] == head)
    return [list(row) for row in part.rows]


def test_the_report_counts_the_runs_and_shows_the_papers_angles(monkeypatch, angles):
    monkeypatch.setattr(findings, "MOST_ROWS", 3)
    assert [row[0] for row in table(angles, "theta deg")] == ["-5", "5", "10", "15"]
    assert "and 8 more in the file." in shown(angles)
    counts = {name: [*map(int, row)] for name, *row in table(angles, "runs by unstable modes")}
    assert counts.pop("steady sliding") == [14, 0, 0]
    assert np.sum([*counts.values()], axis=0).tolist() == [0, 6, 4]


def test_a_file_is_completed_and_its_windows_found_again(tmp_path):
    first, _ = (
        STUDY.sweep(SHORT | {"most": 0.2, "theta": theta}).plan(tmp_path / "table6.nc").run("sync")
        for theta in ([5.0, 8.0], [0.0, 15.0])
    )
    np.testing.assert_array_equal(first["window_open_from"], 1)
    with xr.open_dataset(tmp_path / "table6.nc") as plain:
        whole = plain.load()
    np.testing.assert_array_equal(whole["theta"], [0.0, 5.0, 8.0, 15.0])
    np.testing.assert_array_equal(whole["window_open_from"], 0)


def test_a_point_without_a_solution_keeps_its_error(tmp_path):
    finished = runner.run("table6", SHORT | {"theta": [10.0, 40.0], "mu": 2.2, "most": 0.5}, tmp_path)
    np.testing.assert_array_equal(finished.dataset["status"], [1, 2])
    text = finished.study.report(finished.dataset)
    assert "failed: theta = 40: ContactError: mu = 2.2" in text
    assert "The runs were cut short at most = 0.5 s: theta = 10 degrees." in text
    assert finished.figure.is_file()


def test_what_is_pending_or_failed_leaves_gaps(angles):
    some = angles.copy(deep=True)
    some["status"][5:7] = [0, 2]
    for name in study.VARIABLES:
        some[name] = some[name].where(some["status"] == 1)
    assert [row[4] for row in table(some, "theta deg")][5:7] == ["pending", "failed"]
    assert "failed: theta = 10" in shown(some)
    some["status"][:] = 0
    for name in study.VARIABLES:
        some[name] = some[name].where(False)
    assert shown(some.isel(window=slice(0))).count("pending") == len(ANGLES)


def test_windows_that_cannot_be_found_are_told_and_all_else_is_kept(monkeypatch, computed):
    def fails(*args):
        raise ArithmeticError("onsets near theta = 1 cannot be told apart")

    monkeypatch.setattr(windows, "unstable_windows", fails)
    data = computed(theta=[5.0, 15.0], most=0.2)
    assert data.sizes["window"] == 0
    assert "could not be found: onsets near theta = 1 cannot be told apart." in shown(data)
    assert float(data["unstable_modes"].sel(theta=5.0)) == 2


def test_what_a_user_may_act_on_is_told(angles):
    angles = angles.copy(deep=True)
    # Runs as short as these may have another line.
    angles["member_dominant_frequency"].loc[{"theta": 2.5}] = 2650.0
    text = shown(angles.isel(window=[0]))
    assert "not begin to grow by flutter within the band: theta = 1, 2.5, 5, 10, 10.5 degrees." in text
    assert "The runs differ" not in text
    other = angles.copy(deep=True)
    other["member_regime"][0, 0] = INTERMITTENT
    other["member_dominant_frequency"][5] = [2000.0, 2600.0]
    assert (
        "The runs differ in regime, or their dominant frequencies lie far apart: theta = -5, 5 degrees."
        in shown(other)
    )
    (one,) = ([row[0], row[7]] for row in table(other, "theta deg") if row[0] == "5")
    assert one == ["5", "2000-2600"]
    assert "A single inclination has no window" in shown(angles.isel(theta=[5], window=slice(0)))


@given(st.lists(st.floats(1.0, 1e4), max_size=12))
def test_panels_of_frequency_hold_every_line(lines):
    lines = np.sort(np.array(lines))
    tiers = figure.bands(lines)
    assert 1 <= len(tiers) <= figure.MOST_BANDS
    assert all(any(low < line < high for low, high in tiers) for line in lines)
    # Panels are ascending, and what is apart by less than the factor shares one.
    for (_, high), (low, _) in pairwise(tiers):
        assert low / high > figure.APART * 0.93 / 1.05 - 1e-9


@given(st.lists(st.lists(st.floats(1.0, 1e4), max_size=3), min_size=1, max_size=6))
def test_branches_hold_every_pair_once_and_do_not_jump(rows):
    frequency = np.full((len(rows), 3), np.nan)
    for k, row in enumerate(rows):
        frequency[k, : len(row)] = np.sort(row)
    places = [place for branch in figure.branches(frequency) for place in zip(*branch, strict=True)]
    assert sorted(places) == [tuple(place) for place in np.argwhere(np.isfinite(frequency))]
    for branch in figure.branches(frequency):
        np.testing.assert_array_equal(np.diff(branch[0]), 1)
        line = frequency[branch]
        assert np.all(np.abs(np.diff(line)) <= figure.SAME * line[1:])


@pytest.mark.slow
def test_the_whole_table():
    """Half a degree apart, every ensemble does what stability says of its angle."""
    data = STUDY.sweep({}).plan().run()
    unstable = data["unstable_modes"].values > 0
    np.testing.assert_array_equal(vibrates(data["member_regime"]).all(axis=1), unstable)
    np.testing.assert_array_equal((data["member_regime"] == STEADY).all(axis=1), ~unstable)
    inside = (data["window_from"].values.min() < data["theta"]) & (data["theta"] < data["window_to"].values.max())
    np.testing.assert_array_equal(unstable, inside)
    line = data["dominant_frequency"].values[unstable]
    assert np.all((line > 2580.0) & (line < 2700.0))
