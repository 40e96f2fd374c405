"""Flutter over an interval of inclinations: curves of onsets, and windows in which a pair of modes is unstable.

Points of neighbouring samples, all flutter onsets or growing modes at an angle, are linked where each has one
clear counterpart. Otherwise the interval is halved, until a point is said to end in it. Roots and extremes along a
branch are bracketed (Brent, Algorithms for Minimization without Derivatives, 1973).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, groupby, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, fminbound

from fivcore import checks
from fivcore.errors import InputError, UnsolvedError
from fivcore.jit import Array, ReadOnlyArrays
from fivcore.rig import Rig
from fivcore.stability.many import crossings, rig_table
from fivcore.stability.sliding import sliding_modes


@dataclass(frozen=True, eq=False)
class OnsetCurve(ReadOnlyArrays):
    """One branch of onsets or of recoveries; arrays are read-only.

    Attributes
    ----------
    theta, mu, frequency : ndarray, (n,)
        Degrees, ascending; 1; Hz.
    rises : bool
        True for onsets, False for recoveries.
    ends : tuple of str
        Where it begins and ends: the "range" of theta, "mu_max", "fmax", or a "fold", where it meets a branch of
        the other kind.
    lowest : tuple of float
        theta, mu and frequency where mu is least.
    """

    theta: Array
    mu: Array
    frequency: Array
    rises: bool
    ends: tuple[str, str]
    lowest: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class OnsetCurves(ReadOnlyArrays):
    """All branches over an interval of theta, and their values at given angles; arrays are read-only.

    Attributes
    ----------
    onsets, recoveries : tuple of OnsetCurve
        Ascending in frequency where mu is least.
    theta : ndarray, (k,)
        The given angles, degrees.
    mu, frequency, recovery_mu, recovery_frequency : ndarray, (k, onsets) or (k, recoveries)
        Friction and frequency (Hz) of each branch there, NaN where it does not reach.
    """

    onsets: tuple[OnsetCurve, ...]
    recoveries: tuple[OnsetCurve, ...]
    theta: Array
    mu: Array
    frequency: Array
    recovery_mu: Array
    recovery_frequency: Array


@dataclass(frozen=True, eq=False)
class UnstableWindows(ReadOnlyArrays):
    """Intervals of theta in which a mode pair grows, ascending in frequency, then in theta; arrays are read-only.

    Attributes
    ----------
    theta_from, theta_to, frequency_from, frequency_to : ndarray, (n,)
        Ends, degrees; the growing mode's frequency there, Hz: fmax where it leaves the band, 0 where it diverges.
    open_from, open_to : ndarray of bool, (n,)
        Whether the window goes on beyond what was asked.
    peak_growth_rate, peak_theta, peak_frequency : ndarray, (n,)
        Where the mode grows fastest: 1/s, degrees, Hz.
    """

    theta_from: Array
    theta_to: Array
    frequency_from: Array
    frequency_to: Array
    open_from: NDArray[np.bool_]
    open_to: NDArray[np.bool_]
    peak_growth_rate: Array
    peak_theta: Array
    peak_frequency: Array


def onset_curves(rig: Rig, theta: Any, fmax: float = 10e3, mu_max: float = 1.0) -> OnsetCurves:
    """Flutter onsets and recoveries of steady sliding (V > 0) as curves over theta.

    Parameters
    ----------
    rig : Rig
    theta : array_like, (k,)
        Degrees, ascending. Where they are more than half a degree apart, onsets are sampled between them too.
    fmax, mu_max : float
        Band, Hz; largest friction of interest.

    Returns
    -------
    OnsetCurves
        Values at the given angles are those of `flutter_onsets`. A branch with both ends between two samples is
        not seen, nor one that turns back and forth there.

    Raises
    ------
    ValueError, ArithmeticError
        For an argument out of range; if onsets cannot be isolated at an angle, or told apart between two.
    """
    checks.instance("rig", rig, Rig)
    angles = checks.array("theta", theta, checks.theta_degrees)
    if angles.ndim != 1 or not len(angles) or np.any(np.diff(angles) <= 0.0):
        raise InputError(f"theta of shape {angles.shape}: it must be a list of ascending angles, each once")
    band, most = checks.band(fmax), checks.between("mu_max", mu_max, 1e-12, 1e6, "a coefficient of friction")
    sample, curves = partial(_onsets, rig, band, most), []
    for branch in _branches(sample, angles):
        points = list(branch)
        for p, q in pairwise(branch):
            if p.outside != q.outside:
                at = _root(sample, p, q, lambda at: max(at.level / most, at.frequency / band) - 1.0)
                if at.level / most > at.frequency / band:
                    points.append(at._replace(outside=False, level=most, end="mu_max"))
                else:
                    points.append(at._replace(outside=False, frequency=band, end="fmax"))
        parts = [
            list(part) for outside, part in groupby(sorted(points), lambda point: point.outside) if not outside
        ]
        for part in parts:
            lowest = min(part, key=lambda point: point.level)
            at, mu, frequency = np.array([point[:3] for point in part]).T.copy()
            curves.append(OnsetCurve(at, mu, frequency, part[0].rises, (part[0].end, part[-1].end), lowest[:3]))
    curves.sort(key=lambda curve: curve.lowest[2])
    onsets, recoveries = (tuple(curve for curve in curves if curve.rises is kind) for kind in (True, False))
    return OnsetCurves(onsets, recoveries, angles, *_table(angles, onsets), *_table(angles, recoveries))


def unstable_windows(
    rig: Rig, mu: float, theta_min: float, theta_max: float, fmax: float = 10e3
) -> UnstableWindows:
    """Intervals of theta in which a pair of modes of steady sliding (V > 0) is unstable at one friction.

    A window opens or closes where a branch of onsets or recoveries passes `mu`, where a growing mode enters or
    leaves the band, and where it begins or ceases to oscillate; divergence makes no window.

    Parameters
    ----------
    rig : Rig
    mu, theta_min, theta_max, fmax : float
        Coefficient of friction; range, degrees; band, Hz.

    Returns
    -------
    UnstableWindows
        Ends to 1e-11 degrees. No mode that grows at one of the samples, half a degree apart, is missed; between
        two of them a window is seen if its branch of onsets is below four times `mu` at one.

    Raises
    ------
    ValueError, ArithmeticError
        For an argument out of range; if onsets cannot be told apart.
    """
    checks.instance("rig", rig, Rig)
    friction = checks.friction(mu)
    first = checks.number("theta_min", theta_min, "an angle between -90 and 90 degrees", lambda x: abs(x) < 90.0)
    last = checks.number(
        "theta_max", theta_max, f"above theta_min = {first:g} and below 90 degrees", lambda x: first < x < 90.0
    )
    band = checks.band(fmax)
    angles, growing = np.array([first, last]), partial(_growing, rig, friction, band)
    # Onsets well above the friction belong to branches that may dip to it between two samples.
    onsets = partial(_onsets, rig, band, 4.0 * friction)
    stops = set(_dense(angles))
    for branch in _branches(onsets, angles) if friction > 0.0 else []:
        for p, q in pairwise(branch):
            if (p.level > friction) != (q.level > friction):
                theta = _root(onsets, p, q, lambda at: at.level - friction).theta
                stops |= {theta - 1e-8, theta + 1e-8}
    samples = [growing(theta) for theta in sorted(stops) if first <= theta <= last]
    windows = []
    for modes in _follow(growing, samples, 1e-11, _window_ends):
        k = int(np.argmax([mode.level for mode in modes]))
        best = _extreme(growing, modes[max(k - 1, 0) : k + 2], 1.0)
        peak = max(modes[0], modes[-1], best, key=lambda mode: mode.level)
        windows.append([mode[:3] for mode in (modes[0], modes[-1], peak)])
    at, level, frequency = np.array(windows).reshape(-1, 3, 3).transpose(2, 1, 0)
    ends = frequency[:2]
    ends[2.0 * np.pi * ends < 1e-4 * level[:2]] = 0.0
    ends[ends > (1.0 - 1e-9) * band] = band
    order = np.lexsort((at[0], ends[0]))
    low, high, peak = at[:, order]
    low_frequency, high_frequency, peak_frequency = frequency[:, order]
    limits = low, high, low_frequency, high_frequency, low == first, high == last
    return UnstableWindows(*limits, level[2, order], peak, peak_frequency)


class Point(NamedTuple):
    """An onset, a recovery or a growing mode at one angle, in degrees."""

    theta: float
    # Friction of an onset or growth rate (1/s) of a mode; Hz; coordinates in which distances are measured.
    level: float
    frequency: float
    place: complex
    # False for a recovery; only points of one kind are linked.
    rises: bool = True
    # Beyond the limits of interest, where a branch may end for no known reason.
    outside: bool = False
    # Why a branch ends here.
    end: str = "range"


Pairs = list[tuple[Point, Point]]
Sample = tuple[float, list[Point]]
Sampler = Callable[[float], Sample]
# Pairs of points without a counterpart, on the left and on the right, with the ends of their branches at an angle.
Ending = Callable[[list[Point], list[Point], float], Pairs]


def _onsets(rig: Rig, fmax: float, mu_max: float, theta: float, *, exact: bool = False) -> Sample:
    """Onsets and recoveries up to the limits if `exact`, else beyond, to bracket where branches pass them."""
    band, most = (fmax, mu_max) if exact else (1.1 * fmax, 2.0 * mu_max)
    found, points = crossings(rig_table({"theta": theta}, rig), band, most, rig)[0], list[Point]()
    for _, mu, frequency, change in found[:, found[2] <= band].T[np.argsort(found[2, found[2] <= band])].tolist():
        rises = change > 0.0
        # This close to a fold they are one zero and its rounding.
        if points and points[-1].rises != rises and frequency - points[-1].frequency < 1e-8 * frequency:
            points.pop()
            continue
        # A distance of 1 is a tenth of the frequency or a factor of e in friction.
        place = complex(10.0 * np.log(frequency), np.log(mu))
        points.append(Point(theta, mu, frequency, place, rises, mu > mu_max or frequency > fmax))
    return theta, points


def _branches(sample: partial[Sample], theta: Array) -> list[list[Point]]:
    """Every branch at ascending angles, with its folds and the extremes of its friction."""
    samples = [sample(angle, exact=True) for angle in _dense(theta)]
    if len(samples) == 1:
        return [[point] for point in samples[0][1]]
    branches = []
    for branch in _follow(sample, samples, 1e-9, _folds):
        # The slope at an end of the range tells whether there is an extreme before the next point.
        beside = [
            _locate(sample, pair, 0.999 * end.theta + 0.001 * (pair[0].theta + pair[1].theta - end.theta))
            for pair, end in ((branch[:2], branch[0]), (branch[-2:], branch[-1]))
            if end.end == "range" and not end.outside
        ]
        points = sorted([*branch, *beside])
        extremes = {
            _extreme(sample, (p, at, q), 1.0 if at.level > p.level else -1.0)
            for p, at, q in zip(points, points[1:], points[2:], strict=False)
            if (at.level > p.level) == (at.level > q.level)
        }
        branches.append(sorted(extremes | set(branch)))
    return branches


def _folds(before: list[Point], after: list[Point], theta: float) -> Pairs:
    """Pairs of an onset or a recovery and the fold in which the two meet."""
    pairs: Pairs = []
    for ended in (before, after):
        for p in (point for point in ended if not point.outside):
            kinds = [[point for point in ended if (point.rises == p.rises) is same] for same in (True, False)]
            q = _counterpart(p, *kinds)
            if q is None:
                raise UnsolvedError(f"theta = {theta:.9g}: onsets near it cannot be told apart; leave it out")
            mu, frequency = 0.5 * (p.level + q.level), 0.5 * (p.frequency + q.frequency)
            fold = p._replace(theta=theta, level=mu, frequency=frequency, end="fold")
            pairs.append((p, fold) if ended is before else (fold, p))
    return pairs


def _dense(theta: Array) -> list[float]:
    """The given angles and others between them, at most half a degree apart."""
    parts = [np.linspace(a, b, int(np.ceil(2.0 * (b - a))) + 1)[:-1] for a, b in pairwise(theta)]
    return [float(angle) for angle in np.concatenate([*parts, theta[-1:]])]


def _table(theta: Array, curves: tuple[OnsetCurve, ...]) -> Array:
    """Friction and frequency of each curve at the given angles, (2, theta, curve)."""
    table = np.full((2, len(theta), len(curves)), np.nan)
    for k, curve in enumerate(curves):
        _, given, own = np.intersect1d(theta, curve.theta, return_indices=True)
        table[:, given, k] = curve.mu[own], curve.frequency[own]
    return table


def _growing(rig: Rig, mu: float, fmax: float, theta: float) -> Sample:
    """Modes that grow while they oscillate."""
    modes = sliding_modes(rig, theta, mu, fmax)
    both = zip(modes.growth_rate.tolist(), modes.frequency.tolist(), strict=True)
    return theta, [
        Point(theta, rate, frequency, complex(np.log(complex(rate, 2.0 * np.pi * frequency))))
        for rate, frequency in both
        if rate > 0.0 and frequency > 0.0
    ]


def _window_ends(before: list[Point], after: list[Point], theta: float) -> Pairs:
    """Pairs of a growing mode and the end of its window."""
    ended = [(mode, mode._replace(theta=theta)) for mode in before]
    return ended + [(mode._replace(theta=theta), mode) for mode in after]


def _follow(sampler: Sampler, samples: list[Sample], shortest: float, ending: Ending) -> list[list[Point]]:
    """Branches through ascending samples, each ascending in theta, from intervals down to `shortest` degrees."""
    branches: dict[Point, list[Point]] = {}
    for left, right in pairwise(samples):
        for first, second in _link(sampler, left, right, shortest, ending):
            branches[second] = [*branches.pop(first, [first]), second]
    return list(branches.values())


def _link(sampler: Sampler, left: Sample, right: Sample, shortest: float, ending: Ending) -> Pairs:
    """Pairs of neighbours on each branch between two samples."""
    pairs, clear = _counterparts(left[1], right[1])
    linked = set(chain.from_iterable(pairs))
    before, after = ([point for point in points if point not in linked] for _, points in (left, right))
    middle = 0.5 * (left[0] + right[0])
    if right[0] - left[0] <= shortest or (clear and all(point.outside for point in before + after)):
        return pairs + ending(before, after, middle)
    between = sampler(middle)
    return _link(sampler, left, between, shortest, ending) + _link(sampler, between, right, shortest, ending)


def _counterparts(left: list[Point], right: list[Point]) -> tuple[Pairs, bool]:
    """Pairs of mutually nearest points, and whether all are clear: no rival is nearer than twice as far."""
    pairs, all_clear = [], True
    for p in left:
        q = _counterpart(p, *([point for point in points if point.rises == p.rises] for points in (left, right)))
        if q is None:
            continue
        rivals = [point.place for point in left + right if point is not p and point is not q]
        rival = min((min(abs(place - p.place), abs(place - q.place)) for place in rivals), default=np.inf)
        distance = abs(p.place - q.place)
        clear = distance <= 0.5 * rival
        if distance <= 0.3 and (clear or not (p.outside and q.outside)):
            pairs.append((p, q))
            all_clear = all_clear and clear
    return pairs, all_clear


def _counterpart(p: Point, own: list[Point], others: list[Point]) -> Point | None:
    """The nearest to p of others, if p is the nearest to it of its own."""
    q = min(others, key=lambda point: abs(point.place - p.place), default=None)
    return q if q and min(own, key=lambda point: abs(point.place - q.place)) is p else None


def _locate(sampler: Sampler, near: Sequence[Point], theta: float) -> Point:
    """The point at `theta` of the branch that passes through some neighbours, ascending in theta."""
    place = np.interp(theta, [point.theta for point in near], [point.place for point in near])
    same_angle = [point for point in near if point.theta == theta]
    points = same_angle or [point for point in sampler(theta)[1] if point.rises == near[0].rises]
    if not points:
        raise UnsolvedError(f"theta = {theta:.9g}: a branch is lost between two angles at which it is known")
    return min(points, key=lambda point: abs(point.place - place))


def _root(sampler: Sampler, p: Point, q: Point, function: Callable[[Point], float]) -> Point:
    """The point between neighbours where `function`, of opposite sign at them, is zero."""
    theta = brentq(lambda x: function(_locate(sampler, [p, q], x)), p.theta, q.theta, xtol=1e-14)
    return _locate(sampler, [p, q], theta)


def _extreme(sampler: Sampler, near: Sequence[Point], sign: float) -> Point:
    """Where the level is largest (`sign` = 1) or least (-1) between the first and the last of neighbours."""
    best, ends = max(near, key=lambda point: sign * point.level), (near[0].theta, near[-1].theta)
    if ends[1] - ends[0] < 1e-6:
        return best
    theta = fminbound(lambda x: -sign * _locate(sampler, near, x).level, *ends, xtol=1e-8)
    return max(best, _locate(sampler, near, float(theta)), key=lambda point: sign * point.level)
