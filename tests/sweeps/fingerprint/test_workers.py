"""Live workers never compute with other code than the client's: what they have loaded is compared."""

import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest
from distributed import LocalCluster

from sweeps import SchedulerError, Sweep, pointwise
from tests.helpers.backends import INSIDE
from tests.sweeps.fingerprint.conftest import LIVE

CACHED = "CACHE = {}\ndef f(a): return CACHE.setdefault(a, 2.0 * a)"


def sweep_of(module):
    """Of a function that travels with its code, and names one of a module that workers import."""
    return Sweep("live", pointwise(lambda a: module.f(a)), {"a": [1.0, 2.0]}, ["y"])


@pytest.fixture
def names(files):
    """A module for each edit."""
    files({f"live_{number}.py": text for number, text in enumerate(LIVE.values())})
    return [f"live_{number}" for number in range(len(LIVE))]


def edited(files, names):
    files({f"{name}.py": text.replace("2.0", "3.0") for name, text in zip(names, LIVE.values(), strict=False)})


def check(files, names, path, executor):
    """Results of the first code are right; those of edited code are refused, for workers have the first."""
    sweep_of(files({"cached.py": CACHED}).load("cached")).plan(path / "cached.nc").run(executor)
    # What the code has changed while it ran is no difference.
    sweep_of(files.load("cached")).plan(path / "again.nc").run(executor)
    for name in names:
        data = sweep_of(files.load(name)).plan(path / f"{name}.nc").run(executor)
        assert data["y"].values.tolist() == [2.0, 4.0], name
    edited(files, names)
    for name in names:
        with pytest.raises(SchedulerError, match="this worker has another version of the code"):
            sweep_of(files.load(name)).plan(path / f"{name}-edited.nc").run(executor)
        assert not (path / f"{name}-edited.nc").exists()


def test_live_workers_of_dask_are_compared(files, names, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(files.folder), *sys.path]))
    with LocalCluster(n_workers=1, threads_per_worker=1, **(INSIDE | {"processes": True})) as cluster:
        check(files, names[:3], tmp_path, cluster)


@pytest.mark.slow  # quick: workers of Dask, above
def test_live_processes_are_compared(files, names, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(files.folder), *sys.path]))
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        check(files, names[3:5], tmp_path, executor)
