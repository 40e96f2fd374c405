"""Other systems than a local disk under Linux, imitated: what they refuse, and what they leave behind."""

import errno
import os
import re
import shutil
import stat
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sweeps import InputError, LockedError, StoreError, check_free, open_results, status
from sweeps.storage import assemble, store
from sweeps.storage.store import Store
from tests import HOME
from tests.helpers.waves import GRID, NAMES, interrupted, sweep
from tests.helpers.windows import Removing, Windows, closed

fcntl = pytest.importorskip("fcntl")  # Windows itself needs no imitation

GROWN = GRID | {"x": np.arange(1.0, 7.0)}

pytestmark = pytest.mark.usefixtures("small_pieces")


@pytest.fixture
def windows(monkeypatch):
    """No open file is replaced or removed, no folder is opened, and a released lock is removed."""
    for name in ("replace", "unlink", "remove"):
        monkeypatch.setattr(os, name, closed(getattr(os, name)))
    monkeypatch.setattr(store, "os", Windows())
    monkeypatch.setattr(store, "FileLock", Removing)


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("large", [150, 1 << 40])
def test_windows_a_file_grows_and_is_read_by_others_meanwhile(path, limits, large):
    limits(large)
    sweep().plan(path).run("sync").close()
    interrupted(sweep(GROWN).plan(path), 8)
    open_results(path).close()
    assert (status(path).state, status(path).done) == ("interrupted", 9)
    plan = sweep(GROWN, derive=lambda data: data.assign(top=data["root"].max()))
    data = plan.plan(path).run("sync")
    xr.testing.assert_equal(data[NAMES].load(), sweep(GROWN).plan().run("sync")[NAMES])
    data.close()
    assert os.listdir(path.parent) == [path.name]


@pytest.mark.usefixtures("windows")
def test_windows_a_file_that_somebody_reads_is_named_and_its_points_are_kept(path):
    sweep().plan(path).run("sync")
    with open(path, "rb"), pytest.raises(StoreError, match=r"has it open, close it there\); all points are kept"):
        sweep(GROWN).plan(path).run("sync")
    assert sweep(GROWN).plan(path).todo == 0
    assert sweep(GROWN).plan(path).run("sync")["status"].values.all()


def test_no_name_of_a_file_is_special_anywhere_and_nothing_is_linked(path, monkeypatch):
    """Windows knows no colon, question mark or final full stop, and needs a permission for links."""
    seen = set()
    for name in ("symlink", "link"):
        monkeypatch.setattr(os, name, None)
    run = sweep().plan(path)
    run.run("sync", progress=lambda snapshot: seen.update(each.name for each in path.parent.rglob("*")))
    assert len(seen) > 5
    assert len({name.lower() for name in seen}) == len(seen)
    assert all(re.fullmatch(r"[\w.-]*\w", name) for name in seen)


@pytest.mark.parametrize(
    ("step", "code"), [("open", errno.EINVAL), ("fsync", errno.EBADF), ("fsync", errno.ENOTSUP)]
)
def test_a_file_system_that_flushes_no_folder_stores_all_the_same(path, monkeypatch, code, step):
    original = getattr(os, step)

    def refusing(place, *rest):
        if stat.S_ISDIR(os.stat(place).st_mode if os.path.exists(place) else 0):
            raise OSError(code, os.strerror(code))
        return original(place, *rest)

    monkeypatch.setattr(os, step, refusing)
    assert sweep().plan(path).run("sync")["status"].values.all()
    assert sweep(GROWN).plan(path).todo == 6


def test_a_disk_that_fails_when_it_flushes_is_reported(path, monkeypatch):
    def failing(descriptor):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", failing)
    with pytest.raises(StoreError, match="could not be written: Input/output error; nothing was finished"):
        sweep().plan(path).run("sync")


def test_a_lock_on_nfs_is_seen(path, monkeypatch):
    """There, only what is open for writing can be locked by one alone, and for reading by several."""
    original = fcntl.flock

    def flock(file, how):
        mode = fcntl.fcntl(file, fcntl.F_GETFL) & os.O_ACCMODE
        if (how & fcntl.LOCK_EX and mode == os.O_RDONLY) or (how & fcntl.LOCK_SH and mode == os.O_WRONLY):
            raise OSError(errno.EBADF, "Bad file descriptor")
        return original(file, how)

    monkeypatch.setattr(fcntl, "flock", flock)
    interrupted(sweep().plan(path), 3)
    with Store(path).locked():
        assert status(path).state == "running"
        with pytest.raises(LockedError, match="is being written by process"):
            check_free(path)
    assert status(path).state == "interrupted"


def attempts(path):
    return (lambda: sweep(GROWN).plan(path), lambda: open_results(path), lambda: status(path))


