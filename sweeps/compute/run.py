"""Execution of a plan: a loop over batches, which are computed, stored and assembled."""

import json
import math
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import asdict, replace
from itertools import islice
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import xarray as xr
from dask.system import CPU_COUNT
from numpy.typing import NDArray

from sweeps import errors
from sweeps.compute.executors import Backend, Payload, Points, Pool, check_backend, is_pool, threads
from sweeps.errors import ClusterLostError, DamagedError, InputError, StoreError, SweepStoppedError, WorkerDied
from sweeps.fingerprint.identity import steady
from sweeps.fingerprint.provenance import Environment
from sweeps.grid import FAILED
from sweeps.plan.adoption import Adoption, changed, confirm
from sweeps.plan.batches import BatchSizes, Queue
from sweeps.plan.planning import ENGINE, ROW_BYTES, PlanData, duration, make_plan, mixture, select
from sweeps.status import Progress, Snapshot
from sweeps.storage.assemble import Source, Table, assemble, restore_types
from sweeps.storage.existing import PENDING_NAMES, existing, extended, opened
from sweeps.storage.netcdf import with_metadata, write
from sweeps.storage.parts import BOOKKEEPING, PartSource, PartWriter
from sweeps.storage.store import Store, owner, write_state
from sweeps.task import BatchSummary, one_blas_thread

# s between looks at whether to stop; between lines of progress that are no terminal's; between states that are
# written for other processes, and how long a rate was measured before it counts.
TICK, LINE_INTERVAL, INTERVAL = 0.1, 5.0, 1.0
# Number of running batches that a snapshot describes.
SHOWN = 4


def execute(
    plan: PlanData, scheduler: Any, workers: int | None, progress: Progress | bool | None, fail_fast: bool
) -> tuple[xr.Dataset, PlanData]:
    """Run a plan; see `sweeps.Plan.run`. Return the dataset and the updated plan."""
    check_backend(scheduler, workers)
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise InputError(f"progress = {progress!r}: it must be True, False, None or a function of a Snapshot")
    report = _lines() if progress is True else progress or None

    def compute(plan: PlanData, store: Store | None, fail_fast: bool = fail_fast) -> Table:
        return _Run(plan, store, report, fail_fast).compute(scheduler, workers)

    if plan.store is None:
        data = assemble(compute(plan, None), lazy=False)
        data = restore_types(with_metadata(plan.manifest, data, plan.sweep.derive))
    else:
        store = Store(plan.store, plan.shared)
        planned = plan.manifest.attributes["fingerprint"]
        with steady(plan.sweep, ENGINE, planned) if plan.todo or plan.adoption else nullcontext():
            if plan.adoption is not None:
                plan = _adopt(plan, store, plan.adoption, compute)
            data, plan = _finish(plan, store, compute)
        if plan.later:
            fields = make_plan(
                plan.sweep, store.file, fresh=False, retry_failed=False, strict=plan.strict, adopt=None
            )
            return execute(replace(plan, **fields), scheduler, workers, progress, fail_fast)
    if line := _failures(data):
        warnings.warn(f"{plan.sweep.name}: {line}", errors.FailedPointsWarning, stacklevel=3)
    return data, plan


def _lines() -> Progress:
    """Progress on standard error: one line that changes on a terminal, else a new line every few seconds."""
    stream, terminal, last = sys.stderr, sys.stderr.isatty(), time.monotonic()

    def update(now: Snapshot) -> None:
        nonlocal last
        ended = not now.now and (now.done >= now.todo or now.stopping)
        if not (ended or terminal or time.monotonic() - last >= LINE_INTERVAL):
            return
        last, texts = time.monotonic(), [f"{now.done} of {now.todo} done"]
        texts += [f"{now.failed} failed"] * bool(now.failed) + ["stopping"] * (now.stopping and not ended)
        texts += [f"{duration(now.left)} left"] * (now.left > 0.0)
        start, end = ("\r", "\x1b[K" + "\n" * ended) if terminal else ("", "\n")
        stream.write(f"{start}{', '.join(texts)}{end}")
        stream.flush()

    return update


