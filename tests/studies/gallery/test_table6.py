"""Table 6: windows of instability, motion over the inclination, and what the paper's text says of it."""

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from fivcore import Rig, Scene, simulate, sliding_modes
from studies import paper, registry, runner
from studies.gallery.table6 import figure as table6_figure
from studies.gallery.table6 import findings as table6_report
from studies.gallery.table6 import study as table6
from studies.gallery.table6 import windows as table6_angles
from studies.gallery.table6.windows import NOT_STATED, SLIDES, STEADY, VIBRATES, VIBRATING
from studies.motion import ensembles, transients
from studies.plotting import figures

# Angles on either side of every bound, and all of which the paper's text gives a number.
ANGLES = [-5.0, 0.0, 0.5, 1.0, 2.5, 5.0, 10.0, 10.5, 11.0, 12.0, 12.5, 15.0]
SHORT = {"members": 2, "least": 0.4, "load_ups": 2.0}
STUDY = registry.load("table6")


def computed(**other):
    """The study's dataset, without a file."""
    return STUDY.sweep(SHORT | {"theta": ANGLES} | other).plan().run("sync")


@pytest.fixture(scope="module")
def angles():
    return computed()


@pytest.fixture(autouse=True)
def _style():
    with figures.style():
        yield


def said(dataset):
    """The report, and that the figure can be drawn."""
    figure = STUDY.draw(dataset)
    figure.canvas.draw()
    return STUDY.report(dataset)


def test_the_rig_vibrates_where_a_mode_is_unstable_and_nowhere_else(angles):
    unstable = angles["unstable_modes"].values > 0
    np.testing.assert_array_equal(angles["theta"].values[unstable], [1.0, 2.5, 5.0, 10.0, 10.5])
    np.testing.assert_array_equal(np.isin(angles["regime"], VIBRATING), unstable)
    np.testing.assert_array_equal(angles["regime"].values[~unstable], STEADY)
    # Where none grows, d1 on the mass is all that the slowest mode decays by.
    slowest = angles["mode_growth_rate"].values[~unstable]
    np.testing.assert_allclose(slowest, -0.5 * Rig().d1, rtol=1e-3)


def test_unstable_pairs_are_those_of_the_stability_analysis(angles):
    at = angles.sel(theta=5.0)
    np.testing.assert_allclose(at["frequency"][:2], [398.0, 2794.0], atol=1.0)
    np.testing.assert_allclose(at["growth_rate"][:2], [384.0, 1764.0], atol=1.0)
    for theta in angles["theta"].values:
        here, modes = angles.sel(theta=theta), sliding_modes(Rig(), theta, paper.MU)
        count = int(here["unstable_modes"])
        assert count == modes.unstable.sum()
        np.testing.assert_array_equal(here["frequency"][:count], modes.frequency[modes.unstable])
        np.testing.assert_array_equal(here["growth_rate"][:count], modes.growth_rate[modes.unstable])
        assert np.all(np.isnan(here["frequency"][count:]))


def test_windows_end_where_a_pair_begins_or_ceases_to_grow(angles):
    np.testing.assert_allclose(angles["window_from"], [1.971, 0.623], atol=1e-3)
    np.testing.assert_allclose(angles["window_to"], [9.348, 10.680], atol=1e-3)
    np.testing.assert_array_equal(angles["window_open_from"], 0)
    np.testing.assert_array_equal(angles["window_open_to"], 0)
    for k in range(angles.sizes["window"]):
        at = angles.isel(window=k)
        for bound, inward in ((at["window_from"], 1e-3), (at["window_to"], -1e-3)):
            sides = np.array([float(bound) + inward, float(bound) - inward])
            inside, outside = sliding_modes(Rig(), sides, paper.MU).unstable.sum(axis=1)
            assert inside == outside + 1
        # Flutter needs 0 < tan(theta) < mu.
        assert 0.0 < float(at["window_from"]) < float(at["window_to"]) < np.degrees(np.arctan(paper.MU))


def test_windows_go_on_beyond_a_range_that_cuts_them():
    found, comment = table6_angles.windows(Rig(), paper.MU, 2e-3, 3.0, 10.0)
    assert comment == ""
    np.testing.assert_array_equal(found["from"], 3.0)
    np.testing.assert_array_equal(found["open_from"], 1)
    np.testing.assert_allclose(found["to"], [9.348, 10.0], atol=1e-3)
    np.testing.assert_array_equal(found["open_to"], [0, 1])


