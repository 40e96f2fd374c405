"""A plan's way from batches to the dataset: compute, keep, put together."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from dask.system import CPU_COUNT

from sweeps.compute.local import Batch, Result, in_process, packed
from sweeps.errors import SchedulerError, StoreError, SweepStoppedError, reason
from sweeps.grid import Points
from sweeps.plan.keys import Columns, column
from sweeps.storage.lock import announce, locked
from sweeps.storage.merge import MemorySource, ShardSource, Source, dataset, gather
from sweeps.storage.netcdf import attach, leftovers, open_results, stored_only, write
from sweeps.storage.store import Store
from sweeps.watch.monitor import Monitor, Progress

if TYPE_CHECKING:
    from sweeps.plan.plan import Plan

LOCAL = ("threads", "sync", "processes")


def execute(
    plan: Plan, scheduler: str, workers: int | None, progress: Progress | None, fail_fast: bool
) -> xr.Dataset:
    """Run a plan; see `Plan.run`."""
    check_backend(scheduler, workers)
    if plan.store is None:
        run = _Run(plan, None, Monitor(plan.todo, progress, None), fail_fast)
        run.compute(scheduler, workers)
        found = dataset(plan.layout, gather(plan.layout, run.tables))
        return attach(plan.layout, found, plan.sweep.derive)
    store = Store(plan.store)
    if plan.whole:
        _tidy(store)
        return _asked(plan, store)
    with locked(store):
        if store.stamp() != plan.stamp:
            raise StoreError(f"{store.file} has changed since this was planned; plan again")
        sources = [source for source in plan.sources if source.name not in plan.damaged]
        known = {source.name for source in sources}
        _prepare(plan, store, known)
        _Run(plan, store, Monitor(plan.todo, progress, store.progress), fail_fast).compute(scheduler, workers)
        sources += [ShardSource(store.shards, name) for name in store.shards.names() if name not in known]
        write(store, plan.layout, sources, plan.sweep.derive)
        store.clear()
    return _asked(plan, store)


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


def _prepare(plan: Plan, store: Store, known: Collection[str]) -> None:
    """Make the folder of shards, remove what is of no use, and say what is to come."""
    try:
        if plan.layout.fresh and not plan.sources:
            store.clear()
        store.parts.mkdir(parents=True, exist_ok=True)
        # What a killed run left half written, and shards that are damaged or of another layout.
        for path in [*store.parts.glob(".*.tmp"), *leftovers(store)]:
            path.unlink(missing_ok=True)
        for name in store.shards.names():
            if name not in known:
                (store.parts / name).unlink()
        announce(store)
        temporary = store.layout.with_name(".layout.tmp")
        plan.layout.save(temporary)
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, store.layout)
    except (OSError, RuntimeError) as problem:
        raise StoreError(_unwritten(store, problem)) from problem


def _tidy(store: Store) -> None:
    """Remove what a run left that was killed when its file was written already."""
    if store.parts.exists() or store.lock.exists():
        with suppress(StoreError), locked(store):
            if not store.layout.exists():
                store.clear()


def _asked(plan: Plan, store: Store) -> xr.Dataset:
    """Of the file, the points that were asked for, in the order in which they were."""
    try:
        found = open_results(store.file)
    except ValueError as problem:
        raise StoreError(f"{problem}; move it away, or start over with fresh (--fresh)") from None
    grid, asked = plan.layout.grid, plan.sweep.grid
    if asked.shape == grid.shape and np.array_equal(plan.asked, np.arange(grid.size)):
        return found
    place = np.stack(np.unravel_index(plan.asked.reshape(asked.shape), grid.shape))
    chosen = {}
    for k, dim in enumerate(grid.dims):
        first = tuple(slice(None) if j == k else 0 for j in range(len(grid.dims)))
        chosen[dim] = place[(k, *first)]
    some = stored_only(plan.layout, found).isel(chosen)
    if "failure" in some.dims:
        points = plan.layout.at([column(some[f"failure_{name}"].values) for name in grid.axes])
        ours = np.isin(plan.layout.original[points], plan.layout.original[plan.asked])
        some = some.isel(failure=ours) if ours.any() else some.drop_dims("failure")
    return attach(plan.layout, some, plan.sweep.derive)


def _unwritten(store: Store, problem: BaseException) -> str:
    kept = "what was finished is kept, and the same run goes on from there"
    return f"{store.file} could not be written: {reason(problem)}; {kept}"


class _Run:
    """One execution of a plan's batches: the job of a back end."""

    def __init__(self, plan: Plan, store: Store | None, monitor: Monitor, fail_fast: bool) -> None:
        self.plan, self.store, self.monitor, self.fail_fast = plan, store, monitor, fail_fast
        self.folder = None if store is None else store.shards
        self.work, self.as_shard = plan.work, store is not None
        self.tables: list[Source] = []
        # A plain flag: a signal's handler sets it, and must not wait for the lock within an event.
        self.interrupted = False
        self.failure = ""

    def compute(self, scheduler: str, workers: int | None) -> None:
        """Do every batch; with a store each becomes a shard, without one a table in memory."""
        with self._interruptible():
            try:
                for table in self.plan.probes:
                    self._keep(packed(self.work, table, self.as_shard))
                    self.monitor.before(len(table), table.failed)
                if self.plan.batches and not self.stopped():
                    self._batches(scheduler, workers)
            finally:
                # Lanes that were abandoned come too late from now on.
                if self.folder is not None:
                    self.folder.close()
                self.monitor.close()
        if self.failure and self.fail_fast:
            raise SweepStoppedError(f"stopped at the first failure: {self.failure}")
        if self.interrupted:
            raise KeyboardInterrupt

    def _batches(self, scheduler: str, workers: int | None) -> None:
        batches, most = iter(self.plan.batches), len(self.plan.batches)
        count = min(workers or CPU_COUNT, most)
        if scheduler in ("threads", "sync"):
            in_process(self, batches, count if scheduler == "threads" else None)
            return
        # Imported here: it takes long, and few runs need it.
        from sweeps.compute.cluster import connected, on_cluster

        with connected(None if scheduler == "processes" else scheduler, count) as client:
            on_cluster(client, self, batches)

    def arguments(self, batch: Batch) -> tuple[Points, Columns]:
        """The points of a batch, and their keys."""
        return self.plan.layout.grid.points(batch), self.plan.layout.slot_key(batch)

    def begun(self, batch: Batch) -> None:
        """The batch has been given to a worker."""
        ends = self.plan.layout.grid.points(batch[[0, -1]])
        spans = [f"{n} = {_span(v[0].item(), v[1].item())}" for n, v in ends.items()]
        self.monitor.begin(int(batch[0]), ", ".join(spans))

    def finished(self, batch: Batch, result: Result) -> None:
        """The batch is done."""
        self._keep(result)
        self.monitor.end(int(batch[0]), result.rows, result.failed)

    def withdrawn(self, batch: Batch) -> None:
        """The batch was taken back before it was begun."""
        self.monitor.end(int(batch[0]), 0, 0)

    def stopped(self) -> bool:
        """Whether no more batches are to begin."""
        return self.interrupted or bool(self.fail_fast and self.failure)

    def _keep(self, result: Result) -> None:
        if result.failed:
            self.failure = self.failure or result.first_failure
        if result.table is not None:
            self.tables.append(MemorySource(result.table))
        if self.store is None or self.folder is None or result.content is None:
            return
        try:
            self.folder.put(result.content)
        except (OSError, RuntimeError) as problem:
            raise StoreError(_unwritten(self.store, problem)) from problem

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
    def text(value: Any) -> str:
        return f"{value:g}" if isinstance(value, float) else str(value)

    return text(first) if first == last else f"{text(first)} to {text(last)}"
