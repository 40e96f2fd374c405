"""What every run must do whatever its scene: records, scaling, segments, options, and ends with an error."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from fivcore import (
    DivergenceError,
    FixedContactWarning,
    OutOfBandWarning,
    Rig,
    Scene,
    State,
    flutter_onsets,
    simulate,
    simulate_many,
)
from fivcore.contact.reduced import default_cutoff, full_model, reduced_model
from fivcore.rig import P1, P2, VALID
from fivcore.transient.fast import run as fast
from fivcore.transient.fast.run import FastRun
from fivcore.transient.fast.steady import growing, steady_sliding
from fivcore.transient.normalised import Normalised, loading_time
from fivcore.transient.options import RunOptions
from fivcore.transient.published import BETA2
from fivcore.transient.statistics import SEPARATION, SLIP
from fivcore.transient.summary import CUTOFF_ERROR, UNSTEADY
from studies.accuracy.rigs import drawn_scene
from tests.helpers.runs import SERIES, assert_same_run, assert_same_summary

PAPERS = Scene(5e-3, 5.0, 0.2, 9.0)
QUICK = Scene(0.02, 5.0, 0.2, 9.0)

# What is recorded, and in which stretches, changes nothing.

RECORDED = [
    ("fast", PAPERS, 0.15, 1e3, {}),
    ("fast", PAPERS, 0.05, 1e7, {}),
    ("fast", replace(PAPERS, theta=-5.0, rig=Rig(d1=200.0)), 0.5, 5e5, {}),
    ("fast", replace(PAPERS, theta=-5.0, rig=Rig(d1=200.0)), 0.5, 5e5, {"cutoff": 75e3}),
    ("exact", QUICK, 0.0125, 1e6, {}),
    ("paper", QUICK, 2e-3, 1e7, {}),
]


@pytest.mark.parametrize(("method", "scene", "duration", "rate", "given"), RECORDED)
def test_recorded_or_not_the_bits_are_the_same(method, scene, duration, rate, given):
    plain = simulate(scene, duration, method, **given)
    assert plain.summary["settled_early"] == (scene.theta < 0.0)
    assert_same_summary(plain, simulate(scene, duration, method, record=["state"], sample_rate=rate, **given))


@pytest.mark.parametrize(
    ("method", "scene", "duration"),
    [
        # Through the onset; a drive that starts to slide steadily for good; the published scheme; event to event.
        ("fast", PAPERS, 0.07),
        ("fast", Scene(-5e-3, 5.0, 0.05, 9.0), 2.0),
        ("paper", PAPERS, 0.001),
        ("exact", QUICK, 0.0125),
    ],
)
def test_series_at_given_times_are_those_of_every_step(method, scene, duration):
    every = simulate(scene, duration, method, record=True, sample_rate=None)
    times = np.sort(np.concatenate([[0.0, duration], np.random.default_rng(2).uniform(0.0, duration, 3000)]))
    kept = simulate(scene, duration, method, record=True, sample_times=times)
    assert_same_summary(kept, every)
    np.testing.assert_array_equal(kept.time, times)
    for name in ("velocity_B", "normal_force", "tangential_force", "slip_velocity"):
        np.testing.assert_array_equal(getattr(kept, name), np.interp(times, every.time, getattr(every, name)))
    before = np.maximum(np.searchsorted(every.time, times, side="right") - 1, 0)
    np.testing.assert_array_equal(kept.state, every.state[before])
    assert kept.state.dtype == np.int8


@pytest.mark.parametrize("rate", [250e3, 400e3, 1e6, 777.0])
def test_series_come_at_the_rate_that_is_asked_for(rate):
    """Whether or not a whole number of steps fits; of 1.667 us none fits into these."""
    step = 5e-6 / 3.0
    every, kept = (simulate(PAPERS, 0.0331, record=True, step=step, sample_rate=each) for each in (None, rate))
    np.testing.assert_allclose(kept.time, np.arange(np.ceil(0.0331 * rate - 1e-9)) / rate, rtol=1e-12)
    assert set(kept.state.tolist()) == {0, 1, 2} or rate < 1e3
    for name in ("velocity_B", "normal_force", "tangential_force", "slip_velocity"):
        np.testing.assert_array_equal(getattr(kept, name), np.interp(kept.time, every.time, getattr(every, name)))
    steps = simulate(PAPERS, 0.01, record=True, step=step)
    assert np.diff(steps.time) == pytest.approx(1e-5, rel=1e-9)
    assert np.isin(steps.velocity_B, every.velocity_B).all()


def test_the_motion_does_not_depend_on_the_stretches_it_is_taken_in(monkeypatch):
    """Bit for bit, long after the first burst; the sums of the figures are added stretch by stretch."""
    runs = []
    for short, long in ((0.04, 0.2), (0.0137, 0.0091), (0.5, 0.5)):
        monkeypatch.setattr(fast, "SHORT_SEGMENT", short)
        monkeypatch.setattr(fast, "LONG_SEGMENT", long)
        runs.append(simulate(replace(PAPERS, V=2e-3), 0.25, record=True, sample_rate=None, end_early=False))
    for run in runs[1:]:
        for name in SERIES:
            assert np.array_equal(getattr(run, name), getattr(runs[0], name))
        assert run.summary.pop("regime") == runs[0].summary["regime"]
        for name, value in run.summary.items():
            assert value == pytest.approx(runs[0].summary[name], rel=1e-9, nan_ok=True)


def test_memory_grows_by_the_samples_and_what_is_done_with_them_at_the_end():
    """32 bytes every 20 microseconds, and a quarter more."""
    peaks = []
    # Two seconds hold segments of full length.
    for duration in (2.0, 2.0, 8.0):
        tracemalloc.start()
        run = simulate(PAPERS, duration)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert all(len(getattr(run, name)) == 0 for name in SERIES)
    assert 6.0 * 1.6e6 < peaks[2] - peaks[1] < 6.0 * 2.4e6


# Scaling: every figure with a unit is F times its canonical value, to the last bit.
SCALED = {"velocity_rms", "mean_normal_force", "max_normal_force", "normal_force_999"}
SCALED |= {"max_slip_speed", "slip_speed_999"}
SCALES = [
    (PAPERS, 0.25, {}),
    (Scene(-3.7e-3, 5.0, 0.2, 7.3), 0.25, {"settle": 0.0, "numerical_damping": "published"}),
    (Scene(-2.1e-2, -5.0, 0.2, 113.0), 0.25, {}),
    # Ended early, and by the other methods.
    (Scene(-2e-2, 5.0, 0.2, 3.3, Rig(d1=200.0)), 0.3, {}),
    (Scene(-0.03, -5.0, 0.2, 7.3), 2e-3, {"method": "paper", "settle": 0.0}),
    (Scene(-0.03, -5.0, 0.2, 7.3), 0.012, {"method": "exact", "settle": 0.0}),
]


@pytest.mark.parametrize(("scene", "duration", "given"), SCALES)
def test_a_run_is_the_canonical_one_times_the_load(scene, duration, given):
    sense, F = np.sign(scene.V), scene.F
    canonical = Scene(Normalised.of(scene).speed_per_load, scene.drive_theta, scene.mu, 1.0, scene.rig)
    own, unit = (simulate(each, duration, record=True, sample_rate=None, **given) for each in (scene, canonical))
    for key, value in unit.summary.items():
        expected = F * value if key in SCALED else value
        assert np.array_equal(own.summary[key], expected, equal_nan=not isinstance(value, str)), key
    for name, factor in zip(SERIES, (1.0, F * sense, F, F * sense, F * sense, 1), strict=True):
        assert np.array_equal(getattr(own, name), factor * getattr(unit, name)), name
    assert own.summary["settled_early"] == bool(scene.rig.d1 == 200.0)


# Options.
SAME = [
    # Published damping is a rig with so much more; each method's own is the default; and beta2 by its value.
    ("fast", {"numerical_damping": "published"}, {"rig": Rig(d2=1.6e-8)}, 0.1),
    ("exact", {"numerical_damping": "published"}, {"rig": Rig(d2=1.6e-8)}, 0.0125),
    ("fast", {"numerical_damping": "none"}, {}, 0.1),
    ("exact", {"numerical_damping": "none"}, {}, 0.0125),
    ("paper", {"numerical_damping": "published"}, {}, 3e-3),
    ("paper", {"numerical_damping": "none"}, {"beta2": 0.5}, 3e-3),
    ("paper", {"beta2": BETA2}, {}, 2e-3),
]


@pytest.mark.parametrize(("method", "given", "same", "duration"), SAME)
def test_an_option_is_what_it_says_by_other_means(method, given, same, duration):
    scene, recorded = PAPERS if duration > 0.02 else QUICK, {"record": True, "sample_rate": 50e3}
    other = replace(scene, rig=same.get("rig", scene.rig))
    rest = {name: given[name] for name in given if name != "numerical_damping" and name != "beta2"}
    rest |= {name: same[name] for name in same if name != "rig"}
    own = simulate(scene, duration, method, **given, **recorded)
    assert own.scene == scene
    assert_same_run(replace(own, scene=other), simulate(other, duration, method, **rest, **recorded))


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_a_ramp_shorter_than_a_step_is_a_jerk(method):
    """What matters is the speed that P2 is given at once, not in how many steps."""
    jerk, *others = (
        simulate(replace(PAPERS, V=1e-3), 1e-3, method, ramp=ramp, settle=0.0, record=True)
        for ramp in (0.0, 1e-9, 1e-7, 1.3e-6)
    )
    for short in others:
        assert short.summary["stick_fraction"] == pytest.approx(jerk.summary["stick_fraction"], abs=0.02)
        assert short.normal_force[-1] == pytest.approx(jerk.normal_force[-1], rel=0.02)
        assert short.tangential_force[-1] == pytest.approx(jerk.tangential_force[-1], abs=0.05)


def test_at_rest_it_stays_at_rest():
    """A drive of 1e-11 m/s is none; what is left is rounding of a contact held by positions."""
    run = simulate(Scene(1e-11, 5.0, 0.2, 9.0), 2e-3, "paper", record=True, sample_rate=1e6)
    assert np.all(run.state == 1)
    np.testing.assert_allclose(run.normal_force, 9.0, rtol=1e-7)
    assert np.abs(run.tangential_force).max() < 1e-6
    assert np.abs(run.velocity_B).max() < 1e-11


def test_heavy_damping_does_not_make_the_contact_slip_early():
    for d2 in (3e-6, 1e-4):
        scene = replace(PAPERS, rig=Rig(d2=d2))
        default, plain = (simulate(scene, 0.035, cutoff=cutoff, settle=0.0).summary for cutoff in (None, 75e3))
        assert default["first_slip_time"] == pytest.approx(plain["first_slip_time"], rel=1e-3)


@pytest.mark.parametrize(("n1", "n2"), [(1, 1), (2, 2), (1, 40), (30, 1)])
@pytest.mark.parametrize("method", ["fast", "exact"])
def test_coarse_meshes_run_whatever_is_left_above_the_cut_off(method, n1, n2):
    rig = Rig(replace(P1, elements=n1), replace(P2, elements=n2))
    assert reduced_model(rig, 5.0).K.any() == (n1 != n2)
    # Over a third of a period of the head on its beam.
    summary = simulate(replace(QUICK, rig=rig), 0.02, method, settle=0.0).summary
    assert summary["mean_normal_force"] == pytest.approx(9.0, rel=0.05)


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_a_run_that_blows_up_says_so(method, monkeypatch):
    """Steps known to be unstable are refused beforehand; here a run is told that its energy has exploded."""
    kind = {"fast": "fast.run.FastRun", "exact": "exact.ExactRun", "paper": "published.PaperRun"}[method]
    energies = iter([1.0])
    monkeypatch.setattr(f"fivcore.transient.{kind}.stored_energy", lambda run: next(energies, 1e9))
    with pytest.raises(DivergenceError, match=r"blown up at t = .*; scene V = 0\.005 m/s") as caught:
        simulate(PAPERS, 1e-3, method)
    assert caught.value.scene == PAPERS


# The start.
FULL = full_model(Rig(), 5.0)


def sliding(scene, contact=SLIP):
    """Modes as in steady sliding at the speed of the drive, seen from P2's clamp before the jerk."""
    elastic, q = FULL.stiffness > 0.0, scene.F * FULL.static_equilibrium
    q[elastic] += scene.mu * scene.F * FULL.tangential[elastic] / FULL.stiffness[elastic]
    q[~elastic] -= FULL.normal @ q / FULL.normal[~elastic]
    return State(q, -FULL.inertia * scene.V, contact)


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_a_run_that_begins_in_slip_has_slipped_and_waits_until_it_has_settled(method):
    scene = replace(PAPERS, V=0.1, mu=0.05)
    given = {"initial": sliding(scene), "ramp": 0.0}
    early, late = (simulate(scene, 2e-3, method, **given, **more).summary for more in ({}, {"settle": 0.0}))
    assert early["first_slip_time"] == late["first_slip_time"] == 0.0
    assert np.isnan(early["slip_fraction"])
    assert (early["regime"], late["slip_fraction"]) == ("undecided", 1.0)
    if method == "fast":
        assert simulate(scene, 0.25, **given).summary["regime"] == "steady sliding"


