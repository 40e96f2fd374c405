"""Dask clusters as executors: processes on this machine, or workers elsewhere.

A plug-in takes the task of a run to the workers once, also to those that join later. A worker that sees the folder
of the parts, which a file with the run's name proves, writes its parts itself; results of other workers travel.
"""

# mypy: disallow-untyped-calls=False, disallow-any-generics=False

import logging
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cached_property
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any
from uuid import uuid4

import cloudpickle  # type: ignore[import-untyped]
import dask
import distributed
import numpy as np
from distributed.utils import silence_logging_cmgr
from numpy.typing import NDArray

from sweeps.errors import ClusterLostError, InputError, SchedulerError, UndeclaredError, WorkerDied
from sweeps.fingerprint.code import check_loaded, digests
from sweeps.fingerprint.provenance import environment
from sweeps.storage.parts import PartWriter
from sweeps.task import BatchSummary, Task, importable

# s to wait for a scheduler's answer and its first worker; for another worker when none is left, since restarting
# one takes a few; and between counts of the workers.
CONNECT_TIMEOUT, NO_WORKER_TIMEOUT, POLL_INTERVAL = 10.0, 60.0, 1.0
SCHEDULER_LOST = "the scheduler does not answer any more"

# Configuration of our own workers.
CONFIGURATION = {
    # A worker that samples its own stack a hundred times a second takes a tenth of the time of loops in Python.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    # Dask's workers return memory to the system at once, and get it again page by page: a tenth of the time of
    # a function that needs the same arrays over and over. These keep up to 64 MB of it.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 26,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 24,
    # Dask's web servers have no authentication, so they show nothing.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
# Dask gives up a worker that does not come back within 15 s; restarting one on a busy machine may take longer.
NEVER_GIVEN_UP = {"distributed.deploy.lost-worker-timeout": "1 day"}


@contextmanager
def cluster(
    scheduler: Any, workers: int, task: Task, code: tuple[str | Path, ...], writer: PartWriter | None
) -> "Iterator[Cluster]":
    """Workers that are ready for the batches of a task, new ones or a scheduler's; else a SchedulerError."""
    payload = _Payload(task, code, writer)
    connection: AbstractContextManager[distributed.Client] = nullcontext(scheduler)
    if not isinstance(scheduler, distributed.Client):
        connection = _own_cluster(workers) if scheduler == "processes" else _connected(scheduler)
    # Whoever meets lost connections and killed workers reports them in one line; Dask's log would repeat them.
    with silence_logging_cmgr(logging.CRITICAL), connection as client:
        try:
            with suppress(OSError):
                if payload.probe is not None:
                    payload.probe.write_text(payload.name)
            with _translated():
                client.register_plugin(payload)
            yield Cluster(client, payload.name)
        finally:
            if payload.probe is not None:
                payload.probe.unlink(missing_ok=True)
            with suppress(Exception):
                client.unregister_worker_plugin(payload.name)


@contextmanager
def _connected(scheduler: Any) -> Iterator[distributed.Client]:
    address = str(getattr(scheduler, "scheduler_address", scheduler))
    who = f"scheduler = {address!r}:"
    try:
        # Of a cluster object the client takes the certificates too.
        client = distributed.Client(scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError) as problem:
        what = f"no Dask scheduler answers there ({type(problem).__name__}); start one, or leave it out"
        tls = "; its certificates must be in Dask's configuration, under distributed.comm.tls"
        raise SchedulerError(f"{who} {what}{tls * address.startswith('tls://')}") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_TIMEOUT)
        except TimeoutError:
            raise SchedulerError(f"{who} it has no workers; start some with: dask worker {address}") from None
        yield client


@contextmanager
def _own_cluster(workers: int) -> Iterator[distributed.Client]:
    who = "scheduler = 'processes':"
    if multiprocessing.current_process().daemon:
        raise SchedulerError(f"{who} a worker of another cluster cannot start workers; use threads")
    with tempfile.TemporaryDirectory(prefix="sweeps-", ignore_cleanup_errors=True) as folder:
        # Threads and processes that begin here ignore a terminal's Ctrl-C: workers finish their batches. The first
        # thread that needs Python's tracker of resources starts it and unblocks all; so it starts before.
        if os.name != "nt":
            resource_tracker.ensure_running()
            before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            # Scheduler and workers make folders of their own there.
            with dask.config.set(CONFIGURATION | {"temporary-directory": folder}):
                own = distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                    # A scheduler or worker executes what it receives, and every user of the machine reaches
                    # its port: TLS excludes all who do not have the key of this run.
                    security=distributed.Security.temporary(),
                    # Workers spill nothing to a disk and are not killed for their size.
                    memory_limit=0,
                    # The run decides about a batch whose worker died. There is a web server in any case; at
                    # the usual port only one can be.
                    scheduler_kwargs={"allowed_failures": 0, "dashboard_address": "127.0.0.1:0"},
                )
        except Exception as problem:  # whatever it was, there is no cluster
            cause: BaseException = problem
            while cause.__cause__ is not None:
                cause = cause.__cause__
            advice = "a script must do this under if __name__ == '__main__', for every process imports it"
            why = f"no workers could be started: {str(cause) or type(cause).__name__}; {advice}"
            raise SchedulerError(f"{who} {why}") from problem
        finally:
            if os.name != "nt":
                signal.pthread_sigmask(signal.SIG_SETMASK, before)
        # The configuration is read whenever a worker is lost.
        with dask.config.set(NEVER_GIVEN_UP), own, distributed.Client(own, set_as_default=False) as client:
            try:
                yield client
            except BaseException:
                # A graceful shutdown waits for running batches, whose results are lost now.
                for nanny in own.workers.values():
                    if nanny.pid:
                        with suppress(OSError):
                            os.kill(nanny.pid, signal.SIGTERM if os.name == "nt" else signal.SIGKILL)
                raise


