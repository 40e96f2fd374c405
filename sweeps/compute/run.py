"""The execution of a plan: one loop over batches, which are computed, stored and assembled."""

import signal
import threading
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import xarray as xr
from dask.local import SynchronousExecutor
from dask.system import CPU_COUNT
from numpy.typing import NDArray

from sweeps import errors
from sweeps.errors import DamagedError, SchedulerError, StoreError, SweepStoppedError, WorkerDied
from sweeps.fingerprint.code import check_loaded
from sweeps.fingerprint.identity import functions_of
from sweeps.fingerprint.provenance import Environment, environment
from sweeps.plan.batches import BatchSizes, Queue
from sweeps.plan.planning import ROW_BYTES, PlanData, mixture, select
from sweeps.status import Monitor, Progress
from sweeps.storage.assemble import Source, Table, assemble, restore_types
from sweeps.storage.existing import opened
from sweeps.storage.netcdf import described, write
from sweeps.storage.parts import BOOKKEEPING, PartSource, PartWriter
from sweeps.storage.store import Store
from sweeps.task import BatchSummary, one_blas_thread

LOCAL = ("threads", "sync", "processes")
# s between looks at whether to stop.
TICK = 0.1


def execute(
    plan: PlanData, scheduler: Any, workers: int | None, progress: Progress | None, fail_fast: bool
) -> tuple[xr.Dataset, tuple[Any, ...]]:
    """Run a plan; see `sweeps.Plan.run`. Returns the dataset and the new version of the store."""
    check_backend(scheduler, workers)
    if plan.store is None:
        table = _Run(plan, None, progress, fail_fast).compute(scheduler, workers)
        return restore_types(described(plan.manifest, assemble(table, lazy=False), plan.sweep.derive)), ()
    store = Store(plan.store)
    with nullcontext() if plan.whole else store.locked():
        if store.version() != plan.version:
            raise StoreError(f"{store.file} has changed since this was planned; plan again")
        if not plan.whole:
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
    if plan.whole and store.parts.exists():
        # They remain of a run that was killed when its file was complete; whoever releases the lock removes them.
        with suppress(StoreError), store.locked():
            pass
    return _requested(plan, store), store.version()


def check_backend(scheduler: Any, workers: int | None) -> None:
    """Raise a `SchedulerError` unless the scheduler is one of those that `Plan.run` accepts."""
    known = isinstance(scheduler, str) and (scheduler in LOCAL or "://" in scheduler)
    if not known and not hasattr(scheduler, "scheduler_info"):
        kinds = "'threads', 'sync', 'processes', an address like tcp://host:8786, or a Dask client or cluster"
        raise SchedulerError(f"scheduler = {scheduler!r}: it must be {kinds}")
    whole = isinstance(workers, (int, np.integer)) and not isinstance(workers, bool)
    if workers is not None and not (whole and workers >= 1):
        raise SchedulerError(f"workers = {workers!r}: it must be an integer, 1 or above")


def _requested(plan: PlanData, store: Store) -> xr.Dataset:
    try:
        data = opened(store.file)
    except ValueError as problem:
        raise StoreError(f"{problem}; move it away, or {errors.HINT_START_OVER}") from None
    if plan.alignment.identical:
        return restore_types(data)
    grid = plan.manifest.grid
    # The computed variables, without derived ones.
    own = [*plan.manifest.variables, *(name for name in BOOKKEEPING if name in data)]
    data = data[own + [name for name in data.data_vars if data[name].dims == ("failure",)]]
    some = data.isel(dict(zip(grid.dims, plan.alignment.indexers, strict=True)))
    if "failure" in some.dims:
        inside = [some[f"failure_{name}"].isin(plan.sweep.grid.axes[name].values).values for name in grid.axes]
        flags = np.logical_and.reduce(inside)
        some = some.isel(failure=flags) if flags.any() else some.drop_dims("failure")
    return restore_types(described(plan.manifest, some, plan.sweep.derive))


class _Local(AbstractContextManager["_Local"]):
    """An executor of threads of this process; with `workers` None this thread."""

    window = 2  # submitted batches for each worker at most: one to work on, one that waits

    def __init__(self, run: "_Run", workers: int | None) -> None:
        self._run, self.workers = run, workers or 1
        self._pool: Executor = SynchronousExecutor() if workers is None else ThreadPoolExecutor(workers)

    def __exit__(self, kind: type[BaseException] | None, *problem: Any) -> None:
        """Wait for the threads, which cannot be ended; after an interrupt give them up."""
        abandoned = kind is not None and issubclass(kind, KeyboardInterrupt)
        self._pool.shutdown(wait=not abandoned, cancel_futures=True)

    def environments(self, libraries: tuple[str, ...]) -> list[dict[str, str]]:
        return [environment(libraries)]

    def check(self) -> None:
        """Threads do not disappear."""

    def submit(self, name: str, points: NDArray[np.intp]) -> Future[BatchSummary]:
        return self._pool.submit(lambda: self._run.write(name, self._run.plan.task.run(points)))

    def result(self, future: Future[BatchSummary]) -> BatchSummary:
        return future.result()

    def halt(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)