def test_what_a_long_stick_is_does_not_depend_on_the_start():
    """Next to the onset of the pair at 2.8 kHz sticks are short; from an open contact they come at once."""
    scene, up = Scene(2e-3, 5.0, 0.1125, 9.0), 1e-6 / FULL.normal[0] * (FULL.stiffness == 0.0)
    starts = ({}, {"ramp": 0.05}, {"initial": State(scene.F * FULL.static_equilibrium + up, 0.0 * up, SEPARATION)})
    runs = [simulate(scene, 0.8, **given).summary for given in starts]
    assert max(np.sum(run["stick_times"]) for run in runs) < 0.1 * 0.8
    normalised = Normalised.of(scene)
    times = [
        FastRun(normalised, RunOptions(duration=0.8, ramp=ramp)).record["least_stick"][0] for ramp in (0.0, 0.05)
    ]
    assert times == [0.2 * loading_time(normalised)] * 2


# The contact point is fixed.
def test_a_run_that_moves_p2_by_more_than_2_percent_of_its_length_warns(recwarn):
    simulate(Scene(1.0, 5.0, 0.2, 9.0), 2.99e-3)
    simulate_many([Scene(1.0, 5.0, 0.2, 9.0)], 6e-3)
    assert not recwarn.list
    with pytest.warns(FixedContactWarning, match=r"^V \* duration is 4 % of P2's length, by which the "):
        simulate(Scene(-1.0, 5.0, 0.2, 9.0), 6e-3)


