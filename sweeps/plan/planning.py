"""The plan of a sweep: which points are requested, which are stored already, and which share a computation.

Planning calls no function of the user's but `skip`, `key` and `scale`, and reads no stored value unless the sweep
is refined. A plan keeps some 15 bytes for each point.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.declaration import Declaration, Refinement
from sweeps.errors import DamagedError, InputError, StoreError
from sweeps.fingerprint.code import check_loaded
from sweeps.fingerprint.identity import configuration, fingerprint, functions_of, libraries_of, metadata_digest
from sweeps.fingerprint.provenance import Environment, environment, mixed, source
from sweeps.grid import DONE, FAILED, PENDING, SKIPPED, Alignment, check_size
from sweeps.plan.keys import factors, representatives
from sweeps.refine.refine import requested_points
from sweeps.sample import check_same_draws
from sweeps.storage.assemble import LARGE, Source, Table, rounded, scaled
from sweeps.storage.existing import Existing, check_replaceable, existing
from sweeps.storage.parts import Manifest
from sweeps.storage.store import Store, signature
from sweeps.task import Task

Flags = NDArray[np.bool_]
# The functions of the engine that change a value belong to the fingerprint.
ENGINE = (rounded, scaled)
# Bytes of a point besides its results: status, error, computing time.
ROW_BYTES = 16
# The share of a rounded float that compression leaves.
COMPRESSED = 0.6
# `Plan.timed` computes batches of these sizes at these places of the work, until so many s have passed.
SIZES, PLACES = (1, 1, 8, 8, 8, 8, 8, 8), (0.0, 0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875)
SECONDS = 0.15


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PlanData:
    """The fields of a `sweeps.Plan`, which documents the public ones; of a refined sweep those of its next pass.

    Flags are of the file's points: `due` where one is computed, for all its copies; `requested` at the sweep's own
    that are not skipped, whose positions `alignment` has. `sources` and `environments` are those of the stored
    results, `version` is the state of the store, and `whole` says whether the file is complete already.
    """

    due: Flags
    requested_count: int
    distinct: int
    cached: int
    failed: int
    todo: int
    seconds: float
    damaged: tuple[str, ...]
    environments: tuple[dict[str, str], ...]
    sweep: Declaration
    store: Path | None
    points: int
    skipped: int
    bytes: int
    manifest: Manifest
    task: Task
    alignment: Alignment
    requested: Flags
    sources: tuple[Source, ...]
    version: tuple[Any, ...]
    covers: tuple[str, ...]
    whole: bool
    strict: bool

    @property
    def most_seconds(self) -> float:
        """Estimated time on one core; of a refined sweep if every point were requested in the end."""
        if self.sweep.refinement is None or not self.todo:
            return self.seconds
        return self.seconds / self.todo * (self.points - self.skipped - self.cached)

    def __repr__(self) -> str:
        time = "unknown: there is no earlier run" if math.isnan(self.seconds) else duration(self.seconds)
        shape = " x ".join(f"{d} {n}" for d, n in zip(self.sweep.grid.dims, self.sweep.grid.shape, strict=True))
        chosen = f"to {self.requested_count} points ({100.0 * self.requested_count / self.points:.3g} %)"
        chosen += " so far; their results may request more" * (self.todo > 0)
        others = mixed([*self.environments, environment(self.task.libraries)])
        rows = [
            ("sweep", self.sweep.name),
            ("grid", shape),
            ("points", f"{self.points}"),
            ("skipped", f"{self.skipped}"),
            ("refined", self.sweep.refinement and chosen),
            ("distinct", f"{self.distinct}"),
            ("cached", f"{self.cached}" + (f", {self.failed} of them failed" if self.failed else "")),
            ("to do", f"{self.todo}"),
            ("file size", size(self.bytes)),
            ("estimated time", f"{time} on one core" if self.seconds > 0 else time),
            ("at most", f"{duration(most)} for all points" if (most := self.most_seconds) > self.seconds else ""),
            ("file", str(self.store or "")),
            ("depends on", ", ".join(name for name in self.covers if not name.startswith("sweeps."))),
            ("environment", others and f"{others}; stored points stay"),
            *(("damaged", f"{name}: its points are computed again") for name in self.damaged),
        ]
        return "\n".join(f"{name:<15} {text}" for name, text in rows if text)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"


def duration(seconds: float) -> str:
    """Seconds as text for a reader."""
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"


def size(count: float) -> str:
    """Bytes as text for a reader."""
    for unit in ("B", "kB", "MB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} GB"


def make_plan(
    sweep: Declaration, store: str | Path | None, *, fresh: bool, retry_failed: bool, strict: bool
) -> dict[str, Any]:
    """The fields of the plan of a sweep; see `sweeps.Sweep.plan`."""
    if store is None:
        return _make_plan(sweep, None, fresh, retry_failed, strict)
    place = Store(store)
    place.check_place(sweep.name)
    before = signature(place.file), signature(place.manifest)
    try:
        return _make_plan(sweep, place, fresh, retry_failed, strict)
    except StoreError:
        # A file that is replaced while it is read seems damaged.
        if (signature(place.file), signature(place.manifest)) != before:
            raise StoreError(f"{place.file} has changed while this was planned; plan again") from None
        raise


def _make_plan(
    sweep: Declaration, place: Store | None, fresh: bool, retry_failed: bool, strict: bool
) -> dict[str, Any]:
    # Before anything is read: a later change makes the plan outdated.
    version = () if place is None else place.version()
    check_size(sweep.grid)
    attributes = {"source": source(_package(sweep))}
    present, own, libraries = Existing(sweep.grid, [], {}), dict[str, Any](code={}), tuple[str, ...]()
    # Without a store nothing is compared, so the function may carry anything.
    with suppress(*([InputError] if place is None else [])):
        libraries = tuple(libraries_of(sweep))
    if place is not None:
        check_loaded(functions_of(sweep), sweep.code)
        own = fingerprint(sweep, ENGINE)
        attributes |= {"fingerprint": json.dumps(own), "metadata_digest": metadata_digest(sweep)}
        if fresh:
            check_replaceable(place, sweep.name)
        else:
            present = existing(place, sweep.name, own) or present
            check_same_draws(place.file, present.grid, sweep.grid)

    grid = present.grid.union(sweep.grid)
    check_size(grid)
    attributes["configuration"] = configuration(sweep, grid)
    if sweep.remark:
        attributes["remark"] = sweep.remark
    alignment = grid.align(sweep.grid)
    mask, requested = grid.mask(), np.zeros(grid.shape, dtype=bool)
    requested[alignment.index] = True
    requested = requested.ravel() & mask
    manifest = Manifest(
        sweep.name,
        sweep.title or sweep.name,
        replace(grid, skip=None),
        sweep.coords,
        sweep.stored,
        representatives(sweep, grid, requested, mask & ~requested),
        factors(sweep, grid, mask),
        attributes,
        fresh,
    )
    if (before := present.manifest) is not None:
        known = grid.align(before.grid).identical
        token, earlier = (before.token, {}) if known else (manifest.token, {before.token: before.grid})
        # A run that started over and was interrupted starts over still.
        manifest = replace(manifest, fresh=before.fresh, token=token, earlier={**before.earlier, **earlier})
    selection = select(sweep, manifest, requested, present.sources, retry_failed)
    mixture(place, sweep, [*selection["environments"], environment(libraries)], strict)
    finished = bool(present.sources) and present.manifest is None and not selection["todo"]
    same = present.attributes.get("metadata_digest") == attributes.get("metadata_digest")
    shapes = {name: tuple(len(sweep.coords[dim]) for dim in each.dims) for name, each in sweep.variables.items()}
    what = sweep.name, sweep.function, sweep.constants, sweep.variables
    shrunk = {name: 1.0 if each.digits is None else COMPRESSED for name, each in sweep.stored.items()}
    return selection | {
        "sweep": sweep,
        "store": None if place is None else place.file,
        "points": sweep.grid.size,
        "skipped": sweep.grid.size - int(np.count_nonzero(requested)),
        "bytes": int(grid.size * (ROW_BYTES + sum(manifest.row_bytes(name) * shrunk[name] for name in shrunk))),
        "manifest": manifest,
        "task": Task(*what, shapes, manifest.grid, sweep.rerun, libraries),
        "alignment": alignment,
        "requested": requested,
        "sources": tuple(present.sources),
        "version": version,
        "covers": tuple(own["code"]),
        "whole": finished and same and grid.size == present.grid.size,
        "strict": strict,
    }


def mixture(place: Store | None, sweep: Declaration, environments: Sequence[Environment], strict: bool) -> str:
    """Report that the results of a sweep are of several environments, "" if not; `strict` refuses it."""
    if not (different := mixed(environments)):
        return ""
    where = sweep.name if place is None else place.file
    line = f"{where}: not all points are computed in one environment: {different}"
    if strict:
        raise InputError(f"{line}; choose another folder, start over with fresh, or leave strict out")
    return line


def _package(sweep: Declaration) -> str:
    """The top-level package of a sweep's function, or the name of its script."""
    function: Any = sweep.function
    while hasattr(function, "func") or hasattr(function, "__wrapped__"):
        function = function.func if hasattr(function, "func") else function.__wrapped__
    name = str(getattr(function, "__module__", type(function).__module__)).partition(".")[0]
    main = getattr(sys.modules["__main__"], "__file__", None) if name == "__main__" else None
    return Path(main).stem if main else name


