"""Deciding what a sweep will do: what is asked, what is at hand, what is one computation, and how it is cut."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from sweeps.assemble import Source, gather, scaled
from sweeps.batch import FAILED, PENDING, Table, Work, rounded
from sweeps.fingerprint.identity import configuration, fingerprint, metadata_digest
from sweeps.grid import Axis, Grid, Points
from sweeps.keys import Index, key_columns
from sweeps.layout import Layout
from sweeps.plan import Plan
from sweeps.refine import wanted_points
from sweeps.store import Kept, Store, check_replaceable, kept

if TYPE_CHECKING:
    from sweeps.sweep import Sweep

# A batch long enough to hide its own cost, short enough to spread and to show progress, small enough to hold.
BATCH_SECONDS = 1.0
BATCH_BYTES = 12e6
# A short sweep is cut finer, so that all workers have something, but not below this.
LEAST_BATCHES, SHORTEST = 16, 0.02
# Towards the end a batch is this share of what is left, down to so long, s: workers end at the same time.
LAST_SHARE, LAST_SECONDS = 0.125, 0.25
# Probes: so many points each, at these places of the work, while they are expected to take less than this, s.
PROBE_SIZES, PROBE_SECONDS = (1, 1, 8, 8, 8, 8, 8, 8), 0.15
PROBE_PLACES = (0.0, 0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875)
# What the engine itself does to a value belongs to the fingerprint.
ENGINE = (rounded, scaled)
# Bytes of a point besides its results: status, error, computing time.
ROW_BYTES = 16
# What rounding and compression leave of a rounded float.
COMPRESSED = 0.6


def make_plan(sweep: Sweep, store: str | Path | None, fresh: bool, retry_failed: bool) -> Plan:
    """The plan of a sweep; see `Sweep.plan`."""
    place = None if store is None else Store(store)
    attributes: dict[str, str] = {}
    present: Kept | None = None
    if place is not None:
        place.check_place(sweep.name)
        told = fingerprint(sweep, ENGINE)
        attributes = {"identity": json.dumps(told), "presentation": metadata_digest(sweep)}
        if fresh:
            check_replaceable(place, sweep.name)
        else:
            present = kept(place, sweep.name, told)
            # A run that started over and was interrupted goes on as that.
            fresh = present is not None and present.fresh
    stamp = () if place is None else place.stamp()

    grid = sweep.grid if present is None else _grown(present.grid, sweep.grid)
    attributes["configuration"] = configuration(sweep, grid)
    asked = grid.place(sweep.grid)
    skipped = sweep.grid.skipped(sweep.grid.points())
    wanted = asked[~skipped]
    sources: list[Source] = [] if present is None else present.sources
    layout = _layout(sweep, grid, wanted, attributes, fresh)
    refinement = sweep.refinement
    unseen = [name for name in sweep.variables if refinement is None or name != refinement.variable]
    known = gather(layout, sources, unseen)
    status = known.status
    if refinement is not None:
        wanted = asked[wanted_points(sweep, refinement, layout, asked, known) & ~skipped]

    # As flags of all points: np.unique takes a second for a million.
    slots, due = np.zeros(grid.size, dtype=bool), np.zeros(grid.size, dtype=bool)
    slots[layout.original[wanted]] = True
    again = (PENDING, FAILED) if retry_failed else (PENDING,)
    due[layout.original[wanted[np.isin(status[wanted], again)]]] = True
    distinct = int(np.count_nonzero(slots))
    todo = _in_order(sweep, layout, np.flatnonzero(due))
    work = Work(
        sweep.name,
        sweep.function,
        sweep.constants,
        sweep.variables,
        {name: layout.shape(name) for name in sweep.variables},
    )
    row = sum(layout.row_bytes(name) for name in sweep.variables) + ROW_BYTES
    probes, seconds = _probe(work, layout, todo, row, sweep.at_once)
    probed = np.concatenate([np.zeros(0, dtype=np.intp), *(index for index, _ in probes)])
    batches = make_batches(todo[~np.isin(todo, probed)], seconds, row, sweep.at_once)
    longest = max((len(batch) for batch in batches), default=0)
    whole = (
        present is not None
        and present.finished
        and not len(todo)
        and grid.size == present.grid.size
        and present.attributes.get("presentation") == attributes["presentation"]
    )
    return Plan(
        sweep=sweep,
        store=None if place is None else place.file,
        points=sweep.grid.size,
        skipped=int(skipped.sum()),
        wanted=len(wanted),
        distinct=distinct,
        cached=distinct - len(todo),
        failed=int(np.count_nonzero(status[slots & ~due] == FAILED)),
        todo=len(todo),
        batches=batches,
        original=layout.original,
        bytes=_bytes(sweep, layout),
        batch_bytes=longest * row,
        seconds=0.0 if not len(todo) else seconds * len(todo),
        layout=layout,
        work=work,
        probes=tuple(table for _, table in probes),
        asked=asked,
        sources=tuple(sources),
        stamp=stamp,
        whole=whole,
        damaged=tuple(known.damaged),
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


def _layout(sweep: Sweep, grid: Grid, wanted: NDArray[np.intp], attributes: dict[str, str], fresh: bool) -> Layout:
    """The file that will be: which point is computed in each one's stead, and what it is multiplied by."""
    rest = np.ones(grid.size, dtype=bool)
    rest[wanted] = False
    others = np.flatnonzero(rest)
    others = others[~grid.skipped(grid.points(others))] if len(others) else others
    # Of equal points the first one asked for is computed.
    live = np.concatenate([wanted, others])
    points = grid.points(live)
    original = np.full(grid.size, -1, dtype=np.intp)
    original[live] = live
    key = None
    if sweep.key is not None:
        columns = key_columns(sweep, points)
        original[live] = live[Index(columns).first()]
        key = [_scattered(column, live, grid.size) for column in columns]
    factors = {name: _scattered(each, live, grid.size) for name, each in _factors(sweep, points).items()}
    zipped = [group for group in grid.groups if len(group) > 1]
    return Layout(
        sweep.name,
        sweep.title or sweep.name,
        Grid(grid.axes, zipped),
        sweep.coords,
        sweep.variables,
        original,
        key,
        factors,
        attributes,
        fresh,
    )


