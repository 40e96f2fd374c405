"""Refinement of a sweep: its grid is a lattice, of which only the points are computed that are worth it.

`refined(sweep, refinement)` is the sweep; its plans are passes. Each finds in the store what the passes before
have found, asks for what that makes worth computing (`sweeps.lattice`), and runs like any other plan: a pass that
is interrupted goes on, and nothing is computed twice. In the file the other points are interpolated, and say so in
their status; to the next plan they are pending.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sweeps.compute.batch import (
    DONE,
    FAILED,
    INTERPOLATED,
    INTERPOLATED_MEANING,
    PENDING,
    SKIPPED,
    STATUS_MEANINGS,
)
from sweeps.refine.lattice import Rule, closure, finest_known, survey
from sweeps.storage.manifest import LARGE

if TYPE_CHECKING:
    from sweeps.grid import Variable
    from sweeps.plan.plan import Plan
    from sweeps.storage.manifest import Layout
    from sweeps.storage.merge import Gathered
    from sweeps.sweep import Sweep
    from sweeps.watch.monitor import Progress

Derive = Callable[[xr.Dataset], xr.Dataset]


@dataclass(frozen=True)
class Refinement:
    """What decides where a sweep is computed.

    Parameters
    ----------
    variable : str
        The variable that is looked at: one number a point. Of a whole number every value is a class of its own.
    levels : int
        Halvings of the coarse lattice's spacing along every axis: each has (m - 1) 2^levels + 1 values.
    tolerance : float, optional
        Largest error expected of interpolation, in units of the range of the values found; None: any.
    thresholds : tuple of float
        Values at which a float passes from one class to another.
    resolution : float
        Errors below this share of the largest value are rounding; at least that of the variable as it is kept.
    """

    variable: str
    levels: int
    tolerance: float | None = None
    thresholds: tuple[float, ...] = ()
    resolution: float = 1e-9

    def rule(self, whole: bool) -> Rule:
        """What makes a point worth computing."""
        return Rule(self.thresholds, self.tolerance, self.resolution, whole)


def refined(sweep: Sweep, refinement: Refinement) -> Sweep:
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


def passes(sweep: Sweep, store: str | Path, *, fresh: bool = False, retry_failed: bool = False) -> Iterator[Plan]:
    """The plans of a refined sweep, one after the other; each is to be run before the next is asked for.

    A pass holds the store while it runs; a run that comes in between two of them goes on from there, and this one
    then ends as any does that finds its store taken.

    Parameters
    ----------
    sweep : Sweep
    store, fresh, retry_failed
        As for `Sweep.plan`.
    """
    plan = sweep.plan(store, fresh=fresh, retry_failed=retry_failed)
    while True:
        yield plan
        plan = sweep.plan(store)
        if not plan.todo:
            return


def refine(
    sweep: Sweep,
    store: str | Path,
    scheduler: str = "threads",
    workers: int | None = None,
    progress: Progress | None = None,
    *,
    fresh: bool = False,
    retry_failed: bool = False,
    fail_fast: bool = False,
) -> xr.Dataset:
    """Run every pass of a refined sweep.

    Parameters
    ----------
    sweep : Sweep
    store, fresh, retry_failed
        As for `Sweep.plan`.
    scheduler, workers, progress, fail_fast
        As for `Plan.run`.

    Returns
    -------
    xarray.Dataset
        All points of the lattice; their status tells which were computed.

    Raises
    ------
    StoreError, SchedulerError, SweepStoppedError, KeyboardInterrupt
        As `Plan.run` does.
    """
    every = passes(sweep, store, fresh=fresh, retry_failed=retry_failed)
    first = next(every)
    with one_backend(first, scheduler, workers) as backend:
        for plan in chain([first], every):
            dataset = plan.run(*backend, progress, fail_fast=fail_fast)
    return dataset


@contextmanager
def one_backend(plan: Plan, scheduler: str, workers: int | None) -> Iterator[tuple[str, int | None]]:
    """Scheduler and workers for a plan and those that follow: processes are started once, and serve them all."""
    if scheduler != "processes" or not plan.todo:
        yield scheduler, workers
        return
    # Imported here: it takes long, and few runs need it.
    from sweeps.compute.cluster import connected

    with connected(None, workers) as client:
        yield str(client.scheduler_info()["address"]), None


def wanted_points(
    sweep: Sweep, refinement: Refinement, layout: Layout, asked: NDArray[np.intp], known: Gathered
) -> NDArray[np.bool_]:
    """Which points of a refined sweep are wanted, as far as what is known of it tells.

    Parameters
    ----------
    sweep : Sweep
    refinement : Refinement
    layout : Layout
    asked : ndarray of int
        Places in the layout of the points of the sweep's own grid.
    known : Gathered
        With the values of the variable that is looked at.

    Raises
    ------
    ValueError
        If the file has so many points that not all values can be interpolated in memory.
    """
    large = [each for each in layout.large() if not sweep.variables[each].dims]
    if large:
        raise ValueError(
            f"Sweep {sweep.name}: {layout.grid.size} points of {large[0]} are too many to refine; it must be at "
            f"most {LARGE // layout.row_bytes(large[0])}"
        )
    name, shape = refinement.variable, sweep.grid.shape
    variable = sweep.variables[name]
    values = _as_floats(known.values[name][asked], variable).reshape(shape)
    present = _is_known(known.status[asked]).reshape(shape)
    copies = layout.original[asked].reshape(shape) if sweep.key is not None else None
    return closure(values, present, refinement.levels, refinement.rule(_whole(variable.dtype)), copies).ravel()


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
            flag_meanings=f"{STATUS_MEANINGS} {INTERPOLATED_MEANING}",
        )
    return dataset if then is None else then(dataset)


def _check(sweep: Sweep, refinement: Refinement) -> None:
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
