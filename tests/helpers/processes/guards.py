"""Arrays of a compiled kernel laid against guard pages, which nobody may touch: leaving them ends the process."""

from __future__ import annotations

import ctypes
import importlib
import mmap
import pkgutil
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

import fivcore

PAGE = mmap.PAGESIZE
SIDES = ("behind", "ahead of")
# A float of these bytes is no number, a whole number of them is -1.
POISON = 0xFF
_mprotect = ctypes.CDLL(None, use_errno=True).mprotect
_mprotect.argtypes = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int


class Guarded:
    """Bytes right behind a page that may not be touched, or right ahead of one; POISON is on their other side."""

    def __init__(self, size: int, side: str) -> None:
        pages = max(-(-size // PAGE), 1)
        self.memory = mmap.mmap(-1, (pages + 2) * PAGE)
        room = np.frombuffer(self.memory, np.uint8)
        for place in (0, (pages + 1) * PAGE):
            if _mprotect(room.ctypes.data + place, PAGE, 0):
                raise OSError(ctypes.get_errno(), "mprotect")
        usable = slice(PAGE, (pages + 1) * PAGE)
        self.first = usable.start if side == "behind" else usable.stop - size
        self.bytes = room[self.first : self.first + size]
        self._rest = room[self.first + size : usable.stop] if side == "behind" else room[PAGE : self.first]
        self._rest[:] = POISON

    def untouched(self) -> bool:
        """Whether nothing was written beside the bytes."""
        return bool((self._rest == POISON).all())


def _arrays(values: Any) -> Iterator[np.ndarray]:
    for value in values:
        if isinstance(value, tuple):
            yield from _arrays(value)
        elif isinstance(value, np.ndarray):
            yield value
        elif not isinstance(value, (int, float, complex, np.number)):
            raise TypeError(f"{type(value).__name__}: kernels take arrays, tuples of them, and numbers")


def _extents(arrays: Iterator[np.ndarray]) -> list[tuple[int, int]]:
    """Begin and end in memory of arrays, of those that share some of it together."""
    joined: list[tuple[int, int]] = []
    for low, high in sorted({np.lib.array_utils.byte_bounds(array) for array in arrays if array.size}):
        if joined and low < joined[-1][1]:
            joined[-1] = joined[-1][0], max(high, joined[-1][1])
        else:
            joined.append((low, high))
    return joined


class Laid:
    """The arguments of a kernel with all arrays laid against pages; arrays that share memory still do."""

    def __init__(self, given: tuple[Any, ...], side: str) -> None:
        self._rooms = {(low, high): Guarded(high - low, side) for low, high in _extents(_arrays(given))}
        for (low, high), room in self._rooms.items():
            ctypes.memmove(room.bytes.ctypes.data, low, high - low)
        self._empty = Guarded(0, side)
        self.arguments = tuple(map(self._copy, given))

    def _copy(self, value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(self._copy, value))
        if not isinstance(value, np.ndarray):
            return value
        room, place = self._empty, 0
        for (low, high), own in self._rooms.items():
            if value.size and low <= value.ctypes.data < high:
                room, place = own, value.ctypes.data - low
        copy = np.ndarray(value.shape, value.dtype, room.memory, room.first + place, value.strides)
        copy.flags.writeable = value.flags.writeable
        return copy

    def content(self) -> bytes:
        """The bytes of all arrays."""
        return b"".join(room.bytes.tobytes() for room in self._rooms.values())

    def untouched(self) -> bool:
        """Whether nothing was written beside an array."""
        return all(room.untouched() for room in (*self._rooms.values(), self._empty))

    def give_back(self) -> None:
        """Write what the arrays hold to the arguments that they are copies of."""
        for (low, high), room in self._rooms.items():
            ctypes.memmove(low, room.bytes.ctypes.data, high - low)


def guarded(kernel: Any, calls: Counter[str]) -> Callable[..., Any]:
    """A kernel that works twice, its arrays behind guard pages and ahead of them, and must do the same twice."""

    def call(*given: Any) -> Any:
        name = f"{kernel.__module__}.{kernel.__name__}"
        calls[name] += 1
        both = [Laid(given, side) for side in SIDES]
        for laid, side in zip(both, SIDES, strict=True):
            result = kernel(*laid.arguments)
            assert laid.untouched(), f"{name} wrote beside arrays that lie {side} a page"
        assert both[0].content() == both[1].content(), f"{name} reads beside its arrays"
        both[1].give_back()
        return result

    return call


def kernels() -> dict[str, Any]:
    """All kernels that Python may call, by every module and name under which they are known."""
    names = [part.name for part in pkgutil.walk_packages(fivcore.__path__, "fivcore.")]
    return {
        f"{name}.{key}": value
        for name in names
        for key, value in vars(importlib.import_module(name)).items()
        if isinstance(value, Dispatcher) and not value.targetoptions.get("forceinline")
    }


@contextmanager
def all_guarded(monkeypatch: Any, calls: Counter[str]) -> Iterator[None]:
    """Guard every kernel that Python calls; calls are counted by module and name.

    Whatever is computed here must have been computed before: no kernel can be compiled while others are replaced.
    """
    with monkeypatch.context() as patch:
        for place, kernel in kernels().items():
            patch.setattr(place, guarded(kernel, calls))
        yield