@pytest.mark.parametrize(
    ("name", "how", "said"),
    [
        ("flock", OSError(errno.ENOLCK, "No locks available"), "cannot be locked.*HDF5_USE_FILE_LOCKING"),
        ("flock", None, "is locked or open in another program; close it there$"),
        ("open_dataset", PermissionError(13, "Permission denied"), "cannot be read: permission is missing"),
    ],
)
def test_a_file_that_cannot_be_opened_is_not_called_damaged(path, monkeypatch, name, how, said):
    sweep().plan(path).run("sync")

    def refusing(*rest, **options):
        raise how

    with open(path, "r+b") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        if how:
            monkeypatch.setattr(fcntl if name == "flock" else assemble.xr, name, refusing)
        for attempt in attempts(path):
            with pytest.raises((StoreError, InputError), match=f"sweep.nc.* {said}") as refused:
                attempt()
            assert "damaged" not in str(refused.value)
    monkeypatch.undo()
    assert open_results(path)["status"].values.all()


LITTER = [
    "._manifest",
    "._000001-0123abcd.part",
    ".fuse_hidden01",
    ".nfs01",
    ".DS_Store",
    "desktop.ini",
    "Thumbs.db",
]


def test_what_systems_leave_behind_is_no_obstacle(path):
    interrupted(sweep().plan(path), 3)
    parts = path.with_name("sweep.nc.parts")
    for name in LITTER:
        (parts / name).write_bytes(b"litter")
    plan = sweep().plan(path)
    assert (plan.cached, plan.damaged) == (3, ())
    assert plan.run("sync")["status"].values.all()
    assert not parts.exists()


def test_a_complete_result_in_a_folder_that_may_only_be_read_is_planned_and_run(path, monkeypatch):
    sweep().plan(path).run("sync")
    original = os.open

    def reading(place, flags, *rest, **options):
        if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            raise PermissionError(errno.EACCES, "Permission denied", str(place))
        return original(place, flags, *rest, **options)

    def refused(place, *rest, **options):
        raise PermissionError(errno.EACCES, "Permission denied", str(place))

    monkeypatch.setattr(os, "open", reading)
    monkeypatch.setattr(os, "access", lambda place, mode: not mode & os.W_OK)
    monkeypatch.setattr(Path, "mkdir", refused)
    plan = sweep().plan(path)
    xr.testing.assert_identical(plan.run(), open_results(path))
    assert status(path).state == "complete"
    assert np.array_equal(sweep({"x": [2.0], "y": [3.0]}).plan(path).run("sync")["status"], [[1]])
    with pytest.raises(StoreError, match="cannot be written to; choose another path"):
        sweep(GROWN).plan(path)


def test_a_user_without_a_home_or_an_entry_may_run(path, monkeypatch):
    def unknown(*rest):
        raise KeyError("uid not found")

    for name in ("HOME", "USER", "LOGNAME", "USERPROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", unknown)
    assert sweep().plan(path).run("sync")["status"].values.all()
    with pytest.raises(InputError, match=r"^~/a\.nc: .*; write it without ~$"):
        sweep().plan("~/a.nc")


PROGRAM = """
import os, sys
from windows import Removing, Windows, closed
for name in ("replace", "unlink", "remove"):
    setattr(os, name, closed(getattr(os, name)))
os.symlink = os.link = None
from sweeps.storage import store
store.os, store.FileLock = Windows(), Removing
from studies.cli.main import main
main()
"""


@pytest.mark.slow
def test_the_wheel_is_pure_python_and_fig5_runs_where_files_are_as_under_windows(tmp_path):
    """Installed beside the present libraries, away from the sources; the file of the result grows, too."""
    sources, dist, home = (tmp_path / name for name in ("sources", "dist", "env"))
    for name in ("fivcore", "sweeps", "studies"):
        shutil.copytree(HOME / name, sources / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(HOME / name, sources)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "-q", "--no-deps", "--wheel-dir", dist, sources], check=True)
    (wheel,) = dist.iterdir()
    assert wheel.name.endswith("-py3-none-any.whl")
    assert not [name for name in zipfile.ZipFile(wheel).namelist() if name.endswith((".so", ".pyd", ".dll"))]
    venv.create(home)
    python = home / "bin" / "python"
    subprocess.run([*pip, "--python", python, "install", "-q", "--no-deps", wheel], check=True)
    (site,) = home.glob("lib/python*/site-packages")
    (site / "present.pth").write_text(sysconfig.get_path("purelib"))
    shutil.copy(HOME / "tests" / "helpers" / "windows.py", site)
    here = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "FIV_RESULTS", "HOME")}
    for more, count in ([], 501), (["--set", "mu=0.1234"], 1), ([], 501):
        fig5 = [python, "-c", PROGRAM, "run", "fig5", "--yes", *more]
        done = subprocess.run(fig5, cwd=tmp_path, env=here, text=True, capture_output=True)
        assert done.returncode == 0, done.stderr
        assert re.search(rf"points +{count}\n", done.stderr)
    file = tmp_path / "results" / "fig5" / "fig5.nc"
    assert status(file).done == 502
    assert sorted(os.listdir(file.parent)) == ["fig5.nc", "fig5.png"]