def select(
    sweep: Declaration, manifest: Manifest, requested: Flags, sources: Sequence[Source], retry_failed: bool = False
) -> dict[str, Any]:
    """The first fields of a plan: the computations to do, given the stored results."""
    table, chosen = Table(manifest, sources), requested
    if sweep.refinement is not None:
        try:
            chosen = requested & _refined(sweep, sweep.refinement, table)
        except DamagedError as problem:
            left = [source for source in table.used() if source.name != problem.part]
            fields = select(sweep, manifest, requested, left, retry_failed)
            return fields | {"damaged": (*table.damaged, problem.part, *fields["damaged"])}
    status = table.status
    again = (status == PENDING) | (retry_failed & (status == FAILED))
    computations, due = _computations(manifest, chosen), _computations(manifest, chosen & again)
    distinct, todo = int(np.count_nonzero(computations)), int(np.count_nonzero(due))
    mean = table.seconds / table.computations if table.computations else math.nan
    return {
        "due": due,
        "requested_count": int(np.count_nonzero(chosen)),
        "distinct": distinct,
        "cached": distinct - todo,
        "failed": int(np.count_nonzero(computations & (status == FAILED) & ~due)),
        "todo": todo,
        "seconds": todo * mean if todo else 0.0,
        "damaged": tuple(table.damaged),
        "environments": tuple(table.environments),
    }


