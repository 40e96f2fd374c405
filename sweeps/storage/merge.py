"""From tables to a dataset in memory: every point gets the result of its computation, times its own factors."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sweeps.compute.batch import DONE, FAILED, PENDING, SKIPPED, STATUS_MEANINGS, Table, rounded
from sweeps.grid import Variable
from sweeps.storage.manifest import Layout
from sweeps.storage.parts import ShardFolder

# Letters of all error texts together, and of each at least.
LETTERS, LEAST_LETTERS = 30_000_000, 60
# Of so many failures, tracebacks and reproducing lines are kept.
MOST_TRACEBACKS = 1000


# Points of a layout, the row of a table for each, and whether it was computed there rather than copied.
Pairs = tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]


class Source(Protocol):
    """Somewhere that computed points are kept.

    Attributes
    ----------
    own : bool
        Whether its rows are those of points, factors included, and not of computations.
    name : str
    """

    @property
    def own(self) -> bool:
        """See above."""

    @property
    def name(self) -> str:
        """See above."""

    def read(self, wanted: Collection[str]) -> Table | None:
        """The table with the `wanted` results; None if it is damaged."""

    def points(self, layout: Layout, table: Table) -> Pairs:
        """Points of the layout that get something."""


def pairs(layout: Layout, slots: NDArray[np.intp]) -> Pairs:
    """Every row goes to its slot and to the copies of it; -1 goes nowhere."""
    first = np.searchsorted(layout.sorted_original, slots)
    last = np.searchsorted(layout.sorted_original, slots, side="right")
    counts = np.where(slots >= 0, last - first, 0)
    rows = np.repeat(np.arange(len(slots)), counts)
    within = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    points = layout.order[first[rows] + within]
    return points, rows, points == slots[rows]


class KeyedSource:
    """Rows that are found by their keys."""

    own = False

    def points(self, layout: Layout, table: Table) -> Pairs:
        """Points of the layout that get something."""
        return pairs(layout, layout.find(table.key))


@dataclass(frozen=True)
class ShardSource(KeyedSource):
    """A shard on disk."""

    folder: ShardFolder
    name: str

    def read(self, wanted: Collection[str]) -> Table | None:
        """The shard, read anew."""
        return self.folder.read(self.name, wanted)


@dataclass(frozen=True, eq=False)
class MemorySource(KeyedSource):
    """A table that is in memory anyway."""

    table: Table
    name = "memory"

    def read(self, wanted: Collection[str]) -> Table | None:
        """The table."""
        return self.table


@dataclass(eq=False)
class Gathered:
    """Everything but the large variables, one entry a point, and where the large ones are.

    Attributes
    ----------
    values : dict of str to ndarray
    status, error, wall_time : ndarray
    failures : dict of int to tuple
        Traceback and reproducing line of the computations that failed, by point.
    source, row : ndarray
        For each point the place of its source in the list, and its row there; -1 where there is none.
    damaged : list of str
        Sources that could not be read.
    """

    values: dict[str, NDArray[Any]]
    status: NDArray[np.int8]
    error: NDArray[np.object_]
    wall_time: NDArray[np.float64]
    failures: dict[int, tuple[str, str]]
    source: NDArray[np.int32]
    row: NDArray[np.int32]
    damaged: list[str] = field(default_factory=list)


def gather(layout: Layout, sources: Sequence[Source], large: Collection[str] = ()) -> Gathered:
    """Read every source once; where several know a point, the last that did it counts."""
    size = layout.grid.size
    small = [name for name in layout.variables if name not in large]
    found = Gathered(
        {
            name: np.full(
                (size, *layout.shape(name)), layout.variables[name].missing, layout.variables[name].dtype
            )
            for name in small
        },
        np.where(layout.original < 0, np.int8(SKIPPED), np.int8(PENDING)),
        np.full(size, "", dtype=object),
        np.full(size, np.nan),
        {},
        np.full(size, -1, dtype=np.int32),
        np.full(size, -1, dtype=np.int32),
    )
    for number, source in enumerate(sources):
        table = source.read(small)
        if table is None:
            found.damaged.append(source.name)
        else:
            _take(layout, found, source, table, number)
    return found


def _take(layout: Layout, found: Gathered, source: Source, table: Table, number: int) -> None:
    """Enter a table's rows at their points."""
    points, rows, computed = source.points(layout, table)
    before, status = found.status[points], table.status[rows]
    open_ = (before == PENDING) | (before == FAILED)
    # What failed does not replace what was done.
    better = (status == DONE) | ((status == FAILED) & open_)
    if source.own:
        # What a finished file says of a point goes before what it says of another that is the same.
        better &= computed | (before == PENDING)
    points, rows, computed = points[better], rows[better], computed[better]
    for name, values in found.values.items():
        values[points] = scaled(layout, name, table.values[name][rows], source, points)
    found.status[points] = table.status[rows]
    found.error[points] = table.error[rows]
    # A copy costs nothing.
    found.wall_time[points] = np.where(computed, table.wall_time[rows], 0.0)
    found.source[points], found.row[points] = number, rows
    for point in [point for point in found.failures if found.status[point] != FAILED]:
        del found.failures[point]
    failed = np.flatnonzero(computed & (table.status[rows] == FAILED))
    for point, row in zip(points[failed].tolist(), rows[failed].tolist(), strict=True):
        if table.reproduce[row]:
            # The entry of a computation stands at the point that is now computed for all of its copies.
            found.failures[int(layout.original[point])] = (table.traceback[row], table.reproduce[row])
    if len(found.failures) > 2 * MOST_TRACEBACKS:
        found.failures = {point: found.failures[point] for point in sorted(found.failures)[:MOST_TRACEBACKS]}


