"""Batches on threads of this process, or one after the other; and what every back end does to a batch."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from dask.local import SynchronousExecutor
from numpy.typing import NDArray

from sweeps.compute.batch import BatchResult, Task
from sweeps.errors import SchedulerError
from sweeps.fingerprint.provenance import Environment, environment, mixed
from sweeps.grid import Grid
from sweeps.storage.parts import encode


class Receipt(NamedTuple):
    """A finished batch: its rows, those of them that failed, and its wall-clock time, s."""

    rows: int
    failed: int
    seconds: float
    # Where and why the first point failed that did.
    first_failure: str = ""
    # The part, where it is still to be written; without a store the result itself.
    content: bytes | None = None
    result: BatchResult | None = None


class WorkerDied(Exception):  # noqa: N818 - it is no error of the run
    """A worker died while it had the batch."""


@dataclass(frozen=True, eq=False)
class Job:
    """The task of a back end and the points of the grid that its batches take."""

    task: Task
    grid: Grid
    # Token of the manifest that parts name; "" where there is no store, and results stay in memory.
    manifest: str
    # The only environment in which to compute; None: any.
    only: Environment | None = None

    def compute(self, points: NDArray[np.intp]) -> Receipt:
        """Compute a batch; its part is in the receipt."""
        if self.only is not None and (other := mixed([self.only, environment()])):
            raise SchedulerError(f"a worker joined whose environment is another ({other})")
        begin = time.perf_counter()
        result = self.task.compute(self.grid.points(points))
        return self.receipt(points, result, time.perf_counter() - begin)

    def receipt(self, points: NDArray[np.intp], result: BatchResult, seconds: float) -> Receipt:
        """The receipt of a batch that has this result."""
        first = ""
        if result.failures:
            row = min(result.failures)
            where = ", ".join(f"{name} = {each[0]}" for name, each in self.grid.points(points[[row]]).items())
            first = f"{where}: {result.failures[row].error}"
        receipt = Receipt(len(result), len(result.failures), seconds, first)
        if not self.manifest:
            return receipt._replace(result=result)
        return receipt._replace(content=encode(result, points, self.task.variables, self.manifest))


class Local:
    """Threads of this process, or with `workers` None this thread; `compute(name, points)` gives a receipt."""

    # Batches handed out for each worker at most: one to work on, one waiting.
    window = 2

    def __init__(self, compute: Callable[[str, NDArray[np.intp]], Receipt], workers: int | None) -> None:
        self._compute, self.workers = compute, workers or 1
        self._pool: Executor = SynchronousExecutor() if workers is None else ThreadPoolExecutor(workers)

    def __enter__(self) -> Local:
        return self

    def __exit__(self, kind: type[BaseException] | None, *problem: Any) -> None:
        """Let threads finish what they have begun, for they cannot be ended; after an interrupt give them up."""
        abandoned = kind is not None and issubclass(kind, KeyboardInterrupt)
        self._pool.shutdown(wait=not abandoned, cancel_futures=True)

    def check(self) -> None:
        """Threads are always there."""

    def room(self, window: int, under_way: int) -> int:
        """How many batches to hand out now, so that there are at most so many for each worker."""
        return self.workers * window - under_way

    def submit(self, names: list[str], batches: list[NDArray[np.intp]], alone: bool = False) -> list[Future[Any]]:
        """Have batches computed and kept as the parts of these names."""
        return [self._pool.submit(self._compute, *each) for each in zip(names, batches, strict=True)]

    def halt(self) -> None:
        """Begin no more batches."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def isolate(self, last: bool) -> bool:
        """Nothing dies here without the whole process."""
        return False
