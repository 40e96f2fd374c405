"""Ctrl-C: the first lets batches that have begun finish, the second stops at once; what was finished is kept."""

import os
import signal
import time

import pytest

from sweeps import AbandonedError
from sweeps.storage.store import Store
from tests.helpers.backends import assert_right
from tests.helpers.processes.sweep_programs import end, finished_points, make, start, wait_for

pytestmark = pytest.mark.usefixtures("small_pieces", "interruptible")


def interrupt(snapshot, twice=False):
    """Send Ctrl-C after four points; and again, when the run has noticed."""
    if snapshot.done >= 4 and (twice or not snapshot.stopping):
        signal.raise_signal(signal.SIGINT)


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


@pytest.mark.parametrize("where", ["threads", "sync", "inside"])
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


@pytest.mark.parametrize("twice", [False, True])
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
