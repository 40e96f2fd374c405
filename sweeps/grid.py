"""The declaration of a sweep: axes, the grid of points that they span, variables, and all of these together."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from sweeps.errors import InputError

Points = dict[str, NDArray[Any]]
# One array for each column, one entry for each row.
Columns = list[NDArray[Any]]
# Points that are made at once where only their flags are needed.
BLOCK = 1 << 18
# A plan keeps a few bytes for each point in memory.
MOST_POINTS = 20_000_000
# Floating-point values of an axis are rounded to these significant digits.
DIGITS = 15

# Status of a point.
PENDING, DONE, FAILED, SKIPPED, INTERPOLATED = range(5)
STATUS_FLAGS = {PENDING: "pending", DONE: "done", FAILED: "failed", SKIPPED: "skipped"}
# Points of a refined sweep only.
INTERPOLATED_FLAG = {INTERPOLATED: "interpolated"}

DTYPES = ("float64", "float32", "int8", "int16", "int32", "int64", "bool", "str")
# Bytes of a text where sizes are estimated.
TEXT_BYTES = 32
# What a sweep's file contains besides axes and results; names that begin with `failure_` are reserved as well.
RESERVED = ("status", "error", "wall_time", "traceback", "reproduce", "failure", "point")


@dataclass(frozen=True, eq=False)
class Axis:
    """The values of one parameter.

    Parameters
    ----------
    values : array_like, (n,)
        Numbers or strings; at least one, all finite. Floats of any width become float64, rounded to 15 significant
        digits, so that 0.3 is the same point however it was computed. A narrower one is taken for the shortest
        decimal that denotes it: np.float32(0.1) is 0.1, not 0.10000000149.
    units, long_name : str
        As UDUNITS reads them, "1" for a pure number; description for the file and figures.
    """

    values: Any
    units: str = "1"
    long_name: str = ""

    def __post_init__(self) -> None:
        values = np.atleast_1d(np.asarray(self.values))
        if is_text(values):
            values = values.astype(str)
        if values.ndim != 1 or values.size == 0:
            raise InputError(f"Axis: values of shape {values.shape}: they must be a list with one or more")
        if values.dtype.kind not in "biufU":
            raise InputError(f"Axis: values = {self.values!r}: they must be numbers or strings")
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            raise InputError(f"Axis: values contain {values[~np.isfinite(values)][0]}: all must be finite")
        values = axis_values(values).copy()
        values.setflags(write=False)
        object.__setattr__(self, "values", values)

    def __len__(self) -> int:
        return len(self.values)


def axis_values(values: NDArray[Any]) -> NDArray[Any]:
    """Values in the form of an axis: floats of any width as the float64 of their decimals, others unchanged."""
    if values.dtype.kind != "f":
        return values
    if values.dtype.itemsize < 8:
        return values.astype("U32").astype(float)
    values = values.astype(float)
    shift = DIGITS - 1 - np.floor(np.log10(np.abs(values), where=values != 0.0, out=np.zeros(values.shape)))
    power = 10.0 ** np.clip(shift, 0.0, 22.0)  # these powers of ten are exact
    product = values * power
    found: NDArray[np.float64] = np.rint(product) / power
    # Products have a rounding error of their own, which matters near ties.
    unsure = (shift < 0.0) | (shift > 22.0) | (np.abs(product - np.rint(product)) > 0.4)
    found[unsure] = [float(f"{value:.{DIGITS}g}") for value in values[unsure]]
    return found


@dataclass(frozen=True)
class Variable:
    """One result of the function.

    Parameters
    ----------
    units, long_name : str
    dims : tuple of str
        Dimensions besides the grid's; their coordinates are the sweep's `coords`.
    dtype : str
        One of DTYPES; missing entries are NaN. Of integers a file marks missing ones by the least value of the
        type, and netCDF lost ones by the next, so that no result may be one of the two. Of texts, missing ones are
        "", and each takes the room of the longest. Whole numbers and truth values may become floats; texts must be
        declared. Of a complex number, return two floats.
    digits : int, optional
        Significant decimal digits of a float; further ones are rounded away, so that compression works.
    scale : str
        The factor of the sweep's `scale` by which the value is multiplied at each point; "" for none.
    flags : mapping of int to str, optional
        Meaning of each value of an integer; CF flags in the file, with underscores in place of blanks.
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
            raise InputError(f"Variable: dims = {dims}: no dimension may occur twice")
        object.__setattr__(self, "dims", dims)
        if not self.is_float and (self.digits is not None or self.scale):
            raise InputError(f"Variable: dtype = {self.dtype!r}: digits and scale are for floats; leave them out")
        if self.digits is not None and not (type(self.digits) is int and 1 <= self.digits <= 15):
            raise InputError(f"Variable: digits = {self.digits!r}: it must be an integer from 1 to 15")
        if (flags := self.flags) is not None:
            lowest = self.missing + 1 if np.dtype(self.dtype).kind == "i" else math.inf
            codes = all(isinstance(code, (int, np.integer)) and code > lowest for code in flags)
            if not (flags and codes and all(isinstance(word, str) and word for word in flags.values())):
                rule = "it must be a dict of int to str, with an integer dtype"
                raise InputError(f"Variable: flags = {flags!r}: {rule}")
            object.__setattr__(self, "flags", {int(code): word for code, word in flags.items()})

    @property
    def is_float(self) -> bool:
        """Whether the values are floats."""
        return np.dtype(self.dtype).kind == "f"

    @property
    def missing(self) -> Any:
        """The value for a missing result; for the types that a file can have."""
        if self.dtype == "str":
            return ""
        return math.nan if self.is_float else int(np.iinfo(self.dtype).min)

    @property
    def itemsize(self) -> int:
        """Bytes of a value; an estimate for a text."""
        return TEXT_BYTES if self.dtype == "str" else np.dtype(self.dtype).itemsize

    def absent(self, shape: tuple[int, ...]) -> NDArray[Any]:
        """An array of missing results; texts are objects, so that each may have any length."""
        return np.full(shape, self.missing, object if self.dtype == "str" else self.dtype)

    @property
    def stored(self) -> "Variable":
        """The variable by which a file represents this one, since netCDF has no bool."""
        return replace(self, dtype="int8", flags={0: "false", 1: "true"}) if self.dtype == "bool" else self


