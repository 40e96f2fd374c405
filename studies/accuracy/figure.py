"""How costs and errors are drawn: work-precision diagrams, and what the parts are worth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from studies.accuracy import settings as asked
from studies.accuracy import styles as looks
from studies.accuracy.convergence import draw_cutoffs, draw_elements, draw_modes, draw_steps
from studies.accuracy.errors import DIMS, FIGURES, place
from studies.accuracy.rows import Row, find, root_mean_square, rows
from studies.plotting import figures

# A row of the figure, relative.
HEIGHTS = (1.2, 0.95, 1.25, 0.9)
# A run alone is drawn beside one of a batch if its cost is that much greater.
DEARER = 1.1


def draw(dataset: xr.Dataset) -> Figure:
    """Errors against cost, against cut-off and step, of each part and figure, and of sliding stability."""
    data = dataset.transpose(*DIMS, ...)
    every = rows(data)
    figure, panels = figures.panels(4, 2, 17.0, 25.5, gridspec_kw={"height_ratios": HEIGHTS})
    _draw_statistics(panels[0], every)
    _draw_bursts(panels[1], data, every)
    draw_cutoffs(panels[2], data)
    draw_steps(panels[3], data)
    _draw_parts(panels[4], data, every)
    _draw_default(panels[5], data)
    draw_modes(panels[6], data)
    draw_elements(panels[7], data)
    for axes in panels[:2]:
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_minor_formatter(NullFormatter())
    for letter, axes in zip("abcdefgh", panels, strict=True):
        axes.set_title(f"({letter}) {axes.get_title()}", loc="left", fontsize=9.0)
        axes.set_title("")
    figures.legend_below(figure, panels[:2], 3)
    for legend in figure.legends:
        legend.set_title("(a) and (b)")
    figure.suptitle("Run time against error")
    return figure


def _curve(every: Sequence[Row], kind: str) -> list[Row]:
    """Settings of `fast` of one kind, other things being at their defaults."""
    return [
        row
        for row in every
        if (row.method, row.kind) == (asked.FAST, kind) and not asked.OPTIONS[row.setting].share
    ]


def _draw_statistics(axes: Axes, every: Sequence[Row]) -> None:
    """Mismatch of the figures against cost."""

    def add(chosen: Sequence[Row], look: looks.Look) -> None:
        looks.plot(axes, [(row.cost, row.mismatch) for row in chosen], look)

    for kind, look in looks.CURVES.items():
        add(_curve(every, kind), look)
    fast = [row for row in every if row.method == asked.FAST and row.kind != "default"]
    add([row for row in fast if asked.OPTIONS[row.setting].share], looks.BOTH)
    add([row for row in fast if row.kind not in looks.CURVES], looks.OTHER)
    for method in (asked.EXACT, asked.PAPER):
        chosen = [row for row in every if row.method == method]
        add(chosen, looks.METHODS[method] | {"label": asked.METHODS[method]})
    own = find(every, asked.FAST)
    if own is not None:
        add([own], looks.DEFAULT)
        if own.alone > DEARER * own.cost:
            alone = looks.DEFAULT | {"markerfacecolor": "none", "label": "fast: default, one run alone"}
            looks.plot(axes, [(own.alone, own.mismatch)], alone)
        if np.isfinite(own.scatter):
            axes.axhspan(0.0, own.scatter, color=figures.GREY, alpha=0.25, linewidth=0.0, label="scatter alone")
    looks.tolerance(axes)
    # What has a cost and no ensemble.
    for method, text in (
        (asked.PAPER, "paper, the reference"),
        (asked.ELEMENTS, "paper in finite elements"),
        (asked.EVENTS, "solve_ivp"),
    ):
        row = find(every, method)
        if row is not None and np.isfinite(row.alone):
            looks.upright(axes, row.alone, text, bottom=False)
    axes.set(xscale="log", yscale="log", xlabel="processor s per simulated s", ylabel="error / tolerance, rms")
    axes.set_title("figures after the first burst")


def _draw_bursts(axes: Axes, data: xr.Dataset, every: Sequence[Row]) -> None:
    """Error of the first slip's motion against cost."""

    def add(chosen: Sequence[Row], look: looks.Look) -> None:
        errors = data["slip_velocity_error"]
        at = [errors.sel({"method": row.method, "setting": row.setting}).values for row in chosen]
        pairs = [(row.alone, root_mean_square(each)) for row, each in zip(chosen, at, strict=True)]
        looks.plot(axes, pairs, look)
        if look is looks.DEFAULT:
            looks.slope(axes, *pairs[0], 2, 2.5)

    for kind, look in looks.CURVES.items():
        add(_curve(every, kind), look)
    for method, look in looks.METHODS.items():
        chosen = sorted((row for row in every if row.method == method), key=lambda row: row.alone)
        add(chosen, look | {"label": asked.METHODS[method]})
    own = find(every, asked.FAST)
    if own is not None:
        add([own], looks.DEFAULT)
    axes.set(xscale="log", yscale="log", xlabel="processor s per simulated s", ylabel="largest error of $v_B$")
    axes.set_title("half-way to the first separation")


def _draw_parts(axes: Axes, data: xr.Dataset, every: Sequence[Row]) -> None:
    """Mismatch at each scene of what is no scale: what each part of a method is worth."""
    scales = [(asked.FAST, kind) for kind in looks.CURVES]
    chosen = [row for row in every if np.isfinite(row.mismatch) and (row.method, row.kind) not in scales]
    for y, row in enumerate(chosen):
        at = data["mismatch"].sel({"method": row.method, "setting": row.setting}).values
        axes.plot(at, np.full(len(at), y), color=figures.GREY, linewidth=0.5)
        for value, look in zip(at, looks.SCENES, strict=False):
            axes.plot(value, y, **{**look, "linestyle": "none", "markersize": 4.0})
    axes.axvline(1.0, color=figures.BLACK, linewidth=0.8, linestyle=":")
    names = [f"{asked.METHODS[row.method]}, {row.name}" for row in chosen]
    axes.set_yticks(range(len(chosen)), names, fontsize=looks.TINY)
    axes.set(xscale="log", xlabel="error / tolerance, rms", ylim=(max(len(chosen), 1) - 0.5, -0.5))
    axes.set_title("what the parts are worth")


def _draw_default(axes: Axes, data: xr.Dataset) -> None:
    """Each figure of `fast` by default at each scene, in units of its tolerance, with two standard errors."""
    own = place(data, asked.FAST, asked.DEFAULT)
    known = [each for each in FIGURES if each.asked]
    for y, each in enumerate(known):
        if own is None or "mismatch" not in data:
            break
        error = data[f"{each.name}_error"].values[own] / each.tolerance
        with np.errstate(divide="ignore", invalid="ignore"):
            standard = np.nan_to_num(np.abs(error / data[f"{each.name}_deviation"].values[own]))
        for n, look in zip(range(len(error)), looks.SCENES, strict=False):
            height = y + 0.6 * ((n + 0.5) / len(error) - 0.5)
            axes.plot(error[n] + 2.0 * standard[n] * np.array([-1.0, 1.0]), [height] * 2, color=look["color"])
            axes.plot(error[n], height, **{**look, "linestyle": "none", "markersize": 4.0})
    for x in (-1.0, 1.0):
        axes.axvline(x, color=figures.BLACK, linewidth=0.8, linestyle=":")
    axes.set_yticks(range(len(known)), [each.long_name for each in known], fontsize=7.0)
    axes.set(xlabel="error / tolerance, ± 2 standard errors", ylim=(len(known) - 0.5, -0.5))
    axes.set_title("fast by default")
