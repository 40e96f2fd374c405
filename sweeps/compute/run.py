"""A plan's way from batches to the dataset: compute, keep, merge. One loop serves every back end."""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Union

import numpy as np
import xarray as xr
from dask.system import CPU_COUNT
from numpy.typing import NDArray

from sweeps.compute.batch import one_blas_thread
from sweeps.compute.local import Job, Local, Receipt, WorkerDied
from sweeps.errors import (
    AbandonedError,
    InputError,
    MixedWarning,
    SchedulerError,
    StoreError,
    SweepStoppedError,
    reason,
)
from sweeps.fingerprint.provenance import Environment, environment, environments_of, mixed
from sweeps.plan.batches import BatchSizes, Queue
from sweeps.plan.plan import PlanData, Selection
from sweeps.plan.planning import ROW_BYTES, select
from sweeps.storage.lock import locked
from sweeps.storage.merge import dataset, gather
from sweeps.storage.netcdf import attach, open_results, stored_only, write
from sweeps.storage.sources import DamagedError, PartSource, ResultSource, Source
from sweeps.storage.store import Store
from sweeps.watch.monitor import Monitor, Progress

if TYPE_CHECKING:
    from sweeps.compute.cluster import Cluster

Backend = Union[Local, "Cluster"]
LOCAL = ("threads", "sync", "processes")
# A point has failed when the worker that had nothing else to do died so many times.
DEATHS = 2
# Seconds between looks at whether to stop.
TICK = 0.25


def execute(
    plan: PlanData, scheduler: str, workers: int | None, progress: Progress | None, fail_fast: bool
) -> xr.Dataset:
    """Run a plan; see `Plan.run`."""
    check_backend(scheduler, workers)
    known = _checked_environments(plan, scheduler) if plan.todo else []
    only = known[0] if known and plan.strict else None
    if plan.store is None:
        sources = _Run(plan, None, list(plan.sources), progress, fail_fast, only).compute(scheduler, workers)
        found = gather(plan.manifest, sources, [*plan.manifest.variables, "wall_time"])
        data = attach(plan.manifest, dataset(plan.manifest, found), plan.sweep.derive)
        _tell_late(plan, known, data)
        return data
    store = Store(plan.store)
    if plan.whole:
        _check_unchanged(plan, store)
        _tidy(store)
        return _requested(plan, store)
    with locked(store):
        _check_unchanged(plan, store)
        sources = [source for source in plan.sources if source.name not in plan.damaged]
        _prepare(plan, store, {source.name for source in sources})
        sources = _Run(plan, store, sources, progress, fail_fast, only).compute(scheduler, workers)
        try:
            write(store, plan.manifest, sources, plan.sweep.derive)
        except DamagedError as problem:
            # The next plan computes its points again.
            (store.parts / problem.part).unlink(missing_ok=True)
            text = f"{problem.part} in {store.parts} got damaged; plan and run again"
            raise StoreError(text) from None
        store.clear()
    data = _requested(plan, store)
    _tell_late(plan, known, data)
    return data


def check_backend(scheduler: str, workers: int | None) -> None:
    """Refuse a back end that there is not."""
    if scheduler not in LOCAL and "://" not in str(scheduler):
        raise SchedulerError(
            f"scheduler = {scheduler!r}: it must be 'threads', 'sync', 'processes', or an address like "
            "tcp://host:8786"
        )
    whole = isinstance(workers, (int, np.integer)) and not isinstance(workers, bool)
    if workers is not None and not (whole and workers >= 1):
        raise SchedulerError(f"workers = {workers!r}: it must be a whole number, 1 or above")


def _checked_environments(plan: PlanData, scheduler: str) -> list[Environment]:
    """Environments of what is at hand and of who is to compute; several are a warning, or refused if strict."""
    here = [environment()]
    if scheduler not in LOCAL:
        # Imported here: it takes long, and few runs need it.
        from sweeps.compute.cluster import environments_at

        here = environments_at(scheduler)
    every: list[Environment] = [*plan.environments, *here]
    if told := mixed(every):
        text = _not_one(plan, told)
        if plan.strict:
            raise InputError(f"{text}; choose another folder, start over with fresh, or leave strict out")
        warnings.warn(f"{text}; computed_by says which are", MixedWarning, stacklevel=4)
    return every


def _tell_late(plan: PlanData, known: Sequence[Environment], data: xr.Dataset) -> None:
    """Tell of environments of points that were not known when the run began: of workers that joined it later."""
    found = environments_of(data.attrs)
    late = [each for each in found if each not in known]
    if known and late and len(found) > 1:
        text = _not_one(plan, mixed([known[0], *late]))
        warnings.warn(f"{text}; computed_by says which are", MixedWarning, stacklevel=4)


def _not_one(plan: PlanData, told: str) -> str:
    return f"{plan.store or plan.sweep.name}: not all points are computed in one environment: {told}"


