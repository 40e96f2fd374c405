"""Refinement of a sweep: on a lattice, only those points are computed that decide the others.

A run of `refined(sweep, refinement)` computes, pass by pass, the points that the results so far request
(`sweeps.refine.lattice`), and nothing twice. In the file the other points are interpolated and marked so in the
status; for the next plan they are pending.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
import xarray as xr

from sweeps import grid
from sweeps.errors import InputError
from sweeps.grid import Declaration, Refinement
from sweeps.refine.lattice import Choice, choose, coarse, predict

Declared = TypeVar("Declared", bound=Declaration)
Derive = Callable[[xr.Dataset], xr.Dataset] | None
Copied = tuple[Callable[[dict[str, Any]], Any], Sequence[str]] | None  # a sweep's key and the names of its axes


def refined(sweep: Declared, refinement: Refinement) -> Declared:
    """The sweep, computed where `refinement` requests it and interpolated elsewhere, if they fit (ValueError)."""
    who, levels, tolerance = f"Sweep {sweep.name}: refinement", refinement.levels, refinement.tolerance
    if type(levels) is not int or levels < 0:
        raise InputError(f"{who}: levels = {levels!r}: it must be an integer, 0 or above")
    if tolerance is not None and not tolerance > 0.0:
        raise InputError(f"{who}: tolerance = {tolerance!r}: it must be above 0")
    decide = {name: each for name, each in sweep.variables.items() if each.dtype != "str"}
    numbers = [name for name, each in decide.items() if not each.dims]
    if refinement.variable not in numbers:
        raise InputError(f"{who}: variable = {refinement.variable!r}: it must be one of {', '.join(numbers)}")
    if list(refinement.thresholds) != sorted(set(refinement.thresholds)):
        raise InputError(f"{who}: thresholds = {refinement.thresholds}: they must ascend")
    for dim, length in zip(sweep.grid.dims, sweep.grid.shape, strict=True):
        if levels and length > 1 and sweep.grid.axes[dim].values.dtype.kind == "U":
            raise InputError(f"{who}: {dim} has texts, between which nothing is interpolated; levels must be 0")
        if (length - 1) % 2**levels:
            needed = f"with levels = {levels} it must have one more than a multiple of {2**levels}"
            raise InputError(f"{who}: {dim} has {length} values; {needed}")
    variable = sweep.variables[refinement.variable]
    rounding = float(np.finfo(variable.dtype).eps) if variable.is_float else 0.0
    resolution = max(refinement.resolution, rounding, 0.0 if variable.digits is None else 10.0**-variable.digits)
    refinement = replace(refinement, resolution=resolution, whole=not variable.is_float)
    copied = None if sweep.key is None else (sweep.key, tuple(sweep.grid.axes))
    derive = partial(filled, refinement=refinement, then=sweep.derive, copied=copied)
    return replace(sweep, refinement=refinement, derive=derive)


def filled(dataset: xr.Dataset, *, refinement: Refinement, then: Derive, copied: Copied) -> xr.Dataset:
    """Interpolate the points that are neither computed nor requested, record how well, then derive the rest.

    The lattice is the file's grid, which can be finer than the requested one. If none of its coarse lattices is
    computed throughout, nothing is interpolated.
    """
    rule = {name: value for name, value in asdict(refinement).items() if name != "whole"}
    configuration = json.loads(dataset.attrs["configuration"]) | {"refinement": rule}
    dataset = dataset.assign_attrs(configuration=json.dumps(configuration))
    status, dims = dataset["status"], dataset["status"].ndim
    computed = np.isin(status.values, (grid.DONE, grid.FAILED, grid.SKIPPED))
    # Halvings after which a lattice that is computed throughout becomes this one.
    common, most = math.gcd(*(n - 1 for n in status.shape)), max(status.shape).bit_length()
    possible = [n for n in range(most) if common % 2**n == 0 and computed[coarse(n, dims)].all()]
    if possible:
        levels = refinement.levels if refinement.levels in possible else min(possible)
        values = dataset[refinement.variable].values.astype(float)
        copies = None
        if copied is not None:
            # Equal numbers for points that are one computation, as for the plan.
            key, axes = copied
            points = {name: dataset[name].broadcast_like(status).transpose(*status.dims) for name in axes}
            keys = np.asarray(key({name: each.values.ravel() for name, each in points.items()}))
            first = grid.first_equal(list(keys.reshape(status.size, -1).T)).reshape(status.shape)
            copies = np.where(status.values == grid.SKIPPED, -1, first)
        choice = choose(values, computed, levels, refinement, copies)
        shown = computed | ~choice.points
        for name, each in dataset.data_vars.items():
            if each.dims == status.dims and each.dtype.kind in "fi" and name not in ("status", "wall_time"):
                # Integers are floats once some are missing.
                own = replace(refinement, whole=np.dtype(each.encoding.get("dtype", each.dtype)).kind == "i")
                predicted, _ = predict(each.values.astype(float), computed, levels, own)
                dataset[name] = each.copy(data=np.where(shown, predicted, np.nan).astype(each.dtype))
        codes = np.where(computed, status.values, np.where(shown, grid.INTERPOLATED, grid.PENDING)).astype(np.int8)
        flags = grid.flag_attributes(grid.STATUS_FLAGS | grid.INTERPOLATED_FLAG, np.int8)
        dataset["status"] = status.copy(data=codes).assign_attrs(flags)
        if levels:
            dataset = dataset.assign_attrs(refinement=json.dumps(_errors(dataset, refinement, levels, choice)))
    return dataset if then is None else then(dataset)


def _errors(dataset: xr.Dataset, refinement: Refinement, levels: int, choice: Choice) -> dict[str, Any]:
    """The attribute `refinement`.

    The `tolerance`, None for classes; the `levels` of the choice, none if unfinished, and their `largest` errors,
    both in units of the range; the range `within` which the `exhausted` ones lie, by dimension.
    """
    status, values = dataset["status"], dataset[refinement.variable].values
    finite = values[np.isfinite(values)]
    unit = float(np.ptp(finite)) if finite.size else 0.0
    measured = choice.levels if len(choice.levels) == levels else []
    places = np.argwhere(choice.exhausted)
    ends = zip(status.dims, places.min(axis=0), places.max(axis=0), strict=True) if len(places) else ()
    record = {
        "tolerance": None if refinement.whole else refinement.tolerance,
        "levels": [each | {"largest": each["largest"] / unit if unit else 0.0} for each in measured],
        "interpolated": int(np.count_nonzero(status.values == grid.INTERPOLATED)),
    }
    record |= {name: sum(each[name] for each in measured) for name in ("control", "missed")}
    within = {str(dim): [dataset[dim].values[end].item() for end in both] for dim, *both in ends}
    return record | {"exhausted": len(places), "within": within}