@dataclass(frozen=True, eq=False)
class Grid:
    """The product of axes; zipped axes vary together, along the dimension of the first of them.

    `groups` has the axes that vary together, one group for each dimension, which is named after the first of them;
    `dims`, `shape` and `size` are those of an array with an entry for each point.

    Parameters
    ----------
    axes : mapping of str to (Axis or array_like)
        In the order of the dimensions.
    zipped : sequence of str, or of sequences of str
        One group of axes of equal length, or several groups.
    skip : callable, optional
        `skip(points)` returns, as a boolean array, which points are not computed.
    sampling : mapping
        How the values along the first dimension were drawn, if they were (`sweeps.Sample`), as JSON represents it.
    """

    axes: Mapping[str, Any]
    zipped: Sequence[Any] = ()
    skip: Callable[[Points], Any] | None = None
    sampling: Mapping[str, Any] = field(default_factory=dict)
    groups: tuple[tuple[str, ...], ...] = field(init=False, repr=False)
    dims: tuple[str, ...] = field(init=False, repr=False)
    shape: tuple[int, ...] = field(init=False, repr=False)
    size: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        axes = {name: each if isinstance(each, Axis) else Axis(each) for name, each in self.axes.items()}
        if not axes:
            raise InputError("Grid: axes = {}: there must be at least one axis")
        check_names("Grid: axes", axes, Axis)
        zipped = [self.zipped] if self.zipped and isinstance(self.zipped[0], str) else self.zipped
        named = [name for group in zipped for name in group]
        for name in [each for each in named if each not in axes or named.count(each) > 1]:
            raise InputError(f"Grid: zipped names {name!r}: it must be one of {', '.join(axes)}, and in one group")
        group_of = {name: (name,) for name in axes} | {name: tuple(group) for group in zipped for name in group}
        groups = tuple(dict.fromkeys(group_of.values()))
        shape = tuple(len(axes[group[0]]) for group in groups)
        own = {"axes": axes, "groups": groups, "dims": tuple(group[0] for group in groups), "shape": shape}
        vars(self).update(own, size=math.prod(shape))  # it is frozen
        for group in groups:
            lengths = {name: len(axes[name]) for name in group}
            if len(set(lengths.values())) > 1:
                raise InputError(f"Grid: zipped axes differ in length: {lengths}; they must be equal")
            repeated = self._index(group).duplicated()
            if repeated.any():
                value = tuple(axes[name].values[np.argmax(repeated)].item() for name in group)
                raise InputError(f"Grid: {', '.join(group)} takes the value {value} twice; once is enough")

    @classmethod
    def of(cls, points: Any) -> "Grid":
        """A grid from a grid, a mapping of axes or lists, or a pandas DataFrame, whose columns are zipped axes."""
        if isinstance(points, pd.DataFrame):
            columns = {str(points.index.name or "row"): points.index} | {str(c): points[c] for c in points}
            return cls({name: Axis(values.to_numpy()) for name, values in columns.items()}, tuple(columns))
        return points if isinstance(points, cls) else cls(points)

    def dim_of(self, name: str) -> str:
        """The dimension along which the axis `name` runs."""
        return next(group[0] for group in self.groups if name in group)

    def blocks(self) -> Iterator[NDArray[np.intp]]:
        """Indices of all points, BLOCK at a time."""
        for begin in range(0, self.size, BLOCK):
            yield np.arange(begin, min(begin + BLOCK, self.size))

    def points(self, index: NDArray[np.intp] | None = None) -> Points:
        """The points at flat indices `index`, by default all, in C order of the dimensions."""
        chosen = np.arange(self.size) if index is None else index
        along = dict(zip(self.dims, np.unravel_index(chosen, self.shape), strict=True))
        return {name: axis.values[along[self.dim_of(name)]] for name, axis in self.axes.items()}

    def locate(self, points: Points) -> NDArray[np.intp]:
        """Flat indices of points of the grid; an InputError if a point is missing."""
        columns = {name: axis_values(np.asarray(points[name])) for name in self.axes}
        along = [self._positions(group, columns) for group in self.groups]
        return np.asarray(np.ravel_multi_index(along, self.shape))

    def mask(self) -> NDArray[np.bool_]:
        """False at the points that `skip` leaves out."""
        mask = np.ones(self.size, dtype=bool)
        if self.skip is not None:
            for index in self.blocks():
                flags = np.asarray(self.skip(self.points(index)), dtype=bool)
                if flags.shape != index.shape:
                    raise InputError(f"Grid: skip returned the shape {flags.shape}; it must be {index.shape}")
                mask[index] = ~flags
        return mask

    def align(self, other: "Grid") -> "Alignment":
        """Positions in this grid of the points of `other`, a part of it with the same axes."""
        indexers: list[NDArray[np.intp] | slice] = []
        for group in self.groups:
            values = {name: other.axes[name].values for name in group}
            equal = all(np.array_equal(self.axes[name].values, each) for name, each in values.items())
            indexers.append(slice(None) if equal else self._positions(group, values))
        return Alignment(other.shape, self.shape, tuple(indexers))

    def union(self, other: "Grid") -> "Grid":
        """The values of this grid and of `other`, a grid of the same axes; everything else as in `other`.

        The union of sorted axes is sorted; otherwise new values come last.
        """
        axes = dict(other.axes)
        for group in self.groups:
            both = self._index(group), other._index(group)
            union = both[0].union(both[1], sort=False)
            if all(each.is_monotonic_increasing for each in both):
                union = union.sort_values()
            elif all(each.is_monotonic_decreasing for each in both):
                union = union.sort_values(ascending=False)
            for level, name in enumerate(group):
                axes[name] = replace(axes[name], values=union.get_level_values(level).to_numpy())
        return replace(other, axes=axes)

    def _index(self, group: Sequence[str], points: Points | None = None) -> Any:
        columns = [self.axes[name].values if points is None else points[name] for name in group]
        return pd.Index(columns[0]) if len(columns) == 1 else pd.MultiIndex.from_arrays(columns)

    def _positions(self, group: Sequence[str], points: Points) -> NDArray[np.intp]:
        """Positions of rows of values along the dimension of a group."""
        requested = self._index(group, points)
        found: NDArray[np.intp] = self._index(group).get_indexer(requested)
        if np.any(found < 0):
            raise InputError(f"Grid: {', '.join(group)} has no value {requested[np.argmin(found)]}")
        return found


