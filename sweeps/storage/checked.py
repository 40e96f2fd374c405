"""What a file must be before anything of it is used: regular, as it was written, and not too large."""

from __future__ import annotations

import errno
import json
import math
import os
import stat
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sweeps.errors import InputError
from sweeps.grid import MOST_POINTS

# What stands before the check sum at a file's end; bytes that are read at a time.
SEAL, BLOCK = b"\nsweeps CRC-32 ", 1 << 20
# Where HDF5 says how long a file is, by the version of what the file begins with; its library cuts files to that.
HDF5, LENGTH_AT = b"\x89HDF\r\n\x1a\n", {0: 40, 1: 44, 2: 28, 3: 28}


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
        Naming the variable and its shape or type.
    LookupError, TypeError, ValueError, AttributeError
        If what the file says of itself cannot be understood.
    """
    most = {name: MOST_POINTS for name in ("status", *file.dimensions)}
    if "identity" in file.ncattrs():
        most |= _most_entries(file, json.loads(file.identity))
    for name, variable in file.variables.items():
        if math.prod(variable.shape) > most.get(name, math.inf):
            raise InputError(f"{name} has the shape {' x '.join(map(str, variable.shape))}, which no result has")
        if not isinstance(variable.datatype, np.dtype) and variable.dtype is not str:
            raise InputError(f"{name} is of a type of its own, which no result has")


def _most_entries(file: Any, identity: dict[str, Any]) -> dict[str, int]:
    """Of each variable that was computed how many entries it may have, by its points and its own dimensions."""
    points = math.prod(len(file.dimensions[group[0]]) for group in identity["groups"])
    lengths = {name: int(text.partition(" ")[0]) for name, text in identity["coords"].items()}
    return {
        name: points * math.prod(lengths[dim] for dim in each["dims"])
        for name, each in identity["variables"].items()
    }