# The band of the onsets.
def test_the_paper_rig_vibrates_from_its_lowest_onset_on(recwarn):
    (onset, *_) = flutter_onsets(Rig(), 5.0).mu
    regimes = [simulate(Scene(2e-3, 5.0, times * onset, 9.0), 1.0).summary["regime"] for times in (0.99, 1.01)]
    assert regimes[0] == "steady sliding" != regimes[1]
    assert not recwarn.list


def test_a_run_whose_sliding_is_unstable_above_the_band_alone_warns():
    scene = replace(drawn_scene(2010, 9), mu=0.18)
    with pytest.warns(OutOfBandWarning, match=r"^at mu = 0\.18 sliding is unstable at 19\.2 kHz and not below 10"):
        run = simulate(scene, 0.2)
    assert 10e3 < run.growing[0] < scene.rig.valid_up_to


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::fivcore.OutOfBandWarning")
@pytest.mark.parametrize("number", range(19))
def test_a_random_rig_vibrates_from_the_onset_of_the_modes_of_its_run(number):
    """Within 2 %. The next, number 19, keeps a vibration that begins with its first slip at 7 % less, too."""
    scene = drawn_scene(2010, number)
    model = reduced_model(scene.rig, scene.drive_theta)

    def unstable(mu):
        return len(growing(steady_sliding(model, mu, model.default_step).eigenvalues)) > 0

    low, high = 0.0, next(mu for mu in np.arange(0.05, 0.6, 0.002) if unstable(mu))
    low = high - 0.002
    while high - low > 1e-5:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if unstable(middle) else (middle, high)
    below, above = (simulate(replace(scene, mu=times * high), 2.0).summary["regime"] for times in (0.98, 1.02))
    assert below == "steady sliding" != above


