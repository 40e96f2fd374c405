"""Each summary figure, on made signals whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from fivcore import Scene
from fivcore.transient.normalised import Normalised, displacement, slip_distance
from fivcore.transient.spectra import BLOCK, Correlation, Histogram, Monitor, Welch
from fivcore.transient.statistics import FIELDS, SEPARATION, SLIP, STICK, begin, clear, count_step, enter
from fivcore.transient.summary import regime_of, summarise
from fivcore.transient.uncertainty.blocks import Blocks

RATE = 50e3
SCENE = Normalised.of(Scene(2e-3, 5.0, 0.2, 9.0))


def run(states, forces=None, speeds=None, step=1e-4, settle=None, min_stick=None, settling=0.0):
    """Count a made sequence of contact states; the counters, and the long sticks."""
    record = begin(np.zeros(1, FIELDS).view(np.recarray), settle, settling, min_stick)
    record["stick_room"] = len(states)
    counted, was, sticks = record[0], int(states[0]), np.empty((len(states), 2))
    for i, state in enumerate(states):
        t, settled_from = (i + 0.5) * step, counted.settled_from
        if state != was and plainly(enter, counted, was, int(state), t):
            sticks[counted.sticks_at + counted.sticks - 1] = counted.last_stick, t
        was = state
        if t < counted.settled_from or counted.settled_from != settled_from:
            plainly(clear, counted)
        if t >= counted.settled_from:
            N = 1.0 if forces is None else forces[i]
            speed = 0.0 if speeds is None else speeds[i]
            plainly(count_step, counted, int(state), N, speed, step)
    return counted, sticks[: counted.sticks].copy()


def plainly(function, *given):
    """Run what is made to be put into a kernel as what it is written as."""
    return function.py_func(*given) if hasattr(function, "py_func") else function(*given)


def figures_of(counted, monitor, duration, sticks=None, steadiness=0.0, released=0.0):
    """Summary of a made run."""
    made = SimpleNamespace(scene=SCENE, options=SimpleNamespace(ramp=1e-3, initial=None), steps=1, step=duration)
    made.record, made.released_energy = np.array([counted]), lambda: released
    blocks = Blocks()
    blocks.spread = lambda start: steadiness * SCENE.speed_per_load
    return summarise(made, monitor, blocks, NONE if sticks is None else sticks, 0)


NONE = np.zeros((0, 2))


def silent():
    monitor = Monitor(RATE)
    monitor.close(NONE)
    return monitor


def shown(monitor, t, velocity, settled_from=0.0):
    """Show samples to a monitor, with N = 1 and no slip."""
    monitor.add(t, velocity, np.ones(len(t)), np.zeros(len(t)), settled_from)


def counted_figures(states, *series, **given):
    """Summary of a made sequence of contact states."""
    counted, sticks = run(states, *series, **given)
    return figures_of(counted, silent(), len(states) * 1e-4, sticks)


def test_fractions_are_shares_of_the_time_after_the_first_slip_and_settling():
    states = [STICK] * 1000 + [SLIP] * 100 + [STICK] * 300 + [SEPARATION] * 100
    figures = counted_figures(states, settling=0.01)
    assert figures["first_slip_time"] == pytest.approx(0.10005)
    shares = [figures[f"{name}_fraction"] for name in ("stick", "separation", "slip")]
    assert shares == pytest.approx([0.75, 0.25, 0.0], abs=1e-3)
    assert figures["first_separation_time"] == pytest.approx(0.14005)


def test_a_run_that_never_slips_counts_from_its_start():
    figures = counted_figures([STICK] * 100)
    assert figures["stick_fraction"] == 1.0
    assert np.isnan(figures["first_slip_time"])
    assert np.isnan(figures["first_separation_time"])
    assert figures["mean_normal_force"] == pytest.approx(9.0)
    assert len(figures["stick_times"]) == 0
    counted, _ = run([STICK] * 100)
    figures = figures_of(counted, silent(), 10.0)
    assert (figures["regime"], figures["stick_fraction_se"], figures["slip_fraction_se"]) == ("stuck", 0.0, 0.0)
    assert np.isnan(figures["mean_normal_force_se"])


def test_long_sticks_are_a_fifth_of_the_first_and_the_last_may_be_censored():
    first = [STICK] * 1000 + [SLIP] * 10
    states = first + [STICK] * 300 + [SLIP] * 10 + [STICK] * 100 + [SLIP] * 10 + [STICK] * 250
    figures = counted_figures(states)
    assert figures["stick_times"] == pytest.approx([0.03])
    assert figures["stick_starts"] == pytest.approx([0.10105], abs=1e-4)
    assert figures["censored_sticks"] == 1
    figures = counted_figures(states, min_stick=0.005)
    assert figures["stick_times"] == pytest.approx([0.03, 0.01])


def test_what_comes_before_settling_counts_for_nothing():
    """Largest force and slip speed, mean force and changes of state are those after it."""
    states = [STICK] * 10 + [SLIP] * 10 + [STICK] * 10 + [SLIP] * 20 + [SEPARATION] * 20
    forces = np.r_[np.full(25, 7.0), np.full(25, 3.0), np.zeros(20)]
    speeds = np.r_[np.full(25, 4.0), np.full(45, 2.0)]
    figures = counted_figures(states, forces, speeds, settle=20e-4, min_stick=1e-9)
    assert figures["max_normal_force"] == pytest.approx(7.0 * 9.0)
    figures = counted_figures(states, forces, speeds, settling=14.5e-4, min_stick=1e-9)
    assert figures["max_normal_force"] == pytest.approx(3.0 * 9.0)
    assert figures["max_slip_speed"] == pytest.approx(2.0 * 9.0)
    assert figures["mean_normal_force"] == pytest.approx(9.0 * 3.0 * 25.0 / 45.0)
    assert figures["switches_per_second"] == pytest.approx(2.0 / 45e-4)
    assert figures["stick_times"] == pytest.approx([10e-4])


@pytest.mark.parametrize("scale", [1e-9, 3e3])
def test_quantiles_of_a_known_distribution(scale):
    rng = np.random.default_rng(1)
    values = scale * rng.exponential(size=200_000)
    forces, speeds = Histogram(), Histogram()
    for piece in np.array_split(values, 7):
        forces.add(piece)
        speeds.add(0.5 * piece, 1e-6)
    for share in (0.5, 0.9, 0.999):
        exact = np.quantile(values, share)
        assert forces.quantile(share) == pytest.approx(exact, rel=4e-3)
        assert speeds.quantile(share) == pytest.approx(0.5 * exact, rel=4e-3)


def test_quantiles_of_nothing_of_zeros_and_of_weighted_values():
    histogram = Histogram()
    assert np.isnan(histogram.quantile(0.5))
    histogram.add(np.zeros(0))
    assert np.isnan(histogram.quantile(0.5))
    histogram.add(np.zeros(3))
    assert histogram.quantile(0.999) == 0.0
    histogram = Histogram()
    histogram.add(np.array([1.0]), 9980.0)
    histogram.add(np.array([5.0]), 20.0)
    assert histogram.quantile(0.99) == pytest.approx(1.0, rel=4e-3)
    assert histogram.quantile(0.999) == pytest.approx(5.0, rel=4e-3)


@pytest.mark.parametrize("frequency", [233.0, 2612.0, 9871.0])
def test_the_dominant_frequency_of_a_noisy_sine_beside_peaks_below_200_hz_and_above_10_khz(frequency):
    t = np.arange(40_000) / RATE
    welch = Welch(RATE)
    lines = sum(size * np.sin(2 * np.pi * f * t) for size, f in ((10, 60), (1, frequency), (5, 15e3)))
    welch.add(lines + 0.5 * np.random.default_rng(2).normal(size=len(t)))
    assert welch.peak() == pytest.approx(frequency, abs=3.0)


def test_sticks_and_what_lies_between_them_have_spectra_of_their_own():
    t = np.arange(50_000) / RATE
    within = (t > 0.3) & (t < 0.6)
    signal = np.where(within, 0.1 * np.sin(2 * np.pi * 2055 * t), np.sin(2 * np.pi * 2612 * t))
    monitor = Monitor(RATE)
    for k, piece in enumerate(np.array_split(np.arange(len(t)), 10)):
        running = 0.3 < t[piece[-1]] < 0.6
        sticks = np.array([[0.3, np.inf]]) if running else np.array([[0.3, 0.6]]) if k >= 3 else NONE
        shown(monitor, t[piece], signal[piece])
        monitor.process(sticks, np.inf)
    monitor.close(sticks)
    assert monitor.moving.peak() == pytest.approx(2612.0, abs=3.0)
    assert monitor.stuck.peak() == pytest.approx(2055.0, abs=3.0)
    moving = np.sqrt(0.7 * 0.5 + 0.3 * 0.005)
    assert monitor.rms == pytest.approx(moving, rel=1e-3)


def test_a_sample_at_an_edge_of_a_stick_and_sticks_of_other_blocks():
    """A stick holds its first sample and not its last; of two blocks each has the sticks within it."""
    t = np.arange(2 * BLOCK) / RATE
    signal = np.random.default_rng(8).normal(size=len(t))
    edges = np.array([[0, 2048], [BLOCK - 1, BLOCK + 5000], [BLOCK + 9000, 2 * BLOCK - 1]])
    monitor, moving, stuck = Monitor(RATE), Welch(RATE), Welch(RATE)
    shown(monitor, t, signal)
    monitor.close(t[edges])
    for first, last in ((2048, BLOCK - 1), (BLOCK + 5000, BLOCK + 9000)):
        moving.add(signal[first:last])
    for first, last in ((0, 2048), (BLOCK, BLOCK + 5000), (BLOCK + 9000, 2 * BLOCK - 1)):
        stuck.add(signal[first:last])
    assert monitor.moving.power == pytest.approx(moving.power, rel=1e-12)
    assert monitor.stuck.power == pytest.approx(stuck.power, rel=1e-12)


def test_what_is_not_known_to_be_a_long_stick_waits():
    t = np.arange(2 * BLOCK) / RATE
    signal = np.sin(2 * np.pi * 2055 * t)
    monitor = Monitor(RATE)
    shown(monitor, t[: BLOCK + 2048], signal[: BLOCK + 2048])
    monitor.process(NONE, t[1024])
    assert monitor.stuck.power.sum() == monitor.moving.power.sum() == 0.0
    stick = np.array([[t[1024], np.inf]])
    monitor.process(stick, np.inf)
    assert monitor.stuck.power.sum() > 0.0
    shown(monitor, t[BLOCK + 2048 :], signal[BLOCK + 2048 :])
    monitor.close(stick)
    assert monitor.stuck.peak() == pytest.approx(2055.0, abs=5.0)
    assert monitor.moving.power.sum() < 0.03 * monitor.stuck.power.sum()


def test_settling_begins_everything_anew():
    monitor = Monitor(RATE)
    t = np.arange(2000) / RATE
    shown(monitor, t, np.full(2000, 7.0))
    shown(monitor, t + 0.04, np.tile([1.0, -1.0], 1000), 0.04)
    monitor.close(NONE)
    assert monitor.rms == pytest.approx(1.0)
    assert monitor.forces.counts.sum() == monitor.speeds.counts.sum() == 2000


@pytest.mark.parametrize("decay", [0.0, 40.0])
def test_coherence_of_a_sine_is_one_and_of_filtered_noise_its_decay(decay):
    frequency, n = 2600.0, 400_000
    t = np.arange(n) / RATE
    rng = np.random.default_rng(3)
    if decay:
        # A complex first-order filter: autocorrelation exp(-decay |lag|) cos(2 pi f lag).
        factor = np.exp((-decay + 2j * np.pi * frequency) / RATE)
        noise = rng.normal(size=n) + 1j * rng.normal(size=n)
        signal = lfilter([1.0], [1.0, -factor], noise).real
    else:
        signal = np.sin(2 * np.pi * frequency * t)
    correlation = Correlation()
    for first in range(0, n, BLOCK):
        correlation.add(signal[first : first + BLOCK])
    period = RATE / frequency
    expected = np.exp(-decay * 20.0 / frequency)
    assert correlation.near(20 * period, 0.5 * period) == pytest.approx(expected, abs=0.01 if not decay else 0.08)


def test_a_record_too_short_for_twenty_periods_has_no_coherence():
    correlation = Correlation()
    correlation.add(np.sin(np.arange(300.0)))
    assert np.isnan(correlation.near(400.0, 10.0))


@pytest.mark.parametrize(("steadiness", "regime"), [(0.001, "steady sliding"), (0.02, "irregular")])
def test_a_vibration_that_has_died_away_has_no_dominant_frequency(steadiness, regime):
    t = np.arange(50_000) / RATE
    monitor = Monitor(RATE)
    shown(monitor, t, 0.1 * SCENE.speed_per_load * np.exp(-50.0 * t) * np.sin(2 * np.pi * 468.0 * t))
    monitor.close(NONE)
    counted, _ = run([STICK] + [SLIP] * 2000, settle=0.0)
    figures = figures_of(counted, monitor, 1.0, steadiness=steadiness)
    assert figures["regime"] == regime
    assert figures["velocity_rms"] == pytest.approx(9.0 * SCENE.speed_per_load * 0.1 * np.sqrt(0.005), rel=0.02)
    expected = pytest.approx(468.0, abs=5.0) if regime == "irregular" else pytest.approx(np.nan, nan_ok=True)
    assert figures["dominant_frequency"] == expected
    assert np.isnan(figures["coherence"]) == (regime == "steady sliding")


def test_the_energy_residual_is_what_does_not_add_up():
    counted, _ = run([STICK] * 10)
    counted.work, counted.damped, counted.friction = 5.0, 1.0, 2.0
    figures = figures_of(counted, silent(), 1e-3, released=-2.0)
    assert figures["energy_residual"] == 0.0
    figures = figures_of(counted, silent(), 1e-3, released=-1.0)
    assert figures["energy_residual"] == pytest.approx(1.0 / 9.0)


@pytest.mark.parametrize(
    ("change", "regime"),
    [
        ({"slipped": False, "drive": 1.2}, "undecided"),
        ({"slipped": False, "drive": 1.4}, "stuck"),
        ({"slip_share": float("nan")}, "undecided"),
        ({"slip_share": 1.0, "steadiness": 0.005}, "steady sliding"),
        ({"slip_share": 1.0, "steadiness": 0.02}, "irregular"),
        ({"stick_share": 0.2, "last_stick": 0.9}, "intermittent"),
        ({"stick_share": 0.2, "last_stick": 0.3}, "irregular"),
        ({"coherence": 0.95}, "periodic"),
        ({"coherence": float("nan")}, "irregular"),
    ],
)
def test_the_regime_is_decided_in_the_stated_order(change, regime):
    usual = {"slipped": True, "drive": 50.0, "slip_share": 0.1, "steadiness": 1.0}
    usual |= {"stick_share": 0.0, "last_stick": 0.0, "coherence": 0.3}
    assert regime_of(**usual | change) == regime


def test_the_clamp_starts_uniformly_accelerated():
    t = np.array([0.0, 0.5e-3, 1e-3, 3e-3])
    assert displacement(t, 2.0, 1e-3) == pytest.approx([0.0, 0.25e-3, 1e-3, 5e-3])
    assert displacement(t, 2.0, 0.0) == pytest.approx(2.0 * t)


def test_what_slips_statically_is_0_143_mm():
    assert 9.0 * slip_distance(SCENE) == pytest.approx(0.1435e-3, rel=5e-3)
    assert slip_distance(Normalised.of(Scene(1e-3, 5.0, 0.0, 9.0))) == 0.0
