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
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq, minimize_scalar

# A counterpart is clear if it is at most FAR away and no rival is nearer than twice as far.
FAR, CLEAR = 0.3, 0.5
# Shorter intervals (degrees) are not searched for an extreme.
NARROW = 1e-6


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
    # Why a branch ends here, if it does.
    end: str = ""


Pairs = list[tuple[Point, Point]]
Sample = tuple[float, list[Point]]
Sampler = Callable[[float], Sample]
# Pairs of points without a counterpart, on the left and on the right, with the ends of their branches at an angle.
Ending = Callable[[list[Point], list[Point], float], Pairs]


def follow(sampler: Sampler, samples: list[Sample], shortest: float, ending: Ending) -> list[list[Point]]:
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
        q = closest(p, [point for point in right if point.rises == p.rises])
        if q is None or closest(q, [point for point in left if point.rises == p.rises]) is not p:
            continue
        distance = abs(p.place - q.place)
        rivals = [point.place for point in left + right if point is not p and point is not q]
        rival = min((min(abs(place - p.place), abs(place - q.place)) for place in rivals), default=np.inf)
        clear = distance <= CLEAR * rival
        if distance <= FAR and (clear or not (p.outside and q.outside)):
            pairs.append((p, q))
            all_clear = all_clear and clear
    return pairs, all_clear


def closest(p: Point, points: list[Point]) -> Point | None:
    """The nearest to p of some points, if there are any."""
    return min(points, key=lambda point: abs(point.place - p.place), default=None)


def locate(sampler: Sampler, near: list[Point], theta: float) -> Point:
    """The point at `theta` of the branch that passes through some neighbours, ascending in theta."""
    place = np.interp(theta, [point.theta for point in near], [point.place for point in near])
    known = [point for point in near if point.theta == theta]
    points = known or [point for point in sampler(theta)[1] if point.rises == near[0].rises]
    if not points:
        raise ArithmeticError(f"theta = {theta:.9g}: a branch is lost between two angles at which it is known")
    return min(points, key=lambda point: abs(point.place - place))


def root(sampler: Sampler, p: Point, q: Point, function: Callable[[Point], float]) -> Point:
    """The point between neighbours where `function`, of opposite sign at them, is zero."""
    theta = brentq(lambda x: function(locate(sampler, [p, q], x)), p.theta, q.theta, xtol=1e-14)
    return locate(sampler, [p, q], theta)


def extreme(sampler: Sampler, near: list[Point], sign: float) -> Point:
    """Where the level is largest (`sign` = 1) or least (-1) between the first and the last of neighbours."""
    best, ends = max(near, key=lambda point: sign * point.level), (near[0].theta, near[-1].theta)
    if ends[1] - ends[0] < NARROW:
        return best
    found = minimize_scalar(
        lambda x: -sign * locate(sampler, near, x).level, bounds=ends, method="bounded", options={"xatol": 1e-8}
    )
    return max(best, locate(sampler, near, float(found.x)), key=lambda point: sign * point.level)
