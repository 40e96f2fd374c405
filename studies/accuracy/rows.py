"""The file of `accuracy` as rows, one for each method and setting, over all scenes: cost and errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.accuracy import settings as asked
from studies.accuracy.errors import DIMS, UNKNOWN, YES


@dataclass(frozen=True)
class Row:
    """One method with one setting.

    Attributes
    ----------
    method, setting : int
    kind, name : str
        What is set, and the setting for a reader.
    alone, together : float
        Processor time per simulated second of a run alone, and of each of an ensemble's; the mean over scenes.
    mismatch, scatter : float
        Errors of the figures in units of their tolerances, and what scatter alone would make: root mean square
        over figures and scenes.
    worst : float
        The largest of them.
    undamped : float
        Mismatch against the published scheme without its numerical damping.
    right, scenes : int
        Scenes at which every figure is within its tolerance and scatter, and those where that is known.
    """

    method: int
    setting: int
    kind: str
    name: str
    alone: float
    together: float
    mismatch: float
    scatter: float
    worst: float
    undamped: float
    right: int
    scenes: int

    @property
    def cost(self) -> float:
        """What it costs in a sweep, s per simulated second."""
        return self.alone if np.isnan(self.together) else self.together


def rows(dataset: xr.Dataset) -> list[Row]:
    """Every method and setting of which something is known, in the file's order."""
    data = dataset.transpose(*DIMS, ...)
    found = []
    for j, method in enumerate(data["method"].values):
        for k, setting in enumerate(data["setting"].values):
            at = data.isel({"method": j, "setting": k})
            if method == asked.LINEAR or not np.isfinite(at["cpu_per_second"]).any():
                continue
            within = at["within"].values if "within" in at else np.full(at.sizes["scene"], UNKNOWN)
            found.append(
                Row(
                    int(method),
                    int(setting),
                    asked.OPTIONS[int(setting)].kind,
                    str(at["setting_name"].item()),
                    mean(at["cpu_per_second"].values),
                    mean(at["batch_cpu_per_second"].values),
                    root_mean_square(_values(at, "mismatch")),
                    root_mean_square(_values(at, "mismatch_scatter")),
                    largest(_values(at, "worst_mismatch")),
                    root_mean_square(_values(at, "mismatch_undamped")),
                    int(np.count_nonzero(within == YES)),
                    int(np.count_nonzero(within != UNKNOWN)),
                )
            )
    return found


def front(candidates: Sequence[Row]) -> list[Row]:
    """Those that no other is both cheaper and nearer than, the cheapest first."""
    known = sorted((row for row in candidates if np.isfinite(row.cost + row.mismatch)), key=lambda row: row.cost)
    found: list[Row] = []
    for row in known:
        if not found or row.mismatch < found[-1].mismatch:
            found.append(row)
    return found


def cheapest_right(candidates: Sequence[Row]) -> Row | None:
    """The cheapest that is right at every scene."""
    right = [row for row in candidates if row.scenes and row.right == row.scenes and np.isfinite(row.cost)]
    return min(right, key=lambda row: row.cost, default=None)


def find(candidates: Sequence[Row], method: int, setting: int = asked.DEFAULT) -> Row | None:
    """The row of a method with a setting."""
    return next((row for row in candidates if (row.method, row.setting) == (method, setting)), None)


def mean(values: NDArray[np.float64]) -> float:
    """Of what there is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def root_mean_square(values: NDArray[np.float64]) -> float:
    """Of what there is."""
    return float(np.sqrt(mean(np.square(values))))


def largest(values: NDArray[np.float64]) -> float:
    """In magnitude, of what there is, with its sign."""
    known = values[np.isfinite(values)]
    return float(known[np.argmax(np.abs(known))]) if len(known) else float("nan")


def _values(at: xr.Dataset, name: str) -> NDArray[np.float64]:
    return np.asarray(at[name].values if name in at else np.full(1, np.nan), dtype=float)
