"""Threads, processes and clusters: the same results, each at its cost, and one line where it cannot be."""

import os
import pickle
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

import distributed
import numpy as np
import pytest
import xarray as xr
from threadpoolctl import threadpool_info

from sweeps import SchedulerError, SweepStoppedError, open_results
from sweeps.compute import cluster
from sweeps.compute.cluster import Cluster
from tests import HOME
from tests.helpers.sweep_programs import QUIET, cut, end, make, simple, start, undisturbed, values, wait_for

pytestmark = pytest.mark.usefixtures("small_pieces")


@pytest.fixture(scope="module")
def address():
    """A scheduler with two workers, as somebody else would have started it."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, **QUIET) as cluster:
        yield cluster.scheduler_address


def children():
    listed = subprocess.run(
        ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(os.getpid())], capture_output=True, text=True
    )
    return {line.split()[0] for line in listed.stdout.splitlines() if "spawn_main" in line}


@pytest.mark.parametrize("scheduler", ["threads", "processes", "tcp"])
def test_every_back_end_gives_the_same_bits(tmp_path, monkeypatch, address, scheduler):
    monkeypatch.chdir(tmp_path)
    # A folder of its own for what is temporary: others use the system's meanwhile.
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", None)
    before = children()
    expected = undisturbed(24)
    scheduler = address if scheduler == "tcp" else scheduler
    xr.testing.assert_identical(values(make(points=24).plan().run(scheduler, 2)), expected)
    make(points=24).plan("kept/powers.nc").run(scheduler, 2)
    xr.testing.assert_identical(values(open_results("kept/powers.nc")), expected)
    assert sorted(os.listdir()) == ["kept", "temporary"]
    assert children() == before
    assert not [name for name in os.listdir(temporary) if name.startswith(("sweeps-", "dask"))]


@pytest.mark.parametrize("scheduler", ["processes", "tcp"])
def test_functions_without_a_name_and_blas_on_one_thread(address, scheduler):
    factor = 3.0

    def closure(points):
        import scipy.linalg

        x = points["x"]
        scipy.linalg.solve(np.eye(3), np.ones(3))
        pools = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
        return {"y": factor * x, "n": np.full(len(x), max(pools, default=1))}

    data = simple(closure).plan().run(address if scheduler == "tcp" else scheduler, 2)
    np.testing.assert_array_equal(data["y"], 3.0 * data["x"])
    assert np.all(data["n"] == 1)


def test_no_more_is_submitted_than_the_workers_need(address, monkeypatch):
    most, sizes = 0, []
    submit = distributed.Client.map

    def counted(self, function, *arguments, **options):
        sizes.extend(len(pickle.dumps(each)) for each in zip(*arguments, strict=True))
        return submit(self, function, *arguments, **options)

    monkeypatch.setattr(distributed.Client, "map", counted)

    def watch(snapshot):
        nonlocal most
        most = max(most, len(snapshot.now))

    monkeypatch.setattr("sweeps.watch.monitor.SHOWN", 1000)
    make(points=40).plan().run(address, None, watch)
    assert Cluster.window < most <= Cluster.window * 2

    # What is sent for a batch does not grow with the grid.
    monkeypatch.setattr("sweeps.plan.batches.BATCH_BYTES", 48.0 * 5)
    sizes.clear()
    make(points=100).plan().run(address)
    small, count = max(sizes), len(sizes)
    sizes.clear()

    def enough(snapshot):
        if len(sizes) >= count:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        make(points=1_000_000).plan().run(address, None, enough)
    assert len(sizes) >= count
    assert max(sizes) <= small + 64


def test_a_worker_that_is_killed_costs_nothing():
    before, killed = children(), []

    def kill(snapshot):
        if snapshot.done >= 16 and not killed:
            killed.append((children() - before).pop())
            os.kill(int(killed[0]), signal.SIGKILL)

    data = make(points=40, pause=0.02).plan().run("processes", 2, kill)
    assert killed
    xr.testing.assert_identical(values(data), undisturbed(40))


def test_a_point_at_which_workers_die_fails_alone():
    begin = time.monotonic()
    data = make(points=40, parent=os.getpid(), deadly=22.0).plan().run("processes", 2)
    assert time.monotonic() - begin < 40.0
    expected = undisturbed(40)
    xr.testing.assert_identical(values(data).drop_sel(x=22.0), expected.drop_sel(x=22.0))
    lost = data.sel(x=22.0)
    assert int(lost["status"]) == 2
    assert "the process that computed this point died" in str(lost["error"].item())
    told = data["reproduce"].values[data["failure_x"].values.tolist().index(22.0)]
    assert told.startswith("from numpy import array; from tests.helpers.sweep_programs import powers; powers({'x'")


def test_nobody_at_the_address(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    begin = time.monotonic()
    process = start(store=tmp_path / "a.nc", points=4, scheduler=f"tcp://127.0.0.1:{port}", patience=2)
    told = wait_for(process, "SchedulerError")
    assert process.wait(20.0) == 3
    assert time.monotonic() - begin < 8.0
    assert cluster.PATIENCE <= 10.0
    assert f"scheduler = 'tcp://127.0.0.1:{port}': no Dask scheduler answers there" in told
    assert process.stderr.read() == ""
    end(process)


@pytest.mark.parametrize("wrong", ["nonsense://here", "tcp://", "tcp://nowhere.invalid:1"])
def test_addresses_that_are_none(monkeypatch, wrong):
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    with pytest.raises(SchedulerError, match="no Dask scheduler answers there"):
        make(points=4).plan().run(wrong)


def test_a_scheduler_without_workers(monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    said = pytest.raises(SchedulerError, match=r"it has no workers; start some with: dask worker tcp://")
    with distributed.LocalCluster(n_workers=0, **QUIET) as empty, said:
        make(points=4).plan().run(empty.scheduler_address)


def test_workers_that_lack_the_module(tmp_path, address):
    (tmp_path / "only_here.py").write_text("def f(points): return {'y': points['x'], 'n': points['x']}")
    code = f"""