def _failures(data: xr.Dataset) -> str:
    """The number of failed points, and place and reason of the first failure; "" without failures."""
    failed = data["status"] == FAILED
    if not (count := int(failed.sum())):
        return ""
    first = data["error"].isel(failed.argmax(failed.dims))
    point = ", ".join(f"{name} = {each.item()}" for name, each in first.coords.items() if data[name].dims)
    why = " ".join(str(first.item()).split())
    text = f"{count} of {failed.size} points failed, the first at {point}: {why}"
    return f"{text}; retry_failed=True computes them again"


def _adopt(plan: PlanData, store: Store, chosen: Adoption, compute: Callable[..., Table]) -> PlanData:
    """Repeat stored computations; if they agree, the file becomes one of the present code. Return the new plan."""
    due = np.zeros(plan.manifest.grid.size, dtype=bool)
    due[chosen.points] = True
    nothing: dict[str, Any] = {"sources": (), "environments": (), "cached": 0, "store": None, "seconds": 0.0}
    trial = replace(plan, **nothing, due=due, todo=len(chosen.points), sweep=replace(plan.sweep, refinement=None))
    before = Table(plan.manifest, [each for each in plan.sources if each.name not in plan.damaged])
    with store.locked():
        _check_version(plan, store)
        line = confirm(chosen, before, compute(trial, None, fail_fast=False))
        remark = "; ".join(filter(None, [plan.sweep.remark, line]))
        manifest = replace(plan.manifest, attributes={**plan.manifest.attributes, "remark": remark})
        # What follows from all points follows when they are there.
        write(store, Table(manifest, before.sources), None if plan.todo else plan.sweep.derive)
        store.clear_all()
    own = json.loads(plan.manifest.attributes["fingerprint"])
    present = existing(store, plan.sweep.name, own)
    sources = () if present is None else tuple(present.sources)
    return replace(
        plan, sources=sources, version=store.version(), whole=not plan.todo, adoption=None, adopted=line
    )


def _check_version(plan: PlanData, store: Store) -> None:
    if store.version() != plan.version:
        raise StoreError(f"{store.file} has changed since this was planned; plan again")


def _finish(plan: PlanData, store: Store, compute: Callable[..., Table]) -> tuple[xr.Dataset, PlanData]:
    """Compute missing results, write the file and read the requested points; return the updated plan."""
    with nullcontext() if plan.whole else store.locked():
        _check_version(plan, store)
        if not plan.whole:
            table = compute(plan, store)
            if plan.shared is not None:
                return restore_types(with_metadata(plan.manifest, assemble(table, lazy=True), None)), plan
            try:
                if table.damaged:
                    raise DamagedError(table.damaged[0], str(store.parts))
                if plan.extends:
                    table = _extend(plan, store, table)
                write(store, table, plan.sweep.derive)
            except DamagedError as problem:
                # The next plan computes its points again.
                (store.parts / problem.part).unlink(missing_ok=True)
                raise
            store.clear_all()
    if plan.whole and store.parts.exists():
        # They remain of a run that was killed when its file was complete; whoever releases the lock removes them.
        with suppress(StoreError), store.locked():
            pass
    return _requested(plan, store), replace(plan, version=store.version(), whole=True)


def _extend(plan: PlanData, store: Store, table: Table) -> Table:
    """The results of a file with the variables that it lacks.

    Refused if the called function returns other values for variables that the file already has.
    """
    found = extended(
        store, plan.sweep.name, json.loads(plan.manifest.attributes["fingerprint"]), pending=plan.alone
    )
    if found is None:
        raise StoreError(f"{store.file} has changed since this was planned; plan again")
    older, names = found
    if plan.alone:
        attributes = dict(plan.manifest.attributes)
        if failed := int(np.count_nonzero(table.status == FAILED)):
            attributes[PENDING_NAMES] = ", ".join(names)
            why = (
                f"{table.reasons()[int(np.argmax(table.status == FAILED))].error}; retry_failed computes it again"
            )
            line = f"{plan.extends} failed at {failed} of {plan.distinct} stored points: {why}"
            warnings.warn(f"{plan.sweep.name}: {line}", errors.FailedPointsWarning, stacklevel=5)
        manifest = replace(plan.manifest, variables=plan.sweep.stored, attributes=attributes)
        return Table(manifest, older.sources, table)
    stored = [*json.loads(older.attributes["fingerprint"])["variables"]]
    line = changed(stored, Table(plan.manifest, older.sources), table)
    for each in older.sources:
        each.data.close()  # type: ignore[union-attr]
    if line:
        store.clear_all()
        text = f"{plan.extends} cannot be added, and nothing has changed: {line}"
        raise StoreError(f"{store.file}: {text}; {errors.HINT_EITHER}")
    return table


