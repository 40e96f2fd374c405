"""The execution of a plan: batches are computed, stored, and assembled. One loop serves all executors."""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import xarray as xr
from dask.local import SynchronousExecutor
from dask.system import CPU_COUNT
from numpy.typing import NDArray

from sweeps.errors import (
    AbandonedError,
    DamagedError,
    InputError,
    MixedWarning,
    SchedulerError,
    StoreError,
    SweepStoppedError,
    WorkerDied,
    reason,
)
from sweeps.fingerprint.code import check_loaded
from sweeps.fingerprint.identity import functions_of
from sweeps.fingerprint.provenance import Environment, environment, mixed
from sweeps.plan.batches import BatchSizes, Queue
from sweeps.plan.planning import ROW_BYTES, STRICT, PlanData, mixed_line, select
from sweeps.status import Monitor, Progress
from sweeps.storage.assemble import Source, Table, assemble, declared
from sweeps.storage.existing import opened
from sweeps.storage.netcdf import described, stored_only, write
from sweeps.storage.parts import PartSource, PartWriter, ResultSource
from sweeps.storage.store import Store
from sweeps.task import BatchSummary, one_blas_thread

LOCAL = ("threads", "sync", "processes")
# s between looks at whether to stop.
TICK = 0.25


def execute(
    plan: PlanData, scheduler: Any, workers: int | None, progress: Progress | None, fail_fast: bool
) -> tuple[xr.Dataset, tuple[Any, ...]]:
    """Run a plan; see `sweeps.Plan.run`. Returns the dataset and the new version of the store."""
    check_backend(scheduler, workers)
    if plan.store is None:
        table = _Run(plan, None, progress, fail_fast).compute(scheduler, workers)
        return declared(described(plan.manifest, assemble(table, lazy=False), plan.sweep.derive)), ()
    store = Store(plan.store)
    if plan.whole:
        _check_unchanged(plan, store)
        _tidy(store)
        return _requested(plan, store), store.version()
    with store.locked():
        _check_unchanged(plan, store)
        table = _Run(plan, store, progress, fail_fast).compute(scheduler, workers)
        try:
            if table.damaged:
                raise DamagedError(table.damaged[0], str(store.parts))
            write(store, table, plan.sweep.derive)
        except DamagedError as problem:
            # The next plan computes its points again.
            (store.parts / problem.part).unlink(missing_ok=True)
            raise
        store.clear()
    return _requested(plan, store), store.version()


def check_backend(scheduler: Any, workers: int | None) -> None:
    """Raise a `SchedulerError` unless the scheduler is one of those that `Plan.run` accepts."""
    known = isinstance(scheduler, str) and (scheduler in LOCAL or "://" in scheduler)
    if not known and not hasattr(scheduler, "scheduler_info"):
        raise SchedulerError(
            f"scheduler = {scheduler!r}: it must be 'threads', 'sync', 'processes', an address like "
            "tcp://host:8786, or a Dask client or cluster"
        )
    whole = isinstance(workers, (int, np.integer)) and not isinstance(workers, bool)
    if workers is not None and not (whole and workers >= 1):
        raise SchedulerError(f"workers = {workers!r}: it must be an integer, 1 or above")


def _check_unchanged(plan: PlanData, store: Store) -> None:
    if store.version() != plan.version:
        raise StoreError(f"{store.file} has changed since this was planned; plan again")


def _tidy(store: Store) -> None:
    """Remove the rest of a run that was killed when its file was complete."""
    if store.parts.exists():
        with suppress(StoreError), store.locked():
            if not store.manifest.exists():
                store.clear()


