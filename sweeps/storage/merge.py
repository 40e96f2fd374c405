"""From parts to a dataset: every point gets the result of its computation, times its own factors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sweeps.compute.batch import BatchResult
from sweeps.compute.values import scaled
from sweeps.errors import StoreError
from sweeps.grid import DONE, FAILED, PENDING, SKIPPED, STATUS_FLAGS, Axis, Variable
from sweeps.storage.manifest import Manifest
from sweeps.storage.sources import Source, runs
from sweeps.storage.texts import NETCDF

WALL_TIME = Variable("s", "computing time of the point")
STATUS = Variable("", "status of the point", dtype="int8", flags=STATUS_FLAGS)
ERROR_ATTRIBUTES = {"long_name": "why the point failed"}
# Letters of all error texts together, and of each at least.
LETTERS, LEAST_LETTERS = 30_000_000, 60
# Of so many failures, tracebacks and reproducing lines are kept.
MOST_TRACEBACKS = 1000


Convert = Callable[[str, NDArray[Any], NDArray[np.intp]], NDArray[Any]]


class DamagedError(StoreError):
    """A part got damaged after it was planned with; `part` is its name."""

    def __init__(self, part: str) -> None:
        super().__init__(f"{part} got damaged; plan and run again")
        self.part = part


class Chosen(NamedTuple):
    """Points whose results a source gives, none before it having better ones."""

    source: Source
    points: NDArray[np.intp]
    rows: NDArray[np.intp]
    computed: NDArray[np.bool_]


@dataclass(eq=False)
class Choice:
    """Which source gives each point; known from what sources say of themselves, without any value.

    Attributes
    ----------
    status : ndarray of int8, (points,)
    seconds, computations : float, int
        Computing time of all that is at hand, and of how many computations it is.
    damaged : list of str
        Sources that cannot be used.
    """

    manifest: Manifest
    status: NDArray[np.int8]
    seconds: float = 0.0
    computations: int = 0
    damaged: list[str] = field(default_factory=list)

    def take(self, sources: Sequence[Source]) -> Iterator[Chosen]:
        """Go through the sources; where several know a point, the last that did it counts."""
        for source in sources:
            held = source.held(self.manifest)
            if held is None:
                self.damaged.append(source.name)
                continue
            self.seconds += held.seconds
            self.computations += int(np.count_nonzero(held.computed))
            before = self.status[held.points]
            # What failed does not replace what was done.
            better = ~held.failed | (before == PENDING) | (before == FAILED)
            if source.scaled:
                # What a finished file says of a point goes before what it says of another that is the same.
                better &= held.computed | (before == PENDING)
            points, rows, computed, failed = held.points, held.rows, held.computed, held.failed
            if not better.all():
                points, rows, computed, failed = points[better], rows[better], computed[better], failed[better]
            self.status[points] = np.where(failed, np.int8(FAILED), np.int8(DONE))
            yield Chosen(source, points, rows, computed)


def choice(manifest: Manifest) -> Choice:
    """The choice before any source: every point is pending or skipped."""
    status = np.full(manifest.grid.size, PENDING, dtype=np.int8)
    if manifest.representative is not None:
        status[manifest.representative < 0] = SKIPPED
    return Choice(manifest, status)


def surveyed(manifest: Manifest, sources: Sequence[Source]) -> Choice:
    """The choice after all sources, of which no value is read."""
    chosen = choice(manifest)
    for _ in chosen.take(sources):
        continue
    return chosen


@dataclass(eq=False)
class Gathered:
    """Results in memory, one entry a point.

    Attributes
    ----------
    values : dict of str to ndarray
        Of the variables asked for; `wall_time` is one.
    status : ndarray of int8
    errors : dict of int to str
        Of the points that failed.
    failures : dict of int to tuple
        Traceback and reproducing line of the computations that failed, by point.
    """

    values: dict[str, NDArray[Any]]
    status: NDArray[np.int8]
    errors: dict[int, str] = field(default_factory=dict)
    failures: dict[int, tuple[str, str]] = field(default_factory=dict)


def gather(
    manifest: Manifest, sources: Sequence[Source], names: Collection[str], reasons: bool = True
) -> Gathered:
    """Read some variables of all points, with or without why points failed.

    Raises
    ------
    DamagedError
        If a source is damaged.
    """
    size, chosen = manifest.grid.size, choice(manifest)
    variables = {name: manifest.variables.get(name, WALL_TIME) for name in names}
    found = Gathered(
        {
            name: np.full((size, *inner_shape(manifest, name)), each.missing, each.dtype)
            for name, each in variables.items()
        },
        chosen.status,
    )
    for source, points, rows, computed in chosen.take(sources):
        result = read(source, [name for name in names if name in manifest.variables], reasons)
        for name, values in found.values.items():
            if name in manifest.variables:
                values[points] = at_points(manifest, name, result.values[name][rows], source, points)
            else:
                # A copy costs nothing.
                values[points] = np.where(computed, result.wall_time[rows], 0.0)
        if reasons and (result.failures or found.errors):
            _take_reasons(manifest, found, result.failures, points, rows, computed)
    if chosen.damaged:
        raise DamagedError(chosen.damaged[0])
    return found


def read(source: Source, variables: Collection[str], reasons: bool = False) -> BatchResult:
    """The rows of a source.

    Raises
    ------
    DamagedError
        If it got damaged.
    """
    result = source.read(variables, reasons)
    if result is None:
        raise DamagedError(source.name)
    return result


def _take_reasons(
    manifest: Manifest, found: Gathered, failures: Any, points: Any, rows: Any, computed: Any
) -> None:
    """Enter why points failed, and forget it of those that now have a result."""
    for point in [point for point in found.errors if found.status[point] != FAILED]:
        del found.errors[point]
        found.failures.pop(point, None)
    at = np.flatnonzero(np.isin(rows, list(failures)))
    for point, row, own in zip(points[at].tolist(), rows[at].tolist(), computed[at].tolist(), strict=True):
        found.errors[point] = failures[row].error
        if own and failures[row].reproduce:
            # The entry of a computation stands at the point that is now computed for all of its copies.
            slot = int(manifest.representatives(np.array([point]))[0])
            found.failures[slot] = (failures[row].traceback, failures[row].reproduce)
    if len(found.failures) > 2 * MOST_TRACEBACKS:
        found.failures = {point: found.failures[point] for point in sorted(found.failures)[:MOST_TRACEBACKS]}


def at_points(
    manifest: Manifest, name: str, values: NDArray[Any], source: Source, points: NDArray[np.intp]
) -> NDArray[Any]:
    """Rows of a source as results of points."""
    factor = None if source.scaled else manifest.factor(name, points)
    return values if factor is None else scaled(values, factor, manifest.variables[name].digits)


def inner_shape(manifest: Manifest, name: str) -> tuple[int, ...]:
    """Shape of a variable, or of the computing time, at one point."""
    return manifest.shape(name) if name in manifest.variables else ()


def stream(
    manifest: Manifest,
    sources: Sequence[Source],
    variables: dict[str, Any],
    slots: NDArray[np.intp] | None = None,
    convert: Convert | None = None,
) -> None:
    """Write variables into an open netCDF file, a source at a time.

    Parameters
    ----------
    manifest : Manifest
    sources : sequence of Source
    variables : dict of str to netCDF4.Variable
        With the grid's dimensions first, or with one dimension for the `slots`.
    slots : ndarray of int, optional
        Ascending points, which are the rows of the variables.
    convert : callable, optional
        Makes of a variable's name, values of computations and their points what is written; default: results of
        points.

    Raises
    ------
    DamagedError
        If a source is damaged.
    """
    shape = manifest.grid.shape if slots is None else (len(slots),)
    chosen = choice(manifest)
    for source, points, rows, _ in chosen.take(sources):
        if slots is not None:
            inside = np.isin(points, slots)
            points, rows = points[inside], rows[inside]
        if not len(points):
            continue
        result = read(source, list(variables))
        order = np.argsort(points, kind="stable")
        points, rows = points[order], rows[order]
        places = points if slots is None else np.searchsorted(slots, points)
        for begin, end in runs(places, shape[-1]):
            *outer, last = np.unravel_index(places[begin], shape)
            region = (*outer, slice(last, last + end - begin))
            for name, variable in variables.items():
                values = _neighbours(result.values[name], rows[begin:end])
                if convert is None:
                    values = at_points(manifest, name, values, source, points[begin:end])
                else:
                    values = convert(name, values, points[begin:end])
                with NETCDF:
                    variable[region] = values
    if chosen.damaged:
        raise DamagedError(chosen.damaged[0])


def _neighbours(values: NDArray[Any], rows: NDArray[np.intp]) -> NDArray[Any]:
    """Rows of an array, without a copy where they are neighbours."""
    first, last = int(rows[0]), int(rows[-1])
    if last - first + 1 == len(rows) and np.all(np.diff(rows) == 1):
        return values[first : last + 1]
    return values[rows]


def dataset(manifest: Manifest, found: Gathered, states: bool = True) -> xr.Dataset:
    """What was gathered, with the attributes CF asks for; with or without `status` and `error`."""
    grid = manifest.grid
    coords: dict[str, Any] = {
        name: ((grid.dim_of(name),), axis.values, attributes(axis, name)) for name, axis in grid.axes.items()
    }
    coords |= {name: ((name,), axis.values, attributes(axis, name)) for name, axis in manifest.coords.items()}

    def shaped(array: NDArray[Any]) -> NDArray[Any]:
        return array.reshape(*grid.shape, *array.shape[1:])

    data: dict[str, Any] = {}
    for name, values in found.values.items():
        if name in manifest.variables:
            described = manifest.variables[name]
            data[name] = _variable(name, described, (*grid.dims, *described.dims), shaped(values))
    if states:
        error = np.full(grid.size, "", dtype=object)
        for point, text in found.errors.items():
            error[point] = fitting(manifest, text)
        data["status"] = (grid.dims, shaped(found.status), attributes(STATUS, "status"))
        data["error"] = (grid.dims, shaped(error), ERROR_ATTRIBUTES)
    if "wall_time" in found.values:
        data["wall_time"] = (grid.dims, shaped(found.values["wall_time"]), attributes(WALL_TIME, "wall_time"))
    data |= failure_table(manifest, found)
    return xr.Dataset(data, coords)


def fitting(manifest: Manifest, text: str) -> str:
    """An error text cut to what a file has room for: every point has room for the longest."""
    letters = max(LEAST_LETTERS, LETTERS // manifest.grid.size)
    return text if len(text) <= letters else f"{text[: letters - 3]}..."


def failure_table(manifest: Manifest, found: Gathered) -> dict[str, Any]:
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
    for name, values in manifest.grid.points(np.array(slots)).items():
        named = {"long_name": f"{name} of the point that failed"}
        data[f"failure_{name}"] = (("failure",), values, attributes(manifest.grid.axes[name], name) | named)
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


def attributes(described: Axis | Variable, name: str) -> dict[str, Any]:
    """Units, long name (what has none is called by its `name`), digits and flags of an axis or a variable."""
    found: dict[str, Any] = {"units": described.units, "long_name": described.long_name or name}
    if isinstance(described, Axis):
        if described.values.dtype.kind == "U":
            # A text has no units.
            del found["units"]
    elif described.digits is not None:
        found["comment"] = f"kept to {described.digits} significant digits"
    elif described.flags is not None:
        del found["units"]
        found["flag_values"] = np.array(list(described.flags), dtype=described.dtype)
        found["flag_meanings"] = " ".join(word.replace(" ", "_") for word in described.flags.values())
    return {name: value for name, value in found.items() if not (isinstance(value, str) and not value)}
