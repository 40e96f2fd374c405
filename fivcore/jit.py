"""How compiled kernels are compiled, and the array types that they and their callers share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numba import config, njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
# Entries of eight bytes on either side of an array: two lines of a cache.
ROOM = 16
# Of all that may be compiled.
SOURCES = sha256(b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.rglob("*.py")))).hexdigest()[
    :16
]
Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile once (kept on disk where there is a place), release the lock, let 1 / 0 be infinite.

    No fast-math: the order of operations is the one written.
    """
    compiled = njit(nogil=True, error_model="numpy")(function)
    # Without a folder that may be written to, every process compiles anew.
    with suppress(RuntimeError), _folder_of_these_sources():
        compiled.enable_caching()
    return cast(Function, compiled)


@contextmanager
def _folder_of_these_sources() -> Iterator[None]:
    """Keep compiled code apart for each state of this package.

    Numba looks only at the file of a kernel; what is inlined into it from others would stay as it was.
    """
    settings: Any = config
    given = settings.CACHE_DIR
    settings.CACHE_DIR = str(Path(given or Path(__file__).parent / "__pycache__") / SOURCES)
    try:
        yield
    finally:
        settings.CACHE_DIR = given


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


def apart(values: NDArray[Any]) -> NDArray[Any]:
    """A copy with room around it.

    Small arrays lie side by side. Where two threads write into one line of the processor's cache, each waits for
    the other at every step: a twentieth of the time.
    """
    room = np.zeros(len(values) + 2 * ROOM, values.dtype)
    inside = room[ROOM : ROOM + len(values)]
    inside[:] = values
    return inside
