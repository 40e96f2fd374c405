"""A plan's way from batches to the dataset: compute, keep, put together."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sweeps import backends
from sweeps.assemble import MemorySource, ShardSource, Source, dataset, gather
from sweeps.errors import SchedulerError, StoreError, SweepStoppedError
from sweeps.final import attach, open_results, stored_only, write
from sweeps.lock import announce, locked
from sweeps.monitor import Monitor, Progress
from sweeps.store import Store

if TYPE_CHECKING:
    from sweeps.plan import Plan

LOCAL = ("threads", "sync", "processes")


def execute(
    plan: Plan, scheduler: str, workers: int | None, progress: Progress | None, fail_fast: bool
) -> xr.Dataset:
    """Run a plan; see `Plan.run`."""
    check_backend(scheduler, workers)
    if plan.store is None:
        tables: list[Source] = []
        run = _Run(plan, None, Monitor(plan.todo, progress, None), fail_fast)
        run.compute(scheduler, workers, tables)
        found = dataset(plan.layout, gather(plan.layout, tables))
        return attach(plan.layout, found, plan.sweep.derive)
    store = Store(plan.store)
    if plan.whole:
        return _asked(plan, store)
    with locked(store):
        if store.stamp() != plan.stamp:
            raise StoreError(f"{store.file} has changed since this was planned; plan again")
        _prepare(plan, store)
        run = _Run(plan, store, Monitor(plan.todo, progress, store.progress), fail_fast)
        run.compute(scheduler, workers, [])
        sources = list(plan.sources)
        known = {source.name for source in sources}
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


def _prepare(plan: Plan, store: Store) -> None:
    """Make the folder of shards, remove what is of no use, and say what is to come."""
    try:
        if plan.layout.fresh:
            store.clear()
        store.parts.mkdir(parents=True, exist_ok=True)
        for path in store.parts.glob(".*.tmp"):
            path.unlink()
        for name in plan.damaged:
            (store.parts / name).unlink(missing_ok=True)
        announce(store)
        temporary = store.layout.with_name(".layout.tmp")
        plan.layout.save(temporary)
        os.replace(temporary, store.layout)
    except (OSError, RuntimeError) as problem:
        raise StoreError(_unwritten(store, problem)) from problem


def _asked(plan: Plan, store: Store) -> xr.Dataset:
    """Of the file, the points that were asked for, in the order in which they were."""
    found = open_results(store.file)
    grid, asked = plan.layout.grid, plan.sweep.grid
    if asked.shape == grid.shape and np.array_equal(plan.asked, np.arange(grid.size)):
        return found
    place = np.stack(np.unravel_index(plan.asked.reshape(asked.shape), grid.shape))
    chosen = {}
    for k, dim in enumerate(grid.dims):
        first = tuple(slice(None) if j == k else 0 for j in range(len(grid.dims)))
        chosen[dim] = place[(k, *first)]
    some = stored_only(plan.layout, found).isel(chosen)
    return attach(plan.layout, some, plan.sweep.derive)


def _unwritten(store: Store, problem: BaseException) -> str:
    reason = getattr(problem, "strerror", None) or problem
    return f"{store.file} could not be written: {reason}; what was finished is kept, and the same run goes on from there"


class _Run:
    """One execution of a plan's batches."""

    def __init__(self, plan: Plan, store: Store | None, monitor: Monitor, fail_fast: bool) -> None:
        self.plan, self.monitor, self.fail_fast = plan, monitor, fail_fast
        self.folder = None if store is None else store.shards
        self.store = store
        self.stop = threading.Event()
        self.interrupted = False
        self.failure = ""

    def compute(self, scheduler: str, workers: int | None, tables: list[Source]) -> None:
        """Do every batch; with a store each becomes a shard, without one a table in memory."""
        self.tables = tables
        with self._interruptible():
            try:
                for table in self.plan.probes:
                    self._keep(backends.packed(self.plan.work, table, self.folder is not None))
                    self.monitor.end(-1, len(table), table.failed)
                if self.plan.batches and not self.stop.is_set():
                    self._batches(scheduler, workers)
            except (OSError, RuntimeError) as problem:
                if self.store is None or isinstance(problem, (StoreError, SweepStoppedError)):
                    raise
                raise StoreError(_unwritten(self.store, problem)) from problem
        if self.failure and self.fail_fast:
            raise SweepStoppedError(f"stopped at the first failure: {self.failure}")
        if self.interrupted:
            raise KeyboardInterrupt

    def _batches(self, scheduler: str, workers: int | None) -> None:
        batches = iter(self.plan.batches)
        if scheduler in ("threads", "sync"):
            count = 1 if scheduler == "sync" else (workers or os.cpu_count() or 1)
            backends.in_process(self._one, batches, min(count, len(self.plan.batches)), self.stop)
            return
        with ExitStack() as stack:
            client = stack.enter_context(
                backends.connected(None if scheduler == "processes" else scheduler, workers)
            )
            backends.on_cluster(
                client,
                self.plan.work,
                self._argument,
                self.folder is not None,
                batches,
                self._begun,
                self._finished,
                self.stop,
            )

    def _argument(self, batch: backends.Batch) -> tuple[Any, Any]:
        layout = self.plan.layout
        return layout.grid.points(batch), layout.slot_key(batch)

    def _one(self, batch: backends.Batch) -> None:
        self._begun(batch)
        self._finished(batch, backends.finish(self.plan.work, *self._argument(batch), self.folder is not None))

    def _begun(self, batch: backends.Batch) -> None:
        ends = self.plan.layout.grid.points(batch[[0, -1]])
        spans = [f"{n} = {_span(v[0].item(), v[1].item())}" for n, v in ends.items()]
        self.monitor.begin(int(batch[0]), ", ".join(spans))

    def _finished(self, batch: backends.Batch, result: backends.Result) -> None:
        self._keep(result)
        self.monitor.end(int(batch[0]), result.rows, result.failed)

    def _keep(self, result: backends.Result) -> None:
        if result.failed:
            self.failure = self.failure or result.first_failure
            if self.fail_fast:
                self.stop.set()
        if self.folder is not None and result.content is not None:
            self.folder.put(result.content)
        elif result.table is not None:
            self.tables.append(MemorySource(result.table))

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """The first interrupt lets what is under way finish and be kept, the second means now."""
        plain = threading.current_thread() is threading.main_thread()
        if not plain or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
            yield
            return

        def first(number: int, frame: Any) -> None:
            self.interrupted = True
            self.stop.set()
            signal.signal(signal.SIGINT, signal.default_int_handler)
            self.monitor.stop()

        signal.signal(signal.SIGINT, first)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _span(first: Any, last: Any) -> str:
    def text(value: Any) -> str:
        return f"{value:g}" if isinstance(value, float) else str(value)

    return text(first) if first == last else f"{text(first)} to {text(last)}"