def _requested(plan: PlanData, store: Store) -> xr.Dataset:
    """Select the requested points of the file, in the order of the request."""
    try:
        data = opened(store.file)
    except ValueError as problem:
        raise StoreError(f"{problem}; move it away, or start over with fresh (--fresh)") from None
    if plan.alignment.identical:
        return declared(data)
    grid = plan.manifest.grid
    some = stored_only(plan.manifest, data).isel(dict(zip(grid.dims, plan.alignment.indexers, strict=True)))
    if "failure" in some.dims:
        inside = [some[f"failure_{name}"].isin(plan.sweep.grid.axes[name].values).values for name in grid.axes]
        own = np.logical_and.reduce(inside)
        some = some.isel(failure=own) if own.any() else some.drop_dims("failure")
    return declared(described(plan.manifest, some, plan.sweep.derive))


def _unwritten(store: Store, problem: BaseException, kept: int) -> str:
    """Report a failure to write, and whether anything is stored."""
    done = "what was finished is kept, and the same run goes on from there" if kept else "nothing was finished"
    return f"{store.file} could not be written: {reason(problem)}; {done}"


class _Local:
    """An executor of threads of this process; with `workers` None this thread."""

    # Submitted batches for each worker at most: one to work on, one that waits.
    window = 2

    def __init__(self, run: _Run, workers: int | None) -> None:
        self._run, self.workers = run, workers or 1
        self._pool: Executor = SynchronousExecutor() if workers is None else ThreadPoolExecutor(workers)

    def __enter__(self) -> _Local:
        return self

    def __exit__(self, kind: type[BaseException] | None, *problem: Any) -> None:
        """Wait for the threads, which cannot be ended; after an interrupt give them up."""
        abandoned = kind is not None and issubclass(kind, KeyboardInterrupt)
        self._pool.shutdown(wait=not abandoned, cancel_futures=True)

    def environments(self, libraries: tuple[str, ...]) -> list[dict[str, str]]:
        """That of this process."""
        return [environment(libraries)]

    def check(self) -> None:
        """Threads do not disappear."""

    def submit(self, name: str, points: NDArray[np.intp]) -> Future[Any]:
        """Compute a batch, and store it as the part `name`."""
        return self._pool.submit(lambda: self._run.write(name, points, self._run.plan.task.run(points)))

    def result(self, future: Future[Any]) -> BatchSummary | None:
        """The summary of a finished batch."""
        summary: BatchSummary | None = future.result()
        return summary

    def halt(self) -> None:
        """Begin no more batches."""
        self._pool.shutdown(wait=False, cancel_futures=True)


