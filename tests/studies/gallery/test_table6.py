"""Table 6: windows of instability, motion over the inclination, and the paper's text beside."""

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from fivcore import Rig, Scene, simulate, sliding_modes
from studies import claims, paper, registry, runner
from studies.gallery.table6 import figure, findings, study, windows
from studies.motion import ensembles, regimes, transients
from studies.plotting import figures

# Angles on either side of every bound, and all of which the paper's text gives a number.
ANGLES = [-5.0, 0.0, 0.5, 1.0, 2.5, 5.0, 10.0, 10.5, 11.0, 12.0, 12.5, 15.0]
SHORT = {"members": 2, "least": 0.4, "load_ups": 2.0}
STUDY = registry.load("table6")
STEADY, INTERMITTENT, IRREGULAR = map(transients.REGIMES.index, ("steady sliding", "intermittent", "irregular"))


def computed(**other):
    """The study's dataset, without a file."""
    return STUDY.sweep(SHORT | {"theta": ANGLES} | other).plan().run("sync")


def vibrates(codes):
    return regimes.is_of(codes, *regimes.VIBRATING)


@pytest.fixture(scope="module")
def angles():
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
    found = windows.windows(Rig(), paper.MU, 2e-3, 3.0, 10.0)
    np.testing.assert_array_equal(found["from"], 3.0)
    np.testing.assert_array_equal(found["open_from"], 1)
    np.testing.assert_allclose(found["to"], [9.348, 10.0], atol=1e-3)
    np.testing.assert_array_equal(found["open_to"], [0, 1])


@pytest.mark.parametrize(("mu", "low", "high"), [(paper.MU, 5.0, 5.0), (0.0, -10.0, 20.0), (paper.MU, 11.0, 20.0)])
def test_there_may_be_no_windows(mu, low, high):
    found = windows.windows(Rig(), mu, 2e-3, low, high)
    assert all(len(values) == 0 for values in found.values())


def test_the_mirror_image_is_the_same_rig():
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


def test_only_what_vibrates_has_a_main_line_and_it_is_near_the_measured_one(angles):
    line = angles["member_dominant_frequency"]
    np.testing.assert_array_equal(np.isfinite(line), vibrates(angles["member_regime"]))
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
    runs = [dict.fromkeys(study.KEPT, 1.0) | {"regime": r, "dominant_frequency": line} for r, line in each]
    monkeypatch.setattr(transients, "figures_of", lambda run: run)
    return study.ensemble(runs)


def test_most_members_decide_and_of_two_rival_lines_one_is_taken(monkeypatch):
    runs = [(INTERMITTENT, 2660.0), (IRREGULAR, 1929.0), (INTERMITTENT, 2661.0), (STEADY, 460.0)]
    found = members(monkeypatch, *runs)
    assert (found["regime"], found["regime_share"]) == (INTERMITTENT, 0.5)
    # What is left of a motion that dies does not sound.
    assert found["dominant_frequency"] == 2660.0
    tied = members(monkeypatch, (IRREGULAR, 2660.0), (STEADY, 460.0))
    assert (tied["regime"], tied["regime_share"]) == (IRREGULAR, 0.5)
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


def test_of_more_pairs_than_places_the_fastest_are_kept(monkeypatch, angles):
    monkeypatch.setattr(study, "PAIRS", 1)
    found = study.unstable_pairs(Scene(2e-3, 5.0, 0.2, 9.0))
    assert found["unstable_modes"] == 2
    np.testing.assert_allclose(found["frequency"], [2794.0], atol=1.0)
    assert "More than 1 modes are unstable, and the 1 fastest are kept: theta = 2.5, 5 degrees." in shown(
        angles.isel(pair=[0])
    )


def test_the_papers_text_stands_beside_the_model(angles):
    """At 5 degrees 2700 Hz and pairs at 400 and 2800 Hz; at 10 degrees 2700 Hz; at 15, < 0 and > 12 steady."""
    rows = rows_of(angles)
    assert [paper for paper, _, _ in rows] == ["2700", "2700", "400", "2800", "2700", *["steady sliding"] * 3]
    here = [angles["dominant_frequency"].sel(theta=5.0)] * 2 + [*angles["frequency"].sel(theta=5.0)[:2].values]
    here.append(angles["dominant_frequency"].sel(theta=10.0))
    assert [here for _, here, _ in rows] == [*(f"{float(each):.4g}" for each in here), *["steady sliding"] * 3]
    assert [float(difference.removesuffix(" %")) for *_, difference in rows[:5]] == pytest.approx(
        [
            100.0 * (float(each) / given - 1.0)
            for each, given in zip(here, [2700, 2700, 400, 2800, 2700], strict=True)
        ],
        abs=0.051,
    )
    assert [difference for *_, difference in rows[5:]] == ["none"] * 3
    assert "Table 6 is not at hand" in shown(angles)
    points = {label: places.tolist() for label, places in figure.paper_points(angles["theta"].values).items()}
    assert points == {
        "paper: main line measured": [[5.0, 2700.0], [10.0, 2700.0]],
        "paper: main line simulated": [[5.0, 2700.0]],
        "paper: unstable pair": [[5.0, 400.0], [5.0, 2800.0]],
    }
    assert {*points, "paper: vibrates", "paper: says nothing"} <= labels_of(angles)


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


