"""Deciding what a sweep will do: what is requested, what is at hand, and what is one computation.

No function of the user's is called but `skip`, `key` and `scale`, and what is at hand is known without its values.
Of each point the plan holds a few flags; a number only where points are skipped, or are copies of others.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.compute.batch import Task
from sweeps.compute.values import rounded, scaled
from sweeps.fingerprint.identity import configuration, fingerprint, metadata_digest
from sweeps.fingerprint.provenance import versions, versions_differing
from sweeps.grid import FAILED, PENDING, Axis, Columns, Embedding, Grid, Index
from sweeps.plan.declaration import Declaration
from sweeps.plan.keys import factors, key_columns
from sweeps.plan.plan import PlanData, Selection
from sweeps.refine.refine import wanted_points
from sweeps.storage.existing import Existing, check_replaceable, existing
from sweeps.storage.manifest import Manifest
from sweeps.storage.merge import gather, surveyed
from sweeps.storage.sources import Source
from sweeps.storage.store import Store

# What the engine itself does to a value belongs to the fingerprint.
ENGINE = (rounded, scaled)
# Bytes of a point besides its results: status, error, computing time.
ROW_BYTES = 16
# What rounding and compression leave of a rounded float.
COMPRESSED = 0.6
# Points that are made at a time, where they are only looked at.
BLOCK = 1 << 18


def make_plan(sweep: Declaration, store: str | Path | None, fresh: bool, retry_failed: bool) -> PlanData:
    """The plan of a sweep; see `Sweep.plan`."""
    place = None if store is None else Store(store)
    attributes: dict[str, str] = {}
    present: Existing | None = None
    if place is not None:
        place.check_place(sweep.name)
        own = fingerprint(sweep, ENGINE)
        attributes = {
            "identity": json.dumps(own),
            "presentation": metadata_digest(sweep),
            "libraries": json.dumps(versions(own["sources"])),
        }
        if fresh:
            check_replaceable(place, sweep.name)
        else:
            present = existing(place, sweep.name, own)
            # A run that started over and was interrupted goes on as that.
            fresh = present is not None and present.manifest is not None and present.manifest.fresh
    stamp = () if place is None else place.stamp()

    grid = sweep.grid if present is None else _grown(present.grid, sweep.grid)
    attributes["configuration"] = configuration(sweep, grid)
    embedding = grid.embed(sweep.grid)
    requested = _requested(sweep.grid, grid, embedding)
    sources = () if present is None else tuple(present.sources)
    manifest = _manifest(sweep, grid, requested, attributes, fresh, None if present is None else present.manifest)
    selection = select(sweep, manifest, embedding, requested, sources, retry_failed)
    whole = (
        present is not None
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
        bytes=_bytes(sweep, manifest),
        manifest=manifest,
        task=Task(sweep.name, sweep.function, sweep.constants, sweep.variables, shapes),
        embedding=embedding,
        requested=requested,
        sources=sources,
        stamp=stamp,
        whole=whole,
        versions="" if present is None else _versions(present.attributes, attributes),
    )


def _versions(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Which libraries have other versions than those that made what is at hand."""
    stored = json.loads(before.get("libraries", "{}"))
    return versions_differing(stored, json.loads(now["libraries"])) if stored else ""


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
        values = gather(manifest, usable, [sweep.refinement.variable], reasons=False)
        at = embedding(np.arange(sweep.grid.size))
        chosen = wanted_points(
            sweep.name,
            sweep.refinement,
            manifest,
            values.values[sweep.refinement.variable][at].reshape(sweep.grid.shape),
            status[at].reshape(sweep.grid.shape),
            None if sweep.key is None else manifest.representatives(at).reshape(sweep.grid.shape),
        )
        wanted = np.zeros_like(requested)
        wanted[at[chosen.ravel()]] = True
        wanted &= requested
    again = status == PENDING
    if retry_failed:
        again |= status == FAILED
    slots = _slots(manifest, wanted)
    due = _slots(manifest, wanted & again)
    distinct, todo = int(np.count_nonzero(slots)), int(np.count_nonzero(due))
    failed = int(np.count_nonzero(slots & (status == FAILED) & ~due))
    seconds = math.nan if todo else 0.0
    if todo and found.computations:
        seconds = todo * found.seconds / found.computations
    return Selection(
        due=due,
        wanted=int(np.count_nonzero(wanted)),
        distinct=distinct,
        cached=distinct - todo,
        failed=failed,
        todo=todo,
        seconds=seconds,
        damaged=tuple(found.damaged),
    )


