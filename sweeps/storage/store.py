"""The files of a sweep: their places, the lock of a run, and the atomic replacement of a file.

STUDY.nc            the result; replaced as a whole, never written into
STUDY.nc.parts/     during a run, and after it was interrupted:
    manifest            description of the result, twice (manifest.copy)
    000001-….part       one finished batch each
    progress.json       owner and progress of the run
.STUDY.nc.lock      locked by the run; the empty file stays

A share, which a job of its own computes, has its parts in STUDY.nc.3-of-16.parts/ and its lock likewise.
"""

import errno
import json
import os
import re
import shutil
import socket
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4
from zlib import crc32

from filelock import FileLock, Timeout, lock_descriptor

if os.name != "nt":
    import fcntl

from sweeps.errors import HINT_MOVE, HINT_OTHER_PATH, InputError, LockedError, StoreError, reason

PART = re.compile(r"(\d{6,})-[0-9a-f]{8}\.part")
# Files that a run, or an operating system, may have left in the folder of parts.
LEFT = re.compile(rf"manifest(\.copy)?|progress\.json|{PART.pattern}|\..*|desktop\.ini|Thumbs\.db", re.IGNORECASE)
# What a file system answers that cannot wait for a file or a folder, or lets nobody open a folder.
NO_FSYNC = {errno.EINVAL, errno.EBADF, errno.ENOTSUP, errno.ENOSYS, errno.EACCES, errno.EPERM, errno.EISDIR}
# Earlier versions wrote this and eight hexadecimal digits behind everything that netCDF reads. It is checked up to
# this size; of larger files, as of those of today, HDF5 checks the numbers.
TRAILER, MOST_CHECKED = b"\nsweeps CRC-32 ", 1 << 28
# s. A reader that tests the lock holds it for a moment.
LOCK_TIMEOUT = 0.2


@contextmanager
def replacing(
    path: Path, folder: Path | None = None, rename: Callable[[Path, Path], None] | None = None
) -> Iterator[Path]:
    """Yield a temporary path, in `folder` if given, and rename it to `path` when its content is on the disk.

    After a crash at any moment the file has its old or its new content. An error removes the temporary file.
    """
    temporary = (folder or path.parent) / f".{path.name}.{uuid4().hex[:12]}.tmp"
    try:
        yield temporary
        # Windows flushes only what is open for writing, and no folders.
        _flush(temporary, os.O_RDWR)
        (rename or os.replace)(temporary, path)
        if os.name != "nt":
            _flush(path.parent, os.O_RDONLY)
    finally:
        with suppress(OSError):
            temporary.unlink()


def _flush(path: Path, flags: int) -> None:
    """Wait until a file or folder is on the disk, if the file system supports it."""
    try:
        descriptor = os.open(path, flags)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as problem:
        if problem.errno not in NO_FSYNC:
            raise


def is_held(path: Path) -> bool | None:
    """Whether a process holds the exclusive lock of a file; None without a file, or if it cannot be locked."""
    with suppress(OSError):
        check_regular(path)
        with open(path, "rb") as file:
            if os.name == "nt":
                return not lock_descriptor(file.fileno(), blocking=False)
            try:
                # Readers share it, which NFS allows where a file is open for reading only.
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
            return False
    return None


def check_regular(path: Path) -> None:
    """Raise an `OSError` for anything but a regular file: opening a pipe would block."""
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(errno.EINVAL, f"{path.name} is not a regular file")


def check_trailer(path: Path) -> None:
    """Raise a StoreError if the CRC-32 that an earlier version appended to a file does not match."""
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END) - len(TRAILER) - 8
        file.seek(max(size, 0))
        last = file.read()
        # A flipped bit of the marker itself leaves the rest of it.
        if sum(a == b for a, b in zip(last, TRAILER, strict=False)) < len(TRAILER) - 1 or size > MOST_CHECKED:
            return
        file.seek(0)
        if last != TRAILER + b"%08x" % crc32(file.read(size)):
            raise StoreError(f"{path} is damaged: its checksum does not match; {HINT_MOVE}")


def signature(path: Path) -> tuple[int, ...]:
    """A value that changes whenever a file is replaced; empty without a file."""
    with suppress(OSError):
        state = path.stat()
        return state.st_ino, state.st_mtime_ns, state.st_size
    return ()


