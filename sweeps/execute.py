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


def execute(plan: Plan, scheduler: str, workers: int, progress: Progress | None) -> Outcome:
    """Compute every batch of the plan and spread the results to the copies."""
    sweep, size = plan.sweep, plan.points
    points = sweep.grid.points()
    outcome = Outcome(
        {
            name: np.full((size, *_inner_shape(sweep, name)), variable.missing, dtype=variable.dtype)
            for name, variable in sweep.variables.items()
        },
        np.full(size, PENDING, dtype=np.int8),
        np.full(size, "", dtype=object),
        np.full(size, np.nan),
    )
    lock = threading.Lock()

    def one(batch: NDArray[np.intp]) -> None:
        failed = _batch(sweep, points, batch, outcome)
        if progress is not None:
            with lock:
                progress(len(batch), failed)

    tasks = [delayed(one, pure=False)(batch) for batch in plan.batches]
    if scheduler == "sync":
        compute(*tasks, scheduler="synchronous")
    else:
        compute(*tasks, scheduler="threads", num_workers=workers)

    copied = plan.original >= 0
    source = plan.original[copied]
    for array in (*outcome.values.values(), outcome.status, outcome.error, outcome.wall_time):
        array[copied] = array[source]
    # A copy costs nothing.
    outcome.wall_time[np.nonzero(copied)[0][np.nonzero(copied)[0] != source]] = 0.0
    outcome.status[~copied] = SKIPPED
    return outcome


def _batch(sweep: Sweep, points: Points, batch: NDArray[np.intp], outcome: Outcome) -> int:
    """Compute one batch in place; if it raises, its points one by one. Returns how many failed."""
    start = time.perf_counter()
    try:
        results = _call(sweep, points, batch)
    except Exception as problem:  # noqa: BLE001 - whatever a point raises is kept as its outcome
        if len(batch) > 1:
            return sum(_batch(sweep, points, batch[i : i + 1], outcome) for i in range(len(batch)))
        outcome.status[batch] = FAILED
        outcome.error[batch] = f"{type(problem).__name__}: {problem}"
        outcome.wall_time[batch] = time.perf_counter() - start
        return 1
    for name, values in results.items():
        outcome.values[name][batch] = values
    outcome.status[batch] = DONE
    outcome.wall_time[batch] = (time.perf_counter() - start) / len(batch)
    return 0


def _call(sweep: Sweep, points: Points, batch: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
    given = sweep.function({name: values[batch] for name, values in points.items()}, **sweep.constants)
    results = {}
    for name in sweep.variables:
        if name not in given:
            raise KeyError(f"the function of sweep {sweep.name} returned no {name!r}")
        values, expected = np.asarray(given[name]), (len(batch), *_inner_shape(sweep, name))
        if values.shape != expected:
            raise ValueError(
                f"the function of sweep {sweep.name} returned {name!r} of shape {values.shape}; "
                f"it must be {expected}"
            )
        results[name] = values
    return results


def _inner_shape(sweep: Sweep, name: str) -> tuple[int, ...]:
    return tuple(len(sweep.coords[dim]) for dim in sweep.variables[name].dims)
