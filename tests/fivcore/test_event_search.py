"""`exact`'s search for events: certified, so that no pair of crossings is passed over."""

import numpy as np
import pytest

from fivcore import ContactError, DivergenceError, Scene
from fivcore.transient.exact import DWELL, HELD, ExactRun
from fivcore.transient.exact_kernels import DRAG, PULL, Q_R, V_R, A, P, S, search, waves_at
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import STICK

NO_START, FIRST = np.eye(8)[3], np.zeros(1, dtype=np.int64)


def waves(*terms):
    """Rates and factors for `search`, from pairs of rate and amplitude, without drift."""
    rates = np.array([rate for rate, _ in terms], dtype=complex)
    return rates, np.array([[*(amplitude for _, amplitude in terms), *np.zeros(6)]], dtype=complex)


def value_and_slope(eigenvalues, factors, start, s):
    """One function of `search` and its derivative at s."""
    m, out = len(eigenvalues), np.empty(len(factors), dtype=complex)
    waves_at(eigenvalues, start, s, out)
    parts, d, forced = factors[:m] * np.exp(eigenvalues * s), out[m:].real, factors[m:].real
    slope = forced[S] * d[P] + forced[P] * d[A] + forced[Q_R] * d[V_R]
    slope += forced[V_R] * (start[PULL] - start[DRAG] * d[V_R])
    return parts.sum().real + forced @ d, (parts * eigenvalues).sum().real + slope


@pytest.mark.parametrize("dip", [1e-6, 1e-9, 1e-12])
def test_a_pair_of_crossings_between_samples_is_found(dip):
    """1 - dip + cos is negative for about sqrt(8 dip) / omega, 4.5 ns down to 4.5 ps."""
    omega, phase = 2.0 * np.pi * 1e5, 0.7
    time, which = search(*waves((0.0, 1.0 - dip), (1j * omega, np.exp(1j * phase))), NO_START, FIRST, 1e-3)
    assert which == 0
    assert time == pytest.approx((np.pi - phase - np.sqrt(2.0 * dip)) / omega, abs=2e-14)
    near = waves((0.0, 1.0 + dip), (1j * omega, np.exp(1j * phase)))
    assert search(*near, NO_START, FIRST, 1e-4) == (1e-4, -1)


def test_the_first_crossing_of_random_sums_is_found():
    rng, found = np.random.default_rng(4), 0
    for _ in range(40):
        rates = rng.uniform(-3e4, 2e3, 6) + 1j * rng.uniform(1e3, 1e6, 6)
        parts = rng.normal(size=(1, 6)) + 1j * rng.normal(size=(1, 6))
        drift, start = np.zeros((1, 6)), np.array([1e-3, 2.0, 1e3, 1.0, 0.0, 0.0, 0.0, 0.0])
        drift[0, :4] = rng.normal(), rng.normal(), 0.0, 12.0 * rng.uniform()
        factors = np.hstack([parts, drift])
        factors[0, 9] += max(0.0, 0.1 - value_and_slope(rates, factors[0], start, 0.0)[0])
        drift = factors[0, 6:].real
        time, which = search(rates, factors, start, FIRST, 1e-4)
        t = np.linspace(0.0, 1e-4, 20_001)
        f = (parts[0] * np.exp(np.outer(t, rates))).real.sum(axis=1)
        f += drift[0] * (1e-3 + 2.0 * t + 500.0 * t**2) + drift[1] * (2.0 + 1e3 * t) + drift[3]
        assert (f[t < time - 1e-12] > 0.0).all()
        if which == 0:
            value, slope = value_and_slope(rates, factors[0], start, time)
            assert abs(value / slope) < 1e-13
            found += 1
    assert 10 < found < 40


SINE = waves((1j * 1e5, -1j)), np.pi
SQUARE = waves((0.0, 1.0), (1j * 1e5, -1.0 - 2.0j), (2j * 1e5, 1.0j)), 7.0 * np.pi / 6.0


@pytest.mark.parametrize(("order", "sums"), [(1, SINE), (2, SQUARE)])
def test_what_begins_at_zero_departs_and_returns(order, sums):
    """sin and (1 - cos)(1 + 2 sin): no crossing at the start, and the next one found."""
    (rates, parts), expected = sums
    time, which = search(rates, parts, NO_START, np.array([order], dtype=np.int64), 5e-5)
    assert which == 0
    assert 1e5 * time == pytest.approx(expected, abs=1e-8)
    assert search(rates, -parts, NO_START, np.array([order], dtype=np.int64), 1.0) == (0.0, 0)


def test_a_graze_on_the_tip_of_the_cone_is_held():
    """mu = 0: stick has no room at all, and what is found at once is acted on a dwell later."""
    run = exact_run(0.02, 5.0, 0.0)
    assert (run._event, run._stop, run.held) == (HELD, DWELL, 1)


def exact_run(V, theta, mu):
    """A run before its first step."""
    return ExactRun(
        Normalised.of(Scene(V, theta, mu, 9.0)), RunOptions(duration=1.0, method="exact", cutoff=75e3, settle=0.0)
    )


def test_a_run_without_a_unique_contact_force_or_a_finite_state_is_an_error():
    with pytest.raises(ContactError, match="not unique"):
        exact_run(0.01, 40.0, 30.0)
    run = exact_run(0.02, 5.0, 0.2)
    with pytest.raises(DivergenceError, match="blown up at t = 0 s"):
        run._enter(0.0, STICK, np.full(2 * len(run.model.stiffness) + 2, np.nan))
