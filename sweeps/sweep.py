"""A sweep's declaration: which function, over which grid, giving which variables."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sweeps.grid import Axis, Grid, Points, Variable, check_names
from sweeps.plan import Plan, make_batches

PROBE_POINTS = 8
LISTED = 20


@dataclass(frozen=True, eq=False)
class Sweep:
    """A function of points, mapped over a grid.

    Parameters
    ----------
    name : str
    function : callable
        `function(points, **constants)` takes a batch, a dict of 1-D arrays with one entry a point, and
        returns a dict of arrays with the batch first. A point's result must not depend on its batch.
    grid : Grid
    variables : mapping of str to Variable
    constants : mapping
        Keyword arguments of the function; numbers, texts, arrays, dataclasses and containers of them.
    key : callable, optional
        `key(points)` gives equal rows for points that are one computation; it is done once and copied.
    coords : mapping of str to Axis
        Coordinates of the dimensions that variables have beyond the grid's.
    title : str
        The file's title.
    derive : callable, optional
        `derive(dataset)` returns the finished dataset with whatever follows from all points together.
    """

    name: str
    function: Callable[..., Mapping[str, Any]]
    grid: Grid
    variables: Mapping[str, Variable]
    constants: Mapping[str, Any] = field(default_factory=dict)
    key: Callable[[Points], Any] | None = None
    coords: Mapping[str, Axis] = field(default_factory=dict)
    title: str = ""
    derive: Callable[[xr.Dataset], xr.Dataset] | None = None

    def __post_init__(self) -> None:
        if not self.variables:
            raise ValueError(f"Sweep {self.name}: variables = {{}}: there must be at least one")
        check_names(f"Sweep {self.name}: variables", self.variables, Variable)
        check_names(f"Sweep {self.name}: coords", self.coords, Axis)
        groups = (self.grid.axes, self.coords, self.variables)
        every = [name for group in groups for name in group]
        for name in every:
            if every.count(name) > 1:
                raise ValueError(f"Sweep {self.name}: {name!r} names two things; each needs its own name")
        for name, variable in self.variables.items():
            for dim in variable.dims:
                if dim not in self.coords:
                    raise ValueError(
                        f"Sweep {self.name}: variable {name!r} has the dimension {dim!r}; coords must hold it"
                    )
        self.configuration()

    def configuration(self) -> str:
        """Everything the values depend on, as one line of JSON; long axes by their ends and length.

        The values of the axes are the coordinates of the same file.
        """
        return json.dumps(
            {
                "name": self.name,
                "axes": {name: _summary(axis) for name, axis in self.grid.axes.items()},
                "constants": dict(self.constants),
            },
            default=_plain,
        )

    def plan(self, store: str | Path | None = None) -> Plan:
        """Decide everything before the first expensive call; probes the function on a few points.

        Parameters
        ----------
        store : path, optional
            The netCDF file to write; without it the result stays in memory.
        """
        points = self.grid.points()
        skipped = self.grid.skipped(points)
        wanted = np.nonzero(~skipped)[0]
        original = self._originals(points, wanted)
        todo = np.unique(original[wanted])
        seconds = self._probe(points, todo)
        per_point = sum(
            np.dtype(v.dtype).itemsize * int(np.prod([len(self.coords[d]) for d in v.dims]))
            for v in self.variables.values()
        )
        return Plan(
            sweep=self,
            store=None if store is None else Path(store),
            points=self.grid.size,
            skipped=int(skipped.sum()),
            distinct=len(todo),
            cached=0,
            todo=len(todo),
            batches=make_batches(todo, seconds),
            original=original,
            bytes=self.grid.size * (per_point + 9),
            seconds=seconds * len(todo),
        )

    def _originals(self, points: Points, wanted: NDArray[np.intp]) -> NDArray[np.intp]:
        """For each point the index of the one computed in its stead; -1 where skipped."""
        original = np.full(self.grid.size, -1, dtype=np.intp)
        if self.key is None:
            original[wanted] = wanted
            return original
        if not len(wanted):
            return original
        rows = np.asarray(self.key({name: values[wanted] for name, values in points.items()}))
        if rows.ndim not in (1, 2) or len(rows) != len(wanted) or rows.dtype.kind not in "biufU":
            raise ValueError(
                f"Sweep {self.name}: key gave an array of shape {rows.shape} and type {rows.dtype} for "
                f"{len(wanted)} points; it must give one row of numbers or texts for each"
            )
        if rows.dtype.kind == "f" and np.any(np.isnan(rows)):
            raise ValueError(f"Sweep {self.name}: key gave NaN, which equals nothing")
        _, first, copy = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        original[wanted] = wanted[first[copy.ravel()]]
        return original

    def _probe(self, points: Points, todo: NDArray[np.intp]) -> float:
        """Seconds a point, from one call on a few points spread over the work; NaN if it fails."""
        if not len(todo):
            return 0.0
        few = todo[np.unique(np.linspace(0, len(todo) - 1, PROBE_POINTS).astype(int))]
        try:
            # The first call pays for compilation and caches.
            self.function({name: values[few[:1]] for name, values in points.items()}, **self.constants)
            start = time.perf_counter()
            self.function({name: values[few] for name, values in points.items()}, **self.constants)
            return (time.perf_counter() - start) / len(few)
        except Exception:  # noqa: BLE001 - the point will say so when it is run; here its time is unknown
            return float("nan")


def _summary(axis: Axis) -> Any:
    values = axis.values.tolist()
    return values if len(values) <= LISTED else {"first": values[0], "last": values[-1], "count": len(values)}


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise ValueError(f"constants hold {value!r}, which cannot be written as JSON")