class Store:
    """The paths of one sweep, or of its share K of N, (K, N); nothing is created before a run needs it."""

    def __init__(self, path: str | Path, share: tuple[int, int] | None = None) -> None:
        try:
            self.file = Path(os.path.abspath(Path(path).expanduser()))
        except RuntimeError as problem:  # of a path that begins with ~
            raise InputError(f"{path}: {str(problem).rstrip('.')}; write it without ~") from None
        if not self.file.name:
            raise InputError(f"{path}: it is the root of all folders, and no file")
        self.share, name = share, self.file.name + ("" if share is None else ".{}-of-{}".format(*share))
        self.parts, self.lock = self.file.with_name(f"{name}.parts"), self.file.with_name(f".{name}.lock")
        self.manifest, self.progress = self.parts / "manifest", self.parts / "progress.json"

    def shares(self) -> "list[Store]":
        """The shares that lie beside the file, by number."""
        name, names = re.compile(rf"{re.escape(self.file.name)}\.(\d+)-of-(\d+)\.parts"), list[str]()
        with suppress(OSError):
            names = os.listdir(self.file.parent)
        numbers = sorted((int(found[2]), int(found[1])) for found in map(name.fullmatch, names) if found)
        return [Store(self.file, (number, count)) for count, number in numbers]

    def exists(self) -> bool:
        """Whether there is a result, finished or not."""
        return self.file.exists() or self.is_unfinished()

    def is_unfinished(self) -> bool:
        """Whether there are parts, of a run or of shares."""
        return any(each.manifest.is_file() for each in (self, *self.shares()))

    def part_names(self) -> list[str]:
        """Names of the parts, in the order in which their batches were submitted."""
        try:
            names = [each.name for each in os.scandir(self.parts) if PART.fullmatch(each.name) and each.is_file()]
        except (FileNotFoundError, NotADirectoryError):
            return []
        except OSError as problem:
            raise StoreError(f"{self.parts} cannot be read: {reason(problem)}") from None
        return sorted(names, key=lambda name: int(name.partition("-")[0]))

    def version(self) -> tuple[Any, ...]:
        """A value that changes whenever another run has written here; that of a share ignores other shares."""
        if self.share is not None:
            return (*Store(self.file).version(), *self.part_names())
        return (*self.part_names(), *signature(self.file), *signature(self.manifest))

    def check_place(self, name: str) -> None:
        """Refuse, before anything is read, a place that cannot store the results of sweep `name`."""
        path = self.file
        try:
            self._check_parts()
            if path.exists() and not path.is_file():
                what = "a folder" if path.is_dir() else "not a regular file"
                raise StoreError(f"{path} is {what}; the results of {name} need a file there")
        except OSError as problem:
            raise StoreError(f"{path} cannot be used: {problem.strerror}; {HINT_OTHER_PATH}") from None

    def check_writable(self) -> None:
        """Refuse, before anything is computed, a folder in which no file can be written."""
        folder = next(each for each in self.file.parents if each.is_symlink() or each.exists())
        if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
            what = "cannot be written to" if folder.is_dir() else "is a file, not a folder"
            what = what if folder.exists() else "is a link to nothing"
            raise StoreError(f"{folder} {what}; {HINT_OTHER_PATH}")

    def _check_parts(self) -> None:
        # A finished run removes the folder.
        if self.parts.is_symlink() or (self.parts.exists() and not self.parts.is_dir()):
            raise StoreError(f"{self.parts} is in the way, for it is no folder; remove it, or {HINT_OTHER_PATH}")
        if foreign := self._foreign():
            raise StoreError(f"{self.parts} has {foreign}, which is not a run's; {HINT_MOVE}")

    def _foreign(self) -> str:
        """The name of a file in the folder of parts that is not from a run; "" if there is none."""
        with suppress(FileNotFoundError, NotADirectoryError):
            return min((name for name in os.listdir(self.parts) if not LEFT.fullmatch(name)), default="")
        return ""

    def clear(self) -> None:
        """Remove the parts; a folder with foreign files stays."""
        # The manifest goes first: parts without a manifest count as none.
        for path in (self.manifest, self.manifest.with_suffix(".copy")):
            with suppress(PermissionError):  # somebody reads it just now, on Windows
                path.unlink(missing_ok=True)
        if not self._foreign():
            shutil.rmtree(self.parts, ignore_errors=True)

    def clear_all(self) -> None:
        """Remove the parts of this locked store and of its shares."""
        self.clear()
        for share in self.shares():
            share.clear()
            with suppress(OSError):
                share.lock.unlink(missing_ok=True)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the lock, which the operating system releases if this process dies.

        A whole run does not wait for a share that computes, nor a share for a whole run: the second gets a
        LockedError.
        """
        try:
            self._check_parts()
            self.file.parent.mkdir(parents=True, exist_ok=True)
            lock = FileLock(self.lock, timeout=LOCK_TIMEOUT, thread_local=False)
            lock.acquire()
        except Timeout:
            raise self.locked_error() from None
        except OSError as problem:
            raise StoreError(f"{self.file} cannot be written: {reason(problem)}; {HINT_OTHER_PATH}") from None
        try:
            with suppress(OSError):  # the owner is for a message only, which a full disk may prevent
                self.parts.mkdir(exist_ok=True)
            write_state(self.progress, owner())
            for other in self.shares() if self.share is None else [Store(self.file)]:
                # Others test locks too, and hold them for a moment.
                until = time.monotonic() + LOCK_TIMEOUT
                while other.is_locked():
                    if time.monotonic() > until:
                        raise other.locked_error()
                    time.sleep(0.1 * LOCK_TIMEOUT)
            yield
        finally:
            if not self.manifest.exists():
                self.clear()
            lock.release()

    def is_locked(self) -> bool:
        """Whether a run holds the lock at present."""
        return bool(is_held(self.lock))

    def locked_error(self) -> LockedError:
        """The error that names the run which holds the lock."""
        state = read_state(self.progress)
        run = "process {pid} on {host}, begun {started}".format(**state) if state else "another run"
        return LockedError(f"{self.file} is being written by {run}; wait for it, or {HINT_OTHER_PATH}")


def owner() -> dict[str, Any]:
    """Process, host and start of this run."""
    return {"pid": os.getpid(), "host": socket.gethostname(), "started": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"}


def write_state(file: Path, state: dict[str, Any]) -> None:
    """Write the progress for other processes; errors are ignored."""
    with suppress(OSError):
        temporary = file.with_name(f".{file.name}.tmp")
        temporary.write_text(json.dumps(state | {"written": time.time()}))
        os.replace(temporary, file)


def read_state(file: Path) -> dict[str, Any]:
    """The progress that a run has written; empty without a file."""
    try:
        check_regular(file)
        state = json.loads(file.read_text(encoding="utf-8"))
        return state if isinstance(state, dict) and {"pid", "host", "started"} <= set(state) else {}
    except (OSError, ValueError):
        return {}
