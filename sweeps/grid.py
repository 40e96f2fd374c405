"""What is varied and what comes out: axes, their grid, and the variables of a result."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Points = dict[str, NDArray[Any]]
# One array a column, one entry a row.
Columns = list[NDArray[Any]]

# What has become of a point.
PENDING, DONE, FAILED, SKIPPED, INTERPOLATED = range(5)
STATUS_FLAGS = {PENDING: "pending", DONE: "done", FAILED: "failed", SKIPPED: "skipped"}
# Points of a refined sweep only.
INTERPOLATED_FLAG = {INTERPOLATED: "interpolated"}

DTYPES = ("float64", "float32", "int8", "int16", "int32", "int64")
# What a sweep's file holds besides axes and results; names that begin with `failure_` are its own as well.
RESERVED = ("status", "error", "wall_time", "traceback", "reproduce", "failure", "point", "computed")


@dataclass(frozen=True, eq=False)
class Axis:
    """The values one name takes.

    Parameters
    ----------
    values : array_like, (n,)
        Numbers or texts; at least one, all finite.
    units : str
        As UDUNITS reads them; "1" for a pure number.
    long_name : str
        What a reader of the file or a figure sees.
    """

    values: Any
    units: str = "1"
    long_name: str = ""

    def __post_init__(self) -> None:
        values = np.atleast_1d(np.asarray(self.values))
        if values.ndim != 1 or values.size == 0:
            raise ValueError(f"Axis: values of shape {values.shape}: they must be a list with one or more")
        if values.dtype.kind not in "biufU":
            raise ValueError(f"Axis: values = {self.values!r}: they must be numbers or texts")
        if values.dtype.kind == "f" and values.dtype.itemsize not in (4, 8):
            values = values.astype(float)  # what netCDF can hold
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            raise ValueError(f"Axis: values contain {values[~np.isfinite(values)][0]}: all must be finite")
        values = values.copy()
        values.setflags(write=False)
        object.__setattr__(self, "values", values)

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True)
class Variable:
    """One result of the function.

    Parameters
    ----------
    units, long_name : str
    dims : tuple of str
        Dimensions beyond the point's own; their coordinates are the sweep's `coords`.
    dtype : str
        One of DTYPES; missing entries are NaN. In the file a missing whole number is the least of its type,
        which a result therefore may not be.
    digits : int, optional
        Significant decimal digits kept of a float; what lies beyond is rounded away, so that it can be
        compressed. Default: all.
    scale : str
        The factor of the sweep's `scale` by which a copy's value is multiplied; "" for none.
    flags : mapping of int to str, optional
        What each value of a whole number means; the file has them as CF flags, blanks replaced by underscores.
    """

    units: str = "1"
    long_name: str = ""
    dims: tuple[str, ...] = ()
    dtype: str = "float64"
    digits: int | None = None
    scale: str = ""
    flags: Mapping[int, str] | None = field(default=None, hash=False)

    def __post_init__(self) -> None:
        if self.dtype not in DTYPES:
            raise ValueError(f"Variable: dtype = {self.dtype!r}: it must be one of {', '.join(DTYPES)}")
        dims = (self.dims,) if isinstance(self.dims, str) else tuple(self.dims)
        if len(set(dims)) < len(dims):
            raise ValueError(f"Variable: dims = {dims}: each may stand once")
        object.__setattr__(self, "dims", dims)
        whole = np.dtype(self.dtype).kind != "f"
        if whole and (self.digits is not None or self.scale):
            raise ValueError(
                f"Variable: digits and scale are for floats; with dtype = {self.dtype!r} leave them out"
            )
        digits = self.digits
        if digits is not None and not (type(digits) is int and 1 <= digits <= 15):
            raise ValueError(f"Variable: digits = {digits!r}: it must be a whole number from 1 to 15")
        flags = self.flags
        if flags is not None and not (
            whole
            and flags
            and all(isinstance(code, (int, np.integer)) and code > self.missing for code in flags)
            and all(isinstance(word, str) and word for word in flags.values())
        ):
            raise ValueError(
                f"Variable: flags = {flags!r}: they must be texts by whole numbers, with a dtype of those"
            )

    @property
    def missing(self) -> float:
        """What stands where there is no result."""
        return math.nan if np.dtype(self.dtype).kind == "f" else int(np.iinfo(self.dtype).min)


@dataclass(frozen=True, eq=False)
class Grid:
    """The product of axes; those zipped vary together, along the dimension of the first of them.

    Parameters
    ----------
    axes : mapping of str to Axis
        The order is the order of the dimensions.
    zipped : sequence of str, or of sequences of str
        One group of axes of equal length, or several groups.
    skip : callable, optional
        `skip(points)` tells, as a boolean array, which points need not be computed.
    """

    axes: Mapping[str, Axis]
    zipped: Sequence[Any] = ()
    skip: Callable[[Points], Any] | None = None
    _groups: tuple[tuple[str, ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        axes = dict(self.axes)
        if not axes:
            raise ValueError("Grid: axes = {}: there must be at least one axis")
        check_names("Grid: axes", axes, Axis)
        object.__setattr__(self, "axes", axes)
        zipped = [self.zipped] if self.zipped and isinstance(self.zipped[0], str) else list(self.zipped)
        groups: list[tuple[str, ...]] = []
        taken: set[str] = set()
        for group in zipped:
            for name in group:
                if name not in axes or name in taken:
                    raise ValueError(
                        f"Grid: zipped names {name!r}: it must be one of {', '.join(axes)}, and in one group"
                    )
                taken.add(name)
            lengths = {name: len(axes[name]) for name in group}
            if len(set(lengths.values())) > 1:
                raise ValueError(f"Grid: zipped axes differ in length: {lengths}; they must be equal")
        for name in axes:
            together = next((tuple(g) for g in zipped if name in g), (name,))
            if together not in groups:
                groups.append(together)
        for group in groups:
            first = Index([axes[name].values for name in group]).first()
            again = np.flatnonzero(first != np.arange(len(first)))
            if len(again):
                twice = next(iter(self.rows(group, slice(again[0], again[0] + 1))))
                raise ValueError(f"Grid: {', '.join(group)} takes the value {twice} twice; once is enough")
        object.__setattr__(self, "_groups", tuple(groups))

    @property
    def dims(self) -> tuple[str, ...]:
        """One dimension a group, named after its first axis."""
        return tuple(group[0] for group in self._groups)

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each dimension."""
        return tuple(len(self.axes[name]) for name in self.dims)

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    def dim_of(self, name: str) -> str:
        """The dimension along which the axis `name` runs."""
        return next(group[0] for group in self._groups if name in group)

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """The axes that vary together, one group a dimension."""
        return self._groups

    def points(self, index: NDArray[np.intp] | None = None) -> Points:
        """The points at `index`, one entry each; by default all, in C order of the dimensions."""
        chosen = np.arange(self.size) if index is None else index
        place = dict(zip(self.dims, np.unravel_index(chosen, self.shape), strict=True))
        return {name: axis.values[place[self.dim_of(name)]] for name, axis in self.axes.items()}

    def skipped(self, points: Points) -> NDArray[np.bool_]:
        """Which of `points` need not be computed."""
        count = len(next(iter(points.values())))
        if self.skip is None:
            return np.zeros(count, dtype=bool)
        flags = np.asarray(self.skip(points), dtype=bool)
        if flags.shape != (count,):
            raise ValueError(f"Grid: skip returned the shape {flags.shape}; it must be ({count},)")
        return flags

    def rows(self, group: tuple[str, ...], part: slice = slice(None)) -> list[tuple[Any, ...]]:
        """The values along one dimension, as plain tuples."""
        return list(zip(*(self.axes[name].values[part].tolist() for name in group), strict=True))

    def grown(self, other: Grid) -> Grid:
        """The grid with the values of `other`, one of the same axes, added to it.

        Where both are sorted the sum is; otherwise what is new comes last.
        """
        axes = dict(self.axes)
        for group, place in zip(self._groups, self.embed(other).places, strict=True):
            if place is None or np.all(place >= 0):
                continue
            every = [
                np.concatenate([axes[name].values, other.axes[name].values[place < 0]], dtype=kind)
                for name, kind in ((name, _common(axes[name], other.axes[name])) for name in group)
            ]
            for step in (1, -1):
                if all(_ascending([grid.axes[name].values[::step] for name in group]) for grid in (self, other)):
                    order = np.lexsort(every[::-1])[::step]
                    every = [values[order] for values in every]
                    break
            for name, values in zip(group, every, strict=True):
                axes[name] = Axis(values, axes[name].units, axes[name].long_name)
        zipped = [group for group in self._groups if len(group) > 1]
        return Grid(axes, zipped, self.skip)

    def embed(self, other: Grid) -> Embedding:
        """Where the points of `other`, a grid of the same axes, lie in this one."""
        places: list[NDArray[np.intp] | None] = []
        for group, index in zip(self._groups, self._indices, strict=True):
            own, asked = ([grid.axes[name].values for name in group] for grid in (self, other))
            same = all(map(np.array_equal, own, asked))
            places.append(None if same else index.find(asked))
        return Embedding(other.shape, self.shape, tuple(places))

    def at(self, values: Columns) -> NDArray[np.intp]:
        """The point with each row of the axes' values; -1 where there is none."""
        names = list(self.axes)
        along = [
            index.find([values[names.index(name)] for name in group])
            for index, group in zip(self._indices, self._groups, strict=True)
        ]
        return _flat(along, self.shape)

    @cached_property
    def _indices(self) -> list[Index]:
        """What finds values along each dimension."""
        return [Index([self.axes[name].values for name in group]) for group in self._groups]


