"""Flutter over an interval of inclinations: curves of onsets, and windows in which a pair of modes is unstable.

A sample holds every point at its angle: all flutter onsets, or all growing modes. Two neighbouring samples are
linked where each point has one clear counterpart in the other. Where one has none, the interval between them is
halved until all have, or until it is so short that a point is said to end in it. Roots and extremes along a branch
are found by bracketing (Brent, Algorithms for Minimization without Derivatives, 1973), with a sample at every
angle tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, fminbound

from fivcore import checks
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.stability.onsets import onset_crossings
from fivcore.stability.sliding import ReadOnlyArrays, sliding_modes

# A counterpart is clear if it is at most FAR away and no rival is nearer than twice as far.
FAR, CLEAR = 0.3, 0.5
# Shorter intervals (degrees) are not searched for an extreme.
NARROW = 1e-6
# Samples are at most so many degrees apart.
SPACING = 0.5
# Onsets are sampled up to these multiples of the largest friction and of the band, to bracket where branches end.
MORE_FRICTION, MORE_BAND = 2.0, 1.1
# Windows look at onsets up to this many times their friction, for branches that dip to it between two samples.
HEADROOM = 4.0
# Degrees: the interval in which a fold is known to lie, or a growing mode to end; and the distance from an onset
# at which its growing mode is looked for.
FOLD, END, BESIDE = 1e-9, 1e-11, 1e-8
# Onset and recovery closer than this share of their frequency are one zero and its rounding, close to a fold.
SAME = 1e-8
# At the end of a window a mode with a smaller share of oscillation in |phi| ceases to oscillate.
CEASED = 1e-4


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
        Where mu is least: theta, mu and frequency.
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
    theta_from, theta_to : ndarray, (n,)
        Ends, degrees.
    frequency_from, frequency_to : ndarray, (n,)
        Frequency of the growing mode there, Hz. At fmax it goes on growing beyond the band; at 0 it ceases to
        oscillate and diverges.
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
        At the given angles the numbers of `flutter_onsets`. The branches pass through these, through further
        samples where they are steep, and through their ends and lowest points.

    Raises
    ------
    ValueError
        For an argument out of range.
    ArithmeticError
        If onsets cannot be isolated at an angle, or told apart between two.

    Notes
    -----
    A branch with both ends between two neighbouring samples is not seen, nor one that turns back and forth there.
    """
    checks.instance("rig", rig, Rig)
    angles = checks.array("theta", theta, checks.theta_degrees)
    if angles.ndim != 1 or not len(angles) or np.any(np.diff(angles) <= 0.0):
        raise ValueError(f"theta of shape {angles.shape}: it must be a list of ascending angles, each once")
    band, most = checks.band(fmax), checks.between("mu_max", mu_max, 1e-12, 1e6, "a coefficient of friction")
    search = _Onsets(rig, band, most)
    curves = [curve for branch in search.branches(angles) for curve in search.curves(branch)]
    curves.sort(key=lambda curve: curve.lowest[2])
    onsets, recoveries = (tuple(curve for curve in curves if curve.rises is kind) for kind in (True, False))
    return OnsetCurves(onsets, recoveries, angles, *_table(angles, onsets), *_table(angles, recoveries))


