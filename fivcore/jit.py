"""How compiled kernels are compiled, and the array types that they and their callers share."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numba import config, njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
# Of all that may be compiled.
SOURCES = sha256(b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.rglob("*.py")))).hexdigest()[
    :16
]
# Names of the folders in which compiled kernels are kept; seconds after which one of other sources is removed.
PREFIX, OLD = "kernels-", 7.0 * 24.0 * 3600.0
Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile once (kept on disk where there is a place), release the lock, let 1 / 0 be infinite.

    No fast-math: the order of operations is the one written.
    """
    compiled = njit(nogil=True, error_model="numpy")(function)
    # Without a folder that may be written to, every process compiles anew.
    with suppress(RuntimeError), _cache_of_these_sources():
        compiled.enable_caching()
    return cast(Function, compiled)


def cache_folder(homes: Iterable[Path]) -> Path | None:
    """A folder for what is compiled from these sources, in the first of some places that can be written to.

    Numba looks only at the file of a kernel; what is inlined into it from others would stay as it was. Folders of
    other sources are removed there once nobody has written to them for OLD.
    """
    for home in homes:
        folder = home / f"{PREFIX}{SOURCES}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if not os.access(folder, os.W_OK):
            continue
        for other in home.glob(f"{PREFIX}*"):
            with suppress(OSError):
                if other != folder and time.time() - other.stat().st_mtime > OLD:
                    shutil.rmtree(other, ignore_errors=True)
        return folder
    return None


@contextmanager
def _cache_of_these_sources() -> Iterator[None]:
    """Let Numba keep what it compiles in the folder of these sources; without one it must not keep anything."""
    if FOLDER is None:
        raise RuntimeError("no folder for compiled kernels can be written to")
    given, _SETTINGS.CACHE_DIR = _SETTINGS.CACHE_DIR, str(FOLDER)
    try:
        yield
    finally:
        _SETTINGS.CACHE_DIR = given


def inlined(function: Function) -> Function:
    """A small function within a kernel, put in its place: a call costs more than what it does."""
    return cast(Function, njit(nogil=True, error_model="numpy", forceinline=True)(function))


_FREEDOM = {"reassoc", "contract", "nsz"}


def reordered(function: Function) -> Function:
    """An inlined function whose sums may be added in any order, products and sums fused.

    In the order written, a sum cannot use vector registers. How wide they are decides the last bits: the same
    on every machine of one kind, like those of the eigenvectors it works on.
    """
    return cast(Function, njit(nogil=True, error_model="numpy", forceinline=True, fastmath=_FREEDOM)(function))


def reordered_call(function: Function) -> Function:
    """The same for what is called seldom and from many places: it is compiled once."""
    return cast(Function, njit(nogil=True, error_model="numpy", fastmath=_FREEDOM)(function))


def contracted(function: Function) -> Function:
    """An inlined function whose products and sums may be fused; their order is the one written."""
    return cast(Function, njit(nogil=True, error_model="numpy", forceinline=True, fastmath={"contract"})(function))


_SETTINGS: Any = config
FOLDER = cache_folder(
    [Path(_SETTINGS.CACHE_DIR)]
    if _SETTINGS.CACHE_DIR
    else [
        Path(__file__).parent / "__pycache__",
        Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fiv",
    ]
)
