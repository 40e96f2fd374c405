"""Onsets over the inclination: closed forms, curves to their ends, folds, and windows against eigenvalues."""

from functools import cache

import numpy as np
import pytest

from fivcore import Rig, flutter_onsets, onset_curves, sliding_modes, unstable_windows
from tests import known
from tests.helpers.rigs import workshop_rig


@pytest.fixture(scope="module")
def papers():
    return onset_curves(Rig(), np.linspace(-2.0, 40.0, 15))


def both(curves):
    return (*curves.onsets, *curves.recoveries)


def lowest(curves):
    return min((curve.lowest for curve in curves.onsets), key=lambda point: point[1])


def growing(modes):
    return np.count_nonzero(modes.unstable & (modes.frequency > 0.0), axis=-1)


def test_under_a_heavy_head_onsets_keep_their_frequency_and_follow_a_closed_form():
    """The support does not move. With h_NN = h + c^2 H_a + s^2 H_b and h_NT = s c (H_a - H_b), e = (h + H_a) /
    (H_b - H_a) is real at an onset, whatever theta; there mu = (1 + e) tan(theta) + e / tan(theta), least at
    tan(theta)^2 = e / (1 + e).
    """
    curves = onset_curves(Rig(head_mass=1e12), np.linspace(0.5, 40.0, 4))
    assert len(curves.onsets) >= 3
    inside = 0
    for curve in both(curves):
        np.testing.assert_allclose(curve.frequency, curve.frequency[0], rtol=1e-9)
        t = np.tan(np.radians(curve.theta))
        e = (curve.mu[0] - t[0]) / (t[0] + 1.0 / t[0])
        np.testing.assert_allclose(curve.mu, (1.0 + e) * t + e / t, rtol=1e-8)
        least = np.degrees(np.arctan(np.sqrt(e / (1.0 + e))))
        if curve.theta[0] < least < curve.theta[-1]:
            assert curve.lowest[0] == pytest.approx(least, rel=1e-6)
            assert curve.lowest[1] == pytest.approx(2.0 * np.sqrt(e * (1.0 + e)), rel=1e-9)
            inside += 1
    assert inside >= 3


def test_the_papers_rig_needs_more_friction_than_the_tangent_of_the_angle(papers):
    """Flutter needs 0 < tan(theta) < mu, and towards large angles comes within a part in a hundred of it."""
    ratios = [np.tan(np.radians(curve.theta)) / curve.mu for curve in both(papers)]
    assert all(ratio.min() > 0.0 and ratio.max() < 1.0 for ratio in ratios)
    assert max(ratio.max() for ratio in ratios) > 0.99


def test_the_papers_lowest_onset(papers):
    """Also where it lies beside the end of the range."""
    theta, mu, frequency = lowest(papers)
    assert (theta, mu, frequency) == pytest.approx(known.LOWEST_ONSET, rel=2e-4)
    for other in (theta - 0.01, theta + 0.01):
        assert flutter_onsets(Rig(), other).mu.min() > mu
    assert flutter_onsets(Rig(), theta).mu.min() == pytest.approx(mu, rel=1e-12)
    for angles in ([2.58, 3.0, 4.0], [1.0, 2.0, 2.6]):
        assert lowest(onset_curves(Rig(), angles)) == pytest.approx((theta, mu, frequency), rel=1e-6)


# Curves.
RANGES = [(Rig(), 10e3, 12.0), (workshop_rig(9), 6e3, 42.0)]
RANGES += [pytest.param(workshop_rig(s, s % 4 > 0), 6e3, 42.0, marks=pytest.mark.slow) for s in (6, 16, 48)]