def unstable_windows(
    rig: Rig, mu: float, theta_min: float, theta_max: float, fmax: float = 10e3
) -> UnstableWindows:
    """Intervals of theta in which a pair of modes of steady sliding (V > 0) is unstable at one friction.

    A window opens or closes where a branch of onsets or recoveries passes `mu` (`onset_curves`), where a growing
    mode enters or leaves the band, and where it begins or ceases to oscillate; divergence makes no window.

    Parameters
    ----------
    rig : Rig
    mu : float
        Coefficient of friction.
    theta_min, theta_max : float
        Degrees.
    fmax : float
        Band, Hz.

    Returns
    -------
    UnstableWindows
        Ends to 1e-11 degrees.

    Raises
    ------
    ValueError
        For an argument out of range.
    ArithmeticError
        If onsets cannot be told apart.

    Notes
    -----
    No mode that grows at one of the samples, half a degree apart at most, is missed. Between two of them a window
    is seen if the branch of onsets it belongs to is below four times `mu` at one; not, if a mode that grows
    violently enters the band and leaves it there without an onset.
    """
    checks.instance("rig", rig, Rig)
    friction = checks.friction(mu)
    first = checks.number("theta_min", theta_min, "an angle between -90 and 90 degrees", lambda x: abs(x) < 90.0)
    last = checks.number(
        "theta_max", theta_max, f"above theta_min = {first:g} and below 90 degrees", lambda x: first < x < 90.0
    )
    band = checks.band(fmax)
    angles, growing = np.array([first, last]), partial(_growing, rig, friction, band)
    onsets = _Onsets(rig, band, HEADROOM * friction).passing(angles, friction) if friction > 0.0 else []
    stops = _dense(angles) + [theta + side for theta in onsets for side in (-BESIDE, BESIDE)]
    samples = [growing(theta) for theta in sorted(set(stops)) if first <= theta <= last]
    branches = _follow(growing, samples, END, _window_ends)
    windows = [(_end(branch[0], band), _end(branch[-1], band), _peak(growing, branch)) for branch in branches]
    windows.sort(key=lambda window: (window[0].frequency, window[0].theta))
    table = np.array([[(at.theta, at.frequency, at.level) for at in window] for window in windows])
    theta, frequency, level = table.reshape(-1, 3, 3).transpose(2, 1, 0).copy()
    ends = theta[0], theta[1], frequency[0], frequency[1], theta[0] == first, theta[1] == last
    return UnstableWindows(*ends, peak_growth_rate=level[2], peak_theta=theta[2], peak_frequency=frequency[2])


@dataclass(frozen=True, eq=False)
class Point:
    """An onset, a recovery or a growing mode at one angle, in degrees."""

    theta: float
    # Friction of an onset or growth rate (1/s) of a mode; Hz.
    level: float
    frequency: float
    # Coordinates in which the distance of points is measured.
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


@dataclass(frozen=True)
class _Onsets:
    """Samples and branches of onsets and recoveries of one rig, for a band (Hz) and a largest friction."""

    rig: Rig
    fmax: float
    mu_max: float

    def sample(self, theta: float, *, wider: bool = True) -> Sample:
        """Onsets and recoveries within the limits, with the numbers of `flutter_onsets`, or within wider ones."""
        limits = (MORE_BAND * self.fmax, MORE_FRICTION * self.mu_max) if wider else (self.fmax, self.mu_max)
        points: list[Point] = []
        for mu, frequency, rises in sorted(onset_crossings(self.rig, theta, *limits), key=lambda each: each[1]):
            if points and points[-1].rises != rises and frequency - points[-1].frequency < SAME * frequency:
                points.pop()
                continue
            # A distance of 1 is a tenth of the frequency or a factor of e in friction.
            place = complex(10.0 * np.log(frequency), np.log(mu))
            outside = mu > self.mu_max or frequency > self.fmax
            points.append(Point(theta, mu, frequency, place, rises, outside))
        return theta, points

    def branches(self, theta: Array) -> list[list[Point]]:
        """Every branch at ascending angles, with its folds and the extremes of its friction."""
        samples = [self.sample(angle, wider=False) for angle in _dense(theta)]
        if len(samples) == 1:
            return [[point] for point in samples[0][1]]
        return [self._with_extremes(branch) for branch in _follow(self.sample, samples, FOLD, _folds)]

    def _with_extremes(self, branch: list[Point]) -> list[Point]:
        """A branch with the points between its own at which friction is least or largest."""
        found = {point.theta: point for point in branch}
        # The slope at an end of the range tells whether there is an extreme before the next point.
        beside = [
            _locate(self.sample, pair, 0.999 * end.theta + 0.001 * (pair[0].theta + pair[1].theta - end.theta))
            for pair, end in ((branch[:2], branch[0]), (branch[-2:], branch[-1]))
            if end.end == "range" and not end.outside
        ]
        points = sorted([*branch, *beside], key=lambda point: point.theta)
        for p, at, q in zip(points, points[1:], points[2:], strict=False):
            if (at.level > p.level) == (at.level > q.level):
                best = _extreme(self.sample, [p, at, q], 1.0 if at.level > p.level else -1.0)
                found[best.theta] = best
        return sorted(found.values(), key=lambda point: point.theta)

    def curves(self, branch: list[Point]) -> list[OnsetCurve]:
        """The parts of a branch within the limits."""
        edges = [self._edge(p, q) for p, q in pairwise(branch) if p.outside != q.outside]
        points = sorted([*branch, *edges], key=lambda point: point.theta)
        parts = groupby(points, lambda point: point.outside)
        return [_curve(list(part)) for outside, part in parts if not outside]

    def _edge(self, p: Point, q: Point) -> Point:
        """Where a branch passes a limit."""
        edge = _root(self.sample, p, q, lambda at: max(at.level / self.mu_max, at.frequency / self.fmax) - 1.0)
        if edge.level / self.mu_max > edge.frequency / self.fmax:
            return replace(edge, level=self.mu_max, outside=False, end="mu_max")
        return replace(edge, frequency=self.fmax, outside=False, end="fmax")

    def passing(self, theta: Array, mu: float) -> list[float]:
        """Angles at which branches pass a friction."""
        return [
            _root(self.sample, p, q, lambda at: at.level - mu).theta
            for branch in self.branches(theta)
            for p, q in pairwise(branch)
            if (p.level > mu) != (q.level > mu)
        ]


