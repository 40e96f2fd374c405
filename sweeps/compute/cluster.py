"""The back end of Dask clusters: processes on this machine, or workers elsewhere.

What is the same for all batches travels once, as a plug-in of the workers: who joins later has it too. A worker
that sees the store's folder, which a file there with the run's name proves, writes its parts itself and returns a
receipt; from any other the part itself travels.
"""

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
from functools import cached_property, partial
from multiprocessing import resource_tracker
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any
from uuid import uuid4

import cloudpickle  # type: ignore[import-untyped]
import dask
import distributed
import numpy as np
from distributed.utils import silence_logging_cmgr
from numpy.typing import NDArray

from sweeps.compute.local import TICK, Died, Job, Outcome, Receipt
from sweeps.errors import SchedulerError
from sweeps.fingerprint.code import digests
from sweeps.storage.parts import PartFolder

# Seconds to wait for a scheduler's answer and its first worker.
PATIENCE = 10.0
# Seconds to wait for another worker when there is none left; restarting one takes a few.
BEREFT = 60.0
# Seconds between counts of the workers.
COUNTED = 1.0
GONE = "the scheduler does not answer any more; what was finished is kept"

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
def connected(address: str | None, workers: int) -> Iterator[distributed.Client]:
    """A Dask client: of the scheduler at an address, or of a new cluster of processes on this machine.

    Raises
    ------
    SchedulerError
        If no scheduler answers, it has no workers, or no processes can be started.
    """
    # What Dask says of lost connections and killed workers is said in one line by whoever meets it.
    with (
        silence_logging_cmgr(logging.CRITICAL),
        _own(workers) if address is None else _theirs(address) as client,
    ):
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
        with cluster, distributed.Client(cluster, set_as_default=False) as client:
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
    """What Dask raises when the scheduler has gone, in our words."""
    try:
        yield
    except (CancelledError, distributed.client.FuturesCancelledError, OSError, TimeoutError):
        raise SchedulerError(GONE) from None


def _uncomputable(problem: BaseException | None) -> SchedulerError:
    text = " ".join(f"{type(problem).__name__}: {problem}".split())
    return SchedulerError(f"the workers cannot compute this: {text}")


class Payload(distributed.WorkerPlugin):
    """What every batch of a run needs, at a worker.

    Parameters
    ----------
    run : str
        Name of the run, and of the plug-in.
    job : Job
    parts : Path or None
        The folder of the parts as the client sees it.

    Raises
    ------
    SchedulerError
        If the job cannot be sent.
    """

    idempotent = True

    def __init__(self, run: str, job: Job, parts: Path | None) -> None:
        # A file by which workers find out whether they see the folder.
        self.name, self.probe = run, None if parts is None else parts / f".{run}.probe.tmp"
        try:
            # Unpacked when a batch needs it: a worker that cannot would refuse the plug-in, and not say why.
            self.content = cloudpickle.dumps(job)
        except Exception as problem:  # noqa: BLE001 - any object may refuse in its own way
            raise SchedulerError(
                f"the function of sweep {job.task.name} cannot be sent to other processes: {problem}"
            ) from None
        self.expected = digests(job.task.function) if _importable(job.task.function) else None

    def setup(self, worker: distributed.Worker) -> None:
        """Join a worker."""
        self.worker, self.halted = worker, False

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
        with suppress(OSError):
            if self.probe is not None and self.probe.read_text() == self.name:
                return PartFolder(self.probe.parent)
        return None

    def compute(self, name: str, points: NDArray[np.intp] | range) -> Receipt | None:
        """Compute a batch; its receipt, unless that goes as an event, or the batch is not to begin."""
        if self.halted:
            return None
        receipt = self.job.compute(np.asarray(points))
        if self.folder is not None and receipt.content is not None:
            # What cannot be written from here may be from where the client is.
            with suppress(OSError):
                self.folder.put(name, receipt.content)
                receipt = receipt._replace(content=None)
        if receipt.content is not None or receipt.result is not None:
            return receipt
        # An event needs no question: a third of what a batch costs the client. It arrives before the future's end.
        self.worker.log_event(self.name, (self.worker.get_current_task(), tuple(receipt)))
        return None


def _compute(run: str, name: str, points: NDArray[np.intp] | range) -> Receipt | None:
    plugin: Any = distributed.get_worker().plugins[run]
    receipt: Receipt | None = plugin.compute(name, points)
    return receipt


def _halt(run: str, dask_worker: distributed.Worker) -> None:
    plugin: Any = dask_worker.plugins[run]
    plugin.halted = True