@contextmanager
def _translated() -> Iterator[None]:
    """Raise an error of this package for what Dask raises."""
    try:
        yield
    except UndeclaredError:
        raise
    except distributed.KilledWorker:
        raise WorkerDied from None
    except (CancelledError, distributed.client.FuturesCancelledError, OSError, TimeoutError):
        raise ClusterLostError(SCHEDULER_LOST) from None
    except Exception as problem:  # noqa: BLE001 - workers may lack anything
        text = " ".join(f"{type(problem).__name__}: {problem}".split())
        raise SchedulerError(f"the workers cannot compute this: {text}") from None


class _Payload(distributed.WorkerPlugin):
    """The task and the folder of a run, as a worker keeps them for all batches."""

    # Whether to begin no more batches.
    halted = False

    def __init__(self, task: Task, code: tuple[str | Path, ...], writer: PartWriter | None) -> None:
        self.name = f"sweeps-{uuid4().hex}"
        # Workers that see this file see the folder of the parts.
        self.probe = None if writer is None else writer.folder / f".{self.name}.probe"
        # A function that cannot be imported travels with its code.
        functions = [] if importable(task.function) is None else [task.function]
        names = [each for each in code if isinstance(each, str)]
        expected, token = digests(functions, names), "" if writer is None else writer.token
        try:
            # Unpacked with the first batch: a worker that cannot would refuse the plug-in without a reason.
            self.content = cloudpickle.dumps((task, functions, names, expected, token))
        except Exception as problem:  # noqa: BLE001 - any object may refuse in its own way
            who = f"the function of sweep {task.name}"
            raise SchedulerError(f"{who} cannot be sent to other processes: {problem}") from None

    @cached_property
    def task_and_writer(self) -> tuple[Task, PartWriter | None]:
        """The task, if this worker has the client's code, and the writer of parts, if it sees their folder."""
        task, functions, names, expected, token = cloudpickle.loads(self.content)
        check_loaded(functions, names)
        if digests(functions, names) != expected:
            raise InputError("this worker has another version of the code; install the same one everywhere")
        return task, PartWriter(self.probe.parent, task.stored, token) if self.probe and self.is_seen() else None

    def is_seen(self) -> bool:
        """Whether this worker sees the folder of the parts; after the run no more, since another may have it."""
        return self.probe is not None and os.path.exists(self.probe)


def _compute(run: str, name: str, points: NDArray[np.intp] | range) -> BatchSummary | None:
    payload: Any = distributed.get_worker().plugins[run]
    if payload.halted:
        return None
    task, writer = payload.task_and_writer
    summary: BatchSummary = task.run(np.asarray(points))
    if writer is not None and summary.result is not None and payload.is_seen():
        # If writing fails here, it may succeed where the client is.
        with suppress(OSError):
            writer.write(name, summary.result)
            summary = summary._replace(result=None)
    return summary


class Cluster:
    """An executor on the workers of a Dask cluster that have the payload of a run."""

    window = 4  # submitted batches for each thread at most: one to work on, one that waits, two that travel

    def __init__(self, client: distributed.Client, run: str) -> None:
        self.client, self.run = client, run
        self._executor = client.get_executor(pure=False)
        self._seen = time.monotonic()
        self.check()

    def check(self) -> None:
        """Count the workers; a ClusterLostError if there have been none for NO_WORKER_TIMEOUT."""
        try:
            self._threads = int(sum(self.client.nthreads().values()))
        except Exception as problem:
            raise ClusterLostError(SCHEDULER_LOST) from problem
        self._counted = time.monotonic()
        if self._threads:
            self._seen = self._counted
        elif self._counted - self._seen > NO_WORKER_TIMEOUT:
            raise ClusterLostError("the cluster has no workers left")

    def environments(self, libraries: tuple[str, ...]) -> list[dict[str, str]]:
        """Those of the present workers."""
        with _translated():
            return list(self.client.run(environment, libraries).values())

    @property
    def workers(self) -> int:
        """Number of batches that are computed at a time."""
        if time.monotonic() - self._counted > POLL_INTERVAL:
            self.check()
        return max(self._threads, 1)

    def submit(self, name: str, points: NDArray[np.intp]) -> Future[BatchSummary | None]:
        """Compute a batch, and store it as the part `name`."""
        every = range(int(points[0]), int(points[0]) + len(points))
        sent = every if np.array_equal(points, np.arange(every.start, every.stop)) else points
        future: Future[BatchSummary | None] = self._executor.submit(_compute, self.run, name, sent)
        return future

    def result(self, future: Future[BatchSummary | None]) -> BatchSummary | None:
        """The summary of a finished batch; None if it was not begun."""
        with _translated():
            return future.result()

    def halt(self) -> None:
        """Begin no more batches; only a worker knows which of its batches have begun."""
        run = self.run

        def halt(dask_worker: Any) -> None:
            dask_worker.plugins[run].halted = True

        with suppress(Exception):
            self.client.run(halt, on_error="ignore")