@dataclass(frozen=True, eq=False)
class Embedding:
    """Where the points of one grid lie in another, by value.

    Attributes
    ----------
    inner, outer : tuple of int
        Shapes of the two.
    places : tuple
        Along each dimension where the values of the inner grid stand in the outer one, -1 where they do not; None
        where both have the same values.
    """

    inner: tuple[int, ...]
    outer: tuple[int, ...]
    places: tuple[NDArray[np.intp] | None, ...]

    @property
    def whole(self) -> bool:
        """Whether the two are one grid."""
        return all(place is None for place in self.places)

    def __call__(self, points: NDArray[np.intp]) -> NDArray[np.intp]:
        """The outer grid's point of each of the inner one's; -1 where there is none."""
        if self.whole:
            return points
        index = np.unravel_index(points, self.inner)
        along = [k if place is None else place[k] for k, place in zip(index, self.places, strict=True)]
        return _flat(along, self.outer)

    def along(self, dim: int) -> NDArray[np.intp] | slice:
        """What selects the inner grid along a dimension of the outer one that holds all of it."""
        place = self.places[dim]
        return slice(None) if place is None else place


class Index:
    """Rows that can be looked up by value.

    Attributes
    ----------
    code : ndarray of int64
        A number for each row; equal rows have the same.
    """

    def __init__(self, columns: Columns) -> None:
        self._stages: list[tuple[NDArray[Any], NDArray[np.int64] | None]] = []
        self.code, kinds = np.zeros(len(columns[0]), dtype=np.int64), 1
        for column in columns:
            if _ascending([column]):
                values, place = column, np.arange(len(column))
            else:
                values, place = np.unique(column, return_inverse=True)
            packed = None
            if kinds * len(values) >= 2**62:
                packed, code = np.unique(self.code, return_inverse=True)
                self.code, kinds = code.ravel().astype(np.int64), len(packed)
            self.code = self.code * len(values) + place.ravel()
            kinds *= max(len(values), 1)
            self._stages.append((values, packed))
        self._order = None if _ascending([self.code]) else np.argsort(self.code, kind="stable")
        self._sorted = self.code if self._order is None else self.code[self._order]

    def first(self) -> NDArray[np.intp]:
        """For each row the first that equals it."""
        if self._order is None:
            return np.arange(len(self.code))
        begins = np.concatenate([[True], self._sorted[1:] != self._sorted[:-1]])
        found = np.empty(len(self.code), dtype=np.intp)
        # The sort is stable: of equal rows the first comes first.
        found[self._order] = self._order[np.flatnonzero(begins)][np.cumsum(begins) - 1]
        return found

    def find(self, columns: Columns) -> NDArray[np.intp]:
        """For each row of other columns the first of these that equals it; -1 where none does."""
        count = len(columns[0])
        if not len(self.code):
            return np.full(count, -1, dtype=np.intp)
        present, code = np.ones(count, dtype=bool), np.zeros(count, dtype=np.int64)
        for column, (values, packed) in zip(columns, self._stages, strict=True):
            if packed is not None:
                code, found = _search(packed, code)
                present &= found
            place, found = _search(values, column)
            code, present = code * len(values) + place, present & found
        place, found = _search(self._sorted, code)
        return np.where(present & found, place if self._order is None else self._order[place], -1)


