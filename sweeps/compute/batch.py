"""One batch: from points to their results. A point that fails is kept with its reason; the others go on.

A worker needs nothing else of a sweep than its `Task`, and of a batch its points.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from sweeps.compute.reproduce import one_liner
from sweeps.compute.values import fits, rounded
from sweeps.fingerprint.provenance import environment
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
    environment : dict
        Where it was computed (`sweeps.fingerprint.provenance`); empty if that is not known.
    """

    values: dict[str, NDArray[Any]]
    wall_time: NDArray[np.float64]
    failures: dict[int, Failure] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.wall_time)


@dataclass(frozen=True, eq=False)
class Task:
    """Everything that computing a batch of a sweep needs.

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
        result = self._missing(points)
        with one_blas_thread():
            self._fill(result, points, 0, len(result))
        return result

    def failed(self, point: Points, problem: Exception) -> BatchResult:
        """The result of a point at which nothing could be computed."""
        result = self._missing(point)
        self._fail(result, point, 0, problem)
        return result

    def _missing(self, points: Points) -> BatchResult:
        count = len(next(iter(points.values())))
        values = {
            name: np.full((count, *self.shapes[name]), variable.missing, dtype=variable.dtype)
            for name, variable in self.variables.items()
        }
        return BatchResult(values, np.zeros(count), environment=environment())

    def _fill(self, result: BatchResult, every: Points, begin: int, end: int) -> None:
        points = {name: values[begin:end] for name, values in every.items()}
        start = time.perf_counter()
        try:
            given, errors, times = self._call(points)
        except (Exception, SystemExit) as problem:  # noqa: BLE001 - what a point raises is its outcome
            if end - begin > 1:
                middle = (begin + end) // 2
                self._fill(result, every, begin, middle)
                self._fill(result, every, middle, end)
            else:
                result.wall_time[begin] = time.perf_counter() - start
                self._fail(result, every, begin, problem)
            return
        spent = (time.perf_counter() - start) / (end - begin)
        result.wall_time[begin:end] = spent if times is None else times
        for name, values in given.items():
            result.values[name][begin:end] = values
        for row, error in enumerate(errors or (), begin):
            if error is not None:
                self._fail(result, every, row, error)

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

    def _call(self, points: Points) -> tuple[dict[str, Any], list[Any] | None, Any]:
        """Results of the declared shapes and types; errors and computing times where the function gives them."""
        count = len(next(iter(points.values())))
        who = f"the function of sweep {self.name} returned"
        given = self.function(points, **self.constants)
        if not isinstance(given, Mapping):
            raise TypeError(f"{who} {type(given).__name__}; it must be a dict")
        results: dict[str, Any] = {}
        for name, variable in self.variables.items():
            if name not in given:
                raise KeyError(f"{who} no {name!r}")
            values, expected = np.asarray(given[name]), (count, *self.shapes[name])
            if values.shape != expected:
                raise ValueError(f"{who} {name!r} of shape {values.shape}; it must be {expected}")
            if not fits(values, np.dtype(variable.dtype)):
                raise ValueError(f"{who} {name!r} of type {values.dtype}, which does not fit {variable.dtype}")
            results[name] = rounded(values.astype(variable.dtype), variable.digits)
        errors = None if given.get(ERROR) is None else list(given[ERROR])
        for error in errors or ():
            if not (error is None or isinstance(error, Exception)):
                raise TypeError(f"{who} the {ERROR} {error!r}; it must be an exception or None")
        times = None if given.get(WALL_TIME) is None else np.asarray(given[WALL_TIME], dtype=float)
        if times is not None and times.ndim != 1:
            raise ValueError(f"{who} {WALL_TIME!r} of shape {times.shape}; it must be ({count},)")
        for name, entries in ((ERROR, errors), (WALL_TIME, times)):
            if entries is not None and len(entries) != count:
                raise ValueError(f"{who} {len(entries)} of {name!r}; it must be one a point, {count}")
        return results, errors, times


class _Blas:
    """How many batches compute in this process, and what holds BLAS to one thread meanwhile."""

    lock = threading.Lock()
    batches = 0
    limit: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """One BLAS thread for all of this process, until the last that asks for it has done.

    More would compete with each other, and the bits of a result may depend on their number. A limit belongs to the
    process: whoever ended first would take it from those that still compute.
    """
    # From its version 3.8 on, threadpoolctl ignores all threads but the first that sets a limit, as long as that
    # lives; so here each setting has a short-lived thread of its own.
    with _Blas.lock:
        if not _Blas.batches:
            with ThreadPoolExecutor(1) as setter:
                _Blas.limit = setter.submit(threadpool_limits, 1, "blas").result()
        _Blas.batches += 1
    try:
        yield
    finally:
        with _Blas.lock:
            _Blas.batches -= 1
            if not _Blas.batches:
                with ThreadPoolExecutor(1) as setter:
                    setter.submit(_Blas.limit.restore_original_limits)


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