def _check_unchanged(plan: PlanData, store: Store) -> None:
    if store.stamp() != plan.stamp:
        raise StoreError(f"{store.file} has changed since this was planned; plan again")


def _prepare(plan: PlanData, store: Store, known: Collection[str]) -> None:
    """Make the folder of parts, remove what is of no use, and say what is to come."""
    try:
        if plan.manifest.fresh and not plan.sources:
            store.manifest.unlink(missing_ok=True)
        store.parts.mkdir(parents=True, exist_ok=True)
        # What a killed run left half written, and parts that are damaged or of another manifest.
        for path in store.parts.glob(".*.tmp"):
            path.unlink(missing_ok=True)
        for name in store.folder.names():
            if name not in known:
                (store.parts / name).unlink()
        plan.manifest.save(store.manifest)
    except (OSError, RuntimeError) as problem:
        raise StoreError(_unwritten(store, problem, plan.cached)) from problem


def _tidy(store: Store) -> None:
    """Remove what a run left that was killed when its file was written already."""
    if store.parts.exists() or store.lock.exists():
        with suppress(StoreError), locked(store):
            if not store.manifest.exists():
                store.clear()


def _requested(plan: PlanData, store: Store) -> xr.Dataset:
    """Select the requested points of the file, in the order of the request."""
    try:
        found = open_results(store.file)
    except ValueError as problem:
        raise StoreError(f"{problem}; move it away, or start over with fresh (--fresh)") from None
    if plan.embedding.identical:
        return found
    manifest, grid = plan.manifest, plan.manifest.grid
    some = stored_only(manifest, found).isel(dict(zip(grid.dims, plan.embedding.places, strict=True)))
    if "failure" in some.dims:
        at = [np.asarray(some[f"failure_{name}"].values) for name in grid.axes]
        points = grid.at([values.astype(str) if values.dtype.kind == "O" else values for values in at])
        own = manifest.representatives(np.flatnonzero(plan.requested))
        ours = np.isin(manifest.representatives(points), own)
        some = some.isel(failure=ours) if ours.any() else some.drop_dims("failure")
    return attach(manifest, some, plan.sweep.derive)


def _unwritten(store: Store, problem: BaseException, kept: int) -> str:
    """Say what could not be written and why, and that so many computations are kept, where there are any."""
    done = "what was finished is kept, and the same run goes on from there" if kept else "nothing was finished"
    return f"{store.file} could not be written: {reason(problem)}; {done}"


