"""Each summary figure, on made signals whose answer is known."""

import numpy as np
import pytest

from fivcore import Rig, Scene
from fivcore.transient.drive import Normalised, displacement, slip_distance
from fivcore.transient.spectra import Correlation, Listener, Welch
from fivcore.transient.statistics import (
    BINS,
    DAMPED,
    FRICTION,
    SEPARATION,
    SETTLED_FROM,
    SLIP,
    STICK,
    STICKS,
    WORK,
    Tally,
    follow,
    measure,
    quantile,
    spread,
)
from fivcore.transient.summary import Outcome, regime_of, summarise

RATE = 50e3
SCENE = Normalised.of(Scene(2e-3, 5.0, 0.2, 9.0))


def run(states, forces=None, speeds=None, step=1e-4, settle=None, min_stick=None, settling=0.0):
    """Count a made sequence of contact states."""
    tally = Tally().start(int(states[0]), settle, settling, min_stick)
    flags, moments, sums, hist, fast, word, bits = tally.arrays
    sticks = np.empty((len(states), 2))
    for i, state in enumerate(states):
        t = (i + 0.5) * step
        follow(flags, moments, sums, hist, fast, sticks, t, int(state))
        if t >= moments[SETTLED_FROM]:
            N = 1.0 if forces is None else forces[i]
            speed = 0.0 if speeds is None else speeds[i]
            plainly(measure, sums, int(state), N, speed, step)
            plainly(spread, hist, fast, word, bits, N, speed, step)
    return tally, sticks[: flags[STICKS]].copy()


def plainly(function, *given):
    """Run what is made to be put into a kernel as what it is written as."""
    function.py_func(*given) if hasattr(function, "py_func") else function(*given)


def outcome(duration, sticks=None, steadiness=0.0, released=0.0):
    return Outcome(duration, 1e-3, np.zeros((0, 2)) if sticks is None else sticks, steadiness, released, False)


def silent():
    listener = Listener(RATE)
    listener.close()
    return listener


def test_fractions_are_shares_of_the_time_after_the_first_slip_and_settling():
    states = [STICK] * 1000 + [SLIP] * 100 + [STICK] * 300 + [SEPARATION] * 100
    tally, sticks = run(states, settling=0.01)
    figures = summarise(SCENE, tally, silent(), outcome(0.15, sticks))
    assert figures["first_slip_time"] == pytest.approx(0.10005)
    assert figures["stick_fraction"] == pytest.approx(0.75, abs=1e-3)
    assert figures["separation_fraction"] == pytest.approx(0.25, abs=1e-3)
    assert figures["slip_fraction"] == pytest.approx(0.0, abs=1e-3)
    assert figures["first_separation_time"] == pytest.approx(0.14005)


def test_a_run_that_never_slips_counts_from_its_start():
    tally, _ = run([STICK] * 100)
    figures = summarise(SCENE, tally, silent(), outcome(0.01))
    assert figures["stick_fraction"] == 1.0
    assert np.isnan(figures["first_slip_time"])
    assert np.isnan(figures["first_separation_time"])
    assert figures["mean_normal_force"] == pytest.approx(9.0)
    assert len(figures["stick_times"]) == 0


def test_long_sticks_are_a_fifth_of_the_first_and_the_last_may_be_censored():
    first = [STICK] * 1000 + [SLIP] * 10
    states = first + [STICK] * 300 + [SLIP] * 10 + [STICK] * 100 + [SLIP] * 10 + [STICK] * 250
    tally, sticks = run(states)
    figures = summarise(SCENE, tally, silent(), outcome(len(states) * 1e-4, sticks))
    assert figures["stick_times"] == pytest.approx([0.03])
    assert figures["stick_starts"] == pytest.approx([0.10105], abs=1e-4)
    assert figures["censored_sticks"] == 1
    tally, sticks = run(states, min_stick=0.005)
    figures = summarise(SCENE, tally, silent(), outcome(len(states) * 1e-4, sticks))
    assert figures["stick_times"] == pytest.approx([0.03, 0.01])