@dataclass(frozen=True, eq=False)
class Alignment:
    """Positions of the points of one grid in another that has all of them, by value.

    `inner` and `outer` are the shapes of the two. `indexers` has, for each dimension, the positions of the inner
    grid's values in the outer one; a slice of all where both have the same values.
    """

    inner: tuple[int, ...]
    outer: tuple[int, ...]
    indexers: tuple[NDArray[np.intp] | slice, ...]

    @property
    def identical(self) -> bool:
        """Whether the two grids are equal."""
        return all(isinstance(each, slice) for each in self.indexers)

    def __call__(self, points: NDArray[Any] | None = None) -> NDArray[Any]:
        """Flat indices in the outer grid of points of the inner one, of all by default."""
        points = np.arange(math.prod(self.inner)) if points is None else points
        if self.identical:
            return points
        index = np.unravel_index(points, self.inner)
        along = [k if isinstance(each, slice) else each[k] for k, each in zip(index, self.indexers, strict=True)]
        return np.asarray(np.ravel_multi_index(along, self.outer))


def is_text(values: NDArray[Any]) -> bool:
    """Whether the entries of an array are strings."""
    strings = values.dtype.kind == "O" and values.size > 0 and all(isinstance(each, str) for each in values.flat)
    return values.dtype.kind in "UT" or strings


