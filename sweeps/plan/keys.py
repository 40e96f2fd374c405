"""Which points share one computation, and the factors of its results at each of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.declaration import Declaration
from sweeps.errors import InputError
from sweeps.grid import BLOCK, Columns, Grid, Points, first_equal


def representatives(
    sweep: Declaration, grid: Grid, requested: NDArray[np.bool_], others: NDArray[np.bool_]
) -> NDArray[Any] | None:
    """The point whose computation serves each point; -1 where it is skipped. None: each is its own.

    Of equal points the first requested one represents all, or the first of the others if none is requested.
    """
    kind = np.int32 if grid.size < 2**31 else np.int64
    if sweep.key is None:
        mask = requested | others
        return None if mask.all() else np.where(mask, np.arange(grid.size, dtype=kind), kind(-1))
    order = np.concatenate([np.flatnonzero(requested), np.flatnonzero(others)])
    keys = [
        np.concatenate(parts) for parts in zip(*(_key(sweep, p) for _, p in _blocks(grid, order)), strict=True)
    ]
    representative = np.full(grid.size, -1, dtype=kind)
    representative[order] = order[first_equal(keys)]
    return representative


def factors(sweep: Declaration, grid: Grid, mask: NDArray[np.bool_]) -> dict[str, NDArray[np.float64]]:
    """Factors of variables at each point; where `mask` is False they are for earlier results, and not checked."""
    every: dict[str, NDArray[np.float64]] = {}
    if sweep.scale is None:
        return every
    who = f"Sweep {sweep.name}: scale returned"
    for index, points in _blocks(grid, np.arange(grid.size)):
        returned = sweep.scale(points)
        if not isinstance(returned, Mapping):
            raise InputError(f"{who} {type(returned).__name__}; it must be a dict of factors")
        if missing := {v.scale for v in sweep.variables.values() if v.scale} - set(returned):
            raise InputError(f"{who} no {', '.join(sorted(missing))}")
        for name, each in returned.items():
            values = np.asarray(each)
            if values.shape != index.shape or values.dtype.kind not in "biuf":
                raise InputError(
                    f"{who} {name!r} as an array of shape {values.shape} and type {values.dtype} for "
                    f"{len(index)} points; it must be one number for each"
                )
            if np.any(mask[index] & ~(np.isfinite(values) & (values != 0.0))):
                raise InputError(f"{who} {name!r} with a factor that is 0 or not finite")
            every.setdefault(name, np.zeros(grid.size))[index] = values
    return every


def _blocks(grid: Grid, index: NDArray[np.intp]) -> Iterator[tuple[NDArray[np.intp], Points]]:
    for block in np.array_split(index, len(index) // BLOCK + 1):
        yield block, grid.points(block)


def _key(sweep: Declaration, points: Points) -> Columns:
    """The key of each point, by columns."""
    count = len(next(iter(points.values())))
    rows = np.asarray(sweep.key(points)) if sweep.key is not None and count else np.zeros(0)
    if rows.ndim not in (1, 2) or len(rows) != count or rows.dtype.kind not in "biufU":
        raise InputError(
            f"Sweep {sweep.name}: key returned an array of shape {rows.shape} and type {rows.dtype} for "
            f"{count} points; it must be one row of numbers or strings for each"
        )
    if rows.dtype.kind == "f" and np.any(np.isnan(rows)):
        raise InputError(f"Sweep {sweep.name}: key returned NaN, which equals nothing")
    return [rows] if rows.ndim == 1 else list(rows.T)
