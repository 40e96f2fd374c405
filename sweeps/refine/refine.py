"""Refinement of a sweep: its grid is a lattice, of which only the points are computed that are worth it.

A run of `refined(sweep, refinement)` goes in passes. Each asks for what the results so far make worth computing
(`sweeps.refine.lattice`); a run that is interrupted goes on, and nothing is computed twice. In the file the other
points are interpolated, and say so in their status; to the next plan they are pending.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sweeps.grid import (
    DONE,
    FAILED,
    INTERPOLATED,
    INTERPOLATED_FLAG,
    PENDING,
    SKIPPED,
    STATUS_FLAGS,
    Variable,
)
from sweeps.plan.declaration import Declaration
from sweeps.refine.lattice import Refinement, closure, finest_known, survey
from sweeps.storage.manifest import LARGE, Manifest

Declared = TypeVar("Declared", bound=Declaration)
Derive = Callable[[xr.Dataset], xr.Dataset]


def refined(sweep: Declared, refinement: Refinement) -> Declared:
    """The sweep, to be computed where `refinement` says, and interpolated elsewhere.

    Raises
    ------
    ValueError
        If they do not fit.
    """
    _check(sweep, refinement)
    variable = sweep.variables[refinement.variable]
    if np.dtype(variable.dtype).kind == "f":
        kept = max(float(np.finfo(variable.dtype).eps), 0.0 if variable.digits is None else 10.0**-variable.digits)
        refinement = replace(refinement, resolution=max(refinement.resolution, kept))
    derive = partial(filled, refinement=refinement, then=sweep.derive)
    return replace(sweep, refinement=refinement, derive=derive)


def wanted_points(
    name: str,
    refinement: Refinement,
    manifest: Manifest,
    values: NDArray[Any],
    status: NDArray[np.int8],
    copies: NDArray[np.intp] | None,
) -> NDArray[np.bool_]:
    """Which points of a refined sweep are wanted, as far as what is known of it tells.

    Parameters
    ----------
    name : str
        The sweep's.
    refinement : Refinement
    manifest : Manifest
    values, status : ndarray
        Of the lattice: the variable that is looked at, and what has become of each point.
    copies : ndarray of int, optional
        Equal for points that are one computation.

    Raises
    ------
    ValueError
        If the file has so many points that not all values can be interpolated in memory.
    """
    large = [each for each in manifest.large() if each in manifest.variables and not manifest.variables[each].dims]
    if large:
        raise ValueError(
            f"Sweep {name}: {manifest.grid.size} points of {large[0]} are too many to refine; it must be at "
            f"most {LARGE // manifest.row_bytes(large[0])}"
        )
    variable = manifest.variables[refinement.variable]
    rule = refinement.rule(_whole(variable.dtype))
    return closure(_as_floats(values, variable), _is_known(status), refinement.levels, rule, copies)


def filled(dataset: xr.Dataset, *, refinement: Refinement, then: Derive | None) -> xr.Dataset:
    """Interpolate what is not computed and not to be computed next; then derive what else there is.

    The lattice is the file's grid, which may be finer than the one that was asked for now. Where no coarse lattice
    of it is known throughout, nothing is interpolated.
    """
    told = json.loads(dataset.attrs["configuration"]) | {"refinement": asdict(refinement)}
    dataset = dataset.assign_attrs(configuration=json.dumps(told))
    status = dataset["status"]
    known = _is_known(status.values)
    levels = finest_known(known)
    if levels is not None:
        found = {
            str(name): survey(each.values.astype(float), known, levels, refinement.rule(_whole(each)))
            for name, each in dataset.data_vars.items()
            if each.dims == status.dims and each.dtype.kind in "fi" and name not in ("status", "wall_time")
        }
        rest = ~known & ~found[refinement.variable].asked
        for name, each in found.items():
            own = dataset[name]
            values = np.where(rest, each.values, np.where(known, own.values, np.nan))
            dataset[name] = own.copy(data=values.astype(own.dtype))
        codes = np.where(rest, INTERPOLATED, np.where(known, status.values, PENDING)).astype(np.int8)
        dataset["status"] = status.copy(data=codes).assign_attrs(
            flag_values=np.arange(INTERPOLATED + 1, dtype=np.int8),
            flag_meanings=" ".join((STATUS_FLAGS | INTERPOLATED_FLAG).values()),
        )
    return dataset if then is None else then(dataset)


def _check(sweep: Declaration, refinement: Refinement) -> None:
    who = f"Sweep {sweep.name}: refinement"
    levels, tolerance = refinement.levels, refinement.tolerance
    if type(levels) is not int or levels < 0:
        raise ValueError(f"{who}: levels = {levels!r}: it must be a whole number, 0 or above")
    if tolerance is not None and not tolerance > 0.0:
        raise ValueError(f"{who}: tolerance = {tolerance!r}: it must be above 0")
    variable = sweep.variables.get(refinement.variable)
    if variable is None or variable.dims:
        numbers = [name for name, each in sweep.variables.items() if not each.dims]
        raise ValueError(f"{who}: variable = {refinement.variable!r}: it must be one of {', '.join(numbers)}")
    if list(refinement.thresholds) != sorted(set(refinement.thresholds)):
        raise ValueError(f"{who}: thresholds = {refinement.thresholds}: they must ascend")
    for dim, length in zip(sweep.grid.dims, sweep.grid.shape, strict=True):
        if (length - 1) % 2**levels:
            raise ValueError(
                f"{who}: {dim} has {length} values; with levels = {levels} it must have one more than a multiple "
                f"of {2**levels}"
            )


def _is_known(status: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether there is nothing to be computed at a point: what failed is an answer too."""
    return np.isin(status, (DONE, FAILED, SKIPPED))


def _as_floats(values: NDArray[Any], variable: Variable) -> NDArray[np.float64]:
    """Values with NaN for what is missing."""
    floats = values.astype(float)
    return floats if values.dtype.kind == "f" else np.where(values == variable.missing, np.nan, floats)


def _whole(each: Any) -> bool:
    """Whether a type, or what a variable has in its file, is of whole numbers."""
    kind = each.encoding.get("dtype", each.dtype) if isinstance(each, xr.DataArray) else each
    return bool(np.dtype(kind).kind == "i")