@pytest.mark.parametrize(("mu", "low", "high"), [(paper.MU, 5.0, 5.0), (0.0, -10.0, 20.0), (paper.MU, 11.0, 20.0)])
def test_there_may_be_no_windows(mu, low, high):
    found, comment = table6_angles.windows(Rig(), mu, 2e-3, low, high)
    assert comment == ""
    assert all(len(values) == 0 for values in found.values())


def test_the_mirror_image_is_the_same_rig():
    right = computed(theta=[0.0, 5.0, 12.0])
    left = computed(theta=[-12.0, -5.0, 0.0], V=-paper.ANGLES_SPEED)
    for name in table6.VARIABLES:
        np.testing.assert_array_equal(left[name][::-1], right[name], err_msg=name)
    for name, other in (("from", "to"), ("to", "from"), ("peak_theta", "peak_theta")):
        np.testing.assert_allclose(left[f"window_{name}"], -right[f"window_{other}"], rtol=1e-9)
    np.testing.assert_array_equal(left["window_open_from"], right["window_open_to"])
    np.testing.assert_allclose(left["window_frequency_to"], right["window_frequency_from"], rtol=1e-9)
    assert not np.any(np.signbit(left["window_to"]) & (left["window_to"] == 0.0))
    # The paper tells of the one; the other is its mirror image, of which it tells under another sign.
    assert np.all(left["stated_paper"] == NOT_STATED)


def test_only_what_vibrates_has_a_main_line_and_it_is_near_the_measured_one(angles):
    vibrates = np.isin(angles["member_regime"], VIBRATING)
    np.testing.assert_array_equal(np.isfinite(angles["member_dominant_frequency"]), vibrates)
    for theta, measured in paper.ANGLES_MEASURED.items():
        assert float(angles["dominant_frequency"].sel(theta=theta)) == pytest.approx(measured, rel=0.05)


def test_members_are_runs_of_their_own_and_make_the_figures_of_their_angle(angles):
    at = angles.sel(theta=5.0)
    duration = float(at["duration"])
    for number, member in enumerate(angles["member"].values, 1):
        scene = Scene(paper.ANGLES_SPEED, 5.0, paper.MU, paper.LOAD)
        run = simulate(scene, duration, ramp=ensembles.ramp_of(number, 1e-3)).summary
        assert run["velocity_rms"] == float(at["member_velocity_rms"].sel(member=member))
        assert run["dominant_frequency"] == float(at["member_dominant_frequency"].sel(member=member))
    assert float(at["velocity_rms"]) == pytest.approx(float(at["member_velocity_rms"].mean()))
    shares = sum(at[f"{state}_fraction"] for state in transients.STATES)
    assert float(shares) == pytest.approx(1.0)


def members(monkeypatch, *each):
    """What an ensemble of members with these regimes and main lines has in common."""
    runs = [dict.fromkeys(table6.KEPT, 1.0) | {"regime": r, "dominant_frequency": line} for r, line in each]
    monkeypatch.setattr(transients, "figures_of", lambda run: run)
    return table6.ensemble(runs)


def test_most_members_decide_and_of_two_rival_lines_one_is_taken(monkeypatch):
    intermittent, irregular = transients.REGIMES.index("intermittent"), transients.REGIMES.index("irregular")
    runs = [(intermittent, 2660.0), (irregular, 1929.0), (intermittent, 2661.0), (STEADY, 460.0)]
    found = members(monkeypatch, *runs)
    assert (found["regime"], found["regime_share"]) == (intermittent, 0.5)
    # What is left of a motion that dies does not sound.
    assert found["dominant_frequency"] == 2660.0
    tied = members(monkeypatch, (irregular, 2660.0), (STEADY, 460.0))
    assert (tied["regime"], tied["regime_share"]) == (irregular, 0.5)
    assert np.isnan(members(monkeypatch, (STEADY, 460.0))["dominant_frequency"])


