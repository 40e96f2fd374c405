"""Getting batches done in this process: Dask's threads, or one after the other.

However they are done, batches are taken one by one from an iterator and what comes of each is handed on at once:
no more of them are under way than there are workers for; a million points never sit in a scheduler.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from dask.base import compute
from dask.delayed import delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from sweeps.compute.batch import FAILED, Table, Work
from sweeps.errors import AbandonedError
from sweeps.grid import Points
from sweeps.plan.keys import Columns
from sweeps.storage.parts import encode

Batch = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Result:
    """What comes of a batch: the table, or its shard's content, and how many points failed."""

    rows: int
    failed: int
    table: Table | None
    content: bytes | None
    first_failure: str = ""


class Job(Protocol):
    """What a back end is to do, and whom it tells.

    Attributes
    ----------
    work : Work
    as_shard : bool
        Whether a batch's result is wanted as the content of a shard.
    fail_fast : bool
        Whether it stops at the first point that fails.
    """

    @property
    def work(self) -> Work:
        """See above."""

    @property
    def as_shard(self) -> bool:
        """See above."""

    @property
    def fail_fast(self) -> bool:
        """See above."""

    def arguments(self, batch: Batch) -> tuple[Points, Columns]:
        """The points of a batch, and their keys."""

    def begun(self, batch: Batch) -> None:
        """The batch has been given to a worker."""

    def finished(self, batch: Batch, result: Result) -> None:
        """The batch is done."""

    def withdrawn(self, batch: Batch) -> None:
        """The batch was taken back before it was begun."""

    def stopped(self) -> bool:
        """Whether no more batches are to begin."""


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


def in_process(job: Job, batches: Iterator[Batch], workers: int | None) -> None:
    """Let so many lanes, each a task of Dask's threads, take batches until there are none; None: in this thread.

    An exception in one lane lets the others finish what they have; then it is raised.

    Raises
    ------
    AbandonedError
        If this thread is interrupted while others compute.
    """
    lock = threading.Lock()
    problems: list[BaseException] = []

    def lane() -> None:
        while not (problems or job.stopped()):
            with lock:
                batch = next(batches, None)
            if batch is None:
                return
            try:
                job.begun(batch)
                job.finished(batch, finish(job.work, *job.arguments(batch), job.as_shard))
            except BaseException as problem:  # noqa: BLE001 - raised below; Dask would not wait for the others
                problems.append(problem)

    lanes = [delayed(lane, pure=False)() for _ in range(workers or 0)]
    # One BLAS thread: more would compete with the lanes, and the bits may depend on their number.
    with threadpool_limits(1, user_api="blas"):
        if workers is None:
            lane()
        else:
            # Not Dask's own pool: lanes that are given up would be in the way of the next run.
            pool = ThreadPoolExecutor(workers)
            try:
                compute(*lanes, scheduler="threads", pool=pool)
            except KeyboardInterrupt:
                raise AbandonedError from None
            finally:
                pool.shutdown(wait=False)
    if problems:
        raise problems[0]
