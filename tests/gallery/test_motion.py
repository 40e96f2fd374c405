"""The studies of motion in time: the physics of their results, and the bits of equivalent scenes."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from fivcore import Rig, Scene, glued_frequencies, painleve_mu, simulate, simulate_many
from fivcore.contact import reduced
from fivcore.transient.summary import LONG_SHARE
from studies import paper, registry
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.motion import regimes, run, series
from studies.physics import phases

EPS = np.finfo(float).eps
# One geometric ratio for V and F, no power of two, and with it the same V / F again and again.
RATIO = 10.0 ** (1.0 / 3.0)
SHORT = {"duration": 0.15, "settle": 0.02}


@pytest.fixture(scope="module")
def histories(computed):
    return computed("fig7", duration=1.5)


@pytest.fixture(scope="module")
def contacts(computed):
    return computed("contact", duration=0.8, window=0.05, most=0)


def test_first_slip_comes_when_the_clamp_has_moved_far_enough(histories):
    expected = 0.5 * float(histories["ramp"]) + 0.1435e-3 / histories["V"]
    np.testing.assert_allclose(histories["first_slip_time"], expected, rtol=0.01)
    assert np.all(histories["first_separation_time"] > histories["first_slip_time"])


def test_the_rig_vibrates_at_the_papers_frequency_and_rings_glued_while_stuck(histories):
    point = histories.sel(V=5e-3)
    dominant, frequency = float(point["dominant_frequency"]), histories["frequency"].values
    assert 0.985 * 2580.0 < dominant < 1.015 * 2650.0
    assert series.peak_near(frequency, point["spectrum"].values, dominant, 0.08) == pytest.approx(
        dominant, rel=0.01
    )
    glued = glued_frequencies(Rig(), 5.0, 8)
    np.testing.assert_allclose(histories["glued_frequency"], glued)
    stuck = histories["spectrum_stuck"].sel(V=1e-3).values
    for target, mode in zip(paper.OTHER_LINES, glued[[3, 6]], strict=True):
        assert series.peak_near(frequency, stuck, target, 0.08) == pytest.approx(mode, abs=3.0)


def test_a_harmonic_is_a_peak_within_one_percent_or_none(histories):
    """Peaks of 4830 and 7345 Hz were once printed as harmonics of 2604 Hz."""
    ratio = histories["harmonic_frequency"] / histories["dominant_frequency"] / histories["harmonic"]
    assert np.all((np.abs(ratio - 1.0) <= 0.01) | np.isnan(ratio))
    frequency = np.arange(0.0, 10e3, 20.0)
    power = 1e-3 + sum(np.exp(-(((frequency - f) / 30.0) ** 2)) for f in (2604.0, 4830.0, 7812.0))
    assert np.isnan(series.peak_near(frequency, power, 2 * 2604.0, 0.01))
    assert series.peak_near(frequency, power, 3 * 2604.0, 0.01) == pytest.approx(7812.0, abs=5.0)


def test_long_sticks_are_marked_where_they_are_counted(histories):
    """At 1 mm/s they fill more of the time than makes a vibration intermittent, at 2 and 5 mm/s less."""
    marked = histories["long_stick"].sum("elapsed") / float(histories["sample_rate"])
    total = (histories["long_sticks"] * histories["mean_stick_time"]).fillna(0.0)
    for speed in paper.SPEEDS:
        # Eight runs that differ by their ramps; by four standard errors of their mean.
        scenes, ramps = [Scene(speed, 5.0, 0.2, 9.0)] * 8, [1e-3 * (1.0 + 0.37 * k) for k in range(8)]
        runs = simulate_many(scenes, 2.0, ramp=ramps, settle=0.3, numerical_damping="published")
        shares = [sum(run.summary["stick_times"]) / run.summary["simulated_time"] for run in runs]
        apart, error = np.mean(shares) - LONG_SHARE, np.std(shares, ddof=1) / np.sqrt(8.0)
        assert (apart > 4.0 * error) if speed == 1e-3 else (apart < -4.0 * error)
    for speed in paper.SPEEDS[1:]:
        assert float(marked.sel(V=speed)) == pytest.approx(float(total.sel(V=speed)), abs=1e-4)
    assert float(marked.sel(V=1e-3)) >= float(total.sel(V=1e-3)) - 1e-3
    point = histories.sel(V=1e-3)
    quiet, loud = (point["velocity_B"].where(point["long_stick"] == stuck).std("elapsed") for stuck in (1, 0))
    assert quiet < 0.2 * loud


def test_fractions_of_time_sum_to_one_and_the_spectrum_holds_the_energy(histories):
    fractions = sum(histories[f"{name}_fraction"] for name in run.STATES)
    np.testing.assert_allclose(fractions, 1.0, atol=1e-9)
    # Between the band and half the sampling rate lies some tenth of the energy.
    power = histories["spectrum"].sum("frequency") * float(histories["frequency"][1])
    np.testing.assert_array_less(power, 1.05 * histories["velocity_rms"] ** 2)
    np.testing.assert_array_less(0.7 * histories["velocity_rms"] ** 2, power)


def test_the_contact_obeys_coulomb_and_signorini(contacts):
    N, ratio, slip, state = (
        contacts[name].values for name in ("normal_force", "apparent_friction", "slip_velocity", "state")
    )
    separation, stick, sliding = (state == code for code in range(3))
    assert separation.any(axis=1).all()
    assert sliding.any(axis=1).all()
    assert np.all(N >= 0.0)
    assert np.all(N[separation] == 0.0)
    assert np.all(ratio[separation] == 0.0)
    assert np.all(np.abs(ratio) <= paper.MU * (1.0 + 1e-6))
    np.testing.assert_allclose(np.abs(ratio[sliding]), paper.MU, rtol=1e-6)
    assert np.all(np.abs(slip[stick]) < 1e-9)
    assert np.all(slip[sliding] * ratio[sliding] <= 0.0)
    np.testing.assert_allclose(contacts["mean_normal_force"], paper.LOAD, rtol=5e-3)


def test_slip_adds_up_to_the_motion_of_the_clamp(computed):
    data = computed("contact", window=0.1, window_start=0.3, sample_rate=200e3, duration=0.45, most=0)
    moved = data["slip_displacement"]
    # P2 moves on by 0.2 and 0.5 mm; P1 springs to and fro by 3 and 7 micrometres RMS, 26 at most in 3 s.
    np.testing.assert_allclose(-moved.isel(elapsed=-1), 0.1 * data["V"], atol=40e-6)
    steps = np.diff(moved, axis=1)
    between = 0.5 * (data["slip_velocity"].values[:, 1:] + data["slip_velocity"].values[:, :-1]) / 200e3
    assert np.mean(np.abs(steps - between)) < 0.25 * np.mean(np.abs(steps))


def test_the_overview_holds_the_start(contacts):
    for k in range(contacts.sizes["V"]):
        point = contacts.isel(V=k)
        since = point["interval"] - point["first_slip_time"]
        soon = point["largest_slip_speed"][(since > 0.0) & (since < 0.1)].max()
        assert float(soon) == pytest.approx(float(point["start_up_slip_speed"]))
        assert float(point["largest_slip_speed"][since < -1e-3].max()) < 1e-9
    assert np.all((contacts["start_up_slip_speed"] > 0.08) & (contacts["start_up_slip_speed"] < 0.2))


def test_ten_degrees_vibrate_and_fifteen_slide_steadily(computed):
    data = computed("fig11", duration=0.8)
    assert regimes.kind(data.sel(theta=15.0)) == "steady sliding"
    assert regimes.kind(data.sel(theta=10.0)) in regimes.VIBRATING
    late = data["velocity_B"].sel(elapsed=slice(0.6, None))
    assert np.ptp(late.sel(theta=15.0).values) < 1e-6
    assert np.ptp(late.sel(theta=10.0).values) > 1e-3
    assert float(data["mode_growth_rate"].sel(theta=10.0)) > 500.0
    assert float(data["mode_growth_rate"].sel(theta=15.0)) == pytest.approx(-0.5 * Rig().d1, rel=1e-3)
    assert float(data["dominant_frequency"].sel(theta=10.0)) == pytest.approx(paper.ANGLES[10.0], rel=0.05)


def test_every_scene_of_a_grid_has_the_bits_of_its_own_simulation(computed):
    """Equivalent scenes, which are computed once and scaled, among them."""
    axes = {"V": np.concatenate([[-7e-3], 4e-3 * RATIO ** np.arange(2)]), "theta": [-5.0, 5.0], "mu": [0.2, 0.3]}
    data = computed("scenes", **SHORT, **axes, F=3.7 * RATIO ** np.arange(2), head_mass=2.0)
    assert data["velocity_rms"].dims == ("V", "theta", "mu", "F")
    for place in list(np.ndindex(*data["velocity_rms"].shape))[::3]:
        point = data.isel(dict(zip(data["velocity_rms"].dims, place, strict=True)))
        scene = Scene(*(float(point[name]) for name in ("V", "theta", "mu", "F")), rig=Rig(head_mass=2.0))
        expected = run.summary_of(simulate(scene, SHORT["duration"], settle=SHORT["settle"]))
        for name, value in expected.items():
            np.testing.assert_array_equal(point[name].values, value, err_msg=f"{name} at {place}")


def test_equivalent_scenes_are_computed_once():
    axes = {"V": 1e-3 * RATIO ** np.arange(10), "F": 0.9 * RATIO ** np.arange(10)}
    axes |= {"theta": np.linspace(-15.0, 15.0, 13), "mu": np.linspace(0.05, 0.55, 11)}
    plan = sweep_of(registry.load("scenes"), axes | {"duration": 1e-3}).plan()
    assert (plan.points, plan.distinct) == (14_300, 19 * 13 * 11)
    given = SHORT | {"V": [-6e-3, 6e-3], "theta": [-5.0, 0.0, 5.0], "mu": 0.2, "F": 9.0}
    assert sweep_of(registry.load("scenes"), given).plan().distinct == 3


def test_a_basis_is_built_once_for_each_inclination(computed):
    for cached in (reduced.full_model, reduced.reduced_model):
        cached.cache_clear()
    computed("scenes", **SHORT, V=[4e-3, 6e-3, 8e-3], theta=[2.0, 4.0, 6.0], mu=[0.2, 0.3], F=9.0)
    # One for the run and one for its onset.
    assert reduced.reduced_model.cache_info().misses == 2 * 3
    assert reduced.full_model.cache_info().misses == 3


def test_a_scene_without_a_unique_solution_fails_alone(computed):
    values = SHORT | {"theta": 40.0, "mu": [0.1, 0.2, 0.3, 5.0, 6.0], "V": [5e-3, 1e-2], "F": [4.5, 9.0]}
    data = computed("scenes", **values)
    np.testing.assert_array_equal(data["status"].sel(theta=40.0)[:, :3], 1)
    np.testing.assert_array_equal(data["status"].sel(theta=40.0)[:, 3:], 2)
    limit = f"ContactError: mu = 5: from {painleve_mu(Rig(), 40.0):.6g} on"
    assert all(text.startswith(limit) for text in data["error"].sel(mu=5.0).values.ravel())
    assert np.all(np.isnan(data["velocity_rms"].sel(mu=5.0)))
    assert "20 scenes" in summary.text(summary.parts(registry.load("scenes"), data))


@pytest.mark.parametrize("V", [6e-3, -6e-3])
def test_recorded_series_are_the_motion(computed, V):
    theta = 5.0 if V > 0 else -5.0
    rate, values = 40e3, SHORT | {"V": [V, 3.1 * V], "theta": [theta, -theta], "mu": 0.2, "F": [3.0, 9.0]}
    names = tuple(name for name in series.SERIES if not name.startswith("contact_"))
    data = computed("scenes", record=names, sample_rate=rate, **values)
    times = data["elapsed"].values
    np.testing.assert_array_equal(times, np.arange(6000) / rate)
    for F in (3.0, 9.0):
        point = data.sel(V=V, theta=theta, mu=0.2, F=F)
        scene = Scene(V, theta, 0.2, F)
        motion = simulate(scene, SHORT["duration"], settle=SHORT["settle"], record=True, sample_rate=None)
        for name in ("velocity_B", "normal_force", "tangential_force", "slip_velocity"):
            # Rounded to four digits once before it is multiplied and once after. Between values of opposite sign
            # the line's own rounding is some last digits of these, and may decide what it has near zero.
            values_then = getattr(motion, name)
            expected, rounding = np.interp(times, motion.time, values_then), 8.0 * EPS * np.abs(values_then).max()
            np.testing.assert_allclose(point[name], expected, rtol=1.1e-4, atol=rounding)
        earlier = np.maximum(np.searchsorted(motion.time, times, side="right") - 1, 0)
        np.testing.assert_array_equal(point["state"], motion.state[earlier])
    plain = computed("scenes", **values)
    for name in run.SUMMARY:
        np.testing.assert_array_equal(data[name], plain[name])


@pytest.mark.parametrize(("name", "axis"), [("fig7", "V"), ("fig11", "theta")])
def test_a_study_with_its_own_times_records_there(computed, name, axis):
    value = {"V": 5e-3, "theta": 10.0}[axis]
    values = {"duration": 0.12, axis: value, "sample_rate": 20e3}
    data = computed(name, record=("normal_force", "velocity_B", "state"), **values)
    plain = computed(name, **values)
    for variable in plain.data_vars:
        if variable != "wall_time":
            np.testing.assert_array_equal(data[variable], plain[variable])
    scene = Scene(value if axis == "V" else 2e-3, value if axis == "theta" else 5.0, 0.2, 9.0)
    motion = simulate(scene, 0.12, numerical_damping="published", record=True, sample_rate=None)
    expected = np.interp(data["elapsed"], motion.time, motion.normal_force)
    np.testing.assert_allclose(data["normal_force"].squeeze(), expected, rtol=1e-4)


def test_scenes_run_until_their_fractions_of_time_are_known(computed):
    values = {"V": [5e-3, 2e-2], "theta": 5.0, "mu": 0.2, "F": 9.0, "standard_error": 0.02, "min_duration": 0.1}
    data = computed("scenes", **values)
    times = data["simulated_time"].values.ravel()
    assert times[0] != times[1]
    assert (times > 0.2).all()
    assert (data["stick_fraction_se"] <= 0.02).all()


def test_a_spectrum_measures_power_and_a_peak_its_frequency():
    rate, times = 40e3, np.arange(40_000) / 40e3
    frequency = series.frequencies(rate).values
    whole = np.ones(len(times), dtype=bool)
    power = series.spectrum(1.5 + 0.3 * np.sin(2.0 * np.pi * 2613.0 * times), whole, rate)
    assert power.sum() * frequency[1] == pytest.approx(0.5 * 0.3**2, rel=1e-3)
    assert series.peak_near(frequency, power, 2700.0, 0.08) == pytest.approx(2613.0, abs=1.0)
    noise = series.spectrum(np.random.default_rng(0).normal(size=len(times)), whole, rate)
    assert noise.mean() == pytest.approx(2.0 / rate, rel=0.05)
    assert np.isnan(series.peak_near(frequency, power, np.nan, 0.08))
    # A part shorter than a window counts with what it has, one far shorter not at all.
    tone = np.sin(2.0 * np.pi * 2000.0 * times)
    burst = (times % 0.1 >= 0.01) & (times % 0.1 < 0.02)
    assert series.spectrum(tone, burst, rate).sum() * frequency[1] == pytest.approx(0.5, rel=0.02)
    assert np.all(np.isnan(series.spectrum(tone, times < 1e-3, rate)))


def test_what_rings_above_the_band_is_not_folded_into_it():
    rate = 40e3
    times = series.even_times(0.5, rate).values
    fine = np.arange(0.0, 0.5, 2.4e-6)
    tones = np.sin(2.0 * np.pi * 5e3 * fine) + np.sin(2.0 * np.pi * 37e3 * fine)
    kept = series.velocity(SimpleNamespace(time=fine, velocity_B=tones), times, rate)
    inside = slice(100, -100)
    np.testing.assert_allclose(kept[inside], np.sin(2.0 * np.pi * 5e3 * times)[inside], atol=0.01)


def test_the_main_phases_are_found_in_their_order():
    stick, slip, separation = phases.STICK, phases.SLIP, phases.SEPARATION
    states = [stick, slip, stick, slip, separation, slip, separation, slip, stick]
    state = np.repeat(states, [9, 3, 5, 2, 1, 2, 8, 4, 2])
    assert phases.main_phases(state) == {1: (0, 9), 2: (9, 12), 3: (22, 30), 4: (30, 34)}
    assert phases.main_phases(np.full(5, stick)) == {1: (0, 5)}


def test_the_drawn_period_has_all_phases_if_one_has():
    stick, slip, separation = phases.STICK, phases.SLIP, phases.SEPARATION
    parts = [[slip, 10], [stick, 60], [separation, 40], [stick, 60], [slip, 10], [separation, 20], [slip, 10]]
    state = np.repeat(*zip(*parts, [stick, 200], strict=True))
    time = 1e-5 * np.arange(len(state))
    # P1 moves on like the drive in the first period, which has no slip.
    series = {"elapsed": time, "state": state, "slip_displacement": 1e-3 * np.minimum(time, 1.1e-3)}
    point = xr.Dataset({name: ("time", values) for name, values in series.items()})
    point = point.assign(dominant_frequency=1e3, V=1e-3)
    assert phases.periods(point) == (110, 310, 210)
