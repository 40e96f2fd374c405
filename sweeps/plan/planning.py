"""The plan of a sweep: requested points, stored points, and points that share a computation.

Planning calls only `skip`, `key` and `scale` of the user's functions, and reads no stored value unless the sweep
is refined. A plan takes some 15 bytes for each point.
"""

import json
import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.errors import DamagedError, InputError, MixedWarning, StoreError
from sweeps.fingerprint import identity
from sweeps.fingerprint.identity import configuration, coverage, differences, fingerprint
from sweeps.fingerprint.modules import home_of
from sweeps.fingerprint.provenance import Environment, environment, mixed, source
from sweeps.grid import (
    BLOCK,
    DONE,
    FAILED,
    PENDING,
    Alignment,
    Declaration,
    Grid,
    Refinement,
    check_size,
    first_equal,
)
from sweeps.plan import adoption
from sweeps.refine.lattice import choose
from sweeps.sample import check_same_draws
from sweeps.storage.assemble import LARGE, Source, Table, rounded, scaled
from sweeps.storage.existing import PENDING_NAMES, Existing, check_replaceable, existing, extended, unfinished
from sweeps.storage.parts import Manifest
from sweeps.storage.store import Store, signature
from sweeps.task import Task

Flags = NDArray[np.bool_]
Fields = dict[str, Any]
# The functions of the engine that change a value belong to the fingerprint.
ENGINE = (rounded, scaled)
# Modules that a plan names; of more their packages.
MOST_NAMES = 4
# Bytes of a point besides its results: status, error, computing time.
ROW_BYTES = 16
# The share of a rounded float that compression leaves.
COMPRESSED = 0.6


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
    adoption: adoption.Adoption | None
    adopted: str = ""
    shared: tuple[int, int] | None = None
    # Whether only the variables that the file lacks are computed, and how many requested points follow then.
    alone: bool = False
    later: int = 0

    @property
    def extends(self) -> str:
        """The variables that the plan adds to the file of earlier results."""
        return str(self.manifest.attributes.get("extends", ""))

    @property
    def most_seconds(self) -> float:
        """Estimated time on one core; for a refined sweep, if all points were requested in the end."""
        if self.sweep.refinement is None or not self.todo:
            return self.seconds
        return self.seconds / self.todo * (self.points - self.skipped - self.cached)

    def __repr__(self) -> str:
        grid, count = self.sweep.grid, self.requested_count
        time = "unknown: there is no earlier run" if math.isnan(self.seconds) else duration(self.seconds)
        chosen = f"{count} points ({100.0 * count / self.points:.3g} %)"
        chosen += " so far; more follow where the results change" * (self.todo > 0)
        others = mixed([*self.environments, environment(self.task.libraries)])
        copies = f" computations for {count} points: equal points are computed once"
        stored = " of these are stored already" + (f", {self.failed} of them failed" if self.failed else "")
        covers, extends = [name for name in self.covers if not name.startswith("sweeps.")], self.extends
        how = "stored points are computed again, and must come out the same"
        if self.alone:
            how = "computed alone at the stored points" + f"; then {self.later} other points" * (self.later > 0)
        packages = sorted({name.partition(".")[0] for name in covers})
        rows = {
            "sweep": self.sweep.name,
            "grid": " x ".join(f"{dim} {n}" for dim, n in zip(grid.dims, grid.shape, strict=True)),
            "points": f"{self.points}",
            "skipped": f"{self.skipped}" + " points, left out of the grid" * (self.skipped > 0),
            "refined": self.sweep.refinement and chosen,
            "share": self.shared and "{} of {}".format(*self.shared),
            "distinct": f"{self.distinct}" + (copies if self.distinct < count else ""),
            "cached": f"{self.cached}" + stored * (self.cached > 0),
            "to do": f"{self.todo}",
            "file size": size(self.bytes),
            "estimated time": f"{time} on one core" if self.seconds > 0 else time,
            "at most": f"{duration(most)} for all points" if (most := self.most_seconds) > self.seconds else "",
            "adoption": str(self.adoption or self.adopted),
            "added": extends and f"{extends}; {how}",
            "file": str(self.store or ""),
            "depends on": ", ".join(covers if len(covers) <= MOST_NAMES else packages),
            "environment": others and f"{others}; stored points stay",
        }
        damaged = [("damaged", f"{name}: its points are computed again") for name in self.damaged]
        return "\n".join(f"{name:<15} {text}" for name, text in [*rows.items(), *damaged] if text)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"


