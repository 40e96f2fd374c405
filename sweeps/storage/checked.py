"""What a file must be before anything of it is used: regular, as it was written, and not too large."""

from __future__ import annotations

import errno
import json
import math
import os
import stat
import zlib
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sweeps.errors import InputError
from sweeps.grid import MOST_POINTS

# What stands before the check sum at a file's end; bytes that are read at a time.
SEAL, BLOCK = b"\nsweeps CRC-32 ", 1 << 20
# Where HDF5 says how long a file is, by the version of what the file begins with; its library cuts files to that.
HDF5, LENGTH_AT = b"\x89HDF\r\n\x1a\n", {0: 40, 1: 44, 2: 28, 3: 28}
# What a heap of it begins with, and how much of a file's beginning and of its end is searched for them: in a large
# file that was written here it stood in the first 3 kB.
HEAP, AT_END = b"GCOL\x01", 1 << 25

# What a result says of itself.
TEXTS = {"sweep", "identity", "configuration", "presentation", "environments"}
TEXTS |= {"title", "history", "source", "Conventions"}


def check_regular(path: Path) -> None:
    """Raise the `OSError` of a path at which there is no regular file: a pipe would be waited for, for ever."""
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(errno.EINVAL, f"{path.name} is not a regular file")


def seal(path: Path) -> None:
    """Append the check sum of a netCDF file to it, where readers of HDF5 do not look.

    HDF5 has check sums of large variables only, and whoever changes the file by it cuts the seal off.
    """
    with open(path, "r+b") as file:
        file.write(_seal(file, os.fstat(file.fileno()).st_size))


def check_seal(path: Path) -> None:
    """Raise an `InputError` if a file has a seal of another content, or something else behind what is HDF5's."""
    check_regular(path)
    with open(path, "rb") as file:
        begin = file.read(64)
        whole = os.fstat(file.fileno()).st_size
        size = whole - len(SEAL) - 8
        file.seek(max(size, 0))
        last = file.read()
        file.seek(0)
        sound = last == _seal(file, size) if last.startswith(SEAL) else whole <= _length(begin, whole)
    if not sound:
        raise InputError("its content is not what was written")


def check_heaps(path: Path) -> None:
    """Raise an `InputError` if a file has a heap in which the HDF5 library would stay for ever.

    It goes through a heap's objects by their lengths, also where free space, number 0, is said to have none.
    """
    size = path.stat().st_size
    with open(path, "rb") as file:
        for begin in chain(range(0, min(AT_END, size), BLOCK), range(max(AT_END, size - AT_END), size, BLOCK)):
            file.seek(begin)
            piece = file.read(BLOCK + len(HEAP) - 1)
            at = piece.find(HEAP)
            while at >= 0:
                _check_heap(file, begin + at, size)
                at = piece.find(HEAP, at + 1)


def _check_heap(file: BinaryIO, begin: int, size: int) -> None:
    file.seek(begin + 8)
    length = int.from_bytes(file.read(8), "little")
    heap, at = file.read(length - 16 if 16 < length <= size else 0), 0
    while at + 16 <= len(heap):
        number, length = (int.from_bytes(heap[at + a : at + b], "little") for a, b in ((0, 2), (8, 16)))
        step = 16 + (length + 7) // 8 * 8 if number else length
        if step == 0:
            raise InputError("a heap of it has no end")
        at += step


def _length(begin: bytes, whole: int) -> int:
    """How long a file is as HDF5 says at its beginning; of another file, what it is."""
    at = LENGTH_AT.get(begin[8]) if begin.startswith(HDF5) and len(begin) == 64 else None
    return whole if at is None else int.from_bytes(begin[at : at + 8], "little")


def _seal(file: BinaryIO, size: int) -> bytes:
    """What follows the first `size` bytes of a file, from its beginning."""
    check = 0
    for begin in range(0, size, BLOCK):
        check = zlib.crc32(file.read(min(BLOCK, size - begin)), check)
    return SEAL + b"%08x" % check


def check_declared(file: Any) -> None:
    """Refuse an open netCDF file that declares more than a result may have, or other types, before it is read.

    Raises
    ------
    InputError
        Naming the variable or attribute, and its shape or type.
    LookupError, TypeError, ValueError, AttributeError
        If what the file says of itself cannot be understood.
    """
    for name in TEXTS.intersection(file.ncattrs()):
        if not isinstance(file.getncattr(name), str):
            raise InputError(f"its {name} is no text")
    identity = json.loads(file.identity) if "identity" in file.ncattrs() else {"variables": {}}
    most = {name: MOST_POINTS for name in ("status", *file.dimensions)}
    if identity["variables"]:
        most |= _most_entries(file, identity)
    for name, variable in file.variables.items():
        if math.prod(variable.shape) > most.get(name, math.inf):
            raise InputError(f"{name} has the shape {' x '.join(map(str, variable.shape))}, which no result has")
        if not isinstance(variable.datatype, np.dtype) and variable.dtype is not str:
            raise InputError(f"{name} is of a type of its own, which no result has")
    if "status" in file.variables:
        points, own = file["status"].dimensions, identity["variables"]
        kept = {name: (points, own[name]["dims"] if name in own else []) for name in ("status", "wall_time", *own)}
        kept |= {"error": (points, None), "traceback": (("failure",), None), "reproduce": (("failure",), None)}
        for name in filter(file.variables.__contains__, kept):
            _check_kept(file[name], *kept[name])


def _check_kept(variable: Any, along: tuple[str, ...], own: list[str] | None) -> None:
    """Refuse a variable that has not a text for each point, or numbers along some of its `own` dimensions."""
    text = variable.dtype is str or variable.dtype.kind == "S"
    if text != (own is None):
        raise InputError(f"{variable.name} has {'texts' if text else 'numbers'}")
    dims, count = variable.dimensions, len(along)
    right = len(dims) == count + (variable.dtype == "S1") if own is None else set(dims[count:]) <= set(own)
    if dims[:count] != along or not right:
        raise InputError(f"{variable.name} runs along {', '.join(dims)}")


def _most_entries(file: Any, identity: dict[str, Any]) -> dict[str, int]:
    """Of each variable that was computed how many entries it may have, by its points and its own dimensions."""
    points = math.prod(len(file.dimensions[group[0]]) for group in identity["groups"])
    return {name: points * math.prod(inner) for name, inner in shapes_of(identity).items()}


def shapes_of(identity: dict[str, Any]) -> dict[str, tuple[int, ...]]:
    """The shape that each variable has at one point, by a result's identity."""
    lengths = {name: int(text.partition(" ")[0]) for name, text in identity["coords"].items()}
    return {name: tuple(lengths[dim] for dim in each["dims"]) for name, each in identity["variables"].items()}
