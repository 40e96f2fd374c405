"""From batches to arrays, on Dask's threads. A point that fails is kept apart; the others go on."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from dask.base import compute
from dask.delayed import delayed
from numpy.typing import NDArray

from sweeps.grid import Points

if TYPE_CHECKING:
    from sweeps.plan import Plan, Progress
    from sweeps.sweep import Sweep

PENDING, DONE, FAILED, SKIPPED = range(4)
STATUS_MEANINGS = "pending done failed skipped"


@dataclass(eq=False)
class Outcome:
    """One entry a point of the grid."""

    values: dict[str, NDArray[Any]]
    status: NDArray[np.int8]
    error: NDArray[np.object_]
    wall_time: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Part:
    """What became of some points."""

    index: NDArray[np.intp]
    values: dict[str, NDArray[Any]] | None
    error: str
    seconds: float


def execute(plan: Plan, scheduler: str, workers: int, progress: Progress | None) -> Outcome:
    """Compute every batch of the plan and spread the results to the copies."""
    sweep, size = plan.sweep, plan.points
    points = sweep.grid.points()
    lock = threading.Lock()

    def one(batch: NDArray[np.intp]) -> list[_Part]:
        parts = _batch(sweep, points, batch)
        if progress is not None:
            with lock:
                progress(len(batch), sum(len(part.index) for part in parts if part.values is None))
        return parts

    tasks = [delayed(one, pure=False)(batch) for batch in plan.batches]
    if scheduler == "sync":
        finished = compute(*tasks, scheduler="synchronous")
    else:
        finished = compute(*tasks, scheduler="threads", num_workers=workers)

    outcome = Outcome(
        {
            name: np.full((size, *_inner_shape(sweep, name)), variable.missing, dtype=variable.dtype)
            for name, variable in sweep.variables.items()
        },
        np.full(size, PENDING, dtype=np.int8),
        np.full(size, "", dtype=object),
        np.full(size, np.nan),
    )
    for part in (part for parts in finished for part in parts):
        for name, values in (part.values or {}).items():
            outcome.values[name][part.index] = values
        outcome.status[part.index] = FAILED if part.values is None else DONE
        outcome.error[part.index] = part.error
        outcome.wall_time[part.index] = part.seconds / len(part.index)

    copies = np.nonzero((plan.original >= 0) & (plan.original != np.arange(size)))[0]
    for array in (*outcome.values.values(), outcome.status, outcome.error):
        array[copies] = array[plan.original[copies]]
    outcome.wall_time[copies] = 0.0  # a copy costs nothing
    outcome.status[plan.original < 0] = SKIPPED
    return outcome


def _batch(sweep: Sweep, points: Points, batch: NDArray[np.intp]) -> list[_Part]:
    """Compute one batch; if it raises, its halves, down to the points that fail."""
    start = time.perf_counter()
    try:
        values = _call(sweep, points, batch)
    except Exception as problem:  # noqa: BLE001 - whatever a point raises is kept as its outcome
        if len(batch) > 1:
            middle = len(batch) // 2
            return _batch(sweep, points, batch[:middle]) + _batch(sweep, points, batch[middle:])
        error = f"{type(problem).__name__}: {problem}"
        return [_Part(batch, None, error, time.perf_counter() - start)]
    return [_Part(batch, values, "", time.perf_counter() - start)]


def _call(sweep: Sweep, points: Points, batch: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
    given = sweep.function({name: values[batch] for name, values in points.items()}, **sweep.constants)
    results = {}
    for name, variable in sweep.variables.items():
        if name not in given:
            raise KeyError(f"the function of sweep {sweep.name} returned no {name!r}")
        values, expected = np.asarray(given[name]), (len(batch), *_inner_shape(sweep, name))
        if values.shape != expected:
            raise ValueError(
                f"the function of sweep {sweep.name} returned {name!r} of shape {values.shape}; "
                f"it must be {expected}"
            )
        if not _fits(values, np.dtype(variable.dtype)):
            raise ValueError(
                f"the function of sweep {sweep.name} returned {name!r} of type {values.dtype}, "
                f"which does not fit {variable.dtype}"
            )
        results[name] = values.astype(variable.dtype)
    return results


def _fits(values: NDArray[Any], dtype: np.dtype[Any]) -> bool:
    """Whether nothing but digits of a float is lost."""
    if dtype.kind == "f":
        return values.dtype.kind in "biuf"
    if values.dtype.kind not in "biuf":
        return False
    # The least whole number means that there is none; beyond 2^53 a reader's float would lose digits.
    most = min(np.iinfo(dtype).max, 2**53)
    return bool(np.all((np.abs(values.astype(float)) <= most) & (values == np.rint(values))))


def _inner_shape(sweep: Sweep, name: str) -> tuple[int, ...]:
    return tuple(len(sweep.coords[dim]) for dim in sweep.variables[name].dims)
