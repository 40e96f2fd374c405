"""Points known at single angles, linked to branches over the inclination.

A sample holds every point at its angle: all flutter onsets, or all growing modes. Two neighbouring samples are
linked where each point has one clear counterpart in the other. Where one has none, the interval between them is
halved until all have, or until it is so short that a point is said to end in it. Roots and extremes along a branch
are found by bracketing (Brent, Algorithms for Minimization without Derivatives, 1973), with a sample at every
angle tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

# A counterpart is clear if it is at most FAR away and no rival is nearer than twice as far.
FAR, CLEAR = 0.3, 0.5
# Shorter intervals (degrees) are not searched for an extreme.
NARROW = 1e-6


@dataclass(frozen=True, eq=False)
class Point:
    """An onset, a recovery or a growing mode at one angle.

    Attributes
    ----------
    theta, level, frequency : float
        Degrees; friction of an onset or growth rate (1/s) of a mode; Hz.
    place : complex
        Coordinates in which the distance of points is measured.
    rises : bool
        False for a recovery; only points of one kind are linked.
    outside : bool
        Beyond the limits of interest, where a branch may end for no known reason.
    end : str
        Why a branch ends here, if it does.
    """

    theta: float
    level: float
    frequency: float
    place: complex
    rises: bool = True
    outside: bool = False
    end: str = ""


Pairs = list[tuple[Point, Point]]
Sample = tuple[float, list[Point]]
Sampler = Callable[[float], Sample]
# Pairs of points without a counterpart, on the left and on the right, with the ends of their branches at an angle.
Ending = Callable[[list[Point], list[Point], float], Pairs]


def link(sampler: Sampler, left: Sample, right: Sample, shortest: float, ending: Ending) -> Pairs:
    """Pairs of neighbours on each branch between two samples, from intervals down to `shortest` degrees."""
    pairs, clear = _counterparts(left[1], right[1])
    middle = 0.5 * (left[0] + right[0])
    if not clear and right[0] - left[0] > shortest:
        between = sampler(middle)
        return link(sampler, left, between, shortest, ending) + link(sampler, between, right, shortest, ending)
    linked = {id(point) for pair in pairs for point in pair}
    before, after = ([point for point in points if id(point) not in linked] for _, points in (left, right))
    return pairs + ending(before, after, middle)


def _counterparts(left: list[Point], right: list[Point]) -> tuple[Pairs, bool]:
    """Pairs of mutually nearest points, and whether all are clear and no point inside the limits is left out."""
    n, points = len(left), left + right
    place, kind = np.array([each.place for each in points]), np.array([each.rises for each in points])
    apart = np.abs(place[:, None] - place)
    np.fill_diagonal(apart, np.inf)
    across = np.where(kind[:n, None] == kind[n:], apart[:n, n:], np.inf)
    pairs: Pairs = []
    free, clear = [each.outside for each in points], True
    for i in range(n if across.size else 0):
        j = int(np.argmin(across[i]))
        if across[i, j] > FAR or np.argmin(across[:, j]) != i:
            continue
        rivals = np.delete(apart[[i, n + j]], [i, n + j], axis=1)
        sure = bool(across[i, j] <= CLEAR * rivals.min(initial=np.inf))
        if sure or not (free[i] and free[n + j]):
            pairs.append((points[i], points[n + j]))
            free[i] = free[n + j] = True
            clear = clear and sure
    return pairs, clear and all(free)


def chains(pairs: Pairs) -> list[list[Point]]:
    """Points joined along their pairs, each chain ascending in theta."""
    following = {id(first): second for first, second in pairs}
    followers = {id(second) for _, second in pairs}
    found = [[first] for first, _ in pairs if id(first) not in followers]
    for chain in found:
        while id(chain[-1]) in following:
            chain.append(following[id(chain[-1])])
    return found


def locate(sampler: Sampler, p: Point, q: Point, theta: float) -> Point:
    """The point at `theta` of the branch that passes through the neighbours p and q."""
    for known in (p, q):
        if theta == known.theta:
            return known
    place = p.place + (theta - p.theta) / (q.theta - p.theta) * (q.place - p.place)
    points = [each for each in sampler(theta)[1] if each.rises == p.rises]
    if not points:
        raise ArithmeticError(f"theta = {theta:.9g}: a branch is lost between two angles at which it is known")
    return min(points, key=lambda each: abs(each.place - place))


def root(sampler: Sampler, p: Point, q: Point, function: Callable[[Point], float]) -> Point:
    """The point between neighbours where `function`, of opposite sign at them, is zero."""
    theta = brentq(lambda at: function(locate(sampler, p, q, at)), p.theta, q.theta, xtol=1e-14)
    return locate(sampler, p, q, theta)


def extreme(sampler: Sampler, near: list[Point], sign: float) -> Point:
    """Where the level is largest (`sign` = 1) or least (-1) between the first and the last of neighbours."""

    def at(theta: float) -> Point:
        k = min(int(np.searchsorted([each.theta for each in near[1:]], theta)), len(near) - 2)
        return locate(sampler, near[k], near[k + 1], theta)

    best, ends = max(near, key=lambda each: sign * each.level), (near[0].theta, near[-1].theta)
    if ends[1] - ends[0] < NARROW:
        return best
    found = minimize_scalar(lambda x: -sign * at(x).level, bounds=ends, method="bounded", options={"xatol": 1e-8})
    return max(best, at(float(found.x)), key=lambda each: sign * each.level)
