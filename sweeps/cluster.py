"""Getting batches done by a Dask cluster, of processes on this machine or of workers elsewhere."""

# mypy: disallow-untyped-calls=False, disallow-any-generics=False

from __future__ import annotations

import logging
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from functools import lru_cache, partial
from multiprocessing import resource_tracker
from typing import Any
from uuid import uuid4

import cloudpickle  # type: ignore[import-untyped]
import dask
import distributed
import numpy as np
from dask.system import CPU_COUNT
from distributed.utils import silence_logging_cmgr
from threadpoolctl import threadpool_limits

from sweeps.backends import Batch, Job, Result, finish, packed
from sweeps.batch import Work
from sweeps.errors import SchedulerError
from sweeps.fingerprint.code import digests
from sweeps.grid import Points
from sweeps.keys import Columns
from sweeps.reproduce import one_liner

# Batches submitted for each worker: one to work on, one waiting.
WINDOW = 2
# Seconds to wait for a scheduler's answer and its first worker.
PATIENCE = 10.0
# Seconds to wait for another worker when there is none left; restarting one takes a few.
BEREFT = 60.0
# Seconds between looks at whether to stop.
TICK = 0.25
# A point has failed when the worker that had nothing else to do died so many times.
DEATHS = 2


# How Dask runs workers of our own.
CONFIGURATION = {
    # A worker that samples its own stack a hundred times a second takes turns with what it computes.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    # Dask's workers give memory back to the system at once, and get it again page by page: a tenth of the time of
    # whoever needs the same arrays over and over. These keep up to 64 MB of it.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 26,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 24,
}


@contextmanager
def connected(address: str | None, workers: int | None) -> Iterator[distributed.Client]:
    """A Dask client: of the scheduler at an address, or of a new cluster of processes on this machine.

    Raises
    ------
    SchedulerError
        If no scheduler answers, it has no workers, or no processes can be started.
    """
    # What Dask says of lost connections and killed workers is said in one line by whoever meets it.
    with silence_logging_cmgr(logging.CRITICAL):
        if address is None:
            with _own(workers or CPU_COUNT) as client:
                yield client
        else:
            with _theirs(address) as client:
                yield client


@contextmanager
def _theirs(address: str) -> Iterator[distributed.Client]:
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as problem:
        raise SchedulerError(
            f"scheduler = {address!r}: no Dask scheduler answers there ({type(problem).__name__}); start one, "
            "or leave it out"
        ) from None
    with client, client.as_current():
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise SchedulerError(
                f"scheduler = {address!r}: it has no workers; start some with: dask worker {address}"
            ) from None
        yield client


@contextmanager
def _own(workers: int) -> Iterator[distributed.Client]:
    with tempfile.TemporaryDirectory(prefix="sweeps-", ignore_cleanup_errors=True) as folder:
        # A terminal's Ctrl-C goes to every process, but workers are to finish what they have. What is blocked here
        # is blocked in the cluster's thread, and in every process which that starts, now or later; but the thread
        # that is first to need Python's tracker of resources starts it, and then has nothing blocked.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            # Scheduler and workers each make folders of their own there.
            with dask.config.set(CONFIGURATION | {"temporary-directory": folder}):
                cluster = distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                    # Nothing is spilled to a disk, and no worker killed for its size: it holds a batch or two.
                    memory_limit=0,
                    # What to do with a batch whose worker died is decided here. There is a web server in any case;
                    # at the usual port only one can be.
                    scheduler_kwargs={"allowed_failures": 0, "dashboard_address": "127.0.0.1:0"},
                )
        except Exception as problem:  # whatever it was, there is no cluster
            cause: BaseException = problem
            while cause.__cause__ is not None:
                cause = cause.__cause__
            why = str(cause) or type(cause).__name__
            raise SchedulerError(
                f"scheduler = 'processes': no workers could be started: {why}; a script must do this under "
                "if __name__ == '__main__', for every process imports it"
            ) from problem
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        with cluster, distributed.Client(cluster, set_as_default=False) as client, client.as_current():
            try:
                yield client
            except BaseException:
                # What they still compute is of no use; asked kindly, they would take their time.
                for nanny in cluster.workers.values():
                    if nanny.pid:
                        with suppress(OSError):
                            os.kill(nanny.pid, signal.SIGKILL)
                raise