def _requested(plan: PlanData, store: Store) -> xr.Dataset:
    try:
        data = opened(store.file)
    except ValueError as problem:
        hint = "" if errors.HINT_MOVE in str(problem) else f"; move it away, or {errors.HINT_START_OVER}"
        raise StoreError(f"{problem}{hint}") from None
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
    return restore_types(with_metadata(plan.manifest, some, plan.sweep.derive))


class _Run:
    def __init__(self, plan: PlanData, store: Store | None, progress: Progress | None, fail_fast: bool) -> None:
        self.plan, self.store, self.fail_fast = plan, store, fail_fast
        self.sources: list[Source] = [each for each in plan.sources if each.name not in plan.damaged]
        self.writer = None
        if store is not None:
            last = ["", *store.part_names()][-1]
            self.writer = PartWriter(store.parts, plan.manifest.variables, plan.manifest.token, last)
        self.progress, self.owner, self.begun, self.written = progress, owner(), time.monotonic(), -math.inf
        self.todo, self.done, self.failed, self.planned_rate = plan.cached + plan.todo, plan.cached, 0, math.nan
        self.since = self.done, self.begun  # of the rate: the first batch, which compiles, is not timed
        # What the submitted batches compute, by their first points; whether they are being reported.
        self.now, self.reporting = dict[int, str](), False
        row = sum(map(plan.manifest.row_bytes, plan.manifest.variables)) + ROW_BYTES
        self.sizes = BatchSizes(row)
        # Plain values: a signal's handler counts, and must not wait for a lock.
        self._waiting = False
        self.interrupts, self.failure, self.common_error = 0, "", ""
        self.environments: list[Environment] = [*plan.environments]
        # Name and points of each submitted batch, and whether it is computed alone.
        self._submitted: dict[Future[Any], tuple[str, NDArray[np.intp], bool]] = {}
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
                self._write_state()
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
            warnings.warn(line, errors.MixedWarning, stacklevel=7 + (self.store is not None))

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
        # BLAS is limited for all batches here, since it takes a few milliseconds.
        with one_blas_thread(), self._backend(scheduler, workers) as executor:
            self.planned_rate = executor.workers * plan.todo / max(plan.seconds, 1e-9)
            self.environments += executor.environments(plan.task.libraries)
            self._check_environments(self.environments)
            if (store := self.store) is not None:
                with self._writing(store):
                    store.parts.mkdir(parents=True, exist_ok=True)
                    # Temporary files of killed runs, damaged parts, and parts of another manifest.
                    useless = {*store.part_names()} - {source.name for source in self.sources}
                    for share in store.shares() if plan.manifest.fresh else ():
                        share.clear()
                    for path in [*map(store.parts.joinpath, useless), *store.parts.glob(".*.tmp")]:
                        path.unlink(missing_ok=True)
                    plan.manifest.save(store)
            # A run that stops at a failure has no batches that wait behind one.
            window = 1 if self.fail_fast or scheduler == "sync" else executor.window
            while due.any():
                self._loop(due, executor, window)
                if plan.sweep.refinement is None or plan.shared or self._stopped():
                    return
                due = select(plan.sweep, plan.manifest, plan.requested, self.sources)["due"]
                self.todo += int(np.count_nonzero(due))

    @contextmanager
    def _backend(self, scheduler: Any, workers: int) -> Iterator[Backend]:
        if scheduler in ("threads", "sync") or isinstance(scheduler, ThreadPoolExecutor):
            with threads(scheduler, workers, self._compute) as backend:
                yield backend
                return
        payload = Payload.of(self.plan.task, tuple(self.plan.sweep.code), self.writer)
        if scheduler == "processes" or is_pool(scheduler):
            there: AbstractContextManager[Backend] = Pool(scheduler, workers, payload)
        else:
            # Imported here: it is slow, and few runs need it.
            from sweeps.compute.cluster import cluster

            there = cluster(scheduler, payload)
        with there as backend, payload.offered():
            yield backend

    def _compute(self, name: str, points: Points) -> BatchSummary:
        return self.write(name, self.plan.task.run(np.asarray(points)))

    def _loop(self, due: NDArray[np.bool_], executor: Backend, window: int) -> None:
        queue = Queue(self.plan.manifest.grid, due, self.plan.sweep.order_by)
        if self._first is None:
            self._first = queue.take_spread()
            self._submit(executor, self._first)
        while (queue.left or self._suspects or self._submitted) and not self._stopped():
            if self._suspects and not queue.left and not self._submitted:
                self._submit(executor, self._suspects.pop(), alone=True)
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

    def _submit(self, executor: Backend, points: NDArray[np.intp], *, alone: bool = False) -> None:
        name = "" if self.writer is None else self.writer.next_name()
        ends = self.plan.manifest.grid.points(points[[0, -1]])
        texts = {k: [f"{n:g}" if isinstance(n, float) else str(n) for n in v.tolist()] for k, v in ends.items()}
        spans = [f"{axis} = {' to '.join(dict.fromkeys(each))}" for axis, each in texts.items()]
        self.now[int(points[0])] = ", ".join(spans)
        self._report()
        future = executor.submit(name, points)
        self._submitted[future] = name, points, alone
        future.add_done_callback(self._done.put)

    def _collect(self, executor: Backend, left: int) -> None:
        """Take the result of a finished batch; wait a moment if there is none."""
        executor.check()
        future, self._waiting = None, True
        with suppress(Empty):
            future = self._done.get(timeout=TICK)
        self._waiting = False
        if self.interrupts > 1:
            raise KeyboardInterrupt
        if future is None:
            return
        (name, points, alone), summary = self._submitted.pop(future), None
        try:
            with suppress(CancelledError):
                summary = executor.result(future)
        except ClusterLostError:
            if not self.interrupts:  # a terminal's Ctrl-C may have reached the workers, too
                raise
        except WorkerDied:
            if len(points) == 1 and alone:
                summary = self.plan.task.run(points, RuntimeError("the process that computed this point died"))
            else:
                self._suspects += np.array_split(points, min(2, len(points)))
        del self.now[int(points[0])]
        if summary is None:  # it was not begun, or is computed again
            self._report()
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
        if self.done == self.plan.cached:
            self.since = self.done + summary.rows, time.monotonic()
        self.done, self.failed = self.done + summary.rows, self.failed + summary.failed
        self._report()

    def _snapshot(self) -> Snapshot:
        now, cached = time.monotonic(), self.plan.cached
        elapsed, counted = max(now - self.begun, 1e-9), now - self.since[1]
        rate = (self.done - self.since[0]) / max(counted, INTERVAL) or (self.done - cached) / elapsed
        left = (self.todo - self.done) / rate if rate > 0.0 else math.nan
        if self.planned_rate > 0.0 and (counted < INTERVAL or self.done == cached):
            rate, left = 0.0, (self.todo - self.done) / self.planned_rate
        batches = tuple(islice(self.now.values(), SHOWN))
        return Snapshot(self.todo, self.done, self.failed, elapsed, rate, left, batches, self.interrupts > 0)

    def _report(self) -> None:
        self.reporting = True
        try:
            snapshot = self._snapshot()
            if self.progress is not None:
                self.progress(snapshot)
            if time.monotonic() - self.written >= INTERVAL:
                self._write_state()
        finally:
            self.reporting = False
        if self.interrupts and not snapshot.stopping:  # it was interrupted meanwhile
            self._report()

    def _write_state(self) -> None:
        self.written = time.monotonic()
        if self.store is not None:
            write_state(self.store.progress, asdict(self._snapshot()) | self.owner)

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
            # A report that is interrupted sees it at its end; a handler must not raise.
            if not self.reporting:
                with suppress(Exception):
                    self._report()

        try:
            if ours:
                signal.signal(signal.SIGINT, interrupt)
            yield
        finally:
            if ours:
                signal.signal(signal.SIGINT, default)
