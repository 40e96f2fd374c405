"""Dask clusters, which take seconds to start, for all tests of the folder."""

import signal

import distributed
import pytest

from tests.helpers.backends import INSIDE, QUIET


@pytest.fixture(scope="session")
def outside():
    """A cluster with a worker of two threads in a process of its own."""
    with distributed.LocalCluster(n_workers=1, threads_per_worker=2, **QUIET) as one:
        yield one


@pytest.fixture(scope="session")
def inside():
    """A cluster with two workers of four threads in this process."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=4, **INSIDE) as one:
        yield one


@pytest.fixture(params=["sync", "threads", "address"])
def scheduler(request):
    """Kinds of back ends; on request also a "client" or a "cluster", which are an address's after all."""
    if request.param == "client":
        with distributed.Client(request.getfixturevalue("inside"), set_as_default=False) as client:
            yield client
    elif request.param == "cluster":
        yield request.getfixturevalue("inside")
    else:
        is_address = request.param == "address"
        yield request.getfixturevalue("outside").scheduler_address if is_address else request.param


@pytest.fixture
def interruptible():
    """Ctrl-C as a terminal's process has it; a worker of pytest-xdist ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