def on_cluster(client: distributed.Client, job: Job, batches: Iterator[Batch]) -> None:
    """Keep a window of batches on a cluster until there are none.

    Batches on a worker that dies are done again at the end, one at a time, so that none suffers for another. One
    at which workers die is halved, down to the point that does it, which then has failed.
    """
    run, parcel = uuid4().hex, _parcel(job.work)
    expected = digests(job.work.function) if _importable(job.work.function) else None
    under_way: dict[distributed.Future, Batch] = {}
    suspects: list[tuple[Batch, int]] = []
    alone: int | None = None  # how often the one under way has died before, if it is a suspect

    def submit(batch: Batch) -> None:
        told = (*job.arguments(batch), job.as_shard, expected)
        future = client.submit(_remote, run, parcel, *told, pure=False)
        under_way[future] = batch
        job.begun(batch)

    halted = False
    while True:
        if job.stopped():
            if under_way and not halted:
                # What waits at a worker comes back as it is; only the worker knows what it has begun.
                client.run(_halt, run, on_error="ignore")
                halted = True
        elif alone is None:
            # Whoever wants to stop at a failure wants nothing waiting at a worker that has one.
            slots = (1 if job.fail_fast else WINDOW) * max(_workers(client), 1)
            while len(under_way) < slots and (batch := next(batches, None)) is not None:
                submit(batch)
            if not under_way and suspects:
                batch, alone = suspects.pop()
                submit(batch)
        if not under_way:
            return
        for future in _arrived(client, list(under_way)):
            batch = under_way.pop(future)
            try:
                result = _result(future)
            except distributed.KilledWorker:
                if alone is not None and len(batch) == 1 and alone + 1 == DEATHS:
                    job.finished(batch, _killed(job, batch))
                else:
                    job.withdrawn(batch)
                    suspects += _suspected(batch, alone)
            else:
                if result is None:
                    job.withdrawn(batch)
                else:
                    job.finished(batch, result)
            alone = None


def _suspected(batch: Batch, alone: int | None) -> list[tuple[Batch, int]]:
    """What is to be tried alone now that a worker has died at a batch, and how often it has died alone already."""
    if alone is None:
        return [(batch, 0)]
    if len(batch) == 1:
        return [(batch, alone + 1)]
    return [(half, 0) for half in np.array_split(batch, 2)]


def _arrived(client: distributed.Client, futures: list[distributed.Future]) -> list[distributed.Future]:
    """Those that are done, after a moment; perhaps none."""
    begin = time.monotonic()
    while True:
        with suppress(TimeoutError), _answering():
            return list(distributed.wait(futures, timeout=TICK, return_when="FIRST_COMPLETED").done)
        if _workers(client):
            return []
        if time.monotonic() - begin > BEREFT:
            raise SchedulerError("the cluster has no workers left; what was finished is kept")


def _workers(client: distributed.Client) -> int:
    with _answering():
        return len(client.nthreads())


def _result(future: distributed.Future) -> Result | None:
    """What has come of a batch; None if it was not begun."""
    try:
        with _answering():
            result: Result | None = future.result()
    except (distributed.KilledWorker, SchedulerError):
        raise
    except Exception as problem:  # noqa: BLE001 - whatever a worker raises before it comes to the points
        told = " ".join(f"{type(problem).__name__}: {problem}".split())
        raise SchedulerError(f"the workers cannot compute this: {told}") from None
    return result


@contextmanager
def _answering() -> Iterator[None]:
    """What Dask raises when the scheduler has gone, in our words."""
    try:
        yield
    except TimeoutError:
        raise
    except (CancelledError, distributed.client.FuturesCancelledError, OSError):
        raise SchedulerError("the scheduler does not answer any more; what was finished is kept") from None


def _killed(job: Job, batch: Batch) -> Result:
    """A point at which workers die, as a point that failed."""
    work = job.work
    points, key = job.arguments(batch)
    table = Work(work.name, _died, {}, work.variables, work.shapes).table(points, key)
    table.reproduce[0] = one_liner(
        work.function, {name: values[0] for name, values in points.items()}, work.constants
    )
    return packed(work, table, job.as_shard)


def _died(points: Points) -> dict[str, Any]:
    raise RuntimeError(f"the process that computed this point died, {DEATHS} times out of {DEATHS}")


def _parcel(work: Work) -> bytes:
    """The work as it is sent, packed once for all batches."""
    try:
        return bytes(cloudpickle.dumps(work))
    except Exception as problem:  # noqa: BLE001 - any object may refuse in its own way
        raise SchedulerError(
            f"the function of sweep {work.name} cannot be sent to other processes: {problem}"
        ) from None


# Of a worker: runs of which it is to begin no more batches.
HALTED: set[str] = set()


def _halt(run: str) -> None:
    HALTED.add(run)


def _remote(
    run: str, parcel: bytes, points: Points, key: Columns, as_shard: bool, expected: dict[str, str] | None
) -> Result | None:
    """What a worker does; `expected` are the digests of the function's code, if that is not sent."""
    if run in HALTED:
        return None
    work = _unpacked(parcel)
    if expected is not None and _digests(work.function) != expected:
        raise RuntimeError("this worker has another version of the code; install the same one everywhere")
    with threadpool_limits(1, user_api="blas"):
        return finish(work, points, key, as_shard)


def _importable(function: Any) -> bool:
    """Whether a worker imports the function by its name; others are sent to it with their code."""
    while isinstance(function, partial):
        function = function.func
    module = sys.modules.get(getattr(function, "__module__", None) or "__main__")
    if module is None or module.__name__ == "__main__":
        return False
    return getattr(module, getattr(function, "__qualname__", ""), None) is function


@lru_cache(maxsize=4)
def _unpacked(parcel: bytes) -> Work:
    work: Work = cloudpickle.loads(parcel)
    return work


@lru_cache(maxsize=4)
def _digests(function: Any) -> dict[str, str]:
    return digests(function)
