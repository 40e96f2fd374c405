"""How the probability of instability is drawn: over the plane, along friction, and which numbers decide."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from studies import paper
from studies.plotting import figures, planes

# Contours of probability, with their styles.
LEVELS: dict[float, Any] = {0.05: (0, (1.3, 1.3)), 0.5: "-", 0.95: (0, (6, 1.5))}
# Bars of so many numbers.
MOST = 6


def draw(dataset: xr.Dataset) -> Figure:
    """Probability over inclination and friction; at the angle next to the paper's, what it depends on."""
    whole = min(dataset.sizes["theta"], dataset.sizes["mu"]) > 1
    layout = [["along", "rigs"], ["bars", "bars"]]
    if whole:
        layout, size, ratios = [["plane", "plane"], *layout], (17.0, 22.0), (1.4, 1.0, 0.9)
        figure, panels = figures.mosaic(layout, *size, height_ratios=ratios)
    else:
        figure, panels = figures.mosaic(layout, 17.0, 13.0)
    at = dataset.sel(theta=paper.THETA, method="nearest")
    where = planes.named("theta", at["theta"])
    places = order(at)
    if whole:
        _draw_plane(figure, panels["plane"], dataset)
    _draw_along(panels["along"], at)
    _draw_rigs(figure, panels["rigs"], at, places)
    _draw_bars(panels["bars"], at, places[:MOST])
    titles = {
        "plane": "probability of instability",
        "along": f"along μ at {where}",
        "rigs": f"the rigs' lowest onset at {where}",
        "bars": f"what decides it at {where}",
    }
    for letter, (name, axes) in zip("abcd", panels.items(), strict=False):
        axes.set_title(f"({letter}) {titles[name]}", loc="left", fontsize=9.0)
    figures.legend_below(figure, [panels[name] for name in ("plane", "along") if name in panels], 4)
    whose = "the paper's rig" if paper.is_rig(dataset) else "another rig"
    figure.suptitle(f"Steady sliding of {dataset.sizes['sample']} rigs scattered about {whose}")
    return figure


def order(at: xr.Dataset) -> list[int]:
    """Places of the numbers that scatter, at one angle, the one with the largest total index first."""
    return [int(place) for place in np.argsort(-at["sobol_total"].values, kind="stable")]


def _draw_plane(figure: Figure, axes: Axes, dataset: xr.Dataset) -> None:
    """Probability as lightness, its contours, and where the nominal rig becomes unstable."""
    at = dataset.transpose("mu", "theta", ...)
    theta, mu, share = at["theta"].values, at["mu"].values, at["probability_unstable"].values
    mesh = planes.shades(axes, "theta", theta, "mu", mu, share, Normalize(0.0, 1.0))
    planes.colour_bar(figure, mesh, axes, "probability of instability")
    nominal = at["nominal_unstable"].values
    lines = [(share, level, figures.GREY, style, f"probability {level:g}") for level, style in LEVELS.items()]
    for values, level, colour, style, label in [*lines, (nominal, 0.5, figures.RED, "-", "nominal rig")]:
        if np.nanmin(values) < level < np.nanmax(values):
            look: dict[str, Any] = {"linestyles": [style], "linewidths": 1.3}
            axes.contour(
                theta, mu, values, levels=[level], colors=colour if values is nominal else "white", **look
            )
            axes.plot([], [], color=colour, linestyle=style, label=label)
    if paper.is_rig(dataset):
        look = {"marker": "D", "markersize": 5.5, "markerfacecolor": "white", "markeredgecolor": "black"}
        onsets = [(paper.THETA, onset) for onset, _ in paper.ONSETS]
        planes.marks(axes, onsets, **look, linestyle="none", label="paper: first unstable μ", zorder=4.0)


def _draw_along(axes: Axes, at: xr.Dataset) -> None:
    """The probability against friction with its interval, where it rises, and the nominal rig's lowest onset."""
    mu = at["mu"].values
    low, high, middle = (at[f"probability_{name}"].values for name in ("low", "high", "unstable"))
    axes.fill_between(mu, low, high, color=figures.BLUE, alpha=0.3, linewidth=0.0, label="Wilson 95 %")
    axes.plot(mu, middle, color=figures.BLUE, marker="." if len(mu) < 60 else "", label="share of rigs, (b)")
    onset = float(at["nominal_onset_mu"])
    if onset <= mu[-1]:
        axes.axvline(onset, color=figures.RED, linestyle="--", label="nominal onset, (b)")
    rises = np.flatnonzero((middle > 0.0) & (middle < 1.0))
    if len(rises):
        margin = max(2, len(rises) // 2)
        axes.set_xlim(mu[max(rises[0] - margin, 0)], mu[min(rises[-1] + margin, len(mu) - 1)])
    axes.set(xlabel=planes.label("mu"), ylabel="probability of instability", ylim=(-0.03, 1.03))


def _draw_rigs(figure: Figure, axes: Axes, at: xr.Dataset, places: list[int]) -> None:
    """Every rig by the two numbers that decide most; its lowest onset as lightness, a cross if there is none."""
    names = [str(each) for each in at["parameter"].values[places[:2]]]
    onset = at["onset_mu"].values
    if len(names) < 2:
        names.append("")
    x, y = (planes.shown(name, at[name].values) if name else onset for name in names)
    none = np.isnan(onset)
    # A few outliers do not flatten the scale.
    ends = dict(zip(("vmin", "vmax"), np.nanquantile(onset, (0.01, 0.99)), strict=True)) if not none.all() else {}
    dots = axes.scatter(x[~none], y[~none], 7.0, onset[~none], cmap="cividis", linewidths=0.0, **ends)
    if none.any():
        axes.plot(x[none], y[none], "x", color=figures.RED, markersize=4.0)
    planes.colour_bar(figure, dots, axes, "lowest onset, μ")
    axes.set(xlabel=planes.label(names[0]), ylabel=planes.label(names[1]) if names[1] else "lowest onset, μ")


def _draw_bars(axes: Axes, at: xr.Dataset, chosen: list[int]) -> None:
    """First and total Sobol indices of the lowest onset, with standard errors."""
    rows = np.arange(len(chosen))
    for shift, kind, colour in ((-0.19, "first", figures.GREY), (0.19, "total", figures.BLUE)):
        values, errors = (at[f"sobol_{kind}{end}"].values[chosen] for end in ("", "_se"))
        look: dict[str, Any] = {"color": colour, "error_kw": {"elinewidth": 0.8}}
        axes.barh(rows + shift, np.maximum(values, 0.0), 0.36, xerr=errors, label=f"{kind} index", **look)
    axes.set_yticks(rows, [planes.name(str(each)) for each in at["parameter"].values[chosen]])
    axes.invert_yaxis()
    axes.set(xlabel="Sobol index: share of the variance of the lowest onset", xlim=(0.0, None))
    axes.grid(axis="y", visible=False)
    axes.legend(loc="lower right")