def duration(seconds: float) -> str:
    """A time in s as text for a reader."""
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"


def size(count: float) -> str:
    """A number of bytes as text for a reader."""
    for unit in ("B", "kB", "MB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} GB"


def make_plan(
    sweep: Declaration, store: str | Path | None, *, fresh: bool, retry_failed: bool, strict: bool, adopt: Any
) -> dict[str, Any]:
    """The fields of the plan of a sweep; see `sweeps.Sweep.plan`."""
    if adopt is not None and (store is None or fresh):
        raise InputError("adopt: it is for stored results; give their file, and leave fresh out")
    if store is None:
        return _make_plan(sweep, None, fresh, retry_failed, strict, adopt)
    place = Store(store)
    place.check_place(sweep.name)
    before = signature(place.file), signature(place.manifest)
    try:
        fields = _make_plan(sweep, place, fresh, retry_failed, strict, adopt)
        if not fields["whole"]:
            place.check_writable()
        return fields
    except StoreError:
        # A file that is replaced while it is read seems damaged.
        if (signature(place.file), signature(place.manifest)) != before:
            raise StoreError(f"{place.file} has changed while this was planned; plan again") from None
        raise


def _make_plan(
    sweep: Declaration, place: Store | None, fresh: bool, retry_failed: bool, strict: bool, adopt: Any
) -> Fields:
    # Before anything is read: a later change makes the plan outdated.
    version = () if place is None else place.version()
    check_size(sweep.grid)
    function: Any = sweep.function
    while (inner := getattr(function, "func", None) or getattr(function, "__wrapped__", None)) is not None:
        function = inner
    attributes = {"source": source(home_of(function).partition(".")[0])}
    present, own, imported = Existing(sweep.grid, [], {}), dict[str, Any](code={}), tuple[str, ...]()
    older, lacking, alone, later = None, list[str](), False, 0
    # Without a store nothing is compared, so the function may carry anything.
    if place is not None:
        reached = coverage(sweep, ENGINE)
        own, imported = fingerprint(sweep, reached), reached.libraries
        attributes |= {"fingerprint": json.dumps(own), "metadata_digest": identity.metadata_digest(sweep)}
        if fresh:
            check_replaceable(place, sweep.name)
        else:
            older, lacking = _older(sweep, place, own, retry_failed) if adopt is None else (None, [])
            nothing = present if older is None else older._replace(sources=[], attributes={})
            present = existing(place, sweep.name, own, code=adopt is None, file=older is None) or nothing
            if older is not None:
                stored = json.loads(older.attributes["fingerprint"])
                same = not differences(stored, identity.restricted(own, stored))
                alone = same and all(name in sweep.functions for name in lacking)
            if present.manifest is not None and {*present.manifest.variables} != {
                *(lacking if alone else own["variables"])
            }:
                present = nothing  # parts of variables that were added to a file, which is gone
            check_same_draws(place.file, present.grid, sweep.grid)

    if (line := identity.recompiled(present.attributes, own)) and adopt is None:
        warnings.warn(f"{sweep.name}: {line}", MixedWarning, stacklevel=4)
    grid = present.grid.union(sweep.grid)
    check_size(grid)
    attributes["configuration"] = configuration(sweep, grid)
    if sweep.remark:
        attributes["remark"] = sweep.remark
    alignment = grid.align(sweep.grid)
    mask, requested = grid.mask(), np.zeros(grid.size, dtype=bool)
    requested[alignment()] = True
    requested &= mask
    skipped = sweep.grid.size - int(np.count_nonzero(requested))
    if older is not None:
        # What is stored is computed again with the variables that it lacks, or these alone.
        attributes["extends"], fresh = ", ".join(lacking), True
        rows, wanted = np.arange(older.grid.size), requested
        there = np.isin(older.sources[0].read("status", rows), (DONE,) if alone else (DONE, FAILED))
        if alone:
            requested = np.zeros_like(wanted)
            there &= _missing(older, lacking, rows)
        requested[grid.align(older.grid)(rows[there])] = True
        requested &= mask
        later = int(np.count_nonzero(wanted & ~requested)) if alone else 0
    elif PENDING_NAMES in present.attributes:
        attributes[PENDING_NAMES] = present.attributes[PENDING_NAMES]
    variables = {name: each for name, each in sweep.stored.items() if not alone or name in lacking}
    axes = replace(grid, skip=None), sweep.coords, variables
    points = representatives(sweep, grid, requested, mask & ~requested), factors(sweep, grid, mask)
    manifest = Manifest(sweep.name, sweep.title or sweep.name, *axes, *points, attributes, fresh)
    if (before := present.manifest) is not None:
        known = grid.align(before.grid).identical
        token, earlier = (before.token, {}) if known else (manifest.token, {before.token: before.grid})
        # A run that started over and was interrupted starts over still.
        manifest = replace(manifest, fresh=before.fresh, token=token, earlier={**before.earlier, **earlier})
    selection = select(sweep, manifest, requested, present.sources, retry_failed)
    adopted = None
    if adopt is not None and present.sources and differences(json.loads(present.attributes["fingerprint"]), own):
        adopted = adoption.choose(adopt, Table(manifest, present.sources))
    file = None if place is None else place.file
    mixture(file or sweep.name, [*selection["environments"], environment(imported)], strict)
    finished = bool(present.sources) and present.manifest is None and not selection["todo"]
    same = present.attributes.get("metadata_digest") == attributes.get("metadata_digest")
    shapes = {name: manifest.shape(name) for name in variables}
    what = (
        sweep.name,
        _functions(sweep, variables),
        sweep.constants,
        {n: sweep.variables[n] for n in variables},
        shapes,
    )
    shrunk = {name: 1.0 if each.digits is None else COMPRESSED for name, each in variables.items()}
    return selection | {
        "sweep": sweep,
        "store": file,
        "points": sweep.grid.size,
        "skipped": skipped,
        "bytes": int(grid.size * (ROW_BYTES + sum(manifest.row_bytes(name) * shrunk[name] for name in shrunk))),
        "manifest": manifest,
        "task": Task(*what, manifest.grid, sweep.rerun, imported),
        "alignment": alignment,
        "requested": requested,
        "sources": tuple(present.sources),
        "version": version,
        "covers": tuple(own["code"]),
        "whole": finished and same and grid.size == present.grid.size and adopted is None,
        "strict": strict,
        "adoption": adopted,
        "alone": alone,
        "later": later,
    }


def _older(sweep: Declaration, place: Store, own: Fields, pending: bool) -> tuple[Existing | None, list[str]]:
    """The file to which lacking variables are added, and their names, unless another run is unfinished."""
    run = unfinished(place)
    if sweep.refinement is not None or (run is not None and "extends" not in run.attributes):
        return None, []
    return extended(place, sweep.name, own, pending=pending) or (None, [])


def _missing(older: Existing, names: Sequence[str], rows: NDArray[Any]) -> Flags:
    """Rows of a file that have no value of some variables."""
    stored, missing = json.loads(older.attributes["fingerprint"])["variables"], np.zeros(len(rows), dtype=bool)
    for name in names:
        values = older.sources[0].read(name, rows).reshape(len(rows), -1) if name in stored else None
        floats = values is not None and values.dtype.kind == "f"
        missing |= np.isnan(values).all(axis=1) if values is not None and floats else True
    return missing


def _functions(sweep: Declaration, names: Iterable[str]) -> tuple[tuple[tuple[str, ...], Any], ...]:
    """The functions that compute some variables, and the names of the variables that each returns."""
    found: dict[int, tuple[list[str], Any]] = {}
    for name in names:
        function = sweep.functions.get(name, sweep.function)
        found.setdefault(id(function), ([], function))[0].append(name)
    return tuple((tuple(own), function) for own, function in found.values())


def representatives(sweep: Declaration, grid: Grid, requested: Flags, others: Flags) -> NDArray[Any] | None:
    """The point whose computation serves each point; -1 where it is skipped. None: each is its own.

    Of equal points the first requested one represents all, or the first of the others if none is requested.
    """
    kind = np.int32 if grid.size < 2**31 else np.int64
    if sweep.key is None:
        mask = requested | others
        return None if mask.all() else np.where(mask, np.arange(grid.size, dtype=kind), kind(-1))
    order = np.concatenate([np.flatnonzero(requested), np.flatnonzero(others)])
    blocks = np.array_split(order, len(order) // BLOCK + 1)
    keys = [np.concatenate(k) for k in zip(*(_key(sweep, grid, each) for each in blocks), strict=True)]
    representative = np.full(grid.size, -1, dtype=kind)
    representative[order] = order[first_equal(keys)]
    return representative


def factors(sweep: Declaration, grid: Grid, mask: NDArray[np.bool_]) -> dict[str, NDArray[np.float64]]:
    """Factors of variables at each point; where `mask` is False they are for earlier results, and not checked."""
    every: dict[str, NDArray[np.float64]] = {}
    if sweep.scale is None:
        return every
    who = f"Sweep {sweep.name}: scale returned"
    for index in grid.blocks():
        returned = sweep.scale(grid.points(index))
        if not isinstance(returned, Mapping):
            raise InputError(f"{who} {type(returned).__name__}; it must be a dict of factors")
        if missing := {v.scale for v in sweep.variables.values() if v.scale} - set(returned):
            raise InputError(f"{who} no {', '.join(sorted(missing))}")
        for name, each in returned.items():
            values = np.asarray(each)
            if values.shape != index.shape or values.dtype.kind not in "biuf":
                what = f"an array of shape {values.shape} and type {values.dtype} for {len(index)} points"
                raise InputError(f"{who} {name!r} as {what}; it must be one number for each")
            if np.any(mask[index] & ~(np.isfinite(values) & (values != 0.0))):
                raise InputError(f"{who} {name!r} with a factor that is 0 or not finite")
            every.setdefault(name, np.zeros(grid.size))[index] = values
    return every


def _key(sweep: Declaration, grid: Grid, index: NDArray[np.intp]) -> list[NDArray[Any]]:
    count, who = len(index), f"Sweep {sweep.name}: key returned"
    rows = np.asarray(sweep.key(grid.points(index))) if sweep.key is not None and count else np.zeros(0)
    if rows.ndim not in (1, 2) or len(rows) != count or rows.dtype.kind not in "biufU":
        what = f"an array of shape {rows.shape} and type {rows.dtype} for {count} points"
        raise InputError(f"{who} {what}; it must be one row of numbers or strings for each")
    if rows.dtype.kind == "f" and np.any(np.isnan(rows)):
        raise InputError(f"{who} NaN, which equals nothing")
    return [rows] if rows.ndim == 1 else list(rows.T)


def mixture(where: Any, environments: Sequence[Environment], strict: bool) -> str:
    """Report that results are of several environments, "" if they are not; `strict` refuses it."""
    different = mixed(environments)
    line = f"{where}: not all points are computed in one environment: {different}" if different else ""
    if line and strict:
        raise InputError(f"{line}; choose another path, start over (fresh=True), or leave strict out")
    return line


def select(
    sweep: Declaration, manifest: Manifest, requested: Flags, sources: Sequence[Source], retry_failed: bool = False
) -> dict[str, Any]:
    """The first fields of a plan: the computations to do, given the stored results."""
    table, chosen = Table(manifest, sources), requested
    if sweep.refinement is not None:
        try:
            chosen = requested & _refined(sweep, sweep.refinement, table)
        except DamagedError as problem:
            fields = select(sweep, manifest, requested, table.without(problem.part), retry_failed)
            return fields | {"damaged": (*table.damaged, problem.part, *fields["damaged"])}
    status = table.status
    again = chosen & ((status == PENDING) | (retry_failed & (status == FAILED)))
    computations, due = chosen, again
    if (representative := manifest.representative) is not None:
        # Flags of the representatives of flagged points.
        computations, due = np.zeros((2, len(status)), dtype=bool)
        computations[representative[chosen]], due[representative[again]] = True, True
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
    manifest, name = table.manifest, refinement.variable
    row = manifest.row_bytes(name)
    if row * manifest.grid.size > LARGE:
        many = f"{manifest.grid.size} points of {name} are too many to refine"
        raise InputError(f"Sweep {sweep.name}: {many}; it must be at most {LARGE // row}")
    values = table.values(name, slice(None)).astype(float)
    if refinement.whole:
        values[values == manifest.variables[name].missing] = np.nan
    own, shape = manifest.grid.align(sweep.grid)(), sweep.grid.shape
    # Of failed and skipped points the value is NaN.
    known = table.status[own] != PENDING
    first = None if sweep.key is None else manifest.representative
    copied = None if first is None else first[own].reshape(shape)
    chosen = np.zeros(len(values), dtype=bool)
    levels, lattice = refinement.levels, (values[own].reshape(shape), known.reshape(shape))
    chosen[own] = choose(*lattice, levels, refinement, copied).points.ravel()
    return chosen