class _Run:
    def __init__(self, plan: PlanData, store: Store | None, progress: Progress | None, fail_fast: bool) -> None:
        self.plan, self.store, self.fail_fast = plan, store, fail_fast
        self.sources: list[Source] = [each for each in plan.sources if each.name not in plan.damaged]
        self.writer = None
        if store is not None:
            last = ["", *store.part_names()][-1]
            self.writer = PartWriter(store.parts, plan.manifest.variables, plan.manifest.token, last)
        self.monitor = Monitor(plan.cached, plan.todo, progress, None if store is None else store.progress)
        row = sum(map(plan.manifest.row_bytes, plan.manifest.variables)) + ROW_BYTES
        self.sizes = BatchSizes(row)
        # Plain values: a signal's handler counts, and must not wait for a lock.
        self._waiting = False
        self.interrupts, self.failure, self.common_error = 0, "", ""
        self.environments: list[Environment] = [*plan.environments]
        # Name and points of each submitted batch.
        self._submitted: dict[Future[Any], tuple[str, NDArray[np.intp]]] = {}
        self._done: SimpleQueue[Future[Any]] = SimpleQueue()
        # Batches whose worker died; they are computed one at a time, so that only the guilty one can be blamed.
        self._suspects: list[NDArray[np.intp]] = []
        # The first batch, of points from several places of the grid.
        self._first: NDArray[np.intp] | None = None

    def compute(self, scheduler: Any, workers: int | None) -> Table:
        with self._interruptible():
            try:
                if self.plan.todo:
                    self._passes(scheduler, workers)
            except errors.UndeclaredError:
                if self.store is not None and not self.sources:
                    self.store.clear()
                raise
            except KeyboardInterrupt:
                if any(future.running() for future in self._submitted):
                    raise errors.AbandonedError from None
                raise
            finally:
                # Threads that were given up write nothing from now on.
                if self.writer is not None:
                    self.writer.close()
                self.monitor.write()
        if self.common_error:
            if self.store is not None and not self.plan.sources:
                self.store.clear()
            raise SweepStoppedError(f"stopped, since the first points all failed alike: {self.common_error}")
        if self.failure and self.fail_fast:
            raise SweepStoppedError(f"stopped at the first failure: {self.failure}")
        if self.interrupts:
            raise KeyboardInterrupt
        table = Table(self.plan.manifest, self.sources)
        if late := [each for each in table.environments if each not in self.environments]:
            # Of workers that joined during the run.
            self._check_environments([*self.environments[:1], *late], strict=False)
        return table

    def _check_environments(self, environments: Sequence[Environment], *, strict: bool = True) -> None:
        if line := mixture(self.plan.store or self.plan.sweep.name, environments, strict and self.plan.strict):
            warnings.warn(line, errors.MixedWarning, stacklevel=6)

    @contextmanager
    def _writing(self, store: Store) -> Iterator[None]:
        try:
            yield
        except (OSError, RuntimeError) as problem:
            kept = self.plan.cached or store.part_names()
            done = "finished points are kept; the same run continues" if kept else "nothing was finished"
            raise StoreError(f"{store.file} could not be written: {errors.reason(problem)}; {done}") from problem

    def _passes(self, scheduler: Any, workers: int | None) -> None:
        plan, due = self.plan, self.plan.due
        workers = min(workers or CPU_COUNT, plan.todo if plan.sweep.refinement is None else plan.points)
        if scheduler in ("threads", "sync"):
            backend: AbstractContextManager[Any] = _Local(self, workers if scheduler == "threads" else None)
        else:
            # Imported here: it is slow, and few runs need it.
            from sweeps.compute.cluster import cluster

            backend = cluster(scheduler, workers, plan.task, tuple(plan.sweep.code), self.writer)
        # BLAS is limited for all batches here, since it takes a few milliseconds.
        with one_blas_thread(), backend as executor:
            self.monitor.rate = executor.workers * plan.todo / max(plan.seconds, 1e-9)
            self.environments += executor.environments(plan.task.libraries)
            self._check_environments(self.environments)
            if (store := self.store) is not None:
                check_loaded(functions_of(plan.sweep), plan.sweep.code)
                with self._writing(store):
                    store.parts.mkdir(parents=True, exist_ok=True)
                    # Temporary files of killed runs, damaged parts, and parts of another manifest.
                    useless = {*store.part_names()} - {source.name for source in self.sources}
                    for path in [*map(store.parts.joinpath, useless), *store.parts.glob(".*.tmp")]:
                        path.unlink(missing_ok=True)
                    plan.manifest.save(store)
            # A run that stops at a failure has no batches that wait behind one.
            window = 1 if self.fail_fast or scheduler == "sync" else executor.window
            while due.any():
                self._loop(due, executor, window)
                if plan.sweep.refinement is None or self._stopped():
                    return
                due = select(plan.sweep, plan.manifest, plan.requested, self.sources)["due"]
                self.monitor.todo += int(np.count_nonzero(due))

    def _loop(self, due: NDArray[np.bool_], executor: Any, window: int) -> None:
        queue = Queue(self.plan.manifest.grid, due, self.plan.sweep.order_by)
        if self._first is None:
            self._first = queue.take_spread()
            self._submit(executor, self._first)
        while (queue.left or self._suspects or self._submitted) and not self._stopped():
            if self._suspects and not queue.left and not self._submitted:
                self._submit(executor, self._suspects.pop())
            free = window * executor.workers - len(self._submitted)
            # A message to a cluster costs what a batch does, so half of the window is submitted at once.
            if window == 1 or 2 * free >= window * executor.workers:
                while free > 0 and queue.left:
                    self._submit(executor, queue.take(self.sizes.next(queue.left, executor.workers)))
                    free -= 1
            self._collect(executor, queue.left)
        if self._submitted:
            executor.halt()
        while self._submitted:
            self._collect(executor, queue.left)

    def _submit(self, executor: Any, points: NDArray[np.intp]) -> None:
        name = "" if self.writer is None else self.writer.next_name()
        ends = self.plan.manifest.grid.points(points[[0, -1]])
        texts = {k: [f"{n:g}" if isinstance(n, float) else str(n) for n in v.tolist()] for k, v in ends.items()}
        spans = [f"{axis} = {' to '.join(dict.fromkeys(each))}" for axis, each in texts.items()]
        self.monitor.begin(int(points[0]), ", ".join(spans))
        future = executor.submit(name, points)
        self._submitted[future] = name, points
        future.add_done_callback(self._done.put)

    def _collect(self, executor: Any, left: int) -> None:
        """Take the result of a finished batch; wait a moment if there is none."""
        future, self._waiting = None, True
        with suppress(Empty):
            future = self._done.get(timeout=TICK)
        self._waiting = False
        if self.interrupts > 1:
            raise KeyboardInterrupt
        if future is None:
            executor.check()
            return
        (name, points), summary = self._submitted.pop(future), None
        try:
            with suppress(CancelledError):
                summary = executor.result(future)
        except WorkerDied:
            if len(points) == 1 and not self._submitted:
                # It was alone, so it is guilty.
                summary = self.plan.task.run(points, RuntimeError("the process that computed this point died"))
            else:
                self._suspects += np.array_split(points, min(2, len(points)))
        if summary is None:  # it was not begun, or is computed again
            self.monitor.end(int(points[0]))
            return
        if points is self._first and left and summary.alike:
            # Nothing is stored of it, so that the next run tries these points again.
            self.common_error = summary.first_failure
            if self.store is not None:
                (self.store.parts / name).unlink(missing_ok=True)
        else:
            self.sizes.finished(summary.rows, summary.seconds)
            self.failure = self.failure or summary.first_failure
            self.write(name, summary)
            if self.store is not None:
                self.sources.append(PartSource(self.store.parts, name))
            elif summary.result is not None:
                self.sources.append(summary.result)
        self.monitor.end(int(points[0]), summary.rows, summary.failed)

    def write(self, name: str, summary: BatchSummary) -> BatchSummary:
        """Write the part of a batch; return the summary without the result."""
        if self.writer is None or self.store is None or summary.result is None:
            return summary
        with self._writing(self.store):
            self.writer.write(name, summary.result)
        return summary._replace(result=None)

    def _stopped(self) -> bool:
        return bool(self.interrupts or self.common_error or (self.fail_fast and self.failure))

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """The first interrupt lets the batches that have begun finish, the second stops at once."""
        default = signal.default_int_handler
        main = threading.current_thread() is threading.main_thread()
        ours = main and signal.getsignal(signal.SIGINT) is default

        def interrupt(number: int, frame: Any) -> None:
            self.interrupts += 1
            # While the run waits, the loop raises: a destructor that runs meanwhile would lose the exception.
            if self.interrupts > 1 and not self._waiting:
                raise KeyboardInterrupt
            self.monitor.stop()

        try:
            if ours:
                signal.signal(signal.SIGINT, interrupt)
            yield
        finally:
            if ours:
                signal.signal(signal.SIGINT, default)