import sys; sys.path.insert(0, {str(tmp_path)!r})
import only_here
from tests.helpers.sweep_programs import cut, simple
from sweeps import SchedulerError
cut()
try:
    simple(only_here.f).plan().run({address!r})
except SchedulerError as problem:
    print(problem)
"""
    told = subprocess.run([sys.executable, "-c", code], cwd=HOME, capture_output=True, text=True)
    assert told.stdout == "the workers cannot compute this: ModuleNotFoundError: No module named 'only_here'\n"
    assert told.stderr == ""


def test_workers_that_lack_the_engine():
    cluster = f"distributed.LocalCluster(n_workers=1, processes=False, protocol='tcp://', **{QUIET})"
    code = f"import sys; sys.modules['sweeps'] = None; import distributed; cluster = {cluster}; "
    code += "print(cluster.scheduler_address, flush=True); sys.stdin.read()"
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    where = process.stdout.readline().strip()
    with pytest.raises(SchedulerError, match=r"^the workers cannot compute this: .*ModuleNotFoundError"):
        make(points=4).plan().run(where)
    process.communicate()


def test_a_function_that_cannot_be_sent():
    lock = threading.Lock()

    def locked(points):
        with lock:
            return {"y": points["x"], "n": points["x"]}

    with pytest.raises(SchedulerError, match="the function of sweep simple cannot be sent to other processes: "):
        simple(locked).plan().run("processes", 1)


def test_a_scheduler_that_goes_away(tmp_path):
    command = f"import distributed, time; cluster = distributed.LocalCluster(n_workers=1, **{QUIET}); "
    command += "print(cluster.scheduler_address, flush=True); time.sleep(100)"
    process = subprocess.Popen(
        [sys.executable, "-c", f"if __name__ == '__main__': {command}"],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    where = process.stdout.readline().strip()
    path = tmp_path / "powers.nc"
    run = start(store=path, points=20, long=0.2, scheduler=where)
    wait_for(run, "progress 5")
    end(process)
    assert "the scheduler does not answer any more" in wait_for(run, "SchedulerError")
    assert run.wait(10.0) == 3
    assert run.stderr.read() == ""
    end(run)
    assert make(points=20, long=0.2).plan(path).cached >= 4


def test_so_many_lanes_as_workers():
    now, most, lock = 0, 0, threading.Lock()

    def count(points):
        nonlocal now, most
        with lock:
            now += 1
            most = max(most, now)
        time.sleep(0.02)
        with lock:
            now -= 1
        return {"y": points["x"], "n": points["x"]}

    for workers in (1, 2, 5):
        most = 0
        simple(count).plan().run("threads", workers)
        assert most == workers


@pytest.mark.parametrize(
    ("scheduler", "problem"),
    [("sync", KeyError), ("threads", RuntimeError), ("threads", OSError), ("processes", RuntimeError)],
)
def test_a_callback_that_raises_ends_the_run(tmp_path, scheduler, problem):
    told = []

    def broken(snapshot):
        told.append(snapshot)
        if snapshot.done > 5:
            raise problem("no more")

    path = tmp_path / "powers.nc"
    with pytest.raises(problem, match="no more"):
        make(points=24, pause=0.01).plan(path).run(scheduler, 2, broken)
    assert [each.done for each in told] == sorted(each.done for each in told)
    assert make(points=24, pause=0.01).plan(path).cached > 4


@pytest.mark.parametrize("scheduler", ["sync", "threads", "processes"])
def test_the_first_failure_can_end_a_run(tmp_path, scheduler):
    path, log = tmp_path / "powers.nc", tmp_path / "log"
    sweep = make(points=40, log=log, pause=0.05)
    with pytest.raises(SweepStoppedError, match=r"first failure: x = 7.0: ValueError: seven is not allowed"):
        sweep.plan(path).run(scheduler, 2, fail_fast=True)
    begun = log.read_text().split()
    # After it failed no batch is begun; its own has one more point, and another lane may just have taken one.
    last = len(begun) - begun[::-1].index("7")
    assert len(begun) - last <= 5
    assert sweep.plan(path).cached == len(set(begun))


def test_counts_and_rate():
    told = []
    make(points=40, pause=0.01).plan().run("sync", progress=told.append)
    last = told[-1]
    assert (last.todo, last.done, last.failed, last.now, last.left) == (40, 40, 1, (), 0.0)
    assert [each.done for each in told] == sorted(each.done for each in told)
    assert all(each.rate < 100.0 for each in told)
    assert {each.now[0].split()[0] for each in told if each.now} == {"x"}
    assert not last.stopping


def test_within_a_thread_and_within_a_worker(address):
    results = []
    thread = threading.Thread(target=lambda: results.append(make(points=24).plan().run("threads", 2)))
    thread.start()
    thread.join()

    def nested(scheduler):
        cut()
        try:
            return values(make(points=24).plan().run(scheduler, 2))
        except SchedulerError as problem:
            return str(problem)

    expected = undisturbed(24)
    xr.testing.assert_identical(values(results[0]), expected)
    with distributed.Client(address, set_as_default=False) as client:
        xr.testing.assert_identical(client.submit(nested, "threads").result(60), expected)
        told = client.submit(nested, "processes").result(60)
        assert isinstance(told, str), told
        assert "no workers could be started" in told


def test_rows_of_a_megabyte_need_little_memory(tmp_path):
    process = start(store=tmp_path / "rows.nc", points=300, rows=True)
    peak = int(wait_for(process, "peak").split()[1])
    end(process)
    assert open_results(tmp_path / "rows.nc")["row"].shape == (300, 1 << 17)
    assert peak < 350
