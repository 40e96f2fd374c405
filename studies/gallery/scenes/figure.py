"""How a grid of scenes is drawn: maps of the regime, or a row of scenes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from studies.motion import regimes, transients
from studies.motion.regimes import KINDS
from studies.plotting import figures, planes
from studies.plotting.planes import COLOURS, DARK, HATCHES, SYMBOLS, named
from studies.study import constants

# Cells along a side up to which each bears a number, and ticks.
MOST_WRITTEN, MOST_TICKS = 10, 8


def draw(dataset: xr.Dataset) -> Figure:
    """Maps if two axes or more vary, else shares of time and RMS along the one that does, or of one scene."""
    varying = [name for name in transients.SCENE if dataset.sizes[name] > 1]
    varying.sort(key=lambda name: -dataset.sizes[name])
    held = [named(name, dataset[name].values[0]) for name in transients.SCENE if name not in varying]
    fixed = constants(dataset)
    rule = f"runs until the shares of time are known to {fixed['standard_error']:g}"
    length = f"runs of {fixed['duration']:g} s" if fixed["duration"] else rule
    about = ", ".join([*held, length, transients.damping(fixed)])
    if len(varying) > 1:
        return _draw_maps(dataset, varying, f"Regime of the motion\n{about}")
    along = varying[0] if varying else "V"
    at = dataset.isel({name: 0 for name in transients.SCENE if name != along})
    return _draw_row(at, along, f"Scenes along {SYMBOLS[along][0]}: {about}" if varying else f"One scene: {about}")


def _draw_maps(dataset: xr.Dataset, varying: Sequence[str], title: str) -> Figure:
    """The longest axis across and the next one up in every map; the others go from map to map."""
    x, y, *others = varying
    written = max(dataset.sizes[x], dataset.sizes[y]) <= MOST_WRITTEN
    wide, high = (_extent(dataset.sizes[name], written) for name in (x, y))
    figure, kinds, left_out = planes.multiples(
        dataset,
        x,
        y,
        others,
        lambda across, down: (max(2.0 + wide * across, 13.0), 3.6 + high * down),
        lambda axes, at: _draw_map(axes, at, x, y, written),
    )
    handles = planes.patches(np.unique(np.concatenate(kinds)))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))
    note = "\nnumbers: RMS of the velocity of B / (mm/s)" if written else ""
    whole = title + (f" ({left_out})" if left_out else "") + note
    figure.suptitle(figures.fitted(whole, 2.54 * figure.get_figwidth()))
    return figure


def _extent(count: int, written: bool) -> float:
    """Side of a map, cm: a number needs room, and a small map has small cells rather than none."""
    return min(max((1.1 if written else 0.5) * count, 4.0), 11.0 if written else 8.0) + 0.8


def _draw_map(axes: Axes, at: xr.Dataset, x: str, y: str, written: bool) -> NDArray[np.intp]:
    """One map, its cells of equal size whatever the steps of the axes; the kinds that occur in it."""
    kinds = regimes.kinds(at)
    ends = [np.arange(count + 1) - 0.5 for count in kinds.shape[::-1]]
    axes.pcolormesh(
        *ends,
        kinds,
        cmap=ListedColormap(COLOURS),
        vmin=-0.5,
        vmax=len(KINDS) - 0.5,
        edgecolors="white",
        linewidth=0.4 if max(kinds.shape) <= 40 else 0.0,
    )
    failed = np.ma.masked_not_equal(kinds, KINDS.index("failed"))
    hatched: dict[str, Any] = {"facecolor": "none", "edgecolor": figures.GREY, "linewidth": 0.0}
    axes.pcolor(*ends, failed, hatch=HATCHES["failed"], **hatched)
    rms = 1e3 * at["velocity_rms"].values
    if written:
        for row, column in np.argwhere(np.isfinite(rms)):
            colour = "white" if KINDS[kinds[row, column]] in DARK else "black"
            axes.text(column, row, _short(rms[row, column]), color=colour, fontsize=7.0, ha="center", va="center")
    axes.grid(False)
    for name, side in ((x, axes.xaxis), (y, axes.yaxis)):
        values = planes.shown(name, at[name].values)
        ticks = values if len(values) <= MOST_TICKS else _round(values)
        side.set_ticks(np.interp(ticks, values, range(len(values))), [f"{tick:.3g}" for tick in ticks])
        side.set_label_text(planes.label(name))
    return np.unique(kinds)


def _round(values: NDArray[Any]) -> NDArray[Any]:
    """Round numbers within the ascending values, which need not be among them."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    log = planes.is_logarithmic(values)
    locator = LogLocator(subs=(1.0, 2.0, 5.0)) if log else MaxNLocator(MOST_TICKS, steps=[1, 2, 5, 10])
    ticks = np.asarray(locator.tick_values(values[0], values[-1]))
    return np.asarray(ticks[(ticks >= values[0]) & (ticks <= values[-1])])


def _short(value: float) -> str:
    """Two digits; nothing smaller than a hundredth is worth telling."""
    return "0" if value < 5e-3 else f"{value:.1f}" if value >= 1.0 else f"{value:.2f}"


def _draw_row(at: xr.Dataset, along: str, title: str) -> Figure:
    """Shares of time and RMS along the one axis that varies."""
    values, kinds = planes.shown(along, at[along].values), regimes.kinds(at)
    figure, (shares, rms) = figures.panels(2, 1, 15.0, 13.0, sharex=True)
    edges = planes.edges(values)
    planes.shares(shares, edges, at)
    planes.along(rms, values, 1e3 * at["velocity_rms"].values, kinds, size=6.0 if len(values) <= 60 else 4.0)
    if planes.is_logarithmic(values):
        rms.set_xscale("log")
        rms.xaxis.set_major_formatter("{x:g}")
    planes.mark_few(rms.xaxis, values)
    rms.set_xlim(edges[0], edges[-1])
    rms.set_ylim(bottom=0.0)
    rms.set_xlabel(planes.label(along))
    rms.set_ylabel("RMS of the velocity of B / (mm/s)")
    shares.set_ylabel("share of the time")
    figures.legend_below(figure, [shares, rms], 5)
    figure.suptitle(figures.fitted(title, 15.0))
    return figure