@pytest.mark.parametrize(("rig", "fmax", "last"), RANGES)
def test_curves_are_all_onsets_and_recoveries_whatever_the_angles(rig, fmax, last):
    """At the given angles, between them, and with half as many."""
    few, many = (onset_curves(rig, np.linspace(1.0, last, count), fmax) for count in (4, 8))
    for k, angle in enumerate(few.theta):
        found = flutter_onsets(rig, angle, fmax)
        for mu, frequency, *expected in (
            (few.mu[k], few.frequency[k], found.mu, found.frequency),
            (few.recovery_mu[k], few.recovery_frequency[k], found.recovery_mu, found.recovery_frequency),
        ):
            there = np.isfinite(mu)
            order = np.argsort(mu[there])
            np.testing.assert_array_equal(mu[there][order], expected[0])
            np.testing.assert_allclose(frequency[there][order], expected[1], rtol=1e-13)
    for curve, other in zip(both(few), both(many), strict=True):
        assert np.all(np.diff(curve.theta) > 0.0)
        for k in range(1, len(curve.theta) - 1, max(len(curve.theta) // 6, 1)):
            found = flutter_onsets(rig, curve.theta[k], fmax, 1.1)
            mu = found.mu if curve.destabilising else found.recovery_mu
            frequency = found.frequency if curve.destabilising else found.recovery_frequency
            near = np.argmin(np.abs(frequency / curve.frequency[k] - 1.0) + np.abs(mu / curve.mu[k] - 1.0))
            assert (mu[near], frequency[near]) == pytest.approx((curve.mu[k], curve.frequency[k]), rel=1e-8)
        assert curve.ends == other.ends
        np.testing.assert_allclose(curve.theta[[0, -1]], other.theta[[0, -1]], rtol=1e-9)
        np.testing.assert_allclose(curve.mu[[0, -1]], other.mu[[0, -1]], rtol=1e-7)
        # mu is flat where it is least within a curve, so that its rounding leaves some 1e-8 of theta open; the
        # frequency goes with it.
        theta, *found = curve.lowest
        inside = curve.theta[0] < theta < curve.theta[-1]
        slope = np.gradient(curve.frequency, curve.theta)[curve.theta == theta].item() if inside else 0.0
        moved = other.lowest[2] + slope * (theta - other.lowest[0])
        np.testing.assert_allclose((theta, *found), (*other.lowest[:2], moved), rtol=1e-7)


def test_a_curve_reaches_the_largest_friction(papers):
    assert {curve.ends[0] for curve in papers.onsets} == {"mu_max"}
    for curve in papers.onsets:
        for k, inwards in ((0, 1e-6), (-1, -1e-6)):
            if curve.ends[k] != "mu_max":
                continue
            assert curve.mu[k] == pytest.approx(1.0, rel=1e-12)
            for way, there in ((inwards, True), (-inwards, False)):
                near = np.abs(flutter_onsets(Rig(), curve.theta[k] + way).frequency - curve.frequency[k]) < 0.1
                assert np.any(near) == there


def test_a_curve_leaves_the_band():
    rig, fmax = workshop_rig(11), 3e3
    curves = onset_curves(rig, np.linspace(20.0, 44.0, 4), fmax)
    (curve,) = (curve for curve in curves.onsets if "fmax" in curve.ends)
    assert curve.ends[0] == "fmax"
    assert curve.frequency[0] == pytest.approx(fmax, rel=1e-12)
    inside, outside = (flutter_onsets(rig, curve.theta[0] + way, fmax).mu for way in (1e-6, -1e-6))
    assert len(inside) == 1 + len(outside)


@pytest.mark.parametrize("seed", [9, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (6, 16, 42))])
def test_onset_and_recovery_meet_in_a_fold(seed):
    """On one side of it there are both, apart by the root of the distance in theta; on the other there is none."""
    rig, fmax, ends = workshop_rig(seed), 10e3, {}
    for curve in both(onset_curves(rig, np.linspace(0.5, 42.0, 12), fmax)):
        for k, end in zip((0, -1), curve.ends, strict=True):
            if end == "fold":
                place = (curve.theta[k], curve.mu[k], curve.frequency[k])
                ends.setdefault(round(place[0], 7), []).append((curve.destabilising, k, place))
    assert ends
    for theta, (one, other) in ends.items():
        assert (one[0], one[1]) == (not other[0], other[1])
        assert one[2] == pytest.approx(other[2], rel=1e-10)
        inwards = 1.0 if one[1] == 0 else -1.0

        def apart(shift, at=one[2]):
            found = flutter_onsets(rig, at[0] + shift, fmax, 1.1)
            rise = found.mu[np.abs(found.frequency / at[2] - 1.0) < 0.02]
            fall = found.recovery_mu[np.abs(found.recovery_frequency / at[2] - 1.0) < 0.02]
            return abs(rise[0] - fall[0]) if len(rise) and len(fall) else None

        assert apart(-1e-7 * inwards) is None, theta
        assert apart(4e-7 * inwards) / apart(1e-7 * inwards) == pytest.approx(2.0, rel=0.1)


# Windows.
@cache
def found(rig, mu, fmax):
    return unstable_windows(rig, mu, -0.5, 12.0 if rig == Rig() else 25.0, fmax)


def test_windows_of_the_papers_rig():
    """The 400 Hz pair, then the 2.8 kHz pair."""
    windows = found(Rig(), 0.2, 10e3)
    ends = np.stack([windows.theta_from, windows.theta_to], axis=1)
    np.testing.assert_allclose(ends, list(known.WINDOWS.values()), atol=0.01)
    for frequency in (windows.frequency_from, windows.frequency_to):
        np.testing.assert_allclose(frequency, list(known.WINDOWS), atol=0.5)
    assert not np.any(windows.open_from | windows.open_to)
    for mu, low, high in ((1.0, -40.0, 0.0), (0.0, -10.0, 20.0)):
        assert len(unstable_windows(Rig(), mu, low, high).theta_from) == 0


CASES = [(Rig(), 0.2, 10e3), (workshop_rig(13), 0.4, 8e3)]
CASES += [pytest.param(workshop_rig(6), 0.7, 8e3, marks=pytest.mark.slow)]
CASES += [pytest.param(Rig(d1=0.0, d2=0.0), 0.45, 10e3, marks=pytest.mark.slow)]


@pytest.mark.parametrize(("rig", "mu", "fmax"), CASES)
def test_windows_end_where_a_mode_ceases_to_grow_and_peak_where_it_grows_fastest(rig, mu, fmax):
    windows = found(rig, mu, fmax)
    ends = np.concatenate([windows.theta_from[~windows.open_from], windows.theta_to[~windows.open_to]])
    assert len(ends)
    for theta in ends:
        before, after = growing(sliding_modes(rig, [theta - 1e-6, theta + 1e-6], mu, fmax))
        assert before != after, theta
    for k, (low, high, peak) in enumerate(
        zip(windows.theta_from, windows.theta_to, windows.peak_theta, strict=True)
    ):
        assert low <= peak <= high
        modes = sliding_modes(rig, np.clip(peak + np.array([0.0, -1e-3, 1e-3]), low, high), mu, fmax)
        phi = modes.growth_rate + 2j * np.pi * modes.frequency
        expected = windows.peak_growth_rate[k] + 2j * np.pi * windows.peak_frequency[k]
        same = np.nanargmin(np.abs(phi - expected), axis=-1)[:, None]
        at, *beside = np.take_along_axis(phi, same, -1)[:, 0]
        # Where oscillation ceases, eigenvalues move as the root of the distance.
        tolerance = 1e-7 if low < peak < high else 1e-4
        assert abs(at - expected) < tolerance * abs(expected)
        assert max(mode.real for mode in beside) < at.real + tolerance * abs(expected)


SEEDS = [range(3), *(pytest.param(range(k, k + 10), marks=pytest.mark.slow) for k in range(0, 900, 10))]


@pytest.mark.parametrize("seeds", SEEDS)
def test_no_growing_mode_is_outside_the_windows_and_no_window_without_one(seeds):
    """Onsets, recoveries, divergences and modes that cross the end of the band, on any rig."""
    checked = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        rig, fmax = workshop_rig(seed, seed % 4 > 0), 10 ** rng.uniform(3.0, 4.2)
        mu, low = rng.choice([0.1, 0.2, 0.4, 0.7, 1.2]), rng.uniform(-30.0, 5.0)
        high = low + rng.uniform(2.0, 40.0)
        windows = unstable_windows(rig, mu, low, high, fmax)
        theta = rng.uniform(low, high, 30)
        modes, at = sliding_modes(rig, theta, mu, fmax), theta[:, None]
        differ = growing(modes) != np.sum((windows.theta_from <= at) & (at <= windows.theta_to), axis=-1)
        # As documented: what grows faster than it oscillates may cross the band unseen between two angles.
        violent = np.any(modes.unstable & (modes.growth_rate > 2.0 * np.pi * modes.frequency), axis=-1)
        assert not np.any(differ & ~violent), seed
        checked += len(windows.theta_from)
    assert checked > 0


@pytest.mark.slow
def test_windows_do_not_depend_on_the_range_but_where_it_cuts_them():
    """Also where the range ends with a window."""
    whole = found(Rig(), 0.2, 10e3)
    near = unstable_windows(Rig(), 0.2, whole.theta_from[1], whole.theta_to[1])
    np.testing.assert_allclose(near.theta_from, whole.theta_from, rtol=1e-10, atol=1e-7)
    np.testing.assert_allclose(near.theta_to, whole.theta_to, rtol=1e-10, atol=1e-7)
    np.testing.assert_allclose(near.peak_growth_rate, whole.peak_growth_rate, rtol=1e-10)
    part = unstable_windows(Rig(), 0.2, 1.0, 5.0)
    np.testing.assert_array_equal([part.open_from, part.open_to], [[False, True], [True, True]])
    np.testing.assert_array_equal(part.theta_to, [5.0, 5.0])
    assert part.theta_from[1] == 1.0
    assert part.theta_from[0] == pytest.approx(whole.theta_from[0], rel=1e-10)


def test_windows_shrink_to_nothing_at_the_lowest_onset(papers):
    theta, mu, _ = lowest(papers)
    for share, low, high in ((1e-4, 2.0, 3.2), (1e-8, 2.5, 2.7)):
        above = unstable_windows(Rig(), mu * (1.0 + share), low, high)
        assert above.theta_from < theta < above.theta_to
        assert above.theta_to - above.theta_from == pytest.approx(2.0 * theta * np.sqrt(2.0 * share), rel=0.02)
        assert len(unstable_windows(Rig(), mu * (1.0 - share), low, high).theta_from) == 0
