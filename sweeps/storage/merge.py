"""From sources to a dataset: every point gets the result of its computation, times its own factors."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sweeps.compute.batch import BatchResult, Failure
from sweeps.grid import DONE, FAILED, PENDING, SKIPPED, Axis, Grid, Variable
from sweeps.storage.manifest import Manifest
from sweeps.storage.sources import NETCDF, DamagedError, PartSource, Source, runs

# Letters of all error texts together, and of each at least.
LETTERS, LEAST_LETTERS = 30_000_000, 60
# Environment of a point that was not computed.
NOWHERE = np.int16(-1)
# Of so many failures, tracebacks and reproducing lines are kept.
MOST_TRACEBACKS = 1000

Indices = NDArray[np.intp]


class Choice:
    """Which source gives each point: where several know one, the last that did it. No value is read for that.

    Attributes
    ----------
    status : ndarray of int8, (points,)
    seconds, computations : float, int
        Computing time of all that is at hand, and of how many computations it is.
    damaged : list of str
        Parts that cannot be used.
    environments : list of dict
        In which points were computed.
    """

    def __init__(self, manifest: Manifest) -> None:
        self.manifest = manifest
        self.status = np.full(manifest.grid.size, PENDING, dtype=np.int8)
        if manifest.representative is not None:
            self.status[manifest.representative < 0] = SKIPPED
        self.seconds, self.computations, self.damaged = 0.0, 0, list[str]()
        self.environments = list[dict[str, str]]()
        # Of each point, as soon as there is more than one.
        self._by: NDArray[np.int16] | None = None

    def take(self, source: Source) -> tuple[Indices, Indices, NDArray[np.bool_]]:
        """Points for which a source is better than those before, their rows, and which it computed as these.

        Raises
        ------
        DamagedError, StoreError
            If it is damaged.
        """
        held = source.held(self.manifest)
        self.seconds += held.seconds
        self.computations += int(np.count_nonzero(held.computed))
        before = self.status[held.points]
        # Neither what failed nor what is known of a copy replaces what was done.
        better = (before == PENDING) | (before == FAILED) | (held.computed & ~held.failed)
        points = held.points[better]
        self._mark(points, held.by[better], held.environments)
        self.status[points] = np.where(held.failed[better], np.int8(FAILED), np.int8(DONE))
        return points, held.rows[better], held.computed[better]

    def _mark(self, points: Indices, by: NDArray[np.int16], environments: Sequence[dict[str, str]]) -> None:
        """Enter in which of a source's environments points were computed."""
        codes = np.unique(by).tolist() if len(environments) > 1 else [0] * min(len(by), 1)
        self.environments += [environments[code] for code in codes if environments[code] not in self.environments]
        if self._by is None and len(self.environments) > 1:
            self._by = np.where((self.status == DONE) | (self.status == FAILED), np.int16(0), NOWHERE)
        if self._by is not None and codes:
            numbers = np.full(len(environments), NOWHERE)
            numbers[codes] = [self.environments.index(environments[code]) for code in codes]
            self._by[points] = numbers[by]

    def made(self) -> tuple[list[dict[str, str]], NDArray[np.int16] | None]:
        """The environments of what is there in the end, and where there are several the number of each point's."""
        if self._by is None:
            return self.environments, None
        codes = [code for code in range(len(self.environments)) if (self._by == code).any()]
        # NOWHERE finds the last.
        numbers = np.full(len(self.environments) + 1, NOWHERE)
        numbers[codes] = range(len(codes))
        return [self.environments[code] for code in codes], numbers[self._by] if len(codes) > 1 else None


def surveyed(manifest: Manifest, sources: Sequence[Source]) -> Choice:
    """The choice among sources of which no value is read; damaged parts are named and left out."""
    choice = Choice(manifest)
    for source in sources:
        try:
            choice.take(source)
        except DamagedError as problem:
            choice.damaged.append(problem.part)
    return choice


@dataclass(eq=False)
class Gathered:
    """Results in memory, one entry a point.

    Attributes
    ----------
    values : dict of str to ndarray
        Of the variables asked for; `wall_time` may be one. Or variables of a file instead, that were filled.
    status : ndarray of int8
    errors : dict of int to str
        Of the points that failed, cut to what a file has room for.
    failures : dict of int to Failure
        Of the computations that failed, by the point that is now computed for all of their copies.
    environments : list of dict
        In which the points were computed; where there are several, `by` has the number of each point's.
    """

    values: dict[str, Any]
    status: NDArray[np.int8]
    errors: dict[int, str] = field(default_factory=dict)
    failures: dict[int, Failure] = field(default_factory=dict)
    environments: Sequence[dict[str, str]] = ()
    by: NDArray[np.int16] | None = None


def gather(
    manifest: Manifest, sources: Sequence[Source], names: Collection[str], reasons: bool = True
) -> Gathered:
    """Read some variables of all points into memory, with or without why points failed; see `fill`."""
    values = {}
    for name in names:
        described, shape = manifest.described(name), (manifest.grid.size, *manifest.shape(name))
        values[name] = np.full(shape, described.missing, described.dtype)
    return fill(manifest, sources, values, reasons=reasons)


