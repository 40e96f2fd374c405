"""Flutter over an interval of inclinations: curves of onsets, and windows in which a pair of modes is unstable.

Both sample the certified functions at neighbouring angles (`flutter_onsets`, `sliding_modes`), link the samples to
branches (`fivcore.stability.branches`) and refine ends and extremes by bracketed root finding. Onset and recovery
meet in folds, where the square of their distance in frequency falls linearly to zero in theta.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import checks
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.stability.branches import Interval, Point, Sample, Sampler, chains, extreme, link, nearest, root
from fivcore.stability.onsets import onset_crossings
from fivcore.stability.sliding import sliding_modes

# Samples are at most so many degrees apart.
SPACING = 0.5
# Beyond the largest friction and the end of the band points are known as well, to bracket where a branch passes
# them: up to these multiples.
MORE_FRICTION, MORE_BAND = 2.0, 1.1
# Windows look at onsets up to this many times their friction, for what dips to it between two angles.
HEADROOM = 4.0
# Degrees: an interval so short holds a fold; a growing mode is known to end within one so short; and a mode is looked
# for this far on either side of its onset.
FOLD, END, BESIDE = 2e-8, 1e-11, 1e-8
# Onset and recovery closer than this share of their frequency are rounding: so close to a fold they come in numbers.
SAME = 1e-8
# A mode with a smaller share of oscillation in |phi| ceases to oscillate at the end of its window.
CEASED = 1e-4


@dataclass(frozen=True, eq=False)
class OnsetCurve:
    """One branch of onsets or of recoveries; arrays are read-only.

    Attributes
    ----------
    theta, mu, frequency : ndarray, (n,)
        Degrees, ascending; 1; Hz.
    rises : bool
        True for onsets, where a growth rate rises through zero with mu; False for recoveries.
    ends : tuple of str
        Where it begins and ends: the "range" of theta, "mu_max", "fmax", or a "fold", where it meets a branch of the
        other kind.
    lowest : tuple of float
        Where mu is least: theta, mu and frequency.
    """

    theta: Array
    mu: Array
    frequency: Array
    rises: bool
    ends: tuple[str, str]
    lowest: tuple[float, float, float]

    def __post_init__(self) -> None:
        for part in (self.theta, self.mu, self.frequency):
            part.setflags(write=False)


@dataclass(frozen=True, eq=False)
class OnsetCurves:
    """All branches over an interval of theta, and their values at given angles; arrays are read-only.

    Attributes
    ----------
    onsets, recoveries : tuple of OnsetCurve
        Ascending in frequency where mu is least.
    theta : ndarray, (k,)
        The given angles, degrees.
    mu, frequency : ndarray, (k, onsets)
        Friction and frequency (Hz) of the onsets there, NaN where a branch does not reach.
    recovery_mu, recovery_frequency : ndarray, (k, recoveries)
        Likewise of the recoveries.
    """

    onsets: tuple[OnsetCurve, ...]
    recoveries: tuple[OnsetCurve, ...]
    theta: Array
    mu: Array
    frequency: Array
    recovery_mu: Array
    recovery_frequency: Array

    def __post_init__(self) -> None:
        for part in (self.theta, self.mu, self.frequency, self.recovery_mu, self.recovery_frequency):
            part.setflags(write=False)


@dataclass(frozen=True, eq=False)
class UnstableWindows:
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

    def __post_init__(self) -> None:
        for part in vars(self).values():
            part.setflags(write=False)


def onset_curves(rig: Rig, theta: Any, fmax: float = 10e3, mu_max: float = 1.0) -> OnsetCurves:
    """Flutter onsets and recoveries of steady sliding (V > 0) as curves over theta.

    Parameters
    ----------
    rig : Rig
    theta : array_like, (k,)
        Degrees, ascending. Where they are more than half a degree apart, onsets are sampled between them too.
    fmax : float
        Band, Hz.
    mu_max : float
        Largest friction of interest.

    Returns
    -------
    OnsetCurves
        At the given angles the numbers of `flutter_onsets`. The branches pass through these, through further samples
        where they are steep, and through their ends and lowest points.

    Raises
    ------
    ValueError
        For an argument out of range.
    ArithmeticError
        If onsets cannot be isolated at an angle, or told apart between two.

    Notes
    -----
    Not seen are branches with both ends between two neighbouring samples, and a branch that turns back and forth
    between two of them passes for a smooth one. What grows without an onset has no curve (`FlutterOnsets`).
    """
    checks.instance("rig", rig, Rig)
    angles = checks.array("theta", theta, checks.theta_degrees)
    if angles.ndim != 1 or not len(angles) or np.any(np.diff(angles) <= 0.0):
        raise ValueError(f"theta of shape {angles.shape}: it must be a list of ascending angles, each once")
    search = _Onsets(
        rig, checks.band(fmax), checks.between("mu_max", mu_max, 1e-12, 1e6, "a coefficient of friction")
    )
    curves = [curve for chain in search.branches(angles) for curve in search.curves(chain)]
    curves.sort(key=lambda curve: curve.lowest[2])
    onsets = tuple(curve for curve in curves if curve.rises)
    recoveries = tuple(curve for curve in curves if not curve.rises)
    return OnsetCurves(onsets, recoveries, angles, *_table(angles, onsets), *_table(angles, recoveries))


def unstable_windows(
    rig: Rig, mu: float, theta_min: float, theta_max: float, fmax: float = 10e3
) -> UnstableWindows:
    """Intervals of theta in which a pair of modes of steady sliding (V > 0) is unstable at one friction.

    A window opens or closes where a branch of onsets or recoveries passes `mu` (`onset_curves`), and besides where
    a growing mode enters or leaves the band, or begins or ceases to oscillate.

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
        Ends by onset and recovery to rounding, others to 1e-11 degrees.

    Raises
    ------
    ValueError
        For an argument out of range.
    ArithmeticError
        If onsets cannot be told apart.

    Notes
    -----
    No mode that grows at one of the samples, half a degree apart at most, is missed. Between two of them a window is
    seen if the branch of onsets it belongs to is below four times `mu` at one; not, if a mode that grows violently
    enters the band and leaves it there without an onset. Growth without oscillation (divergence) makes no window;
    `sliding_modes` at the theta in question has it.
    """
    checks.instance("rig", rig, Rig)
    friction = checks.friction(mu)
    first = checks.number("theta_min", theta_min, "an angle between -90 and 90 degrees", lambda x: abs(x) < 90.0)
    last = checks.number(
        "theta_max", theta_max, f"above theta_min = {first:g} and below 90 degrees", lambda x: first < x < 90.0
    )
    band = checks.band(fmax)
    angles = np.array([first, last])
    growing = partial(_growing, rig, friction, band)
    onsets = _Onsets(rig, band, HEADROOM * friction).passing(angles, friction) if friction > 0.0 else []
    stops: list[tuple[float, Point | None]] = [(theta, None) for theta in _dense(angles)]
    stops += [(point.theta + side, point) for point in onsets for side in (-BESIDE, BESIDE)]
    stops = sorted((stop for stop in stops if first <= stop[0] <= last), key=lambda stop: stop[0])
    intervals, ends = [], []
    for (left, before), (right, after) in pairwise([(growing(theta), onset) for theta, onset in stops]):
        onset = before if before is after else None
        for each in link(growing, left, right, END if onset is None else np.inf):
            intervals.append(each)
            ends += _ends(each, onset)
    windows = chains(intervals, ends)
    columns = {
        "from": [_end(window[0], band) for window in windows],
        "to": [_end(window[-1], band) for window in windows],
        "peak": [_peak(growing, window) for window in windows],
    }
    order = sorted(range(len(windows)), key=lambda k: (columns["from"][k].frequency, columns["from"][k].theta))
    begin, end, peak = (
        np.array([(each[k].theta, each[k].frequency, each[k].level) for k in order]).reshape(-1, 3).T.copy()
        for each in columns.values()
    )
    return UnstableWindows(
        theta_from=begin[0],
        theta_to=end[0],
        frequency_from=begin[1],
        frequency_to=end[1],
        open_from=begin[0] == first,
        open_to=end[0] == last,
        peak_growth_rate=peak[2],
        peak_theta=peak[0],
        peak_frequency=peak[1],
    )


@dataclass(frozen=True)
class _Onsets:
    """Samples and branches of onsets and recoveries of one rig, below `fmax` (Hz) and `mu_max`."""

    rig: Rig
    fmax: float
    mu_max: float

    def within(self, theta: float) -> Sample:
        """Onsets and recoveries within the limits, with the numbers of `flutter_onsets`."""
        return self._sample(theta, self.fmax, self.mu_max)

    def beyond(self, theta: float) -> Sample:
        """Those within wider limits too."""
        return self._sample(theta, MORE_BAND * self.fmax, MORE_FRICTION * self.mu_max)

    def _sample(self, theta: float, fmax: float, mu_max: float) -> Sample:
        points: list[Point] = []
        for frequency, mu, rises in sorted(
            (f, mu, rises) for mu, f, rises in onset_crossings(self.rig, theta, fmax, mu_max)
        ):
            if points and points[-1].rises != rises and frequency - points[-1].frequency < SAME * frequency:
                points.pop()
                continue
            # A distance of 1 is a tenth of the frequency or a factor of e in friction.
            place = complex(10.0 * np.log(frequency), np.log(mu))
            points.append(Point(theta, mu, frequency, place, rises, mu > self.mu_max or frequency > self.fmax))
        return Sample(theta, points)

    def branches(self, theta: Array) -> list[list[Point]]:
        """Every branch through the onsets at ascending angles, with its folds and the extremes of its friction."""
        samples = [self.within(angle) for angle in _dense(theta)]
        intervals = [each for left, right in pairwise(samples) for each in link(self.beyond, left, right, FOLD)]
        folds = [pair for each in intervals for pair in self._folds(each)]
        found = chains(intervals or [Interval(samples[0], samples[0], [])], folds)
        return [self._with_extremes(branch) for branch in found]

    def _folds(self, interval: Interval) -> list[tuple[Point, Point]]:
        """Pairs of an onset or a recovery without a counterpart and the fold in which the two meet."""
        pairs: list[tuple[Point, Point]] = []
        for ended, outwards in zip(interval.ended(), (1.0, -1.0), strict=True):
            folded: set[int] = set()
            for p in ended:
                if p.may_end or id(p) in folded:
                    continue
                others = [each for each in ended if each.rises != p.rises and id(each) not in folded]
                if not others:
                    raise ArithmeticError(
                        f"theta = {p.theta:.9g}: onsets near it cannot be told apart with this rig; leave it out"
                    )
                q = nearest(others, p.place, rises=not p.rises)
                folded |= {id(p), id(q)}
                at = self._fold(p, q, 10.0 * outwards * FOLD)
                pairs += [(each, replace(at, rises=each.rises))[:: int(outwards)] for each in (p, q)]
        return pairs

    def _fold(self, p: Point, q: Point, step: float) -> Point:
        """Where p and q meet: the square of their distance falls linearly in theta, and their mean is smooth."""
        inner = self.beyond(p.theta - step).points
        a, b = (nearest(inner, each.place, rises=each.rises) for each in (p, q))
        near, far = (p.frequency - q.frequency) ** 2, (a.frequency - b.frequency) ** 2
        share = near / (far - near)

        def at(one: float, other: float, before: float, after: float) -> float:
            mean = 0.5 * (one + other)
            return mean + share * (mean - 0.5 * (before + after))

        mu = at(p.level, q.level, a.level, b.level)
        frequency = at(p.frequency, q.frequency, a.frequency, b.frequency)
        return replace(p, theta=p.theta + share * step, level=mu, frequency=frequency, may_end=True, end="fold")

    def _with_extremes(self, branch: list[Point]) -> list[Point]:
        """A branch and, between its points, where friction is least or largest."""
        found = [*branch]
        for p, at, q in zip(branch, branch[1:], branch[2:], strict=False):
            if (at.level > p.level) == (at.level > q.level):
                best = extreme(self.beyond, [p, at, q], -1.0 if at.level > p.level else 1.0)
                found += [best] if best is not at else []
        return sorted(found, key=lambda point: point.theta)

    def curves(self, branch: list[Point]) -> list[OnsetCurve]:
        """The parts of a branch within the limits."""
        pieces: list[list[Point]] = [[]]
        for before, point in pairwise([None, *branch]):
            if before and (self._excess(before) > 0.0) != (self._excess(point) > 0.0):
                edge = self._edge(before, point)
                pieces[-1].append(edge)
                pieces += [[]] if self._excess(point) > 0.0 else []
            if self._excess(point) <= 0.0:
                pieces[-1].append(point)
        return [self._curve(piece) for piece in pieces if piece]

    def _excess(self, point: Point) -> float:
        return max(point.level / self.mu_max, point.frequency / self.fmax) - 1.0

    def _edge(self, p: Point, q: Point) -> Point:
        """Where a branch passes a limit."""
        edge = root(self.beyond, p, q, self._excess)
        if edge.level / self.mu_max > edge.frequency / self.fmax:
            return replace(edge, level=self.mu_max, end="mu_max")
        return replace(edge, frequency=self.fmax, end="fmax")

    def _curve(self, piece: list[Point]) -> OnsetCurve:
        theta, mu, frequency = np.array([(point.theta, point.level, point.frequency) for point in piece]).T.copy()
        k = int(np.argmin(mu))
        ends = (piece[0].end or "range", piece[-1].end or "range")
        lowest = (float(theta[k]), float(mu[k]), float(frequency[k]))
        return OnsetCurve(theta, mu, frequency, piece[0].rises, ends, lowest)

    def passing(self, theta: Array, mu: float) -> list[Point]:
        """Where branches pass a friction."""
        return [
            root(self.beyond, p, q, lambda point: point.level - mu)
            for branch in self.branches(theta)
            for p, q in pairwise(branch)
            if (p.level > mu) != (q.level > mu)
        ]


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
    points = []
    for growth, frequency in zip(modes.growth_rate.tolist(), modes.frequency.tolist(), strict=True):
        if growth > 0.0 and frequency > 0.0:
            place = complex(np.log(complex(growth, 2.0 * np.pi * frequency)))
            points.append(Point(theta, growth, frequency, place))
    return Sample(theta, points)


def _ends(interval: Interval, onset: Point | None) -> list[tuple[Point, Point]]:
    """Pairs of a growing mode without a counterpart and the end of its window: the onset, if one lies between."""
    middle = 0.5 * (interval.left.theta + interval.right.theta)
    pairs = []
    for ended, way in zip(interval.ended(), (1, -1), strict=True):
        for mode in ended:
            end = replace(mode, theta=middle) if onset is None else replace(onset, level=0.0)
            pairs.append((mode, end)[::way])
    return pairs


def _end(mode: Point, fmax: float) -> Point:
    """The end of a window, its frequency that of the band where the mode goes on beyond it, or 0 where it diverges."""
    if 2.0 * np.pi * mode.frequency < CEASED * mode.level:
        return replace(mode, frequency=0.0)
    return replace(mode, frequency=fmax) if mode.frequency > (1.0 - 1e-9) * fmax else mode


def _peak(growing: Sampler, window: list[Point]) -> Point:
    """Where a mode grows fastest; its window's end rather than the last mode before it."""
    k = max(range(len(window)), key=lambda k: window[k].level)
    best = extreme(growing, window[max(k - 1, 0) : k + 2], -1.0)
    return max([window[0], window[-1], best], key=lambda mode: mode.level)
