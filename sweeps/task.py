"""A batch of a sweep's `Task`: from points to results. A failing point is stored with its reason."""

import inspect
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from sweeps.errors import InputError, UndeclaredError
from sweeps.fingerprint.provenance import environment
from sweeps.grid import Grid, Points, Variable, is_text
from sweeps.storage.assemble import rounded
from sweeps.storage.parts import BatchResult, Failure

# A function may return these besides its results: the exception of each point or None, and its computing time.
ERROR, WALL_TIME = "error", "wall_time"
# The result of a function of numbers that returns no dict.
VALUE = "value"
# In place of what a function of numbers returns at other points; fits no variable, so that its point fails alone.
ABSENT = object()
# Characters of an error text; the traceback has all of them.
MOST_CHARACTERS = 400


class Pointwise:
    """A function of numbers in the place of a function of arrays: `sweeps.pointwise`.

    Parameters
    ----------
    function : callable
        `function(a=..., b=..., **constants)` takes one number (or string) for each axis. It returns a dict of
        numbers or arrays, or the value of a single variable. An exception is stored with its point.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        if not callable(function):
            raise InputError(f"pointwise: function = {function!r}: it must be a function")
        self.function = self.__wrapped__ = function

    def __call__(self, points: Points, **constants: Any) -> dict[str, Any]:
        """Call the function at each point; exceptions and times are returned with the results."""
        # The number of a row or a draw is for functions that take it.
        unused = {"row", "sample"} - set(inspect.signature(self.function).parameters)
        columns = {name: values.tolist() for name, values in points.items() if name not in unused}
        count = len(next(iter(points.values())))
        rows, errors, times = list[Any](), list[Any]([None] * count), np.zeros(count)
        for k in range(count):
            begin = time.perf_counter()
            try:
                rows.append(self.function(**{name: values[k] for name, values in columns.items()}, **constants))
            except Exception as problem:  # noqa: BLE001 - stored with the point
                errors[k] = problem
            times[k] = time.perf_counter() - begin
        results: dict[str, Any] = {ERROR: errors, WALL_TIME: times}
        if rows:
            # A point that failed has the results of any other, which are not looked at.
            ends = iter(rows)
            every = [next(ends) if error is None else rows[0] for error in errors]
            if not isinstance(rows[0], Mapping):
                return results | {VALUE: every}
            names = dict.fromkeys(name for row in rows for name in row)
            results |= {name: [row.get(name, ABSENT) for row in every] for name in names}
            results[ERROR] = [own or other for own, other in zip(errors, results[ERROR], strict=True)]
        return results


pointwise = Pointwise


class BatchSummary(NamedTuple):
    """A finished batch: number of points and failures, time in s, the first failure, and whether all are alike."""

    rows: int
    failed: int
    seconds: float
    first_failure: str
    alike: bool
    # None once it is written as a part.
    result: BatchResult | None


@dataclass(frozen=True, eq=False)
class Task:
    """Everything needed to compute a batch; `rerun(point)` gives a line that computes a point again.

    `functions` are the functions to call, with the names of the variables that each returns.
    """

    name: str
    functions: tuple[tuple[tuple[str, ...], Callable[..., Any]], ...]
    constants: Mapping[str, Any]
    variables: Mapping[str, Variable]
    shapes: Mapping[str, tuple[int, ...]]
    grid: Grid
    rerun: Callable[[Mapping[str, Any]], str] | None = None
    libraries: tuple[str, ...] = ()

    def run(self, index: NDArray[np.intp], problem: Exception | None = None) -> BatchSummary:
        """Compute the points at these indices of the grid; with a `problem`, the point has failed."""
        begin, points = time.perf_counter(), self.grid.points(index)
        result = self.compute(points) if problem is None else self._missing(points)
        if problem is not None:
            self._fail(result, points, 0, problem)
        failures, first, result.points = result.failures, "", index
        if failures:
            row = min(failures)
            first = ", ".join(f"{name} = {values[row]}" for name, values in points.items())
            first += f": {failures[row].error}"
        alike = len(failures) == len(result) and len({each.error for each in failures.values()}) == 1
        return BatchSummary(len(result), len(failures), time.perf_counter() - begin, first, alike, result)

    def compute(self, points: Points) -> BatchResult:
        """Compute a batch; if it raises as a whole, compute its halves, down to the failing points."""
        result = self._missing(points)
        with one_blas_thread():
            self._fill(result, points, 0, len(result))
        return result

    def _missing(self, points: Points) -> BatchResult:
        count = len(next(iter(points.values())))
        values = {k: v.stored.absent((count, *self.shapes[k])) for k, v in self.variables.items()}
        return BatchResult(values, np.zeros(count), environment=environment(self.libraries))

    def _fill(self, result: BatchResult, every: Points, begin: int, end: int) -> None:
        start = time.perf_counter()
        try:
            returned, errors, times = self._call({name: values[begin:end] for name, values in every.items()})
        except UndeclaredError:
            raise  # it is the sweep's fault, not a point's
        except (Exception, SystemExit) as problem:  # noqa: BLE001 - stored with the point
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
        for name, values in returned.items():
            result.values[name][begin:end] = values
        for row, error in enumerate(errors, begin):
            if error is not None:
                self._fail(result, every, row, error)

    def _fail(self, result: BatchResult, every: Points, row: int, problem: BaseException) -> None:
        frames = [f for f in traceback.extract_tb(problem.__traceback__) if f.filename != __file__]
        lines = traceback.format_list(frames) or ["(raised by the sweep engine)\n"]
        try:
            text = str(problem)
        except Exception:  # noqa: BLE001 - the point has failed all the same
            text = "(its message cannot be read)"
        error = _writable(f"{type(problem).__name__}: {text}" if text else type(problem).__name__)
        shortened = error if len(error) <= MOST_CHARACTERS else f"{error[: MOST_CHARACTERS - 3]}..."
        point = {name: values[row].item() for name, values in every.items()}
        again = "" if self.rerun is None else self.rerun(point)
        result.failures[row] = Failure(shortened, _writable("".join([*lines, error])), _writable(again))
        for name, values in result.values.items():
            values[row] = self.variables[name].stored.missing

    def _call(self, points: Points) -> tuple[dict[str, Any], list[Any], Any]:
        """Stored results, the error of each point or None, and computing times if the functions return them."""
        calls = [self._called(names, function, points) for names, function in self.functions]
        every = {name: values for results, *_ in calls for name, values in results.items()}
        errors = [
            next((e for e in each if e is not None), None) for each in zip(*(c[1] for c in calls), strict=True)
        ]
        times = [spent for *_, spent in calls if spent is not None]
        return every, errors, sum(times) if times else None

    def _called(
        self, names: tuple[str, ...], function: Callable[..., Any], points: Points
    ) -> tuple[dict[str, Any], list[Any], Any]:
        count, who = len(next(iter(points.values()))), f"the function of sweep {self.name} returned"
        returned = function(points, **self.constants)
        if not isinstance(returned, Mapping):
            returned = {VALUE: returned}
        if len(names) == 1 and VALUE in returned:
            returned = dict(returned)
            returned.setdefault(names[0], returned.pop(VALUE))
        self._check_declared(returned, names)
        errors = [None] * count if returned.get(ERROR) is None else list(returned[ERROR])
        for error in errors:
            if not (error is None or isinstance(error, Exception)):
                raise TypeError(f"{who} the {ERROR} {error!r}; it must be an exception or None")
        times = None if returned.get(WALL_TIME) is None else np.asarray(returned[WALL_TIME], dtype=float)
        if len(errors) != count:
            raise ValueError(f"{who} {len(errors)} of {ERROR!r}; it must be one a point, {count}")
        if times is not None and times.shape != (count,):
            raise ValueError(f"{who} {WALL_TIME!r} of shape {times.shape}; it must be ({count},)")
        results: dict[str, Any] = {}
        for name in names if None in errors else ():
            variable = self.variables[name]
            if name not in returned:
                raise KeyError(f"{who} no {name!r}")
            values, expected = np.asarray(returned[name]), (count, *self.shapes[name])
            if values.shape != expected:
                raise ValueError(f"{who} {name!r} of shape {values.shape}; it must be {expected}")
            if variable.dtype == "str":
                # An array of texts and NaN would have the text "nan".
                texts = np.asarray(returned[name], dtype=object)
                results[name] = np.array([*map(_text, texts.flat)], dtype=object).reshape(expected)
                continue
            if not fits(values, np.dtype(variable.dtype)):
                other = f"; it may be declared as {how}" if (how := declaration(values)) else ""
                other = "; return its real and its imaginary part" if values.dtype.kind == "c" else other
                raise ValueError(
                    f"{who} {name!r} of type {values.dtype}, which does not fit {variable.dtype}{other}"
                )
            results[name] = rounded(values.astype(variable.stored.dtype, copy=False), variable.digits)
        return results, errors, times

    def _check_declared(self, returned: Mapping[str, Any], names: tuple[str, ...]) -> None:
        """Refuse undeclared results, which would be lost without a message."""
        for name in (each for each in returned if each not in (*names, ERROR, WALL_TIME)):
            what = f"{name!r}, which is not one of its variables, {', '.join(names)}"
            how = f"declare it, as {name!r}: {declaration(_present(returned[name])) or 'Variable(...)'}"
            raise UndeclaredError(f"the function of sweep {self.name} returned {what}; {how}, or do not return it")


def fits(values: NDArray[Any], dtype: np.dtype[Any]) -> bool:
    """Whether a type stores the values without loss, except for digits of floats."""
    kind = values.dtype.kind
    if dtype.kind == "U":
        return is_text(values)
    if dtype.kind == "b" or kind not in "biuf":
        return dtype.kind == kind == "b"
    if dtype.kind == kind == "f":
        return not np.any(np.isfinite(values) & (np.abs(values) > np.finfo(dtype).max))
    # Beyond 2^53 a float, as which readers get integers, too, loses digits.
    least, most = -(2**53), 2**53
    if dtype.kind == "i":
        # The two least integers mark missing and lost ones.
        least, most = max(least, np.iinfo(dtype).min + 2), min(most, np.iinfo(dtype).max)
    return bool(np.all((values >= least) & (values <= most) & (values == np.rint(values))))


def _present(values: Any) -> NDArray[Any]:
    """The first value that is not missing."""
    rows = values if isinstance(values, (list, np.ndarray)) else [values]
    return np.asarray([each for each in rows if each is not None and each is not ABSENT][:1])


def declaration(values: NDArray[Any]) -> str:
    """The declaration of a variable with these values; "" if no type fits."""
    kinds = {"b": "bool", "i": "int64", "u": "int64", "f": "float64", "U": "str"}
    dtype = kinds.get("U" if is_text(values) else values.dtype.kind, "")
    options = [f"dtype={dtype!r}"] * (dtype != "float64") + ["dims=..."] * (values.ndim > 1)
    return f"Variable({', '.join(options)})" if dtype and fits(values, np.dtype(dtype)) else ""


def _text(value: Any) -> str:
    """The stored form of a text, "" if it is missing."""
    if isinstance(value, str):
        return _writable(str(value))
    if value is None or value != value:
        return ""
    raise TypeError(f"a result {value!r}: it must be text, or None where there is none")


class _Blas:
    """Number of batches in computation in this process, and their limit of BLAS to one thread."""

    lock, batches, limit = threading.Lock(), 0, cast(Any, None)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread in this process, until the last user of this context leaves it.

    More threads would compete with each other, and the bits of a result may depend on their number.
    """
    # From its version 3.8 on, threadpoolctl ignores all threads but the first that sets a limit, as long as that
    # lives; so each setting has a short-lived thread of its own.
    with _Blas.lock:
        _Blas.batches += 1
        if _Blas.batches == 1:
            with ThreadPoolExecutor(1) as setter:
                _Blas.limit = setter.submit(threadpool_limits, 1, "blas").result()
    try:
        yield
    finally:
        with _Blas.lock:
            _Blas.batches -= 1
            if not _Blas.batches:
                with ThreadPoolExecutor(1) as setter:
                    setter.submit(_Blas.limit.restore_original_limits)


def _writable(text: str) -> str:
    """A text with escapes for what a file cannot store: invalid UTF-8 and NUL."""
    return text.replace("\0", "\\0").encode("utf-8", "backslashreplace").decode("utf-8")
