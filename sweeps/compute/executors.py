"""Executors of `concurrent.futures` as back ends: the common protocol by which a run computes its batches.

A task travels to other processes as bytes, and each process unpacks it once. A process that sees the folder of the
parts, which a file with the run's name proves, writes its parts itself; the results of others are sent back.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent import futures
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any
from uuid import uuid4

import cloudpickle  # type: ignore[import-untyped]
import numpy as np
from dask.local import SynchronousExecutor
from numpy.typing import NDArray

from sweeps.errors import ClusterLostError, InputError, SchedulerError, UndeclaredError, WorkerDied, message
from sweeps.fingerprint.code import digests, settle
from sweeps.fingerprint.modules import by_value
from sweeps.fingerprint.provenance import environment
from sweeps.storage.parts import PartWriter
from sweeps.task import BatchSummary, Task

LOCAL = ("threads", "sync", "processes")
MOST_PROCESSES = 61  # of Windows
KINDS = (
    "'threads', 'sync', 'processes', an address like tcp://host:8786, a Dask client or cluster, an executor of "
    "concurrent.futures, or a function that makes one"
)
GUARD = "a program must do this under if __name__ == '__main__', for every worker imports it"

Points = NDArray[np.intp] | range
Compute = Callable[[str, Points], BatchSummary | None]


def check_backend(scheduler: Any, workers: int | None) -> None:
    """Raise a `SchedulerError` for a scheduler that `Plan.run` does not accept."""
    known = isinstance(scheduler, str) and (scheduler in LOCAL or "://" in scheduler)
    if not (known or is_pool(scheduler) or hasattr(scheduler, "scheduler_info")):
        raise SchedulerError(f"scheduler = {scheduler!r}: it must be {KINDS}")
    whole = isinstance(workers, (int, np.integer)) and not isinstance(workers, bool)
    if workers is not None and not (whole and workers >= 1):
        raise SchedulerError(f"workers = {workers!r}: it must be an integer, 1 or above")
    # A worker imports the program that started it: the run belongs to that program, which reports this.
    starts = scheduler == "processes" if isinstance(scheduler, str) else is_pool(scheduler)
    if starts and getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)


def is_pool(scheduler: Any) -> bool:
    """Whether an object is an executor, or creates executors."""
    return isinstance(scheduler, Executor) or callable(scheduler)


class Backend(AbstractContextManager["Backend"]):
    """An executor with a number of `workers`, here threads of this process; subclasses differ in the rest."""

    window = 2  # submitted batches for each worker at most: one to work on, one that waits

    def __init__(self, executor: Executor, workers: int, compute: Compute, *, own: bool = True) -> None:
        self.executor, self.workers, self._compute, self.own = executor, workers, compute, own
        self._futures = set[Future[Any]]()

    def __exit__(self, kind: type[BaseException] | None, *problem: Any) -> None:
        """Shut down an executor of our own; wait for threads, which cannot be ended, or abandon them."""
        self.halt()
        if self.own:
            self.executor.shutdown(wait=kind is None or not issubclass(kind, KeyboardInterrupt))

    def environments(self, libraries: tuple[str, ...]) -> list[dict[str, str]]:
        """The environments of the workers, as far as they are known."""
        return [environment(libraries)]

    def check(self) -> None:
        """Count the workers; a ClusterLostError if none is left."""

    def submit(self, name: str, points: NDArray[np.intp]) -> Future[BatchSummary | None]:
        """Compute a batch, and store it as the part `name`."""
        every = range(int(points[0]), int(points[0]) + len(points))
        sent = every if np.array_equal(points, np.arange(every.start, every.stop)) else points
        future = self.executor.submit(self._compute, name, sent)
        self._futures.add(future)
        future.add_done_callback(self._futures.discard)
        return future

    def result(self, future: Future[Any]) -> Any:
        """The summary of a finished batch; None or a CancelledError if it has not begun."""
        return future.result()

    def halt(self) -> None:
        """Begin no more batches."""
        for future in [*self._futures]:
            future.cancel()


def threads(scheduler: Any, workers: int, compute: Compute) -> Backend:
    """Threads of this process: new ones, those of an executor, or this thread alone."""
    if isinstance(scheduler, Executor):
        return Backend(scheduler, _size(scheduler), compute, own=False)
    if scheduler == "sync":
        return Backend(SynchronousExecutor(), 1, compute)
    return Backend(futures.ThreadPoolExecutor(workers), workers, compute)


class Processes(futures.ProcessPoolExecutor):
    """Processes of this machine, which ignore Ctrl-C of a terminal from their start."""

    def __init__(self, workers: int) -> None:
        if multiprocessing.current_process().daemon:
            raise SchedulerError("scheduler = 'processes': a worker cannot start workers; use threads")
        super().__init__(min(workers, MOST_PROCESSES), multiprocessing.get_context("spawn"))

    def submit(self, *call: Any, **options: Any) -> Future[Any]:
        """Submit a call, for which a new process may start."""
        if os.name == "nt":
            return super().submit(*call, **options)
        # Python's tracker of resources unblocks all signals when it starts; so it starts before.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            return super().submit(*call, **options)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Pool(Backend):
    """Workers of any other executor, or processes of this machine; a factory replaces workers that die."""

    def __init__(self, scheduler: Any, workers: int, payload: "Payload") -> None:
        own = not isinstance(scheduler, Executor)
        self._make = partial(Processes, workers) if scheduler == "processes" else scheduler
        executor = self._made() if own else scheduler
        super().__init__(executor, _size(executor), payload.compute, own=own)
        self._payload, self.name = payload, type(executor).__name__

    def _made(self) -> Executor:
        executor = self._make()
        if not isinstance(executor, Executor):
            raise SchedulerError(f"scheduler = {self._make!r}: it made {executor!r}; it must make an executor")
        return executor

    def __exit__(self, kind: type[BaseException] | None, *problem: Any) -> None:
        """Shut down an executor of our own, and end its workers if the run is lost."""
        self.halt()
        if self.own:
            for process in [*(getattr(self.executor, "_processes", None) or {}).values()] if kind else ():
                process.kill()
            self.executor.shutdown(wait=kind is None)

    def environments(self, libraries: tuple[str, ...]) -> list[dict[str, str]]:
        """The environment of one worker, which proves that workers can compute; batches bring the others."""
        try:
            return [self.result(self.executor.submit(self._payload.environment, libraries))]
        except (WorkerDied, RuntimeError):
            raise SchedulerError(f"{self.name} has no workers that live; {GUARD}") from None

    def submit(self, name: str, points: NDArray[np.intp]) -> Future[BatchSummary | None]:
        """Compute a batch, on new workers if the others are gone."""
        try:
            return super().submit(name, points)
        except RuntimeError:  # it is broken, or somebody has shut it down
            if not self.own:
                raise self._lost() from None
            self.__exit__(WorkerDied)
            self.executor = self._made()
            return super().submit(name, points)

    def result(self, future: Future[Any]) -> Any:
        """The summary of a finished batch."""
        try:
            return future.result()
        except (futures.CancelledError, UndeclaredError):
            raise
        except futures.BrokenExecutor:
            raise WorkerDied if self.own else self._lost() from None
        except Exception as problem:  # noqa: BLE001 - workers may lack anything
            raise SchedulerError(f"the workers cannot compute this: {message(problem)}") from None

    def _lost(self) -> ClusterLostError:
        kept = "the same run continues from what is stored; " * (self._payload.probe is not None)
        advice = "a function that makes such executors isolates the point that kills them"
        return ClusterLostError(f"{self.name} is broken, since a worker died; {kept}{advice}")


def _size(executor: Any) -> int:
    counts = (getattr(executor, name, None) for name in ("_max_workers", "max_workers"))
    return next((each for each in counts if isinstance(each, int) and each > 0), os.cpu_count() or 1)


@dataclass(frozen=True)
class Payload:
    """The task and the folder of a run, for other processes; its `name` is unique."""

    name: str
    content: bytes = field(compare=False, repr=False)
    # Workers that see this file see the folder of the parts.
    probe: Path | None = field(compare=False)
    client: int = field(compare=False, default_factory=os.getpid)

    @classmethod
    def of(cls, task: Task, code: tuple[str | Path, ...], writer: PartWriter | None) -> "Payload":
        """Pack a task; a SchedulerError if it cannot be sent to other processes."""
        name = f"sweeps-{uuid4().hex}"
        names = [each for each in code if isinstance(each, str)]
        # What travels with the function cannot differ there.
        travels, expected = by_value(), dict[str, str]()
        with suppress(InputError):  # it cannot be compared; then nothing of it is stored
            every = digests([each for _, each in task.functions], names)
            expected = {home: each for home, each in every.items() if home not in travels}
        token = "" if writer is None else writer.token
        try:
            content = cloudpickle.dumps((task, names, expected, token))
        except Exception as problem:  # noqa: BLE001 - any object may refuse in its own way
            who = f"the function of sweep {task.name}"
            raise SchedulerError(f"{who} cannot be sent to other processes: {problem}") from None
        return cls(name, content, None if writer is None else writer.folder / f".{name}.probe")

    @contextmanager
    def offered(self) -> Iterator[None]:
        """Mark the folder of the parts as this run's while the context lasts."""
        try:
            with suppress(OSError):
                if self.probe is not None:
                    self.probe.write_text(self.name)
            yield
        finally:
            if self.probe is not None:
                self.probe.unlink(missing_ok=True)

    def is_seen(self) -> bool:
        """Whether this process sees the folder of the parts, and the run continues."""
        return self.probe is not None and os.path.exists(self.probe)

    def compute(self, name: str, points: Points) -> BatchSummary:
        """Compute a batch in a worker, and write its part if possible."""
        task, writer = _unpacked(self)
        summary = task.run(np.asarray(points))
        if writer is not None and summary.result is not None and self.is_seen():
            # If writing fails here, it may succeed where the client is.
            with suppress(OSError):
                writer.write(name, summary.result)
                summary = summary._replace(result=None)
        return summary

    def environment(self, libraries: tuple[str, ...]) -> dict[str, str]:
        """The environment of this worker, if it can compute the task."""
        _unpacked(self)
        return environment(libraries)


# Function, declared code and digests of the last task that was unpacked here.
_seen: list[tuple[list[Any], list[str], dict[str, str]]] = []


@lru_cache(maxsize=2)
def _unpacked(payload: Payload) -> tuple[Task, PartWriter | None]:
    """The task, if this worker has the client's code, and the writer of parts, if it sees their folder."""
    task, names, expected, token = cloudpickle.loads(payload.content)
    # What the code of the last run has changed, such as a cache, counts as it was before.
    for earlier, code, before in _seen:
        settle(before, digests(earlier, code))
    functions = [each for _, each in task.functions]
    here = digests(functions, names) if expected else {}
    if {home: here.get(home) for home in expected} != expected:
        raise InputError("this worker has another version of the code; install the same one everywhere")
    _seen[:] = [(functions, names, here)]
    if os.getpid() != payload.client and threading.current_thread() is threading.main_thread():
        # A terminal sends Ctrl-C to all processes; the client's decides which batches are finished.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if payload.probe is None or not payload.is_seen():
        return task, None
    return task, PartWriter(payload.probe.parent, task.variables, token, goes_on=payload.is_seen)
