"""How the sticks are drawn: both laws, how they depart from 1/V, and the collapse."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from studies import paper
from studies.gallery.stick_time.findings import reference
from studies.motion import transients
from studies.plotting import figures
from studies.study import constants

# How each kind of stick is drawn.
LOOKS: dict[str, dict[str, Any]] = {
    "start_up": {"color": figures.ORANGE, "marker": "s", "label": "start-up"},
    "sustained": {"color": figures.BLUE, "marker": "o", "label": "sustained"},
}
LINE: dict[str, Any] = {"markersize": 4.0, "linewidth": 0.8}
# Of the frictions, and of the loads within them.
COLOURS = (figures.BLUE, figures.BLACK, figures.ORANGE, figures.GREEN, figures.RED)
MARKERS = "ov^Ds"
# Of fewer sticks no mean is drawn; and of how many speeds the distribution.
LEAST_STICKS, MOST_SPEEDS = 20, 4
STYLES = ("-", "--", "-.", ":")


def draw(dataset: xr.Dataset) -> Figure:
    """Times, times by speed, their distribution, and all frictions and loads in one."""
    at, fixed = reference(dataset), constants(dataset)
    figure, (times, products, spread, collapse) = figures.panels(2, 2, 17.0, 15.5)
    _draw_times(times, at)
    _draw_products(products, at)
    _draw_spread(spread, at)
    _draw_collapse(collapse, dataset)
    titles = ("mean", "mean × speed", "distribution", "every friction and load")
    figures.letter((times, products, spread, collapse), titles)
    held = f"μ = {float(at['mu']):g}, F = {float(at['F']):g} N"
    title = f"Duration of long sticks, θ = {fixed['theta']:g}°; (a) to (c) {held}"
    figure.suptitle(f"{title}\n{transients.damping(fixed)}")
    return figure


def _means(at: xr.Dataset, kind: str) -> np.ndarray:
    """Mean stick times and the ends of their intervals, (3, V), s; none where hardly a stick is left."""
    means = np.stack([at[f"mean_stick_time{end}"].sel(kind=kind).values for end in ("", "_low", "_high")])
    return np.where(at[f"{kind}_count"].sum("member").values >= LEAST_STICKS, means, np.nan)


def _draw_times(axes: Axes, at: xr.Dataset) -> None:
    """Mean stick times against speed, both axes logarithmic, with the paper's law."""
    V = at["V"].values
    for kind, look in LOOKS.items():
        mean, low, high = 1e3 * _means(at, kind)
        bars = np.nan_to_num(np.stack([mean - low, high - mean]))
        axes.errorbar(1e3 * V, mean, bars, capsize=2.0, **LINE, **look)
    once = 1e3 * at["loading_time"].mean("member").values
    axes.plot(1e3 * V, once, ":", color=figures.GREY, label="first stick, μF/(k V)")
    start = float(at["mean_stick_time"].sel(kind="start_up").interp(V=min(paper.SPEEDS)))
    if np.isfinite(start) and V[0] <= min(paper.SPEEDS) <= V[-1]:
        speeds = np.array(sorted(paper.STICK_RATIO_SPEEDS))
        law = 1e3 * start * np.array([1.0, paper.STICK_RATIO])
        bold: dict[str, Any] = {"color": figures.RED, "linewidth": 2.2, "zorder": 3.0}
        axes.plot(1e3 * speeds, law, "-", label="paper: half at twice V", **bold)
    axes.set(xscale="log", yscale="log", xlabel="V / (mm/s)", ylabel="mean stick time / ms")
    # Room for the legend below all that is drawn.
    low, high = axes.get_ylim()
    axes.set_ylim(low * (low / high) ** 0.5, high)
    figures.one_two_five(axes.xaxis, axes.yaxis)
    axes.legend(loc="lower left")


