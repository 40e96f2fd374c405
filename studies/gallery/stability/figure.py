"""How stability over inclination and friction is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from studies import paper
from studies.plotting import figures, planes
from studies.study import constants

# Of stable points, which no shade is like, and of so many unstable pairs; the last stands for more as well.
STABLE = "#ececec"
COUNTS = (STABLE, "#a6dcf7", figures.BLUE, "#00304d")
# Of the branches; on shades they need a rim.
STYLES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (1.3, 1.3)), (0, (6, 1.5, 1.3, 1.5)))
RIM = [patheffects.withStroke(linewidth=2.8, foreground="white")]
# Growth rates below this share of the largest have one shade.
FAINTEST = 0.01
# What the paper says: its onsets; where the rig vibrates; where it slides, at single inclinations and over ranges.
MARK: dict[str, Any] = {"linestyle": "none", "markersize": 6.5, "markeredgewidth": 1.2, "zorder": 4.0}
DIAMOND = MARK | {"marker": "D", "markerfacecolor": "white", "markeredgecolor": figures.ORANGE}
TRIANGLE = MARK | {"marker": "^", "markerfacecolor": figures.ORANGE, "markeredgecolor": "black"}
STEADY: dict[str, Any] = {"color": figures.BLUE, "linewidth": 2.0}
DOT = MARK | STEADY | {"marker": "o", "markeredgecolor": "black"}


def draw(dataset: xr.Dataset) -> Figure:
    """Growth rate over the plane with the branches on it; below, frequency and number of unstable pairs.

    Along a single inclination or friction, both against the other.
    """
    if min(dataset.sizes["theta"], dataset.sizes["mu"]) == 1:
        return _draw_line(dataset)
    layout = [["growth", "growth"], ["frequency", "count"]]
    figure, panels = figures.mosaic(layout, 17.0, 17.5, height_ratios=(1.45, 1.0))
    plane = "theta", dataset["theta"].values, "mu", dataset["mu"].values
    at = dataset.transpose("mu", "theta", ...)
    growth, frequency, count = (
        at[name].values.astype(float) for name in ("growth_rate", "frequency", "unstable_modes")
    )
    for name in ("growth", "frequency"):
        stable = np.where(growth <= 0.0, 0.0, np.nan)  # what is not known stays white
        planes.classes(panels[name], *plane, stable, [STABLE])
    if np.any(growth > 0.0):
        largest, faintest = float(np.nanmax(growth)), float(np.nanmin(growth[growth > 0.0]))
        norm = LogNorm(max(min(faintest, 0.5 * largest), FAINTEST * largest), largest)
        kilohertz = np.where(growth > 0.0, 1e-3 * frequency, np.nan)
        scale, ticks = planes.banded(kilohertz)
        for name, values, each, label, marked in (
            ("growth", np.where(growth > 0.0, growth, np.nan), norm, "growth rate / (1/s)", None),
            ("frequency", kilohertz, scale, "frequency / kHz", ticks),
        ):
            mesh = planes.shades(panels[name], *plane, values, each)
            planes.colour_bar(figure, mesh, panels[name], label, marked)
    last = len(COUNTS) - 1
    planes.classes(panels["count"], *plane, np.minimum(count, last), COUNTS)
    colours = ScalarMappable(Normalize(-0.5, last + 0.5), ListedColormap(list(COUNTS)))
    bar = planes.colour_bar(figure, colours, panels["count"], "unstable pairs")
    bar.set_ticks(range(last + 1), labels=[*map(str, range(last)), f"{last}{'+' * bool(np.any(count > last))}"])
    bar.ax.tick_params(length=0.0)
    handles = [
        *_draw_branches(panels["growth"], dataset),
        *_draw_bound(list(panels.values())),
        *(_draw_paper(panels["growth"]) if paper.is_rig(dataset) else []),
    ]
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
    titles = ("growth of the fastest mode, and onsets", "its frequency", "number of unstable pairs")
    for letter, axes, title in zip("abc", panels.values(), titles, strict=True):
        axes.set_title(f"({letter}) {title}", loc="left", fontsize=9.0)
    figure.suptitle(_title(dataset))
    return figure


def _title(dataset: xr.Dataset) -> str:
    whose = "" if paper.is_rig(dataset) else " (not the paper's rig)"
    return f"Steady sliding, modes below {constants(dataset)['fmax'] / 1e3:g} kHz{whose}"


def _draw_branches(axes: Axes, dataset: xr.Dataset) -> list[Line2D]:
    """Each branch of onsets, and of recoveries, to its ends; for the legend, what stands for them."""
    number = dataset["trace_branch"].values
    handles: list[Line2D] = []
    for dim, colour, name in (("pair", figures.BLACK, "onset"), ("recovery", figures.RED, "recovery")):
        for k, frequency in enumerate(dataset[f"{dim}_lowest_frequency"].values):
            chosen = np.flatnonzero(number == len(handles))
            look: dict[str, Any] = {"color": colour, "linestyle": STYLES[k % len(STYLES)], "linewidth": 1.4}
            # A branch may reach a single angle.
            look |= {"marker": "." if len(chosen) == 1 else "", "label": f"{name}, {frequency:.0f} Hz"}
            places = dataset["trace_theta"].values[chosen], dataset["trace_mu"].values[chosen]
            axes.plot(*places, path_effects=RIM, **look)
            handles.append(Line2D([], [], **look))
    return handles


def _draw_bound(panels: list[Axes]) -> list[Line2D]:
    """Where tan(theta) = mu, as far as it lies in the plane."""
    (left, right), (low, high) = panels[0].get_xlim(), panels[0].get_ylim()
    first, last = np.degrees(np.arctan((max(low, 0.0), high)))
    theta = np.linspace(max(left, first), min(right, last), 200)
    if theta[0] >= theta[-1]:
        return []
    look: dict[str, Any] = {"color": figures.GREEN, "linestyle": "--", "linewidth": 1.2, "label": "tan θ = μ"}
    for axes in panels:
        axes.plot(theta, np.tan(np.radians(theta)), path_effects=RIM, **look)
    return [Line2D([], [], **look)]


def _draw_paper(axes: Axes) -> list[Line2D]:
    """The paper's onsets, and at its friction where the rig vibrates and where it slides steadily."""
    onsets = [(paper.THETA, mu) for mu, _ in paper.ONSETS]
    vibrates = [(theta, paper.MU) for theta in sorted(paper.ANGLES_MEASURED)]
    slides = [(theta, paper.MU) for theta, frequency in paper.ANGLES.items() if np.isnan(frequency)]
    handles = planes.marks(axes, onsets, label="paper: first unstable μ", **DIAMOND)
    handles += planes.marks(axes, vibrates, label="paper: vibrates (measured)", **TRIANGLE)
    steady = bool(planes.marks(axes, slides, **DOT))
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for start, end in np.clip(paper.STEADY_ANGLES, left, right):
        if start < end and low <= paper.MU <= high:
            axes.plot([start, end], [paper.MU] * 2, **STEADY, zorder=3.5)
            steady = True
    whole = DOT | {"linestyle": "-", "label": "paper: slides steadily (measured)"}
    return handles + ([Line2D([], [], **whole)] if steady else [])


