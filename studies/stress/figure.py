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
TICKS = {1e-6: "≤ 1e-6", 1e-4: "1e-4", 1e-2: "1e-2", 1.0: "1", REFUSED: "refused", FAILED: "fails"}
ROW = 0.7


def draw(dataset: xr.Dataset) -> Figure:
    """Above, the nearest check of every case, or that it is refused or fails; below, every check of every case."""
    outcome, methods = outcomes(dataset), [str(name) for name in dataset["method"].values]
    height = np.where(outcome == FAILS, FAILED, np.where(outcome < FAILS, REFUSED, np.nan))
    height = np.where(outcome == PASSES, worst(dataset)[0], height)
    groups, count = dataset["group"].values, dataset.sizes["case"]
    of_groups = {group: height[groups == group].T for group in dict.fromkeys(groups)}
    every = zip(
        dataset["check"].values, dataset["margin"].transpose("check", "method", "case").values, strict=True
    )
    of_checks = {name: np.minimum(each, FAILED) for name, each in every if not np.isnan(each).all()}
    rows = [max(len(of_groups), 2), max(len(of_checks), 2)]
    figure, panels = figures.panels(
        2, 1, 17.0, 5.0 + ROW * sum(rows), sharex=True, gridspec_kw={"height_ratios": rows}
    )
    for axes, heights in zip(panels, (of_groups, of_checks), strict=True):
        _strips(axes, heights, methods)
    figures.letter(panels, ("cases by group: the check that came nearest to failing, cost apart", "every check"))
    panels[1].set_xlabel("margin: value / bound of the check; from 1 on a case fails")
    failed = np.count_nonzero(outcome == FAILS)
    figure.suptitle(f"{count} case{'s' * (count > 1)} under stress,\n{DAMPING}: {failed or 'none'} failed")
    figures.legend_below(figure, panels)
    return figure


def _strips(axes: Axes, heights: Mapping[str, Any], methods: Sequence[str]) -> None:
    """Beside each label the points of each method, (methods, points), one row below the other."""
    look: dict[str, Any] = {"markersize": 4.0, "markerfacecolor": "none", "markeredgewidth": 0.7}
    for row, each in enumerate(heights.values()):
        for values, method in zip(each, methods, strict=True):
            marker, colour, beside = LOOKS[method]
            x = np.maximum(values[~np.isnan(values)], LEAST)
            # Spread evenly whatever their number: multiples of the golden section.
            spread = 0.16 * (np.arange(len(x)) * 0.6180339887498949 % 1.0 - 0.5)
            axes.plot(x, row + beside + spread, marker, color=colour, label=method, **look)
    axes.axvline(1.0, color=figures.RED, linestyle="--", linewidth=1.0, label="bound")
    axes.set(xscale="log", xlim=(0.5 * LEAST, 2.0 * FAILED), ylim=(max(len(heights), 1) - 0.5, -0.5))
    axes.set_xticks(list(TICKS), list(TICKS.values()))
    axes.set_xticks([], minor=True)
    axes.set_yticks(np.arange(len(heights)), list(heights))
    axes.set_yticks(np.arange(len(heights) - 1) + 0.5, minor=True)
    axes.grid(axis="y", visible=False)
    axes.grid(axis="y", which="minor")
    axes.tick_params(axis="y", which="both", length=0.0)