@pytest.mark.parametrize("other", [{"V": 1e-3}, {"mu": 0.25}, {"F": 10.0}, {"head_mass": 3.0}])
def test_beside_another_operating_point_the_paper_says_nothing(other):
    data = computed(theta=[5.0, 15.0], **other)
    assert not rows_of(data)
    assert "paper" not in shown(data)
    assert labels_of(data)
    assert not any("paper" in label for label in labels_of(data))


def test_the_report_counts_the_runs_by_motion_and_stability(angles):
    lines = shown(angles).splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("runs by unstable modes"))
    assert lines[start].split()[-3:] == ["0", "1", "2"]
    counts = {line[:15].strip(): [*map(int, line.split()[-3:])] for line in lines[start + 1 : start + 4]}
    assert counts["steady sliding"] == [14, 0, 0]
    assert np.sum([*counts.values()], axis=0).tolist() == [14, 6, 4]


def test_inclinations_at_which_runs_differ_are_listed(angles):
    assert "runs differ" not in shown(angles)
    other = angles.copy(deep=True)
    other["member_regime"][0, 0] = INTERMITTENT
    other["member_dominant_frequency"][5] = [2000.0, 2600.0]
    lines = shown(other).splitlines()
    start = next(k for k, line in enumerate(lines) if "runs differ" in line)
    assert lines[start + 1].split(maxsplit=1) == ["-5", "1 steady sliding, 1 intermittent              -"]
    assert lines[start + 2].split()[-1] == "2000-2600"


def test_rows_of_a_long_table_hold_the_papers_angles(monkeypatch, angles):
    monkeypatch.setattr(findings, "MOST_ROWS", 3)
    text = shown(angles)
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
    for variable in whole.variables.values():
        assert variable.attrs["long_name"]
    assert first.figure.is_file()


def test_a_point_without_a_solution_keeps_its_error(tmp_path):
    finished = runner.run("table6", SHORT | {"theta": [10.0, 40.0], "mu": 1.8, "most": 0.5}, tmp_path)
    np.testing.assert_array_equal(finished.dataset["status"], [1, 2])
    text = finished.study.report(finished.dataset)
    assert "failed: theta = 40: ContactError: mu = 1.8" in text
    assert "The runs were cut short at most = 0.5 s: theta = 10 degrees." in text
    assert finished.figure.is_file()


def test_what_is_pending_or_failed_leaves_gaps(angles):
    some = angles.copy(deep=True)
    for k, status in ((5, 0), (6, 2)):
        some["status"][k] = status
        for name in study.VARIABLES:
            some[name] = some[name].astype(float)
            some[name][k] = np.nan
    text = shown(some)
    assert "pending" in text
    assert "failed: theta = 10" in text
    nothing = some.where(False)
    nothing["status"] = xr.zeros_like(angles["status"])
    nothing["unstable_modes"] = 0 * angles["unstable_modes"]
    nothing = nothing.isel(window=slice(0))
    assert shown(nothing.assign_attrs(angles.attrs)).count("pending") == len(ANGLES)


def test_windows_that_cannot_be_found_are_told_and_all_else_is_kept(monkeypatch):
    def fails(*args):
        raise ArithmeticError("onsets near theta = 1 cannot be told apart")

    monkeypatch.setattr(windows, "unstable_windows", fails)
    data = computed(theta=[5.0, 15.0])
    assert data.sizes["window"] == 0
    assert "could not be found: onsets near theta = 1 cannot be told apart." in shown(data)
    assert float(data["unstable_modes"].sel(theta=5.0)) == 2


def test_an_unstable_mode_outside_all_windows_is_told(angles):
    text = shown(angles.isel(window=[0]))
    assert "not begin to grow by flutter within the band: theta = 1, 2.5, 5, 10, 10.5 degrees." in text


@pytest.mark.parametrize("theta", [[5.0], [15.0], [4.0, 6.0]])
def test_few_angles_are_drawn_and_told_as_well(theta):
    text = shown(computed(theta=theta))
    assert ("A single inclination has no window" in text) == (len(theta) == 1)


@given(st.lists(st.floats(1.0, 1e4), max_size=12))
def test_panels_of_frequency_hold_every_line(lines):
    lines = np.sort(np.array(lines))
    tiers = figure.bands(lines)
    assert 1 <= len(tiers) <= figure.MOST_BANDS
    assert all(low < high for low, high in tiers)
    for line in lines:
        assert any(low < line < high for low, high in tiers)
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


def test_the_papers_angles_are_on_the_axis():
    axis = STUDY.axes["theta"].values
    assert (axis[0], axis[-1], len(axis)) == (-10.0, 20.0, 61)
    assert {*paper.ANGLES, *paper.ANGLES_MEASURED, 0.0, 12.0} <= set(axis)
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
    np.testing.assert_array_equal(vibrates(data["member_regime"]).all(axis=1), unstable)
    np.testing.assert_array_equal((data["member_regime"] == STEADY).all(axis=1), ~unstable)
    inside = (data["window_from"].values.min() < data["theta"]) & (data["theta"] < data["window_to"].values.max())
    np.testing.assert_array_equal(unstable, inside)
    line = data["dominant_frequency"].values[unstable]
    assert np.all((line > 2580.0) & (line < 2700.0))
