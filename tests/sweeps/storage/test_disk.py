"""Disks that are full, damaged or closed to us, and runs that want the same place."""

import json
import multiprocessing
import os
import re
import signal
import tempfile
import threading
import time
from pathlib import Path

import pytest
import xarray as xr

from sweeps import LockedError, StoreError
from sweeps.plan import planning
from sweeps.storage import lock
from sweeps.storage.parts import PartFolder
from sweeps.storage.sources import FileSource
from sweeps.storage.store import Store
from tests.helpers.processes.sweep_programs import check, end, finished_points, flip, make, start, wait_for

KEPT = r"could not be written: .*; (what was finished is kept, and the same run goes on|all points are kept)"
NOTHING = r"could not be written: [^;]*; nothing was finished$"
FULL, HDF = OSError(28, "No space left on device"), RuntimeError("NetCDF: HDF error")

pytestmark = pytest.mark.usefixtures("small_pieces")


@pytest.fixture
def half(path, monkeypatch):
    """A store of twenty points whose run met a full disk in the middle."""
    put, done = PartFolder.put, []

    def full(self, name, content):
        done.append(name)
        if len(done) > 4:
            raise FULL
        put(self, name, content)

    with monkeypatch.context() as patch:
        patch.setattr(PartFolder, "put", full)
        with pytest.raises(StoreError, match=KEPT) as caught:
            make(points=20).plan(path).run("sync")
    assert "\n" not in str(caught.value)
    assert len(Store(path).folder.names()) == 4
    assert not lock.is_locked(Store(path))
    return Store(path)


@pytest.mark.parametrize("problem", [FULL, HDF])
def test_a_disk_full_at_the_end(path, tmp_path, monkeypatch, problem):
    make(points=10).plan(path).run()
    before = path.read_bytes()

    def full(self, name, **options):
        Path(name).write_bytes(b"half")
        raise problem

    with monkeypatch.context() as patch:
        patch.setattr(xr.Dataset, "to_netcdf", full)
        with pytest.raises(StoreError, match=KEPT):
            make(points=20).plan(path).run()
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sweep.nc", "sweep.parts"]
    plan = make(points=20).plan(path)
    assert plan.todo == 0
    plan.run()
    check(path, 20)


def test_what_is_kept_is_said_to_be_only_where_something_is(path, half, monkeypatch):
    def full(self, name, content):
        raise FULL

    monkeypatch.setattr(PartFolder, "put", full)
    with pytest.raises(StoreError, match=KEPT):
        make(points=20).plan(path).run("sync")
    half.clear()
    with pytest.raises(StoreError, match=NOTHING):
        make(points=20).plan(path).run("sync")


@pytest.mark.parametrize("size", [100, 12_000, 18_000])
def test_files_that_may_not_grow(path, size):
    process = start(store=path, points=20, file_size=size)
    told = wait_for(process, "StoreError")
    assert process.wait(10) == 3
    # The first cannot hold the manifest.
    assert re.search(KEPT if size > 100 else NOTHING, told)
    assert process.stderr.read() == ""
    end(process)
    assert not path.exists()
    again = start(store=path, points=20)
    wait_for(again, "done")
    end(again)
    check(path, 20)


def test_places_that_cannot_be_written_to(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file" / "a.nc", Path("/proc/sweeps/a.nc"), Path("/proc/a.nc")):
        with pytest.raises(StoreError, match="choose another folder"):
            make(points=3).plan(place).run()
    # Closed after planning.
    plan = make(points=3).plan(tmp_path / "deep" / "a.nc")
    (tmp_path / "deep").write_text("")
    with pytest.raises(StoreError, match=r"cannot be written: .*; choose another folder"):
        plan.run()


def test_a_folder_without_permission():
    forked = multiprocessing.get_context("fork")
    told = forked.SimpleQueue()

    def refused():
        if os.geteuid() == 0:  # for whom permissions do not count
            os.setgroups([])
            os.setgid(65534)
            os.setuid(65534)
        try:
            make(points=3).plan(folder / "a.nc").run("sync")
            told.put("written")
        except StoreError as problem:
            told.put(str(problem))

    # Not below pytest's own folder, which is closed to others.
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o555)
        process = forked.Process(target=refused)
        process.start()
        process.join()
        assert process.exitcode == 0
        assert told.get() == f"{folder} cannot be written to; choose another folder"
        assert list(folder.iterdir()) == []
        folder.chmod(0o700)


