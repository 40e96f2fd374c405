"""Timing a few points of a plan, where somebody asks for it; what they give is thrown away."""

from __future__ import annotations

import math
import time

import numpy as np

from sweeps.plan.plan import PlanData

# Batches of so many points, from these places of the work, while so long is not over, s.
SIZES, SECONDS = (1, 1, 8, 8, 8, 8, 8, 8), 0.15
PLACES = (0.0, 0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875)


def timed(plan: PlanData) -> float:
    """The time to expect for a plan on one core, s, as a few points tell it; NaN if all of them fail.

    The first batch pays for compilation and caches and tells nothing, unless it is all there is to do.
    """
    seconds, begin = math.nan, time.perf_counter()
    # Spread over the work: costs may differ from end to end.
    for number, (size, place) in enumerate(zip(SIZES, PLACES, strict=True)):
        if number == 1:
            begin = time.perf_counter()
        if not plan.todo or (number > 1 and time.perf_counter() - begin > SECONDS):
            break
        points = _next_due(plan.due, int(place * len(plan.due)), size * plan.sweep.batch_multiple)
        result = plan.task.compute(plan.manifest.grid.points(points))
        if (number or plan.todo == 1) and len(result.failures) < len(result):
            # The last batch is the largest, and tells most of what batches cost.
            seconds = float(result.wall_time.mean())
    return seconds * plan.todo if plan.todo else 0.0


def _next_due(due: np.ndarray, begin: int, count: int) -> np.ndarray:
    """So many points that are due, from a place on, or before it where there are no more."""
    step, found = 1 << 18, np.zeros(0, dtype=np.intp)
    for start in (*range(begin, len(due), step), *range(0, begin, step)):
        found = np.concatenate([found, start + np.flatnonzero(due[start : start + step])])
        if len(found) >= count:
            break
    return np.unique(found[:count])
