"""What is varied and what comes out: axes, their grid, and the variables of a result."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.errors import InputError

Points = dict[str, NDArray[Any]]
# One array a column, one entry a row.
Columns = list[NDArray[Any]]
# Points that are made at a time, where they are only looked at.
BLOCK = 1 << 18
# A plan has a few flags of each point, all of them in memory.
MOST_POINTS = 200_000_000

# What has become of a point.
PENDING, DONE, FAILED, SKIPPED, INTERPOLATED = range(5)
STATUS_FLAGS = {PENDING: "pending", DONE: "done", FAILED: "failed", SKIPPED: "skipped"}
# Points of a refined sweep only.
INTERPOLATED_FLAG = {INTERPOLATED: "interpolated"}

DTYPES = ("float64", "float32", "int8", "int16", "int32", "int64")
# What a sweep's file holds besides axes and results; names that begin with `failure_` are its own as well.
OF_POINTS = ("status", "error", "wall_time", "computed_by")
RESERVED = (*OF_POINTS, "traceback", "reproduce", "failure", "point", "computed")


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
            raise InputError(f"Axis: values of shape {values.shape}: they must be a list with one or more")
        if values.dtype.kind not in "biufU":
            raise InputError(f"Axis: values = {self.values!r}: they must be numbers or texts")
        if values.dtype.kind == "f" and values.dtype.itemsize not in (4, 8):
            values = values.astype(float)  # what netCDF can hold
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            raise InputError(f"Axis: values contain {values[~np.isfinite(values)][0]}: all must be finite")
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
            raise InputError(f"Variable: dtype = {self.dtype!r}: it must be one of {', '.join(DTYPES)}")
        dims = (self.dims,) if isinstance(self.dims, str) else tuple(self.dims)
        if len(set(dims)) < len(dims):
            raise InputError(f"Variable: dims = {dims}: each may stand once")
        object.__setattr__(self, "dims", dims)
        whole = np.dtype(self.dtype).kind != "f"
        if whole and (self.digits is not None or self.scale):
            raise InputError(
                f"Variable: digits and scale are for floats; with dtype = {self.dtype!r} leave them out"
            )
        digits = self.digits
        if digits is not None and not (type(digits) is int and 1 <= digits <= 15):
            raise InputError(f"Variable: digits = {digits!r}: it must be a whole number from 1 to 15")
        flags = self.flags
        if flags is not None and not (
            whole
            and flags
            and all(isinstance(code, (int, np.integer)) and code > self.missing for code in flags)
            and all(isinstance(word, str) and word for word in flags.values())
        ):
            raise InputError(
                f"Variable: flags = {flags!r}: they must be texts by whole numbers, with a dtype of those"
            )
        if flags is not None:
            object.__setattr__(self, "flags", {int(code): word for code, word in flags.items()})

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
    drawn : mapping
        How the values along the first dimension came about where they were not chosen (`sweeps.Sample`), as JSON
        holds it: results of one grid do not go with those of another.

    Attributes
    ----------
    groups : tuple of tuple of str
        The axes that vary together, one group a dimension.
    """

    axes: Mapping[str, Axis]
    zipped: Sequence[Any] = ()
    skip: Callable[[Points], Any] | None = None
    drawn: Mapping[str, Any] = field(default_factory=dict)
    groups: tuple[tuple[str, ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        axes = dict(self.axes)
        if not axes:
            raise InputError("Grid: axes = {}: there must be at least one axis")
        check_names("Grid: axes", axes, Axis)
        zipped = [self.zipped] if self.zipped and isinstance(self.zipped[0], str) else self.zipped
        named = [name for group in zipped for name in group]
        for name in named:
            if name not in axes or named.count(name) > 1:
                raise InputError(
                    f"Grid: zipped names {name!r}: it must be one of {', '.join(axes)}, and in one group"
                )
        group_of = {name: (name,) for name in axes}
        for group in map(tuple, zipped):
            lengths = {name: len(axes[name]) for name in group}
            if len(set(lengths.values())) > 1:
                raise InputError(f"Grid: zipped axes differ in length: {lengths}; they must be equal")
            group_of |= dict.fromkeys(group, group)
        object.__setattr__(self, "axes", axes)
        object.__setattr__(self, "groups", tuple(dict.fromkeys(group_of.values())))
        for group in self.groups:
            first = first_equal(self._columns(group))
            again = np.flatnonzero(first < np.arange(len(first)))
            if len(again):
                twice = tuple(column[again[0]].item() for column in self._columns(group))
                raise InputError(f"Grid: {', '.join(group)} takes the value {twice} twice; once is enough")

    @property
    def dims(self) -> tuple[str, ...]:
        """One dimension a group, named after its first axis."""
        return tuple(group[0] for group in self.groups)

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
        return next(group[0] for group in self.groups if name in group)

    def blocks(self) -> Iterator[NDArray[np.intp]]:
        """The numbers of all points, some at a time."""
        for begin in range(0, self.size, BLOCK):
            yield np.arange(begin, min(begin + BLOCK, self.size))

    def points(self, index: NDArray[np.intp] | None = None) -> Points:
        """The points at `index`, one entry each; by default all, in C order of the dimensions."""
        chosen = np.arange(self.size) if index is None else index
        places = dict(zip(self.dims, np.unravel_index(chosen, self.shape), strict=True))
        return {name: axis.values[places[self.dim_of(name)]] for name, axis in self.axes.items()}

    def at(self, values: Columns) -> NDArray[np.intp]:
        """The point with each row of the axes' values; -1 where there is none."""
        points = dict(zip(self.axes, values, strict=True))
        along = [_find(self._columns(group), [points[name] for name in group]) for group in self.groups]
        return _flat(along, self.shape)

    def live(self) -> NDArray[np.bool_]:
        """Whether each point is one that `skip` does not leave out."""
        live = np.ones(self.size, dtype=bool)
        if self.skip is not None:
            for index in self.blocks():
                flags = np.asarray(self.skip(self.points(index)), dtype=bool)
                if flags.shape != index.shape:
                    raise InputError(f"Grid: skip returned the shape {flags.shape}; it must be {index.shape}")
                live[index] = ~flags
        return live

    def embed(self, other: Grid) -> Embedding:
        """Where the points of `other`, a grid of the same axes, lie in this one."""
        places: list[NDArray[np.intp] | slice] = []
        for group in self.groups:
            own, asked = self._columns(group), other._columns(group)
            places.append(slice(None) if all(map(np.array_equal, own, asked)) else _find(own, asked))
        return Embedding(other.shape, self.shape, tuple(places))

    def grown(self, other: Grid) -> Grid:
        """The values of this grid and of `other`, one of the same axes, with all else that `other` says of them.

        Where both are sorted the sum is; otherwise what is new comes last.
        """
        if self.embed(other).identical:
            return other
        axes = dict(other.axes)
        for group in self.groups:
            own, asked = self._columns(group), other._columns(group)
            new = _find(own, asked) < 0
            every = [np.concatenate([column, more[new]]) for column, more in zip(own, asked, strict=True)]
            step = next((step for step in (1, -1) if _sorted(own, step) and _sorted(asked, step)), None)
            if step is not None:
                order = np.lexsort(every[::-1])[::step]
                every = [values[order] for values in every]
            for name, values in zip(group, every, strict=True):
                # A file has no flags, and may have whole numbers.
                same = values.astype(axes[name].values.dtype)
                axes[name] = replace(axes[name], values=same if np.array_equal(same, values) else values)
        return replace(other, axes=axes)

    def _columns(self, group: Sequence[str]) -> Columns:
        return [self.axes[name].values for name in group]


@dataclass(frozen=True, eq=False)
class Embedding:
    """Where the points of one grid lie in another, by value.

    Attributes
    ----------
    inner, outer : tuple of int
        Shapes of the two.
    places : tuple of (ndarray of int or slice)
        Along each dimension where the values of the inner grid stand in the outer one, -1 where they do not; a
        slice of all where both have the same values.
    """

    inner: tuple[int, ...]
    outer: tuple[int, ...]
    places: tuple[NDArray[np.intp] | slice, ...]

    @property
    def identical(self) -> bool:
        """Whether the two are one grid."""
        return all(isinstance(place, slice) for place in self.places)

    @property
    def index(self) -> tuple[NDArray[np.intp], ...]:
        """What picks the points of the inner grid from an array of the outer one's shape that holds all of it."""
        return np.ix_(*(np.arange(n)[place] for n, place in zip(self.outer, self.places, strict=True)))

    def __call__(self, points: NDArray[np.intp]) -> NDArray[np.intp]:
        """The outer grid's point of each of the inner one's; -1 where there is none."""
        if self.identical:
            return points
        index = np.unravel_index(points, self.inner)
        along = [k if isinstance(place, slice) else place[k] for k, place in zip(index, self.places, strict=True)]
        return _flat(along, self.outer)


def first_equal(columns: Columns) -> NDArray[np.intp]:
    """For each row the first that equals it."""
    # Equal rows stay in their order, so that the first of them is the first that differs from the one before.
    order = np.lexsort(columns)
    new = np.arange(len(order)) == 0
    for column in columns:
        ranked = column[order]
        new[1:] |= ranked[1:] != ranked[:-1]
    first = np.empty_like(order)
    first[order] = order[new][np.cumsum(new) - 1]
    return first


def _find(columns: Columns, requested: Columns) -> NDArray[np.intp]:
    """For each of the rows requested the first that equals it; -1 where none does."""
    count = len(columns[0])
    first = first_equal([np.concatenate(pair) for pair in zip(columns, requested, strict=True)])[count:]
    return np.where(first < count, first, -1)


def _sorted(columns: Columns, step: int) -> bool:
    """Whether rows, all different, ascend with a step of 1, or descend with one of -1."""
    return np.array_equal(np.lexsort(columns[::-1])[::step], np.arange(len(columns[0])))


def _flat(along: Sequence[NDArray[np.intp]], shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Points by their places along each dimension; -1 where one of these is."""
    flat = np.ravel_multi_index(along, shape, mode="clip")
    return np.where(np.logical_and.reduce([place >= 0 for place in along]), flat, -1)


def check_counts(counts: Mapping[str, int]) -> None:
    """Refuse a grid by the lengths of its dimensions, before anything is allocated for its points.

    Raises
    ------
    InputError
        If there are too many.
    """
    if (size := math.prod(counts.values())) > MOST_POINTS:
        shape = " x ".join(f"{name} {count}" for name, count in counts.items())
        raise InputError(
            f"grid = {shape}: {size:.3g} points are more than the {MOST_POINTS:.3g} that one plan can hold; "
            "take fewer values, or run parts of them into folders of their own"
        )


def check_names(what: str, named: Mapping[str, Any], kind: type) -> None:
    """Raise unless every name can stand in a file and every value is a `kind`."""
    for name, value in named.items():
        usable = isinstance(name, str) and name.isidentifier() and not name.startswith("failure_")
        if not usable or name in RESERVED:
            raise InputError(
                f"{what} has the name {name!r}: it must be of letters, digits and _, and none of "
                f"{', '.join(RESERVED)}, failure_..."
            )
        if not isinstance(value, kind):
            raise InputError(f"{what}[{name!r}] = {value!r}: it must be of type {kind.__name__}")
