"""Executors of any kind give the same bits; where workers die, what is finished stays and the guilty is found."""

import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial

import loky
import numpy as np
import pytest

from sweeps import ClusterLostError, FailedPointsWarning, InputError, SchedulerError, open_results
from sweeps.compute import executors, run
from sweeps.plan import batches
from sweeps.storage.parts import PartWriter
from tests import HOME
from tests.helpers.backends import assert_right, simple, visible
from tests.helpers.sweep_programs import make

# Copies of this process are there at once, which suits tests of what dies.
COPIES = partial(ProcessPoolExecutor, 2, multiprocessing.get_context("fork"))
DIED = "RuntimeError: the process that computed this point died"


def children():
    return {process.pid for process in multiprocessing.active_children()}


class Plain(Executor):
    """An executor that has nothing but the protocol."""

    def submit(self, function, /, *arguments, **options):
        future: Future = Future()
        future.set_result(function(*arguments, **options))
        return future


@pytest.fixture(scope="module", params=["threads", "spawn", pytest.param("loky", marks=pytest.mark.slow), "plain"])
def executor(request):
    if request.param == "loky":
        yield loky.get_reusable_executor(2)
    else:
        kinds = {"threads": ThreadPoolExecutor, "spawn": executors.Processes}
        with kinds[request.param](2) if request.param in kinds else Plain() as one:
            yield one


def test_any_executor_gives_the_same_bits_and_is_not_shut_down(path, executor):
    assert_right(make(points=40).plan().run(executor))
    make(points=40).plan(path).run(executor)
    assert_right(open_results(path))
    assert visible(path.parent) == [path.name]
    assert executor.submit(abs, -3).result() == 3


def count_loads(count):
    loads = executors.cloudpickle.loads

    def counted(content):
        with count.get_lock():
            count.value += 1
        return loads(content)

    return counted


@pytest.mark.usefixtures("small_pieces")
def test_processes_unpack_a_task_once_and_write_their_parts(path, monkeypatch):
    count, written = multiprocessing.Value("i"), []
    monkeypatch.setattr(executors.cloudpickle, "loads", count_loads(count))
    write = PartWriter.write
    monkeypatch.setattr(PartWriter, "write", lambda *arguments: written.append(1) or write(*arguments))
    with COPIES() as pool:
        data = simple(lambda points: {"y": np.full(len(points["x"]), os.getpid())}).plan(path).run(pool)
    assert 1 <= count.value == len({*data["y"].values}) <= 2
    assert os.getpid() not in data["y"].values
    assert written == []


@pytest.mark.usefixtures("small_pieces")
def test_a_broken_executor_is_named_and_the_same_run_resumes(path, tmp_path):
    log = tmp_path / "log"
    sweep = make(points=40, log=log, parent=os.getpid(), deadly=22.0)
    message = r"^ProcessPoolExecutor is broken, since a worker died; the same run continues from what is stored; a"
    with COPIES() as pool, pytest.raises(ClusterLostError, match=message):
        sweep.plan(path).run(pool)
    plan = sweep.plan(path)
    assert 10 < plan.cached < 40
    log.unlink()
    before = children()
    assert_right(plan.run(COPIES), failed=(7.0, 22.0))
    computed = log.read_text() if log.exists() else ""  # all but the deadly point may have been stored
    assert len({*computed.split()}) == plan.todo - 1
    assert children() == before
    assert open_results(path)["error"].values[22] == DIED


def test_workers_that_somebody_kills_are_replaced(path, monkeypatch):
    monkeypatch.setattr(batches, "BATCH_BYTES", 1.0)
    killed = []

    def kill(snapshot):
        if snapshot.done >= 8 and not killed:
            killed.append(max(children()))
            os.kill(killed[0], getattr(signal, "SIGKILL", signal.SIGTERM))

    make(pause=0.02).plan(path).run(COPIES, progress=kill)
    assert killed
    assert_right(open_results(path))


@pytest.mark.slow
def test_processes_of_this_machine_isolate_a_deadly_point(path, monkeypatch):
    monkeypatch.setattr(batches, "BATCH_BYTES", 4 * 48.0)
    before = children()
    data = make(points=40, parent=os.getpid(), deadly=22.0).plan(path).run("processes", 2)
    assert_right(data, failed=(7.0, 22.0))
    assert data["error"].values[22] == DIED
    assert visible(path.parent) == [path.name]
    assert children() == before


@pytest.mark.parametrize("wrong", [3, "nonsense", None, object()])
def test_what_is_no_back_end_is_refused_with_all_kinds_named(path, wrong):
    with pytest.raises(
        SchedulerError, match=r"scheduler = .*: it must be 'threads', .* an executor of concurrent"
    ):
        make().plan(path).run(wrong)
    assert not path.parent.joinpath(".sweep.nc.lock").exists()


def test_a_function_that_makes_no_executor_and_an_executor_that_was_shut_down(path):
    with pytest.raises(SchedulerError, match="it made 3; it must make an executor"):
        make().plan(path).run(lambda: 3)
    (pool := COPIES()).shutdown()
    with pytest.raises(SchedulerError, match="ProcessPoolExecutor has no workers that live"):
        make().plan(path).run(pool)


OWN = "functools.partial(futures.ProcessPoolExecutor, 2, spawn)"


@pytest.mark.parametrize("how", ["'processes', 1", pytest.param(OWN, marks=pytest.mark.slow)])
def test_a_program_without_a_main_guard_ends_in_one_line(tmp_path, how):
    program = f"""
import functools, multiprocessing, sweeps
from concurrent import futures
spawn = multiprocessing.get_context("spawn")
sweeps.Sweep("halves", sweeps.pointwise(lambda t: 0.5 * t), {{"t": [0.0, 1.0]}}, ["x"]).plan("a.nc").run({how})
"""
    (tmp_path / "program.py").write_text(program)
    own = {"env": os.environ | {"PYTHONPATH": str(HOME)}, "cwd": tmp_path, "timeout": 100}
    done = subprocess.run([sys.executable, "program.py"], capture_output=True, text=True, **own)
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    last = done.stderr.splitlines()[-1]
    assert "SchedulerError" in last
    assert last.endswith("a program must do this under if __name__ == '__main__', for every worker imports it")


# Progress, and points that failed.


def test_progress_is_a_line_that_changes_on_a_terminal_and_lines_elsewhere(monkeypatch, capsys):
    monkeypatch.setattr(run, "LINE_INTERVAL", 0.0)
    make(points=20).plan().run("sync", progress=True)
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1] == "20 of 20 done, 1 failed"
    assert len(lines) > 2
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    make(points=20).plan().run("sync", progress=True)
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.endswith("\r20 of 20 done, 1 failed\x1b[K\n")
    make(points=20).plan().run("sync", progress=False)
    assert capsys.readouterr().err == ""


def test_another_progress_is_refused_before_the_store_is_touched(path):
    with pytest.raises(
        InputError, match=r"progress = 3: it must be True, False, None or a function of a Snapshot"
    ):
        make(points=4).plan(path).run(progress=3)
    assert [*path.parent.iterdir()] == []


def test_failed_points_are_named_once_at_the_end(path):
    message = r"^powers: 1 of 12 points failed, the first at x = 7.0: ValueError: seven is not allowed; retry"
    for store in (None, path, path):
        with pytest.warns(FailedPointsWarning, match=message) as caught:
            make(points=12).plan(store).run()
        assert [(each.filename, len(caught)) for each in caught] == [(__file__, 1)]
