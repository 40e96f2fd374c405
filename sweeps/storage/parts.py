"""Shards: a table as the bytes of a netCDF file, whose name holds a check sum of its content.

A shard is written under a temporary name, flushed and renamed, so that it is whole or not there; a damaged one
no longer fits its name.
"""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import netCDF4
import numpy as np

from sweeps.compute.batch import Table
from sweeps.grid import Variable

# The netCDF library is not made for several threads at once.
NETCDF = threading.RLock()

TEXTS = ("error", "traceback", "reproduce")
# Bytes of one row from which on it has a chunk of its own.
WIDE = 1 << 16
# Of a shard's number, at least.
DIGITS = 6
NAME = re.compile(rf"\d{{{DIGITS},}}-[0-9a-f]{{8}}\.nc")


def encode(table: Table, variables: Mapping[str, Variable]) -> bytes:
    """A table as a netCDF file in memory."""
    with NETCDF:
        file = netCDF4.Dataset("shard.nc", "w", memory=table.nbytes + (1 << 16))
        write_table(file, table, variables)
        return bytes(file.close())


def decode(content: bytes, wanted: Collection[str] | None = None) -> Table:
    """The table in a shard's bytes, with all results or those that are `wanted`."""
    with NETCDF:
        file = netCDF4.Dataset("shard.nc", memory=content)
        file.set_auto_maskandscale(False)
        table = read_table(file, wanted)
        file.close()
    return table


def write_table(file: Any, table: Table, variables: Mapping[str, Variable], checked: bool = False) -> None:
    """Write a table into an open netCDF file or group; `checked`: results with check sums of their own."""
    file.createDimension("point", len(table))
    for name, values in table.points.items():
        _put(file, f"axis_{name}", values)
    for k, values in enumerate(table.key):
        _put(file, f"key_{k}", values)
    for name, values in table.values.items():
        # Full-precision floats hardly shrink; rounded ones and whole numbers do.
        small = variables[name].digits is not None or values.dtype.kind == "i"
        _put(file, f"value_{name}", values, zlib=small, complevel=1, shuffle=small, fletcher32=checked)
    _put(file, "status", table.status)
    _put(file, "wall_time", table.wall_time)
    if table.failed:
        for name in TEXTS:
            _put(file, name, getattr(table, name))


def read_table(file: Any, wanted: Collection[str] | None = None) -> Table:
    """Read a table from an open netCDF file or group."""
    names, rows = list(file.variables), len(file.dimensions["point"])

    def some(prefix: str) -> dict[str, Any]:
        found = {name.removeprefix(prefix): file[name] for name in names if name.startswith(prefix)}
        return {
            name: read_texts(each).astype(str) if each.dtype.kind == "S" else each[...]
            for name, each in found.items()
        }

    def text(name: str) -> Any:
        return read_texts(file[name]) if name in names else np.full(rows, "", dtype=object)

    values = some("value_") if wanted is None else {name: file[f"value_{name}"][...] for name in wanted}
    key = some("key_")
    columns = [key[str(k)] for k in range(len(key))]
    return Table(
        some("axis_"),
        columns,
        values,
        file["status"][...],
        text("error"),
        text("traceback"),
        text("reproduce"),
        file["wall_time"][...],
    )


def _put(file: Any, name: str, values: np.ndarray, **options: Any) -> None:
    """Write a variable whose first dimension is the point."""
    dims = ["point"]
    for length in values.shape[1:]:
        dims.append(f"n{length}")
        if dims[-1] not in file.dimensions:
            file.createDimension(dims[-1], length)
    if values.dtype.kind == "b":
        values = values.astype(np.int8)
    if values.dtype.kind in "OU":
        _put_texts(file, name, values)
        return
    # A reader takes whole rows.
    wide = values.ndim > 1 and values[:1].nbytes > WIDE and bool(options.get("zlib"))
    chunk = (1, *values.shape[1:]) if wide else None
    made = file.createVariable(name, values.dtype, tuple(dims), fill_value=False, chunksizes=chunk, **options)
    made[...] = values


def _put_texts(file: Any, name: str, texts: np.ndarray) -> None:
    """Write texts as characters, each padded to the longest."""
    letters = np.array([text.encode() for text in texts.tolist()], dtype=bytes)
    width = max(letters.dtype.itemsize, 1)
    if f"letters{width}" not in file.dimensions:
        file.createDimension(f"letters{width}", width)
    made = file.createVariable(name, "S1", ("point", f"letters{width}"), zlib=True, complevel=1)
    made[...] = letters.astype(f"S{width}").view("S1").reshape(len(texts), width)


def read_texts(variable: Any) -> np.ndarray:
    """Texts that are stored as characters."""
    variable.set_auto_chartostring(False)
    return as_texts(variable[...])


def as_texts(letters: Any) -> np.ndarray:
    """Rows of padded characters as texts."""
    letters = np.asarray(letters)
    texts = np.empty(letters.shape[:-1], dtype=object)
    for place in np.ndindex(texts.shape):
        texts[place] = letters[place].tobytes().rstrip(b"\0").decode("utf-8", "replace")
    return texts


class ShardFolder:
    """The shards of a store; made in no time, for every source has one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._last: int | None = None
        self._closed = False
        self._lock = threading.Lock()

    def names(self) -> list[str]:
        """The shards' names in the order in which they were written."""
        found = [
            path.name for path in self.path.glob("[0-9]*-*.nc") if NAME.fullmatch(path.name) and path.is_file()
        ]
        return sorted(found, key=_number)

    def put(self, content: bytes) -> None:
        """Write a shard: temporary name, flush, rename; nothing once the folder is closed."""
        with self._lock:
            if self._closed:
                return
            if self._last is None:
                self._last = max(map(_number, self.names()), default=0)
            self._last += 1
            name = f"{self._last:0{DIGITS}d}-{_check(content)}.nc"
        temporary = self.path / f".{name}.tmp"
        try:
            with open(temporary, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            with self._lock:
                if not self._closed:
                    os.replace(temporary, self.path / name)
            flush_folder(self.path)
        finally:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)

    def close(self) -> None:
        """Take no more shards: the store is given back, and threads that still compute come too late."""
        with self._lock:
            self._closed = True

    def read(self, name: str, wanted: Collection[str] | None = None) -> Table | None:
        """A shard's table; None if it is damaged or gone."""
        try:
            content = (self.path / name).read_bytes()
            if _check(content) != name.partition("-")[2].removesuffix(".nc"):
                return None
            return decode(content, wanted)
        except (OSError, RuntimeError, LookupError, ValueError):
            # What is no shard at all may still fit its name: nothing has the check sum 0.
            return None


def _number(name: str) -> int:
    return int(name.partition("-")[0])


def flush_folder(path: Path) -> None:
    """Make a new name in a folder last, power cut or not; where folders cannot be flushed, the system does it."""
    with suppress(OSError):
        folder = os.open(path, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _check(content: bytes) -> str:
    """Of the whole file; what it is to find is damage, not malice."""
    return f"{crc32(content):08x}"
