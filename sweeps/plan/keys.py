"""Which points are one computation, and what the results of each are multiplied by."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sweeps.grid import Columns, Points
from sweeps.plan.declaration import Declaration


def key_columns(sweep: Declaration, points: Points) -> Columns:
    """The key of each point.

    Raises
    ------
    ValueError
        If the sweep's key gives something that cannot be compared.
    """
    count = len(next(iter(points.values())))
    rows = np.asarray(sweep.key(points)) if sweep.key is not None and count else np.zeros(0)
    if rows.ndim not in (1, 2) or len(rows) != count or rows.dtype.kind not in "biufU":
        raise ValueError(
            f"Sweep {sweep.name}: key gave an array of shape {rows.shape} and type {rows.dtype} for "
            f"{count} points; it must give one row of numbers or texts for each"
        )
    if rows.dtype.kind == "f" and np.any(np.isnan(rows)):
        raise ValueError(f"Sweep {sweep.name}: key gave NaN, which equals nothing")
    return [rows] if rows.ndim == 1 else list(rows.T)


def factors(sweep: Declaration, points: Points) -> dict[str, NDArray[np.float64]]:
    """What variables are multiplied by, one number a point.

    Raises
    ------
    ValueError
        If the sweep's scale gives anything else.
    """
    given = {} if sweep.scale is None else sweep.scale(points)
    count = len(next(iter(points.values())))
    if not isinstance(given, Mapping):
        raise ValueError(f"Sweep {sweep.name}: scale gave {type(given).__name__}; it must give a dict of factors")
    missing = {v.scale for v in sweep.variables.values() if v.scale} - set(given)
    if missing:
        raise ValueError(f"Sweep {sweep.name}: scale gives no {', '.join(sorted(missing))}")
    found = {}
    for name, each in given.items():
        values = np.asarray(each)
        if values.shape != (count,) or values.dtype.kind not in "biuf":
            raise ValueError(
                f"Sweep {sweep.name}: scale gave {name!r} as an array of shape {values.shape} and type "
                f"{values.dtype} for {count} points; it must give one number for each"
            )
        found[name] = values.astype(float)
        if not np.all(np.isfinite(found[name])):
            raise ValueError(f"Sweep {sweep.name}: scale gave {name!r} with a factor that is not finite")
    return found
