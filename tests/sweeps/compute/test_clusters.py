"""What a cluster costs and survives: its threads, what travels, who writes, who dies, and who leaves in time."""

import os
import pickle
import subprocess
import sys
import threading
import time

import distributed
import numpy as np
import pytest
from threadpoolctl import threadpool_info

from sweeps import Axis, Grid, Sweep, Variable, open_results
from sweeps.compute import cluster
from sweeps.compute.batch import one_blas_thread
from sweeps.compute.cluster import Cluster
from sweeps.storage.parts import PartFolder
from tests import HOME
from tests.helpers.sweep_programs import QUIET, end, make, values

pytestmark = pytest.mark.usefixtures("small_pieces")
COMPUTED: list[float] = []


def nap(points, ballast=None):
    COMPUTED.extend(points["x"].tolist())
    time.sleep(0.01 * len(points["x"]))
    return {"y": 2.0 * points["x"]}


def naps(points=200, **options):
    return Sweep("naps", nap, Grid({"x": Axis(np.arange(float(points)))}), {"y": Variable()}, **options)


def test_threads_of_workers_are_counted(inner, monkeypatch):
    monkeypatch.setattr("sweeps.watch.monitor.SHOWN", 1000)
    most = []
    naps().plan().run(inner, None, lambda snapshot: most.append(len(snapshot.now)))
    assert max(most) == 8 * Cluster.window


def test_what_all_batches_share_travels_once(inner, monkeypatch):
    sizes, payloads = [], []
    submit, register = distributed.Client.map, distributed.Client.register_plugin

    def submitted(self, function, *arguments, **options):
        sizes.extend(len(pickle.dumps(each)) for each in zip(*arguments, strict=True))
        return submit(self, function, *arguments, **options)

    def registered(self, plugin, *arguments, **options):
        payloads.append(len(pickle.dumps(plugin)))
        return register(self, plugin, *arguments, **options)

    monkeypatch.setattr(distributed.Client, "map", submitted)
    monkeypatch.setattr(distributed.Client, "register_plugin", registered)
    data = naps(40, constants={"ballast": np.zeros(1_000_000)}).plan().run(inner)
    assert np.all(data["status"] == 1)
    assert len(payloads) == 1
    assert payloads[0] > 8e6
    assert len(sizes) == 40
    assert max(sizes) < 500

    # What is sent for a batch does not grow with the grid.
    monkeypatch.setattr("sweeps.plan.batches.BATCH_BYTES", 48.0 * 5)
    sizes.clear()
    make(points=100).plan().run(inner)
    small, count = max(sizes), len(sizes)
    sizes.clear()

    def enough(snapshot):
        if len(sizes) >= count:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        make(points=1_000_000).plan().run(inner, None, enough)
    assert len(sizes) >= count
    assert max(sizes) <= small + 64


def test_workers_that_see_the_store_write_their_parts(tmp_path, inner, monkeypatch):
    writers, refusing, put = [], [], PartFolder.put

    def written(self, name, content):
        main = threading.current_thread() is threading.main_thread()
        if refusing and not main:
            raise PermissionError(13, "Permission denied")
        writers.append(main)
        put(self, name, content)

    def run():
        writers.clear()
        data = naps(40).plan(tmp_path / "naps.nc", fresh=True).run(inner)
        np.testing.assert_array_equal(data["y"], 2.0 * data["x"])
        return writers

    monkeypatch.setattr(PartFolder, "put", written)
    assert run() == [False] * 40
    # Workers that cannot write hand over what they have.
    refusing.append(True)
    assert run() == [True] * 40
    # Without the file that tells them that they see it, everything travels.
    refusing.clear()
    monkeypatch.setattr(cluster.Path, "write_text", lambda self, text: 0)
    assert run() == [True] * 40
    assert os.listdir(tmp_path) == ["naps.nc"]


def test_a_limit_of_threads_lasts_until_the_last_has_done():
    def pools():
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    # Whichever thread was the first to set a limit, others may set one too.
    with one_blas_thread():
        assert pools() <= {1}
    before, held, done = pools(), threading.Event(), threading.Event()

    def first():
        with one_blas_thread():
            held.set()
            done.wait(10.0)

    thread = threading.Thread(target=first)
    thread.start()
    held.wait(10.0)
    with one_blas_thread():
        done.set()
        thread.join()
        assert pools() <= {1}
    assert pools() == before


WORKER = """
import sys
from distributed.cli.dask_worker import main
sys.argv[1:] = [sys.argv[1], "--nworkers", "2", "--nthreads", "1", "--no-dashboard", "--lifetime", "20s",
                "--lifetime-stagger", "4s", "--lifetime-restart", "--local-directory", sys.argv[2]]
main()
"""


@pytest.mark.slow
def test_workers_that_leave_before_their_time_is_up_cost_nothing(tmp_path):
    log, path = tmp_path / "log", tmp_path / "powers.nc"
    with distributed.LocalCluster(n_workers=0, **QUIET) as empty:
        command = [sys.executable, "-c", WORKER, empty.scheduler_address, str(tmp_path)]
        workers = subprocess.Popen(
            command,
            cwd=HOME,
            env=os.environ | {"PYTHONPATH": str(HOME)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        counts = []
        try:
            begin = time.monotonic()
            data = (
                make(points=600, log=log, pause=0.3)
                .plan(path)
                .run(empty.scheduler_address, None, lambda snapshot: counts.append(snapshot.done))
            )
            assert time.monotonic() - begin > 60.0
        finally:
            end(workers)
    assert counts == sorted(counts)
    assert counts[-1] == 600
    assert np.count_nonzero(data["status"] == 2) == 1
    expected = make(points=600).plan().run("sync")
    np.testing.assert_array_equal(values(open_results(path))["square"], values(expected)["square"])
