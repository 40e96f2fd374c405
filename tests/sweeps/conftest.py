"""What tests of sweeps share."""

import distributed
import pytest

from tests.helpers.sweep_programs import QUIET


@pytest.fixture
def path(tmp_path):
    """Where a sweep is stored."""
    return tmp_path / "sweep.nc"


@pytest.fixture
def inner():
    """A scheduler with one worker of eight threads, all in this process."""
    where = {"processes": False, "protocol": "tcp://"}
    with distributed.LocalCluster(n_workers=1, threads_per_worker=8, **where, **QUIET) as one:
        yield one.scheduler_address
