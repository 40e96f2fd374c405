"""What every method counts while it runs: time in each contact state, forces, slip speeds, sticks.

A method calls `follow` once a step and, after settling, `measure`, and `spread` every few steps; memory is
fixed, whatever the duration.
Quantiles come from histograms whose bins are the leading bits of a number: 128 bins an octave, so a quantile
is known to 0.4 %. All times are in seconds since the drive started, all weights are durations.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.jit import Array, apart, inlined, kernel

# Contact states, as in a record's `state`.
SEPARATION, STICK, SLIP = 0, 1, 2

# Slots of `flags` (int64): the present state, and how many long sticks are in the list.
STATE, STICKS = 0, 1

# Slots of `moments` (float64), NaN where it has not happened or does not apply.
FIRST_SLIP, FIRST_SEPARATION, STICK_START, SETTLED_FROM, SETTLING, LEAST_STICK = 0, 1, 2, 3, 4, 5

# Slots of `sums` (float64): after settling ...
SUM_N, MAX_N, MAX_SLIP, SWITCHES = 0, 1, 2, 3
TIME_IN = 4  # and the two after it: time in each contact state
SETTLED_SUMS = 7
# ... and, from the start, the energy balance.
WORK, DAMPED, FRICTION, TERMINATION, IMPACT = 7, 8, 9, 10, 11

# Histogram bins: exponent and seven bits of the mantissa, from 2^-120 to 2^60. N = 1, the commonest value of all,
# lies in the middle of one: rounding does not decide where it counts.
_SHIFT, _MIDDLE = 45, 1 << 44
_LOWEST = (1023 - 120) << 7
BINS = 180 << 7


@dataclass
class Tally:
    """Counters of one run."""

    flags: NDArray[np.int64] = field(default_factory=lambda: apart(np.zeros(2, dtype=np.int64)))
    moments: Array = field(default_factory=lambda: apart(np.full(6, np.nan)))
    sums: Array = field(default_factory=lambda: apart(np.zeros(12)))
    forces: Array = field(default_factory=lambda: np.zeros(BINS))
    speeds: Array = field(default_factory=lambda: np.zeros(BINS))
    word: Array = field(default_factory=lambda: apart(np.zeros(1)))

    def start(self, state: int, settle: float | None, settling: float, least_stick: float | None) -> Tally:
        """Begin in a contact state.

        Without `settle` everything counts until the first slip, which clears the counters; they begin anew
        `settling` later. Without `least_stick` a stick is long from a fifth of the time to the first slip on.
        """
        self.flags[STATE] = state
        self.moments[SETTLED_FROM] = 0.0 if settle is None else settle
        self.moments[SETTLING] = settling if settle is None else np.nan
        self.moments[LEAST_STICK] = np.nan if least_stick is None else least_stick
        return self

    def room(self, begin: float, end: float, step: float) -> Array:
        """Space for the long sticks of a stretch; the list of the present ones begins anew."""
        self.flags[STICKS] = 0
        least = self.moments[LEAST_STICK]
        # Until the first slip there are none, and after it the least is a fifth of the time since the start.
        shortest = max(0.2 * begin if np.isnan(least) else float(least), step)
        return np.empty((int((end - begin) / shortest) + 2, 2))

    def taken(self, sticks: Array) -> Array:
        """The sticks that were entered."""
        return sticks[: self.flags[STICKS]].copy()

    def repeat(self, sample: Tally, settled: float, entries: float, all_in_all: float) -> None:
        """Count what `sample` counted so many times more: after settling, in the histograms, for the energy."""
        if settled > 0.0:
            highest = [MAX_N, MAX_SLIP]
            peaks = np.maximum(self.sums[highest], sample.sums[highest])
            self.sums[:SETTLED_SUMS] += settled * sample.sums[:SETTLED_SUMS]
            self.sums[highest] = peaks
            self.forces += entries * sample.forces
            self.speeds += entries * sample.speeds
        self.sums[SETTLED_SUMS:] += all_in_all * sample.sums[SETTLED_SUMS:]

    @property
    def arrays(self) -> tuple[Any, ...]:
        """What the kernels take; the last is the same word seen as its bits."""
        return self.flags, self.moments, self.sums, self.forces, self.speeds, self.word, self.word.view(np.int64)


@kernel
def follow(
    flags: Any, moments: Any, sums: Any, forces: Any, speeds: Any, sticks: Any, t: float, state: int
) -> None:
    """Keep first slip, first separation, switches, and the sticks that are long enough."""
    if state == flags[STATE]:
        return
    if state == SLIP and np.isnan(moments[FIRST_SLIP]):
        moments[FIRST_SLIP] = t
        if np.isnan(moments[LEAST_STICK]):
            moments[LEAST_STICK] = 0.2 * t
        if not np.isnan(moments[SETTLING]):
            moments[SETTLED_FROM] = t + moments[SETTLING]
            sums[:SETTLED_SUMS] = 0.0
            forces[:] = 0.0
            speeds[:] = 0.0
    if state == SEPARATION and np.isnan(moments[FIRST_SEPARATION]):
        moments[FIRST_SEPARATION] = t
    if t >= moments[SETTLED_FROM]:
        sums[SWITCHES] += 1.0
    if state == STICK:
        if not np.isnan(moments[FIRST_SLIP]):
            moments[STICK_START] = t
    elif moments[STICK_START] >= 0.0:
        if t - moments[STICK_START] >= moments[LEAST_STICK] and flags[STICKS] < sticks.shape[0]:
            sticks[flags[STICKS], 0] = moments[STICK_START]
            sticks[flags[STICKS], 1] = t
            flags[STICKS] += 1
        moments[STICK_START] = np.nan
    flags[STATE] = state


@inlined
def measure(sums: Any, state: int, N: float, speed: float, weight: float) -> None:
    """Add a step after settling: state, normal force, and the relative speed of the two surfaces."""
    sums[TIME_IN + state] += weight
    sums[SUM_N] += weight * N
    sums[MAX_N] = max(sums[MAX_N], N)
    sums[MAX_SLIP] = max(sums[MAX_SLIP], speed)


@inlined
def bin_of(bits: int) -> int:
    """Bin of the histograms for a number of zero or more, from its bits."""
    return min(max(((bits + _MIDDLE) >> _SHIFT) - _LOWEST, 0), BINS - 1)


@inlined
def spread(forces: Any, speeds: Any, word: Any, bits: Any, N: float, speed: float, weight: float) -> None:
    """Add a step, or one for several, to the histograms."""
    word[0] = N
    forces[bin_of(bits[0])] += weight
    word[0] = speed
    speeds[bin_of(bits[0])] += weight


def quantile(histogram: Array, share: float) -> float:
    """The value that a share of the counted time stays below; NaN where nothing was counted.

    Linear within a bin; the first bin holds zero and all that is below 2^-120.
    """
    filled = np.flatnonzero(histogram)
    if not len(filled):
        return float("nan")
    sums = np.cumsum(histogram[filled])
    wanted = share * sums[-1]
    place = int(np.searchsorted(sums, wanted))
    index = int(filled[place])
    if index == 0:
        return 0.0
    below = sums[place - 1] if place else 0.0
    within = (wanted - below) / histogram[index]
    edges = ((np.array([index, index + 1], dtype=np.int64) + _LOWEST) << _SHIFT) - _MIDDLE
    low, high = edges.view(np.float64)
    return float(low + min(max(within, 0.0), 1.0) * (high - low))
