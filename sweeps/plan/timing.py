"""Timing a few points of a plan, where somebody asks for it; what they give is thrown away."""

from __future__ import annotations

import math

import numpy as np

from sweeps.plan.plan import PlanData

# Batches of so many points, from these places of the work, while so long is not over, s.
SIZES, SECONDS = (1, 1, 8, 8, 8, 8, 8, 8), 0.15
PLACES = (0.0, 0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875)


def timed(plan: PlanData) -> float:
    """The estimated time of a plan on one core, s, as a few points tell it; NaN if all of them fail.

    The first batch pays for compilation and caches and tells nothing, unless it is all there is to do.
    """
    seconds, spent = math.nan if plan.todo else 0.0, 0.0
    due = np.flatnonzero(plan.due)
    # Spread over the work: costs may differ from end to end.
    for number, (size, place) in enumerate(zip(SIZES, PLACES, strict=True)):
        points = due[int(place * plan.todo) :][: size * plan.sweep.batch_multiple]
        if not len(points) or spent > SECONDS:
            break
        result = plan.task.compute(plan.manifest.grid.points(points))
        taken = float(result.wall_time.sum())
        spent += taken if number else 0.0
        if (number or plan.todo == 1) and len(result.failures) < len(result):
            # The last batch is the largest, and tells most of what batches cost.
            seconds = taken / len(points) * plan.todo
    return seconds