def scaled(
    layout: Layout, name: str, values: NDArray[Any], source: Source, points: NDArray[np.intp]
) -> NDArray[Any]:
    """Results of computations as those of points."""
    variable = layout.variables[name]
    if source.own or not variable.scale:
        return values
    factor = layout.factors[variable.scale][points]
    product = (values * factor.reshape(-1, *(1,) * (values.ndim - 1))).astype(values.dtype)
    return rounded(product, variable.digits)


def dataset(layout: Layout, found: Gathered) -> xr.Dataset:
    """What was gathered, with the attributes CF asks for."""
    grid = layout.grid
    # In a file every point has room for the longest text; tracebacks hold all of each.
    letters = max(LEAST_LETTERS, LETTERS // grid.size)
    for point in np.flatnonzero(found.status == FAILED).tolist():
        if len(found.error[point]) > letters:
            found.error[point] = f"{found.error[point][: letters - 3]}..."
    coords: dict[str, Any] = {
        name: ((grid.dim_of(name),), axis.values, attributes(axis, name)) for name, axis in grid.axes.items()
    }
    coords |= {name: ((name,), axis.values, attributes(axis, name)) for name, axis in layout.coords.items()}

    def shaped(array: NDArray[Any]) -> NDArray[Any]:
        return array.reshape(*grid.shape, *array.shape[1:])

    data: dict[str, Any] = {
        name: _variable(name, layout.variables[name], (*grid.dims, *layout.variables[name].dims), shaped(values))
        for name, values in found.values.items()
    }
    flags = {
        "flag_values": np.arange(len(STATUS_MEANINGS.split()), dtype=np.int8),
        "flag_meanings": STATUS_MEANINGS,
        "long_name": "status of the point",
    }
    data["status"] = (grid.dims, shaped(found.status), flags)
    data["error"] = (grid.dims, shaped(found.error), {"long_name": "why the point failed"})
    time = {"units": "s", "long_name": "computing time of the point"}
    data["wall_time"] = (grid.dims, shaped(found.wall_time), time)
    data |= _failures(layout, found)
    return xr.Dataset(data, coords)


def _failures(layout: Layout, found: Gathered) -> dict[str, Any]:
    """The computations that failed: where, why, and the line of Python that shows it again."""
    slots = sorted(found.failures)[:MOST_TRACEBACKS]
    if not slots:
        return {}
    about = {
        "traceback": "where the computation failed",
        "reproduce": "Python that computes the point again",
    }
    texts = np.array([found.failures[slot] for slot in slots], dtype=object).reshape(-1, 2)
    data: dict[str, Any] = {
        name: (("failure",), texts[:, k], {"long_name": text}) for k, (name, text) in enumerate(about.items())
    }
    for name, values in layout.grid.points(np.array(slots)).items():
        told = {"long_name": f"{name} of the point that failed"}
        data[f"failure_{name}"] = (("failure",), values, attributes(layout.grid.axes[name], name) | told)
    return data


def _variable(name: str, described: Variable, dims: tuple[str, ...], values: NDArray[Any]) -> xr.Variable:
    """A variable as it will look when it is read again: missing whole numbers are NaN."""
    encoding: dict[str, Any] = {}
    if values.dtype.kind == "i":
        encoding = {"dtype": described.dtype, "_FillValue": np.array(described.missing, described.dtype)[()]}
        # Readers of CF take single precision where it holds every value of the type.
        kind = np.float32 if values.dtype.itemsize <= 2 else np.float64
        values = np.where(values == described.missing, kind(np.nan), values.astype(kind))
    return xr.Variable(dims, values, attributes(described, name), encoding)


def attributes(described: Any, name: str) -> dict[str, str]:
    """Units, long name (what has none is called by its `name`) and digits of an axis or a variable."""
    told = {"units": described.units, "long_name": described.long_name or name}
    values = getattr(described, "values", None)  # of an axis
    if values is not None and values.dtype.kind == "U":
        # A text has no units.
        del told["units"]
    if getattr(described, "digits", None) is not None:
        told["comment"] = f"kept to {described.digits} significant digits"
    return {name: text for name, text in told.items() if text}
