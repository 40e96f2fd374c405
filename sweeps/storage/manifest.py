"""What a result will look like, without the functions that make it: enough to put shards together.

It is kept beside the shards, so that whoever reads a sweep that is still running needs no code of the sweep's.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from sweeps.grid import Axis, Grid, Variable
from sweeps.plan.keys import Columns, Index, column
from sweeps.storage.parts import NETCDF

# A variable with more bytes than this is never in memory as a whole.
LARGE = 32_000_000


@dataclass(frozen=True, eq=False)
class Layout:
    """The grid of a file and what belongs to each of its points.

    Attributes
    ----------
    name, title : str
    grid : Grid
    coords : mapping of str to Axis
    variables : mapping of str to Variable
    original : ndarray, (points,)
        The point whose computation is this point's too; -1 where it is skipped.
    key : list of ndarray, or None
        The key of each point; None where that is the values of its axes.
    factors : mapping of str to ndarray, (points,)
        What the results of a computation are multiplied by at each point.
    attributes : mapping of str to str
        `configuration`, `identity` and `presentation` of the sweep.
    fresh : bool
        Whether a finished file beside the shards is to be replaced rather than completed.
    """

    name: str
    title: str
    grid: Grid
    coords: Mapping[str, Axis]
    variables: Mapping[str, Variable]
    original: NDArray[np.intp]
    key: Columns | None = None
    factors: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    fresh: bool = False

    @cached_property
    def order(self) -> NDArray[np.intp]:
        """The points, copies beside what they are copies of."""
        return np.argsort(self.original, kind="stable")

    @cached_property
    def sorted_original(self) -> NDArray[np.intp]:
        """`original` in that order."""
        return self.original[self.order]

    @cached_property
    def slots(self) -> NDArray[np.intp]:
        """The points that stand for a computation of their own."""
        return np.flatnonzero(self.original == np.arange(len(self.original)))

    def slot_key(self, slots: NDArray[np.intp]) -> Columns:
        """The keys of some points."""
        if self.key is None:
            return list(self.grid.points(slots).values())
        return [column[slots] for column in self.key]

    def find(self, key: Columns) -> NDArray[np.intp]:
        """The slot of each row of a key; -1 where there is none."""
        if self.key is None:
            flat = self.at(key)
            return np.where((flat >= 0) & (self.original[flat] == flat), flat, -1)
        if not len(self.slots):
            return np.full(len(key[0]), -1, dtype=np.intp)
        place = self._index.find(key)
        return np.where(place >= 0, self.slots[place], -1)

    def at(self, values: Columns) -> NDArray[np.intp]:
        """The point with each row of the axes' values; -1 where there is none."""
        names = list(self.grid.axes)
        along = [
            index.find([values[names.index(name)] for name in group])
            for index, group in zip(self._along, self.grid.groups, strict=True)
        ]
        inside = np.all([place >= 0 for place in along], axis=0)
        flat = np.ravel_multi_index([np.maximum(place, 0) for place in along], self.grid.shape)
        return np.where(inside, flat, -1)

    @cached_property
    def _along(self) -> list[Index]:
        """What finds values along each dimension."""
        return [Index([self.grid.axes[name].values for name in group]) for group in self.grid.groups]

    @cached_property
    def _index(self) -> Index:
        """What finds a key among those of the slots."""
        return Index(self.slot_key(self.slots))

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a variable at one point."""
        return tuple(len(self.coords[dim]) for dim in self.variables[name].dims)

    def row_bytes(self, name: str) -> int:
        """Size of a variable at one point."""
        return int(np.dtype(self.variables[name].dtype).itemsize * np.prod(self.shape(name), dtype=np.int64))

    def large(self) -> list[str]:
        """Variables that are streamed from shard to file."""
        return [name for name in self.variables if self.row_bytes(name) * self.grid.size > LARGE]

    def save(self, path: Path) -> None:
        """Write the layout as netCDF."""
        described = {
            "name": self.name,
            "title": self.title,
            "groups": self.grid.groups,
            "axes": {name: [axis.units, axis.long_name] for name, axis in self.grid.axes.items()},
            "coords": {name: [axis.units, axis.long_name] for name, axis in self.coords.items()},
            "variables": {name: asdict(variable) for name, variable in self.variables.items()},
            "attributes": dict(self.attributes),
            "factors": list(self.factors),
            "keys": None if self.key is None else len(self.key),
            "fresh": self.fresh,
        }
        arrays = {f"axis_{name}": axis.values for name, axis in self.grid.axes.items()}
        arrays |= {f"coord_{name}": axis.values for name, axis in self.coords.items()}
        # Where every point is its own computation there is nothing to tell.
        if not np.array_equal(self.original, np.arange(self.grid.size)):
            arrays["original"] = self.original
        arrays |= {f"key_{k}": column for k, column in enumerate(self.key or ())}
        arrays |= {f"factor_{name}": values for name, values in self.factors.items()}
        with NETCDF, netCDF4.Dataset(path, "w") as file:
            file.layout = json.dumps(described)
            for name, values in arrays.items():
                dim = f"n_{name}"
                file.createDimension(dim, len(values))
                text = values.dtype.kind in "OU"
                kind: Any = str if text else ("i1" if values.dtype.kind == "b" else values.dtype)
                made = file.createVariable(name, kind, (dim,), zlib=not text, complevel=1, shuffle=not text)
                made[...] = values.astype(object) if text else values

    @classmethod
    def load(cls, path: Path) -> Layout:
        """Read what `save` wrote.

        Raises
        ------
        ValueError
            If the file is damaged or something else.
        """
        try:
            with NETCDF, netCDF4.Dataset(path) as file:
                file.set_auto_maskandscale(False)
                told = json.loads(file.layout)
                arrays = {name: column(variable[...]) for name, variable in file.variables.items()}
            axes = {name: Axis(arrays[f"axis_{name}"], *about) for name, about in told["axes"].items()}
            grid = Grid(axes, [tuple(group) for group in told["groups"] if len(group) > 1])
            return cls(
                told["name"],
                told["title"],
                grid,
                {name: Axis(arrays[f"coord_{name}"], *about) for name, about in told["coords"].items()},
                {name: Variable(**about) for name, about in told["variables"].items()},
                arrays.get("original", np.arange(grid.size)),
                None if told["keys"] is None else [arrays[f"key_{k}"] for k in range(told["keys"])],
                {name: arrays[f"factor_{name}"] for name in told["factors"]},
                told["attributes"],
                told["fresh"],
            )
        except (OSError, RuntimeError, AttributeError, KeyError, TypeError, ValueError, IndexError) as problem:
            raise ValueError(f"{path}: it is damaged or not the layout of a sweep") from problem