def first_equal(columns: Columns) -> NDArray[np.intp]:
    """Index of the first row that equals each row."""
    label = np.zeros(len(columns[0]), dtype=np.int64)
    for column in columns:
        label = pd.factorize(label * len(label) + pd.factorize(column)[0])[0]
    return np.unique(label, return_index=True)[1][label]


def block_shape(shape: tuple[int, ...], most: int) -> tuple[int, ...]:
    """Shape of blocks of at most `most` entries, or of one, that are contiguous in C order."""
    lengths = list[int]()
    for length in reversed(shape):
        lengths.insert(0, min(most, length))
        most = max(most // max(length, 1), 1)
    return tuple(lengths)


def blocks(shape: tuple[int, ...], most: int) -> list[tuple[slice, ...]]:
    """Cut an array of this shape, in C order, into blocks of at most `most` entries, or of one."""
    steps = zip(shape, block_shape(shape, most), strict=True)
    return list(product(*([slice(k, min(k + n, length)) for k in range(0, length, n)] for length, n in steps)))


def flag_attributes(flags: Mapping[int, str], dtype: Any) -> dict[str, Any]:
    """CF attributes of an integer whose values have meanings."""
    words = " ".join(word.replace(" ", "_") for word in flags.values())
    return {"flag_values": np.array(list(flags), dtype=dtype), "flag_meanings": words}


def check_counts(counts: Mapping[str, int]) -> None:
    """Refuse a grid by the lengths of its dimensions, before anything is allocated for its points."""
    if (size := math.prod(counts.values())) > MOST_POINTS:
        shape = " x ".join(f"{name} {count}" for name, count in counts.items())
        many = f"{size:.3g} points are more than the {MOST_POINTS:.3g} of one plan"
        raise InputError(f"grid = {shape}: {many}; take fewer values, or run parts of them into separate folders")


def check_size(grid: Grid) -> None:
    """Refuse a grid of too many points."""
    check_counts(dict(zip(grid.dims, grid.shape, strict=True)))


def check_names(what: str, named: Mapping[str, Any], kind: type) -> None:
    """Raise unless every name is valid in a file and every value is a `kind`."""
    for name, value in named.items():
        usable = isinstance(name, str) and name.isidentifier() and not name.startswith("failure_")
        if not usable or name in RESERVED:
            rule = f"it must be of letters, digits and _, and none of {', '.join(RESERVED)}, failure_..."
            raise InputError(f"{what} has the name {name!r}: {rule}")
        if not isinstance(value, kind):
            raise InputError(f"{what}[{name!r}] = {value!r}: it must be of type {kind.__name__}")


@dataclass(frozen=True)
class Refinement:
    """The rule by which a refined sweep chooses points to compute.

    Parameters
    ----------
    variable, levels : str, int
        The variable that decides, one number at each point; halvings of the coarse lattice's spacing along every
        axis: each has (m - 1) 2^levels + 1 values.
    tolerance : float, optional
        Largest expected error of interpolation, in units of the range of the values; None: any.
    thresholds : tuple of float
        Ascending; a value up to the first of them is of one class, one above it of another, and so on.
    resolution, whole : float, bool
        The share of the largest value below which errors are rounding, and whether every value is a class, between
        which nothing is interpolated; `refined` sets both by the variable.
    """

    variable: str
    levels: int
    tolerance: float | None = None
    thresholds: tuple[float, ...] = ()
    resolution: float = 1e-9
    whole: bool = False


@dataclass(frozen=True, eq=False)
class Declaration:
    """The fields of a `sweeps.Sweep`, which documents them."""

    name: str
    function: Callable[..., Any]
    grid: Any
    variables: Any
    constants: Mapping[str, Any] = field(default_factory=dict)
    key: Callable[[Points], Any] | None = None
    coords: Mapping[str, Any] = field(default_factory=dict)
    code: Sequence[str | Path] = ()
    title: str = ""
    derive: Callable[[xr.Dataset], xr.Dataset] | None = None
    scale: Callable[[Points], Mapping[str, Any]] | None = None
    order_by: tuple[str, ...] = ()
    request: Mapping[str, Any] = field(default_factory=dict)
    remark: str = ""
    rerun: Callable[[Mapping[str, Any]], str] | None = None
    refinement: Refinement | None = None
    functions: Mapping[str, Callable[..., Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        who = f"Sweep {self.name}:"
        given = [self.variables] if isinstance(self.variables, str) else self.variables
        variables = given if isinstance(given, Mapping) else dict.fromkeys(given, Variable())
        coords = {name: each if isinstance(each, Axis) else Axis(each) for name, each in self.coords.items()}
        several = {"order_by": self.order_by, "code": self.code}
        several = {k: (v,) if isinstance(v, (str, Path)) else tuple(v) for k, v in several.items()}
        vars(self).update(grid=Grid.of(self.grid), variables=variables, coords=coords, **several)  # it is frozen
        if not variables:
            raise InputError(f"{who} variables = {{}}: there must be at least one")
        for what in ("function", "key", "derive", "scale", "rerun"):
            each = getattr(self, what)
            if not callable(each) and (each is not None or what == "function"):
                raise InputError(f"{who} {what} = {each!r}: it must be a function")
        check_names(f"{who} variables", self.variables, Variable)
        check_names(f"{who} coords", self.coords, Axis)
        names = [*self.grid.axes, *self.coords, *self.variables]
        for name in (each for each in names if names.count(each) > 1):
            raise InputError(f"{who} {name!r} names two things; each needs its own name")
        for name, variable in self.variables.items():
            for dim in (each for each in variable.dims if each not in self.coords):
                raise InputError(f"{who} variable {name!r} has the dimension {dim!r}; coords must have it")
            if (scale := variable.scale) and self.scale is None:
                raise InputError(f"{who} variable {name!r} has the scale {scale!r}; the sweep needs scale")
        for name, each in self.functions.items():
            if name not in self.variables or not callable(each) or len(self.functions) == len(self.variables):
                rule = "it must be a function of one of the variables, of which one at least is the sweep's own"
                raise InputError(f"{who} functions[{name!r}] = {each!r}: {rule}")
        for name in (each for each in self.order_by if each not in self.grid.axes):
            raise InputError(f"{who} order_by names {name!r}: it must be one of {', '.join(self.grid.axes)}")

    @property
    def stored(self) -> dict[str, Variable]:
        """The variables as the file represents them."""
        return {name: each.stored for name, each in self.variables.items()}
