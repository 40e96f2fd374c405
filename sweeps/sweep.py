"""A sweep's declaration: which function, over which grid, giving which variables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from sweeps.fingerprint.identity import plain
from sweeps.grid import Axis, Grid, Points, Variable, check_names

if TYPE_CHECKING:
    from sweeps.plan import Plan
    from sweeps.refine import Refinement


@dataclass(frozen=True, eq=False)
class Sweep:
    """A function of points, mapped over a grid.

    Parameters
    ----------
    name : str
    function : callable
        `function(points, **constants)` takes a batch, a dict of 1-D arrays with one entry a point, and
        returns a dict of arrays with the batch first. A point's result must not depend on its batch. It may
        also return `error`, for each point an exception or None, and `wall_time` (s).
    grid : Grid
    variables : mapping of str to Variable
    constants : mapping
        Keyword arguments of the function; numbers, texts, arrays, dataclasses and containers of them.
    key : callable, optional
        `key(points)` gives equal rows for points that are one computation; it is done once, at one of them, and
        copied.
    coords : mapping of str to Axis
        Coordinates of the dimensions that variables have beyond the grid's.
    title : str
        The file's title.
    derive : callable, optional
        `derive(dataset)` returns the finished dataset with whatever follows from all points together; what
        was computed it leaves as it is.
    scale : callable, optional
        `scale(points)` gives factors by name; a variable that names one in its `scale` is multiplied by it at
        each point, so that one computation serves points that differ in size only.
    together : sequence of str
        Axes whose change is costly: a batch holds neighbours along the others first.
    at_once : int
        How many points the function computes side by side at little more than the cost of one: batches hold as
        many, where there are.
    refinement : Refinement, optional
        What decides which points are computed; given by `sweeps.refined`. Without it all are.
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
    scale: Callable[[Points], Mapping[str, Any]] | None = None
    together: tuple[str, ...] = ()
    at_once: int = 1
    refinement: Refinement | None = None

    def __post_init__(self) -> None:
        if not self.variables:
            raise ValueError(f"Sweep {self.name}: variables = {{}}: there must be at least one")
        for what, each in (
            ("function", self.function),
            ("key", self.key),
            ("derive", self.derive),
            ("scale", self.scale),
        ):
            if not (callable(each) or (each is None and what != "function")):
                raise ValueError(f"Sweep {self.name}: {what} = {each!r}: it must be a function")
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
            if variable.scale and self.scale is None:
                raise ValueError(
                    f"Sweep {self.name}: variable {name!r} has the scale {variable.scale!r}; the sweep needs scale"
                )
        object.__setattr__(
            self, "together", (self.together,) if isinstance(self.together, str) else tuple(self.together)
        )
        for name in self.together:
            if name not in self.grid.axes:
                raise ValueError(
                    f"Sweep {self.name}: together names {name!r}: it must be one of {', '.join(self.grid.axes)}"
                )
        if not (isinstance(self.at_once, int) and self.at_once >= 1):
            text = f"Sweep {self.name}: at_once = {self.at_once!r}: it must be a whole number, 1 or above"
            raise ValueError(text)
        plain(self.constants)

    def plan(self, store: str | Path | None = None, *, fresh: bool = False, retry_failed: bool = False) -> Plan:
        """Decide everything before the first expensive call; probes the function on a few points.

        Parameters
        ----------
        store : path, optional
            The netCDF file to write; without it the result stays in memory.
        fresh : bool
            Start over, whatever the store holds of this sweep.
        retry_failed : bool
            Compute again what failed.

        Raises
        ------
        StoreError
            If the store cannot be used or belongs to something else; the message says what differs.
        """
        from sweeps.planning import make_plan

        return make_plan(self, store, fresh, retry_failed)
