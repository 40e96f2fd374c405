"""What every back end does to a batch, and those of this process: threads, or one batch after the other."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from sweeps.compute.batch import BatchResult, Task
from sweeps.errors import AbandonedError
from sweeps.grid import Grid, Points
from sweeps.storage.parts import PartFolder, encode

# Batches handed out for each thread: one to work on, one waiting.
WINDOW = 2
# Seconds between looks at whether to stop.
TICK = 0.25


class Receipt(NamedTuple):
    """What comes of a batch.

    Attributes
    ----------
    rows, failed : int
    seconds : float
        Wall-clock time.
    first_failure : str
        Where and why the first point failed that did.
    content : bytes or None
        The part, where the worker did not write it itself.
    result : BatchResult or None
        Where there is no store.
    """

    rows: int
    failed: int
    seconds: float
    first_failure: str = ""
    content: bytes | None = None
    result: BatchResult | None = None


@dataclass(frozen=True, eq=False)
class Job:
    """What a back end does to every batch of points.

    Attributes
    ----------
    task : Task
    grid : Grid
        Of which batches are points.
    manifest : str
        Token of the manifest that parts name; "" where there is no store, and results stay in memory.
    """

    task: Task
    grid: Grid
    manifest: str


class Died(NamedTuple):
    """A worker died while it had the batch."""


# A receipt; or an exception that ends the run; or None for a batch that was taken back before it was begun.
Outcome = Receipt | Died | BaseException | None


def perform(job: Job, points: NDArray[np.intp]) -> Receipt:
    """Compute a batch; where there is a store its part is in the receipt, and still to be written."""
    begin = time.perf_counter()
    values = job.grid.points(points)
    with one_blas_thread():
        result = job.task.compute(values)
    return receipt_of(job, points, values, result, time.perf_counter() - begin)


def receipt_of(job: Job, points: NDArray[np.intp], values: Points, result: BatchResult, seconds: float) -> Receipt:
    """The receipt of a batch, with its part's content or the result itself."""
    first = ""
    if result.failures:
        row = min(result.failures)
        where = ", ".join(f"{name} = {each[row]}" for name, each in values.items())
        first = f"{where}: {result.failures[row].error}"
    receipt = Receipt(len(result), len(result.failures), seconds, first)
    if not job.manifest:
        return receipt._replace(result=result)
    return receipt._replace(content=encode(result, points, job.task.variables, job.manifest))


class _Limit:
    """How many batches compute in this process, and what holds BLAS to one thread meanwhile."""

    lock = threading.Lock()
    count = 0
    held: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """One BLAS thread for all of this process, until the last that asks for it has done.

    More would compete with each other, and the bits of a result may depend on their number. A limit belongs to the
    process: whoever ended first would take it from those that still compute.
    """
    with _Limit.lock:
        if not _Limit.count:
            _Limit.held = threadpool_limits(1, user_api="blas")
        _Limit.count += 1
    try:
        yield
    finally:
        with _Limit.lock:
            _Limit.count -= 1
            if not _Limit.count:
                _Limit.held.restore_original_limits()


class _Inline(Executor):
    """Computes a batch when it is submitted."""

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, **options))
        except Exception as problem:  # noqa: BLE001 - raised by whoever asks for the result
            future.set_exception(problem)
        return future


class Local:
    """Threads of this process, or with `workers` None this thread.

    Parameters
    ----------
    job : Job
    folder : PartFolder, optional
        Where parts go.
    workers : int, optional
    """

    def __init__(self, job: Job, folder: PartFolder | None, workers: int | None) -> None:
        self.job, self.folder, self.workers = job, folder, workers or 1
        self._pool: Executor = _Inline() if workers is None else ThreadPoolExecutor(workers)
        self._queued = workers is not None
        self._open: set[Future[Receipt]] = set()
        self._done: SimpleQueue[Future[Receipt]] = SimpleQueue()

    def __enter__(self) -> Local:
        self._limit = one_blas_thread()
        self._limit.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._limit.__exit__(kind, problem, trace)
        if isinstance(problem, KeyboardInterrupt) and any(future.running() for future in self._open):
            raise AbandonedError from None

    def room(self, window: int) -> int:
        """How many batches may be handed out at a time, so many for each worker."""
        return self.workers * (window if self._queued else 1)

    def submit(self, name: str, points: NDArray[np.intp], alone: bool = False) -> Future[Receipt]:
        """Have a batch computed and kept as the part of that name."""
        future = self._pool.submit(self._compute, name, points)
        self._open.add(future)
        future.add_done_callback(self._done.put)
        return future

    def _compute(self, name: str, points: NDArray[np.intp]) -> Receipt:
        receipt = perform(self.job, points)
        if self.folder is not None and receipt.content is not None:
            self.folder.put(name, receipt.content)
        return receipt._replace(content=None)

    def arrived(self) -> list[tuple[Future[Receipt], Outcome]]:
        """What has come of batches meanwhile; waits a moment where there is nothing."""
        futures: list[Future[Receipt]] = []
        with suppress(Empty):
            futures.append(self._done.get(timeout=TICK))
            while True:
                futures.append(self._done.get_nowait())
        self._open.difference_update(futures)
        return [(future, _outcome(future)) for future in futures]

    def halt(self) -> None:
        """Begin no more batches."""
        for future in list(self._open):
            future.cancel()

    def isolate(self, last: bool) -> bool:
        """Nothing dies here without the whole process."""
        return False


def _outcome(future: Future[Receipt]) -> Outcome:
    try:
        return future.result()
    except CancelledError:
        return None
    except BaseException as problem:  # noqa: BLE001 - raised by the loop, which keeps what else has arrived first
        return problem