DAMAGES = {
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-100]),
    "flipped": lambda path: flip(path, path.stat().st_size // 2),
    "empty": lambda path: path.write_bytes(b""),
    "another": lambda path: path.write_bytes(b"no netCDF at all"),
    "gone": lambda path: path.unlink(),
}


@pytest.mark.parametrize("how", DAMAGES)
def test_a_damaged_part_is_computed_again_and_with_the_manifest_all(half, how):
    name = half.folder.names()[1]
    lost = set(half.folder.contents(name).points.tolist())
    whole = finished_points(half)
    DAMAGES[how](half.parts / name)
    plan = make(points=20).plan(half.file)
    assert plan.damaged == (name,) * (how != "gone")
    assert (f"damaged         {name}: its points are computed again" in repr(plan)) == (how != "gone")
    assert plan.cached == len(whole - lost)
    DAMAGES[how](half.manifest)
    make(points=20).plan(half.file).run()
    check(half.file, 20)


def test_rubbish_among_the_shards(half):
    names = ("000900-00000000.part", "12-abc.part", "000901-zz.part", "notes.txt", ".000902-00000000.part.tmp")
    for name in names:
        (half.parts / name).write_bytes(b"")
    (half.parts / "000903-00000000.part").mkdir()
    plan = make(points=20).plan(half.file)
    assert plan.damaged == ("000900-00000000.part",)
    plan.run()
    check(half.file, 20)


def test_the_second_run_is_refused_and_the_lock_dies_with_its_holder(path):
    process = start(store=path, points=20, long=0.2)
    wait_for(process, "progress 3")
    with pytest.raises(LockedError, match=rf"process {process.pid} on \S+, begun 20\S+Z; wait for it"):
        make(points=20, long=0.2).plan(path).run()
    assert lock.is_locked(Store(path))
    # The first is undisturbed.
    wait_for(process, "progress 8")
    end(process)
    assert Store(path).lock.exists()
    assert not lock.is_locked(Store(path))
    make(points=20, long=0.2).plan(path).run(workers=20)
    check(path, 20)


def test_an_old_plan_is_refused(path):
    """Whether it has anything to do or not."""
    old = make(points=6).plan(path)
    for points in (6, 8):
        make(points=points).plan(path).run()
        before = path.read_bytes()
        with pytest.raises(StoreError, match="has changed since this was planned; plan again"):
            old.run()
        assert path.read_bytes() == before
        old = make(points=4).plan(path)
        assert old.whole


def test_what_another_run_does_while_one_plans_makes_the_plan_an_old_one(path, monkeypatch):
    """It is neither computed again nor lost."""
    check_same_draws = planning.check_same_draws

    def meanwhile(*arguments):
        monkeypatch.setattr(planning, "check_same_draws", check_same_draws)
        make(points=8).plan(path).run()

    monkeypatch.setattr(planning, "check_same_draws", meanwhile)
    old = make(points=6).plan(path)
    with pytest.raises(StoreError, match="has changed since this was planned; plan again"):
        old.run()
    check(path, 8)


def test_a_file_that_is_replaced_while_one_plans_is_not_damaged(path, monkeypatch):
    make(points=4).plan(path).run()
    held = FileSource.held

    def meanwhile(self, manifest):
        monkeypatch.setattr(FileSource, "held", held)
        make(points=8).plan(path).run()
        return held(self, manifest)

    monkeypatch.setattr(FileSource, "held", meanwhile)
    with pytest.raises(StoreError, match=r"has changed while this was planned; plan again$"):
        make(points=6).plan(path)
    check(path, 8)


def test_progress_of_a_run_can_be_read_at_any_time(tmp_path):
    store, states, over = Store(tmp_path / "powers.nc"), [], threading.Event()

    def look():
        while not over.is_set():
            if store.progress.exists():
                try:
                    states.append(json.loads(store.progress.read_text()))
                except FileNotFoundError:
                    continue
            time.sleep(1e-3)

    before, watcher = signal.getsignal(signal.SIGINT), threading.Thread(target=look)
    watcher.start()
    begin = time.monotonic()
    make(points=300, pause=0.005).plan(store.file).run()
    over.set()
    watcher.join()
    assert len(states) > 10
    assert all(state["pid"] == os.getpid() for state in states)
    assert [state["done"] for state in states if "done" in state]
    # Written at the start, once a second and at the end, not for each batch.
    assert len({state["written"] for state in states}) <= 3 + (time.monotonic() - begin)
    assert not store.parts.exists()
    assert signal.getsignal(signal.SIGINT) is before