@pytest.mark.parametrize("scale", [1e-9, 1.0, 3e3])
def test_quantiles_of_a_known_distribution(scale):
    rng = np.random.default_rng(1)
    values = scale * rng.exponential(size=200_000)
    tally = Tally()
    _, _, _, hist, fast, word, bits = tally.arrays
    for value in values:
        plainly(spread, hist, fast, word, bits, value, 0.5 * value, 1e-6)
    for share in (0.5, 0.9, 0.999):
        exact = np.quantile(values, share)
        assert quantile(tally.forces, share) == pytest.approx(exact, rel=4e-3)
        assert quantile(tally.speeds, share) == pytest.approx(0.5 * exact, rel=4e-3)


def test_quantile_of_nothing_and_of_zeros():
    assert np.isnan(quantile(np.zeros(BINS), 0.5))
    only_zero = np.zeros(BINS)
    only_zero[0] = 3.0
    assert quantile(only_zero, 0.999) == 0.0


@pytest.mark.parametrize("frequency", [233.0, 1234.5, 2612.0, 6624.4, 9871.0])
def test_the_dominant_frequency_of_a_noisy_sine(frequency):
    t = np.arange(40_000) / RATE
    signal = np.sin(2 * np.pi * frequency * t) + 0.5 * np.random.default_rng(2).normal(size=len(t))
    welch = Welch(RATE)
    for piece in np.array_split(signal, 13):
        welch.add(piece)
    welch.close()
    assert welch.peak() == pytest.approx(frequency, abs=3.0)


def test_a_peak_below_200_hz_or_above_10_khz_does_not_count():
    t = np.arange(20_000) / RATE
    welch = Welch(RATE)
    welch.add(10 * np.sin(2 * np.pi * 60 * t) + np.sin(2 * np.pi * 3000 * t) + 5 * np.sin(2 * np.pi * 15e3 * t))
    welch.close()
    assert welch.peak() == pytest.approx(3000.0, abs=3.0)


def test_sticks_and_what_lies_between_them_have_spectra_of_their_own():
    t = np.arange(50_000) / RATE
    within = (t > 0.3) & (t < 0.6)
    signal = np.where(within, 0.1 * np.sin(2 * np.pi * 2055 * t), np.sin(2 * np.pi * 2612 * t))
    listener = Listener(RATE)
    for k, piece in enumerate(np.array_split(np.arange(len(t)), 10)):
        running = 0.3 < t[piece[-1]] < 0.6
        sticks = np.array([[0.3, np.inf]]) if running else np.array([[0.3, 0.6]]) if k >= 3 else np.zeros((0, 2))
        listener.hear(t[piece], signal[piece], sticks, np.inf, 0.0)
    listener.close()
    assert listener.moving.peak() == pytest.approx(2612.0, abs=3.0)
    assert listener.stuck.peak() == pytest.approx(2055.0, abs=3.0)
    moving = np.sqrt(0.7 * 0.5 + 0.3 * 0.005)
    assert listener.rms == pytest.approx(moving, rel=1e-3)


def test_what_is_not_known_to_be_a_long_stick_waits():
    t = np.arange(4096) / RATE
    signal = np.sin(2 * np.pi * 2055 * t)
    listener = Listener(RATE)
    listener.hear(t[:2048], signal[:2048], np.zeros((0, 2)), t[1024], 0.0)
    assert listener.stuck.power.sum() == 0.0
    listener.hear(t[2048:], signal[2048:], np.array([[t[1024], np.inf]]), np.inf, 0.0)
    listener.close()
    assert listener.stuck.peak() == pytest.approx(2055.0, abs=5.0)


