"""Refinement of a sweep: its grid is a lattice, of which only the points are computed that are worth it.

A run of `refined(sweep, refinement)` goes in passes. Each asks for what the results so far make worth computing
(`sweeps.refine.lattice`); a run that is interrupted goes on, and nothing is computed twice. In the file the other
points are interpolated, and say so in their status; to the next plan they are pending.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sweeps.errors import InputError
from sweeps.grid import (
    DONE,
    FAILED,
    INTERPOLATED,
    INTERPOLATED_FLAG,
    PENDING,
    SKIPPED,
    STATUS_FLAGS,
    Embedding,
)
from sweeps.plan.declaration import Declaration
from sweeps.refine.lattice import Refinement, closure, finest_known, survey
from sweeps.storage.manifest import BESIDES, LARGE, Manifest
from sweeps.storage.merge import attributes, gather
from sweeps.storage.sources import Source

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
        refinement = replace(refinement, resolution=max(refinement.resolution, kept), whole=False)
    else:
        refinement = replace(refinement, whole=True)
    derive = partial(filled, refinement=refinement, then=sweep.derive)
    return replace(sweep, refinement=refinement, derive=derive)


def wanted_points(
    sweep: Declaration,
    refinement: Refinement,
    manifest: Manifest,
    embedding: Embedding,
    status: NDArray[np.int8],
    sources: Sequence[Source],
) -> NDArray[np.bool_]:
    """Which of the file's points a refined sweep asks for, as far as what is known of it tells.

    Raises
    ------
    ValueError
        If the file has so many points that not all values can be interpolated in memory.
    """
    large = [each for each in manifest.large() if each in manifest.variables and not manifest.variables[each].dims]
    if large:
        raise InputError(
            f"Sweep {sweep.name}: {manifest.grid.size} points of {large[0]} are too many to refine; it must be at "
            f"most {LARGE // manifest.row_bytes(large[0])}"
        )
    name, shape = refinement.variable, manifest.grid.shape
    values = gather(manifest, sources, [name], reasons=False).values[name]
    if refinement.whole:
        values = np.where(values == manifest.variables[name].missing, np.nan, values.astype(float))
    copies = None if sweep.key is None else manifest.representative

    def lattice(array: NDArray[Any]) -> NDArray[Any]:
        return array.reshape(shape)[embedding.index]

    wanted = np.zeros(shape, dtype=bool)
    wanted[embedding.index] = closure(
        lattice(values),
        lattice(_is_known(status)),
        refinement.levels,
        refinement,
        None if copies is None else lattice(copies),
    )
    return wanted.ravel()


def filled(dataset: xr.Dataset, *, refinement: Refinement, then: Derive | None) -> xr.Dataset:
    """Interpolate what is not computed and not to be computed next; then derive what else there is.

    The lattice is the file's grid, which may be finer than the one that was asked for now. Where no coarse lattice
    of it is known throughout, nothing is interpolated.
    """
    chosen_by = {name: value for name, value in asdict(refinement).items() if name != "whole"}
    configuration = json.loads(dataset.attrs["configuration"]) | {"refinement": chosen_by}
    dataset = dataset.assign_attrs(configuration=json.dumps(configuration))
    status = dataset["status"]
    known = _is_known(status.values)
    levels = finest_known(known)
    if levels is not None:
        surveys = {}
        for name, each in dataset.data_vars.items():
            if each.dims == status.dims and each.dtype.kind in "fi" and name not in ("status", "wall_time"):
                # Whole numbers are floats once some are missing.
                whole = np.dtype(each.encoding.get("dtype", each.dtype)).kind == "i"
                surveys[name] = survey(each.values.astype(float), known, levels, replace(refinement, whole=whole))
        shown = known | ~surveys[refinement.variable].asked
        for name, found in surveys.items():
            own = dataset[name]
            dataset[name] = own.copy(data=np.where(shown, found.values, np.nan).astype(own.dtype))
        codes = np.where(known, status.values, np.where(shown, INTERPOLATED, PENDING)).astype(np.int8)
        flags = attributes(replace(BESIDES["status"], flags=STATUS_FLAGS | INTERPOLATED_FLAG), "status")
        dataset["status"] = status.copy(data=codes).assign_attrs(flags)
    return dataset if then is None else then(dataset)


def _check(sweep: Declaration, refinement: Refinement) -> None:
    who = f"Sweep {sweep.name}: refinement"
    levels, tolerance = refinement.levels, refinement.tolerance
    if type(levels) is not int or levels < 0:
        raise InputError(f"{who}: levels = {levels!r}: it must be a whole number, 0 or above")
    if tolerance is not None and not tolerance > 0.0:
        raise InputError(f"{who}: tolerance = {tolerance!r}: it must be above 0")
    variable = sweep.variables.get(refinement.variable)
    if variable is None or variable.dims:
        numbers = [name for name, each in sweep.variables.items() if not each.dims]
        raise InputError(f"{who}: variable = {refinement.variable!r}: it must be one of {', '.join(numbers)}")
    if list(refinement.thresholds) != sorted(set(refinement.thresholds)):
        raise InputError(f"{who}: thresholds = {refinement.thresholds}: they must ascend")
    for dim, length in zip(sweep.grid.dims, sweep.grid.shape, strict=True):
        if levels and length > 1 and sweep.grid.axes[dim].values.dtype.kind == "U":
            raise InputError(f"{who}: {dim} is of texts, between which nothing is interpolated; levels must be 0")
        if (length - 1) % 2**levels:
            raise InputError(
                f"{who}: {dim} has {length} values; with levels = {levels} it must have one more than a multiple "
                f"of {2**levels}"
            )


def _is_known(status: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether there is nothing to be computed at a point: what failed is an answer too."""
    return np.isin(status, (DONE, FAILED, SKIPPED))
