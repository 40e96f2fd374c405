"""A tornado of elasticities for each pair, and the elasticities by its strongest numbers over the inclination."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies import paper
from studies.gallery.sensitivity.findings import named, reference
from studies.plotting import figures, planes

# Of the numbers that stand out, with markers that tell them apart in grey; theta is black.
COLOURS, MARKERS = (figures.BLUE, figures.RED, figures.GREEN, figures.ORANGE, figures.GREY), "os^Dv"
OTHERS = "#c8c8c8"
# What a number takes, as a share of the longest bar on the other side.
ROOM = 0.35
# Angles between two markers; ticks.
APART, TICKS = 6, (-1000, -100, -10, -1, 0, 1, 10, 100, 1000)


def draw(dataset: xr.Dataset) -> Figure:
    """A row for each pair: bars by size with the result of a real change of 1 %, and curves over theta."""
    at = reference(dataset)
    strongest = [p for p in at["parameter"].values.tolist() if p != "theta"]
    looks = dict(zip(strongest, zip(COLOURS, MARKERS, strict=True), strict=False)) | {
        "theta": (figures.BLACK, ".")
    }
    pairs = dataset["pair"].values
    height = 2.0 + len(pairs) * (1.8 + max(0.36 * len(at["parameter"]), 2.0))
    options: dict[str, Any] = {"sharex": "col", "gridspec_kw": {"width_ratios": (1.25, 1.0)}}
    figure, panels = figures.panels(len(pairs), 2, 17.5, height, **options)
    for pair, tornado, over in zip(pairs, panels[::2], panels[1::2], strict=True):
        _tornado(tornado, at.sel(pair=pair), looks)
        _over_theta(over, dataset.sel(pair=pair), looks)
        over.axvline(float(at["theta"]), color=figures.GREY, linewidth=0.8, linestyle=":")
    # Both sides of zero have room for numbers.
    low, high = panels[-2].get_xlim()
    panels[-2].set_xlim(min(low, -ROOM * high), max(high, -ROOM * low))
    panels[-2].set_xlabel("elasticity of the onset's μ: % for 1 % of the number")
    panels[-1].set_xlabel(planes.label("theta"))
    figures.legend_below(figure, panels[::-1], 3)
    whose = "" if paper.is_rig(dataset) else " (not the paper's rig)"
    figure.suptitle(f"What moves the flutter onsets{whose}; left at {planes.named('theta', at['theta'])}")
    return figure


def _tornado(axes: Axes, one: xr.Dataset, looks: dict[str, tuple[str, str]]) -> None:
    """Bars, the largest at the top; circles where the onset is when the number is 1 % larger."""
    value = one["elasticity_mu"].values
    order = np.argsort(np.nan_to_num(np.abs(value)), kind="stable")
    one, value = one.isel(parameter=order), value[order]
    names, height = one["parameter"].values.tolist(), np.arange(len(order))
    mu, frequency = (float(one[name].max()) for name in ("onset_mu", "onset_frequency"))
    axes.set_yticks(height, [named(name) for name in names])
    axes.tick_params(axis="y", length=0.0)
    axes.set_ylim(-0.7, len(order) - 0.3)
    axes.grid(False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.axvline(0.0, color=figures.BLACK, linewidth=0.8)
    if not np.any(np.isfinite(value)):
        axes.set_title(f"pair {int(one['pair'])}: no onset" if np.isnan(mu) else f"{frequency:.0f} Hz: a fold")
        return
    axes.set_title(f"{frequency:.0f} Hz, onset at μ = {mu:.4f}")
    axes.barh(height, value, 0.7, color=[looks[name][0] if name in looks else OTHERS for name in names])
    again = 100.0 * one["change_mu"].values / mu
    look: dict[str, Any] = {"markersize": 4.0, "markerfacecolor": "white", "color": figures.BLACK}
    axes.plot(again, height, "o", markeredgewidth=0.8, label="solved again with 1 % more", linestyle="", **look)
    text: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": 7.0}
    # On the other side of zero nothing is drawn.
    for y, each in zip(height, value, strict=True):
        side, away = ("right", -5) if each >= 0.0 else ("left", 5)
        axes.annotate(f"{each:+.2f}".replace("-", "−"), (0.0, y), (away, 0), ha=side, **text)


def _over_theta(axes: Axes, one: xr.Dataset, looks: dict[str, tuple[str, str]]) -> None:
    """Elasticities by the numbers that have looks of their own; nearly linear within 1, logarithmic beyond."""
    theta = one["theta"].values
    common: dict[str, Any] = {"markersize": 3.5, "markevery": APART if len(theta) > 3 * APART else 1}
    axes.axhline(0.0, color=figures.BLACK, linewidth=0.8)
    for name in [name for name in looks if name in one["parameter"].values]:
        colour, marker = looks[name]
        value = one["elasticity_mu"].sel(parameter=name)
        axes.plot(theta, value, color=colour, marker=marker, label=f"by {named(name)}", **common)
    axes.set_yscale("asinh", linear_width=1.0)
    axes.set_yticks([each for each in TICKS if axes.get_ylim()[0] < each < axes.get_ylim()[1]])
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_ylabel("elasticity of μ")
