"""From stored results to a dataset: each point gets the result of its computation, times its own factors.

A `Table` says which row of which source, a finished file, a part or a batch in memory, belongs to each point; it
reads no value. Large variables become lazy Dask arrays over the sources.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sweeps.errors import DAMAGED, HINT_MOVE, UNREADABLE, DamagedError, StoreError
from sweeps.grid import DONE, FAILED, PENDING, SKIPPED, Axis, Grid, Variable, block_shape, flag_attributes
from sweeps.storage.parts import BatchResult, Coverage, Failure, Manifest, PartSource
from sweeps.storage.store import check_trailer, is_held

# Larger variables are assembled in blocks of this size, bytes.
LARGE = 32_000_000
# Characters of all error texts together, and of each at least: every point has room for the longest.
ERROR_CHARACTERS, LEAST_CHARACTERS = 30_000_000, 60
# Number of failures whose tracebacks are stored.
MOST_TRACEBACKS = 1000

Indices = NDArray[np.signedinteger[Any]]


def open_netcdf(path: Path, **options: Any) -> xr.Dataset:
    """Open a netCDF file without decoding dates; a StoreError names its fault."""
    if not path.is_file():
        raise StoreError(f"{path} is not a regular file; {HINT_MOVE}")
    try:
        return xr.open_dataset(path, engine="netcdf4", decode_times=False, **options)
    except PermissionError:
        what = "cannot be read: permission is missing, or another program has it open"
    except (AttributeError, *UNREADABLE):  # the netCDF library raises AttributeError, too
        held = is_held(path)
        what = "is locked or open in another program; close it there" if held else DAMAGED
        if held is None:
            what = "cannot be locked, as HDF5 wants to; set HDF5_USE_FILE_LOCKING=FALSE"
    raise StoreError(f"{path} {what}")


def present(variable: xr.Variable) -> NDArray[Any]:
    """Values of a file's variable; an OSError if HDF5 cannot read them. Missing results are filled in."""
    from netCDF4 import default_fillvals  # slow, and not every command reads a file

    about, values = variable.attrs | variable.encoding, variable.values
    kind = np.dtype(about.get("dtype", values.dtype)).str[1:]
    # Any byte may be a result, unless it is a flag; earlier versions chose the value, and have a trailer.
    fillable = kind in default_fillvals and (kind[1:] != "1" or "flag_values" in about)
    if fillable and "_FillValue" not in about and np.any(values == np.asarray(default_fillvals[kind], kind)):
        raise OSError("values are lost")
    return values


@dataclass(frozen=True, eq=False)
class FileSource:
    """A finished file as a source of results; its rows are the points of its own grid in C order, scaled."""

    path: Path
    grid: Grid
    environments: list[dict[str, str]]
    name = "file"

    @cached_property
    def data(self) -> xr.Dataset:
        """The open file, with integers as they are stored."""
        check_trailer(self.path)
        return open_netcdf(self.path, cache=False, mask_and_scale=False)

    def coverage(self, manifest: Manifest) -> Coverage:
        """The points in the file."""
        rows = np.arange(self.grid.size)
        status, spent = self.read("status", rows), self.read("wall_time", rows)
        points = np.where((status == DONE) | (status == FAILED), manifest.grid.align(self.grid)(rows), -1)
        count = int(np.count_nonzero(spent > 0.0))
        return points, status == FAILED, float(np.nansum(spent)), count, self.environments

    def read(self, name: str, rows: Any) -> NDArray[Any]:
        """Values of a variable at some rows; the smallest box around them is read from the disk."""
        index = np.unravel_index(rows, self.grid.shape)
        box = tuple(slice(int(each.min()), int(each.max()) + 1) for each in index)
        values = self._values(name, box)
        return np.asarray(values[tuple(each - cut.start for cut, each in zip(box, index, strict=True))])

    def _values(self, name: str, box: Any = ...) -> NDArray[Any]:
        try:
            return present(self.data[name].variable[box])
        except StoreError:
            raise
        except UNREADABLE:
            raise StoreError(f"{self.path} {DAMAGED}") from None

    @property
    def failures(self) -> dict[int, Failure]:
        """The reasons why rows failed."""
        rows = np.flatnonzero(self.read("status", np.arange(self.grid.size)) == FAILED)
        errors = self.read("error", rows).tolist() if len(rows) else []
        reasons = {row: Failure(error) for row, error in zip(rows.tolist(), errors, strict=True)}
        if "failure" in self.data.dims:
            at = self.grid.locate({name: self._values(f"failure_{name}") for name in self.grid.axes})
            lines = zip(*(self._values(name).tolist() for name in ("traceback", "reproduce")), strict=True)
            reasons |= {k: Failure(reasons[k].error, *each) for k, each in zip(at.tolist(), lines, strict=True)}
        return reasons