class _Run:
    """One execution of a plan's batches."""

    def __init__(self, plan: PlanData, store: Store | None, progress: Progress | None, fail_fast: bool) -> None:
        self.plan, self.store, self.fail_fast = plan, store, fail_fast
        self.sources: list[Source] = [each for each in plan.sources if each.name not in plan.damaged]
        self.writer = None
        if store is not None:
            last = ["", *store.part_names()][-1]
            self.writer = PartWriter(store.parts, plan.manifest.variables, plan.manifest.token, last)
        self.monitor = Monitor(plan.todo, progress, None if store is None else store.progress)
        row = sum(map(plan.manifest.row_bytes, plan.manifest.variables)) + ROW_BYTES
        self.sizes = BatchSizes(row, plan.sweep.batch_multiple)
        # Plain values: a signal's handler sets the flag, and must not wait for a lock.
        self.interrupted, self.failure, self.common_error = False, "", ""
        self.environments: list[Environment] = [*plan.environments]
        # Name and points of each submitted batch.
        self._submitted: dict[Future[Any], tuple[str, NDArray[np.intp]]] = {}
        self._done: SimpleQueue[Future[Any]] = SimpleQueue()
        # Batches whose worker died; they are computed one at a time, so that only the guilty one can be blamed.
        self._suspects: list[NDArray[np.intp]] = []
        # The first batch, of points from several places of the grid.
        self._first: NDArray[np.intp] | None = None

    def compute(self, scheduler: Any, workers: int | None) -> Table:
        """Compute every batch, of a refined sweep pass after pass; return the table of all results."""
        with self._interruptible():
            try:
                if self.plan.todo:
                    self._passes(scheduler, workers)
            except KeyboardInterrupt:
                if any(future.running() for future in self._submitted):
                    raise AbandonedError from None
                raise
            finally:
                # Threads that were given up write nothing from now on.
                if self.writer is not None:
                    self.writer.close()
                self.monitor.close()
        if self.common_error:
            if self.store is not None and not self.plan.sources:
                self.store.clear()
            raise SweepStoppedError(f"stopped, since the first points all failed alike: {self.common_error}")
        if self.failure and self.fail_fast:
            raise SweepStoppedError(f"stopped at the first failure: {self.failure}")
        if self.interrupted:
            raise KeyboardInterrupt
        table = Table(self.plan.manifest, self.sources)
        if late := [each for each in table.environments if each not in self.environments]:
            # Of workers that joined during the run.
            self._check_environments([*self.environments[:1], *late], strict=False)
        return table

    def _check_environments(self, environments: Sequence[Environment], *, strict: bool = True) -> None:
        """Warn of a mixture of environments, or refuse it if the plan is strict."""
        if different := mixed(environments):
            line = mixed_line(self.store, self.plan.sweep, different)
            if strict and self.plan.strict:
                raise InputError(f"{line}; {STRICT}")
            warnings.warn(line, MixedWarning, stacklevel=6)

    def _prepare(self) -> None:
        """Make the folder of parts, remove useless files from it, and write the manifest."""
        if (store := self.store) is None:
            return
        check_loaded(functions_of(self.plan.sweep), self.plan.sweep.code)
        useful = {source.name for source in self.sources}
        try:
            store.parts.mkdir(parents=True, exist_ok=True)
            # Temporary files of killed runs, damaged parts, and parts of another manifest.
            useless = [*store.parts.glob(".*.tmp")]
            for path in [*useless, *(store.parts / name for name in store.part_names() if name not in useful)]:
                path.unlink(missing_ok=True)
            self.plan.manifest.save(store)
        except (OSError, RuntimeError) as problem:
            raise StoreError(_unwritten(store, problem, self.plan.cached)) from problem

    def _passes(self, scheduler: Any, workers: int | None) -> None:
        plan, due = self.plan, self.plan.due
        most = plan.todo if plan.sweep.refinement is None else plan.points
        # Set for all batches here, since it takes a few milliseconds.
        with one_blas_thread(), self._executor(scheduler, min(workers or CPU_COUNT, most)) as executor:
            self.environments += executor.environments(plan.task.libraries)
            self._check_environments(self.environments)
            self._prepare()
            # A run that stops at a failure has no batches that wait behind one.
            window = 1 if self.fail_fast or scheduler == "sync" else executor.window
            while due.any():
                self._loop(due, executor, window)
                if plan.sweep.refinement is None or self._stopped():
                    return
                due = select(plan.sweep, plan.manifest, plan.alignment, plan.requested, self.sources)["due"]
                self.monitor.todo += int(np.count_nonzero(due))

    def _executor(self, scheduler: Any, workers: int) -> AbstractContextManager[Any]:
        if scheduler in ("threads", "sync"):
            return _Local(self, workers if scheduler == "threads" else None)
        # Imported here: it is slow, and few runs need it.
        from sweeps.compute.cluster import cluster

        return cluster(scheduler, workers, self.plan.task, tuple(self.plan.sweep.code), self.writer)

    def _loop(self, due: NDArray[np.bool_], executor: Any, window: int) -> None:
        """Submit batches as long as there are points, and collect their results."""
        queue = Queue(self.plan.manifest.grid, due, self.plan.sweep.order_by)
        if self._first is None:
            self._first = queue.take_spread(self.sizes.least)
            self._submit(executor, self._first)
        while (queue.left or self._suspects or self._submitted) and not self._stopped():
            if self._suspects and not queue.left and not self._submitted:
                self._submit(executor, self._suspects.pop())
            free = window * executor.workers - len(self._submitted)
            # A message to a cluster costs what a batch does, so half of the window is submitted at once.
            if window == 1 or 2 * free >= window * executor.workers:
                for _ in range(free):
                    if queue.left:
                        self._submit(executor, queue.take(self.sizes.next(queue.left, executor.workers)))
            self._collect(executor, queue.left)
        if self._submitted:
            executor.halt()
        while self._submitted:
            self._collect(executor, queue.left)

    def _submit(self, executor: Any, points: NDArray[np.intp]) -> None:
        name = "" if self.writer is None else self.writer.next_name()
        ends = self.plan.manifest.grid.points(points[[0, -1]])
        spans = [f"{n} = {_span(v[0].item(), v[1].item())}" for n, v in ends.items()]
        self.monitor.begin(int(points[0]), ", ".join(spans))
        future = executor.submit(name, points)
        self._submitted[future] = name, points
        future.add_done_callback(self._done.put)

    def _collect(self, executor: Any, left: int) -> None:
        """Take the result of a finished batch; wait a moment if there is none."""
        try:
            future = self._done.get(timeout=TICK)
        except Empty:
            executor.check()
            return
        name, points = self._submitted.pop(future)
        summary: BatchSummary | None = None
        try:
            summary = executor.result(future)
        except CancelledError:
            pass  # it was not begun
        except WorkerDied:
            summary = self._died(points)
        if summary is None:
            self.monitor.end(int(points[0]))
            return
        if points is self._first and left and summary.common_error:
            # Nothing is stored of it, so that the next run tries these points again.
            self.common_error = summary.first_failure
            if self.store is not None:
                (self.store.parts / name).unlink(missing_ok=True)
            self.monitor.end(int(points[0]), summary.rows, summary.failed)
            return
        self.sizes.finished(summary.rows, summary.seconds)
        self.failure = self.failure or summary.first_failure
        self.write(name, points, summary)
        if self.store is not None:
            self.sources.append(PartSource(self.store.parts / name))
        elif summary.result is not None:
            self.sources.append(ResultSource(points, summary.result))
        self.monitor.end(int(points[0]), summary.rows, summary.failed)

    def write(self, name: str, points: NDArray[np.intp], summary: BatchSummary) -> BatchSummary:
        """Write the part of a batch; return the summary without the result."""
        if self.writer is None or self.store is None or summary.result is None:
            return summary
        try:
            self.writer.write(name, points, summary.result)
        except (OSError, RuntimeError) as problem:
            kept = self.plan.cached + len(self.store.part_names())
            raise StoreError(_unwritten(self.store, problem, kept)) from problem
        return summary._replace(result=None)

    def _died(self, points: NDArray[np.intp]) -> BatchSummary | None:
        """Queue the halves of a batch whose worker died; a single point of which one died alone has failed."""
        alone = len(points) == 1 and not self._submitted
        if not alone:
            self._suspects += np.array_split(points, 2) if len(points) > 1 else [points]
            return None
        problem = RuntimeError("the process that computed this point died")
        task = self.plan.task
        return task.summary(points, task.failed(task.grid.points(points), problem), 0.0)

    def _stopped(self) -> bool:
        """Whether no more batches begin."""
        return self.interrupted or bool(self.common_error) or bool(self.fail_fast and self.failure)

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """The first interrupt lets the batches that have begun finish, the second stops at once."""
        main = threading.current_thread() is threading.main_thread()
        if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
            yield
            return

        def interrupt(number: int, frame: Any) -> None:
            if self.interrupted:
                raise KeyboardInterrupt
            self.interrupted = True
            self.monitor.stop()

        signal.signal(signal.SIGINT, interrupt)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _span(first: Any, last: Any) -> str:
    texts = [f"{value:g}" if isinstance(value, float) else str(value) for value in (first, last)]
    return texts[0] if first == last else " to ".join(texts)
