"""One batch: from points to a table of what became of them. A point that fails is kept apart; the others go on.

This is what runs on a worker, and all that travels there: a `Work`, and an array of points a batch.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.grid import Points, Variable
from sweeps.keys import Columns
from sweeps.reproduce import one_liner

PENDING, DONE, FAILED, SKIPPED = range(4)
STATUS_MEANINGS = "pending done failed skipped"
# A function may return these besides its results: what a point raised, and its own computing time.
ERROR, WALL_TIME = "error", "wall_time"


@dataclass(eq=False)
class Table:
    """Computed points, one row each.

    Attributes
    ----------
    points : dict of str to ndarray
        Values of the axes.
    key : list of ndarray
        What identifies the computation.
    values : dict of str to ndarray
        Results, not scaled; the missing value where a point failed.
    status : ndarray of int8
    error, traceback, reproduce : ndarray of object
        Texts; empty where a point was done.
    wall_time : ndarray
        s.
    """

    points: Points
    key: Columns
    values: dict[str, NDArray[Any]]
    status: NDArray[np.int8]
    error: NDArray[np.object_]
    traceback: NDArray[np.object_]
    reproduce: NDArray[np.object_]
    wall_time: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.status)

    @property
    def failed(self) -> int:
        """How many points failed."""
        return int(np.count_nonzero(self.status == FAILED))

    @property
    def nbytes(self) -> int:
        """Size of the values."""
        return sum(values.nbytes for values in self.values.values())


@dataclass(frozen=True, eq=False)
class Work:
    """What is done to every batch of a sweep.

    Attributes
    ----------
    name : str
    function : callable
    constants : mapping
    variables : mapping of str to Variable
    shapes : mapping of str to tuple
        Shape of each variable at one point.
    """

    name: str
    function: Callable[..., Mapping[str, Any]]
    constants: Mapping[str, Any]
    variables: Mapping[str, Variable]
    shapes: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def table(self, points: Points, key: Columns) -> Table:
        """Compute a batch; if it raises as a whole, its halves, down to the points that fail."""
        count = len(next(iter(points.values())))
        table = Table(
            points,
            key,
            {},
            np.full(count, PENDING, dtype=np.int8),
            *(np.full(count, "", dtype=object) for _ in range(3)),
            np.zeros(count),
        )
        self._fill(table, 0, count)
        if not table.values:
            self._make_room(table)
        return table

    def _make_room(self, table: Table) -> None:
        """Values for all points of a table, missing so far."""
        for name, variable in self.variables.items():
            shape = (len(table), *self.shapes[name])
            table.values[name] = np.full(shape, variable.missing, dtype=variable.dtype)

    def _fill(self, table: Table, begin: int, end: int) -> None:
        points = {name: values[begin:end] for name, values in table.points.items()}
        start = time.perf_counter()
        try:
            given = self._call(points)
        except Exception as problem:  # noqa: BLE001 - whatever a point raises is kept as its outcome
            if end - begin > 1:
                middle = (begin + end) // 2
                self._fill(table, begin, middle)
                self._fill(table, middle, end)
                return
            table.wall_time[begin] = time.perf_counter() - start
            self._fail(table, begin, problem)
            return
        table.wall_time[begin:end] = given.pop(WALL_TIME, (time.perf_counter() - start) / (end - begin))
        table.status[begin:end] = DONE
        problems = given.pop(ERROR, ())
        if end - begin == len(table):
            table.values = given
        else:
            if not table.values:
                self._make_room(table)
            for name, values in given.items():
                table.values[name][begin:end] = values
        for row, problem in enumerate(problems, begin):
            if problem is not None:
                self._fail(table, row, problem)

    def _fail(self, table: Table, row: int, problem: Exception) -> None:
        """Keep why a point failed, where, and how to see it again."""
        frames = [f for f in traceback.extract_tb(problem.__traceback__) if f.filename != __file__]
        lines = traceback.format_list(frames)
        table.status[row] = FAILED
        table.error[row] = f"{type(problem).__name__}: {problem}"
        table.traceback[row] = "".join(lines).rstrip() or "(raised by the sweep engine)"
        point = {name: values[row] for name, values in table.points.items()}
        table.reproduce[row] = one_liner(self.function, point, self.constants)
        for name, values in table.values.items():
            values[row] = self.variables[name].missing

    def _call(self, points: Points) -> dict[str, Any]:
        """The function's results, each of its declared shape and type, and what else it told."""
        count = len(next(iter(points.values())))
        given = self.function(points, **self.constants)
        results: dict[str, Any] = {}
        for name, variable in self.variables.items():
            if name not in given:
                raise KeyError(f"the function of sweep {self.name} returned no {name!r}")
            values, expected = np.asarray(given[name]), (count, *self.shapes[name])
            if values.shape != expected:
                raise ValueError(
                    f"the function of sweep {self.name} returned {name!r} of shape {values.shape}; "
                    f"it must be {expected}"
                )
            if not _fits(values, np.dtype(variable.dtype)):
                raise ValueError(
                    f"the function of sweep {self.name} returned {name!r} of type {values.dtype}, "
                    f"which does not fit {variable.dtype}"
                )
            results[name] = rounded(values.astype(variable.dtype, copy=False), variable.digits)
        for name in (ERROR, WALL_TIME):
            if name in given:
                if len(given[name]) != count:
                    raise ValueError(
                        f"the function of sweep {self.name} returned {len(given[name])} of {name!r}; it must be "
                        f"one a point, {count}"
                    )
                results[name] = given[name]
        return results


def rounded(values: NDArray[Any], digits: int | None) -> NDArray[Any]:
    """Floats to so many significant decimal digits: the last bits of the mantissa become zero.

    To nearest, ties to even: idempotent, and the same everywhere. The relative error is at most
    10^-digits / 2, so that no value moves by more than half a unit of the last digit kept.
    """
    if digits is None:
        return values
    bits, word = (23, np.dtype(np.uint32)) if values.dtype == np.float32 else (52, np.dtype(np.uint64))
    # Half a unit of the last bit is at most 10^-digits / 2.
    drop = bits - int(np.ceil(digits * np.log2(10.0)))
    if drop <= 0:
        return values
    raw: NDArray[Any] = values.view(word)
    shift, half, mask = (word.type(n) for n in (drop, (1 << (drop - 1)) - 1, (1 << drop) - 1))
    kept = (raw + half + ((raw >> shift) & word.type(1))) & ~mask
    return np.where(np.isfinite(values), kept.view(values.dtype), values)


def _fits(values: NDArray[Any], dtype: np.dtype[Any]) -> bool:
    """Whether nothing but digits of a float is lost."""
    if dtype.kind == "f":
        return values.dtype.kind in "biuf"
    if values.dtype.kind not in "biuf":
        return False
    # The least whole number means that there is none; beyond 2^53 a reader's float would lose digits.
    most = min(np.iinfo(dtype).max, 2**53)
    return bool(np.all((np.abs(values.astype(float)) <= most) & (values == np.rint(values))))
