"""Deciding what a sweep will do: what is requested, what is at hand, and what is one computation.

No function of the user's is called but `skip`, `key` and `scale`, and what is at hand is known without its values.
Of each point the plan holds a few flags; a number only where points are skipped, or are copies of others.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.compute.batch import Task
from sweeps.compute.values import rounded, scaled
from sweeps.errors import StoreError
from sweeps.fingerprint.identity import configuration, fingerprint, metadata_digest
from sweeps.grid import FAILED, PENDING, Embedding, Grid, check_counts
from sweeps.plan.declaration import Declaration
from sweeps.plan.keys import factors, representatives
from sweeps.plan.plan import PlanData, Selection
from sweeps.refine.refine import wanted_points
from sweeps.sample import check_same_draws
from sweeps.storage.existing import Existing, check_replaceable, existing
from sweeps.storage.manifest import Manifest
from sweeps.storage.merge import surveyed
from sweeps.storage.sources import DamagedError, Source
from sweeps.storage.store import Store, mark

# What the engine itself does to a value belongs to the fingerprint.
ENGINE = (rounded, scaled)
# Bytes of a point besides its results: status, error, computing time.
ROW_BYTES = 16
# What rounding and compression leave of a rounded float.
COMPRESSED = 0.6


def make_plan(
    sweep: Declaration, store: str | Path | None, fresh: bool, retry_failed: bool, strict: bool
) -> PlanData:
    """The plan of a sweep; see `Sweep.plan`."""
    if store is None:
        return _make_plan(sweep, None, (), fresh, retry_failed, strict)
    place = Store(store)
    place.check_place(sweep.name)
    # Before anything is read: what changes from now on makes the plan an old one.
    stamp, before = place.stamp(), (mark(place.file), mark(place.manifest))
    try:
        return _make_plan(sweep, place, stamp, fresh, retry_failed, strict)
    except StoreError:
        # A file that is replaced while it is read seems damaged.
        if (mark(place.file), mark(place.manifest)) != before:
            raise StoreError(f"{place.file} has changed while this was planned; plan again") from None
        raise


def _make_plan(
    sweep: Declaration,
    place: Store | None,
    stamp: tuple[Any, ...],
    fresh: bool,
    retry_failed: bool,
    strict: bool,
) -> PlanData:
    attributes: dict[str, str] = {}
    present = Existing(sweep.grid, [], {})
    if place is not None:
        own = fingerprint(sweep, ENGINE)
        attributes = {
            "identity": json.dumps(own),
            "presentation": metadata_digest(sweep),
        }
        if fresh:
            check_replaceable(place, sweep.name)
        else:
            present = existing(place, sweep.name, own) or present
            check_same_draws(place.file, present.grid, sweep.grid)

    check_size(sweep.grid)
    grid = present.grid.grown(sweep.grid)
    check_size(grid)
    attributes["configuration"] = configuration(sweep, grid)
    if sweep.remark:
        attributes["remark"] = sweep.remark
    embedding = grid.embed(sweep.grid)
    live, requested = grid.live(), np.zeros(grid.shape, dtype=bool)
    requested[embedding.index] = True
    requested = requested.ravel() & live
    manifest = Manifest(
        sweep.name,
        sweep.title or sweep.name,
        replace(grid, skip=None),
        sweep.coords,
        sweep.variables,
        representatives(sweep, grid, requested, live & ~requested),
        factors(sweep, grid, live),
        attributes,
        fresh,
    )
    if present.manifest is not None:
        manifest = _continued(present.manifest, manifest)
    selection = select(sweep, manifest, embedding, requested, present.sources, retry_failed)
    whole = (
        bool(present.sources)
        and present.manifest is None
        and not selection.todo
        and grid.size == present.grid.size
        and present.attributes.get("presentation") == attributes["presentation"]
    )
    shapes = {name: manifest.shape(name) for name in sweep.variables}
    return PlanData(
        **vars(selection),
        sweep=sweep,
        store=None if place is None else place.file,
        points=sweep.grid.size,
        skipped=sweep.grid.size - int(np.count_nonzero(requested)),
        bytes=_bytes(manifest),
        manifest=manifest,
        task=Task(sweep.name, sweep.function, sweep.constants, sweep.variables, shapes),
        embedding=embedding,
        requested=requested,
        sources=tuple(present.sources),
        stamp=stamp,
        whole=whole,
        strict=strict,
    )


def check_size(grid: Grid) -> None:
    """Refuse a grid of too many points; see `check_counts`."""
    check_counts(dict(zip(grid.dims, grid.shape, strict=True)))


def _continued(before: Manifest, manifest: Manifest) -> Manifest:
    """The manifest of a run that takes up another that was not finished, with whose parts it goes on."""
    # A run that started over and was interrupted goes on as that.
    if manifest.grid.embed(before.grid).identical:
        return replace(manifest, fresh=before.fresh, token=before.token, earlier=before.earlier)
    return replace(manifest, fresh=before.fresh, earlier={**before.earlier, before.token: before.grid})


def _bytes(manifest: Manifest) -> int:
    """Expected size of the file."""
    point = float(ROW_BYTES)
    for name, variable in manifest.variables.items():
        point += manifest.row_bytes(name) * (COMPRESSED if variable.digits is not None else 1.0)
    return int(manifest.grid.size * point)


def select(
    sweep: Declaration,
    manifest: Manifest,
    embedding: Embedding,
    requested: NDArray[np.bool_],
    sources: Sequence[Source],
    retry_failed: bool = False,
) -> Selection:
    """What is to be done, given what is at hand; of a refined sweep what that makes worth computing."""
    found = surveyed(manifest, sources)
    status, wanted = found.status, requested
    if sweep.refinement is not None:
        usable = [source for source in sources if source.name not in found.damaged]
        try:
            wanted = requested & wanted_points(sweep, sweep.refinement, manifest, embedding, status, usable)
        except DamagedError as problem:
            left = [source for source in sources if source.name != problem.part]
            again = select(sweep, manifest, embedding, requested, left, retry_failed)
            return replace(again, damaged=(*again.damaged, problem.part))
    again = (status == PENDING) | (retry_failed & (status == FAILED))
    slots, due = _slots(manifest, wanted), _slots(manifest, wanted & again)
    distinct, todo = int(np.count_nonzero(slots)), int(np.count_nonzero(due))
    seconds = found.seconds / found.computations if found.computations else math.nan
    return Selection(
        due=due,
        wanted=int(np.count_nonzero(wanted)),
        distinct=distinct,
        cached=distinct - todo,
        failed=int(np.count_nonzero(slots & (status == FAILED) & ~due)),
        todo=todo,
        seconds=todo * seconds if todo else 0.0,
        damaged=tuple(found.damaged),
        environments=tuple(found.made()[0]),
    )


def _slots(manifest: Manifest, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The representatives of the points that are flagged, as flags themselves."""
    if manifest.representative is None:
        return flags
    slots = np.zeros_like(flags)
    slots[manifest.representative[flags]] = True
    return slots
