"""The end of a run whose slip is proved to last (`transient.fast.steady`): the rest is filled in."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any

import numpy as np

from fivcore.transient.fast import layout
from fivcore.transient.fast.onset import RAMP
from fivcore.transient.fast.steady import NEARLY_STEADY, SteadySliding, steady_sliding
from fivcore.transient.statistics import (
    SAMPLE,
    SAMPLED_COUNTERS,
    SETTLED,
    SLIP,
    Segment,
    count_in,
    first_counted,
)


def conclude(run: Any, phase: int, segment: Segment) -> None:
    """Fill in the rest of a run if nothing but steady sliding can follow; choose the next segment's length."""
    if phase != RAMP and not run.record["stopped"][0] and run.record["now"][0] < run.steps:
        steady = _settled(run, segment)
        if steady is not None:
            run.segments = chain([segment], _fill(run, steady))
    varies = _slip_variation(run, segment) >= run.scene.speed_per_load
    run.length = run.long if varies else run.short


def _slip_variation(run: Any, segment: Segment) -> float:
    """By how much the slip rate varied at the end of a segment; infinite where the contact does not slide."""
    # As many whatever the segment's length: a record cuts segments into several.
    recent = segment.samples[-layout.MAX_SKIP // 4 :, 1]
    slides = run.record["contact"][0] == SLIP and len(recent) > 1
    return float(np.ptp(recent)) if slides else np.inf


def _settled(run: Any, segment: Segment) -> SteadySliding | None:
    """Steady sliding, if nothing else can follow a segment; a proof is tried only where it looks so."""
    speed = run.scene.speed_per_load
    if not (run.may_settle and _slip_variation(run, segment) <= NEARLY_STEADY * speed):
        return None
    steady = steady_sliding(run.model, run.kinetic, run.step)
    run.may_settle = steady is not None and steady.decays
    state = run.values(layout.Q), run.values(layout.V), run.u
    return steady if steady is not None and steady.is_permanent(*state, speed) else None


def _fill(run: Any, steady: SteadySliding) -> Iterator[Segment]:
    """Fill in steady sliding to the end of the run: all its steps count the same."""
    speed, record, every, step = run.scene.speed_per_load, run.record, run.sample_every, run.step
    if run.options.until is not None:
        least = (float(record["settled_from"][0]) + run.options.until.least) / step
        run.pause = run.steps = min(max(int(np.ceil(least)), run.pause), run.steps)
    first, last = int(record["now"][0]), run.steps
    q, v, u = steady.start(speed)
    run.place(q, v)
    record["u_N"], record["u_T"] = u
    velocity, N, T, slip_rate, _ = row = steady.row(speed)
    sample = [velocity, slip_rate, N, *(float(record[name][0]) for name in SAMPLED_COUNTERS)]
    settled = int(np.clip(first_counted(record["settled_from"][0], step, 0.5), first, last))
    if settled > first:
        for name in SETTLED:
            record[name] = 0.0
    if last > settled:
        record["max_N"] = np.maximum(record["max_N"], N)
        record["max_slip"] = np.maximum(record["max_slip"], abs(slip_rate))
    record["sum_N"] += (last - settled) * step * N
    record["slip_time"] += (last - settled) * step
    record["work"] += (last - first) * step * T * speed
    record["friction"] -= (last - first) * step * T * slip_rate
    model = run.model
    middle = v + 0.5 * step * (model.normal * (N - 1.0) + model.tangential * T)
    record["damped"] += (last - first) * step * (model.damping @ middle**2)
    record["now"] = last
    begin, rows = -(-first // every), run.row_every
    count = -(-last // every) - begin
    for start in range(first, last, layout.MOST_ROWS * rows) if rows else ():
        end = min(start + layout.MOST_ROWS * rows, last)
        written = np.empty((count_in(start, end, rows), 6))
        written[:, 0] = (np.arange(-(-start // rows), -(-end // rows)) * rows + 0.5) * step
        written[:, 1:] = row
        yield Segment(np.zeros(0), np.empty((0, SAMPLE)), rows=written)
    if count > 0:
        t = np.array([(begin * every + 0.5) * step])
        yield Segment(t, np.array([sample]), repeated=count - 1)
