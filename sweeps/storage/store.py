"""Where a sweep is kept: one CF netCDF file, and beside it, until it is whole, a folder of parts.

STUDY.nc            the result; replaced as a whole, never written into
STUDY.parts/        while a run goes on, or after it was interrupted:
    manifest            what the result will look like
    000001-….part       what has come of a batch
    progress.json       how far the run is, and whose it is
.STUDY.nc.lock      held by the run
"""

from __future__ import annotations

import os
import re
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from sweeps.errors import StoreError
from sweeps.storage.parts import NAME, PartFolder

OTHER = "choose another folder"
# What a run may have left besides its manifest and progress, or its system.
LEFT = re.compile(rf"{NAME.pattern}|\..*\.tmp|\.nfs.*|\.DS_Store")


def mark(path: Path) -> tuple[int, ...]:
    """Changes whenever a file is replaced; nothing where there is none."""
    with suppress(OSError):
        about = path.stat()
        return about.st_ino, about.st_mtime_ns, about.st_size
    return ()


class Store:
    """The files of one sweep; nothing is touched before it is asked for."""

    def __init__(self, path: str | Path) -> None:
        self.file = Path(os.path.abspath(Path(path).expanduser()))
        self.parts = self.file.with_name(f"{self.file.stem}.parts")
        self.lock = self.file.with_name(f".{self.file.name}.lock")
        self.manifest = self.parts / "manifest"
        self.progress = self.parts / "progress.json"

    @property
    def folder(self) -> PartFolder:
        """The parts."""
        return PartFolder(self.parts)

    def stamp(self) -> tuple[Any, ...]:
        """Changes whenever another run has been here."""
        marks: list[Any] = list(self.folder.names())
        return (*marks, *mark(self.file), *mark(self.manifest))

    def check_place(self, name: str) -> None:
        """Refuse, before anything is computed, a place where the results of `name` cannot go."""
        path = self.file
        try:
            if path.exists() and not path.is_file():
                what = "a folder" if path.is_dir() else "not a regular file"
                raise StoreError(f"{path} is {what}; the results of {name} need a file there")
            self.check_parts()
            folder = next(each for each in path.parents if each.is_symlink() or each.exists())
            if not folder.exists():
                raise StoreError(f"{folder} is a link to nothing; {OTHER}")
            if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
                raise StoreError(f"{folder} cannot be written to; {OTHER}")
        except OSError as problem:
            raise StoreError(f"{path} cannot be used: {problem.strerror}; {OTHER}") from None

    def check_parts(self) -> None:
        """Refuse what is somebody's in the place of the parts, which are removed: a link, a file, another folder.

        A link in the place of the lock would make a file elsewhere.
        """
        if self.parts.exists() and not self.parts.is_dir():
            raise StoreError(f"{self.parts} is in the way, for it is no folder; remove it, or {OTHER}")
        if self.parts.is_symlink():
            raise StoreError(f"{self.parts} is a link, where a folder of its own is needed; remove it, or {OTHER}")
        if not self.manifest.exists() and (found := self._foreign()):
            raise StoreError(f"{self.parts} holds {found}, which no run has left; move it away, or {OTHER}")
        if self.lock.is_symlink():
            raise StoreError(f"{self.lock} is a link, where a file of its own is needed; remove it, or {OTHER}")

    def clear(self) -> None:
        """Remove the parts, with all that is among them; a folder that no run has left stays."""
        if self.manifest.exists() or not self._foreign():
            # The manifest goes first: without it the folder is nothing.
            self.manifest.unlink(missing_ok=True)
            shutil.rmtree(self.parts, ignore_errors=True)

    def _foreign(self) -> str:
        """The name of something in the folder of parts that is not ours; "" if there is none."""
        with suppress(FileNotFoundError, NotADirectoryError):
            ours = self.manifest.name, self.progress.name
            names = (name for name in os.listdir(self.parts) if not (name in ours or LEFT.fullmatch(name)))
            return min(names, default="")
        return ""
