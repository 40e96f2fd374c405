"""Timing a few points of a plan, where somebody asks for it; what they give is thrown away."""

from __future__ import annotations

import math
import time

import numpy as np

from sweeps.compute.local import one_blas_thread
from sweeps.plan.plan import PlanData

# So many points each, at these places of the work, while they are expected to take less than this, s.
SIZES, SECONDS = (1, 1, 8, 8, 8, 8, 8, 8), 0.15
PLACES = (0.0, 0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875)


def timed(plan: PlanData) -> float:
    """The time to expect for a plan on one core, s, as a few points tell it; NaN if all of them fail.

    The first batch pays for compilation and caches and tells nothing, unless it is all there is to do.
    """
    due, multiple = plan.due, plan.sweep.batch_multiple
    spent, seconds, totals = 0.0, math.nan, dict[int, tuple[float, int]]()
    # Spread over the work: costs may differ from end to end.
    for number, (base, share) in enumerate(zip(SIZES, PLACES, strict=True)):
        count = base if base == 1 else max(base, multiple)
        if not plan.todo or (number > 1 and not spent + seconds * count <= SECONDS):
            break
        begin = int(share * len(due))
        points = _next_due(due, begin, count)
        with one_blas_thread():
            start = time.perf_counter()
            result = plan.task.compute(plan.manifest.grid.points(points))
            taken = time.perf_counter() - start
        if (number or plan.todo == 1) and len(result.failures) < len(result):
            spent += taken
            before, rows = totals.get(count, (0.0, 0))
            totals[count] = (before + taken, rows + len(points))
            # Larger batches tell more of what a batch costs.
            seconds = totals[count][0] / totals[count][1]
            if count < multiple:
                # Until it is known better: in company they cost twice what one costs alone.
                seconds *= min(2.0 / multiple, 1.0)
    return seconds * plan.todo if plan.todo else 0.0


def _next_due(due: np.ndarray, begin: int, count: int) -> np.ndarray:
    """So many points that are due, from a place on, or before it where there are no more."""
    step, found = 1 << 18, np.zeros(0, dtype=np.intp)
    for start in (*range(begin, len(due), step), *range(0, begin, step)):
        found = np.concatenate([found, start + np.flatnonzero(due[start : start + step])])
        if len(found) >= count:
            break
    return np.unique(found[:count])
