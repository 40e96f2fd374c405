"""Threads, processes and clusters: the same results, each at its cost, and one line where it cannot be."""

import gc
import os
import pickle
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import tracemalloc

import dask
import distributed
import numpy as np
import pytest
import xarray as xr
from threadpoolctl import threadpool_info

from sweeps import (
    DONE,
    FAILED,
    Axis,
    ClusterLostError,
    Grid,
    Refinement,
    SchedulerError,
    Sweep,
    SweepStoppedError,
    Variable,
    open_results,
    refined,
)
from sweeps.compute import cluster
from sweeps.compute.batch import one_blas_thread
from sweeps.compute.cluster import Cluster
from sweeps.storage.parts import PartFolder
from tests import HOME
from tests.helpers.processes.sweep_programs import cut, end, make, undisturbed, values

pytestmark = pytest.mark.usefixtures("small_pieces")
# Options of a cluster that says nothing and shows nothing.
QUIET = {"silence_logs": 50, "dashboard_address": None, "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"}}
INSIDE = QUIET | {"processes": False, "protocol": "tcp://"}
X = Axis(np.arange(24.0))


@pytest.fixture(scope="module")
def address():
    """A scheduler with a worker of two threads in a process, as somebody else would have started it."""
    with distributed.LocalCluster(n_workers=1, threads_per_worker=2, **QUIET) as one:
        yield one.scheduler_address


@pytest.fixture(scope="module")
def inner():
    """A scheduler with two workers of four threads, all in this process."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=4, **INSIDE) as one:
        yield one.scheduler_address


@pytest.fixture(params=["sync", "threads", "tcp"])
def scheduler(request, address):
    """A back end that starts no processes."""
    return address if request.param == "tcp" else request.param


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """A folder of its own for what is temporary: others use the system's meanwhile."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return tmp_path


def simple(function, grid=None, **options):
    return Sweep("simple", function, grid or Grid({"x": X}), **({"variables": {"y": Variable()}} | options))


def left_in(folder):
    return [name for name in os.listdir(folder) if name.startswith(("sweeps-", "dask"))]


def children():
    listed = subprocess.run(
        ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(os.getpid())], capture_output=True, text=True
    )
    return {line.split()[0] for line in listed.stdout.splitlines() if "spawn_main" in line}


def test_every_back_end_gives_the_same_bits(temporary, scheduler):
    path = temporary / "kept" / "powers.nc"
    xr.testing.assert_identical(values(make(points=24).plan().run(scheduler, 2)), undisturbed(24))
    make(points=24).plan(path).run(scheduler, 2)
    xr.testing.assert_identical(values(open_results(path)), undisturbed(24))
    assert os.listdir(path.parent) == [path.name]
    assert not left_in(temporary)


def test_passes_of_a_refined_sweep_and_texts_on_every_back_end(tmp_path, scheduler):
    axis = Axis(np.linspace(-1.0, 1.0, 17))
    grid = Grid({"x": axis, "z": axis, "kind": Axis(["µ = 0"])})
    asked = simple(lambda p: {"y": np.hypot(p["x"], p["z"]) + np.char.str_len(p["kind"])}, grid)
    asked = refined(asked, Refinement("y", 2, tolerance=0.01))
    found, expected = asked.plan(tmp_path / "a.nc").run(scheduler, 2), asked.plan().run("sync")
    xr.testing.assert_equal(found.drop_vars("wall_time"), expected.drop_vars("wall_time"))
    assert 25 < np.count_nonzero(found["status"] == 1) < 289


def test_functions_without_a_name_and_blas_on_one_thread(address):
    factor = 3.0

    def closure(points):
        import scipy.linalg

        scipy.linalg.solve(np.eye(3), np.ones(3))
        pools = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
        return {"y": factor * points["x"] / max(pools, default=1)}

    data = simple(closure).plan().run(address)
    np.testing.assert_array_equal(data["y"], 3.0 * data["x"])


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


