"""Workers of clusters that die, leave, join, lack code or have other code; schedulers that go away."""

import gc
import importlib
import os
import subprocess
import sys
import threading
import time
from functools import partialmethod

import distributed
import numpy as np
import pytest

from sweeps import ClusterLostError, SchedulerError
from sweeps.compute import cluster, executors
from sweeps.errors import WorkerDied
from sweeps.storage.parts import PartWriter
from tests import HOME
from tests.helpers.backends import INSIDE, QUIET, assert_right, simple, visible
from tests.helpers.sweep_programs import make

CODE = "def double(points):\n    return {{'y': {} * points['x']}}\n"
ELSEWHERE = f"""
import sys, distributed
cluster = distributed.LocalCluster(n_workers=1, **{INSIDE})
print(cluster.scheduler_address, flush=True)
for line in sys.stdin:
    exec(line)
    print("done", flush=True)
"""


# Addresses.


@pytest.mark.parametrize("wrong", ["tcp://127.0.0.1:1", "nonsense://here", "tls://nowhere.invalid:1"])
def test_an_address_without_a_scheduler_is_named(wrong, monkeypatch, capfd):
    assert cluster.CONNECT_TIMEOUT <= 10.0
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 0.5)
    with pytest.raises(SchedulerError, match=f"^scheduler = '{wrong}': no Dask scheduler answers") as caught:
        make(points=4).plan().run(wrong)
    assert ("under distributed.comm.tls" in str(caught.value)) == wrong.startswith("tls")
    gc.collect()  # else Dask's failed client ends on the thread of the next one, under a lock of both
    assert capfd.readouterr() == ("", "")


def test_a_cluster_without_workers_is_refused_and_one_with_certificates_serves(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 2.0)
    options = INSIDE | {"protocol": "tls://", "security": distributed.Security.temporary()}
    with distributed.LocalCluster(n_workers=0, **options) as one:
        with pytest.raises(SchedulerError, match=r"it has no workers; start some with: dask worker tls://"):
            make(points=4).plan().run(one)
        one.scale(1)
        assert_right(make(points=24).plan().run(one))


# Code of workers.


@pytest.fixture
def elsewhere(tmp_path):
    """A cluster in another process, with the modules of a folder `there`; and how to execute lines in it."""
    folder = tmp_path / "there"
    folder.mkdir()
    own = {"PYTHONPATH": f"{folder}{os.pathsep}{HOME}", "PYTHONDONTWRITEBYTECODE": "1"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    process = subprocess.Popen([sys.executable, "-c", ELSEWHERE], env=os.environ | own, **pipes)

    def execute(line):
        process.stdin.write(f"{line}\n")
        process.stdin.flush()
        assert process.stdout.readline() == "done\n"

    yield process.stdout.readline().strip(), folder, execute, process
    process.kill()
    process.communicate()


def test_workers_without_the_code_or_with_other_code_are_refused(path, tmp_path, monkeypatch, elsewhere, capfd):
    address, there, execute, _ = elsewhere
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "only_here.py").write_text(CODE.format(2))
    (tmp_path / "of_two_versions.py").write_text(CODE.format(2))
    (there / "of_two_versions.py").write_text(CODE.format("20 "))
    reasons = {"only_here": "No module named 'only_here'", "of_two_versions": "another version of the"}
    for name, reason in reasons.items():
        with pytest.raises(SchedulerError, match=f"^the workers cannot compute this: .*{reason}"):
            simple(importlib.import_module(name).double).plan(tmp_path / f"{name}.nc").run(address)

    # The worker has imported the file that is edited now; the client imports it afterwards.
    (there / "edited.py").write_text(CODE.format(2))
    execute("import edited")
    (there / "edited.py").write_text(CODE.format("30 "))
    monkeypatch.syspath_prepend(there)
    function = importlib.import_module("edited").double
    for fresh in (False, True):
        with pytest.raises(SchedulerError, match="this worker has another version of the code"):
            simple(function).plan(path, fresh=fresh).run(address)
    execute("import importlib, edited; importlib.reload(edited)")
    np.testing.assert_array_equal(simple(function).plan(path).run(address)["y"], 30.0 * np.arange(24.0))
    assert capfd.readouterr() == ("", "")


