"""The declaration of a sweep: which function, over which grid, giving which variables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import xarray as xr

from sweeps.errors import InputError
from sweeps.grid import Axis, Grid, Points, Variable, check_names
from sweeps.refine.lattice import Refinement


@dataclass(frozen=True, eq=False)
class Declaration:
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
    order_by : sequence of str
        Axes whose change is costly: a batch holds neighbours along the others first.
    batch_multiple : int
        How many points the function computes side by side at little more than the cost of one: batches hold as
        many, where there are.
    request : mapping
        What the sweep was asked for, where its constants follow from that, as JSON holds it. It is kept in the
        file's configuration. Sweeps of one request may have constants that differ by rounding.
    remark : str
        What the file's history says of this run besides.
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
    order_by: tuple[str, ...] = ()
    batch_multiple: int = 1
    request: Mapping[str, Any] = field(default_factory=dict)
    remark: str = ""
    refinement: Refinement | None = None

    def __post_init__(self) -> None:
        who = f"Sweep {self.name}:"
        order_by = (self.order_by,) if isinstance(self.order_by, str) else tuple(self.order_by)
        object.__setattr__(self, "order_by", order_by)
        if not self.variables:
            raise InputError(f"{who} variables = {{}}: there must be at least one")
        for what in ("function", "key", "derive", "scale"):
            each = getattr(self, what)
            if not callable(each) and (each is not None or what == "function"):
                raise InputError(f"{who} {what} = {each!r}: it must be a function")
        check_names(f"{who} variables", self.variables, Variable)
        check_names(f"{who} coords", self.coords, Axis)
        names = [*self.grid.axes, *self.coords, *self.variables]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"{who} {name!r} names two things; each needs its own name")
        for name, variable in self.variables.items():
            for dim in variable.dims:
                if dim not in self.coords:
                    raise InputError(f"{who} variable {name!r} has the dimension {dim!r}; coords must hold it")
            if variable.scale and self.scale is None:
                raise InputError(
                    f"{who} variable {name!r} has the scale {variable.scale!r}; the sweep needs scale"
                )
        for name in order_by:
            if name not in self.grid.axes:
                raise InputError(f"{who} order_by names {name!r}: it must be one of {', '.join(self.grid.axes)}")
        if not (isinstance(self.batch_multiple, int) and self.batch_multiple >= 1):
            raise InputError(
                f"{who} batch_multiple = {self.batch_multiple!r}: it must be a whole number, 1 or above"
            )