def _factors(sweep: Sweep, points: Points) -> dict[str, NDArray[np.float64]]:
    """What variables are multiplied by, one number a point."""
    given = {} if sweep.scale is None else sweep.scale(points)
    count = len(next(iter(points.values())))
    if not isinstance(given, Mapping):
        raise ValueError(f"Sweep {sweep.name}: scale gave {type(given).__name__}; it must give a dict of factors")
    missing = {v.scale for v in sweep.variables.values() if v.scale} - set(given)
    if missing:
        raise ValueError(f"Sweep {sweep.name}: scale gives no {', '.join(sorted(missing))}")
    factors = {}
    for name, each in given.items():
        values = np.asarray(each)
        if values.shape != (count,) or values.dtype.kind not in "biuf":
            raise ValueError(
                f"Sweep {sweep.name}: scale gave {name!r} as an array of shape {values.shape} and type "
                f"{values.dtype} for {count} points; it must give one number for each"
            )
        factors[name] = values.astype(float)
        if not np.all(np.isfinite(factors[name])):
            raise ValueError(f"Sweep {sweep.name}: scale gave {name!r} with a factor that is not finite")
    return factors


def _scattered(values: NDArray[Any], at: NDArray[np.intp], size: int) -> NDArray[Any]:
    """An array of `size` with the values where they belong."""
    whole = np.zeros(size, dtype=values.dtype)
    whole[at] = values
    return whole


def _in_order(sweep: Sweep, layout: Layout, todo: NDArray[np.intp]) -> NDArray[np.intp]:
    """Neighbours that share what is costly come together."""
    if not sweep.together or not len(todo):
        return todo
    points = layout.grid.points(todo)
    order = np.lexsort([todo, *(points[name] for name in reversed(sweep.together))])
    return todo[order]


def make_batches(
    todo: NDArray[np.intp], seconds: float, row_bytes: float = 0.0, at_once: int = 1
) -> tuple[NDArray[np.intp], ...]:
    """Cut the work into runs of neighbouring points, which share what they can share."""
    if not len(todo):
        return ()
    fitting = BATCH_SECONDS / seconds if seconds > 0.0 else math.inf
    room = max(1.0, BATCH_BYTES / row_bytes) if row_bytes > 0.0 else math.inf
    # NaN, where nothing is known of the time, cuts as if it were long.
    pieces = (
        LEAST_BATCHES if not seconds * len(todo) < LEAST_BATCHES * SHORTEST else seconds * len(todo) / SHORTEST
    )
    together = min(float(at_once), room)
    size = int(max(1.0, together, min(fitting, room, math.ceil(len(todo) / max(pieces, 1)))))
    least = size if not seconds * size > LAST_SECONDS else int(max(1.0, together, LAST_SECONDS / seconds))
    batches = []
    while len(todo):
        count = min(size, max(least, math.ceil(LAST_SHARE * len(todo))))
        batches.append(todo[:count])
        todo = todo[count:]
    return tuple(batches)


def _probe(
    work: Work, layout: Layout, todo: NDArray[np.intp], row_bytes: int, at_once: int
) -> tuple[list[tuple[NDArray[np.intp], Table]], float]:
    """A few points computed and timed, and the seconds a point takes; NaN if none tells.

    The first probe pays for compilation and caches and tells nothing, unless it is all there is to do. The
    results are kept by the run.
    """
    probes: list[tuple[NDArray[np.intp], Table]] = []
    free = np.ones(len(todo), dtype=bool)
    sizes = [size if size == 1 else max(size, at_once) for size in PROBE_SIZES]
    timed = {size: [0.0, 0] for size in sizes}
    spent, seconds = 0.0, math.nan if len(todo) else 0.0
    # Spread over the work: costs may differ from end to end.
    for size, share in zip(sizes, PROBE_PLACES, strict=False):
        dear = spent + seconds * size > PROBE_SECONDS or row_bytes * size > BATCH_BYTES
        if not free.any() or (len(probes) > 1 and (dear or math.isnan(seconds))):
            break
        start = int(share * max(len(todo) - size, 0))
        chosen = start + np.flatnonzero(free[start : start + size])
        chosen = chosen if len(chosen) else np.flatnonzero(free)[:size]
        free[chosen] = False
        index = todo[chosen]
        begin = time.perf_counter()
        # As in a run: the bits of a result may depend on the number of BLAS threads.
        with threadpool_limits(1, user_api="blas"):
            table = work.table(layout.grid.points(index), layout.slot_key(index))
        taken = time.perf_counter() - begin
        if (probes or len(todo) == 1) and table.failed < len(table):
            spent += taken
            # Larger ones tell more of what a batch costs.
            total = timed[size]
            total[0], total[1] = total[0] + taken, total[1] + len(index)
            seconds = total[0] / total[1]
            if size < at_once:
                # Until it is known better: in company they cost twice what one costs alone.
                seconds *= min(2.0 / at_once, 1.0)
        probes.append((index, table))
    return probes, seconds


def _bytes(sweep: Sweep, layout: Layout) -> int:
    """Expected size of the file."""
    point = float(ROW_BYTES)
    for name, variable in sweep.variables.items():
        point += layout.row_bytes(name) * (COMPRESSED if variable.digits is not None else 1.0)
    return int(layout.grid.size * point)
