"""Files that are whole or not there, whatever ends their writer."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def replacing(
    path: Path, aside: Path | None = None, rename: Callable[[Path, Path], None] | None = None
) -> Iterator[Path]:
    """Write a file under a temporary name; flushed, it gets its own, which outlasts a power cut.

    Parameters
    ----------
    path : Path
    aside : Path, optional
        The folder of the temporary file. Default: that of `path`.
    rename : callable, optional
        What gives the file its name. Default: `os.replace`.
    """
    temporary = (aside or path.parent) / f".{path.name}.{os.getpid()}.tmp"
    try:
        yield temporary
        _flush(temporary)
        (rename or os.replace)(temporary, path)
        # Where folders cannot be flushed, the system does it.
        with suppress(OSError):
            _flush(path.parent)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
