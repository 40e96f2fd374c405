"""The declaration of a sweep: which function, over which grid, giving which variables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr

from sweeps.errors import InputError
from sweeps.grid import Axis, Grid, Points, Variable, check_names


@dataclass(frozen=True)
class Refinement:
    """The rule by which a refined sweep chooses the points that are computed.

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
    batch_multiple: int = 1
    request: Mapping[str, Any] = field(default_factory=dict)
    remark: str = ""
    rerun: Callable[[Mapping[str, Any]], str] | None = None
    refinement: Refinement | None = None

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
        stored = [k for name, each in self.variables.items() for k in each.stored(name)]
        names = [*self.grid.axes, *self.coords, *stored]
        for name in (each for each in names if names.count(each) > 1):
            raise InputError(f"{who} {name!r} names two things; each needs its own name")
        for name, variable in self.variables.items():
            for dim in (each for each in variable.dims if each not in self.coords):
                raise InputError(f"{who} variable {name!r} has the dimension {dim!r}; coords must have it")
            if (scale := variable.scale) and self.scale is None:
                raise InputError(f"{who} variable {name!r} has the scale {scale!r}; the sweep needs scale")
        for name in (each for each in self.order_by if each not in self.grid.axes):
            raise InputError(f"{who} order_by names {name!r}: it must be one of {', '.join(self.grid.axes)}")
        if not (isinstance(self.batch_multiple, int) and self.batch_multiple >= 1):
            raise InputError(f"{who} batch_multiple = {self.batch_multiple!r}: it must be an integer, 1 or above")

    @property
    def stored(self) -> dict[str, Variable]:
        """The variables as the file represents them."""
        return {k: v for name, each in self.variables.items() for k, v in each.stored(name).items()}
