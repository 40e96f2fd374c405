"""Time series of a run, at the steps of the method or at given times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.jit import Array
from fivcore.transient.normalised import Normalised

# Series and their columns in the rows, whose first column is the time.
SERIES = {"velocity_B": 1, "normal_force": 2, "tangential_force": 3, "slip_velocity": 4, "state": 5}


class Record:
    """Named series of a run in the units of its scene: at the rows, or linear between them at given `times`."""

    def __init__(self, normalised: Normalised, names: Sequence[str], times: Array | None = None) -> None:
        factors = {"normal_force": normalised.load, "state": 1.0}
        self._factors = {name: factors.get(name, normalised.load * normalised.sense) for name in names}
        self._parts: dict[str, list[NDArray[Any]]] = {name: [] for name in ("time", *names)}
        self._times, self._last = times, np.empty((0, 1 + len(SERIES)))

    def add(self, rows: Array) -> None:
        """Take the next rows: t, velocity of B, N, T, slip rate and contact state, normalised."""
        if not len(rows):
            return
        if self._times is None:
            self._keep(rows)
            return
        rows = np.concatenate([self._last, rows])
        self._last = rows[-1:].copy()
        t, self._times = np.split(self._times, [np.searchsorted(self._times, rows[-1, 0], side="right")])
        self._keep(rows, t)

    def _keep(self, rows: Array, t: Array | None = None) -> None:
        """Keep the series at the rows or at times `t`; the nearest row stands for what lies outside of all."""
        known = rows[:, 0]
        self._parts["time"].append(known.copy() if t is None else t)
        for name, factor in self._factors.items():
            values = factor * rows[:, SERIES[name]]
            if t is not None and name == "state":
                values = values[np.maximum(np.searchsorted(known, t, side="right") - 1, 0)]
            elif t is not None:
                values = np.interp(t, known, values)
            self._parts[name].append(values.astype(np.int8) if name == "state" else values)

    def whole(self) -> dict[str, Any]:
        """Each series in one piece; nothing where nothing was recorded."""
        if self._times is not None:
            self._keep(self._last, self._times)
        # Each is taken out before the next is joined: all but one then have one copy in memory.
        return {name: np.concatenate(parts) for name in [*self._parts] if (parts := self._parts.pop(name))}


def names_of(record: Any) -> tuple[str, ...]:
    """Series to keep: all for True, none for False, or those named; anything else is refused."""
    if isinstance(record, (bool, np.bool_)):
        return tuple(SERIES) if record else ()
    names = (record,) if isinstance(record, str) else record
    if not isinstance(names, (tuple, list)) or not names or any(name not in SERIES for name in names):
        raise ValueError(f"record = {record!r}: it must be a bool or names of series among {', '.join(SERIES)}")
    return tuple(name for name in SERIES if name in names)


def times_of(sample_times: Any, names: Sequence[str], duration: float) -> Array:
    """Check the times at which series are kept: ascending, within the run, and of something recorded."""
    if not names:
        raise ValueError("sample_times: they are for what is recorded, and nothing is; give record = True")
    try:
        times = np.asarray(sample_times, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError("sample_times: they must be numbers, s") from None
    if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) < 0.0):
        raise ValueError(f"sample_times of shape {times.shape}: they must be a row of finite, ascending times, s")
    if len(times) and not (times[0] >= 0.0 and times[-1] <= duration):
        raise ValueError(
            f"sample_times from {times[0]:g} to {times[-1]:g} s: they must be from 0 to duration = {duration:g} s"
        )
    return times
