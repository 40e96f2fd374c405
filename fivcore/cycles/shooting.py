"""Multiple shooting from event to event by Newton's method, and the tangent along a parameter.

The unknowns are the initial states z_i of the statuses of a cycle and their durations T_i. Each status ends at its
event, where the next one starts. The event condition gives dT_i, so that the linearised equations are
dz_(i+1) = M_i dz_i + d_i, and around the cycle (1 - M) dz_0 = d with M = M_k ... M_1. M is the derivative of the
return map at the first event. Its eigenvalues are the Floquet multipliers, except that the trivial one, 1, is
replaced by 0 (R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, ch. 7).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fivcore.beams.modes import one_blas_thread
from fivcore.cycles.flow import Flow, Segment
from fivcore.errors import SceneError
from fivcore.jit import Array

# Largest residual relative to the motion, and most iterations.
CLOSED, ITERATIONS = 1e-10, 25
# Largest difference between equal durations, relative to the period.
SAME = 1e-7


@dataclass(frozen=True, eq=False)
class Linear:
    """Linearised equations of a cycle: of each segment dz = maps dz_0 + offsets, dT = times dz_0 + delays.

    With the flow of a neighbouring parameter, offsets and delays have a second column, the derivative by it.
    """

    maps: list[Array]
    offsets: list[Array]
    times: list[Array]
    delays: list[Array]
    # Size of the motion, and largest residual in units of it.
    size: float
    residual: float

    @property
    def monodromy(self) -> Array:
        """M, (m, m)."""
        return self.maps[-1][:-1, :-1]


def plane_at(flow: Flow, segment: Segment) -> Array:
    """The plane through the start of a segment, perpendicular to the motion, (m + 1,)."""
    row = flow.field(segment.status, segment.start) @ segment.start
    row /= np.linalg.norm(row)
    row[-1] = -(row[:-1] @ segment.start[:-1])
    return row


@one_blas_thread()
def linearised(
    flow: Flow, segments: list[Segment], plane: Array, beside: Flow | None = None, change: float = 1.0
) -> Linear:
    """Linearise the equations of a cycle; `beside` is the flow with the parameter increased by `change`."""
    size, worst = len(segments[0].start), 0.0
    scale = max(flow.size(each.start) for each in segments)
    maps, offsets, times, delays = [np.eye(size)], [np.zeros((size, 1 + (beside is not None)))], [], []
    for each, after in zip(segments, segments[1:] + segments[:1], strict=True):
        end, tangent = flow.over(each.status, each.start, each.time)
        row, rate = flow.margin(each.status, each.event, end, plane), flow.field(each.status, end) @ end
        value, slope, E = float(row @ end), float(row @ rate), flow.entry(each.status, after.status, end)
        missed = E @ end - after.start
        worst = max(
            worst, float(np.linalg.norm(missed)) / scale, abs(value / slope) / sum(s.time for s in segments)
        )
        gaps, values = missed[:, None], np.array([value])
        if beside is not None:
            other = beside.over(each.status, each.start, each.time, tangent=False)[0]
            moves = (beside.entry(each.status, after.status, other) @ other - E @ end) / change
            gaps = np.column_stack([missed, moves])
            rises = beside.margin(each.status, each.event, other, plane) @ other - value
            values = np.append(value, rises / change)
        delay = -values / slope
        jump, offset = E @ (tangent - np.outer(rate, row @ tangent) / slope), gaps + np.outer(E @ rate, delay)
        times.append(-(row @ tangent) / slope @ maps[-1])
        delays.append(delay - (row @ tangent) / slope @ offsets[-1])
        maps, offsets = [*maps, jump @ maps[-1]], [*offsets, jump @ offsets[-1] + offset]
    finite = all(np.isfinite(each).all() for each in (maps[-1], offsets[-1], times[-1], delays[-1]))
    return Linear(maps, offsets, times, delays, scale, worst if finite else np.inf)


def moved(
    segments: list[Segment], linear: Linear, step: Array, more: float = 0.0, least: float = 0.5
) -> list[Segment]:
    """Segments after a step dz_0, (m,), and a parameter change; `least` limits the loss of each duration."""
    delta, column = np.append(step, 0.0), np.array([1.0, more][: linear.offsets[0].shape[1]])
    changes = [float(row @ delta + delay @ column) for row, delay in zip(linear.times, linear.delays, strict=True)]
    share = min([1.0, *(least * s.time / -c for s, c in zip(segments, changes, strict=True) if c < 0.0 < s.time)])
    share = share if np.isfinite(least) else 1.0
    return [
        each._replace(start=each.start + share * (M @ delta + d @ column), time=each.time + share * change)
        for each, M, d, change in zip(segments, linear.maps, linear.offsets, changes, strict=False)
    ]


def solve(flow: Flow, segments: list[Segment], plane: Array) -> tuple[list[Segment], Linear] | None:
    """Close a cycle by Newton's method; None where it does not converge."""
    best: tuple[list[Segment], Linear] | None = None
    for _ in range(ITERATIONS):
        try:
            linear = linearised(flow, segments, plane)
        except SceneError:
            # With falling friction, far from a motion.
            return best
        if best is not None and linear.residual > 0.1 * best[1].residual:
            # Rounding.
            return best if best[1].residual < linear.residual else (segments, linear)
        if linear.residual < CLOSED:
            best = segments, linear
        # Reject a cycle whose amplitude shrinks to zero.
        if not linear.residual < 1e6 or sum(each.time for each in segments) < flow.grid:
            return None
        step: Any = np.linalg.lstsq(
            np.eye(len(linear.monodromy)) - linear.monodromy, linear.offsets[-1][:-1, 0], 1e-14
        )[0]
        segments = moved(segments, linear, step)
    return best


def primitive(segments: list[Segment]) -> list[Segment]:
    """The shortest part whose repetition is the cycle."""
    times, orders = np.array([each.time for each in segments]), [each[:2] for each in segments]
    for n in range(1, len(segments)):
        apart = np.abs(times - np.roll(times, n)).max()
        if len(segments) % n == 0 and orders[n:] + orders[:n] == orders and apart < SAME * times.sum():
            return segments[:n]
    return segments