def fill(
    manifest: Manifest,
    sources: Sequence[Source],
    targets: dict[str, Any],
    slots: Indices | None = None,
    reasons: bool = False,
) -> Gathered:
    """Fill arrays or variables of an open netCDF file, a source at a time.

    Parameters
    ----------
    manifest : Manifest
    sources : sequence of Source
    targets : dict of str to (ndarray or netCDF4.Variable)
        An array has one row a point, a variable of a file the grid's dimensions first. Where there are `slots`,
        these are the rows of both.
    slots : ndarray of int, optional
        Ascending points, all that have a result.
    reasons : bool
        Whether to read why points failed.

    Raises
    ------
    DamagedError, StoreError
        If a source is damaged.
    """
    shape = manifest.grid.shape if slots is None else (len(slots),)
    choice = Choice(manifest)
    found = Gathered(targets, choice.status)
    for source, read in _read_ahead(sources, [name for name in targets if name != "wall_time"], reasons):
        points, rows, computed = choice.take(source)
        if not len(points):
            continue
        result = read()
        places = points if slots is None else np.searchsorted(slots, points)
        for name, target in targets.items():
            if name == "wall_time":
                # A copy costs nothing.
                target[places] = np.where(computed, result.wall_time[rows], 0.0)
            elif isinstance(target, np.ndarray):
                target[places] = manifest.at_points(name, result.values[name][rows], points)
            else:
                order = np.argsort(places, kind="stable")
                for begin, end in runs(places[order], shape[-1]):
                    run = order[begin:end]
                    *outer, last = np.unravel_index(places[run[0]], shape)
                    values = manifest.at_points(name, result.values[name][rows[run]], points[run])
                    with NETCDF:
                        target[(*outer, slice(last, last + end - begin))] = values
        if reasons and (result.failures or found.errors):
            _take_reasons(manifest, found, result.failures, points, rows)
    found.environments, found.by = choice.made()
    return found


def _read_ahead(
    sources: Sequence[Source], names: list[str], reasons: bool
) -> Iterator[tuple[Source, Callable[[], BatchResult]]]:
    """Each source with what reads it; while one is used, a thread inflates the next part."""
    ahead: Callable[[], BatchResult] | None = None
    with ThreadPoolExecutor(1) as reader:
        for source, after in zip_longest(sources, sources[1:]):
            read = ahead or partial(source.read, names, reasons)
            # Of parts only: whoever is using these may hold the lock that files need.
            ahead = reader.submit(after.read, names, reasons).result if isinstance(after, PartSource) else None
            yield source, read


def _take_reasons(
    manifest: Manifest, found: Gathered, failures: Mapping[int, Failure], points: Indices, rows: Indices
) -> None:
    """Enter why points failed, and forget it of those that now have a result."""
    for point in [point for point in found.errors if found.status[point] != FAILED]:
        del found.errors[point]
        found.failures.pop(point, None)
    at = np.flatnonzero(np.isin(rows, list(failures)))
    slots = manifest.representatives(points[at])
    for point, slot, row in zip(points[at].tolist(), slots.tolist(), rows[at].tolist(), strict=True):
        found.errors[point] = _fitting(manifest, failures[row].error)
        if failures[row].reproduce:
            found.failures[slot] = failures[row]
    if len(found.failures) > 2 * MOST_TRACEBACKS:
        found.failures = {slot: found.failures[slot] for slot in sorted(found.failures)[:MOST_TRACEBACKS]}


def _fitting(manifest: Manifest, text: str) -> str:
    """An error text cut to what a file has room for: every point has room for the longest."""
    letters = max(LEAST_LETTERS, LETTERS // manifest.grid.size)
    return text if len(text) <= letters else f"{text[: letters - 3]}..."


def dataset(manifest: Manifest, found: Gathered) -> xr.Dataset:
    """What was gathered, with the attributes CF asks for, and of each point its status and why it failed."""
    grid = manifest.grid
    axes = [((grid.dim_of(name),), name, axis) for name, axis in grid.axes.items()]
    axes += [((name,), name, axis) for name, axis in manifest.coords.items()]
    arrays = {name: found.values[name] for name in manifest.variables} | {"status": found.status}
    if "error" in found.values:
        arrays["error"] = found.values["error"]
    else:
        arrays["error"] = np.full(grid.size, "", dtype=object)
        arrays["error"][list(found.errors)] = list(found.errors.values())
    arrays["wall_time"] = found.values["wall_time"]
    if found.by is not None:
        arrays["computed_by"] = found.by
    data: dict[str, Any] = {}
    for name, values in arrays.items():
        described, encoding = manifest.described(name), {}
        if values.dtype.kind == "i" and name not in ("status", "computed_by"):
            # As it will look when it is read again: a missing whole number is NaN, in single precision where that
            # holds every value of the type.
            encoding = {"dtype": described.dtype, "_FillValue": values.dtype.type(described.missing)}
            kind = np.float32 if values.dtype.itemsize <= 2 else np.float64
            values = np.where(values == described.missing, kind(np.nan), values.astype(kind))
        shaped = values.reshape(*grid.shape, *values.shape[1:])
        data[name] = ((*grid.dims, *described.dims), shaped, attributes(described, name), encoding)
    if found.by is not None:
        data["computed_by"][2]["comment"] = "as the attribute environments lists them, from 0; -1: not computed"
    data |= _failure_table(grid, found)
    coords = {name: (dims, axis.values, attributes(axis, name)) for dims, name, axis in axes}
    return xr.Dataset(data, coords, {"environments": json.dumps(found.environments or [{}])})


def _failure_table(grid: Grid, found: Gathered) -> dict[str, Any]:
    """The computations that failed: where, why, and the line of Python that shows it again."""
    slots = sorted(found.failures)[:MOST_TRACEBACKS]
    if not slots:
        return {}
    texts = np.array([found.failures[slot] for slot in slots], dtype=object)
    data: dict[str, Any] = {
        "traceback": ("failure", texts[:, 1], {"long_name": "where the computation failed"}),
        "reproduce": ("failure", texts[:, 2], {"long_name": "Python that computes the point again"}),
    }
    for name, values in grid.points(np.array(slots)).items():
        named = {"long_name": f"{name} of the point that failed"}
        data[f"failure_{name}"] = ("failure", values, attributes(grid.axes[name], name) | named)
    return data


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