def _search(values: NDArray[Any], requested: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Where in the sorted `values` each of the requested stands, and whether it does."""
    place = np.minimum(np.searchsorted(values, requested), len(values) - 1)
    return place, np.asarray(values[place] == requested)


def _ascending(columns: Columns) -> bool:
    """Whether the rows are sorted and no two are equal."""
    if len(columns) == 1:
        return bool(np.all(columns[0][1:] > columns[0][:-1]))
    rows = list(zip(*(column.tolist() for column in columns), strict=True))
    return all(before < after for before, after in pairwise(rows))


def _flat(along: Sequence[NDArray[np.intp]], shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Points by their places along each dimension; -1 where one of these is."""
    inside = np.logical_and.reduce([place >= 0 for place in along])
    flat = np.ravel_multi_index([np.maximum(place, 0) for place in along], shape)
    return np.where(inside, flat, -1)


def _common(one: Axis, other: Axis) -> np.dtype[Any]:
    """A type that holds the values of both; texts grow as long as they must."""
    return np.promote_types(one.values.dtype, other.values.dtype)


def check_names(what: str, named: Mapping[str, Any], kind: type) -> None:
    """Raise unless every name can stand in a file and every value is a `kind`."""
    for name, value in named.items():
        usable = isinstance(name, str) and name.isidentifier() and not name.startswith("failure_")
        if not usable or name in RESERVED:
            raise ValueError(
                f"{what} has the name {name!r}: it must be of letters, digits and _, and none of "
                f"{', '.join(RESERVED)}, failure_..."
            )
        if not isinstance(value, kind):
            raise ValueError(f"{what}[{name!r}] = {value!r}: it must be of type {kind.__name__}")
