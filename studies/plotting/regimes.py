"""Regimes over parameters with their marks: onsets, verdicts, different motions, and the paper's points."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from studies import paper
from studies.answering.claims import is_papers_rig
from studies.declaring import labels
from studies.motion import mixed, regimes
from studies.physics.verdicts import BELOW, VERDICTS, uncertain
from studies.plotting import figures, planes

# Quantities drawn beside the regimes; dominant frequency and RMS are those of a vibration.
QUANTITIES = {"stick_fraction": False, "dominant_frequency": True, "velocity_rms": True}
ONSET: dict[str, Any] = {
    "color": "black",
    "linestyle": "--",
    "linewidth": 1.0,
    "label": f"onset of flutter\n{BELOW}",
}
MARKS: dict[str, dict[str, Any]] = {
    "subcritical": {"marker": "s", "color": figures.RED, "label": "missed: vibrates\nthough stable"},
    "unstable above the band": {"marker": "P", "color": "white", "label": f"stable {BELOW},\nunstable above"},
    "quiet though unstable": {
        "marker": "X",
        "color": figures.ORANGE,
        "label": "false alarm: steady\nthough unstable",
    },
    "uncertain": {"marker": "o", "color": "black", "label": "realisations differ"},
}
# A scale leaves out this share of the cells at either end; it is logarithmic if its ends are so many times apart.
RARE, WIDE = 0.02, 10.0


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Regimes and the motion over two parameters, planes of regimes over more, or all along one."""
    x, y, others = arranged(dataset)
    count = int(dataset["members"])
    title = f"Regimes, {count} realisation{'s' * (count > 1)} of a scene"
    if dataset.sizes[y] == 1:
        return _draw_along(dataset.isel({name: 0 for name in (y, *others)}), x, title)
    if any(dataset.sizes[name] > 1 for name in others):
        return planes.over_others(dataset, x, y, others, title, plane)
    return _draw_plane(dataset.isel(dict.fromkeys(others, 0)).transpose(y, x, ...), x, y, title)


def draw_planes(dataset: xr.Dataset) -> figures.Figure:
    """Regimes over the two longest parameters, a panel for each value of up to two others."""
    dims = [str(dim) for dim in dataset["status"].dims]
    x, y, *others = sorted(dims, key=lambda dim: -dataset.sizes[dim])
    return planes.over_others(dataset, x, y, others, "Regime of the motion", plane)


def arranged(dataset: xr.Dataset) -> tuple[str, str, list[str]]:
    """The horizontal and vertical parameter, and the others; V and mu unless only another one varies."""
    order = ["V", "mu", *sorted(("theta", "F"), key=lambda name: -dataset.sizes[name])]
    first, second, *others = sorted(order, key=lambda name: dataset.sizes[name] == 1)
    # Friction goes up if it is one of both.
    x, y = (second, first) if first == "mu" and dataset.sizes[second] > 1 else (first, second)
    return x, y, others


def plane(axes: figures.Axes, point: xr.Dataset, x: str, y: str) -> None:
    """The plane of regimes, and the available marks of its cells."""
    planes.classes(axes, point["status"].copy(data=regimes.kinds(point)), x, y)
    _draw_onset(axes, point, x, y)
    # Below the others, which are smaller.
    planes.mark_mixed(axes, point, x, y)
    for name, look in MARKS.items() if "verdict" in point else ():
        chosen = ~mixed.several(point) & uncertain(point)
        if name in VERDICTS:
            chosen = point["verdict"] == [*VERDICTS].index(name)
        planes.marks(axes, planes.places(chosen, x, y), markeredgecolor="black", markersize=4.0, **look)
    # The paper's kinds of vibration by speed, where the others of V, theta, mu and F are the paper's.
    test = {"theta": paper.THETA, "mu": paper.MU, "F": paper.LOAD}
    same = all(np.isclose(point[name], value) for name, value in test.items() if name not in (x, y))
    for V, kind in paper.VIBRATION.items() if same and x == "V" and y in test and is_papers_rig(point) else ():
        planes.marks(axes, [(1e3 * V, test[y])], **planes.PAPER[kind])