# Processes.


def test_a_worker_that_takes_long_to_start_again_is_waited_for(monkeypatch):
    monkeypatch.setattr(cluster, "BEREFT", 20.0)
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "10ms"}):
        data = make(points=8, parent=os.getpid(), deadly=5.0).plan().run("processes", 1)
    assert data["status"].values.tolist() == [DONE] * 5 + [FAILED, DONE, FAILED]  # seven is not allowed


def test_a_worker_that_is_killed_costs_nothing(temporary):
    path, before, killed = temporary / "kept" / "powers.nc", children(), []

    def kill(snapshot):
        if snapshot.done >= 16 and not killed:
            killed.append((children() - before).pop())
            os.kill(int(killed[0]), signal.SIGKILL)

    make(points=40, pause=0.02).plan(path).run("processes", 2, kill)
    assert killed
    xr.testing.assert_identical(values(open_results(path)), undisturbed(40))
    assert os.listdir(path.parent) == [path.name]
    assert children() == before
    assert not left_in(temporary)


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
    assert told.startswith(
        "from numpy import array; from tests.helpers.processes.sweep_programs import powers; powers({'x'"
    )


def test_a_function_that_cannot_be_sent():
    lock = threading.Lock()

    def locked(points):
        with lock:
            return {"y": points["x"]}

    with pytest.raises(SchedulerError, match="the function of sweep simple cannot be sent to other processes: "):
        simple(locked).plan().run("processes", 1)


# Clusters.


def test_addresses_that_are_none(monkeypatch, capfd):
    assert cluster.PATIENCE <= 10.0
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for wrong in (f"tcp://127.0.0.1:{port}", "nonsense://here", "tcp://", "tcp://nowhere.invalid:1"):
        begin = time.monotonic()
        with pytest.raises(SchedulerError, match=f"^scheduler = '{wrong}': no Dask scheduler answers there"):
            make(points=4).plan().run(wrong)
        assert time.monotonic() - begin < 8.0
        # Dask's client that failed ends here, and not on the thread that the next one starts under a lock of both.
        gc.collect()
    said = pytest.raises(SchedulerError, match=r"it has no workers; start some with: dask worker tcp://")
    with distributed.LocalCluster(n_workers=0, **QUIET) as empty, said:
        make(points=4).plan().run(empty.scheduler_address)
    assert capfd.readouterr() == ("", "")


def test_workers_that_lack_the_module(tmp_path, monkeypatch, address, capfd):
    (tmp_path / "only_here.py").write_text("def f(points): return {'y': points['x']}")
    monkeypatch.syspath_prepend(tmp_path)
    import only_here

    said = r"^the workers cannot compute this: ModuleNotFoundError: No module named 'only_here'$"
    with pytest.raises(SchedulerError, match=said):
        simple(only_here.f).plan().run(address)
    assert capfd.readouterr() == ("", "")


ELSEWHERE = f"""
import sys, distributed
sys.modules["sweeps"] = None
cluster = distributed.LocalCluster(n_workers=1, **{INSIDE})
print(cluster.scheduler_address, flush=True)
sys.stdin.readline()
del sys.modules["sweeps"]
print("there now", flush=True)
sys.stdin.read()
"""


