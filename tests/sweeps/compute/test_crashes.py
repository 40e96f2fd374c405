"""Whatever ends a run, at whatever moment: what was finished is kept, and the run goes on to the same result."""

import os
import shutil
import signal
import time

import numpy as np
import pytest

from sweeps.storage import lock
from sweeps.storage.store import Store
from tests.helpers.processes.sweep_programs import check, end, finished_points, make, start, wait_for
from tests.helpers.storms import faults

pytestmark = pytest.mark.usefixtures("small_pieces")
SCHEDULERS = ["sync", "threads", "processes"]


@pytest.mark.parametrize(
    ("scheduler", "kills", "longest"),
    [("threads", 6, 0.5), pytest.param("processes", 20, 3.0, marks=pytest.mark.slow)],
)
def test_killed_at_random_moments_a_run_goes_on(tmp_path, scheduler, kills, longest):
    """Nothing that was finished is computed again."""
    path, log, moments = tmp_path / "store" / "powers.nc", tmp_path / "log", np.random.default_rng(1)
    store, done, again = Store(path), 0, set()
    # Where the machine has other things to do, more of them until they are spread over the run.
    while done < kills or (len(again) <= kills // 4 and done < 3 * kills):
        before = finished_points(store)
        log.write_text("")
        process = start(store=path, log=log, pause=0.02, scheduler=scheduler)
        wait_for(process, "ready")
        time.sleep(moments.uniform(0.0, longest))
        done += process.poll() is None
        end(process)
        assert not before & {float(line) for line in log.read_text().split()}
        again.add(len(before))
        if not before:
            # Nothing was finished: later.
            longest *= 1.25
        if path.exists() and not store.parts.exists():
            make(log=log, pause=0.02).plan(path).run("sync")
            check(path)
            shutil.rmtree(path.parent)
    make(log=log, pause=0.02).plan(path).run()
    check(path)
    assert len(again) > kills // 4


def killed_at(number, path, when):
    """Run in a copy of this process that kills itself at the so-manyth step on the disk; whether it did."""
    child = os.fork()
    if child == 0:

        def kill(step, moment):
            if (step, moment) == (number, when):
                os.kill(os.getpid(), signal.SIGKILL)

        try:
            faults.at_each_step(kill)
            make(points=3).plan(path).run("sync")
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


@pytest.mark.parametrize("when", ["before", pytest.param("after", marks=pytest.mark.slow)])
def test_killed_at_each_step_on_the_disk(tmp_path, when):
    number = 0
    path = tmp_path / "store" / "powers.nc"
    while number := number + 1:
        killed = killed_at(number, path, when)
        make(points=3).plan(path).run("sync")
        check(path, 3)
        shutil.rmtree(path.parent)
        if not killed:
            break
    assert number > 20


# A terminal's Ctrl-C goes to the whole group; only where there are other processes does it make a difference.
@pytest.mark.parametrize("group", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize("scheduler", SCHEDULERS)
def test_the_first_interrupt_lets_batches_finish(tmp_path, scheduler, group):
    path, log = tmp_path / "powers.nc", tmp_path / "log"
    process = start(store=path, log=log, points=30, pause=0.1, scheduler=scheduler)
    wait_for(process, "progress 4")
    (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
    wait_for(process, "KeyboardInterrupt")
    assert process.wait(20.0) == 130
    told = process.stderr.read()
    end(process)
    assert told == ""
    store = Store(path)
    begun = [float(line) for line in log.read_text().split()]
    assert len(begun) == len(set(begun)) < 12
    # All that was begun is kept.
    assert finished_points(store) == set(begun)
    assert not lock.is_locked(store)
    assert sorted(p.name for p in store.parts.iterdir()) == [*store.folder.names(), "manifest", "progress.json"]
    make(points=30, log=log, pause=0.1).plan(path).run(workers=8)
    log.unlink()
    check(path, 30)


@pytest.mark.parametrize("scheduler", SCHEDULERS)
def test_the_second_interrupt_ends_at_once(path, scheduler):
    process = start(store=path, points=8, long=30.0, scheduler=scheduler)
    wait_for(process, "progress 4")
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGINT)
    wait_for(process, "progress 4 True")
    time.sleep(0.2)
    begin = time.monotonic()
    os.killpg(process.pid, signal.SIGINT)
    wait_for(process, "AbandonedError" if scheduler == "threads" else "KeyboardInterrupt")
    assert process.wait(10.0) == 130
    assert time.monotonic() - begin < 4.0
    assert process.stderr.read() == ""
    assert not lock.is_locked(Store(path))
    end(process)


def test_threads_that_were_given_up_write_nothing_more(tmp_path):
    process = start(store=tmp_path / "powers.nc", points=8, long=1.0, linger=2.0)
    wait_for(process, "progress 4")
    time.sleep(0.3)
    os.kill(process.pid, signal.SIGINT)
    wait_for(process, "progress 4 True")
    os.kill(process.pid, signal.SIGINT)
    before, after = wait_for(process, "before"), wait_for(process, "after")
    assert before.split()[1:] == after.split()[1:]
    assert process.communicate() == ("", "")