Source = PartSource | BatchResult | FileSource


class Table:
    """The row of a source for each point: of several sources the last one that did not fail.

    `status`, `source`, `row` (-1 where there is none) and `is_copy`, whether the result was computed at another
    point, have an entry for each point; `seconds` and `computations` are those of all sources. `damaged` are the
    names of parts that are left out, `environments` those in which the others were computed. `added` has the
    variables that the sources lack, where it is done.
    """

    def __init__(self, manifest: Manifest, sources: Sequence[Source], added: "Table | None" = None) -> None:
        size = manifest.grid.size
        self.manifest, self.sources, self.added = manifest, sources, added
        self.status = np.full(size, PENDING, dtype=np.int8)
        self.source, self.row = np.full((2, size), -1, dtype=np.int32)
        self.is_copy = np.zeros(size, dtype=bool)
        self.seconds, self.computations = 0.0, 0
        self.damaged = list[str]()
        self.environments: list[dict[str, str]] = [] if added is None else [*added.environments]
        for number, source in enumerate(sources):
            try:
                points, failed, seconds, computations, environments = source.coverage(manifest)
            except DamagedError as problem:
                self.damaged.append(problem.part)
                continue
            self.seconds += seconds
            self.computations += computations
            self.environments += [each for each in environments if each not in self.environments]
            rows = np.flatnonzero(points >= 0)
            rows = rows[~failed[rows] | (self.status[points[rows]] != DONE)]
            self.status[points[rows]] = np.where(failed[rows], np.int8(FAILED), np.int8(DONE))
            self.source[points[rows]], self.row[points[rows]] = number, rows
        if manifest.representative is not None:
            self._copy(manifest.representative)

    def _copy(self, representative: NDArray[Any]) -> None:
        """Give results to copies of points with a result, and successes to copies of failures."""
        inside = representative >= 0
        for status, receivers in ((DONE, (PENDING, FAILED)), (FAILED, (PENDING,))):
            origins = np.flatnonzero((self.status == status) & inside)
            origin_of = np.full(len(representative), -1, dtype=np.intp)
            origin_of[representative[origins[::-1]]] = origins[::-1]  # of several origins the first
            copies = np.flatnonzero(np.isin(self.status, receivers) & inside)
            copies = copies[origin_of[representative[copies]] >= 0]
            for array in (self.status, self.source, self.row):
                array[copies] = array[origin_of[representative[copies]]]
            self.is_copy[copies] = True
        # A result of a point that was not skipped earlier stays.
        skipped = ~inside & (self.status != DONE)
        self.status[skipped], self.source[skipped] = SKIPPED, -1

    def without(self, part: str) -> list[Source]:
        """The sources without the damaged ones and another part, which proved to be damaged."""
        return [source for source in self.sources if source.name not in (*self.damaged, part)]

    def values(self, name: str, points: slice) -> NDArray[Any]:
        """Values of a variable, or `wall_time`, at a range of points."""
        variable, index = self.manifest.variable(name), np.arange(len(self.status))[points]
        values = variable.absent((len(index), *self.manifest.shape(name)))
        new = self.added if self.added is not None and name in self.added.manifest.variables else None
        for source, rows, at in self._by_source(index):
            if new is not None and isinstance(source, FileSource) and name not in source.data:
                continue
            # A slice copies faster, or not at all.
            part = isinstance(source, PartSource) and bool(np.all(np.diff(rows) == 1))
            found = source.read(name, slice(int(rows[0]), int(rows[-1]) + 1) if part else rows)
            if variable.scale:
                factors = self.manifest.factors[variable.scale]
                factor = factors[index[at]]
                if isinstance(source, FileSource):
                    # Exactly 1 at the file's own points.
                    factor = factor / factors[self.manifest.grid.align(source.grid)(rows)]
                found = scaled(found, factor, variable.digits)
            values[at] = found
        if new is not None:
            done = new.status[points] == DONE
            values[done] = new.values(name, points)[done]
        if name == "wall_time":
            values[self.is_copy[points]] = 0.0
        return values

    def _by_source(self, points: NDArray[np.intp]) -> Iterator[tuple[Source, Indices, Indices]]:
        """Each source of some points, its rows, and the places among the points to which they belong."""
        source = self.source[points]
        order = np.argsort(source, kind="stable")
        numbers, begins = np.unique(source[order], return_index=True)
        # Of nothing, `split` makes one piece.
        for number, places in zip(numbers.tolist(), np.split(order, begins[1:]), strict=False):
            if number >= 0:
                yield self.sources[number], self.row[points[places]], places

    def reasons(self) -> dict[int, Failure]:
        """The reasons why points failed, by point."""
        points, reasons = np.flatnonzero(self.status == FAILED), dict[int, Failure]()
        for source, rows, at in self._by_source(points):
            every = source.failures
            reasons |= {k: every[row] for k, row in zip(points[at].tolist(), rows.tolist(), strict=True)}
        return reasons


