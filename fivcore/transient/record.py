"""Segments, which the methods hand to the driver, and the time series recorded from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.jit import Array
from fivcore.transient.normalised import Normalised

# Columns of a sample: velocity of B, slip rate, N, and these counters after that step.
SAMPLED_COUNTERS = ("stick_time", "separation_time", "sum_N", "switches")
SAMPLE = 3 + len(SAMPLED_COUNTERS)
# Series and their columns in the rows, whose first column is the time.
SERIES = {"velocity_B": 1, "normal_force": 2, "tangential_force": 3, "slip_velocity": 4, "state": 5}


@dataclass
class Segment:
    """Results of a segment, normalised (F = 1).

    `samples` (n, SAMPLE) were taken at the times `t` (n,), followed by `further` samples like the last; `sticks`
    (k, 2) are start and end of the long sticks that ended; `rows` (m, 6) what is recorded: time, velocity of B, N,
    T, slip rate and contact state.
    """

    t: Array
    samples: Array
    sticks: Array = field(default_factory=lambda: np.empty((0, 2)))
    rows: Array = field(default_factory=lambda: np.empty((0, 6)))
    further: int = 0


def count_in(first: int, last: int, every: int) -> int:
    """Number of multiples of `every` from step `first` up to step `last`, excluded; none if `every` is zero."""
    return max(-(-last // every) - (-(-first // every)), 0) if every else 0


def room_for_sticks(start: float, end: float, least: float, step: float) -> int:
    """Largest number of long sticks of at least `least` that end between two times, s."""
    return int((end - start) / max(least, step)) + 2


class Record:
    """Named series of a run in its scene's units: at the rows, or linear between them at `times` or a `rate`."""

    def __init__(
        self, normalised: Normalised, names: Sequence[str], times: Array | None = None, rate: float | None = None
    ) -> None:
        factors = {"normal_force": normalised.load, "state": 1.0}
        self._factors = {name: factors.get(name, normalised.load * normalised.sense) for name in names}
        self._parts: dict[str, list[NDArray[Any]]] = {name: [] for name in ("time", *names)}
        self._times, self._rate, self._taken, self._last = times, rate, 0, np.empty((0, 1 + len(SERIES)))

    def add(self, rows: Array) -> None:
        """Take the next rows of `Segment.rows`."""
        if self._times is None and self._rate is None:
            self._keep(rows)
        elif len(rows):
            rows = np.concatenate([self._last, rows])
            self._last = rows[-1:].copy()
            self._keep(rows, self._due(rows[-1, 0]))

    def _due(self, until: float) -> Array:
        """Times up to `until`, s, at which series have not been kept yet."""
        if self._times is not None:
            t, self._times = np.split(self._times, [np.searchsorted(self._times, until, side="right")])
            return t
        first, rate = self._taken, self._rate or 0.0
        self._taken = max(int(until * rate * (1.0 + 1e-12)) + 1, first)
        return np.asarray(np.arange(first, self._taken) / rate)

    def _keep(self, rows: Array, t: Array | None = None) -> None:
        """Keep the series at the rows or at times `t`; the nearest row stands for what lies outside of all."""
        reached = rows[:, 0]
        self._parts["time"].append(reached.copy() if t is None else t)
        for name, factor in self._factors.items():
            values = factor * rows[:, SERIES[name]]
            if t is not None and name == "state":
                values = values[np.maximum(np.searchsorted(reached, t, side="right") - 1, 0)]
            elif t is not None:
                values = np.interp(t, reached, values)
            self._parts[name].append(values.astype(np.int8) if name == "state" else values)

    def whole(self, end: float) -> dict[str, Any]:
        """Each series of a run that ended at `end`, s, in one piece; nothing where nothing was recorded."""
        if self._times is not None:
            self._keep(self._last, self._times)
        elif self._rate is not None:
            t = self._due(end)
            self._keep(self._last, t[t < end * (1.0 - 1e-12)])
        # Each is taken out before the next is joined: all but one then have one copy in memory.
        return {name: np.concatenate(parts) for name in [*self._parts] if (parts := self._parts.pop(name))}
