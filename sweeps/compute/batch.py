"""One batch: from points to their results. A point that fails is kept with its reason; the others go on.

A worker needs nothing else of a sweep than its `Task`, and of a batch its points.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sweeps.compute.reproduce import one_liner
from sweeps.compute.values import fits, rounded
from sweeps.grid import Points, Variable

# A function may return these besides its results: what a point raised, and its own computing time.
ERROR, WALL_TIME = "error", "wall_time"
# Letters of an error text: every point of a file has room for the longest. The traceback holds all of it.
MOST_LETTERS = 400


class Failure(NamedTuple):
    """Why a point failed, where, and a line of Python that shows it again."""

    error: str
    traceback: str = ""
    reproduce: str = ""


@dataclass(eq=False)
class BatchResult:
    """Computed points, one row each.

    Attributes
    ----------
    values : dict of str to ndarray
        Results, not scaled; the missing value where a point failed.
    wall_time : ndarray
        s.
    failures : dict of int to Failure
        By row.
    """

    values: dict[str, NDArray[Any]]
    wall_time: NDArray[np.float64]
    failures: dict[int, Failure] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.wall_time)


@dataclass(frozen=True, eq=False)
class Task:
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

    def compute(self, points: Points) -> BatchResult:
        """Compute a batch; if it raises as a whole, its halves, down to the points that fail."""
        count = len(next(iter(points.values())))
        result = BatchResult({}, np.zeros(count))
        self._fill(result, points, 0, count)
        if not result.values:
            self._make_room(result)
        return result

    def _make_room(self, result: BatchResult) -> None:
        """Missing values for all points of a batch."""
        for name, variable in self.variables.items():
            shape = (len(result), *self.shapes[name])
            result.values[name] = np.full(shape, variable.missing, dtype=variable.dtype)

    def _fill(self, result: BatchResult, every: Points, begin: int, end: int) -> None:
        points = {name: values[begin:end] for name, values in every.items()}
        start = time.perf_counter()
        try:
            given, besides = self._call(points)
        except (Exception, SystemExit) as problem:  # noqa: BLE001 - what a point raises is its outcome
            if end - begin > 1:
                middle = (begin + end) // 2
                self._fill(result, every, begin, middle)
                self._fill(result, every, middle, end)
                return
            result.wall_time[begin] = time.perf_counter() - start
            self._fail(result, every, begin, problem)
            return
        spent = (time.perf_counter() - start) / (end - begin)
        result.wall_time[begin:end] = besides.get(WALL_TIME, spent)
        if end - begin == len(result):
            result.values = given
        else:
            if not result.values:
                self._make_room(result)
            for name, values in given.items():
                result.values[name][begin:end] = values
        for row, each in enumerate(besides.get(ERROR, ()), begin):
            if each is not None:
                self._fail(result, every, row, each)

    def _fail(self, result: BatchResult, every: Points, row: int, problem: BaseException) -> None:
        """Keep why a point failed, where, and how to see it again."""
        frames = [f for f in traceback.extract_tb(problem.__traceback__) if f.filename != __file__]
        lines = traceback.format_list(frames) or ["(raised by the sweep engine)\n"]
        error = _described(problem)
        shortened = error if len(error) <= MOST_LETTERS else f"{error[: MOST_LETTERS - 3]}..."
        point = {name: values[row] for name, values in every.items()}
        reproduce = _writable(one_liner(self.function, point, self.constants))
        result.failures[row] = Failure(shortened, _writable("".join([*lines, error])), reproduce)
        for name, values in result.values.items():
            values[row] = self.variables[name].missing

    def _call(self, points: Points) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """The function's results, each of its declared shape and type, and what it returned besides."""
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
            if not fits(values, np.dtype(variable.dtype)):
                raise ValueError(
                    f"the function of sweep {self.name} returned {name!r} of type {values.dtype}, "
                    f"which does not fit {variable.dtype}"
                )
            # A copy: the function may use its array again, or may have returned the points themselves.
            results[name] = rounded(values.astype(variable.dtype), variable.digits)
        return results, self._besides(given, count)

    def _besides(self, given: Mapping[str, Any], count: int) -> dict[str, Any]:
        """Errors and computing times, one a point, where the function returned them."""
        besides: dict[str, Any] = {}
        who = f"the function of sweep {self.name} returned"
        if given.get(ERROR) is not None:
            besides[ERROR] = list(given[ERROR])
            for each in besides[ERROR]:
                if not (each is None or isinstance(each, Exception)):
                    raise TypeError(f"{who} the {ERROR} {each!r}; it must be an exception or None")
        if given.get(WALL_TIME) is not None:
            besides[WALL_TIME] = np.asarray(given[WALL_TIME], dtype=float)
            if besides[WALL_TIME].ndim != 1:
                shape = besides[WALL_TIME].shape
                raise ValueError(f"{who} {WALL_TIME!r} of shape {shape}; it must be ({count},)")
        for name, entries in besides.items():
            if len(entries) != count:
                raise ValueError(f"{who} {len(entries)} of {name!r}; it must be one a point, {count}")
        return besides


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
