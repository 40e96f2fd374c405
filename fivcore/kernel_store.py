"""Compiled kernels on disk. A damaged or missing file costs a compilation, and never stops a computation.

Numba's own cache keeps an index of all variants of a kernel in one file and verifies nothing: a truncated file
raises an error, a corrupted one is executed, and two processes that save at the same time may overwrite each
other's variants. It recompiles a kernel when the kernel's own file changes, but not when a file changes whose code
is inlined into the kernel.

Here the name of the folder contains a digest of all sources of this package. Each variant has its own subfolder
with a checksum, which is written under another name and then renamed.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
import warnings
from collections.abc import Iterable, Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numba

_SETTINGS: Any = numba.config
_HERE = Path(__file__).parent
# Digest of all sources that may be compiled.
SOURCES = sha256(b"".join(path.read_bytes() for path in sorted(_HERE.rglob("*.py")))).hexdigest()[:16]
# Prefix of the folders of compiled kernels; age in seconds at which those of other sources are removed.
PREFIX, OLD = "kernels-", 7.0 * 24.0 * 3600.0
_CHECKSUM = "checksum"


def attach(dispatcher: Any) -> Any:
    """Store the variants of a compiled function in FOLDER, and return the function."""
    # Without a writable folder, every process compiles its own.
    if FOLDER is not None:
        dispatcher._cache = _Variants(dispatcher, FOLDER)
    return dispatcher


class _Variants:
    """The stored variants of one kernel, by signature and processor; replaces Numba's own cache."""

    def __init__(self, dispatcher: Any, home: Path) -> None:
        self._dispatcher, self._home = dispatcher, home
        self.cache_path = str(home)  # Numba prints it in the statistics of a dispatcher.

    def _place(self, signature: Any, codegen: Any) -> Path:
        function = self._dispatcher.py_func
        which = function.__module__, function.__qualname__, str(signature), codegen.magic_tuple()
        return self._home / sha256(repr((*which, sys.version, numba.__version__)).encode()).hexdigest()[:32]

    def _numbas(self, folder: Path) -> Any:
        """Return Numba's cache of this kernel in a folder."""
        given, _SETTINGS.CACHE_DIR = _SETTINGS.CACHE_DIR, str(folder)
        try:
            self._dispatcher.enable_caching()
            return self._dispatcher._cache
        finally:
            _SETTINGS.CACHE_DIR, self._dispatcher._cache = given, self

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return a stored variant, or None; a damaged one is removed."""
        place, result = self._place(signature, context.codegen()), None
        # Numba may raise anything if a file is removed meanwhile or is wrong in spite of its checksum.
        with suppress(Exception):
            if (place / _CHECKSUM).read_text() == _checksum(place):
                result = self._numbas(place).load_overload(signature, context)
        if result is None:
            shutil.rmtree(place, ignore_errors=True)
        return result

    def save_overload(self, signature: Any, result: Any) -> None:
        """Store a variant, or warn that it cannot be stored; the compiled kernel is used in either case."""
        place = self._place(signature, result.codegen)
        try:
            self._home.mkdir(parents=True, exist_ok=True)
            with TemporaryDirectory(dir=self._home, ignore_cleanup_errors=True) as elsewhere:
                new = Path(elsewhere) / "variant"
                self._numbas(new).save_overload(signature, result)
                (new / _CHECKSUM).write_text(_checksum(new))
                new.rename(place)
        except (OSError, RuntimeError) as error:  # RuntimeError: Numba found no source file of the function.
            # Another process may have stored the same variant meanwhile.
            if not place.exists():
                reason = getattr(error, "strerror", error)
                warnings.warn(f"compiled kernels are not kept in {self._home}: {reason}", stacklevel=1)


def _checksum(folder: Path) -> str:
    files = sorted(folder.rglob("*.nb?"))
    return sha256(b"".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()


def cache_folder(homes: Iterable[Path]) -> Path | None:
    """Create the folder of these sources in the first of `homes` that is writable, and return it.

    Folders `kernels-*` of other sources are removed if they have not been written to for OLD seconds.
    """
    for home in homes:
        folder = home / f"{PREFIX}{SOURCES}"
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            for other in home.glob(f"{PREFIX}*"):
                with suppress(OSError):
                    if other != folder and time.time() - other.stat().st_mtime > OLD:
                        shutil.rmtree(other, ignore_errors=True)
            return folder
    return None


def _homes() -> Iterator[Path]:
    """Yield the folders to try; in a shared one, a subfolder `fiv`."""
    if _SETTINGS.CACHE_DIR:
        yield Path(_SETTINGS.CACHE_DIR) / "fiv"
        return
    yield _HERE / "__pycache__"
    # In a container the user may have no home directory.
    with suppress(RuntimeError):
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fiv"


FOLDER = cache_folder(_homes())