def _folds(before: list[Point], after: list[Point], theta: float) -> Pairs:
    """Pairs of an onset or a recovery and the fold in which the two meet."""
    pairs: Pairs = []
    for ended in (before, after):
        for p in (point for point in ended if not point.outside):
            q = _closest(p, [point for point in ended if point.rises != p.rises])
            if q is None or _closest(q, [point for point in ended if point.rises == p.rises]) is not p:
                raise ArithmeticError(
                    f"theta = {theta:.9g}: onsets near it cannot be told apart with this rig; leave it out"
                )
            mu, frequency = 0.5 * (p.level + q.level), 0.5 * (p.frequency + q.frequency)
            fold = replace(p, theta=theta, level=mu, frequency=frequency, end="fold")
            pairs.append((p, fold) if ended is before else (fold, p))
    return pairs


def _curve(points: list[Point]) -> OnsetCurve:
    theta, mu, frequency = np.array([(each.theta, each.level, each.frequency) for each in points]).T.copy()
    k = int(np.argmin(mu))
    lowest = (float(theta[k]), float(mu[k]), float(frequency[k]))
    return OnsetCurve(theta, mu, frequency, points[0].rises, (points[0].end, points[-1].end), lowest)


def _dense(theta: Array) -> list[float]:
    """The given angles and, where they are far apart, others between them."""
    parts = [np.linspace(a, b, int(np.ceil((b - a) / SPACING)) + 1)[:-1] for a, b in pairwise(theta)]
    return [float(angle) for angle in np.concatenate([*parts, theta[-1:]])]


def _table(theta: Array, curves: tuple[OnsetCurve, ...]) -> tuple[Array, Array]:
    """Friction and frequency of each curve at the given angles, (theta, curve)."""
    mu, frequency = np.full((2, len(theta), len(curves)), np.nan)
    for k, curve in enumerate(curves):
        _, given, own = np.intersect1d(theta, curve.theta, return_indices=True)
        mu[given, k], frequency[given, k] = curve.mu[own], curve.frequency[own]
    return mu, frequency


def _growing(rig: Rig, mu: float, fmax: float, theta: float) -> Sample:
    """Modes that grow while they oscillate."""
    modes = sliding_modes(rig, theta, mu, fmax)
    both = zip(modes.growth_rate.tolist(), modes.frequency.tolist(), strict=True)
    growing = [(growth, frequency) for growth, frequency in both if growth > 0.0 and frequency > 0.0]
    return theta, [
        Point(theta, *each, complex(np.log(complex(each[0], 2.0 * np.pi * each[1])))) for each in growing
    ]


def _window_ends(before: list[Point], after: list[Point], theta: float) -> Pairs:
    """Pairs of a growing mode and the end of its window."""
    begun, ended = ([replace(mode, theta=theta) for mode in modes] for modes in (after, before))
    return [*zip(before, ended, strict=True), *zip(begun, after, strict=True)]


def _end(mode: Point, fmax: float) -> Point:
    """The end of a window, with the frequency `fmax` where the mode leaves the band and 0 where it diverges."""
    if 2.0 * np.pi * mode.frequency < CEASED * mode.level:
        return replace(mode, frequency=0.0)
    return replace(mode, frequency=fmax) if mode.frequency > (1.0 - 1e-9) * fmax else mode