@given(st.lists(st.floats(200.0, 1e4) | st.just(np.nan), max_size=9))
def test_the_middle_line_is_one_of_them(lines):
    known = [line for line in lines if np.isfinite(line)]
    found = ensembles.middle(np.array(lines, dtype=float))
    if not known:
        assert np.isnan(found)
        return
    assert found in known
    assert sum(line < found for line in known) <= len(known) / 2
    assert sum(line > found for line in known) <= len(known) / 2


def test_a_point_does_not_depend_on_its_batch():
    sweep = STUDY.sweep(SHORT | {"theta": [2.5, 5.0, 15.0]})
    together = sweep.function(sweep.grid.points(), **sweep.constants)
    for k, theta in enumerate([2.5, 5.0, 15.0]):
        alone = sweep.function({"theta": np.array([theta])}, **sweep.constants)
        for name in sweep.variables:
            np.testing.assert_array_equal(alone[name][0], together[name][k])


def test_of_more_pairs_than_places_the_fastest_are_kept(monkeypatch, angles):
    monkeypatch.setattr(table6, "PAIRS", 1)
    found = table6.unstable_pairs(Scene(2e-3, 5.0, 0.2, 9.0))
    assert found["unstable_modes"] == 2
    np.testing.assert_allclose(found["frequency"], [2794.0], atol=1.0)
    fewer = angles.isel(pair=[0])
    assert "At 2.5 and 5 degrees more than 1 modes are unstable; the 1 that grow fastest are kept." in said(fewer)


@pytest.mark.parametrize(
    ("theta", "code", "measured", "unstable"),
    [
        (-10.0, SLIDES, None, ()),
        (-0.5, SLIDES, None, ()),
        (0.0, NOT_STATED, None, ()),
        (4.5, NOT_STATED, None, ()),
        (5.0, VIBRATES, 2700.0, (400.0, 2800.0)),
        (10.0, VIBRATES, 2700.0, ()),
        (12.0, NOT_STATED, None, ()),
        (12.5, SLIDES, None, ()),
        (15.0, SLIDES, None, ()),
    ],
)
def test_the_papers_text_is_repeated_and_nothing_is_added(theta, code, measured, unstable):
    found = table6_angles.stated(np.array([theta]))
    assert found["stated"][0] == code
    number = found["measured_frequency"][0]
    assert np.isnan(number) if measured is None else number == measured
    kept = found["unstable_frequency"][0]
    np.testing.assert_array_equal(kept[np.isfinite(kept)], unstable)


def test_fig11_and_table6_tell_the_same_of_an_angle():
    for theta, frequency in paper.ANGLES.items():
        found = table6_angles.stated(np.array([theta]))
        np.testing.assert_array_equal(found["measured_frequency"], frequency)
        assert found["stated"][0] == (SLIDES if np.isnan(frequency) else VIBRATES)


@pytest.mark.parametrize("other", [{"V": 1e-3}, {"mu": 0.25}, {"F": 10.0}, {"head_mass": 3.0}])
def test_beside_another_operating_point_the_paper_says_nothing(other):
    data = computed(theta=[5.0, 15.0], **other)
    assert np.all(data["stated_paper"] == NOT_STATED)
    for name in ("measured", "simulated", "unstable"):
        assert np.all(np.isnan(data[f"{name}_frequency_paper"]))
    text = said(data)
    assert "paper" not in text
    assert "2700" not in text


def test_the_report_tells_where_paper_and_model_part(angles):
    text = said(angles)
    assert "Of 0, 0.5, 1, 2.5, 10.5, 11 and 12 degrees it says nothing, and these cells stay empty." in text
    assert "The rig vibrates wherever a mode is unstable, and slides steadily wherever none is." in text
    assert "Wherever the text speaks (5 inclinations), the rig moves as it says." in text
    assert "between 0 and 5 degrees; here it is at 0.62." in text
    assert "between 10 and 12 degrees; here it is at 10.68." in text
    assert "unstable pairs at 398 and 2794 Hz; by the paper at 400 and 2800 Hz." in text
    for theta in paper.ANGLES_MEASURED:
        main = float(angles["dominant_frequency"].sel(theta=theta))
        assert f"main line {main:.0f} Hz, {100.0 * (main / 2700.0 - 1.0):+.1f} % from the measured 2700 Hz" in text
    # Other motions than the model's would be told.
    other = angles.copy(deep=True)
    other["regime"][:] = STEADY
    other["member_regime"][0, 0] = VIBRATING[0]
    text = said(other)
    assert "slides steadily though a mode below 10 kHz is unstable at 1, 2.5, 5, 10 and 10.5 degrees." in text
    assert "5 degrees: to the paper the rig vibrates; here: steady sliding." in text
    assert "Runs differ at -5 degrees: 1 steady sliding, 1 intermittent." in text
    other["regime"][:] = VIBRATING[0]
    text = said(other)
    assert "The rig vibrates though no mode below 10 kHz is unstable at -5, 0, 0.5, 11, 12, 12.5 and 15" in text
    assert "15 degrees: to the paper the rig slides steadily; here: intermittent." in text


