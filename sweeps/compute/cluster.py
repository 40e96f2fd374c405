"""Dask clusters as back ends; a plug-in takes the task of a run to all workers, also to those that join later."""

# mypy: disallow-untyped-calls=False, disallow-any-generics=False

import logging
import math
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from typing import Any

import distributed
from distributed.utils import silence_logging_cmgr

from sweeps.compute.executors import Backend, Payload, Points
from sweeps.errors import ClusterLostError, SchedulerError, UndeclaredError, WorkerDied, message
from sweeps.fingerprint.provenance import environment
from sweeps.task import BatchSummary

# s to wait for a scheduler's answer and its first worker; for another worker when none is left, since restarting
# one takes a few; and between counts of the workers.
CONNECT_TIMEOUT, NO_WORKER_TIMEOUT, POLL_INTERVAL = 10.0, 60.0, 1.0
SCHEDULER_LOST = "the scheduler does not answer any more"


@contextmanager
def cluster(scheduler: Any, payload: Payload) -> "Iterator[Cluster]":
    """The workers of a Dask scheduler, prepared for the batches of a task; else a SchedulerError."""
    connection = nullcontext(scheduler) if isinstance(scheduler, distributed.Client) else _connected(scheduler)
    # Whoever meets lost connections and killed workers reports them in one line; Dask's log would repeat them.
    with (
        silence_logging_cmgr(logging.CRITICAL),
        connection as client,
    ):
        try:
            with _translated():
                client.register_plugin(_Plugin(payload))
            yield Cluster(client, payload)
        finally:
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
def _translated() -> Iterator[None]:
    """Replace an exception of Dask by an error of this package."""
    try:
        yield
    except UndeclaredError:
        raise
    except distributed.KilledWorker:
        raise WorkerDied from None
    except (CancelledError, distributed.client.FuturesCancelledError, OSError, TimeoutError):
        raise ClusterLostError(SCHEDULER_LOST) from None
    except Exception as problem:  # noqa: BLE001 - workers may lack anything
        raise SchedulerError(f"the workers cannot compute this: {message(problem)}") from None


class _Plugin(distributed.WorkerPlugin):
    """The payload of a run, as a worker keeps it for all batches."""

    # Whether to begin no more batches.
    halted = False

    def __init__(self, payload: Payload) -> None:
        self.name, self.payload = payload.name, payload


def _compute(run: str, name: str, points: Points) -> BatchSummary | None:
    plugin: Any = distributed.get_worker().plugins[run]
    summary: BatchSummary | None = None if plugin.halted else plugin.payload.compute(name, points)
    return summary


class Cluster(Backend):
    """The workers of a Dask cluster that have the payload of a run."""

    window = 4  # one to work on, one that waits, two that travel

    def __init__(self, client: distributed.Client, payload: Payload) -> None:
        super().__init__(client.get_executor(pure=False), 0, partial(_compute, payload.name), own=False)
        self.client, self.run = client, payload.name
        self._seen, self._counted = time.monotonic(), -math.inf
        self.check()

    def check(self) -> None:
        """Count the workers from time to time; a ClusterLostError after NO_WORKER_TIMEOUT without workers."""
        if time.monotonic() - self._counted < POLL_INTERVAL:
            return
        try:
            threads = int(sum(self.client.nthreads().values()))
        except Exception as problem:
            raise ClusterLostError(SCHEDULER_LOST) from problem
        self._counted, self.workers = time.monotonic(), max(threads, 1)
        if threads:
            self._seen = self._counted
        elif self._counted - self._seen > NO_WORKER_TIMEOUT:
            raise ClusterLostError("the cluster has no workers left")

    def environments(self, libraries: tuple[str, ...]) -> list[dict[str, str]]:
        """The environments of the present workers."""
        with _translated():
            return list(self.client.run(environment, libraries).values())

    def result(self, future: Future[Any]) -> Any:
        """The summary of a finished batch."""
        with _translated():
            return future.result()

    def halt(self) -> None:
        """Begin no more batches. Only a worker knows which of its batches have begun."""
        run = self.run

        def halt(dask_worker: Any) -> None:
            dask_worker.plugins[run].halted = True

        with suppress(Exception):
            self.client.run(halt, on_error="ignore")