def rounded(values: NDArray[Any], digits: int | None) -> NDArray[Any]:
    """Round floats to significant decimal digits by clearing the last bits of the mantissa.

    To nearest, ties to even: idempotent, and the same on every machine. No value moves by more than half a unit of
    the last digit. Values that would become infinite and subnormal numbers, which have fewer bits, stay as they
    are.
    """
    if digits is None:
        return values
    bits, word = (23, np.dtype(np.uint32)) if values.dtype == np.float32 else (52, np.dtype(np.uint64))
    # Half a unit of the last bit is at most 10^-digits / 2.
    drop = bits - int(np.ceil(digits * np.log2(10.0)))
    if drop <= 0:
        return values
    raw: Any = values.view(word)
    shift, half, mask = (word.type(n) for n in (drop, (1 << (drop - 1)) - 1, (1 << drop) - 1))
    near: NDArray[Any] = ((raw + half + ((raw >> shift) & word.type(1))) & ~mask).view(values.dtype)
    normal = np.isfinite(values) & np.isfinite(near) & (np.abs(values) >= np.finfo(values.dtype).tiny)
    return np.where(normal, near, values)


def scaled(values: NDArray[Any], factor: NDArray[np.float64], digits: int | None) -> NDArray[Any]:
    """Multiply the results of computations by the factor of each point, and round them again."""
    product = (values * factor.reshape(-1, *(1,) * (values.ndim - 1))).astype(values.dtype)
    return rounded(product, digits)


