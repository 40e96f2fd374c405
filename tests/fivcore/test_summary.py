"""Each figure of a summary, on made signals whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from fivcore import Scene
from fivcore.transient.normalised import Normalised, displacement, slip_distance
from fivcore.transient.observe import LONG_BLOCK as BLOCK
from fivcore.transient.observe import NORMAL_FORCE, SLIP_RATE, Correlation, Observer, welch
from fivcore.transient.statistics import FIELDS, SAMPLE, SEPARATION, SLIP, STICK, begin, clear, count_step, enter
from fivcore.transient.summary import summarise
from tests.known import SLIP_DISTANCE

RATE, STEP, NONE = 50e3, 1e-4, np.zeros((0, 2))
SCENE = Normalised.of(Scene(2e-3, 5.0, 0.2, 9.0))


def plainly(function, *given):
    """Run what is made to be put into a kernel as what it is written as."""
    return function.py_func(*given) if hasattr(function, "py_func") else function(*given)


def counted(states, forces=None, speeds=None, settle=None, min_stick=0.02, settling=0.0):
    """Counters of a made sequence of contact states, one a step, and the long sticks."""
    record = begin(np.zeros(1, FIELDS).view(np.recarray), settle, settling, min_stick, int(states[0]))
    record["stick_room"] = len(states)
    found, was, sticks = record[0], int(states[0]), np.empty((len(states), 2))
    for i, state in enumerate(states):
        t, settled_from = (i + 0.5) * STEP, found.settled_from
        if state != was and plainly(enter, found, was, int(state), t):
            sticks[found.sticks - 1] = found.last_stick, t
        was = state
        if t < found.settled_from or found.settled_from != settled_from:
            plainly(clear, found)
        if t >= found.settled_from:
            N, speed = 1.0 if forces is None else forces[i], 0.0 if speeds is None else speeds[i]
            plainly(count_step, found, int(state), N, speed, STEP)
    return found, sticks[: found.sticks].copy()


def samples_of(velocity):
    """Samples with N = 1 and no slip."""
    samples = np.zeros((len(velocity), SAMPLE))
    samples[:, 0], samples[:, 2] = velocity, 1.0
    return samples


def observed(t, velocity, sticks=NONE, settled_from=0.0):
    """An observer that has seen all samples, with N = 1 and no slip."""
    observer = Observer(RATE, len(t))
    observer.add(t, samples_of(velocity), settled_from)
    observer.sticks = sticks
    return observer


def figures_of(states, *series, observer=None, duration=None, steadiness=0.0, released=0.0, energies=(), **given):
    """Summary of a made run."""
    record, sticks = counted(states, *series, **given)
    for name, value in energies:
        record[name] = value
    options = SimpleNamespace(ramp=1e-3, initial=None, method="fast", cutoff=None)
    made = SimpleNamespace(scene=SCENE, options=options, steps=1, step=duration or len(states) * STEP, begun=0.0)
    made.record, made.released_energy = np.array([record]), lambda: released
    observer = observer or observed(np.zeros(0), np.zeros(0))
    observer.spread = lambda start: steadiness * SCENE.speed_per_load
    return summarise(made, observer, sticks)


def test_fractions_are_shares_of_the_time_after_the_first_slip_and_settling():
    states = [STICK] * 1000 + [SLIP] * 100 + [STICK] * 300 + [SEPARATION] * 100
    figures = figures_of(states, settling=0.01)
    assert figures["first_slip_time"] == pytest.approx(0.10005)
    shares = [figures[f"{name}_fraction"] for name in ("stick", "separation", "slip")]
    assert shares == pytest.approx([0.75, 0.25, 0.0], abs=1e-3)
    assert figures["first_separation_time"] == pytest.approx(0.14005)


def test_a_run_that_never_slips_counts_from_its_start():
    figures = figures_of([STICK] * 100, duration=10.0)
    assert (figures["stick_fraction"], figures["regime"]) == (1.0, "stuck")
    assert np.isnan([figures["first_slip_time"], figures["first_separation_time"]]).all()
    assert figures["mean_normal_force"] == pytest.approx(9.0)
    assert len(figures["stick_times"]) == 0
    assert figures["stick_fraction_se"] == figures["slip_fraction_se"] == 0.0
    assert np.isnan(figures["mean_normal_force_se"])


def test_without_a_step_after_settling_there_are_no_shares():
    figures = figures_of([SLIP] * 100, settle=(100.0 - 0.25) * STEP)  # behind the middle of the last step
    assert np.isnan([figures["slip_fraction"], figures["mean_normal_force"]]).all()
    assert figures["regime"] == "undecided"


def test_long_sticks_are_those_of_the_least_duration_and_the_last_may_be_censored():
    first = [STICK] * 1000 + [SLIP] * 10
    states = first + [STICK] * 300 + [SLIP] * 10 + [STICK] * 100 + [SLIP] * 10 + [STICK] * 250
    figures = figures_of(states)
    assert figures["stick_times"] == pytest.approx([0.03])
    assert figures["stick_starts"] == pytest.approx([0.10105], abs=1e-4)
    assert figures["censored_sticks"] == 1
    assert figures_of(states, min_stick=0.005)["stick_times"] == pytest.approx([0.03, 0.01])
    last = len(states) * STEP - (len(states) - 250 + 0.5) * STEP
    for least, count in ((last, 1), (np.nextafter(last, 1.0), 0)):
        assert figures_of(states, min_stick=least)["censored_sticks"] == count


def test_what_comes_before_settling_counts_for_nothing():
    """Largest force and slip speed, mean force and changes of state are those after it."""
    states = [STICK] * 10 + [SLIP] * 10 + [STICK] * 10 + [SLIP] * 20 + [SEPARATION] * 20
    forces = np.r_[np.full(25, 7.0), np.full(25, 3.0), np.zeros(20)]
    speeds = np.r_[np.full(25, 4.0), np.full(45, 2.0)]
    figures = figures_of(states, forces, speeds, settle=20e-4, min_stick=1e-9)
    assert figures["max_normal_force"] == pytest.approx(7.0 * 9.0)
    figures = figures_of(states, forces, speeds, settling=14.5e-4, min_stick=1e-9)
    assert figures["max_normal_force"] == pytest.approx(3.0 * 9.0)
    assert figures["max_slip_speed"] == pytest.approx(2.0 * 9.0)
    assert figures["mean_normal_force"] == pytest.approx(9.0 * 3.0 * 25.0 / 45.0)
    assert figures["switches_per_second"] == pytest.approx(2.0 / 45e-4)
    assert figures["stick_times"] == pytest.approx([10e-4])
    t = np.arange(2000) / RATE
    velocity = np.append(np.full(2000, 7.0), np.tile([1.0, -1.0], 1000))
    observer = observed(np.append(t, t + 0.04), velocity, settled_from=0.04)
    assert observer.rms == pytest.approx(1.0)
    assert observer.quantile(NORMAL_FORCE, 0.999) == 1.0
    assert len(observer.blocks) == 1999 // 128


def test_quantiles_of_nothing_of_zeros_and_of_one_value_many_times():
    assert np.isnan(Observer(RATE, 0).quantile(SLIP_RATE, 0.999))
    assert observed(np.arange(3) / RATE, np.zeros(3)).quantile(SLIP_RATE, 0.999) == 0.0
    observer, samples = Observer(RATE, 10_000), samples_of(np.zeros(10))
    samples[:, 1] = -5.0
    observer.add(np.arange(10) / RATE, samples, 0.0)
    observer.repeat(9 / RATE, np.array([0.0, 1.0, 1.0]), 9990)
    assert [observer.quantile(SLIP_RATE, share) for share in (0.998, 0.9995)] == pytest.approx([1.0, 5.0])


@pytest.mark.parametrize("frequency", [233.0, 2612.0, 9871.0])
def test_the_dominant_frequency_of_a_noisy_sine_beside_peaks_below_200_hz_and_above_10_khz(frequency):
    t = np.arange(40_000) / RATE
    lines = sum(size * np.sin(2 * np.pi * f * t) for size, f in ((10, 60), (1, frequency), (5, 15e3)))
    spectrum = welch([lines + 0.5 * np.random.default_rng(2).normal(size=len(t))], RATE)
    assert spectrum.peak() == pytest.approx(frequency, abs=3.0)


def test_sticks_and_what_lies_between_them_have_spectra_of_their_own():
    """A stick holds its first sample and not its last; of two blocks each has the sticks within it."""
    t = np.arange(2 * BLOCK) / RATE
    signal = np.random.default_rng(8).normal(size=len(t))
    edges = np.array([[0, 2048], [BLOCK - 1, BLOCK + 5000], [BLOCK + 9000, 2 * BLOCK - 1]])
    observer = observed(t, signal, t[edges])
    moving, stuck = (
        welch([signal[first:last] for first, last in parts], RATE)
        for parts in (
            ((2048, BLOCK - 1), (BLOCK + 5000, BLOCK + 9000)),
            ((0, 2048), (BLOCK, BLOCK + 5000), (BLOCK + 9000, 2 * BLOCK - 1)),
        )
    )
    assert observer.moving.power == pytest.approx(moving.power, rel=1e-12)
    assert observer.stuck.power == pytest.approx(stuck.power, rel=1e-12)
    assert observer.rms == pytest.approx(np.std(signal), rel=1e-3)


@pytest.mark.parametrize("decay", [0.0, 40.0])
def test_the_autocorrelation_of_a_sine_is_one_and_of_filtered_noise_its_decay(decay):
    """A complex first-order filter gives exp(-decay |lag|) cos(2 pi f lag)."""
    frequency, n, rng = 2600.0, 400_000, np.random.default_rng(3)
    noise = rng.normal(size=n) + 1j * rng.normal(size=n) if decay else np.eye(1, n)[0]
    factor = np.exp((-decay + 2j * np.pi * frequency) / RATE)
    signal = lfilter([1.0], [1.0, -factor], noise).real
    correlation = Correlation([signal[first : first + BLOCK] for first in range(0, n, BLOCK)], 1.0)
    lag, expected = 20 * RATE / frequency, np.exp(-decay * 20.0 / frequency)
    assert correlation.near(lag, 0.025 * lag) == pytest.approx(expected, abs=0.01 if not decay else 0.08)
    assert np.isnan(Correlation([signal[:300]], 1.0).near(lag, 10.0))


@pytest.mark.parametrize(("steadiness", "regime"), [(0.001, "steady sliding"), (0.02, "irregular")])
def test_a_vibration_that_has_died_away_has_no_dominant_frequency(steadiness, regime):
    t, speed = np.arange(50_000) / RATE, 0.1 * SCENE.speed_per_load
    observer = observed(t, speed * np.exp(-50.0 * t) * np.sin(2 * np.pi * 468.0 * t))
    states = [STICK] + [SLIP] * 2000
    figures = figures_of(states, observer=observer, duration=1.0, steadiness=steadiness, settle=0.0)
    assert figures["regime"] == regime
    assert figures["velocity_rms"] == pytest.approx(9.0 * speed * np.sqrt(0.005), rel=0.02)
    expected = 468.0 if regime == "irregular" else np.nan
    assert figures["dominant_frequency"] == pytest.approx(expected, abs=5.0, nan_ok=True)
    assert np.isnan(figures["periodicity"]) == (regime == "steady sliding")


@pytest.mark.parametrize(("released", "residual"), [(-2.0, 0.0), (-1.0, 1.0 / 9.0)])
def test_the_energy_residual_is_what_does_not_add_up(released, residual):
    energies = ("work", 5.0), ("damped", 1.0), ("friction", 2.0)
    found = figures_of([STICK] * 10, released=released, energies=energies)["energy_residual"]
    assert found == pytest.approx(residual)


def test_the_clamp_starts_uniformly_accelerated_and_the_contact_slips_statically_at_0_143_mm():
    t = np.array([0.0, 0.5e-3, 1e-3, 3e-3])
    assert displacement(t, 2.0, 1e-3) == pytest.approx([0.0, 0.25e-3, 1e-3, 5e-3])
    assert displacement(t, 2.0, 0.0) == pytest.approx(2.0 * t)
    assert 9.0 * slip_distance(SCENE) == pytest.approx(SLIP_DISTANCE, rel=5e-3)
    assert slip_distance(Normalised.of(Scene(1e-3, 5.0, 0.0, 9.0))) == 0.0