def test_settling_begins_everything_anew():
    listener = Listener(RATE)
    t = np.arange(2000) / RATE
    listener.hear(t, np.full(2000, 7.0), np.zeros((0, 2)), np.inf, 0.0)
    listener.hear(t + 0.04, np.tile([1.0, -1.0], 1000), np.zeros((0, 2)), np.inf, 0.04)
    listener.close()
    assert listener.rms == pytest.approx(1.0)


@pytest.mark.parametrize("decay", [0.0, 40.0])
def test_coherence_of_a_sine_is_one_and_of_filtered_noise_its_decay(decay):
    frequency, n = 2600.0, 400_000
    t = np.arange(n) / RATE
    rng = np.random.default_rng(3)
    if decay:
        # A complex first-order filter: autocorrelation exp(-decay |lag|) cos(2 pi f lag).
        factor = np.exp((-decay + 2j * np.pi * frequency) / RATE)
        noise = rng.normal(size=n) + 1j * rng.normal(size=n)
        from scipy.signal import lfilter

        signal = lfilter([1.0], [1.0, -factor], noise).real
    else:
        signal = np.sin(2 * np.pi * frequency * t)
    correlation = Correlation()
    for piece in np.array_split(signal, 17):
        correlation.add(piece)
    correlation.close()
    period = RATE / frequency
    expected = np.exp(-decay * 20.0 / frequency)
    assert correlation.near(20 * period, 0.5 * period) == pytest.approx(expected, abs=0.01 if not decay else 0.08)


def test_a_record_too_short_for_twenty_periods_has_no_coherence():
    correlation = Correlation()
    correlation.add(np.sin(np.arange(300.0)))
    correlation.close()
    assert np.isnan(correlation.near(400.0, 10.0))


def test_the_energy_residual_is_what_does_not_add_up():
    tally, _ = run([STICK] * 10)
    tally.sums[[WORK, DAMPED, FRICTION]] = 5.0, 1.0, 2.0
    figures = summarise(SCENE, tally, silent(), outcome(1e-3, released=-2.0))
    assert figures["energy_residual"] == 0.0
    figures = summarise(SCENE, tally, silent(), outcome(1e-3, released=-1.0))
    assert figures["energy_residual"] == pytest.approx(1.0 / 9.0)


@pytest.mark.parametrize(
    ("change", "regime"),
    [
        ({"slipped": False, "drive": 1.2}, "undecided"),
        ({"slipped": False, "drive": 1.4}, "stuck"),
        ({"measured": False, "slip_share": float("nan")}, "undecided"),
        ({"slip_share": 1.0, "steadiness": 0.005}, "steady sliding"),
        ({"slip_share": 1.0, "steadiness": 0.02}, "irregular"),
        ({"stick_share": 0.2, "last_stick": 0.9}, "intermittent"),
        ({"stick_share": 0.2, "last_stick": 0.3}, "irregular"),
        ({"coherence": 0.95}, "periodic"),
        ({"coherence": float("nan")}, "irregular"),
    ],
)
def test_the_regime_is_decided_in_the_stated_order(change, regime):
    usual = {
        "slipped": True,
        "measured": True,
        "drive": 50.0,
        "slip_share": 0.1,
        "steadiness": 1.0,
        "stick_share": 0.0,
        "last_stick": 0.0,
        "coherence": 0.3,
    }
    assert regime_of(**{**usual, **change}) == regime


def test_the_clamp_starts_uniformly_accelerated():
    t = np.array([0.0, 0.5e-3, 1e-3, 3e-3])
    assert displacement(t, 2.0, 1e-3) == pytest.approx([0.0, 0.25e-3, 1e-3, 5e-3])
    assert displacement(t, 2.0, 0.0) == pytest.approx(2.0 * t)


def test_what_slips_statically_is_0_143_mm():
    assert 9.0 * slip_distance(SCENE) == pytest.approx(0.1435e-3, rel=5e-3)
    assert slip_distance(Normalised.of(Scene(1e-3, 5.0, 0.0, 9.0, Rig()))) == 0.0
