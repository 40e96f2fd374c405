"""What is varied and what comes out: axes, their grid, and the variables of a result."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Points = dict[str, NDArray[Any]]

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
    """

    units: str = "1"
    long_name: str = ""
    dims: tuple[str, ...] = ()
    dtype: str = "float64"
    digits: int | None = None
    scale: str = ""

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
            rows = self.rows(group)
            if len(set(rows)) < len(rows):
                twice = next(row for row in rows if rows.count(row) > 1)
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
        for group in self._groups:
            own, new = self.rows(group), other.rows(group)
            present = set(own)
            rows = own + [row for row in new if row not in present]
            if len(rows) == len(own):
                continue
            for backwards in (False, True):
                if all(each == sorted(each, reverse=backwards) for each in (own, new)):
                    rows.sort(reverse=backwards)
                    break
            for name, values in zip(group, zip(*rows, strict=True), strict=True):
                axis = self.axes[name]
                axes[name] = Axis(
                    np.array(values, dtype=_common(axis, other.axes[name])), axis.units, axis.long_name
                )
        zipped = [group for group in self._groups if len(group) > 1]
        return Grid(axes, zipped, self.skip)

    @cached_property
    def _places(self) -> list[dict[tuple[Any, ...], int]]:
        """Where the values along each dimension stand."""
        return [{row: n for n, row in enumerate(self.rows(group))} for group in self._groups]

    def place(self, other: Grid, block: tuple[slice, ...] = ()) -> NDArray[np.intp]:
        """Where each point of `other`, or of a block of it, lies in this grid, by value; -1 where it does not."""
        flat, inside = np.zeros((), dtype=np.intp), np.ones((), dtype=bool)
        parts = [*block, *[slice(None)] * (len(self._groups) - len(block))]
        for group, part, known in zip(self._groups, parts, self._places, strict=True):
            along = np.array([known.get(row, -1) for row in other.rows(group, part)], dtype=np.intp)
            flat = flat[..., None] * len(known) + along
            inside = inside[..., None] & (along >= 0)
        return np.where(inside, flat, -1).ravel()


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
