"""A Dask scheduler or a worker in a process of its own, as somebody else would have started it.

python -m tests.helpers.storms.dask_programs '{"worker": "tcp://127.0.0.1:8786", "numpy": "9.9"}'
"""

import asyncio
import json
import logging
import signal
import sys
import tempfile

import dask
import distributed

from sweeps.fingerprint import provenance

SILENT = {"dashboard_address": "127.0.0.1:0", "host": "127.0.0.1"}


async def serve(told):
    """Be a scheduler, or a worker of one thread for the scheduler at an address."""
    if "worker" in told:
        server = distributed.Worker(told["worker"], nthreads=1, **SILENT)
    else:
        server = distributed.Scheduler(port=0, **SILENT)
    async with server:
        print(server.address, flush=True)
        await server.finished()


def main(told):
    """Serve until killed, with another version of NumPy where one is told; who waits begins at a signal."""
    if "numpy" in told:
        before = provenance._version
        provenance._version = lambda name: told["numpy"] if name == "numpy" else before(name)
    if told.get("waits"):
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1])
        print("ready", flush=True)
        signal.sigwait([signal.SIGUSR1])
    folder = told.get("folder", tempfile.gettempdir())
    logging.disable(logging.CRITICAL)
    with dask.config.set({"temporary-directory": folder}):
        asyncio.run(serve(told))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