def _draw_onset(axes: figures.Axes, point: xr.Dataset, x: str, y: str) -> None:
    """Draw the onset of instability of steady sliding, if it lies in the plane."""
    from matplotlib import patheffects

    onset = point.get("onset_mu", xr.DataArray(np.nan))
    if "mu" not in (x, y) or not np.any(np.isfinite(onset)):
        return
    # Seen on any colour.
    look = ONSET | {"path_effects": [patheffects.withStroke(linewidth=2.0, foreground="white")]}
    if y == "mu" and onset.dims == (x,):
        axes.plot(labels.readable(point[x]).values, onset.values, **look)
    elif onset.ndim == 0:
        (axes.axhline if y == "mu" else axes.axvline)(float(onset), **look)


def _draw_plane(point: xr.Dataset, x: str, y: str, title: str) -> figures.Figure:
    """A plane of regimes, and planes of statistics of the motion below it."""
    figure, panels = figures.mosaic([["regime"] * len(QUANTITIES), list(QUANTITIES)], 7.0, 6.0)
    top = panels.pop("regime")
    plane(top, point, x, y)
    top.fill_between([], [], facecolor="white", edgecolor=figures.GREY, label="white in (c), (d):\nno vibration")
    figures.legend_below(figure, [top])
    for name, axes in panels.items():
        array, options = _quantity(point, name), dict[str, Any](vmin=0.0, vmax=1.0)
        if name != "stick_fraction" and array.notnull().any():
            # Frequencies that most points share would hide the differences within.
            rare = 0.1 if name == "dominant_frequency" else RARE
            low, high = array.quantile([rare, 1.0 - rare]).values
            options = {"vmin": low, "vmax": high, "norm": "log" if 0.0 < WIDE * low < high else "linear"}
        mesh = planes.numbers(axes, array, x, y, **options)
        bar = figure.colorbar(mesh, ax=axes, location="bottom", pad=0.02, aspect=25, extend="both")
        bar.outline.set_visible(False)
        figures.one_two_five(bar.ax.xaxis)
        _draw_onset(axes, point, x, y)
        planes.mark_mixed(axes, point, x, y)
        axes.label_outer()
    figures.entitle([top, *panels.values()], ["regime", *(labels.label(point[name]) for name in panels)])
    figure.suptitle(title)
    return figure


def _quantity(point: xr.Dataset, name: str) -> xr.DataArray:
    """A quantity in readers' units, NaN where the motion has no value of it."""
    array = labels.readable(point[name]).astype(float)
    return array.where(regimes.is_of(regimes.kinds(point), *regimes.VIBRATING)) if QUANTITIES[name] else array


def _draw_along(point: xr.Dataset, x: str, title: str) -> figures.Figure:
    """Statistics along one parameter: the range of the realisations, marked by the regime."""
    figure, panels = figures.panels(len(QUANTITIES), 1, 4.5, sharex=True)
    values, codes = labels.readable(point[x]).values, regimes.kinds(point)
    for axes, name in zip(panels, QUANTITIES, strict=True):
        spread = labels.readable(point[f"{name}_std"]).values
        planes.along(axes, values, _quantity(point, name).values, codes, spread)
        planes.draw_mixed(axes, point, x, name)
        if x == "mu" and np.isfinite(point["onset_mu"]):
            axes.axvline(float(point["onset_mu"]), **ONSET)
        axes.set_ylabel(labels.label(point[name]))
    panels[0].set_ylim(0.0, 1.0)
    planes.set_side(panels[-1], "x", point[x])
    figures.legend_below(figure, panels, 4)
    note = "mean (of the frequency: middle) and standard deviation of the realisations"
    figure.suptitle(f"{title}: {note}")
    return figure