def _draw_line(dataset: xr.Dataset) -> Figure:
    """Growth rate and frequency of the fastest mode against the one axis that varies, and where it passes zero."""
    along, held = ("theta", "mu") if dataset.sizes["mu"] == 1 and dataset.sizes["theta"] > 1 else ("mu", "theta")
    at = dataset.isel({held: 0})
    figure, (growth, frequency) = figures.panels(2, 1, 15.0, 12.0, sharex=True)
    values, rate = planes.shown(along, at[along].values), at["growth_rate"].values
    growth.plot(values, rate, marker="." if len(values) < 40 else None, color=figures.BLACK)
    growth.axhline(0.0, color=figures.GREY, linewidth=0.8)
    for chosen, colour, name in ((~(rate > 0.0), figures.GREY, "stable"), (rate > 0.0, figures.RED, "unstable")):
        if chosen.any():
            height = 1e-3 * at["frequency"].values[chosen]
            frequency.plot(values[chosen], height, ".", color=colour, label=f"fastest mode, {name}")
    names = ("window_from", "window_to") if along == "theta" else ("pair_onset_mu", "pair_recovery_mu")
    passes = np.concatenate([at[name].values for name in names])
    for k, place in enumerate(passes[(passes > values[0]) & (passes < values[-1])]):
        label = "" if k else "a pair's growth passes zero"
        growth.axvline(place, color=figures.BLUE, linestyle=":", label=label)
    growth.set_ylabel("growth rate of the\nfastest mode / (1/s)")
    frequency.set_ylabel("its frequency / kHz")
    frequency.set_ylim(bottom=0.0)
    frequency.set_xlabel(planes.label(along))
    figures.legend_below(figure, [growth, frequency], 3)
    figure.suptitle(f"{_title(dataset)}, {planes.named(held, dataset[held].values[0])}")
    return figure
