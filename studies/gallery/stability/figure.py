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
from numpy.typing import NDArray

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
# What the paper says, at single inclinations and, where it slides, over ranges of them.
MARKS: dict[str, Any] = {
    "linestyle": "none",
    "markersize": 6.5,
    "markeredgecolor": "black",
    "markeredgewidth": 1.2,
}
FIRST_UNSTABLE = MARKS | {
    "marker": "D",
    "markerfacecolor": "white",
    "markeredgecolor": figures.ORANGE,
    "label": "paper: first unstable μ",
}
VIBRATES = MARKS | {"marker": "^", "markerfacecolor": figures.ORANGE, "label": "paper: vibrates (measured)"}
SLIDES = MARKS | {
    "marker": "o",
    "linestyle": "-",
    "linewidth": 2.0,
    "color": figures.BLUE,
    "label": "paper: slides steadily (measured)",
}


def draw(dataset: xr.Dataset) -> Figure:
    """Growth rate over the plane with the branches on it; below, frequency and number of unstable pairs.

    Along a single inclination or friction, both against the other.
    """
    if min(dataset.sizes["theta"], dataset.sizes["mu"]) == 1:
        return _draw_line(dataset)
    figure, _ = figures.panels(1, 1, 17.0, 17.5)
    figure.clear()
    panels = figure.subplot_mosaic([["growth", "growth"], ["frequency", "count"]], height_ratios=(1.45, 1.0))
    growth = dataset["growth_rate"].transpose("mu", "theta").values.astype(float)
    frequency = 1e-3 * dataset["frequency"].transpose("mu", "theta").values.astype(float)
    for name in ("growth", "frequency"):
        stable = np.where(growth <= 0.0, 0.0, np.nan)  # what is not known stays white
        planes.classes(panels[name], *_plane(dataset), stable, [STABLE])
    if np.any(growth > 0.0):
        largest = float(np.nanmax(growth))
        faintest = float(np.nanmin(growth[growth > 0.0]))
        norm = LogNorm(max(min(faintest, 0.5 * largest), FAINTEST * largest), largest)
        mesh = planes.shades(panels["growth"], *_plane(dataset), np.where(growth > 0.0, growth, np.nan), norm)
        planes.colour_bar(figure, mesh, panels["growth"], "growth rate / (1/s)")
        mesh = planes.shades(panels["frequency"], *_plane(dataset), np.where(growth > 0.0, frequency, np.nan))
        planes.colour_bar(figure, mesh, panels["frequency"], "frequency / kHz")
    _draw_counts(figure, panels["count"], dataset)
    handles = [
        *_draw_branches(panels["growth"], dataset),
        *_draw_bound(list(panels.values()), dataset),
        *_draw_statements(panels["growth"], dataset),
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


def _plane(dataset: xr.Dataset) -> tuple[str, NDArray[Any], str, NDArray[Any]]:
    return "theta", dataset["theta"].values, "mu", dataset["mu"].values


def _draw_counts(figure: Figure, axes: Axes, dataset: xr.Dataset) -> None:
    """How many pairs are unstable."""
    count = dataset["unstable_modes"].transpose("mu", "theta").values.astype(float)
    last = len(COUNTS) - 1
    planes.classes(axes, *_plane(dataset), np.minimum(count, last), COUNTS)
    more = "+" if np.any(count > last) else ""
    scale = ScalarMappable(Normalize(-0.5, last + 0.5), ListedColormap(list(COUNTS)))
    bar = figure.colorbar(scale, ax=axes, pad=0.02, ticks=range(last + 1))
    bar.ax.set_yticklabels([*map(str, range(last)), f"{last}{more}"])
    bar.ax.tick_params(length=0.0)
    bar.set_label("unstable pairs")
    bar.outline.set_visible(False)


def _draw_branches(axes: Axes, dataset: xr.Dataset) -> list[Line2D]:
    """Each branch of onsets, and of recoveries, to its ends; what a legend shows of them."""
    number = dataset["trace_branch"].values
    handles = []
    for dim, colour, name in (("pair", figures.BLACK, "onset"), ("recovery", figures.RED, "recovery")):
        for k in range(dataset.sizes[dim]):
            at = dataset.isel({dim: k})
            chosen = number == k + (dataset.sizes["pair"] if dim == "recovery" else 0)
            label = f"{name}, {float(at[f'{dim}_lowest_frequency']):.0f} Hz"
            look: dict[str, Any] = {
                "color": colour,
                "linestyle": STYLES[k % len(STYLES)],
                "linewidth": 1.4,
                "label": label,
            }
            traced = dataset["trace_theta"].values[chosen], dataset["trace_mu"].values[chosen]
            if len(traced[0]) == 1:  # a branch that reaches a single angle
                look["marker"] = "."
            axes.plot(*traced, path_effects=RIM, **look)
            handles.append(Line2D([], [], **look))
    return handles


def _draw_bound(panels: list[Axes], dataset: xr.Dataset) -> list[Line2D]:
    """Where tan(theta) = mu."""
    theta, mu = dataset["theta"].values, dataset["mu"].values
    fine = np.linspace(max(theta[0], 0.0), theta[-1], 200)
    bound = np.tan(np.radians(fine))
    inside = (bound >= mu[0]) & (bound <= mu[-1])
    if theta[-1] <= 0.0 or not inside.any():
        return []
    look: dict[str, Any] = {"color": figures.GREEN, "linestyle": "--", "linewidth": 1.2, "label": "tan θ = μ"}
    for axes in panels:
        axes.plot(fine[inside], bound[inside], path_effects=RIM, **look)
    return [Line2D([], [], **look)]


def _draw_statements(axes: Axes, dataset: xr.Dataset) -> list[Line2D]:
    """What the paper says: its onsets, and at its friction where the rig vibrates and where it slides steadily."""
    if not paper.is_rig(dataset):
        return []
    frame = {name: (dataset[name].values[0], dataset[name].values[-1]) for name in ("theta", "mu")}
    steady = [angle for angle, frequency in paper.ANGLES.items() if np.isnan(frequency)]
    below, above = paper.STEADY_ANGLES
    said: list[tuple[Any, Any, dict[str, Any]]] = [
        ([paper.THETA], [mu for mu, _ in paper.ONSETS], FIRST_UNSTABLE),
        (sorted(paper.ANGLES_MEASURED), [paper.MU], VIBRATES),
        (steady, [paper.MU], SLIDES),
    ]
    handles = []
    for angles, frictions, look in said:
        places = np.array([(theta, mu) for theta in angles for mu in frictions])
        inside = [
            all(low <= value <= high for value, (low, high) in zip(place, frame.values(), strict=True))
            for place in places
        ]
        if any(inside):
            axes.plot(*places[inside].T, **{**look, "linestyle": "none"}, zorder=4.0)
            handles.append(Line2D([], [], **look))
    left, right = axes.get_xlim()
    if frame["mu"][0] <= paper.MU <= frame["mu"][1]:
        for low, high in ((left, min(below, right)), (max(above, left), right)):
            if low < high:
                axes.plot([low, high], [paper.MU] * 2, **{**SLIDES, "marker": ""}, zorder=3.5)
        if (left < below or right > above) and not any(each.get_label() == SLIDES["label"] for each in handles):
            handles.append(Line2D([], [], **SLIDES))
    return handles


def _draw_line(dataset: xr.Dataset) -> Figure:
    """Growth rate and frequency of the fastest mode against the one axis that varies, and where it passes zero."""
    along = "theta" if dataset.sizes["mu"] == 1 and dataset.sizes["theta"] > 1 else "mu"
    held = "mu" if along == "theta" else "theta"
    at = dataset.isel({held: 0})
    figure, (growth, frequency) = figures.panels(2, 1, 15.0, 12.0, sharex=True)
    values = planes.shown(along, at[along].values)
    mark = "." if len(values) < 40 else None
    growth.plot(values, at["growth_rate"].values, marker=mark, color=figures.BLACK)
    unstable = at["growth_rate"].values > 0.0
    for chosen, colour, name in ((~unstable, figures.GREY, "stable"), (unstable, figures.RED, "unstable")):
        if chosen.any():
            height = 1e-3 * at["frequency"].values[chosen]
            frequency.plot(values[chosen], height, ".", color=colour, label=f"fastest mode, {name}")
    growth.axhline(0.0, color=figures.GREY, linewidth=0.8)
    if along == "theta":
        ends = np.concatenate([at["window_from"].values, at["window_to"].values])
        passes = ends[(ends > values[0]) & (ends < values[-1])]
    else:
        passes = np.concatenate([at["pair_onset_mu"].values, at["pair_recovery_mu"].values])
        passes = passes[np.isfinite(passes)]
    for k, place in enumerate(passes):
        label = "a pair's growth passes zero" if k == 0 else ""
        growth.axvline(place, color=figures.BLUE, linestyle=":", label=label)
    growth.set_ylabel("growth rate of the\nfastest mode / (1/s)")
    frequency.set_ylabel("its frequency / kHz")
    frequency.set_ylim(bottom=0.0)
    frequency.set_xlabel(planes.label(along))
    figures.legend_below(figure, [growth, frequency], 3)
    figure.suptitle(f"{_title(dataset)}, {planes.named(held, dataset[held].values[0])}")
    return figure
