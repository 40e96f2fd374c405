"""What a sweep's file will look like, without the functions that make it: enough to put parts together.

It is kept beside the parts, so that whoever reads a sweep that is still running needs no code of the sweep's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from sweeps.compute.values import residual, scaled
from sweeps.errors import UNREADABLE, InputError, StoreError, reason
from sweeps.grid import STATUS_FLAGS, Axis, Embedding, Grid, Variable
from sweeps.storage.packed import Packed, pack
from sweeps.storage.replacing import replacing

# What every file has besides its sweep's variables.
BESIDES = {
    "status": Variable("", "status of the point", dtype="int8", flags=STATUS_FLAGS),
    "error": Variable("", "why the point failed"),
    "wall_time": Variable("s", "computing time of the point"),
    "computed_by": Variable("1", "number of the environment that computed the point", dtype="int16"),
}

# A variable with more bytes than this is never in memory as a whole.
LARGE = 32_000_000


@dataclass(frozen=True, eq=False)
class Manifest:
    """The grid of a file and what belongs to each of its points.

    Attributes
    ----------
    name, title : str
    grid : Grid
    coords : mapping of str to Axis
    variables : mapping of str to Variable
    representative : ndarray of int, (points,), or None
        The point whose computation is this point's too; -1 where it is skipped. None: each is its own.
    factors : mapping of str to ndarray, (points,)
        What the results of a computation are multiplied by at each point.
    attributes : mapping of str to str
        `configuration`, `identity` and `presentation` of the sweep.
    fresh : bool
        Whether a finished file beside the parts is to be replaced rather than completed.
    token : str
        What parts name the manifest by.
    earlier : mapping of str to Grid
        Grids of earlier manifests of the same store, by their tokens; parts may be of these.
    copied : bool
        Whether a point gets the result of its representative, or only representatives have any.
    scaling : callable
        What makes of values, factors and digits what is written.
    """

    name: str
    title: str
    grid: Grid
    coords: Mapping[str, Axis]
    variables: Mapping[str, Variable]
    representative: NDArray[Any] | None = None
    factors: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    fresh: bool = False
    token: str = field(default_factory=lambda: uuid4().hex[:12])
    earlier: Mapping[str, Grid] = field(default_factory=dict)
    copied: bool = True
    scaling: Callable[[NDArray[Any], NDArray[np.float64], int | None], NDArray[Any]] = scaled

    def located(self, token: str, points: NDArray[np.intp]) -> NDArray[np.intp] | None:
        """Points of the grid of this or an earlier manifest as points of this grid; None if there is none."""
        embedding = self._embeddings.get(token)
        return None if embedding is None else embedding(points)

    @cached_property
    def _embeddings(self) -> dict[str, Embedding]:
        grids = {**self.earlier, self.token: self.grid}
        return {token: self.grid.embed(grid) for token, grid in grids.items()}

    def representatives(self, points: NDArray[np.intp]) -> NDArray[np.intp]:
        """The point that is computed in the stead of each; -1 where it is skipped."""
        return points if self.representative is None else self.representative[points]

    def copies(self, points: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """All points that some computed ones stand for, and for each the row of the one; -1 stands for none."""
        if self.representative is None or not self.copied:
            rows = np.flatnonzero(points >= 0)
            return points[rows], rows
        order, ordered = self._order
        first = np.searchsorted(ordered, points)
        counts = np.where(points >= 0, np.searchsorted(ordered, points, side="right") - first, 0)
        rows = np.repeat(np.arange(len(points)), counts)
        within = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
        return order[first[rows] + within], rows

    @cached_property
    def _order(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The points, copies beside what they are copies of; and their representatives in that order."""
        own = self.representatives(np.arange(self.grid.size))
        order = np.argsort(own, kind="stable")
        return order, own[order]

    def computations(self) -> Manifest:
        """The computations themselves: without copies, and of the scaled variables what their products lack."""
        return replace(self, copied=False, scaling=residual)

    def described(self, name: str) -> Variable:
        """One of the variables, or of those that every file has besides."""
        return self.variables.get(name) or BESIDES[name]

    def at_points(self, name: str, values: NDArray[Any], points: NDArray[np.intp]) -> NDArray[Any]:
        """Results of computations as those of some points: times the factor of each."""
        described = self.described(name)
        factors = self.factors.get(described.scale)
        return values if factors is None else self.scaling(values, factors[points], described.digits)

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a variable at one point."""
        return tuple(len(self.coords[dim]) for dim in self.described(name).dims)

    def row_bytes(self, name: str) -> int:
        """Size of a variable at one point."""
        return int(np.dtype(self.described(name).dtype).itemsize * np.prod(self.shape(name), dtype=np.int64))

    def large(self) -> list[str]:
        """Variables that are never in memory together; where one number a point is too much, what else has one."""
        large = [n for n in (*self.variables, "wall_time") if self.row_bytes(n) * self.grid.size > LARGE]
        return [*large, "error"] if "wall_time" in large else large

    def save(self, path: Path) -> None:
        """Write the manifest."""
        grids = {self.token: self.grid, **self.earlier}
        about = {
            "name": self.name,
            "title": self.title,
            "token": self.token,
            "fresh": self.fresh,
            "attributes": dict(self.attributes),
            "groups": {token: grid.groups for token, grid in grids.items()},
            "axes": {name: [axis.units, axis.long_name] for name, axis in self.grid.axes.items()},
            "coords": {name: [axis.units, axis.long_name] for name, axis in self.coords.items()},
            "variables": {name: asdict(variable) for name, variable in self.variables.items()},
            "factors": list(self.factors),
        }
        arrays = {f"axis {n} {token}": axis.values for token, g in grids.items() for n, axis in g.axes.items()}
        arrays |= {f"coord {name}": axis.values for name, axis in self.coords.items()}
        arrays |= {f"factor {name}": values for name, values in self.factors.items()}
        if self.representative is not None:
            arrays["representative"] = self.representative
        with replacing(path) as temporary:
            temporary.write_bytes(pack(about, arrays, ["representative"]))

    @classmethod
    def load(cls, path: Path) -> Manifest:
        """Read what `save` wrote.

        Raises
        ------
        ValueError
            If there is no such file, or it is damaged or something else.
        StoreError
            If it cannot be read now.
        """
        try:
            file = Packed(path)
            about, arrays = file.about, file.read(file.names)
            grids = {}
            for token, groups in about["groups"].items():
                axes = {n: Axis(arrays[f"axis {n} {token}"], *each) for n, each in about["axes"].items()}
                grids[token] = Grid(axes, groups)
            for each in about["variables"].values():
                each["flags"] = each["flags"] and {int(code): word for code, word in each["flags"].items()}
            return cls(
                **{name: about[name] for name in ("name", "title", "token", "fresh", "attributes")},
                grid=grids.pop(about["token"]),
                earlier=grids,
                coords={n: Axis(arrays[f"coord {n}"], *each) for n, each in about["coords"].items()},
                variables={name: Variable(**each) for name, each in about["variables"].items()},
                representative=arrays.get("representative"),
                factors={name: arrays[f"factor {name}"] for name in about["factors"]},
            )
        except UNREADABLE as problem:
            # What is there and cannot be read now is no reason to begin anew.
            if isinstance(problem, OSError) and not isinstance(problem, (FileNotFoundError, NotADirectoryError)):
                raise StoreError(f"{path} cannot be read: {reason(problem)}") from None
            raise InputError(f"{path}: it is damaged or not the manifest of a sweep") from problem