def test_rows_of_a_long_table_hold_the_papers_angles(monkeypatch, angles):
    monkeypatch.setattr(table6_report, "MOST_ROWS", 3)
    text = said(angles)
    assert [line.split()[0] for line in text.splitlines()[3:7]] == ["-5", "5", "10", "15"]
    assert text.splitlines()[7] == "and 8 more in the file."


def test_a_file_is_completed_and_its_windows_found_again(tmp_path):
    first = runner.run("table6", SHORT | {"theta": [5.0, 8.0]}, tmp_path)
    np.testing.assert_array_equal(first.dataset["window_open_from"], 1)
    runner.run("table6", SHORT | {"theta": [0.0, 15.0]}, tmp_path)
    with xr.open_dataset(tmp_path / "table6" / "table6.nc") as plain:
        whole = plain.load()
    np.testing.assert_array_equal(whole["theta"], [0.0, 5.0, 8.0, 15.0])
    np.testing.assert_array_equal(whole["window_open_from"], 0)
    assert whole["frequency"].dims == ("theta", "pair")
    assert whole["regime"].dims == whole["dominant_frequency"].dims == ("theta",)
    assert whole["regime"].attrs["flag_meanings"].split() == [r.replace(" ", "_") for r in transients.REGIMES]
    assert whole["stated_paper"].attrs["flag_meanings"] == "not_stated vibrates slides_steadily"
    np.testing.assert_array_equal(whole["stated_paper"], [NOT_STATED, VIBRATES, NOT_STATED, SLIDES])
    for variable in whole.variables.values():
        assert variable.attrs["long_name"]
    assert first.figure.is_file()


def test_a_point_without_a_solution_keeps_its_error(tmp_path):
    finished = runner.run("table6", SHORT | {"theta": [10.0, 40.0], "mu": 1.8, "most": 0.5}, tmp_path)
    np.testing.assert_array_equal(finished.dataset["status"], [1, 2])
    text = finished.study.report(finished.dataset)
    assert "failed: theta = 40: ContactError: mu = 1.8" in text
    assert "the runs were cut short at most = 0.5 s" in text
    assert finished.figure.is_file()


def test_what_is_pending_or_failed_leaves_gaps(angles):
    some = angles.copy(deep=True)
    for k, status in ((5, 0), (6, 2)):
        some["status"][k] = status
        for name in table6.VARIABLES:
            some[name] = some[name].astype(float)
            some[name][k] = np.nan
    text = said(some)
    assert "pending" in text
    assert "failed: theta = 10" in text
    assert "Wherever the text speaks (3 inclinations)" in text
    nothing = some.where(False)
    nothing["status"] = xr.zeros_like(angles["status"])
    nothing["stated_paper"], nothing["unstable_modes"] = angles["stated_paper"], 0 * angles["unstable_modes"]
    nothing = nothing.isel(window=slice(0))
    assert said(nothing.assign_attrs(angles.attrs)).count("pending") == len(ANGLES)


def test_windows_that_cannot_be_found_are_told_and_all_else_is_kept(monkeypatch):
    def fails(*args):
        raise ArithmeticError("onsets near theta = 1 cannot be told apart")

    monkeypatch.setattr(table6_angles, "unstable_windows", fails)
    data = computed(theta=[5.0, 15.0])
    assert data.sizes["window"] == 0
    assert "could not be found: onsets near theta = 1 cannot be told apart." in said(data)
    assert float(data["unstable_modes"].sel(theta=5.0)) == 2