def _draw_products(axes: Axes, at: xr.Dataset) -> None:
    """Stick time by speed: constant where T ~ 1/V; how many sticks there were, and where intermittence ends."""
    V = at["V"].values
    for kind, look in LOOKS.items():
        mean, low, high = 1e6 * V * _means(at, kind)
        axes.fill_between(1e3 * V, low, high, color=look["color"], alpha=0.25, linewidth=0.0)
        axes.plot(1e3 * V, mean, **LINE, **look)
    end = 1e3 * float(at["intermittence_end"])
    if np.isfinite(end):
        dashed: dict[str, Any] = {"color": figures.RED, "linestyle": "--", "linewidth": 1.0}
        axes.axvline(end, label=f"intermittence ends, {end:.2f} mm/s", **dashed)
    _logarithmic(axes, 1e3 * V)
    axes.set(ylim=(0.0, None), xlabel="V / (mm/s)", ylabel="T V / μm")
    small: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "fontsize": 6.5, "color": figures.BLUE}
    for x, count in zip(1e3 * V, at["sustained_count"].sum("member").values, strict=True):
        if count:
            axes.text(x, 0.02, f"{count:.0f}", rotation=90, ha="center", va="bottom", **small)
    axes.text(1e3 * V[0], 0.13, "number of sustained sticks", **small)
    figures.one_two_five(axes.xaxis)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 0.17))


def _draw_spread(axes: Axes, at: xr.Dataset) -> None:
    """Distribution of the sustained sticks at some speeds."""
    times = at["stick_time"].where(at["stick"] > at["start_up_count"])
    enough = np.flatnonzero(times.count(("member", "stick")) >= LEAST_STICKS)
    chosen = transients.some(len(enough), MOST_SPEEDS) if len(enough) else []
    for k, colour, style in zip(enough[chosen], COLOURS, STYLES, strict=False):
        V, every = float(at["V"][k]), times.isel(V=k).values
        x = np.sort(1e6 * V * every[np.isfinite(every)])
        share = np.arange(1, len(x) + 1) / len(x)
        axes.step(x, share, where="post", color=colour, linestyle=style, label=f"{1e3 * V:g} mm/s ({len(x)})")
    axes.set(xlabel="T V / μm, sustained sticks", ylabel="share of the sticks below", ylim=(0.0, 1.02))
    if len(chosen):
        axes.set_xlim(left=0.0)
        axes.legend(loc="upper left")


def _draw_collapse(axes: Axes, dataset: xr.Dataset) -> None:
    """Stick time by speed over mu F against V / (mu F): one curve, if friction and load do no more than scale."""
    shown: dict[str, Any] = {"linestyle": "none", "markersize": 4.0, "markeredgewidth": 0.7}
    frictions = list(zip(dataset["mu"].values[dataset["mu"].values > 0.0], COLOURS, strict=False))
    loads = list(zip(dataset["F"].values, MARKERS, strict=False))
    for (mu, colour), (F, marker) in product(frictions, loads):
        at = dataset.sel(mu=mu, F=F)
        x = 1e3 * at["V"].values / (mu * F)
        for kind, fill in (("sustained", colour), ("start_up", "none")):
            y = 1e6 * at["V"].values * _means(at, kind)[0] / (mu * F)
            axes.plot(x, y, color=colour, marker=marker, markerfacecolor=fill, **shown)
    _logarithmic(axes, [0.1, 10.0])
    axes.set(ylim=(0.0, None), xlabel="V / (μF) / (mm/s/N)", ylabel="T V / (μF) / (μm/N)")
    figures.one_two_five(axes.xaxis)
    marks = [Line2D([], [], color=colour, marker="o", label=f"μ = {mu:g}", **shown) for mu, colour in frictions]
    marks += [Line2D([], [], color=figures.GREY, marker=mark, label=f"F = {F:g} N", **shown) for F, mark in loads]
    title: dict[str, Any] = {"title": "filled: sustained, open: start-up", "title_fontsize": 6.5}
    axes.legend(handles=marks, loc="lower left", fontsize=6.5, ncols=2, **title)


def _logarithmic(axes: Axes, x: Any) -> None:
    """A logarithmic axis; for all of `x` where nothing is drawn."""
    axes.set_xscale("log")
    if not np.isfinite(axes.dataLim.y1):
        axes.set_xlim(0.9 * np.min(x), 1.1 * np.max(x))
