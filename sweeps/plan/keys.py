"""Which points are one computation: rows of a key, compared by value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sweeps.grid import Points

if TYPE_CHECKING:
    from sweeps.sweep import Sweep

# One array a column, one entry a row.
Columns = list[NDArray[Any]]


def key_columns(sweep: Sweep, points: Points) -> Columns:
    """The key of each point: the sweep's own, or else all its axis values.

    Raises
    ------
    ValueError
        If the sweep's key gives something that cannot be compared.
    """
    if sweep.key is None:
        return [points[name] for name in sweep.grid.axes]
    count = len(next(iter(points.values())))
    rows = np.asarray(sweep.key(points)) if count else np.zeros(0)
    if rows.ndim not in (1, 2) or len(rows) != count or rows.dtype.kind not in "biufU":
        raise ValueError(
            f"Sweep {sweep.name}: key gave an array of shape {rows.shape} and type {rows.dtype} for "
            f"{count} points; it must give one row of numbers or texts for each"
        )
    if rows.dtype.kind == "f" and np.any(np.isnan(rows)):
        raise ValueError(f"Sweep {sweep.name}: key gave NaN, which equals nothing")
    return [rows] if rows.ndim == 1 else list(rows.T)


class Index:
    """Rows that can be looked up by value.

    Attributes
    ----------
    code : ndarray of int64
        A number for each row; equal rows have the same.
    """

    def __init__(self, columns: Columns) -> None:
        self._stages: list[tuple[NDArray[Any], NDArray[np.int64] | None]] = []
        self.code, kinds = np.zeros(len(columns[0]), dtype=np.int64), 1
        for column in columns:
            values, place = np.unique(column, return_inverse=True)
            packed = None
            if kinds * len(values) >= 2**62:
                packed, code = np.unique(self.code, return_inverse=True)
                self.code, kinds = code.ravel().astype(np.int64), len(packed)
            self.code = self.code * len(values) + place.ravel()
            kinds *= max(len(values), 1)
            self._stages.append((values, packed))
        self._order = np.argsort(self.code, kind="stable")
        self._sorted = self.code[self._order]

    def first(self) -> NDArray[np.intp]:
        """For each row the first that equals it."""
        _, first, place = np.unique(self.code, return_index=True, return_inverse=True)
        return np.asarray(first[place.ravel()])

    def find(self, columns: Columns) -> NDArray[np.intp]:
        """For each row of other columns the first of these that equals it; -1 where none does."""
        count = len(columns[0])
        known = np.full(count, len(self.code) > 0)
        code = np.zeros(count, dtype=np.int64)
        for column, (values, packed) in zip(columns, self._stages, strict=True):
            if packed is not None:
                place, found = _search(packed, code)
                code, known = place.astype(np.int64), known & found
            place, found = _search(values, column)
            code, known = code * len(values) + place, known & found
        place, found = _search(self._sorted, code)
        if not len(self.code):
            return np.full(count, -1, dtype=np.intp)
        return np.where(known & found, self._order[place], -1)


def column(values: Any) -> NDArray[Any]:
    """What was read from a file as a column: texts as texts."""
    values = np.asarray(values)
    return np.asarray(values.astype(str) if values.dtype.kind == "O" else values)


def _search(values: NDArray[Any], wanted: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Where in the sorted `values` each of the wanted stands, and whether it does."""
    if not len(values):
        return np.zeros(len(wanted), dtype=np.intp), np.zeros(len(wanted), dtype=bool)
    place = np.minimum(np.searchsorted(values, wanted), len(values) - 1)
    return place, np.asarray(values[place] == wanted)