def test_an_unstable_mode_outside_all_windows_is_told(angles):
    text = said(angles.isel(window=[0]))
    assert "not begin to grow by flutter within the band is unstable at 1, 2.5, 5, 10 and 10.5 degrees" in text


@pytest.mark.parametrize("theta", [[5.0], [15.0], [4.0, 6.0]])
def test_few_angles_are_drawn_and_told_as_well(theta):
    text = said(computed(theta=theta))
    assert ("A single inclination has no window" in text) == (len(theta) == 1)


@given(st.lists(st.floats(1.0, 1e4), max_size=12))
def test_panels_of_frequency_hold_every_line(lines):
    lines = np.sort(np.array(lines))
    tiers = table6_figure.bands(lines)
    assert 1 <= len(tiers) <= table6_figure.MOST_BANDS
    assert all(low < high for low, high in tiers)
    for line in lines:
        assert any(low < line < high for low, high in tiers)
    # Panels are ascending, and what is apart by less than the factor shares one.
    for (_, high), (low, _) in pairwise(tiers):
        assert low / high > table6_figure.APART * 0.93 / 1.05 - 1e-9


@given(st.lists(st.lists(st.floats(1.0, 1e4), max_size=3), min_size=1, max_size=6))
def test_branches_hold_every_pair_once_and_do_not_jump(rows):
    frequency = np.full((len(rows), 3), np.nan)
    for k, row in enumerate(rows):
        frequency[k, : len(row)] = np.sort(row)
    places = [place for branch in table6_figure.branches(frequency) for place in zip(*branch, strict=True)]
    assert sorted(places) == [tuple(place) for place in np.argwhere(np.isfinite(frequency))]
    for branch in table6_figure.branches(frequency):
        np.testing.assert_array_equal(np.diff(branch[0]), 1)
        line = frequency[branch]
        assert np.all(np.abs(np.diff(line)) <= table6_figure.SAME * line[1:])


def test_the_papers_angles_are_on_the_axis():
    axis = STUDY.axes["theta"].values
    assert (axis[0], axis[-1], len(axis)) == (-10.0, 20.0, 61)
    assert {*paper.ANGLES, *paper.ANGLES_MEASURED, *paper.STEADY_ANGLES} <= set(axis)
    assert STUDY.settings["V"].value == paper.ANGLES_SPEED


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"theta": [5.0, 95.0]}, "^theta = 95.0: it must be a single angle"),
        ({"V": 0.0}, "^V = 0.0: it must be a speed"),
        ({"mu": -0.1}, "^mu = -0.1: it must be"),
        ({"F": 0.0}, "^F = 0.0: it must be"),
        ({"members": 0.0}, "^members = 0.0: it must be a whole number from 1 to 1000"),
        ({"members": 2.5}, "^members = 2.5: it must be a whole number"),
        ({"most": 0.0}, "^most = 0.0: it must be a number from"),
        ({"least": -1.0}, "^least = -1.0: it must be a number from"),
        ({"load_ups": -1.0}, "^load_ups = -1.0: it must be a number from"),
        ({"ramp": -1.0}, "^ramp = -1.0: it must be a number from 1e-09"),
        ({"cutoff": -1.0}, "^cutoff = -1.0: it must be a number from 0 to"),
        ({"contact_position": 0.2}, "^contact_position = 0.2: it must be"),
    ],
)
def test_bad_input_is_named_before_anything_runs(given, message):
    with pytest.raises(ValueError, match=message):
        STUDY.sweep(given)


@pytest.mark.slow
def test_the_whole_table():
    """Half a degree apart, every ensemble does what stability says of its angle."""
    data = STUDY.sweep({}).plan().run()
    unstable = data["unstable_modes"].values > 0
    np.testing.assert_array_equal(np.isin(data["member_regime"], VIBRATING).all(axis=1), unstable)
    np.testing.assert_array_equal((data["member_regime"] == STEADY).all(axis=1), ~unstable)
    inside = (data["window_from"].values.min() < data["theta"]) & (data["theta"] < data["window_to"].values.max())
    np.testing.assert_array_equal(unstable, inside)
    line = data["dominant_frequency"].values[unstable]
    assert np.all((line > 2580.0) & (line < 2700.0))