def test_beams_hold_up_to_where_timoshenko_waves_are_ten_percent_slower():
    rig, shear = Rig(), 2.0 * 1.3 / (5.0 / 6.0)
    for beam in (rig.p2, rig.p1):
        radius, speed = beam.thickness / np.sqrt(12.0), np.sqrt(beam.young_modulus / beam.density)
        k = np.sqrt(2.0 * np.pi * VALID * speed / beam.thickness / (speed * radius))
        # shear w^4 - (1 + (1 + shear) x^2) w^2 + x^4 = 0, w in units of speed / radius, x = k radius.
        x = k * radius
        half = 0.5 * (1.0 + (1.0 + shear) * x**2)
        slower = np.sqrt((half - np.sqrt(half**2 - shear * x**4)) / shear)
        assert x**2 / slower == pytest.approx(1.1, abs=2e-3)
    assert rig.valid_up_to == pytest.approx(46.9e3, rel=1e-3)


def test_a_summary_states_its_cutoff_and_the_error_that_it_leads_to():
    scene = Scene(5e-3, 5.0, 0.2, 9.0)
    by_default, given = (simulate(scene, 1.0, cutoff=cutoff).summary for cutoff in (None, 80e3))
    assert by_default["cutoff"] == default_cutoff(Rig())
    assert 0.0085 < by_default["cutoff_error"] < 0.02
    # How unsteady the motion is, its share over one second says, however long the run.
    short = simulate(scene, 1.0, settle=0.5).summary
    share = max(short[f"{status}_fraction_se"] for status in ("stick", "slip", "separation")) * np.sqrt(0.5)
    assert short["cutoff_error"] == pytest.approx(np.hypot(CUTOFF_ERROR, UNSTEADY * share), rel=1e-3)
    assert given["cutoff"] == 80e3
    assert np.isnan(given["cutoff_error"])
    assert simulate(replace(scene, mu=0.05), 1.0).summary["cutoff_error"] == 0.0
    highest = np.sqrt(full_model(Rig(), 5.0).stiffness.max()) / (2.0 * np.pi)
    assert simulate(scene, 1e-3, "paper").summary["cutoff"] == pytest.approx(highest)