def assemble(table: Table, *, lazy: bool) -> xr.Dataset:
    """The dataset of a manifest, with CF attributes; if `lazy`, large variables are Dask arrays over its parts."""
    manifest, grid = table.manifest, table.manifest.grid
    reasons = table.reasons()
    # Fixed-width bytes are written as they are; strings would take a second a million.
    most = max(LEAST_CHARACTERS, ERROR_CHARACTERS // grid.size)
    texts = {k: e if len(e) <= most else f"{e[: most - 3]}..." for k, (e, *_) in reasons.items()}
    errors = np.zeros(grid.size, f"S{max([1, *(len(each.encode()) for each in texts.values())])}")
    errors[list(texts)] = [each.encode() for each in texts.values()]
    arrays: dict[str, Any] = {"status": table.status.reshape(grid.shape), "error": errors.reshape(grid.shape)}
    data: dict[str, Any] = {}
    for name in (*manifest.variables, "status", "error", "wall_time"):
        variable, encoding = manifest.variable(name), {}
        if name not in arrays:
            large = lazy and variable.dtype != "str" and manifest.row_bytes(name) * grid.size > LARGE
            arrays[name] = _lazy(table, name) if large else _values(table, name, grid.shape)
            if np.dtype(variable.dtype).kind == "i":
                missing = np.dtype(variable.dtype).type(variable.missing)
                encoding = {"dtype": variable.dtype, "missing_value": missing}
        data[name] = ((*grid.dims, *variable.dims), arrays[name], attributes(variable, name), encoding)
    data["error"][2]["_Encoding"] = "utf-8"
    data |= _failure_table(table, reasons)
    axes = {**grid.axes, **manifest.coords}
    dims = dict.fromkeys(manifest.coords) | {name: grid.dim_of(name) for name in grid.axes}
    coords = {name: (dims[name] or name, axis.values, attributes(axis, name)) for name, axis in axes.items()}
    return xr.Dataset(data, coords, {"environments": json.dumps(table.environments or [{}])})


def _values(table: Table, name: str, shape: Sequence[int], first: int = 0) -> NDArray[Any]:
    values = table.values(name, slice(first, first + int(np.prod(shape))))
    return as_floats(values.reshape(*shape, *values.shape[1:]), table.manifest.variable(name))


def _lazy(table: Table, name: str) -> Any:
    import dask.array  # slow, and few files are large

    shape, inner = table.manifest.grid.shape, table.manifest.shape(name)
    steps = block_shape(shape, max(LARGE // table.manifest.row_bytes(name), 1))

    def block(block_info: Any = None) -> NDArray[Any]:
        place = block_info[None]["array-location"][: len(shape)]
        first = int(np.ravel_multi_index([begin for begin, _ in place], shape))
        return _values(table, name, [end - begin for begin, end in place], first)

    variable = table.manifest.variable(name)
    empty = as_floats(np.zeros((0,) * (len(shape) + len(inner)), variable.dtype), variable)
    array: Any = dask.array
    chunks = array.core.normalize_chunks((*steps, *inner), (*shape, *inner))
    return array.map_blocks(block, chunks=chunks, dtype=empty.dtype, meta=empty)


def as_floats(values: NDArray[Any], variable: Variable) -> NDArray[Any]:
    """Values as a reader of the file gets them: integers become floats, with NaN for missing values."""
    if values.dtype.kind != "i":
        return values.astype(str) if values.dtype == object else values
    # Single precision represents every integer of 16 bits.
    kind = np.float32 if values.dtype.itemsize <= 2 else np.float64
    return np.where(values == variable.missing, kind(np.nan), values.astype(kind))


def _failure_table(table: Table, reasons: Mapping[int, Failure]) -> dict[str, Any]:
    points = [k for k in sorted(reasons) if reasons[k].traceback and not table.is_copy[k]][:MOST_TRACEBACKS]
    if not points:
        return {}
    texts, grid = np.array([reasons[point] for point in points], dtype=object), table.manifest.grid
    data: dict[str, Any] = {
        "traceback": ("failure", texts[:, 1], {"long_name": "where the computation failed"}),
        "reproduce": ("failure", texts[:, 2], {"long_name": "a line that computes the point again"}),
    }
    for name, values in grid.points(np.array(points)).items():
        named = {"long_name": f"{name} of the point that failed"}
        data[f"failure_{name}"] = ("failure", values, attributes(grid.axes[name], name) | named)
    return data


def attributes(described: Axis | Variable, name: str) -> dict[str, Any]:
    """CF attributes of an axis or a variable; its `name` replaces a missing long name."""
    found: dict[str, Any] = {"units": described.units, "long_name": described.long_name or name}
    variable = described if isinstance(described, Variable) else Variable()
    if variable.dtype == "str" or (isinstance(described, Axis) and described.values.dtype.kind == "U"):
        found["units"] = ""  # strings have none
    elif variable.digits is not None:
        found["comment"] = f"kept to {variable.digits} significant digits"
    elif variable.flags is not None:
        found |= {"units": ""} | flag_attributes(variable.flags, variable.dtype)
    return {name: value for name, value in found.items() if not isinstance(value, str) or value}


def restore_types(data: xr.Dataset) -> xr.Dataset:
    """Replace the stored form of bool and text variables by these types."""
    error = data["error"]
    if error.dtype.kind == "S":
        texts = np.char.decode(error.values, "utf-8")
        data = data.assign(error=(error.dims, texts, {"long_name": error.attrs["long_name"]}))
    for own, each in data.data_vars.items():
        if each.attrs.get("flag_meanings") == "false true" and bool((data["status"] == DONE).all()):
            rest = {k: v for k, v in each.attrs.items() if not k.startswith("flag_")}
            data = data.assign({own: each.astype(bool).assign_attrs(rest)})
    return data
