"""Limit cycles over a parameter: pseudo-arclength continuation through folds and grazing bifurcations.

A point consists of all z_i and p, scaled by the size of the motion and the range of the parameter. A predictor
step along the tangent is corrected perpendicular to it (H. B. Keller, in Applications of Bifurcation Theory, 1977,
359-384). The motion grazes if a margin vanishes within a status, or if the duration of a status vanishes. There
the sequence of statuses changes, and the branch continues with the new sequence, in the same direction or back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fivcore import checks
from fivcore.beams.modes import one_blas_thread
from fivcore.cycles import guesses, shooting
from fivcore.cycles.flow import PLANE, Flow, Segment
from fivcore.cycles.limit_cycle import STATUSES, LimitCycle, closed, flow_of, made, violation
from fivcore.errors import InputError, SceneError, UnsolvedError
from fivcore.jit import Array
from fivcore.rig import BEAM_PARAMETERS, PAPER, RIG_PARAMETERS, Rig, Scene
from fivcore.transient.statistics import SEPARATION, SLIP, STICK

# First, least and largest step and iterations of the corrector; relative change of a parameter for a derivative.
FIRST, LEAST, LARGEST, ITERATIONS, CHANGE = 0.01, 1e-6, 0.1, 10, 1e-6
# Largest negative duration of a vanishing status, in units of the flow's grid.
BACKWARDS = 40.0
# Largest change of amplitude at a new sequence of statuses; distance before a graze from which it is sought.
NEAR, NEAREST = 0.2, 1e-4


class Place(NamedTuple):
    """A point where a branch folds, grazes or starts: the parameter, and what happens."""

    value: float
    text: str


@dataclass(frozen=True, eq=False)
class CycleBranch:
    """Limit cycles along a parameter: `values`, `cycles`, special `places`, and the reason of the `end`."""

    parameter: str
    values: Array
    cycles: list[LimitCycle]
    places: list[Place]
    end: str


class _Point(NamedTuple):
    """A cycle, its parameter, its linearised equations, and the unit tangent in all starts and in the first."""

    cycle: LimitCycle
    value: float
    linear: shooting.Linear
    tangent: Array
    start: Array


class _Follower:
    """Predictor and corrector for one parameter."""

    def __init__(self, name: str, span: float) -> None:
        self.name, self.span = name, span

    def flow(self, scene: Scene, value: float, like: Flow) -> tuple[Scene, Flow]:
        """The scene and its flow at a value of the parameter."""
        there = with_value(scene, self.name, value)
        return there, flow_of(there, like.options, like)

    def linear(self, scene: Scene, flow: Flow, value: float, segments: list[Segment], plane: Array) -> Any:
        """Linearised equations with the derivative by the parameter, in units of its range."""
        change = CHANGE * max(abs(value), 1e-3 * self.span)
        try:
            _, beside = self.flow(scene, value + change, flow)
        except InputError:
            # At a limit of the allowed range.
            change = -change
            _, beside = self.flow(scene, value + change, flow)
        return shooting.linearised(flow, segments, plane, beside, change / self.span)

    def point(self, cycle: LimitCycle, value: float, old: Array) -> _Point:
        """A point with its tangent, oriented like an earlier one."""
        linear = self.linear(cycle.scene, cycle.flow, value, cycle.segments, cycle.plane)
        return self.made(cycle, value, linear, old)

    def made(self, cycle: LimitCycle, value: float, linear: shooting.Linear, old: Array) -> _Point:
        """A point from linearised equations."""
        start, change = bordered(linear, old, 1.0, closing=False)
        z, pairs = np.append(start, 0.0), zip(linear.maps[:-1], linear.offsets, strict=False)
        found = np.append(np.concatenate([M @ z + d[:, 1] * change for M, d in pairs]) / linear.size, change)
        return _Point(cycle, value, linear, found / np.linalg.norm(found), start / np.linalg.norm(found))

    def step(self, point: _Point, length: float) -> tuple[_Point, int] | None:
        """The point after a step along the tangent, and how many iterations it took; None without convergence."""
        try:
            return self._corrected(point, length)
        except (InputError, SceneError, UnsolvedError):
            # Outside the allowed range of a scene, or singular.
            return None

    def _corrected(self, point: _Point, length: float) -> tuple[_Point, int] | None:
        cycle, change = point.cycle, length * point.tangent[-1]
        segments = shooting.moved(cycle.segments, point.linear, length * point.start, change, np.inf)
        if min(each.time for each in segments) < -BACKWARDS * cycle.flow.grid:
            return None
        value, begun = point.value + self.span * change, stacked(cycle.segments)
        for iteration in range(ITERATIONS):
            scene, flow = self.flow(cycle.scene, value, cycle.flow)
            linear = self.linear(scene, flow, value, segments, cycle.plane)
            if not linear.residual < 1e3:
                return None
            gone = np.append((stacked(segments) - begun) / linear.size, (value - point.value) / self.span)
            # Reject a jump to another branch.
            near = float(np.linalg.norm(gone)) < 2.0 * abs(length)
            if linear.residual < shooting.CLOSED:
                there = made(scene, flow, segments, linear, shooting.plane_at(flow, segments[0]))
                return (self.made(there, value, linear, point.tangent), iteration) if near else None
            start, change = bordered(linear, point.tangent, length - float(point.tangent @ gone))
            segments = shooting.moved(segments, linear, start, change, np.inf)
            value += self.span * change
            # Backwards in time, decaying motions grow without bound.
            if min(each.time for each in segments) < -BACKWARDS * cycle.flow.grid:
                return None
        return None

    def located(self, point: _Point, length: float, measure: Callable[[_Point], float]) -> _Point:
        """The point, within a step, at which a measure vanishes: regula falsi (Illinois) or bisection."""
        low, below, high, above, found = 0.0, measure(point), length, np.nan, point
        least = abs(below)
        for _ in range(40):
            share = below / (below - above) if np.isfinite(above) else 0.5
            middle = low + (high - low) * float(np.clip(share, 0.02, 0.98))
            taken = self.step(point, middle)
            value = np.nan if taken is None else measure(taken[0])
            if taken is not None and abs(value) < least:
                found, least = taken[0], abs(value)
            if least < 1e-10 or abs(high - low) < 1e-9 * abs(length):
                break
            if np.isfinite(value) and (value > 0.0) == (below > 0.0):
                low, below, above = middle, value, 0.5 * above
            else:
                high, above, below = middle, value, 0.5 * below
        return found


def sense(cycle: LimitCycle, way: float) -> Array:
    """A tangent of the parameter alone."""
    return np.append(0.0 * stacked(cycle.segments), np.sign(way))


def stacked(segments: list[Segment]) -> Array:
    """The starts of all segments in a row."""
    return np.concatenate([each.start for each in segments])


def bordered(linear: shooting.Linear, tangent: Array, along: float, closing: bool = True) -> tuple[Array, float]:
    """dz_0 and dp by which the linearised equations go `along` a tangent, and where `closing` close the cycle."""
    size, parts = len(linear.monodromy), tangent[:-1].reshape(len(linear.maps) - 1, -1) / linear.size
    row = sum(part @ M for part, M in zip(parts, linear.maps, strict=False))
    missed, by_p = sum(part @ d for part, d in zip(parts, linear.offsets, strict=False))
    matrix, right = np.zeros((size + 1, size + 1)), np.zeros(size + 1)
    matrix[:-1, :-1], matrix[-1, :-1] = np.eye(size) - linear.monodromy, row[:-1]
    matrix[:-1, -1], matrix[-1, -1] = -linear.offsets[-1][:-1, 1], tangent[-1] + by_p
    if closing:
        right[:-1], right[-1] = linear.offsets[-1][:-1, 0], -missed
    right[-1] += along
    scale = np.append(np.full(size, linear.size), 1.0)
    try:
        found = scale * np.linalg.solve(matrix * scale, right)
    except np.linalg.LinAlgError:
        raise UnsolvedError("follow_cycle: more than one branch passes through a cycle; begin elsewhere") from None
    return found[:-1], float(found[-1])


def numbers_of(scene: Scene) -> dict[str, float]:
    """Parameters of a scene, its friction and its rig over which a cycle can be followed, by name."""
    rig = scene.rig
    found = {name: getattr(scene, name) for name in ("V", "theta", "mu", "F")}
    found |= {name: getattr(scene.friction, name) for name in ("kinetic_ratio", "decay_speed")}
    if isinstance(rig, Rig):
        found |= {name: getattr(rig, name) for name in RIG_PARAMETERS}
        found |= {
            f"{beam}_{name}": getattr(getattr(rig, beam), name) for beam in PAPER for name in BEAM_PARAMETERS
        }
    return {name: value for name, value in found.items() if isinstance(value, float)}


def with_value(scene: Scene, name: str, value: float) -> Scene:
    """The scene with another value of one of `numbers_of`."""
    change: Any = {name: value}
    if hasattr(scene, name):
        return replace(scene, **change)
    if hasattr(scene.friction, name):
        return replace(scene, friction=replace(scene.friction, **change))
    return replace(scene, rig=Rig.of(**vars(scene.rig) | change))


# Newton's method may overflow from a poor guess.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
@one_blas_thread()
def follow_cycle(cycle: LimitCycle, parameter: str, until: float, *, most: int = 200) -> CycleBranch:
    """Follow a limit cycle over a parameter, through folds, until it passes a value or returns beyond its start.

    Parameters
    ----------
    cycle : LimitCycle
    parameter : str
        V, theta, mu, F, kinetic_ratio, decay_speed, or a number of the rig as on the command line.
    until : float
        The branch ends at this value, or at the same distance on the other side of its start.
    most : int
        Most points.

    Returns
    -------
    CycleBranch

    Raises
    ------
    ValueError
        For an unknown parameter, or if the value is that of the start.
    """
    numbers = numbers_of(cycle.scene)
    checks.choice("parameter", parameter, tuple(numbers))
    start = numbers[parameter]
    span = abs(checks.number("until", until, "another value than the start's", lambda x: x != start) - start)
    way = _Follower(parameter, span)
    points, places, length, end = [way.point(cycle, start, sense(cycle, until - start))], list[Place](), FIRST, ""
    while len(points) < most and not end:
        point = points[-1]
        if (taken := way.step(point, length)) is None:
            length *= 0.5
            end = f"no convergence beyond {parameter} = {point.value:.9g}" if length < LEAST else ""
            continue
        (after, iterations), gone = taken, length
        length = min(length * (1.5 if iterations <= 3 else 0.7 if iterations > 5 else 1.0), LARGEST)
        flips = len(after.cycle.segments) == 1 and after.cycle.plane[:-1] @ point.cycle.plane[:-1] < 0.0
        if flips:
            # Beyond zero amplitude the same cycle follows, half a period later.
            places.append(Place(born([*points, after]), "birth from steady sliding"))
            end = f"{places[-1].text} at {parameter} = {places[-1].value:.9g}"
            break
        if violation(after.cycle) is not None:
            place, changed = passed(way, point, after, gone)
            if changed is None and gone > NEAREST:
                # Closer to the graze the new sequence differs less from the old one.
                length = 0.25 * gone
                continue
            places.append(place)
            if changed is None:
                end = f"{place.text} at {parameter} = {place.value:.9g}, and no cycle with another order is found"
                break
            after, length = changed, FIRST
            if changed.tangent[-1] * point.tangent[-1] < 0.0:
                places.append(Place(place.value, "fold"))
        elif after.tangent[-1] * point.tangent[-1] < 0.0:
            fold = way.located(point, gone, lambda one: float(one.tangent[-1]))
            places.append(Place(fold.value, "fold"))
        points.append(after)
        if abs(after.value - start) >= span:
            end = f"{parameter} = {after.value:.6g}"
    values, cycles = np.array([each.value for each in points]), [each.cycle for each in points]
    return CycleBranch(parameter, values, cycles, places, end or f"{most} points")


def passed(way: _Follower, before: _Point, beyond: _Point, length: float) -> tuple[Place, _Point | None]:
    """The graze within a step, its description, and a point of the branch beyond it."""
    i, k, _ = violation(beyond.cycle) or (0, 0, 0.0)
    each, old = beyond.cycle.segments[i], beyond.cycle.segments
    name = STATUSES[min(each.status, SLIP)]
    if each.time <= 0.0:
        text = f"{name} vanishes"
        place = way.located(before, length, lambda p: p.cycle.segments[i].time / p.cycle.period)
    else:
        new = {SEPARATION: "contact", STICK: "slip"}.get(each.status, "stick")
        text = f"{'separation' if each.status != SEPARATION and k == 0 else new} begins within {name}"
        place = way.located(before, length, lambda p: inner_margin(p.cycle.flow, p.cycle.segments[i], k))
    changed = reordered(way, before, beyond, place.value)
    if changed is not None and len(changed.cycle.segments) < len(old):
        # The duration of a vanishing status has no derivative by the parameter; the margin beyond it has one.
        lengths = [-LEAST * 4.0**k for k in range(9)]
        back = [x for x in lengths if (at := way.step(changed, x)) and least_inner(at[0]) < 0.0]
        place = way.located(changed, back[0], least_inner) if back else place
        shortest = min(old, key=lambda one: one.time)
        text = f"{STATUSES[min(shortest.status, SLIP)]} vanishes"
    return Place(place.value, text), changed


def born(points: list[_Point]) -> float:
    """The parameter at zero amplitude, if it is an even function of the amplitude."""
    near = points[-5:]
    sizes = np.array([float(np.ptp(each.cycle.velocity_B)) for each in near])
    return float(np.polynomial.Polynomial.fit(sizes**2, [each.value for each in near], 3)(0.0))


def least_inner(point: _Point) -> float:
    """Smallest inner margin of a cycle."""
    flow, counts = point.cycle.flow, {SEPARATION: 1, STICK: 3}
    return min(inner_margin(flow, s, k) for s in point.cycle.segments for k in range(counts.get(s.status, 2)))


def inner_margin(flow: Flow, segment: Segment, k: int) -> float:
    """Smallest local minimum of a margin within a segment, by parabolas; without one, its value at an end."""
    times, z = flow.samples(segment.status, segment.start, segment.time)
    if segment.event == PLANE:
        z = np.column_stack([z, z[:, 1:]])
    y = flow.along(segment.status, z)[k]
    found, size = minima(y), float(np.abs(y).max())
    if not len(found):
        return min(y[1], y[-2]) / size
    i = found[np.argmin(y[found])]
    fine = flow.along(segment.status, flow.samples(segment.status, z[:, i - 1], 2.0 * times[1])[1])[k]
    if not len(j := minima(fine)):
        return float(y[i]) / size
    rise, bend = 0.5 * (fine[j + 1] - fine[j - 1]), fine[j + 1] - 2.0 * fine[j] + fine[j - 1]
    return float((fine[j] - 0.5 * rise**2 / bend).min()) / size


def minima(y: Array) -> Any:
    """Indices of local minima within a row."""
    return np.flatnonzero((y[1:-1] < y[:-2]) & (y[1:-1] <= y[2:])) + 1


def reordered(way: _Follower, before: _Point, beyond: _Point, place: float) -> _Point | None:
    """A point with the sequence of statuses beyond a graze, on that side of the graze or back."""
    cycle, old = beyond.cycle, [each[:2] for each in before.cycle.segments]
    turned = [old[j:] + old[:j] for j in range(len(old))]
    for value in (beyond.value, 2.0 * beyond.value - before.value, before.value):
        for guess in (traced, shortened):
            try:
                scene, flow = way.flow(cycle.scene, value, cycle.flow)
                other = closed(scene, flow, guess(cycle)[:1])
                near = abs(np.ptp(other.velocity_B) / np.ptp(cycle.velocity_B) - 1.0) < NEAR
                if near and [each[:2] for each in other.segments] not in turned:
                    return way.point(other, value, sense(other, value - place or beyond.value - before.value))
            except (UnsolvedError, InputError):
                continue
    return None


def traced(cycle: LimitCycle) -> list[guesses.Guess]:
    """The sequence of statuses of the motion from the start of the longest one of a cycle."""
    longest = max(cycle.segments, key=lambda each: each.time)
    return guesses.recurrent(cycle.flow, longest.status, longest.start, about=cycle.period)


def shortened(cycle: LimitCycle) -> list[guesses.Guess]:
    """A cycle without its shortest status."""
    gone = min(range(len(cycle.segments)), key=lambda i: cycle.segments[i].time)
    parts = [*cycle.segments[gone + 1 :], *cycle.segments[:gone]]
    if len(parts) > 1 and parts[0].status == parts[-1].status:
        parts = [parts[0]._replace(start=parts[-1].start, time=parts[0].time + parts[-1].time), *parts[1:-1]]
    parts = parts if len(parts) > 1 else [parts[0]._replace(event=PLANE)]
    return [(parts, shooting.plane_at(cycle.flow, parts[0]))]
