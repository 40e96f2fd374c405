"""Points known at single angles, linked to branches over the inclination.

A sample holds every point there is at its angle: flutter onsets, or growing modes. Two neighbouring samples are
linked where each point has one clear counterpart in the other. Where one has none, the interval is halved until all
have, or until it is so short that the point can be said to end in it. Roots and extremes along a branch are then
found by bracketing methods (Brent 1973, chapters 4 and 5), which sample at every angle they try.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

# A counterpart is clear if it is at most FAR away and its nearest rival at least twice as far.
FAR, CLEAR = 0.3, 0.5


@dataclass(frozen=True, eq=False)
class Point:
    """An onset, a recovery or a growing mode at one angle.

    Attributes
    ----------
    theta, level, frequency : float
        Degrees; friction of an onset, growth rate (1/s) of a mode; Hz.
    place : complex
        Where it lies among the points of its sample; neighbours on a branch are close.
    rises : bool
        False for a recovery; only points of one kind are linked.
    may_end : bool
        Whether a branch may end here without a reason being looked for.
    end : str
        Why a branch ends here, if it does.
    """

    theta: float
    level: float
    frequency: float
    place: complex
    rises: bool = True
    may_end: bool = False
    end: str = ""


@dataclass(frozen=True, eq=False)
class Sample:
    """All points at one angle (degrees)."""

    theta: float
    points: list[Point]


@dataclass(frozen=True, eq=False)
class Interval:
    """Two neighbouring samples and the pairs of points linked between them."""

    left: Sample
    right: Sample
    pairs: list[tuple[Point, Point]]

    def ended(self) -> tuple[list[Point], list[Point]]:
        """Points on the left and on the right without a counterpart."""
        linked = {id(point) for pair in self.pairs for point in pair}
        left, right = (
            [each for each in side.points if id(each) not in linked] for side in (self.left, self.right)
        )
        return left, right


Sampler = Callable[[float], Sample]


def link(sampler: Sampler, left: Sample, right: Sample, shortest: float) -> list[Interval]:
    """Link two samples, halving the interval between them where that is ambiguous, down to `shortest` degrees."""
    pairs, clear = _counterparts(left, right)
    if clear or right.theta - left.theta <= shortest:
        return [Interval(left, right, pairs)]
    middle = sampler(0.5 * (left.theta + right.theta))
    return link(sampler, left, middle, shortest) + link(sampler, middle, right, shortest)


def _counterparts(left: Sample, right: Sample) -> tuple[list[tuple[Point, Point]], bool]:
    """Pairs of mutually nearest points, and whether they are clear and leave out only points that may end."""
    points = [*left.points, *right.points]
    place, kind = np.array([each.place for each in points]), np.array([each.rises for each in points])
    apart = np.abs(place[:, None] - place)
    np.fill_diagonal(apart, np.inf)
    n = len(left.points)
    across = np.where(kind[:n, None] == kind[n:], apart[:n, n:], np.inf)
    pairs, free, clear = [], [each.may_end for each in points], True
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


def chains(intervals: list[Interval], ends: list[tuple[Point, Point]]) -> list[list[Point]]:
    """Points joined along the pairs of all intervals and along `ends`, each chain ascending in theta."""
    pairs = [*ends, *(pair for each in intervals for pair in each.pairs)]
    points = [point for each in intervals for side in (each.left, each.right) for point in side.points]
    points += [point for pair in ends for point in pair]
    following = {id(first): second for first, second in pairs}
    followers = {id(second) for _, second in pairs}
    found = []
    for point in {id(each): each for each in points}.values():
        if id(point) not in followers:
            chain = [point]
            while id(chain[-1]) in following:
                chain.append(following[id(chain[-1])])
            found.append(chain)
    return found


def nearest(points: list[Point], place: complex, *, rises: bool) -> Point:
    """The point of one kind that lies nearest to a place."""
    same = [each for each in points if each.rises == rises]
    if not same:
        raise ArithmeticError("a branch is lost between two angles at which it is known")
    return min(same, key=lambda each: abs(each.place - place))


def locate(sampler: Sampler, p: Point, q: Point, theta: float) -> Point:
    """The point at `theta` of the branch that passes through the neighbours p and q."""
    for known in (p, q):
        if theta == known.theta:
            return known
    place = p.place + (theta - p.theta) / (q.theta - p.theta) * (q.place - p.place)
    return nearest(sampler(theta).points, place, rises=p.rises)


def root(sampler: Sampler, p: Point, q: Point, function: Callable[[Point], float]) -> Point:
    """The point between neighbours where `function`, of opposite sign at them, is zero."""
    theta = brentq(lambda at: function(locate(sampler, p, q, at)), p.theta, q.theta, xtol=1e-14)
    return locate(sampler, p, q, theta)


def extreme(sampler: Sampler, near: list[Point], sign: float) -> Point:
    """The point with the least level (`sign` = 1) or the largest (-1) between the first and the last of neighbours."""

    def at(theta: float) -> Point:
        k = min(int(np.searchsorted([each.theta for each in near[1:]], theta)), len(near) - 2)
        return locate(sampler, near[k], near[k + 1], theta)

    best = min(near, key=lambda each: sign * each.level)
    if near[-1].theta - near[0].theta < 1e-6:
        return best
    found = minimize_scalar(
        lambda theta: sign * at(theta).level,
        bounds=(near[0].theta, near[-1].theta),
        method="bounded",
        options={"xatol": 1e-8},
    )
    return min([best, at(float(found.x))], key=lambda each: sign * each.level)
