"""How near every case came to failing, by groups and by checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.plotting import figures
from studies.stress.findings import DAMPING, FAILS, PASSES, outcomes, worst

# Marker, colour and place beside the middle of each method.
LOOKS = {"fast": ("o", figures.BLUE, -0.25), "exact": ("^", figures.ORANGE, 0.0), "paper": ("s", "black", 0.25)}
# Smaller margins are drawn as LEAST, for none is nearer to failing than another; refusals and failures above 1.
LEAST, REFUSED, FAILED = 1e-6, 10.0, 100.0


def draw(dataset: xr.Dataset) -> Figure:
    """Above, the nearest check of every case, or that it is refused or fails; below, every check of every case."""
    figure, (upper, lower) = figures.panels(2, 1, 17.0, 19.0)
    outcome, methods = outcomes(dataset), [str(name) for name in dataset["method"].values]
    height = np.where(outcome == FAILS, FAILED, np.where(outcome < FAILS, REFUSED, np.nan))
    height = np.where(outcome == PASSES, worst(dataset)[0], height)
    groups, count = dataset["group"].values, dataset.sizes["case"]
    _strips(upper, {group: height[groups == group].T for group in dict.fromkeys(groups)}, methods)
    upper.set_ylabel("margin of the nearest check but cost")
    ticks = {1e-6: "≤ 1e-6", 1e-4: "1e-4", 1e-2: "1e-2", 1.0: "1", REFUSED: "refused", FAILED: "fails"}
    upper.set_yticks(list(ticks), list(ticks.values()))
    every = zip(
        dataset["check"].values, dataset["margin"].transpose("check", "method", "case").values, strict=True
    )
    _strips(lower, {name: np.minimum(each, FAILED) for name, each in every if not np.isnan(each).all()}, methods)
    lower.set_ylabel("margin of each check")
    failed = np.count_nonzero(outcome == FAILS)
    figure.suptitle(f"{count} case{'s' * (count > 1)} under stress,\n{DAMPING}: {failed or 'none'} failed")
    figures.legend_below(figure, [upper])
    return figure


def _strips(axes: Axes, heights: Mapping[str, Any], methods: Sequence[str]) -> None:
    """Over each label the points of each method, (methods, points), side by side."""
    look: dict[str, Any] = {"markersize": 2.6, "markerfacecolor": "none", "markeredgewidth": 0.6}
    for x, each in enumerate(heights.values()):
        for values, method in zip(each, methods, strict=True):
            marker, colour, beside = LOOKS[method]
            y = np.maximum(values[~np.isnan(values)], LEAST)
            # Spread evenly whatever their number: multiples of the golden section.
            spread = 0.16 * (np.arange(len(y)) * 0.6180339887498949 % 1.0 - 0.5)
            axes.plot(x + beside + spread, y, marker, color=colour, label=method, **look)
    axes.axhline(1.0, color=figures.RED, linestyle="--", linewidth=1.0, label="what is allowed")
    axes.set_yscale("log")
    axes.set_ylim(0.5 * LEAST, 3.0 * max([1.0, *(np.nanmax(each, initial=0.0) for each in heights.values())]))
    axes.set_xlim(-0.5, max(len(heights), 1) - 0.5)
    axes.set_xticks(np.arange(len(heights)), list(heights), rotation=30.0, ha="right", fontsize=7.0)
    axes.grid(axis="x", visible=False)
