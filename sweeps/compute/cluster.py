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
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import resource_tracker
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any
from uuid import uuid4

import cloudpickle  # type: ignore[import-untyped]
import dask
import distributed
import numpy as np
from dask.system import CPU_COUNT
from distributed.utils import silence_logging_cmgr
from numpy.typing import NDArray

from sweeps.compute.local import TICK, Died, Job, Outcome, Receipt, perform
from sweeps.errors import SchedulerError
from sweeps.fingerprint.code import digests
from sweeps.storage.parts import PartFolder

# Seconds to wait for a scheduler's answer and its first worker.
PATIENCE = 10.0
# Seconds to wait for another worker when there is none left; restarting one takes a few.
BEREFT = 60.0
# Seconds between counts of the workers.
COUNTED = 1.0

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
        with (
            cluster,
            distributed.Client(cluster, set_as_default=False) as client,
            client.as_current(),
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


class Payload(distributed.WorkerPlugin):
    """What every batch of a run needs, at a worker.

    Parameters
    ----------
    run : str
        Name of the run, and of the plug-in.
    content : bytes
        The job, pickled.
    expected : dict or None
        Digests of the function's code, where a worker imports it.
    parts : str
        The folder of the parts as the client sees it; "" for none.
    """

    idempotent = True

    def __init__(self, run: str, content: bytes, expected: dict[str, str] | None, parts: str) -> None:
        self.name, self.content, self.expected, self.parts = run, content, expected, parts

    def setup(self, worker: distributed.Worker) -> None:
        """Join a worker; what may fail waits for the first batch."""
        self.halted = False
        self._lock = threading.Lock()
        self._job: Job | None = None
        self._folder: PartFolder | None = None

    def _unpacked(self) -> Job:
        with self._lock:
            if self._job is None:
                job: Job = cloudpickle.loads(self.content)
                if self.expected is not None and digests(job.task.function) != self.expected:
                    raise RuntimeError(
                        "this worker has another version of the code; install the same one everywhere"
                    )
                folder = Path(self.parts)
                with suppress(OSError):
                    if self.parts and probe(folder, self.name).read_text() == self.name:
                        self._folder = PartFolder(folder)
                self._job = job
            return self._job

    def compute(self, name: str, points: NDArray[np.intp] | range) -> Receipt | None:
        """A batch; None if it is not to begin."""
        if self.halted:
            return None
        receipt = perform(self._unpacked(), np.asarray(points))
        if self._folder is not None and receipt.content is not None:
            # What cannot be written from here may be from where the client is.
            with suppress(OSError):
                self._folder.put(name, receipt.content)
                return receipt._replace(content=None)
        return receipt


def probe(parts: Path, run: str) -> Path:
    """The file by which workers find out whether they see a folder."""
    return parts / f".{run}.probe.tmp"


def _compute(run: str, name: str, points: NDArray[np.intp] | range) -> Receipt | None:
    """A batch; a receipt that holds no results goes as an event, which needs no question and no connection."""
    worker: Any = distributed.get_worker()
    receipt: Receipt | None = worker.plugins[run].compute(name, points)
    if receipt is not None and (receipt.content is not None or receipt.result is not None):
        return receipt
    worker.log_event(run, (worker.get_current_task(), receipt and tuple(receipt)))
    return None


def _halt(run: str, dask_worker: distributed.Worker) -> None:
    plugin: Any = dask_worker.plugins[run]
    plugin.halted = True


class Cluster:
    """Workers of a Dask cluster.

    Parameters
    ----------
    client : distributed.Client
    job : Job
    folder : PartFolder, optional
        Where parts go.
    """

    def __init__(self, client: distributed.Client, job: Job, folder: PartFolder | None) -> None:
        self.client, self.run = client, f"sweeps-{uuid4().hex}"
        self._done: SimpleQueue[distributed.Future] = SimpleQueue()
        # Receipts by the keys of their futures; a worker's events overtake nothing and are not overtaken.
        self._receipts: dict[Any, Receipt | None] = {}
        self._counted = self._seen = time.monotonic()
        self._threads = self._count()
        # The worker that is kept free, and the batch that is alone there.
        self._free = ""
        self._alone: distributed.Future | None = None
        self._probe = None if folder is None else probe(folder.path, self.run)
        importable = _importable(job.task.function)
        expected = digests(job.task.function) if importable else None
        self._payload = Payload(self.run, _packed(job), expected, "" if folder is None else str(folder.path))

    def __enter__(self) -> Cluster:
        if self._probe is not None:
            self._probe.write_text(self.run)
        with _answering():
            self.client.register_plugin(self._payload)
            self.client.subscribe_topic(self.run, self._hear)
        return self

    def _hear(self, event: tuple[float, Any]) -> None:
        key, receipt = event[1]
        self._receipts[key] = receipt and Receipt(*receipt)

    def __exit__(self, *problem: Any) -> None:
        with suppress(Exception):
            self.client.unsubscribe_topic(self.run)
            self.client.unregister_worker_plugin(self.run)
        if self._probe is not None:
            self._probe.unlink(missing_ok=True)

    @property
    def workers(self) -> int:
        """How many batches are computed at a time."""
        return max(sum(self._threads.values()), 1)

    def room(self, window: int) -> int:
        """How many batches may be handed out at a time, so many for each thread."""
        if time.monotonic() - self._counted > COUNTED:
            self._threads = self._count()
            self._counted = time.monotonic()
        return window * sum(count for worker, count in self._threads.items() if worker != self._free)

    def _count(self) -> dict[str, int]:
        with _answering():
            return dict(self.client.nthreads())

    def submit(self, name: str, points: NDArray[np.intp], alone: bool = False) -> distributed.Future:
        """Have a batch computed and kept as the part of that name; `alone`: on a worker that has nothing else."""
        first, last = int(points[0]), int(points[-1])
        neighbours = last - first == len(points) - 1 and bool(np.all(np.diff(points) == 1))
        options: dict[str, Any] = {}
        if self._free:
            others = [worker for worker in self._threads if worker != self._free]
            options = {"workers": [self._free] if alone else others, "allow_other_workers": True}
        with _answering():
            future = self.client.submit(
                _compute, self.run, name, range(first, last + 1) if neighbours else points, pure=False, **options
            )
        if alone:
            self._alone = future
        future.add_done_callback(self._done.put)
        return future

    def arrived(self) -> list[tuple[distributed.Future, Outcome]]:
        """What has come of batches meanwhile; waits a moment where there is nothing.

        Raises
        ------
        SchedulerError
            If the scheduler does not answer, or there have been no workers for long.
        """
        futures: list[distributed.Future] = []
        with suppress(Empty):
            futures.append(self._done.get(timeout=TICK))
            while True:
                futures.append(self._done.get_nowait())
        if not futures:
            self._threads = self._count()
            self._seen = time.monotonic() if self._threads else self._seen
            if time.monotonic() - self._seen > BEREFT:
                raise SchedulerError("the cluster has no workers left; what was finished is kept")
            return []
        self._seen = time.monotonic()
        if self._alone in futures:
            self._free, self._alone = "", None
        fetched = [f for f in futures if f.status == "finished" and f.key not in self._receipts]
        if fetched:
            # By way of the scheduler, which knows who has died: alone, a client waits half a minute for the dead.
            with _answering():
                found = self.client.gather(fetched, direct=False)
            self._receipts |= {future.key: receipt for future, receipt in zip(fetched, found, strict=True)}
        return [(f, self._receipts.pop(f.key) if f.key in self._receipts else _problem(f)) for f in futures]

    def halt(self) -> None:
        """Begin no more batches: what waits comes back as it is, for only its worker knows what it has begun."""
        self.client.run(_halt, self.run, on_error="ignore")

    def isolate(self, last: bool) -> bool:
        """Keep a worker free for a batch to be alone at, the only one if it is the `last`; whether it is free."""
        if self._alone is not None:
            return False
        with _answering():
            self._threads = self._count()
            at_work = self.client.processing()
        if len(self._threads) < 2 and not last:
            self._free = ""
            return False
        if self._free not in self._threads:
            self._free = min(self._threads, key=lambda worker: len(at_work.get(worker, ())), default="")
        return bool(self._free) and not at_work.get(self._free)


def _problem(future: distributed.Future) -> Outcome:
    """Why there is nothing of a batch."""
    if future.status == "cancelled":
        return SchedulerError(GONE)
    try:
        with _answering():
            problem = future.exception()
    except SchedulerError as gone:
        return gone
    if isinstance(problem, distributed.KilledWorker):
        return Died()
    text = " ".join(f"{type(problem).__name__}: {problem}".split())
    return SchedulerError(f"the workers cannot compute this: {text}")


GONE = "the scheduler does not answer any more; what was finished is kept"


@contextmanager
def _answering() -> Iterator[None]:
    """What Dask raises when the scheduler has gone, in our words."""
    try:
        yield
    except (CancelledError, distributed.client.FuturesCancelledError, OSError, TimeoutError):
        raise SchedulerError(GONE) from None


def _packed(job: Job) -> bytes:
    """What is sent to every worker."""
    try:
        return bytes(cloudpickle.dumps(job))
    except Exception as problem:  # noqa: BLE001 - any object may refuse in its own way
        raise SchedulerError(
            f"the function of sweep {job.task.name} cannot be sent to other processes: {problem}"
        ) from None


def _importable(function: Any) -> bool:
    """Whether a worker imports the function by its name; others are sent to it with their code."""
    while isinstance(function, partial):
        function = function.func
    module = sys.modules.get(getattr(function, "__module__", None) or "__main__")
    if module is None or module.__name__ == "__main__":
        return False
    return getattr(module, getattr(function, "__qualname__", ""), None) is function
