"""Ways to get batches done: Dask's threads in this process, or a Dask cluster, of this machine or elsewhere.

Every way takes batches one by one from an iterator and hands what comes of each to a function, so that no more
of them are under way than the workers need; a million points never sit in a scheduler.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from dask.base import compute
from dask.delayed import delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from sweeps.batch import FAILED, Table, Work
from sweeps.errors import SchedulerError
from sweeps.grid import Points
from sweeps.keys import Columns
from sweeps.shards import encode
from sweeps.sources import sources

Batch = NDArray[np.intp]
# Batches submitted to a cluster for each of its workers: one to work on, one waiting.
WINDOW = 2
# Seconds to wait for a scheduler's answer.
PATIENCE = 10


@dataclass(frozen=True, eq=False)
class Result:
    """What comes of a batch: the table, or its shard's content, and how many points failed."""

    rows: int
    failed: int
    table: Table | None
    content: bytes | None
    first_failure: str = ""


def finish(work: Work, points: Points, key: Columns, as_shard: bool) -> Result:
    """Compute a batch and pack it."""
    return packed(work, work.table(points, key), as_shard)


def packed(work: Work, table: Table, as_shard: bool) -> Result:
    """A table as what is kept of it."""
    content = encode(table, work.variables) if as_shard else None
    first = ""
    if table.failed:
        row = int(np.flatnonzero(table.status == FAILED)[0])
        where = ", ".join(f"{name} = {values[row]}" for name, values in table.points.items())
        first = f"{where}: {table.error[row]}"
    return Result(len(table), table.failed, None if as_shard else table, content, first)


def in_process(
    one: Callable[[Batch], None], batches: Iterator[Batch], workers: int, stop: threading.Event
) -> None:
    """Let so many lanes, each a Dask task, take batches until there are none; one lane runs in this thread."""
    lock = threading.Lock()

    def lane() -> None:
        while not stop.is_set():
            with lock:
                batch = next(batches, None)
            if batch is None:
                return
            try:
                one(batch)
            except BaseException:
                stop.set()
                raise

    lanes = [delayed(lane, pure=False)() for _ in range(workers)]
    # One BLAS thread: more would compete with the lanes, and the bits may depend on their number.
    with threadpool_limits(1, user_api="blas"):
        if workers == 1:
            compute(*lanes, scheduler="synchronous")
        else:
            compute(*lanes, scheduler="threads", num_workers=workers)


@contextmanager
def connected(address: str | None, workers: int | None) -> Iterator[Any]:
    """A Dask client: of the scheduler at an address, or of a new cluster of processes on this machine.

    Raises
    ------
    SchedulerError
        If no scheduler answers, or it has no workers.
    """
    import dask
    import distributed

    quiet = {
        # Nothing is spilled: what a worker holds is one batch. Pickles on a disk are not wanted either.
        "distributed.worker.memory.target": False,
        "distributed.worker.memory.spill": False,
        "distributed.worker.memory.pause": False,
        "distributed.admin.tick.limit": "30s",
    }
    if address is not None:
        try:
            client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as problem:
            raise SchedulerError(
                f"scheduler = {address!r}: no Dask scheduler answers there ({type(problem).__name__}); start one, "
                "or leave it out"
            ) from None
        with client:
            try:
                client.wait_for_workers(1, timeout=PATIENCE)
            except TimeoutError:
                raise SchedulerError(
                    f"scheduler = {address!r}: it has no workers; start dask worker {address}"
                ) from None
            yield client
        return
    with dask.config.set(quiet):
        cluster = distributed.LocalCluster(
            n_workers=workers or os.cpu_count() or 1,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        )
        with cluster, distributed.Client(cluster, set_as_default=False) as client:
            yield client


def on_cluster(
    client: Any,
    work: Work,
    argument: Callable[[Batch], tuple[Points, Columns]],
    as_shard: bool,
    batches: Iterator[Batch],
    begun: Callable[[Batch], None],
    finished: Callable[[Batch, Result], None],
    stop: threading.Event,
) -> None:
    """Keep a window of batches on a cluster until there are none.

    A batch whose worker dies is done again by another; one that kills several workers is halved, down to the
    point that does it, which then has failed.
    """
    from distributed import KilledWorker, as_completed

    expected = sources(work.function) if _importable(work.function) else None
    again: list[Batch] = []
    under_way: dict[Any, Batch] = {}
    arrivals = as_completed([], loop=client.loop, raise_errors=False)

    def submit() -> None:
        slots = WINDOW * max(len(client.scheduler_info(n_workers=-1)["workers"]), 1)
        while len(under_way) < slots and not stop.is_set():
            batch = again.pop() if again else next(batches, None)
            if batch is None:
                return
            future = client.submit(_remote, work, *argument(batch), as_shard, expected, pure=False)
            under_way[future] = batch
            begun(batch)
            arrivals.add(future)

    submit()
    while under_way:
        future = next(arrivals)
        batch = under_way.pop(future)
        if future.status == "finished":
            finished(batch, future.result())
        else:
            problem = future.exception()
            if not isinstance(problem, KilledWorker):
                raise SchedulerError(
                    f"the cluster's workers cannot compute this: {type(problem).__name__}: {problem}"
                )
            if len(batch) > 1:
                again += np.array_split(batch, 2)
            else:
                finished(batch, _killed(work, argument(batch), problem, as_shard))
        del future
        submit()


def _killed(work: Work, argument: tuple[Points, Columns], problem: Exception, as_shard: bool) -> Result:
    """A point at which workers die, as a point that failed."""

    def die(points: Points, **constants: Any) -> dict[str, Any]:
        raise RuntimeError(f"the worker died, several times over ({problem})")

    dead = Work(work.name, die, {}, work.variables, work.shapes)
    return packed(work, dead.table(*argument), as_shard)


def _remote(work: Work, points: Points, key: Columns, as_shard: bool, expected: dict[str, str] | None) -> Result:
    """What a worker does."""
    if expected is not None and _sources(work.function) != expected:
        raise RuntimeError("this worker has another version of the code; install the same one everywhere")
    with threadpool_limits(1, user_api="blas"):
        return finish(work, points, key, as_shard)


def _importable(function: Any) -> bool:
    """Whether a worker imports the function by its name; others are sent to it with their code."""
    module = sys.modules.get(getattr(function, "__module__", "__main__"))
    if module is None or module.__name__ == "__main__":
        return False
    return getattr(module, getattr(function, "__qualname__", ""), None) is function


@lru_cache(maxsize=8)
def _sources(function: Any) -> dict[str, str]:
    return sources(function)
