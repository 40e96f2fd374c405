"""Regimes of the motion: which of them vibrate, and the regime of each point of a result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.motion.transients import REGIMES
from studies.tables import Column
from sweeps import DONE, FAILED

# What a point of a result can be: in a regime, or without one.
KINDS = (*REGIMES, "failed", "pending")
VIBRATING = ("intermittent", "periodic", "irregular")
STEADY = "steady sliding"

# Columns of a table: shares of time.
SHARES: dict[str, Column] = {name: (f"{name}_fraction", ".3f") for name in ("stick", "slip", "separation")}


def kinds(dataset: xr.Dataset) -> NDArray[np.intp]:
    """The place in KINDS of each point."""
    status, regime = dataset["status"].values, dataset["regime"].values.astype(float)
    done = (status == DONE) & np.isfinite(regime)
    other = np.where(status == FAILED, KINDS.index("failed"), KINDS.index("pending"))
    return np.where(done, np.where(done, regime, 0.0), other).astype(np.intp)


def kind(point: xr.Dataset) -> str:
    """The regime of one point in words."""
    return KINDS[int(kinds(point))]


def is_of(codes: Any, *names: str) -> NDArray[np.bool_]:
    """Which points are in one of the regimes called `names`; `codes` are places in REGIMES or KINDS."""
    return np.isin(codes, [KINDS.index(name) for name in names])


def dominant_frequency(dataset: xr.Dataset) -> xr.DataArray:
    """Dominant frequency, Hz; NaN for points that do not vibrate, where it is that of a vibration that dies."""
    line: xr.DataArray = dataset["dominant_frequency"]
    return line.where(is_of(dataset["regime"].values, *VIBRATING))


def failures(dataset: xr.Dataset, axes: Sequence[str] = (), most: int = 5) -> list[str]:
    """Where the first failed points are, by their axes, and why they failed; and how many more there are."""
    status = dataset["status"]
    failed = np.argwhere(status.values == FAILED)
    lines = []
    for place in failed[:most]:
        point = dataset.isel(dict(zip(status.dims, place, strict=True)))
        where = ", ".join(f"{name} = {float(point[name]):g}" for name in axes or status.dims)
        lines.append(f"failed: {where}: {point['error'].item()}")
    return lines + ([f"and {len(failed) - most} more failed."] if len(failed) > most else [])
