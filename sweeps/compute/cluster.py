"""The back end of Dask clusters: processes on this machine, or workers elsewhere.

What is the same for all batches travels once, as a plug-in of the workers: who joins later has it too. A worker
that sees the store's folder, which a file there with the run's name proves, writes its parts itself and returns a
receipt; from any other the part itself travels.
"""

# mypy: disallow-untyped-calls=False, disallow-any-generics=False

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from functools import cached_property, partial
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

from sweeps.compute.local import Job, Receipt, WorkerDied
from sweeps.compute.reproduce import importable
from sweeps.errors import ClusterLostError, SchedulerError
from sweeps.fingerprint.code import digests
from sweeps.fingerprint.provenance import environment
from sweeps.storage.parts import PartFolder

# Seconds to wait for a scheduler's answer and its first worker.
PATIENCE = 10.0
# Seconds to wait for another worker when there is none left; restarting one takes a few.
BEREFT = 60.0
# Seconds between counts of the workers.
COUNTED = 1.0
GONE = "the scheduler does not answer any more"

# How Dask runs workers of our own.
CONFIGURATION = {
    # A worker that samples its own stack a hundred times a second takes turns with what it computes: a tenth of
    # the time of loops in Python.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    # Dask's workers give memory back to the system at once, and get it again page by page: a tenth of the time of
    # whoever needs the same arrays over and over. These keep up to 64 MB of it.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 26,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 24,
    # Its web servers ask nobody who he is: they show nothing.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
# Dask gives a worker up for good that is not back within 15 s; restarting one on a busy machine may take longer.
NEVER_GIVEN_UP = {"distributed.deploy.lost-worker-timeout": "1 day"}


@contextmanager
def cluster(address: str | None, workers: int, job: Job, parts: Path | None) -> Iterator[Cluster]:
    """The workers of the scheduler at an address, or new processes on this machine, ready for a job's batches.

    Raises
    ------
    SchedulerError
        If no scheduler answers, it has no workers, no processes can be started, or they cannot compute this.
    """
    payload = _Payload(job, parts)
    # What Dask says of lost connections and killed workers is said in one line by whoever meets it.
    with (
        silence_logging_cmgr(logging.CRITICAL),
        _own(workers) if address is None else _theirs(address) as client,
    ):
        found = Cluster(client, payload.name)
        try:
            if payload.probe is not None:
                with suppress(OSError):
                    payload.probe.write_text(payload.name)
            try:
                with _answering():
                    client.register_plugin(payload)
                    client.subscribe_topic(payload.name, found.hear)
            except Exception as problem:  # noqa: BLE001 - whatever it is that workers lack
                raise _in_our_words(problem) from None
            yield found
        finally:
            with suppress(Exception):
                client.unsubscribe_topic(payload.name)
                client.unregister_worker_plugin(payload.name)
            if payload.probe is not None:
                payload.probe.unlink(missing_ok=True)


def environments_at(address: str) -> list[dict[str, str]]:
    """The environments of the workers that the scheduler at an address has now.

    Raises
    ------
    SchedulerError
        If no scheduler answers, it has no workers, or they have another version of this code.
    """
    with silence_logging_cmgr(logging.CRITICAL), _theirs(address) as client:
        try:
            with _answering():
                return list(client.run(environment).values())
        except Exception as problem:  # noqa: BLE001 - whatever it is that workers lack
            raise _in_our_words(problem) from None


@contextmanager
def _theirs(address: str) -> Iterator[distributed.Client]:
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as problem:
        start = "start one, or leave it out"
        if address.startswith("tls://"):
            start = f"{start}; its certificates must be in Dask's configuration, under distributed.comm.tls"
        raise SchedulerError(
            f"scheduler = {address!r}: no Dask scheduler answers there ({type(problem).__name__}); {start}"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise SchedulerError(
                f"scheduler = {address!r}: it has no workers; start some with: dask worker {address}"
            ) from None
        yield client


@contextmanager
def _own(workers: int) -> Iterator[distributed.Client]:
    if multiprocessing.current_process().daemon:
        raise SchedulerError(
            "scheduler = 'processes': no workers could be started by a worker of another cluster; use threads"
        )
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
                    # Whoever reaches a scheduler or a worker can have it execute anything, and everybody on the
                    # machine reaches them: so they talk only to who has the key of this run.
                    security=distributed.Security.temporary(),
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
        with (
            dask.config.set(NEVER_GIVEN_UP),  # read whenever a worker is lost
            cluster,
            distributed.Client(cluster, set_as_default=False) as client,
        ):
            try:
                yield client
            except BaseException:
                # What they still compute is of no use; asked kindly, they would take their time.
                for nanny in cluster.workers.values():
                    if nanny.pid:
                        with suppress(OSError):
                            os.kill(nanny.pid, signal.SIGKILL)
                raise


@contextmanager
def _answering() -> Iterator[None]:
    """Turn what Dask raises when the scheduler has gone into a `ClusterLostError`."""
    try:
        yield
    except (CancelledError, distributed.client.FuturesCancelledError, OSError, TimeoutError):
        raise ClusterLostError(GONE) from None


def _in_our_words(problem: BaseException) -> BaseException:
    """Why there is nothing of a batch."""
    if isinstance(problem, distributed.KilledWorker):
        return WorkerDied()
    text = " ".join(f"{type(problem).__name__}: {problem}".split())
    return (
        problem
        if isinstance(problem, (SchedulerError, ClusterLostError))
        else SchedulerError(f"the workers cannot compute this: {text}")
    )


class _Payload(distributed.WorkerPlugin):
    """A run's task and folder, as a worker holds them for every batch."""

    # Whether to begin no more batches.
    halted = False

    def __init__(self, job: Job, parts: Path | None) -> None:
        self.name = f"sweeps-{uuid4().hex}"
        # By this file workers find out whether they see the folder of the parts.
        self.probe = None if parts is None else parts / f".{self.name}.probe.tmp"
        try:
            # Unpacked when a batch needs it: a worker that cannot would refuse the plug-in, and not say why.
            self.content = cloudpickle.dumps(job)
        except Exception as problem:  # noqa: BLE001 - any object may refuse in its own way
            raise SchedulerError(
                f"the function of sweep {job.task.name} cannot be sent to other processes: {problem}"
            ) from None
        function: Any = job.task.function
        while isinstance(function, partial):
            function = function.func
        # Workers import the function by its name; others are sent to them with their code.
        self.expected = digests(job.task.function) if importable(function) is function else None

    @cached_property
    def job(self) -> Job:
        """The job, where the worker has the code that the client has."""
        job: Job = cloudpickle.loads(self.content)
        if self.expected is not None and digests(job.task.function) != self.expected:
            raise RuntimeError("this worker has another version of the code; install the same one everywhere")
        return job

    @cached_property
    def folder(self) -> PartFolder | None:
        """The folder of the parts, where the worker sees it."""
        return None if self.probe is None or not os.path.exists(self.probe) else PartFolder(self.probe.parent)


def _compute(run: str, name: str, points: NDArray[np.intp] | range) -> Receipt | None:
    """A batch's receipt, unless that went as an event, or the batch is not to begin."""
    worker: Any = distributed.get_worker()
    payload: _Payload = worker.plugins[run]
    if payload.halted:
        return None
    receipt = payload.job.compute(np.asarray(points))
    if payload.folder is not None and receipt.content is not None:
        # What cannot be written from here may be from where the client is.
        with suppress(OSError):
            payload.folder.put(name, receipt.content)
            receipt = receipt._replace(content=None)
    if receipt.content is not None or receipt.result is not None:
        return receipt
    # The client need not ask for an event, which is a third of what a batch costs it. It overtakes the future.
    worker.log_event(run, (worker.get_current_task(), tuple(receipt)))
    return None


def _halt(run: str, dask_worker: distributed.Worker) -> None:
    payload: Any = dask_worker.plugins[run]
    payload.halted = True


class Cluster:
    """Workers of a Dask cluster, which have the payload of a run."""

    # Batches handed out for each thread at most: one to work on, one waiting, and two that travel together.
    window = 4

    def __init__(self, client: distributed.Client, run: str) -> None:
        self.client, self.run = client, run
        # Receipts that came as events, by the keys of Dask's futures.
        self._receipts: dict[Any, Receipt] = {}
        # The worker that is kept free, and whether a batch is alone there.
        self._free, self._alone = "", False
        self._seen = time.monotonic()
        self.check()

    def hear(self, event: tuple[float, Any]) -> None:
        """Keep a receipt that came as an event."""
        key, receipt = event[1]
        self._receipts[key] = Receipt(*receipt)

    @_answering()
    def check(self) -> None:
        """Count the workers.

        Raises
        ------
        ClusterLostError
            If the scheduler does not answer, or there have been no workers for long.
        """
        self._threads: dict[str, int] = self.client.nthreads()
        self._counted = time.monotonic()
        self._seen = self._counted if self._threads else self._seen
        if self._counted - self._seen > BEREFT:
            raise ClusterLostError("the cluster has no workers left")

    @property
    def workers(self) -> int:
        """How many batches are computed at a time."""
        return max(sum(self._threads.values()), 1)

    def room(self, window: int, under_way: int) -> int:
        """How many batches to hand out now, so that there are at most so many for each thread.

        Where several may wait, half of them are handed out at a time: a message costs what a batch does.
        """
        if time.monotonic() - self._counted > COUNTED:
            self.check()
        most = window * sum(count for worker, count in self._threads.items() if worker != self._free)
        free = most - under_way
        return free if window == 1 or 2 * free >= most else 0

    @_answering()
    def submit(self, names: list[str], batches: list[NDArray[np.intp]], alone: bool = False) -> list[Future[Any]]:
        """Have batches computed and kept as the parts of these names; `alone`: one that has a worker to itself."""
        if not batches:
            return []
        options: dict[str, Any] = {}
        if self._free:
            others = [worker for worker in self._threads if worker != self._free]
            options = {"workers": [self._free] if alone else others, "allow_other_workers": True}
        self._alone = self._alone or alone
        sent = [_compact(points) for points in batches]
        tasks = self.client.map(_compute, [self.run] * len(names), names, sent, pure=False, **options)
        futures: list[Future[Any]] = [Future() for _ in tasks]
        for task, future in zip(tasks, futures, strict=True):
            task.add_done_callback(partial(self._resolve, future, alone))
        return futures

    def _resolve(self, future: Future[Any], alone: bool, task: distributed.Future) -> None:
        """Give a future what has come of its batch; Dask calls this in a thread of its own."""
        if alone:
            self._free, self._alone = "", False
        try:
            if task.status == "cancelled":
                raise ClusterLostError(GONE)
            # Whatever has come of it, a worker had it.
            self._seen = time.monotonic()
            if task.status == "error":
                raise task.exception()
            with _answering():
                # By way of the scheduler, which knows who died: a client that asks the dead waits half a minute.
                receipt = self._receipts.pop(task.key, None) or self.client.gather(task, direct=False)
            future.set_result(receipt)
        except Exception as problem:  # noqa: BLE001 - raised by whoever asks for the result
            future.set_exception(_in_our_words(problem))

    @_answering()
    def halt(self) -> None:
        """Begin no more batches: what waits comes back as it is, for only its worker knows what it has begun."""
        self.client.run(_halt, self.run, on_error="ignore")

    @_answering()
    def isolate(self, last: bool) -> bool:
        """Keep a worker free for a batch to be alone at, the only one if it is the `last`; whether it is free."""
        if self._alone:
            return False
        at_work: dict[str, Any] = self.client.processing()
        if self._free not in at_work:
            least = min(at_work, key=lambda worker: len(at_work[worker]), default="")
            self._free = least if last or len(at_work) > 1 else ""
        return bool(self._free) and not at_work[self._free]


def _compact(points: NDArray[np.intp]) -> NDArray[np.intp] | range:
    """Points as a message holds them at little cost."""
    first, end = int(points[0]), int(points[0]) + len(points)
    return range(first, end) if np.array_equal(points, np.arange(first, end)) else points
