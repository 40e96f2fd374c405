"""Flutter over an interval of inclinations: curves of onsets, and windows in which a pair of modes is unstable.

At each angle of a fine grid all flutter onsets or growing modes are computed. Points at neighbouring angles are
linked if each is nearest to the other. If a point has no counterpart, the interval is halved until the end of its
branch is located. Roots and extremes along a branch are bracketed (Brent, Algorithms for Minimization without
Derivatives, 1973).
"""

from __future__ import annotations

from collections.abc import Callable
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

# Largest distance of linked points; see `Point.place`.
LINK_REACH = 0.3


@dataclass(frozen=True, eq=False)
class OnsetCurve(ReadOnlyArrays):
    """One branch of onsets or of recoveries; arrays are read-only.

    Attributes
    ----------
    theta, mu, frequency : ndarray, (n,)
        Degrees, ascending; 1; Hz.
    destabilising : bool
        True for onsets, False for recoveries.
    ends : tuple of str
        Where it begins and ends: the "range" of theta, "mu_max", "fmax", or a "fold", where it meets a branch of
        the other kind.
    lowest : tuple of float
        theta, mu and frequency at the smallest mu. The relative accuracy of theta is about 1e-8, because mu is
        stationary there; that of the frequency follows.
    """

    theta: Array
    mu: Array
    frequency: Array
    destabilising: bool
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
        Whether the window continues beyond the range of theta that was searched.
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
        Degrees, ascending. Where they are more than 0.2 degrees apart, onsets are sampled between them too.
    fmax, mu_max : float
        Band, Hz; largest friction of interest.

    Returns
    -------
    OnsetCurves
        Values at the given angles are those of `flutter_onsets`. A branch narrower than 0.2 degrees can be missed,
        and two folds that close to each other.

    Raises
    ------
    ValueError, ArithmeticError
        For an argument out of range; if onsets cannot be isolated at an angle, or separated between two.
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
        for outside, group in groupby(sorted(points), lambda point: point.outside):
            if not outside:
                part = list(group)
                lowest, ends = min(part, key=lambda point: point.level)[:3], (part[0].end, part[-1].end)
                at, mu, frequency = np.array([point[:3] for point in part]).T.copy()
                curves.append(OnsetCurve(at, mu, frequency, part[0].destabilising, ends, lowest))
    curves.sort(key=lambda curve: curve.lowest[2])
    onsets, recoveries = (tuple(each for each in curves if each.destabilising is kind) for kind in (True, False))
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
        Ends to 1e-11 degrees. The search can miss a window narrower than 0.2 degrees if its onset exceeds four
        times `mu` at the samples on both sides, and one narrower than 0.5 degrees if it has no onset curve.

    Raises
    ------
    ValueError, ArithmeticError
        For an argument out of range; if onsets cannot be separated.
    """
    checks.instance("rig", rig, Rig)
    friction = checks.friction(mu)
    first = checks.number("theta_min", theta_min, "an angle between -90 and 90 degrees", lambda x: abs(x) < 90.0)
    allowed = f"above theta_min = {first:g} and below 90 degrees"
    last = checks.number("theta_max", theta_max, allowed, lambda x: first < x < 90.0)
    band = checks.band(fmax)
    angles, growing = np.array([first, last]), partial(_growing, rig, friction, band)
    # Onsets well above the friction belong to branches that may dip to it between two samples.
    onsets = partial(_onsets, rig, band, 4.0 * friction)
    stops = set(_dense(angles, 0.5))
    for branch in _branches(onsets, angles) if friction > 0.0 else []:
        for p, q in pairwise(branch):
            if (p.level > friction) != (q.level > friction):
                theta = _root(onsets, p, q, lambda at: at.level - friction).theta
                stops |= {theta - 1e-8, theta + 1e-8}
    inside, windows = [theta for theta in sorted(stops) if first <= theta <= last], []
    for modes in _follow(growing, inside, growing(inside), 1e-11, False):
        k = int(np.argmax([mode.level for mode in modes]))
        best = _extreme(growing, modes[max(k - 1, 0) : k + 2], 1.0)
        peak = max(modes[0], modes[-1], best, key=lambda mode: mode.level)
        windows.append([mode[:3] for mode in (modes[0], modes[-1], peak)])
    at, level, frequency = np.array(windows).reshape(-1, 3, 3).transpose(2, 1, 0)
    ends = frequency[:2]
    ends[2.0 * np.pi * ends < 1e-4 * level[:2]] = 0.0
    ends[ends > (1.0 - 1e-9) * band] = band
    order = np.lexsort((at[0], ends[0]))
    (low, high, peak), (start, end, fastest), grows = at[:, order], frequency[:, order], level[2, order]
    return UnstableWindows(low, high, start, end, low == first, high == last, grows, peak, fastest)


class Point(NamedTuple):
    """An onset, a recovery or a growing mode at one angle, in degrees."""

    theta: float
    # Friction of an onset or growth rate (1/s) of a mode; Hz; coordinates in which distances are measured.
    level: float
    frequency: float
    place: complex
    # False for a recovery; only points of one kind are linked.
    destabilising: bool = True
    # True beyond the limits of interest, where the end of a branch does not matter.
    outside: bool = False
    # Why a branch ends here.
    end: str = "range"


Points = list[Point]
Sampler = Callable[[list[float]], list[Points]]


def _onsets(rig: Rig, fmax: float, mu_max: float, angles: list[float], *, exact: bool = False) -> list[Points]:
    """Onsets and recoveries at angles up to the limits if `exact`, else beyond, to bracket where branches pass."""
    band, most = (fmax, mu_max) if exact else (1.1 * fmax, 2.0 * mu_max)
    found, _ = crossings(rig_table({"theta": angles}, rig), band, most, rig)
    samples = [list[Point]() for _ in angles]
    for place, row, mu, change in sorted(found[[2, 0, 1, 3]].T[found[2] <= band].tolist()):
        points, destabilising = samples[int(row)], change > 0.0
        # This close to a fold, onset and recovery coincide to rounding.
        if points and points[-1].destabilising != destabilising and place - points[-1].frequency < 1e-8 * place:
            points.pop()
            continue
        # A distance of 1 is a tenth of the frequency or a factor of e in friction.
        at = complex(10.0 * np.log(place), np.log(mu))
        points.append(Point(angles[int(row)], mu, place, at, destabilising, mu > mu_max or place > fmax))
    return samples


def _growing(rig: Rig, mu: float, fmax: float, angles: list[float]) -> list[Points]:
    """Modes that grow while they oscillate, at angles."""
    samples = []
    for theta in angles:
        modes = sliding_modes(rig, theta, mu, fmax)
        fit = modes.unstable & (modes.frequency > 0.0)
        both = zip(modes.growth_rate[fit].tolist(), modes.frequency[fit].tolist(), strict=True)
        samples.append([Point(theta, *each, np.log(complex(each[0], 2.0 * np.pi * each[1]))) for each in both])
    return samples


def _branches(sample: partial[list[Points]], theta: Array) -> list[Points]:
    """Every branch at ascending angles, with its folds and the extremes of its friction."""
    angles = _dense(theta, 0.2)
    samples, branches = sample(angles, exact=True), []
    if len(angles) == 1:
        return [[point] for point in samples[0]]
    for branch in _follow(sample, angles, samples, 1e-9, True):
        # An extreme may also be in the first interval or in the last.
        near = [branch[:2], branch[-2:], *(branch[k : k + 3] for k in range(len(branch) - 2))]
        extremes = {_extreme(sample, part, sign) for part in near for sign in (-1.0, 1.0) if _bends(part, sign)}
        branches.append(sorted(extremes.union(branch)))
    return branches


def _bends(part: Points, sign: float) -> bool:
    """Whether two points are an end of the range, or the middle one of three is the largest or the least."""
    if len(part) == 2:
        return not any(point.outside or point.end == "fold" for point in part)
    return sign * part[1].level > max(sign * part[0].level, sign * part[2].level)


def _dense(theta: Array, step: float) -> list[float]:
    """The given angles and others between them, at most a step apart."""
    parts = [np.linspace(a, b, int(np.ceil((b - a) / step)) + 1)[:-1] for a, b in pairwise(theta)]
    return [float(angle) for angle in np.concatenate([*parts, theta[-1:]])]


def _table(theta: Array, curves: tuple[OnsetCurve, ...]) -> Array:
    """Friction and frequency of each curve at the given angles, (2, theta, curve)."""
    table = np.full((2, len(theta), len(curves)), np.nan)
    for k, curve in enumerate(curves):
        _, given, own = np.intersect1d(theta, curve.theta, return_indices=True)
        table[:, given, k] = curve.mu[own], curve.frequency[own]
    return table


def _follow(
    sampler: Sampler, angles: list[float], samples: list[Points], least: float, folds: bool
) -> list[Points]:
    """Branches through samples at ascending angles; ends are between angles at most `least` degrees apart."""
    branches: dict[Point, Points] = {}
    for left, right in pairwise(zip(angles, samples, strict=True)):
        for first, second in _link(sampler, left, right, least, folds):
            branches[second] = [*branches.pop(first, [first]), second]
    return list(branches.values())


def _link(sampler: Sampler, left: Any, right: Any, least: float, folds: bool) -> list[tuple[Point, Point]]:
    """Pairs of neighbours on each branch between two samples, which are an angle and its points."""
    pairs = [(p, q) for p in left[1] for q in _nearest(p, right[1]) if _nearest(q, left[1])[0] is p]
    pairs = [(p, q) for p, q in pairs if abs(q.place - p.place) <= LINK_REACH]
    linked, middle = set(chain.from_iterable(pairs)), 0.5 * (left[0] + right[0])
    before, after = ([p for p in points if p not in linked and not p.outside] for _, points in (left, right))
    if not before and not after:
        return pairs
    if right[0] - left[0] > least:
        between = middle, sampler([middle])[0]
        return [*_link(sampler, left, between, least, folds), *_link(sampler, between, right, least, folds)]
    ends = [(p, _end(p, left[1], linked, middle, folds)) for p in before]
    return pairs + ends + [(_end(p, right[1], linked, middle, folds), p) for p in after]


def _nearest(p: Point, points: Points) -> Points:
    """The nearest to p of the points of its kind, or none."""
    same = [q for q in points if q.destabilising == p.destabilising]
    return [min(same, key=lambda q: abs(q.place - p.place))] if same else []


def _end(p: Point, points: Points, linked: set[Point], theta: float, folds: bool) -> Point:
    """The end at `theta` of the branch of p: a fold, where it meets the nearest point of the other kind, or p."""
    if not folds:
        return p._replace(theta=theta)
    others = [q for q in points if q.destabilising != p.destabilising and q not in linked]
    if not others:
        raise UnsolvedError(f"theta = {theta:.9g}: onsets near it cannot be separated; leave it out")
    q = min(others, key=lambda q: abs(q.place - p.place))
    mu, frequency = 0.5 * (p.level + q.level), 0.5 * (p.frequency + q.frequency)
    return p._replace(theta=theta, level=mu, frequency=frequency, end="fold")


def _locate(sampler: Sampler, near: Points, theta: float) -> Point:
    """The point at `theta` of the branch that passes through some neighbours, ascending in theta."""
    place = np.interp(theta, [point.theta for point in near], [point.place for point in near])
    same_angle = [point for point in near if point.theta == theta]
    points = same_angle or [point for point in sampler([theta])[0] if point.destabilising == near[0].destabilising]
    if not points:
        raise UnsolvedError(f"theta = {theta:.9g}: a branch is lost between two angles at which it is known")
    return min(points, key=lambda point: abs(point.place - place))


def _root(sampler: Sampler, p: Point, q: Point, function: Callable[[Point], float]) -> Point:
    """The point between neighbours where `function`, of opposite sign at them, is zero."""
    theta = brentq(lambda x: function(_locate(sampler, [p, q], x)), p.theta, q.theta, xtol=1e-14)
    return _locate(sampler, [p, q], theta)


def _extreme(sampler: Sampler, near: Points, sign: float) -> Point:
    """Where the level is largest (`sign` = 1) or least (-1) between the first and the last of neighbours."""
    best, ends = max(near, key=lambda point: sign * point.level), (near[0].theta, near[-1].theta)
    if ends[1] - ends[0] < 1e-6:
        return best
    theta = fminbound(lambda x: -sign * _locate(sampler, near, x).level, *ends, xtol=1e-8)
    return max(best, _locate(sampler, near, float(theta)), key=lambda point: sign * point.level)
