"""Large variables: from shard to file, a few rows at a time, never all in memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from sweeps.errors import StoreError
from sweeps.storage.manifest import Layout
from sweeps.storage.merge import Gathered, Source, attributes, scaled
from sweeps.storage.parts import NETCDF

# Of a large variable's chunks: a reader who wants one point should not read a hundred others.
CHUNK_BYTES = 1 << 18
MOST_CHUNK_BYTES = 1 << 22
# What was written last and may be written into again, of all large variables; netCDF would keep 64 MB of each.
CACHE_BYTES = 1 << 25


def stream(layout: Layout, sources: Sequence[Source], found: Gathered, large: Sequence[str], path: Path) -> None:
    """Write the large variables into a new file, a source at a time."""
    with NETCDF:
        file = netCDF4.Dataset(path, "w")
    try:
        with NETCDF:
            file.set_auto_maskandscale(False)
            for dim, length in zip(layout.grid.dims, layout.grid.shape, strict=True):
                file.createDimension(dim, length)
            for name in large:
                _create(file, layout, name)
                file[name].set_var_chunk_cache(max(CACHE_BYTES // len(large), MOST_CHUNK_BYTES))
        for number, source in enumerate(sources):
            points = np.flatnonzero(found.source == number)
            if not len(points):
                continue
            table = source.read(large)
            if table is None:
                raise StoreError(f"{source.name} got damaged while it was read; plan and run again")
            for begin, end in _runs(points, layout.grid.shape[-1]):
                here = points[begin:end]
                *outer, last = np.unravel_index(here[0], layout.grid.shape)
                for name in large:
                    values = scaled(layout, name, _rows(table.values[name], found.row[here]), source, here)
                    with NETCDF:
                        file[name][(*outer, slice(last, last + len(here)))] = values
    finally:
        with NETCDF:
            file.close()


def _rows(values: NDArray[Any], rows: NDArray[np.int32]) -> NDArray[Any]:
    """Rows of an array, without a copy where they are neighbours."""
    first, last = int(rows[0]), int(rows[-1])
    if last - first + 1 == len(rows) and np.all(np.diff(rows) == 1):
        return values[first : last + 1]
    return values[rows]


def _runs(points: NDArray[np.intp], length: int) -> Iterator[tuple[int, int]]:
    """Stretches of neighbours along the last dimension."""
    breaks = np.flatnonzero((np.diff(points) != 1) | (points[1:] % length == 0)) + 1
    edges = [0, *breaks.tolist(), len(points)]
    yield from pairwise(edges)


def chunk(layout: Layout, name: str) -> list[int]:
    """Lengths of the pieces in which a variable is stored: a reader of one point reads few others."""
    row, inner = layout.row_bytes(name), layout.shape(name)
    most = layout.grid.shape[-1]
    lengths = [1] * (len(layout.grid.shape) - 1) + [min(max(CHUNK_BYTES // row, 1), most), *inner]
    if row > MOST_CHUNK_BYTES:
        lengths[-1] = max(inner[-1] * MOST_CHUNK_BYTES // row, 1)
    return lengths


def _create(file: Any, layout: Layout, name: str) -> None:
    variable, inner = layout.variables[name], layout.shape(name)
    for dim, length in zip(variable.dims, inner, strict=True):
        if dim not in file.dimensions:
            file.createDimension(dim, length)
    small = variable.digits is not None or np.dtype(variable.dtype).kind == "i"
    made = file.createVariable(
        name,
        variable.dtype,
        (*layout.grid.dims, *variable.dims),
        fill_value=np.array(variable.missing, variable.dtype)[()],
        chunksizes=chunk(layout, name),
        zlib=small,
        complevel=1,
        shuffle=small,
        fletcher32=True,
    )
    aside = [axis for axis in layout.grid.axes if axis not in layout.grid.dims]
    made.setncatts(attributes(variable, name) | ({"coordinates": " ".join(aside)} if aside else {}))