def _peak(growing: Sampler, window: list[Point]) -> Point:
    """Where a mode grows fastest; the end of its window rather than the last mode before it."""
    k = max(range(len(window)), key=lambda k: window[k].level)
    best = _extreme(growing, window[max(k - 1, 0) : k + 2], 1.0)
    return max(window[0], window[-1], best, key=lambda mode: mode.level)


def _follow(sampler: Sampler, samples: list[Sample], shortest: float, ending: Ending) -> list[list[Point]]:
    """Branches through ascending samples, each ascending in theta, from intervals down to `shortest` degrees."""
    pairs = [pair for left, right in pairwise(samples) for pair in _link(sampler, left, right, shortest, ending)]
    following = {id(first): second for first, second in pairs}
    followers = {id(second) for _, second in pairs}
    branches = [[first] for first, _ in pairs if id(first) not in followers]
    for branch in branches:
        while id(branch[-1]) in following:
            branch.append(following[id(branch[-1])])
    return branches


def _link(sampler: Sampler, left: Sample, right: Sample, shortest: float, ending: Ending) -> Pairs:
    """Pairs of neighbours on each branch between two samples."""
    pairs, clear = _counterparts(left[1], right[1])
    linked = {id(point) for pair in pairs for point in pair}
    before, after = ([point for point in points if id(point) not in linked] for _, points in (left, right))
    middle = 0.5 * (left[0] + right[0])
    if right[0] - left[0] <= shortest or (clear and all(point.outside for point in before + after)):
        return pairs + ending(before, after, middle)
    between = sampler(middle)
    return _link(sampler, left, between, shortest, ending) + _link(sampler, between, right, shortest, ending)


def _counterparts(left: list[Point], right: list[Point]) -> tuple[Pairs, bool]:
    """Pairs of mutually nearest points, and whether all are clear."""
    pairs, all_clear = [], True
    for p in left:
        q = _closest(p, [point for point in right if point.rises == p.rises])
        if q is None or _closest(q, [point for point in left if point.rises == p.rises]) is not p:
            continue
        distance = abs(p.place - q.place)
        rivals = [point.place for point in left + right if point is not p and point is not q]
        rival = min((min(abs(place - p.place), abs(place - q.place)) for place in rivals), default=np.inf)
        clear = distance <= CLEAR * rival
        if distance <= FAR and (clear or not (p.outside and q.outside)):
            pairs.append((p, q))
            all_clear = all_clear and clear
    return pairs, all_clear


def _closest(p: Point, points: list[Point]) -> Point | None:
    """The nearest to p of some points, if there are any."""
    return min(points, key=lambda point: abs(point.place - p.place), default=None)


def _locate(sampler: Sampler, near: list[Point], theta: float) -> Point:
    """The point at `theta` of the branch that passes through some neighbours, ascending in theta."""
    place = np.interp(theta, [point.theta for point in near], [point.place for point in near])
    known = [point for point in near if point.theta == theta]
    points = known or [point for point in sampler(theta)[1] if point.rises == near[0].rises]
    if not points:
        raise ArithmeticError(f"theta = {theta:.9g}: a branch is lost between two angles at which it is known")
    return min(points, key=lambda point: abs(point.place - place))


def _root(sampler: Sampler, p: Point, q: Point, function: Callable[[Point], float]) -> Point:
    """The point between neighbours where `function`, of opposite sign at them, is zero."""
    theta = brentq(lambda x: function(_locate(sampler, [p, q], x)), p.theta, q.theta, xtol=1e-14)
    return _locate(sampler, [p, q], theta)


def _extreme(sampler: Sampler, near: list[Point], sign: float) -> Point:
    """Where the level is largest (`sign` = 1) or least (-1) between the first and the last of neighbours."""
    best, ends = max(near, key=lambda point: sign * point.level), (near[0].theta, near[-1].theta)
    if ends[1] - ends[0] < NARROW:
        return best
    theta = fminbound(lambda x: -sign * _locate(sampler, near, x).level, *ends, xtol=1e-8)
    return max(best, _locate(sampler, near, float(theta)), key=lambda point: sign * point.level)
