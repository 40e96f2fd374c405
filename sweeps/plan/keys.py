"""Which points are one computation, and what the results of each are multiplied by."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.errors import InputError
from sweeps.grid import BLOCK, Columns, Grid, Points, first_equal
from sweeps.plan.declaration import Declaration


def representatives(
    sweep: Declaration, grid: Grid, requested: NDArray[np.bool_], others: NDArray[np.bool_]
) -> NDArray[Any] | None:
    """The point that is computed in the stead of each; -1 where it is skipped. None: each is its own.

    Parameters
    ----------
    sweep : Declaration
    grid : Grid
        The file's.
    requested, others : ndarray of bool, (points,)
        Of equal points the first one requested is computed, or the first of the others where none is.

    Raises
    ------
    ValueError
        If the sweep's key gives something that cannot be compared.
    """
    kind = np.int32 if grid.size < 2**31 else np.int64
    if sweep.key is None:
        live = requested | others
        return None if live.all() else np.where(live, np.arange(grid.size, dtype=kind), kind(-1))
    order = np.concatenate([np.flatnonzero(requested), np.flatnonzero(others)])
    keys = [
        np.concatenate(parts) for parts in zip(*(_key(sweep, p) for _, p in _blocks(grid, order)), strict=True)
    ]
    found = np.full(grid.size, -1, dtype=kind)
    found[order] = order[first_equal(keys)]
    return found


def factors(sweep: Declaration, grid: Grid, live: NDArray[np.bool_]) -> dict[str, NDArray[np.float64]]:
    """What variables are multiplied by at each point; 0 where it is not `live`.

    Raises
    ------
    ValueError
        If the sweep's scale gives anything but one number a point.
    """
    found: dict[str, NDArray[np.float64]] = {}
    if sweep.scale is None:
        return found
    for index, points in _blocks(grid, np.flatnonzero(live)):
        given = sweep.scale(points)
        if not isinstance(given, Mapping):
            raise InputError(
                f"Sweep {sweep.name}: scale gave {type(given).__name__}; it must give a dict of factors"
            )
        missing = {v.scale for v in sweep.variables.values() if v.scale} - set(given)
        if missing:
            raise InputError(f"Sweep {sweep.name}: scale gives no {', '.join(sorted(missing))}")
        for name, each in given.items():
            values = np.asarray(each)
            if values.shape != index.shape or values.dtype.kind not in "biuf":
                raise InputError(
                    f"Sweep {sweep.name}: scale gave {name!r} as an array of shape {values.shape} and type "
                    f"{values.dtype} for {len(index)} points; it must give one number for each"
                )
            if not np.all(np.isfinite(values)):
                raise InputError(f"Sweep {sweep.name}: scale gave {name!r} with a factor that is not finite")
            found.setdefault(name, np.zeros(grid.size))[index] = values
    return found


def _blocks(grid: Grid, index: NDArray[np.intp]) -> Iterator[tuple[NDArray[np.intp], Points]]:
    for block in np.array_split(index, len(index) // BLOCK + 1):
        yield block, grid.points(block)


def _key(sweep: Declaration, points: Points) -> Columns:
    """The key of each point, by columns."""
    count = len(next(iter(points.values())))
    rows = np.asarray(sweep.key(points)) if sweep.key is not None and count else np.zeros(0)
    if rows.ndim not in (1, 2) or len(rows) != count or rows.dtype.kind not in "biufU":
        raise InputError(
            f"Sweep {sweep.name}: key gave an array of shape {rows.shape} and type {rows.dtype} for "
            f"{count} points; it must give one row of numbers or texts for each"
        )
    if rows.dtype.kind == "f" and np.any(np.isnan(rows)):
        raise InputError(f"Sweep {sweep.name}: key gave NaN, which equals nothing")
    return [rows] if rows.ndim == 1 else list(rows.T)