# Workers and schedulers that go away.


def test_a_worker_that_dies_is_an_error_of_ours():
    with pytest.raises(WorkerDied), cluster._translated():
        raise distributed.KilledWorker("a batch", "a worker", 0)


@pytest.mark.slow
@pytest.mark.usefixtures("small_pieces")
def test_a_point_that_kills_workers_of_a_cluster_fails_alone(path):
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, **QUIET) as some:
        data = make(points=40, parent=os.getpid(), deadly=22.0).plan(path).run(some)
    assert_right(data, failed=(7.0, 22.0))


@pytest.mark.usefixtures("small_pieces")
def test_workers_that_lack_the_engine_and_a_scheduler_that_goes_away(path, elsewhere, capfd, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 2.0)
    address, _, execute, process = elsewhere
    execute("sys.modules['sweeps'] = None")
    with pytest.raises(SchedulerError, match=r"^the workers cannot compute this: .*ModuleNotFoundError"):
        make(points=4).plan().run(address)
    execute("del sys.modules['sweeps']")
    with pytest.raises(ClusterLostError, match=r"^the scheduler does not answer any more$"):
        make(pause=0.05).plan(path).run(address, None, lambda snapshot: snapshot.done >= 5 and process.kill())
    assert make(pause=0.05).plan(path).cached >= 4
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
@pytest.mark.usefixtures("small_pieces")
def test_workers_may_leave_and_join_and_finished_batches_outlive_the_last(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "NO_WORKER_TIMEOUT", 0.5)
    monkeypatch.setattr(cluster, "POLL_INTERVAL", 0.1)
    options = INSIDE | {"n_workers": 2, "threads_per_worker": 2}
    with distributed.LocalCluster(**options) as some, some.get_client() as client:
        leaving = [next(iter(client.nthreads()))]

        def leave(snapshot):
            if snapshot.done >= 16 and leaving:
                some.scale(3)
                client.retire_workers([leaving.pop()])

        assert_right(make(pause=0.02).plan(tmp_path / "a.nc").run(some, None, leave))
        assert not leaving
        with pytest.raises(ClusterLostError, match=r"^the cluster has no workers left$"):
            make(pause=0.02).plan(tmp_path / "b.nc").run(some, None, lambda s: s.done >= 16 and some.scale(0))
    plan = make(pause=0.02).plan(tmp_path / "b.nc")
    assert 8 <= plan.cached < 60
    assert_right(plan.run())


# The costs of a batch.


def nap(points, ballast=None):
    time.sleep(0.005 * len(points["x"]))
    return {"y": 2.0 * points["x"]}


@pytest.mark.usefixtures("small_pieces")
def test_workers_that_see_the_folder_write_their_parts_themselves(path, inside, monkeypatch):
    writers, write = set(), PartWriter.write

    def written(self, *arguments, refuses=False):
        is_main = threading.current_thread() is threading.main_thread()
        if refuses and not is_main:
            raise PermissionError(13, "Permission denied")
        writers.add(is_main)
        write(self, *arguments)

    # Workers that cannot write, or do not see the file that proves it, send the results.
    for owner, name, replacement, is_main in (
        (PartWriter, "write", written, False),
        (PartWriter, "write", partialmethod(written, refuses=True), True),
        (executors.Path, "write_text", lambda self, text: 0, True),
    ):
        monkeypatch.setattr(owner, name, replacement)
        writers.clear()
        data = simple(nap).plan(path, fresh=True).run(inside)
        np.testing.assert_array_equal(data["y"], 2.0 * data["x"])
        assert writers == {is_main}
    assert visible(path.parent) == [path.name]
