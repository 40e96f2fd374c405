"""Back ends give the same bits, in batches of any size; failures, progress and interrupts are the same on all."""

import os
import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from threadpoolctl import threadpool_info

from sweeps import AbandonedError, Grid, Refinement, SweepStoppedError, open_results, refined
from sweeps.plan import batches
from sweeps.storage.store import Store
from tests.helpers.backends import assert_right, simple, visible
from tests.helpers.sweep_programs import end, finished_points, make, start, wait_for
from tests.helpers.waves import stop_after

SIZES = [{"BATCH_BYTES": 1.0}, {"GROWTH": 2, "SHORTEST": 1e-4}, {"BATCH_SECONDS": 1e-6}, {"FIRST_PLACES": 1}]


@pytest.mark.parametrize("scheduler", ["sync", "threads", "address", "client", "cluster"], indirect=True)
def test_every_back_end_gives_the_same_bits(path, scheduler):
    assert_right(make(points=40).plan().run(scheduler))
    make(points=40).plan(path).run(scheduler)
    assert_right(open_results(path))
    assert visible(path.parent) == [path.name]


@pytest.mark.parametrize("sizes", SIZES)
def test_every_batch_size_gives_the_same_bits(path, sizes, monkeypatch):
    for name, value in sizes.items():
        monkeypatch.setattr(batches, name, value)
    assert_right(make(points=100).plan(path).run("threads", 2))


@pytest.mark.usefixtures("small_pieces")
def test_a_run_may_be_resumed_on_another_back_end_with_other_batches(path, scheduler, monkeypatch):
    for number, count in enumerate((5, 14, 17)):
        monkeypatch.setattr(batches, "BATCH_BYTES", 50.0 * number + 1.0)
        with pytest.raises(KeyboardInterrupt):
            make(points=80).plan(path).run("sync" if number == 1 else scheduler, progress=stop_after(count))
    plan = make(points=80).plan(path)
    assert 17 <= plan.cached < 80
    assert_right(plan.run(scheduler))


def test_refined_sweeps_and_strings_on_every_back_end(path, scheduler):
    axis = np.linspace(-1.0, 1.0, 17)
    grid = Grid({"x": axis, "z": axis, "kind": ["µ = 0"]})
    sweep = simple(lambda p: {"y": np.hypot(p["x"], p["z"]) + np.char.str_len(p["kind"])}, grid)
    sweep = refined(sweep, Refinement("y", 2, tolerance=0.01))
    found, expected = sweep.plan(path).run(scheduler), sweep.plan().run("sync")
    xr.testing.assert_equal(found.drop_vars("wall_time"), expected.drop_vars("wall_time"))
    assert 25 < np.count_nonzero(found["status"] == 1) < 289


def test_closures_run_with_one_blas_thread_everywhere(scheduler):
    factor = 3.0

    def closure(points):
        import scipy.linalg

        scipy.linalg.solve(np.eye(3), np.ones(3))
        threads = {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}
        return {"y": factor * points["x"] / max(threads, default=1)}

    data = simple(closure).plan().run(scheduler)
    np.testing.assert_array_equal(data["y"], 3.0 * data["x"])


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_threads_compute_as_many_batches_at_a_time_as_there_are_workers(workers):
    now, counts = set(), []

    def count(points):
        now.add(threading.get_ident())
        counts.append(len(now))
        time.sleep(0.02)
        now.discard(threading.get_ident())
        return {"y": points["x"]}

    simple(count).plan().run("threads", workers)
    assert max(counts) == workers


@pytest.mark.usefixtures("small_pieces")
def test_snapshots_count_and_describe_batches_and_a_callback_that_raises_ends_the_run(path, scheduler):
    snapshots = []
    make(points=40).plan().run(scheduler, progress=snapshots.append)
    last = snapshots[-1]
    assert (last.todo, last.done, last.failed, last.now, last.left) == (40, 40, 1, (), 0.0)
    assert not last.stopping
    assert [each.done for each in snapshots] == sorted(each.done for each in snapshots)
    assert {each.now[0].split()[0] for each in snapshots if each.now} == {"x"}
    with pytest.raises(ZeroDivisionError):
        make(pause=0.01).plan(path).run(scheduler, progress=lambda snapshot: 1 / (snapshot.done < 6))
    assert make(pause=0.01).plan(path).cached > 4