def _refined(sweep: Declaration, refinement: Refinement, table: Table) -> Flags:
    """The points of the file that a refined sweep requests, by the results so far."""
    manifest = table.manifest
    name, shape = refinement.variable, manifest.grid.shape
    if manifest.row_bytes(name) * manifest.grid.size > LARGE:
        raise InputError(
            f"Sweep {sweep.name}: {manifest.grid.size} points of {name} are too many to refine; it must be at "
            f"most {LARGE // manifest.row_bytes(name)}"
        )
    values = table.values(name, slice(None)).astype(float)
    if refinement.whole:
        values[values == manifest.variables[name].missing] = np.nan
    known = np.isin(table.status, (DONE, FAILED, SKIPPED))
    copies = None if sweep.key is None else manifest.representative
    own = manifest.grid.align(sweep.grid).index
    values, known, chosen = values.reshape(shape)[own], known.reshape(shape)[own], np.zeros(shape, dtype=bool)
    chosen[own] = requested_points(
        refinement, values, known, copies if copies is None else copies.reshape(shape)[own]
    )
    return chosen.ravel()


def _computations(manifest: Manifest, flags: Flags) -> Flags:
    """Flags of the representatives of flagged points."""
    if manifest.representative is None:
        return flags
    computations = np.zeros_like(flags)
    computations[manifest.representative[flags]] = True
    return computations


def timed(plan: PlanData) -> float:
    """The estimated time of a plan on one core, s, by computing some of its points; NaN if all of them fail.

    The results are thrown away. The first batch pays for compilation and caches; it counts only if it is all.
    """
    seconds, spent, due = math.nan if plan.todo else 0.0, 0.0, np.flatnonzero(plan.due)
    # Spread over the work, since costs may differ from end to end.
    for number, (count, place) in enumerate(zip(SIZES, PLACES, strict=True)):
        points = due[int(place * plan.todo) :][: count * plan.sweep.batch_multiple]
        if not len(points) or spent > SECONDS:
            break
        result = plan.task.compute(plan.manifest.grid.points(points))
        taken = float(result.wall_time.sum())
        spent += taken if number else 0.0
        if (number or plan.todo == 1) and len(result.failures) < len(result):
            # The last batch is the largest, and closest to those of a run.
            seconds = taken / len(points) * plan.todo
    return seconds
