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

from sweeps.compute.reproduce import one_liner
from sweeps.grid import Points, Variable
from sweeps.plan.keys import Columns

PENDING, DONE, FAILED, SKIPPED, INTERPOLATED = range(5)
STATUS_MEANINGS = "pending done failed skipped"
# Only where points were not computed because others tell enough (`sweeps.refine`).
INTERPOLATED_MEANING = "interpolated"
# A function may return these besides its results: what a point raised, and its own computing time.
ERROR, WALL_TIME = "error", "wall_time"
# Letters of an error text: every point of a file has room for the longest. The traceback holds all of it.
MOST_LETTERS = 400


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
        none = np.full((3, count), "", dtype=object)
        status = np.full(count, PENDING, dtype=np.int8)
        table = Table(points, key, {}, status, none[0], none[1], none[2], np.zeros(count))
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
            given, told = self._call(points)
        except (Exception, SystemExit) as problem:  # noqa: BLE001 - what a point raises is its outcome
            if end - begin > 1:
                middle = (begin + end) // 2
                self._fill(table, begin, middle)
                self._fill(table, middle, end)
                return
            table.wall_time[begin] = time.perf_counter() - start
            self._fail(table, begin, problem)
            return
        table.wall_time[begin:end] = told.get(WALL_TIME, (time.perf_counter() - start) / (end - begin))
        table.status[begin:end] = DONE
        if end - begin == len(table):
            table.values = given
        else:
            if not table.values:
                self._make_room(table)
            for name, values in given.items():
                table.values[name][begin:end] = values
        for row, each in enumerate(told.get(ERROR, ()), begin):
            if each is not None:
                self._fail(table, row, each)

    def _fail(self, table: Table, row: int, problem: BaseException) -> None:
        """Keep why a point failed, where, and how to see it again."""
        frames = [f for f in traceback.extract_tb(problem.__traceback__) if f.filename != __file__]
        lines = traceback.format_list(frames) or ["(raised by the sweep engine)\n"]
        error = _described(problem)
        table.status[row] = FAILED
        table.error[row] = error if len(error) <= MOST_LETTERS else f"{error[: MOST_LETTERS - 3]}..."
        table.traceback[row] = _writable("".join([*lines, error]))
        point = {name: values[row] for name, values in table.points.items()}
        table.reproduce[row] = _writable(one_liner(self.function, point, self.constants))
        for name, values in table.values.items():
            values[row] = self.variables[name].missing

    def _call(self, points: Points) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """The function's results, each of its declared shape and type, and what else it told."""
        count = len(next(iter(points.values())))
        given = self.function(points, **self.constants)
        if not isinstance(given, Mapping):
            raise TypeError(
                f"the function of sweep {self.name} returned {type(given).__name__}; it must be a dict"
            )
        results: dict[str, NDArray[Any]] = {}
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
            # A copy: the function may use its array again, or may have returned the points themselves.
            results[name] = rounded(values.astype(variable.dtype), variable.digits)
        return results, self._told(given, count)

    def _told(self, given: Mapping[str, Any], count: int) -> dict[str, Any]:
        """Errors and computing times, one a point, where the function returned them."""
        told: dict[str, Any] = {}
        who = f"the function of sweep {self.name} returned"
        if given.get(ERROR) is not None:
            told[ERROR] = list(given[ERROR])
            for each in told[ERROR]:
                if not (each is None or isinstance(each, Exception)):
                    raise TypeError(f"{who} the {ERROR} {each!r}; it must be an exception or None")
        if given.get(WALL_TIME) is not None:
            told[WALL_TIME] = np.asarray(given[WALL_TIME], dtype=float)
            if told[WALL_TIME].ndim != 1:
                raise ValueError(f"{who} {WALL_TIME!r} of shape {told[WALL_TIME].shape}; it must be ({count},)")
        for name, entries in told.items():
            if len(entries) != count:
                raise ValueError(f"{who} {len(entries)} of {name!r}; it must be one a point, {count}")
        return told


def _described(problem: BaseException) -> str:
    """Type and message."""
    try:
        message = str(problem)
    except Exception:  # noqa: BLE001 - what cannot tell its reason has failed all the same
        message = "(its message cannot be read)"
    return _writable(f"{type(problem).__name__}: {message}" if message else type(problem).__name__)


def _writable(text: str) -> str:
    """A text that a file can hold: UTF-8, without the letter that ends a text there."""
    return text.replace("\0", "\\0").encode("utf-8", "backslashreplace").decode("utf-8")


def rounded(values: NDArray[Any], digits: int | None) -> NDArray[Any]:
    """Floats to so many significant decimal digits: the last bits of the mantissa become zero.

    To nearest, ties to even: idempotent, and the same everywhere. The relative error is at most
    10^-digits / 2, so that no value moves by more than half a unit of the last digit kept. What has no such
    neighbour stays as it is: what would become infinite, and what is so small that it has fewer bits.
    """
    if digits is None:
        return values
    bits, word = (23, np.dtype(np.uint32)) if values.dtype == np.float32 else (52, np.dtype(np.uint64))
    # Half a unit of the last bit is at most 10^-digits / 2.
    drop = bits - int(np.ceil(digits * np.log2(10.0)))
    if drop <= 0:
        return values
    raw: Any = values.view(word)
    shift, half, mask = (word.type(n) for n in (drop, (1 << (drop - 1)) - 1, (1 << drop) - 1))
    kept = (raw + half + ((raw >> shift) & word.type(1))) & ~mask
    near: NDArray[Any] = kept.view(values.dtype)
    normal = np.isfinite(values) & np.isfinite(near) & (np.abs(values) >= np.finfo(values.dtype).tiny)
    return np.where(normal, near, values)


def _fits(values: NDArray[Any], dtype: np.dtype[Any]) -> bool:
    """Whether nothing but digits of a float is lost."""
    if dtype.kind == "f":
        if values.dtype.kind != "f" or values.dtype.itemsize <= dtype.itemsize:
            return values.dtype.kind in "biuf"
        most = np.finfo(dtype).max
        return not np.any(np.isfinite(values) & (np.abs(values) > most))
    if values.dtype.kind not in "biuf":
        return False
    # The least whole number means that there is none; beyond 2^53 a reader's float would lose digits.
    limit = min(np.iinfo(dtype).max, 2**53)
    return bool(np.all((np.abs(values.astype(float)) <= limit) & (values == np.rint(values))))