def test_a_run_that_goes_on_counts_on_and_has_the_plans_time_at_first(path):
    make(points=10).plan(path).run("sync")
    plan, snapshots = replace(make(points=40).plan(path), seconds=60.0), []
    plan.run("sync", progress=snapshots.append)
    assert (snapshots[0].done, snapshots[0].todo, snapshots[0].left) == (10, 40, pytest.approx(60.0))
    assert snapshots[0].rate == 0.0  # none is measured yet
    assert (snapshots[-1].done, snapshots[-1].left) == (40, 0.0)


@pytest.mark.usefixtures("small_pieces")
def test_fail_fast_stops_at_the_first_failure_and_keeps_what_was_computed(path, tmp_path, scheduler):
    log = tmp_path / "log"
    sweep = make(log=log, pause=0.03)
    with pytest.raises(SweepStoppedError, match=r"at the first failure: x = 7.0: ValueError: seven is not"):
        sweep.plan(path).run(scheduler, 2, fail_fast=True)
    computed = {float(line) for line in log.read_text().split()}
    assert len(computed) < 40
    assert sweep.plan(path).cached == len(computed)


def test_a_run_within_a_thread():
    results = []
    thread = threading.Thread(target=lambda: results.append(make().plan().run("threads", 2)))
    thread.start()
    thread.join()
    assert_right(results[0])


# Ctrl-C: the first lets batches that have begun finish, the second stops at once.


ctrl_c = pytest.mark.usefixtures("small_pieces", "interruptible")


def interrupt(snapshot, twice=False):
    """Send Ctrl-C after four points; and again, when the run has noticed."""
    if snapshot.done >= 4 and (twice or not snapshot.stopping):
        signal.raise_signal(signal.SIGINT)


@ctrl_c
def test_the_first_interrupt_finishes_and_keeps_what_has_begun(path, tmp_path, scheduler):
    log, store = tmp_path / "log", Store(path)
    with pytest.raises(KeyboardInterrupt) as caught:
        make(log=log, pause=0.02).plan(path).run(scheduler, 2, interrupt)
    assert not isinstance(caught.value, AbandonedError)
    begun = [float(line) for line in log.read_text().split()]
    assert len(begun) == len(set(begun)) < 40
    assert finished_points(store) == set(begun)
    assert not store.is_locked()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert_right(make(log=log, pause=0.02).plan(path).run())
    assert len(log.read_text().split()) == 60


@ctrl_c
@pytest.mark.parametrize("where", ["threads", pytest.param("sync", marks=pytest.mark.slow), "inside"])
def test_the_second_interrupt_stops_at_once_and_late_batches_are_not_written(path, where, request):
    scheduler = request.getfixturevalue(where) if where == "inside" else where
    begun, store = [], Store(path)

    def twice(snapshot):
        begun.extend([time.monotonic()] * (snapshot.done >= 4))
        interrupt(snapshot, twice=True)

    with pytest.raises(KeyboardInterrupt) as caught:
        make(points=16, pause=0.4).plan(path).run(scheduler, 4, twice)
    assert time.monotonic() - begun[0] < 0.3
    assert isinstance(caught.value, AbandonedError) == (where == "threads")
    assert not store.is_locked()
    before = store.part_names()
    time.sleep(0.6)
    assert store.part_names() == before
    assert 16 > make(points=16, pause=0.4).plan(path).cached >= 4


@pytest.mark.posix
@ctrl_c
@pytest.mark.parametrize("twice", [pytest.param(False, marks=pytest.mark.slow), True])
def test_an_interrupt_of_a_terminal_reaches_processes_as_well(path, tmp_path, twice):
    log, store = tmp_path / "log", Store(path)
    process = start(store=path, log=log, points=40, pause=30.0 if twice else 0.1, scheduler="processes")
    try:
        while int(wait_for(process, "progress").split()[1]) < (0 if twice else 4):
            pass
        begin = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)
        if twice:
            wait_for(process, "progress 0 True")
            os.killpg(process.pid, signal.SIGINT)
        wait_for(process, "KeyboardInterrupt")
        assert process.wait(20.0) == 130
        assert time.monotonic() - begin < 6.0
        assert process.stderr.read() == ""
    finally:
        end(process)
    begun = {float(line) for line in log.read_text().split()} if log.exists() else set()
    assert not store.is_locked()
    assert finished_points(store) == (set() if twice else begun)
    assert len(begun) < 30