def _slots(manifest: Manifest, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The representatives of the points that are flagged, as flags themselves."""
    if manifest.representative is None:
        return flags
    slots = np.zeros_like(flags)
    slots[manifest.representative[flags]] = True
    return slots


def _blocks(size: int) -> Iterator[NDArray[np.intp]]:
    for begin in range(0, size, BLOCK):
        yield np.arange(begin, min(begin + BLOCK, size))


def _requested(own: Grid, grid: Grid, embedding: Embedding) -> NDArray[np.bool_]:
    """Flags, of the file's points, those of the sweep's own that are not skipped."""
    if embedding.whole and own.skip is None:
        return np.ones(grid.size, dtype=bool)
    flags = np.zeros(grid.size, dtype=bool)
    for points in _blocks(own.size):
        flags[embedding(points[~own.skipped(own.points(points))])] = True
    return flags


def _manifest(
    sweep: Declaration,
    grid: Grid,
    requested: NDArray[np.bool_],
    attributes: dict[str, str],
    fresh: bool,
    before: Manifest | None,
) -> Manifest:
    """The file that will be: which point is computed in each one's stead, and what it is multiplied by."""
    live = requested.copy()
    if not requested.all():
        for points in _blocks(grid.size):
            others = points[~requested[points]]
            if len(others):
                live[others] = ~grid.skipped(grid.points(others))
    representative: NDArray[Any] | None = None
    multiplied: dict[str, NDArray[np.float64]] = {}
    kind = np.int32 if grid.size < 2**31 else np.int64
    if sweep.key is not None or sweep.scale is not None:
        # Of equal points the first one requested is computed.
        order = np.concatenate([np.flatnonzero(requested), np.flatnonzero(live & ~requested)])
        parts: list[Columns] = []
        for block in np.array_split(order, len(order) // BLOCK + 1):
            values = grid.points(block)
            if sweep.key is not None:
                parts.append(key_columns(sweep, values))
            for name, each in factors(sweep, values).items():
                multiplied.setdefault(name, np.zeros(grid.size))[block] = each
        if sweep.key is not None:
            columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
            del parts
            representative = np.full(grid.size, -1, dtype=kind)
            representative[order] = order[Index(columns).first()] if len(order) else order
    if representative is None and not live.all():
        representative = np.where(live, np.arange(grid.size, dtype=kind), kind(-1))
    tokens: dict[str, Any] = {}
    if before is not None:
        same = before.grid.embed(grid).whole and grid.embed(before.grid).whole
        tokens = (
            {"token": before.token, "earlier": before.earlier}
            if same
            else {"earlier": {**before.earlier, before.token: before.grid}}
        )
    return Manifest(
        sweep.name,
        sweep.title or sweep.name,
        Grid(grid.axes, [group for group in grid.groups if len(group) > 1]),
        sweep.coords,
        sweep.variables,
        representative,
        multiplied,
        attributes,
        fresh,
        **tokens,
    )


def _grown(present: Grid, asked: Grid) -> Grid:
    """The grid of the file: what is present and what is asked, described as it is now."""
    grown = present.grown(asked)
    axes = {
        name: Axis(_as_asked(grown.axes[name].values, axis.values.dtype), axis.units, axis.long_name)
        for name, axis in asked.axes.items()
    }
    return Grid(axes, [group for group in asked.groups if len(group) > 1], asked.skip)


def _as_asked(values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """In the type that was asked for, if it holds them all: a file has no flags, and may have whole numbers."""
    same = values.astype(dtype)
    return same if np.array_equal(same, values) else values.astype(np.promote_types(values.dtype, dtype))


def _bytes(sweep: Declaration, manifest: Manifest) -> int:
    """Expected size of the file."""
    point = float(ROW_BYTES)
    for name, variable in sweep.variables.items():
        point += manifest.row_bytes(name) * (COMPRESSED if variable.digits is not None else 1.0)
    return int(manifest.grid.size * point)
