"""Figures of any result: quantities over one or two parameters, draws as scatter plots, and recorded series."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy
import xarray as xr

from studies import labels
from studies.motion.regimes import kinds
from studies.plotting import figures, planes
from studies.results import PATHS
from studies.summary import quantities
from sweeps import DONE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Panels of a figure: quantities down, values of a further parameter or parameters that are drawn across.
MOST_DOWN, MOST_ACROSS = 4, 3
# Rows of recorded series; the share of a run before its spectrum begins, and the segments of that.
MOST_SERIES, BEGIN, SEGMENTS = 6, 0.3, 8
SERIES = ("velocity_B", "normal_force", "tangential_force", "slip_velocity")


def draw(dataset: xr.Dataset) -> Figure:
    """The first quantities with one number a point, over the parameters that vary."""
    dims = [str(dim) for dim in dataset["status"].dims]
    done = dataset.where(dataset["status"] == DONE)
    names = [name for name in quantities(dataset) if np.isfinite(dataset[name]).any()][:MOST_DOWN]
    title = str(dataset.attrs.get("title", ""))
    if not names or not bool((dataset["status"] == DONE).any()):
        figure, (axes,) = figures.panels(1, 1, 12.0, 5.0)
        axes.axis("off")
        why = "no point has a number to draw" if quantities(dataset) else "no output has one number a point"
        axes.text(0.5, 0.5, why, ha="center", va="center")
        figure.suptitle(figures.fitted(title, 12.0))
        return figure
    if dims[0] in PATHS:
        return _draw_scatter(done, names, title)
    varying = (
        sorted((dim for dim in dims if dataset.sizes[dim] > 1), key=lambda dim: -dataset.sizes[dim]) or dims[:1]
    )
    x, *others = varying
    if len(others) > 1 or (others and dataset.sizes[others[0]] > 2 * MOST_ACROSS):
        return _draw_planes(done, names, x, others, title)
    figure, panels = figures.panels(len(names), 1, 14.0, 3.0 + 4.0 * len(names), sharex=True)
    done = done.isel({dim: 0 for dim in dims if dim not in varying})
    for axes, name in zip(panels, names, strict=True):
        curves = labels.readable(done[name].transpose(x, *others))
        values = labels.readable(done[x]).values
        spread = labels.readable(done[f"{name}_se"]) if f"{name}_se" in done else None
        for k in range(done.sizes[others[0]] if others else 1):
            at = {others[0]: k} if others else {}
            error = None if spread is None else np.nan_to_num(spread.transpose(x, *others).isel(at).values)
            text = labels.named(others[0], done[others[0]][k]) if others else None
            axes.errorbar(values, curves.isel(at).values, error, marker="o", markersize=3.0, label=text)
            planes.draw_mixed(axes, done.isel(at), x, name)
        axes.set_ylabel(figures.fitted(labels.label(dataset[name], long=True), 6.0))
    planes.set_side(panels[-1], "x", dataset[x])
    figures.legend_below(figure, panels, 3)
    figure.suptitle(figures.fitted(title, 14.0))
    return figure


def _draw_planes(done: xr.Dataset, names: Sequence[str], x: str, others: Sequence[str], title: str) -> Figure:
    """Planes of the two longest parameters, a row for each quantity, a column for values of a third."""
    y, *rest = others
    across = planes.subset(done.sizes[rest[0]], MOST_ACROSS) if rest else [0]
    size = max(13.0, 1.5 + 7.0 * len(across)), 2.5 + 6.0 * len(names)
    figure, panels = figures.panels(len(names), len(across), *size)
    for k, axes in enumerate(panels):
        name, column = names[k // len(across)], across[k % len(across)]
        at = {dim: 0 for dim in done["status"].dims if dim not in (x, y)} | ({rest[0]: column} if rest else {})
        array = done[name].isel(at)
        mesh = planes.cells(axes, labels.readable(array), x, y)
        planes.mark_mixed(axes, done.isel(at), x, y)
        bar = figure.colorbar(mesh, ax=axes)
        bar.set_label(figures.fitted(labels.label(done[name], long=True), 6.0))
        if rest:
            axes.set_title(labels.named(rest[0], done[rest[0]][column]), loc="left", fontsize=9.0)
    figure.suptitle(figures.fitted(title, size[0]))
    return figure


def _draw_scatter(done: xr.Dataset, names: Sequence[str], title: str) -> Figure:
    """Each quantity over each parameter that is drawn or comes from a table."""
    dims = done["status"].dims
    varied = [
        str(n) for n, c in done.coords.items() if c.dims == dims[:1] and n not in PATHS and c.dtype.kind in "if"
    ]
    varied = varied[:MOST_ACROSS]
    size = max(10.0, 2.0 + 5.0 * len(varied)), 2.5 + 4.0 * len(names)
    figure, panels = figures.panels(len(names), max(len(varied), 1), *size, sharey="row", sharex="col")
    for k, axes in enumerate(panels):
        name, over = names[k // max(len(varied), 1)], done[varied[k % len(varied)]] if varied else done[dims[0]]
        values = labels.readable(done[name]).transpose(dims[0], ...).values.reshape(done.sizes[dims[0]], -1)
        axes.plot(labels.readable(over).values, values, ".", color=figures.BLUE, markersize=3.0)
        axes.set(xlabel=labels.label(over), ylabel=figures.fitted(labels.label(done[name], long=True), 6.0))
        axes.label_outer()
    figure.suptitle(figures.fitted(title, size[0]))
    return figure


def series_of(dataset: xr.Dataset) -> list[str]:
    """The recorded series of a result."""
    return [name for name in SERIES if name in dataset and "elapsed" in dataset[name].dims]


def draw_series(dataset: xr.Dataset, names: Sequence[str]) -> Figure:
    """A row for each point and series: over time, and its power spectral density."""
    points = dataset.stack(point=[dim for dim in dataset[names[0]].dims if dim != "elapsed"])
    chosen = planes.subset(points.sizes["point"], max(1, MOST_SERIES // len(names)))
    rows = [(points.isel(point=k), name) for k in chosen for name in names][:MOST_SERIES]
    figure, panels = figures.panels(len(rows), 2, 17.0, 3.0 + 3.6 * len(rows), width_ratios=(2, 1))
    elapsed = dataset["elapsed"].values
    rate = 1.0 / float(elapsed[1] - elapsed[0]) if len(elapsed) > 1 else 1.0
    for (at, name), left, right in zip(rows, panels[::2], panels[1::2], strict=True):
        values = labels.unit_of(dataset[name])[1] * at[name].values.astype(float)
        figures.trace(left, elapsed, values, color=figures.BLUE)
        left.set_ylabel(figures.fitted(labels.label(dataset[name]), 4.0))
        place = ", ".join(labels.named(dim, at[dim]) for dim in map(str, dataset["status"].dims))
        left.set_title(place, loc="left", fontsize=9.0)
        later = values[int(BEGIN * len(values)) :]
        if np.isfinite(later).all() and len(later) >= 2 * SEGMENTS:
            frequency, power = scipy.signal.welch(later, rate, nperseg=2 * len(later) // SEGMENTS)
            right.plot(1e-3 * frequency, figures.decibels(power), color=figures.BLUE, linewidth=0.8)
            right.set_xlim(0.0, min(10.0, 0.5e-3 * rate))
        right.set_ylabel(f"dB re ({labels.unit_of(dataset[name])[0]})²/Hz")
    panels[-2].set_xlabel("time / s")
    panels[-1].set_xlabel("frequency / kHz")
    figure.suptitle(f"Recorded series{planes.of_all(chosen, points.sizes['point'])}")
    return figure


def draw_regimes(dataset: xr.Dataset) -> Figure:
    """Regimes over the two longest parameters, a panel for each value of up to two others."""
    dims = [str(dim) for dim in dataset["status"].dims]
    codes = xr.DataArray(kinds(dataset), coords=dataset["status"].coords, dims=dims)
    x, y, *others = sorted(dims, key=lambda dim: -dataset.sizes[dim])
    single = [labels.named(dim, dataset[dim][0]) for dim in dims if dataset.sizes[dim] == 1]
    return planes.over_others(codes, x, y, others, ", ".join(["Regime of the motion", *single]), planes.regimes)
