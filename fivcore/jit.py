"""Decorators that compile kernels with Numba, the folder that keeps them, and array types.

Numba compiles a kernel anew when its own file changes, but not when a file changes from which something is inlined
into it. The folder therefore bears a digest of all sources of this package.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numba import config, njit
from numba.extending import register_jitable
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Function = TypeVar("Function", bound=Callable[..., Any])


class ReadOnlyArrays:
    """Base of data classes: every array in them is read-only."""

    def __post_init__(self) -> None:
        for part in vars(self).values():
            if isinstance(part, np.ndarray):
                part.setflags(write=False)


_HERE = Path(__file__).parent
# Digest of all sources that may be compiled.
SOURCES = sha256(b"".join(path.read_bytes() for path in sorted(_HERE.rglob("*.py")))).hexdigest()[:16]
# Names of the folders of compiled kernels; seconds after which one of other sources is removed.
PREFIX, OLD = "kernels-", 7.0 * 24.0 * 3600.0
_SETTINGS: Any = config
_OPTIONS: Any = {"nogil": True, "error_model": "numpy"}


def kernel(function: Function) -> Function:
    """Compile a function that Python calls; it releases the lock, and 1 / 0 is infinite.

    Operations keep the order in which they are written (no fast-math).
    """
    compiled: Any = njit(**_OPTIONS, fastmath=False)(function)
    # Without a folder that can be written to, every process compiles anew.
    if FOLDER is not None:
        given, _SETTINGS.CACHE_DIR = _SETTINGS.CACHE_DIR, str(FOLDER)
        try:
            with suppress(RuntimeError):
                compiled.enable_caching()
        finally:
            _SETTINGS.CACHE_DIR = given
    return compiled


def _part(**options: Any) -> Callable[[Function], Function]:
    """Compile a function into the kernels that call it; for Python it stays as it is."""
    # Without a `fastmath` of its own it would have that of the kernel which happens to need it first.
    return cast(Any, register_jitable(**_OPTIONS, no_cfunc_wrapper=True, **options))


# A call of its own, or, where a call would cost more than the body, lines of the caller ...
called = _part(fastmath=False)
inlined = _part(fastmath=False, forceinline=True)
# ... with products and sums that may be fused, in the order written ...
contracted = _part(fastmath={"contract"}, forceinline=True)
# ... or with sums that may be added in any order, too: only these use vector registers. Their width decides the
# last bits, which are the same on machines of one kind only, like those of eigenvectors.
reordered = _part(fastmath={"reassoc", "contract", "nsz"}, forceinline=True)
reordered_call = _part(fastmath={"reassoc", "contract", "nsz"})


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


_USER = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fiv"
# A folder that others use, too, has a sub-folder of ours.
FOLDER = cache_folder(
    [Path(_SETTINGS.CACHE_DIR) / "fiv"] if _SETTINGS.CACHE_DIR else [_HERE / "__pycache__", _USER]
)
