"""Data that the methods pass to the observers: counters of a run, and segments of samples, rows and long sticks.

Counters are fields of the record of each method. Kernels call `count_step` in every step and `enter` when the
contact state changes; the motion never depends on a counter. Times are in seconds since the drive started, weights
are durations.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fivcore.jit import Array, contracted, inlined

# Contact states, as in a record's `state`; statistics start SETTLING after the first slip, s.
SEPARATION, STICK, SLIP = 0, 1, 2
SETTLING = 0.1
# Times, NaN if there is none: first slip, first separation, start of the present stick (none before first slip)
# and of the last long one, start of the statistics, its delay after the first slip (NaN: the start is given), and
# shortest duration of a long stick.
EVENTS = ("first_slip", "first_separation", "stick_start", "last_stick", "settled_from", "settling", "least_stick")
# After settling: integral and maximum of N, maximum of |slip rate|, contact transitions, time in each state ...
SETTLED = ("sum_N", "max_N", "max_slip", "switches", "separation_time", "stick_time", "slip_time")
# ... and from the start, the energy balance.
ENERGIES = ("work", "damped", "friction", "termination", "impact")
FIELDS = [(name, "f8") for name in (*EVENTS, *SETTLED, *ENERGIES)]
# Number of long sticks in the list, and the number that it has room for.
FIELDS += [(name, "i8") for name in ("sticks", "stick_room")]
# Columns of a sample: velocity of B, slip rate, N, and these counters after that step.
SAMPLED_COUNTERS = ("stick_time", "separation_time", "sum_N", "switches")
SAMPLE = 3 + len(SAMPLED_COUNTERS)
# Series and their columns in the rows, whose first column is the time.
SERIES = {"velocity_B": 1, "normal_force": 2, "tangential_force": 3, "slip_velocity": 4, "state": 5}
# With several contacts further columns hold these series contact by contact: the first one of all contacts, and so
# on.
CONTACT_SERIES = ("normal_force", "tangential_force", "slip_velocity", "state")


@dataclass
class Segment:
    """Results of a segment, normalised (F = 1).

    `samples`, (n, SAMPLE), were taken at the times `t`, (n,), and the last one counts `repeated` times more;
    `sticks`, (k, 2), are start and end of the long sticks that ended; `rows`, (m, 6), are recorded: time, velocity
    of B, N, T, slip rate and contact state.
    """

    t: Array
    samples: Array
    sticks: Array = field(default_factory=lambda: np.empty((0, 2)))
    rows: Array = field(default_factory=lambda: np.empty((0, 6)))
    repeated: int = 0


def count_in(first: int, last: int, every: int) -> int:
    """Number of multiples of `every` from step `first` up to step `last`, excluded; none if `every` is zero."""
    return max(-(-last // every) - (-(-first // every)), 0) if every else 0


def room_for_sticks(start: float, end: float, least: float, step: float) -> int:
    """Largest number of long sticks of at least `least` that end between two times, s."""
    return int((end - start) / max(least, step)) + 2


@inlined
def clear(run: Any) -> None:
    """Reset the counters of the time after settling."""
    run.sum_N, run.max_N, run.max_slip, run.switches = 0.0, 0.0, 0.0, 0.0
    run.separation_time, run.stick_time, run.slip_time = 0.0, 0.0, 0.0


@contracted
def count_step(run: Any, contact: int, N: float, speed: float, weight: float) -> None:
    """Count a step: contact state, normal force, and the relative speed of the two surfaces."""
    run.sum_N += weight * N
    run.max_N = max(run.max_N, N)
    run.max_slip = max(run.max_slip, speed)
    if contact == STICK:
        run.stick_time += weight
    elif contact == SLIP:
        run.slip_time += weight
    else:
        run.separation_time += weight


@inlined
def first_counted(settled_from: float, step: float, read_at: float) -> int:
    """First step of the statistics: it is sampled at the fraction `read_at`, and not before `settled_from`, s.

    A tie must not be rounded to the next step, because the sample of this step would contain uncleared counters.
    """
    return int(np.ceil(settled_from / step - read_at - 1e-6))


@inlined
def enter(run: Any, was: int, contact: int, t: float) -> bool:
    """Count a change of the contact state at time t; return whether the caller must list a long stick.

    Its row is `run.sticks - 1`, from `run.last_stick` to t. The array is not passed here, because that would count
    references at each call.
    """
    run.switches += 1.0
    listed = was == STICK and t - run.stick_start >= run.least_stick and run.sticks < run.stick_room
    if listed:
        run.last_stick = run.stick_start
        run.sticks += 1
    if was == STICK:
        run.stick_start = np.nan
    # The initial stick is not counted.
    if contact == STICK and run.first_slip <= t:
        run.stick_start = t
    elif contact == SLIP and not run.first_slip <= t:
        run.first_slip = t
        if run.settling >= 0.0:
            run.settled_from = t + run.settling
    elif contact == SEPARATION and not run.first_separation <= t:
        run.first_separation = t
    return listed


def begin(
    record: Any, settle: float | None, settling: float, least_stick: float, contact: int, time: float = 0.0
) -> Any:
    """Initialise the counters of a record (1,) for a run that starts at a time, s, in a contact state; return it.

    Without `settle` the statistics start with the run, and restart `settling` after the first slip.
    """
    for name in EVENTS:
        record[name] = np.nan
    for name in (*SETTLED, *ENERGIES):
        record[name] = 0.0
    record["settled_from"], record["settling"] = (time, settling) if settle is None else (settle, np.nan)
    record["least_stick"] = least_stick
    # `enter` counts changes only.
    if contact == SEPARATION:
        record["first_separation"] = time
    if contact == SLIP:
        record["first_slip"] = time
        if settle is None:
            record["settled_from"] = time + settling
    return record
