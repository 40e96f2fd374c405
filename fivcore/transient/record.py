"""What is kept of a run that is recorded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.jit import Array
from fivcore.transient.normalised import Normalised

# Column of the rows, and what turns its normalised numbers into those of the scene: what a load multiplies, what
# also turns round with the sense of the drive, and what does not change.
LOAD, ALONG, SAME = range(3)
SERIES = {
    "velocity_B": (1, ALONG),
    "normal_force": (2, LOAD),
    "tangential_force": (3, ALONG),
    "slip_velocity": (4, ALONG),
    "state": (5, SAME),
}


class Record:
    """Series of a run, gathered column by column in the scene's own units.

    Seconds of motion at every step are tens of MB: they are held once, whatever else is at work meanwhile, and
    not at all where the series are kept at given times.

    Parameters
    ----------
    normalised : Normalised
    names : sequence of str
        Of `SERIES`, those which are kept.
    times : ndarray, (n,), optional
        Where the series are kept, s, ascending, on lines between the rows; without: at the rows.
    """

    def __init__(self, normalised: Normalised, names: Sequence[str], times: Array | None = None) -> None:
        load = normalised.load
        self._factors = {LOAD: load, ALONG: load * normalised.sense, SAME: 1.0}
        self._names = names
        self._pieces: dict[str, list[NDArray[Any]]] = {name: [] for name in ("time", *names)}
        self._times, self._done = times, 0
        if times is not None:
            # Each in one piece from the start: small pieces of many runs would lie about between each other.
            self._pieces = {name: [np.empty(len(times), dtype=_type(name))] for name in names}
            self._pieces["time"] = [times]
        self._last = np.empty((0, 1 + len(SERIES)))

    def add(self, rows: Array) -> None:
        """Take the next rows: t, velocity of B, N, T, slip rate and contact state, normalised."""
        if self._times is not None:
            rows = np.concatenate([self._last, rows])
            if len(rows):
                self._keep(rows, int(np.searchsorted(self._times, rows[-1, 0], side="right")))
                self._last = rows[-1:].copy()
        elif len(rows):
            self._pieces["time"].append(rows[:, 0].copy())
            for name in self._names:
                self._pieces[name].append(self._own(name, rows).astype(_type(name)))

    def _own(self, name: str, rows: Array) -> Array:
        """A series at the rows, in the scene's units."""
        column, kind = SERIES[name]
        return rows[:, column] if kind == SAME else self._factors[kind] * rows[:, column]

    def _keep(self, rows: Array, until: int) -> None:
        """Fill in the series up to time number `until`; the nearest row stands for what lies outside of all."""
        part = slice(self._done, until)
        t, known = self._pieces["time"][0][part], rows[:, 0]
        for name in self._names:
            values = self._own(name, rows)
            if name == "state":
                kept = values[np.maximum(np.searchsorted(known, t, side="right") - 1, 0)]
            else:
                kept = np.interp(t, known, values)
            self._pieces[name][0][part] = kept
        self._done = until

    def whole(self) -> dict[str, Any]:
        """Each series in one piece; nothing where nothing was recorded."""
        if self._times is not None:
            self._keep(self._last, len(self._times))
            return {name: piece for name, (piece,) in self._pieces.items()}
        # One by one, so that of all but one there is only one copy.
        return {name: np.concatenate(pieces) for name in [*self._pieces] if (pieces := self._pieces.pop(name))}


def _type(name: str) -> type[np.generic]:
    return np.int8 if name == "state" else np.float64


def names_of(record: Any) -> tuple[str, ...]:
    """The series that are kept: all for True, none for False, or those named.

    Raises
    ------
    ValueError
        Naming what is no series.
    """
    if isinstance(record, (bool, np.bool_)):
        return tuple(SERIES) if record else ()
    names = (record,) if isinstance(record, str) else record
    if not isinstance(names, (tuple, list)) or not names or any(name not in SERIES for name in names):
        raise ValueError(f"record = {record!r}: it must be a bool or names of series among {', '.join(SERIES)}")
    return tuple(name for name in SERIES if name in names)


def times_of(sample_times: Any, names: Sequence[str], duration: float) -> Array:
    """The times at which series are kept, checked.

    Raises
    ------
    ValueError
        For what are no ascending times within the run, or where nothing is recorded.
    """
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
