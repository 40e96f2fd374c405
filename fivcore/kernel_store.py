"""Compiled kernels on the disk. Whatever is wrong there costs a compilation, never the computation itself.

Numba lists all variants of a kernel in one file and checks none: a file that is cut is an error, a wrong byte is
run, and two processes that save at once may give two variants one file. It compiles a kernel again where its
own file has changed, but not where another file has from which something is inlined into the kernel.

So the folder bears a digest of all sources of this package. Each variant has a folder of its own within it, with a
checksum; it is written elsewhere and renamed.
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
# Names of the folders of compiled kernels; seconds after which one of other sources is removed.
PREFIX, OLD = "kernels-", 7.0 * 24.0 * 3600.0
_CHECKSUM = "checksum"


def attach(dispatcher: Any) -> Any:
    """Let a compiled function keep its variants in FOLDER, and return it."""
    # Without a folder that can be written to, every process compiles anew.
    if FOLDER is not None:
        dispatcher._cache = _Variants(dispatcher, FOLDER)
    return dispatcher


class _Variants:
    """The variants of one kernel, for signatures and kinds of processors; in the place of Numba's own cache."""

    def __init__(self, dispatcher: Any, home: Path) -> None:
        self._dispatcher, self._home = dispatcher, home
        self.cache_path = str(home)  # Numba's statistics of a dispatcher name it.

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
        """Return a stored variant; None where it is not as it was written, and its folder is removed."""
        place, result = self._place(signature, context.codegen()), None
        # A file that vanishes meanwhile, or a fault that the checksum bears, may raise anything within Numba.
        with suppress(Exception):
            if (place / _CHECKSUM).read_text() == _checksum(place):
                result = self._numbas(place).load_overload(signature, context)
        if result is None:
            shutil.rmtree(place, ignore_errors=True)
        return result

    def save_overload(self, signature: Any, result: Any) -> None:
        """Store a variant; where that fails a warning says so, and the process goes on with what it has."""
        place = self._place(signature, result.codegen)
        try:
            self._home.mkdir(parents=True, exist_ok=True)
            with TemporaryDirectory(dir=self._home, ignore_cleanup_errors=True) as elsewhere:
                new = Path(elsewhere) / "variant"
                self._numbas(new).save_overload(signature, result)
                (new / _CHECKSUM).write_text(_checksum(new))
                new.rename(place)
        except (OSError, RuntimeError) as error:  # Numba's RuntimeError: the function comes from no file
            # Another process may have stored the same variant meanwhile.
            if not place.exists():
                reason = getattr(error, "strerror", error)
                warnings.warn(f"compiled kernels are not kept in {self._home}: {reason}", stacklevel=1)


def _checksum(folder: Path) -> str:
    files = sorted(folder.rglob("*.nb?"))
    return sha256(b"".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()


def cache_folder(homes: Iterable[Path]) -> Path | None:
    """Make the folder of these sources in the first of `homes` that can be written to, and return it.

    `homes` are ours: `kernels-*` of other sources are removed once nobody has written to them for OLD seconds.
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
    """Yield the folders to try; one that others use, too, has a sub-folder of ours."""
    if _SETTINGS.CACHE_DIR:
        yield Path(_SETTINGS.CACHE_DIR) / "fiv"
        return
    yield _HERE / "__pycache__"
    # In a container the user may have neither a home nor an entry that names one.
    with suppress(RuntimeError):
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fiv"


FOLDER = cache_folder(_homes())