class Cluster:
    """Workers of a Dask cluster.

    Parameters
    ----------
    client : distributed.Client
    job : Job
    parts : Path or None
        The folder of the parts.
    """

    def __init__(self, client: distributed.Client, job: Job, parts: Path | None) -> None:
        self.client, self.run = client, f"sweeps-{uuid4().hex}"
        self._payload = Payload(self.run, job, parts)
        self._done: SimpleQueue[distributed.Future] = SimpleQueue()
        # Receipts that came as events, by the keys of their futures.
        self._receipts: dict[Any, Receipt | None] = {}
        # The worker that is kept free, and the batch that is alone there.
        self._free = ""
        self._alone: distributed.Future | None = None
        self._seen = time.monotonic()
        self._count()

    @_answering()
    def _count(self) -> None:
        """Count the threads of each worker."""
        self._threads: dict[str, int] = self.client.nthreads()
        self._counted = time.monotonic()
        if self._threads:
            self._seen = self._counted

    def __enter__(self) -> Cluster:
        with suppress(OSError):
            if self._payload.probe is not None:
                self._payload.probe.write_text(self.run)
        with _answering():
            try:
                self.client.register_plugin(self._payload)
            except OSError:
                raise
            except Exception as problem:  # noqa: BLE001 - whatever it is that workers lack
                raise _uncomputable(problem) from None
            self.client.subscribe_topic(self.run, self._hear)
        return self

    def _hear(self, event: tuple[float, Any]) -> None:
        key, receipt = event[1]
        self._receipts[key] = Receipt(*receipt)

    def __exit__(self, *problem: Any) -> None:
        with suppress(Exception):
            self.client.unsubscribe_topic(self.run)
            self.client.unregister_worker_plugin(self.run)
        if self._payload.probe is not None:
            self._payload.probe.unlink(missing_ok=True)

    @property
    def workers(self) -> int:
        """How many batches are computed at a time."""
        return max(sum(self._threads.values()), 1)

    def room(self, window: int) -> int:
        """How many batches may be handed out at a time, so many for each thread."""
        if time.monotonic() - self._counted > COUNTED:
            self._count()
        return window * sum(count for worker, count in self._threads.items() if worker != self._free)

    @_answering()
    def submit(self, name: str, points: NDArray[np.intp], alone: bool = False) -> distributed.Future:
        """Have a batch computed and kept as the part of that name; `alone`: on a worker that has nothing else."""
        first = int(points[0])
        neighbours = np.array_equal(points, np.arange(first, first + len(points)))
        options: dict[str, Any] = {}
        if self._free:
            others = [worker for worker in self._threads if worker != self._free]
            options = {"workers": [self._free] if alone else others, "allow_other_workers": True}
        sent = range(first, first + len(points)) if neighbours else points
        future = self.client.submit(_compute, self.run, name, sent, pure=False, **options)
        if alone:
            self._alone = future
        future.add_done_callback(self._done.put)
        return future

    @_answering()
    def arrived(self) -> list[tuple[distributed.Future, Outcome]]:
        """What has come of batches meanwhile; waits a moment where there is nothing.

        Raises
        ------
        SchedulerError
            If the scheduler does not answer, there have been no workers for long, or they cannot compute this.
        """
        futures: list[distributed.Future] = []
        with suppress(Empty):
            futures.append(self._done.get(timeout=TICK))
            while True:
                futures.append(self._done.get_nowait())
        if not futures:
            self._count()
            if time.monotonic() - self._seen > BEREFT:
                raise SchedulerError("the cluster has no workers left; what was finished is kept")
        if self._alone in futures:
            self._free, self._alone = "", None
        fetched = [f for f in futures if f.status == "finished" and f.key not in self._receipts]
        if fetched:
            # By way of the scheduler, which knows who has died: alone, a client waits half a minute for the dead.
            found = self.client.gather(fetched, direct=False)
            self._receipts |= {future.key: receipt for future, receipt in zip(fetched, found, strict=True)}
        return [(f, self._receipts.pop(f.key) if f.key in self._receipts else _lost(f)) for f in futures]

    def halt(self) -> None:
        """Begin no more batches: what waits comes back as it is, for only its worker knows what it has begun."""
        self.client.run(_halt, self.run, on_error="ignore")

    @_answering()
    def isolate(self, last: bool) -> bool:
        """Keep a worker free for a batch to be alone at, the only one if it is the `last`; whether it is free."""
        if self._alone is not None:
            return False
        at_work: dict[str, Any] = self.client.processing()
        if self._free not in at_work:
            least = min(at_work, key=lambda worker: len(at_work[worker]), default="")
            self._free = least if last or len(at_work) > 1 else ""
        return bool(self._free) and not at_work[self._free]


def _lost(future: distributed.Future) -> Died:
    """What becomes of a batch without a receipt: its worker died, or the run ends."""
    if future.status == "cancelled":
        raise SchedulerError(GONE)
    problem = future.exception()
    if isinstance(problem, distributed.KilledWorker):
        return Died()
    raise _uncomputable(problem)


def _importable(function: Any) -> bool:
    """Whether a worker imports the function by its name; others are sent to it with their code."""
    while isinstance(function, partial):
        function = function.func
    module = sys.modules.get(getattr(function, "__module__", None) or "__main__")
    if module is None or module.__name__ == "__main__":
        return False
    return getattr(module, getattr(function, "__qualname__", ""), None) is function
