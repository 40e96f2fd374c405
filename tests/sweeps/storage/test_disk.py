"""Runs that are killed, disks that are full or closed to us, and runs that want the same place."""

import errno
import itertools
import os
import shutil
import signal
from pathlib import Path

import pytest
import xarray as xr

from sweeps import LockedError, StoreError, open_results
from sweeps.storage import parts
from sweeps.storage.store import Store
from tests.helpers.backends import assert_right, visible
from tests.helpers.sweep_programs import end, finished_points, make, start, wait_for

KEPT = r"could not be written: [^;]*; (finished points are kept; the same run continues|all points are kept)"
NOTHING = r"could not be written: [^;]*; nothing was finished$"

# Steps on the disk, before each of which a run is killed.
STEPS = [(os, "replace"), (os, "fsync"), (parts, "pack"), (xr.Dataset, "to_netcdf")]
STEPS += [(Path, "unlink"), (Path, "mkdir"), (shutil, "rmtree")]

pytestmark = pytest.mark.usefixtures("small_pieces")


def check(path, points):
    """The file is what an undisturbed run makes, with nothing beside it but the empty file of the lock."""
    data = open_results(path)
    assert data.sizes["x"] == points
    assert_right(data)
    assert visible(path.parent) == [path.name]


def killed_at(number, run):
    """Run in a copy of this process that kills itself before the so-manyth step on the disk; whether it did."""
    steps = itertools.count(1)

    def counted(original):
        def step(*arguments, **options):
            if next(steps) == number:
                os.kill(os.getpid(), signal.SIGKILL)
            return original(*arguments, **options)

        return step

    child = os.fork()
    if child == 0:
        try:
            for owner, name in STEPS:
                setattr(owner, name, counted(getattr(owner, name)))
            run()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


EACH = [pytest.param(old, 1, marks=pytest.mark.slow) for old in (0, 2)]


@pytest.mark.posix
@pytest.mark.parametrize(("old", "every"), [*EACH, (2, 7)])
def test_killed_before_any_step_on_the_disk_a_run_computes_the_missing_points_only(tmp_path, old, every):
    """In particular between writing the file and removing the parts; of a new file, and of one that grows."""
    path, log = tmp_path / "store" / "powers.nc", tmp_path / "log"
    store, killed = Store(path), True
    if old:
        make(points=old, log=log).plan(tmp_path / "old.nc").run("sync")
    number = 0
    while killed:
        number += every
        path.parent.mkdir()
        if old:
            shutil.copy(tmp_path / "old.nc", path)
        killed = killed_at(number, lambda: make(points=4, log=log).plan(path).run("sync"))
        before = finished_points(store)
        rows = sum(parts.Packed(store.parts / name).header["rows"] for name in store.part_names())
        assert len(before) >= max(old, rows)
        log.write_text("")
        make(points=4, log=log).plan(path).run("sync")
        assert {float(line) for line in log.read_text().split()} == {0.0, 1.0, 2.0, 3.0} - before
        check(path, 4)
        shutil.rmtree(path.parent)
    assert number > 20


@pytest.mark.parametrize(("count", "told"), [(0, NOTHING), (1, NOTHING), (2, NOTHING), (6, KEPT)])
def test_a_disk_full_during_the_run_is_reported_in_a_line_and_costs_nothing(path, monkeypatch, count, told):
    """It has room for so many archives; the manifest and its copy are two."""
    pack, numbers, store = parts.pack, itertools.count(), Store(path)

    def full(file, *content):
        file.write_bytes(b"half")
        if next(numbers) >= count:
            raise OSError(errno.ENOSPC, "No space left on device")
        pack(file, *content)

    with monkeypatch.context() as patch:
        patch.setattr(parts, "pack", full)
        with pytest.raises(StoreError, match=f"^[^\n]*{told}[^\n]*$"):
            make(points=20).plan(path).run("sync")
    assert (len(store.part_names()), [*path.parent.rglob("*.tmp")]) == (max(count - 2, 0), [])
    assert make(points=20).plan(path).todo == 20 - len(finished_points(store))
    make(points=20).plan(path).run()
    check(path, 20)


def test_a_disk_full_at_the_end_keeps_the_file_and_all_points(path, monkeypatch):
    make(points=10).plan(path).run()
    before = path.read_bytes()

    def full(self, name, **options):
        Path(name).write_bytes(b"half")
        raise RuntimeError("NetCDF: HDF error")

    with monkeypatch.context() as patch:
        patch.setattr(xr.Dataset, "to_netcdf", full)
        with pytest.raises(StoreError, match=KEPT):
            make(points=20).plan(path).run()
    assert path.read_bytes() == before
    assert make(points=20).plan(path).todo == 0
    make(points=20).plan(path).run()
    check(path, 20)


def test_places_that_cannot_be_written_to(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file" / "a.nc", Path("/proc/sweeps/a.nc"), Path("/proc/a.nc")):
        with pytest.raises(StoreError, match="choose another path"):
            make(points=3).plan(place).run()
    plan = make(points=3).plan(tmp_path / "deep" / "a.nc")
    (tmp_path / "deep").write_text("")  # after planning
    with pytest.raises(StoreError, match=r"cannot be written: .*; choose another path"):
        plan.run()


def test_the_second_run_is_refused_and_the_lock_dies_with_its_holder(path):
    process, store = start(store=path, points=20, long=0.2), Store(path)
    wait_for(process, "progress 3")
    with pytest.raises(LockedError, match=rf"process {process.pid} on \S+, begun 20\S+Z; wait for it"):
        make(points=20, long=0.2).plan(path).run()
    assert store.is_locked()
    wait_for(process, "progress 8")  # the first is undisturbed
    end(process)
    assert store.lock.read_bytes() == b""
    assert not store.is_locked()
    make(points=20, long=0.2).plan(path).run(workers=20)
    check(path, 20)


def test_a_plan_runs_twice_and_returns_the_same_but_not_after_another_run(path):
    plan = make(points=6).plan(path)
    first, before = plan.run(), path.stat().st_mtime_ns
    xr.testing.assert_identical(plan.run(), first)
    assert path.stat().st_mtime_ns == before
    make(points=8).plan(path).run()
    with pytest.raises(StoreError, match="has changed since this was planned; plan again"):
        plan.run()
    check(path, 8)
