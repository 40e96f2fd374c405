"""Files of named arrays behind a small checked header; whatever is read of them is checked as it is read.

Eight bytes of MAGIC, the header's length and check sum, the header as JSON, then the arrays: raw, or where that is
worth it as a single value for all entries, or with their bytes shuffled and deflated. No library's lock is held
meanwhile, and zlib lets other threads run.
"""

from __future__ import annotations

import json
import math
import os
import struct
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.storage.checked import check_regular

MAGIC = b"sweeps-1"
# Of an array; a few bytes may stand for any number of equal entries.
MOST_BYTES = 1 << 34
HEAD = struct.Struct("<8sII")
# So much is read when a file is opened; one that is no longer is checked as a whole.
READ_AT_ONCE = 1 << 16
RAW, CONSTANT, DEFLATED = "raw", "constant", "deflated"


def pack(about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], deflate: Collection[str] = ()) -> bytes:
    """The bytes of a file.

    Parameters
    ----------
    about : mapping
        What JSON can hold.
    arrays : mapping of str to ndarray
        Numbers, flags or texts.
    deflate : collection of str
        Names of the arrays that shrink.
    """
    entries, blobs, offset = {}, [], 0
    for name, values in arrays.items():
        plain = np.ascontiguousarray(values)
        how, blob = _stored(plain, name in deflate)
        entries[name] = [plain.dtype.str, values.shape, how, offset, len(blob), zlib.crc32(blob)]
        blobs.append(blob)
        offset += len(blob)
    header = json.dumps({"about": dict(about), "arrays": entries}).encode()
    return b"".join([HEAD.pack(MAGIC, len(header), zlib.crc32(header)), header, *blobs])


def _stored(values: NDArray[Any], deflate: bool) -> tuple[str, Any]:
    width = values.dtype.itemsize
    if values.size > 1 and width:
        letters = values.reshape(-1).view(np.uint8).reshape(-1, width)
        if np.array_equal(letters[0], letters[-1]) and np.all(letters == letters[0]):
            return CONSTANT, letters[0].tobytes()
        if deflate:
            return DEFLATED, zlib.compress(letters.T.tobytes(), 1)
    return RAW, values.tobytes()


class Packed:
    """A file that `pack` made; arrays are read from it when they are asked for.

    Attributes
    ----------
    about : dict
    names : list of str
        Of the arrays.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is damaged or something else.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        check_regular(path)
        with open(path, "rb") as file:
            self._begin = file.read(READ_AT_ONCE)
            size = os.fstat(file.fileno()).st_size
        if len(self._begin) < HEAD.size or not self._begin.startswith(MAGIC):
            raise ValueError(f"{path} is no file of ours")
        _, length, check = HEAD.unpack_from(self._begin)
        self._start = HEAD.size + length
        header = self._bytes(HEAD.size, length)
        if zlib.crc32(header) != check:
            raise ValueError(f"the header of {path} is damaged")
        found = json.loads(header)
        self.about: dict[str, Any] = found["about"]
        self._arrays: dict[str, Any] = found["arrays"]
        self.names = list(self._arrays)
        if size != self._start + sum(entry[4] for entry in self._arrays.values()):
            raise ValueError(f"{path} has lost its end")
        if size <= READ_AT_ONCE:
            self.read(self.names)

    def _bytes(self, begin: int, length: int) -> bytes:
        if begin + length <= len(self._begin):
            return self._begin[begin : begin + length]
        with open(self.path, "rb") as file:
            file.seek(begin)
            return file.read(length)

    def read(self, names: Collection[str]) -> dict[str, NDArray[Any]]:
        """Some of the arrays, by name."""
        found = {}
        for name in names:
            kind, shape, how, offset, length, check = self._arrays[name]
            blob, dtype = self._bytes(self._start + offset, length), np.dtype(kind)
            if zlib.crc32(blob) != check:
                raise ValueError(f"{name} in {self.path} is damaged")
            if (size := math.prod(shape) * dtype.itemsize) > MOST_BYTES:
                raise ValueError(f"{name} in {self.path} has the shape {shape}")
            if how == DEFLATED:
                whole = zlib.decompressobj().decompress(blob, size + 1)
                letters = np.frombuffer(whole, np.uint8).reshape(dtype.itemsize, -1)
                blob = letters.T.tobytes()
            values = np.frombuffer(blob, dtype)
            found[name] = np.full(shape, values[0], dtype) if how == CONSTANT else values.reshape(shape)
        return found