def test_workers_that_lack_the_engine_and_a_scheduler_that_goes_away(path, monkeypatch, capfd):
    monkeypatch.setattr(cluster, "PATIENCE", 3.0)
    process = subprocess.Popen(
        [sys.executable, "-c", ELSEWHERE],
        cwd=HOME,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    where = process.stdout.readline().strip()
    with pytest.raises(SchedulerError, match=r"^the workers cannot compute this: .*ModuleNotFoundError"):
        make(points=4).plan().run(where)
    process.stdin.write("\n")
    process.stdin.flush()
    assert process.stdout.readline() == "there now\n"
    capfd.readouterr()

    def kill(snapshot):
        if snapshot.done >= 5:
            end(process)

    with pytest.raises(ClusterLostError, match=r"^the scheduler does not answer any more$"):
        make(points=20, long=0.2).plan(path).run(where, None, kill)
    assert make(points=20, long=0.2).plan(path).cached >= 4
    assert capfd.readouterr() == ("", "")


def nap(points, ballast=None):
    time.sleep(0.01 * len(points["x"]))
    return {"y": 2.0 * points["x"]}


def naps(points=40, **options):
    return simple(nap, Grid({"x": Axis(np.arange(float(points)))}), **options)


def test_threads_of_workers_are_counted(inner, monkeypatch):
    monkeypatch.setattr("sweeps.watch.monitor.SHOWN", 1000)
    most = []
    naps(100).plan().run(inner, None, lambda snapshot: most.append(len(snapshot.now)))
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
    data = naps(constants={"ballast": np.zeros(1_000_000)}).plan().run(inner)
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


def test_workers_that_see_the_store_write_their_parts(path, inner, monkeypatch):
    writers, refusing, put = [], [], PartFolder.put

    def written(self, name, content):
        main = threading.current_thread() is threading.main_thread()
        if refusing and not main:
            raise PermissionError(13, "Permission denied")
        writers.append(main)
        put(self, name, content)

    def run():
        writers.clear()
        data = naps().plan(path, fresh=True).run(inner)
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
    assert os.listdir(path.parent) == [path.name]


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
        assert "no workers could be started by a worker" in told


def test_a_script_that_every_worker_would_run_again_is_told_so(tmp_path):
    """Dask before 2026.8 waits for such workers for ever."""
    script = tmp_path / "script.py"
    script.write_text(
        "from tests.helpers.processes.sweep_programs import make\nmake(points=24).plan().run('processes', 1)\n"
    )
    environment = os.environ | {"PYTHONPATH": str(HOME)}
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=100, env=environment, cwd=tmp_path
    )
    assert done.returncode == 1
    assert "SchedulerError: scheduler = 'processes': no workers could be started" in done.stderr
    assert "under if __name__ == '__main__'" in done.stderr


def test_workers_that_leave_and_join_cost_nothing(path):
    counts = []
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=2, **INSIDE) as some,
        some.get_client() as client,
    ):
        workers = set(client.nthreads())

        def leave(snapshot):
            counts.append(snapshot.done)
            if snapshot.done >= 16 and workers:
                some.scale(3)
                client.retire_workers([workers.pop()])

        make(points=80, pause=0.02).plan(path).run(some.scheduler_address, None, leave)
    assert not workers
    assert counts == sorted(counts)
    xr.testing.assert_identical(values(open_results(path)), undisturbed(80))


# What every back end does.


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
        return {"y": points["x"]}

    for workers in (1, 2, 5):
        most = 0
        simple(count).plan().run("threads", workers)
        assert most == workers


def test_a_callback_that_raises_ends_the_run(path, scheduler):
    told = []

    def broken(snapshot):
        told.append(snapshot)
        if snapshot.done > 5:
            raise OSError("no more")

    with pytest.raises(OSError, match="no more"):
        make(points=24, pause=0.01).plan(path).run(scheduler, 2, broken)
    assert [each.done for each in told] == sorted(each.done for each in told)
    assert make(points=24, pause=0.01).plan(path).cached > 4


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


def test_rows_of_a_megabyte_need_little_memory(path):
    # What the file shrinks fast, and a part does not.
    columns = np.arange(1 << 17) % 2
    asked = simple(
        lambda points: {"y": points["x"][:, None] + columns},
        Grid({"x": Axis(np.arange(70.0))}),
        variables={"y": Variable(dims=("column",))},
        coords={"column": Axis(np.arange(1 << 17))},
    )
    tracemalloc.start()
    asked.plan(path).run("threads", 2)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert open_results(path)["y"].shape == (70, 1 << 17)
    assert peak < 30e6
