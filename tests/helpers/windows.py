"""An imitation of Windows: its treatment of open files, folders and locks."""

import errno
import os
from contextlib import suppress
from functools import wraps
from pathlib import Path

from filelock import FileLock


def is_open(path):
    """Whether this process has a file open."""
    for each in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if os.path.samefile(each, path):
                return True
    return False


def closed(function):
    """A function of paths that refuses files that are open."""

    @wraps(function)
    def refusing(*paths, **options):
        if any(is_open(path) for path in paths):
            raise PermissionError(errno.EACCES, "Access is denied", str(paths[-1]))
        return function(*paths, **options)

    return refusing


class Windows:
    """The module `os` with the name of Windows, where no folder can be opened."""

    name = "nt"

    def __getattr__(self, name):
        return getattr(os, name)

    @staticmethod
    def open(path, flags, *rest):
        if os.path.isdir(path):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return os.open(path, flags, *rest)


class Removing(FileLock):
    """A lock whose file is removed when it is released."""

    def release(self, force=False):
        super().release(force)
        with suppress(OSError):
            os.unlink(self.lock_file)
