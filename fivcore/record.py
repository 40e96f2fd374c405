"""What is kept of a run that is recorded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.drive import Canonical
from fivcore.kernel import Array


class Record:
    """Series of a run, gathered column by column in the scene's own units.

    Seconds of motion at every step are tens of MB: they are held once, whatever else is at work meanwhile, and
    not at all where the series are kept at given times.

    Parameters
    ----------
    canonical : Canonical
    times : ndarray, (n,), optional
        Where the series are kept, s, ascending, on lines between the rows; without: at the rows.
    """

    def __init__(self, canonical: Canonical, times: Array | None = None) -> None:
        F, along = canonical.load, canonical.load * canonical.sense
        # As the columns of rows come; the time is the same in all units.
        self._factors = {
            "time": 1.0,
            "velocity_B": along,
            "normal_force": F,
            "tangential_force": along,
            "slip_velocity": along,
        }
        self._pieces: dict[str, list[NDArray[Any]]] = {name: [] for name in (*self._factors, "state")}
        self._times = times
        self._done = 0
        self._last: Array | None = None

    def add(self, rows: Array) -> None:
        """Take the next rows: t, velocity of B, N, T, slip rate and contact state, canonical."""
        if not len(rows):
            return
        if self._times is not None:
            before = rows if self._last is None else np.concatenate([self._last, rows])
            self._last = rows[-1:].copy()
            reached = int(np.searchsorted(self._times, rows[-1, 0], side="right"))
            self._keep(before, self._times[self._done : reached])
            self._done = reached
            return
        for column, (name, factor) in enumerate(self._factors.items()):
            self._pieces[name].append(factor * rows[:, column])
        self._pieces["state"].append(rows[:, -1].astype(np.int8))

    def _keep(self, rows: Array, times: Array) -> None:
        """The series at `times`, none of which is beyond the last row unless no row follows."""
        for column, (name, factor) in enumerate(self._factors.items()):
            values = times if name == "time" else np.interp(times, rows[:, 0], factor * rows[:, column])
            self._pieces[name].append(values)
        before = np.maximum(np.searchsorted(rows[:, 0], times, side="right") - 1, 0)
        self._pieces["state"].append(rows[before, -1].astype(np.int8))

    def whole(self) -> dict[str, Any]:
        """Each series in one piece; nothing where nothing was recorded."""
        if self._times is not None and self._last is not None:
            self._keep(self._last, self._times[self._done :])
        # One by one, so that of all but one there is only one copy.
        return {name: np.concatenate(pieces) for name in [*self._pieces] if (pieces := self._pieces.pop(name))}


def times_of(sample_times: Any, record: bool, duration: float) -> Array:
    """The times at which series are kept, checked.

    Raises
    ------
    ValueError
        For what are no ascending times within the run, or where nothing is recorded.
    """
    if not record:
        raise ValueError("sample_times: they are for what is recorded, and nothing is; give record = True")
    try:
        times = np.array(sample_times, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError("sample_times: they must be numbers, s") from None
    if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) < 0.0):
        raise ValueError(f"sample_times of shape {times.shape}: they must be a row of finite, ascending times, s")
    if len(times) and not (times[0] >= 0.0 and times[-1] <= duration):
        raise ValueError(
            f"sample_times from {times[0]:g} to {times[-1]:g} s: they must be from 0 to duration = {duration:g} s"
        )
    return times
