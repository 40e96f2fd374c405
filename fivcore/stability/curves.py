"""Branches of flutter onsets and recoveries over the inclination, each to its true end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from fivcore import checks
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.stability.arcs import OnsetPlane, OnsetPoint
from fivcore.stability.inclination import inclination
from fivcore.stability.onsets import flutter_onsets

# An arc ends at a certified onset if their frequencies agree to this share.
SAME = 1e-8
# An arc that comes to an angle this close to mu_max or fmax (a share of them) need not be certified there.
TIE = 1e-7
# An interval whose arcs do not match is halved, and its halves, so many times at most.
MOST_HALVINGS = 30


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
        Where it begins and ends: the "range" of theta, "mu_max", "fmax", "mu_zero", or a "fold", where it meets a
        branch of the other kind.
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
class Branch:
    """A branch or a piece of one, ascending in theta.

    Attributes
    ----------
    points : tuple of OnsetPoint
    ends : tuple of str
        As in `OnsetCurve`; empty where it goes on, or reaches the end of the range.
    """

    points: tuple[OnsetPoint, ...]
    ends: tuple[str, str]

    @property
    def rises(self) -> bool:
        """Whether its points are onsets. A fold at its end is neither, so the clearest of them says."""
        return max(self.points, key=lambda point: abs(point.across[1])).rises


def onset_curves(rig: Rig, theta: Any, fmax: float = 10e3, mu_max: float = 1.0) -> OnsetCurves:
    """Flutter onsets and recoveries of steady sliding (V > 0) as curves over theta.

    At each angle all onsets are isolated (`flutter_onsets`). From each the curve is followed to the neighbouring
    angles, round folds, until it arrives at another of them or at the end of friction or band. Each must be the
    end of exactly one arc on either side; where that fails, arcs have been mistaken for one another or an onset
    passed over, and the interval is halved.

    Parameters
    ----------
    rig : Rig
    theta : array_like, (k,)
        Degrees, ascending.
    fmax : float
        Band, Hz.
    mu_max : float
        Largest friction of interest.

    Returns
    -------
    OnsetCurves

    Raises
    ------
    ValueError
        For an argument out of range.
    ArithmeticError
        If onsets cannot be isolated at an angle, or told apart between two.

    Notes
    -----
    Not seen is a branch with both its ends between two neighbouring angles: a closed curve, or one that comes in
    and leaves at `mu_max` or `fmax`. What grows without an onset has no curve (`FlutterOnsets`).
    """
    checks.instance("rig", rig, Rig)
    angles = checks.array("theta", theta, checks.theta_degrees)
    if angles.ndim != 1 or not len(angles) or np.any(np.diff(angles) <= 0.0):
        raise ValueError(f"theta of shape {angles.shape}: it must be a list of ascending angles, each once")
    band = checks.band(fmax)
    most = checks.between("mu_max", mu_max, 1e-12, 1e6, "a coefficient of friction")
    plane = OnsetPlane(inclination(rig, band), most)
    curves = [_curve(plane, branch, band) for branch in branches(rig, angles, band, most)]
    curves.sort(key=lambda curve: curve.lowest[2])
    onsets = tuple(curve for curve in curves if curve.rises)
    recoveries = tuple(curve for curve in curves if not curve.rises)
    return OnsetCurves(onsets, recoveries, angles, *_table(angles, onsets), *_table(angles, recoveries))


def branches(rig: Rig, theta: Array, fmax: float, mu_max: float) -> list[Branch]:
    """Every branch through the onsets at ascending angles."""
    plane = OnsetPlane(inclination(rig, fmax), mu_max)
    known = [(float(angle), certified(rig, float(angle), fmax, plane)) for angle in theta]
    pieces: list[Branch] = []
    for (left, before), (right, after) in pairwise(known):
        waiting = [(left, right, before, after, 0)]
        while waiting:
            low, high, start, end, halvings = waiting.pop()
            arcs = _arcs(plane, low, high, start, end)
            if arcs is not None:
                pieces += [piece for arc in arcs for piece in _pieces(plane, arc)]
                continue
            if halvings == MOST_HALVINGS:
                raise ArithmeticError(
                    f"theta = {low:.9g}: onsets near it cannot be told apart with this rig; leave it out"
                )
            middle = 0.5 * (low + high)
            there = certified(rig, middle, fmax, plane)
            waiting += [(middle, high, there, end, halvings + 1), (low, middle, start, there, halvings + 1)]
    return _joined(pieces, [point for _, points in known for point in points])


def certified(rig: Rig, theta: float, fmax: float, plane: OnsetPlane) -> list[OnsetPoint]:
    """All onsets and recoveries at one angle, with the numbers of `flutter_onsets`."""
    found = flutter_onsets(rig, theta, fmax, plane.mu_max)
    mu = np.concatenate([found.mu, found.recovery_mu])
    omega = np.concatenate([found.frequency, found.recovery_frequency]) / fmax
    return [replace(plane.function(theta, w)[1], mu=m) for m, w in zip(mu.tolist(), omega.tolist(), strict=True)]


def _arcs(
    plane: OnsetPlane, left: float, right: float, before: list[OnsetPoint], after: list[OnsetPoint]
) -> list[list[OnsetPoint]] | None:
    """Arcs between two angles, one end of exactly one of them at each onset; none if they do not match."""
    waiting = {left: list(before), right: list(after)}
    arcs = []
    for edge, heading in ((left, 1.0), (right, -1.0)):
        while waiting[edge]:
            try:
                arc = plane.follow(waiting[edge].pop(0), heading, left, right)
            except ArithmeticError:
                return None
            last = arc[-1]
            if len(arc) > 1 and last.theta in waiting:
                there = waiting[last.theta]
                match = [point for point in there if abs(point.omega - last.omega) <= SAME * last.omega]
                if len(match) == 1:
                    there.remove(match[0])
                    arc[-1] = match[0]
                elif match or plane.excess(last) < -TIE:
                    return None
            arcs.append(arc)
    return arcs


def _pieces(plane: OnsetPlane, arc: list[OnsetPoint]) -> list[Branch]:
    """An arc cut at its folds, each piece ascending in theta."""
    ways = np.sign(np.diff([point.theta for point in arc]))
    folds = (np.flatnonzero(ways[1:] != ways[:-1]) + 1).tolist()
    pieces = []
    for begin, end in pairwise([0, *folds, len(arc) - 1]):
        ends = ["fold" if k in folds else _limit(plane, arc[k]) for k in (begin, end)]
        points = arc[begin : end + 1]
        if points[0].theta > points[-1].theta:
            points, ends = points[::-1], ends[::-1]
        if len(points) > 1:
            pieces.append(Branch(tuple(points), (ends[0], ends[1])))
    return pieces


def _limit(plane: OnsetPlane, point: OnsetPoint) -> str:
    """What ends an arc at a point, if anything does."""
    if plane.excess(point) < -TIE:
        return ""
    if point.mu >= (1.0 - TIE) * plane.mu_max:
        return "mu_max"
    return "fmax" if point.omega >= 1.0 - TIE else "mu_zero"


def _joined(pieces: list[Branch], known: list[OnsetPoint]) -> list[Branch]:
    """Pieces joined where one ends with the onset that another begins with; what is in none stands alone."""
    following = {id(piece.points[0]): piece for piece in pieces}
    ended = {id(piece.points[-1]) for piece in pieces}
    whole = []
    for first in pieces:
        if id(first.points[0]) in ended:
            continue
        points, last = list(first.points), first
        while id(last.points[-1]) in following:
            last = following[id(last.points[-1])]
            points += last.points[1:]
        whole.append(Branch(tuple(points), (first.ends[0] or "range", last.ends[1] or "range")))
    used = {id(point) for branch in whole for point in branch.points}
    return whole + [Branch((point,), ("range", "range")) for point in known if id(point) not in used]


def _curve(plane: OnsetPlane, branch: Branch, band: float) -> OnsetCurve:
    theta, mu, omega = np.array([(point.theta, point.mu, point.omega) for point in branch.points]).T
    low = int(np.argmin(mu))
    near = pairwise(branch.points[max(low - 1, 0) : low + 2])
    between = [point for p, q in near if (point := plane.stationary(p, q)) is not None]
    lowest = min([branch.points[low], *between], key=lambda point: point.mu)
    at = (float(lowest.theta), float(lowest.mu), float(band * lowest.omega))
    return OnsetCurve(theta.copy(), mu.copy(), band * omega, branch.rises, branch.ends, at)


def _table(theta: Array, curves: tuple[OnsetCurve, ...]) -> tuple[Array, Array]:
    """Friction and frequency of each curve at the given angles, (theta, curve)."""
    mu, frequency = np.full((2, len(theta), len(curves)), np.nan)
    for k, curve in enumerate(curves):
        _, given, own = np.intersect1d(theta, curve.theta, return_indices=True)
        mu[given, k], frequency[given, k] = curve.mu[own], curve.frequency[own]
    return mu, frequency