@dataclass(eq=False)
class _Run:
    """One execution of a plan's batches; `sources` are where results at hand are kept, and then all of them."""

    plan: PlanData
    store: Store | None
    sources: list[Source]
    progress: Progress | None
    fail_fast: bool
    only: Environment | None
    # Plain values: a signal's handler sets the flag, and must not wait for a lock.
    interrupted: bool = False
    failure: str = ""

    def __post_init__(self) -> None:
        plan, store = self.plan, self.store
        self.folder = None if store is None else store.folder
        token = "" if store is None else plan.manifest.token
        self.job = Job(plan.task, plan.manifest.grid, token, self.only)
        self.monitor = Monitor(plan.todo, self.progress, None if store is None else store.progress)
        row = sum(plan.manifest.row_bytes(name) for name in plan.sweep.variables) + ROW_BYTES
        self.sizes = BatchSizes(row, plan.sweep.batch_multiple)
        # Of each batch its part's name, its points and, if it is alone at a worker, how often one has died of it.
        self._under_way: dict[Future[Any], tuple[str, NDArray[np.intp], int | None]] = {}
        self._done: SimpleQueue[Future[Any]] = SimpleQueue()
        # Batches at which a worker died, and how often each has died alone.
        self._suspects: list[tuple[NDArray[np.intp], int]] = []

    def compute(self, scheduler: str, workers: int | None) -> list[Source]:
        """Do every batch, of a refined sweep pass after pass; where all results are kept."""
        with self._interruptible():
            try:
                if self.plan.todo:
                    self._passes(scheduler, workers)
            except KeyboardInterrupt:
                if any(future.running() for future in self._under_way):
                    raise AbandonedError from None
                raise
            finally:
                # Threads that were given up come too late from now on.
                if self.folder is not None:
                    self.folder.close()
                self.monitor.close()
        if self.failure and self.fail_fast:
            raise SweepStoppedError(f"stopped at the first failure: {self.failure}")
        if self.interrupted:
            raise KeyboardInterrupt
        return self.sources

    def _passes(self, scheduler: str, workers: int | None) -> None:
        plan: PlanData = self.plan
        selection: Selection = plan
        most = plan.todo if plan.sweep.refinement is None else plan.points
        # Held for all batches here, for it takes a few milliseconds.
        with one_blas_thread(), self._backend(scheduler, min(workers or CPU_COUNT, most)) as backend:
            # Whoever wants to stop at a failure wants nothing waiting at a worker that has one.
            window = 1 if self.fail_fast or scheduler == "sync" else backend.window
            while selection.todo:
                self._loop(selection, backend, window)
                if plan.sweep.refinement is None or self._stopped():
                    return
                selection = select(plan.sweep, plan.manifest, plan.embedding, plan.requested, self.sources)
                self.monitor.todo += selection.todo

    def _backend(self, scheduler: str, workers: int) -> AbstractContextManager[Backend]:
        if scheduler in ("threads", "sync"):
            return Local(self._compute, workers if scheduler == "threads" else None)
        # Imported here: it takes long, and few runs need it.
        from sweeps.compute.cluster import cluster

        parts = None if self.store is None else self.store.parts
        return cluster(None if scheduler == "processes" else scheduler, workers, self.job, parts)

    def _loop(self, selection: Selection, backend: Backend, window: int) -> None:
        """Hand out batches as long as there are any, and take what comes of them."""
        queue = Queue(self.plan.manifest.grid, selection.due, self.plan.sweep.order_by)
        while (queue.left or self._suspects or self._under_way) and not self._stopped():
            if self._suspects and backend.isolate(last=not (queue.left or self._under_way)):
                points, deaths = self._suspects.pop()
                self._submit(backend, [points], deaths)
            batches, room = list[NDArray[np.intp]](), backend.room(window, len(self._under_way))
            while queue.left and len(batches) < room:
                batches.append(queue.take(self.sizes.next(queue.left, backend.workers)))
            self._submit(backend, batches)
            self._take(backend)
        if self._under_way:
            backend.halt()
        while self._under_way:
            self._take(backend)

    def _submit(self, backend: Backend, batches: list[NDArray[np.intp]], deaths: int | None = None) -> None:
        """Hand out batches; one at which a worker died so often, to a worker of its own."""
        names = ["" if self.folder is None else self.folder.next_name() for _ in batches]
        for points in batches:
            ends = self.plan.manifest.grid.points(points[[0, -1]])
            spans = [f"{n} = {_span(v[0].item(), v[1].item())}" for n, v in ends.items()]
            self.monitor.begin(int(points[0]), ", ".join(spans))
        futures = backend.submit(names, batches, deaths is not None)
        for future, name, points in zip(futures, names, batches, strict=True):
            self._under_way[future] = name, points, deaths
            future.add_done_callback(self._done.put)

    def _take(self, backend: Backend) -> None:
        """Keep what has come of a batch; wait a moment where nothing has."""
        try:
            future = self._done.get(timeout=TICK)
        except Empty:
            backend.check()
            return
        name, points, deaths = self._under_way.pop(future)
        receipt: Receipt | None
        try:
            receipt = future.result()
            if receipt is not None:
                self.sizes.finished(receipt.rows, receipt.seconds)
            elif not self._stopped():  # it got lost
                self._suspects.append((points, 0))
        except CancelledError:
            receipt = None  # it was taken back before it was begun
        except WorkerDied:
            receipt = self._suspected(points, deaths)
        if receipt is None:
            self.monitor.end(int(points[0]))
            return
        self.failure = self.failure or receipt.first_failure
        self._write(name, receipt)
        if self.folder is not None:
            self.sources.append(PartSource(self.folder, name))
        elif receipt.result is not None:
            self.sources.append(ResultSource(points, receipt.result))
        self.monitor.end(int(points[0]), receipt.rows, receipt.failed)

    def _compute(self, name: str, points: NDArray[np.intp]) -> Receipt:
        """A batch on a thread of this process, kept as the part of that name."""
        return self._write(name, self.job.compute(points))

    def _write(self, name: str, receipt: Receipt) -> Receipt:
        """The receipt without the part that was in it, which is written."""
        if self.folder is None or self.store is None or receipt.content is None:
            return receipt
        try:
            self.folder.put(name, receipt.content)
        except (OSError, RuntimeError) as problem:
            kept = self.plan.cached + len(self.folder.names())
            raise StoreError(_unwritten(self.store, problem, kept)) from problem
        return receipt._replace(content=None)

    def _suspected(self, points: NDArray[np.intp], deaths: int | None) -> Receipt | None:
        """Queue the halves of a batch at which a worker died; return a point at which too many died as failed."""
        if deaths is None:
            self._suspects.append((points, 0))
        elif len(points) > 1:
            self._suspects += [(half, 0) for half in np.array_split(points, 2)]
        elif deaths + 1 < DEATHS:
            self._suspects.append((points, deaths + 1))
        else:
            died = f"the process that computed this point died, {DEATHS} times out of {DEATHS}"
            result = self.plan.task.failed(self.job.grid.points(points), RuntimeError(died))
            return self.job.receipt(points, result, 0.0)
        return None

    def _stopped(self) -> bool:
        """Whether no more batches are to begin."""
        return self.interrupted or bool(self.fail_fast and self.failure)

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """The first interrupt lets what is under way finish and be kept, the second means now."""
        plain = threading.current_thread() is threading.main_thread()
        if not plain or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
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
