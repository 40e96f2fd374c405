"""How regimes are drawn: as a plane beside what the motion is like there, a row of planes, or along one axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from studies import paper
from studies.gallery.regimes.compare_linear import BELOW, VERDICTS, uncertain
from studies.motion import regimes
from studies.motion.regimes import KINDS
from studies.motion.transients import damping
from studies.plotting import figures, planes
from studies.plotting.planes import COLOURS, named
from studies.study import constants
from sweeps import DONE

# Shown beside the regimes: factor, what stands at the scale, and whether only a vibration has it.
QUANTITIES = {
    "stick_fraction": (1.0, "share of time in stick", False),
    "dominant_frequency": (1e-3, "dominant frequency / kHz", True),
    "velocity_rms": (1e3, "RMS of $v_B$ / (mm/s)", True),
}
# Lines that are seen on any colour.
ONSET: dict[str, Any] = {
    "color": "black",
    "linestyle": "--",
    "linewidth": 1.0,
    "path_effects": [patheffects.withStroke(linewidth=2.0, foreground="white")],
}
# Marks of cells: whose motion is not what stability predicts, whose repeat runs differ, and the paper's own.
RIM: dict[str, Any] = {"linestyle": "none", "markeredgecolor": "black"}
VERDICT_MARKS: dict[str, dict[str, Any]] = {
    "subcritical": {"marker": "s", "color": figures.RED, "label": "subcritical: vibrates\nthough stable"},
    "unstable above the band": {"marker": "P", "color": "white", "label": f"stable {BELOW},\nunstable above"},
    "quiet though unstable": {"marker": "X", "color": figures.ORANGE, "label": "steady sliding\nthough unstable"},
}
DIFFER: dict[str, Any] = RIM | {"marker": "o", "markersize": 2.4, "color": "black"}
DIFFER |= {"markeredgecolor": "white", "markeredgewidth": 0.4, "label": "repeat runs differ"}
PAPER_MARKS = {"intermittent": "^", "periodic": "D"}
# A scale leaves out this share of the cells at either end, single ones would take all of it; it is logarithmic
# where its ends are so many times apart, else it has steps.
RARE, WIDE = 0.02, 10.0
# Shades of a scale that is not logarithmic, at most.
STEPS = 8


def draw(dataset: xr.Dataset) -> Figure:
    """Regimes and figures of the motion over two axes, planes of regimes over more, or all along one axis."""
    x, y, others = arranged(dataset)
    fixed = constants(dataset)
    single = [name for name in (*others, x, y) if dataset.sizes[name] == 1]
    held = ", ".join(named(name, dataset[name].values[0]) for name in single)
    runs = f"{fixed['members']} run{'s' if fixed['members'] > 1 else ''} of each scene"
    about = ", ".join(part for part in (held, runs, damping(fixed), _undecided(dataset)) if part)
    if dataset.sizes[y] == 1:
        return _draw_along(dataset.isel({name: 0 for name in (y, *others)}), x, about)
    varying = [name for name in others if dataset.sizes[name] > 1]
    if varying:
        return _draw_planes(dataset, x, y, varying, about)
    return _draw_plane(dataset.isel(dict.fromkeys(others, 0)).transpose(y, x, ...), x, y, about)


def arranged(dataset: xr.Dataset) -> tuple[str, str, list[str]]:
    """The axes across and up, and the others: V and mu, unless they have one value where another has more."""
    order = ["V", "mu", *sorted(("theta", "F"), key=lambda name: -dataset.sizes[name])]
    first, second, *others = sorted(order, key=lambda name: dataset.sizes[name] == 1)
    # Friction goes up, where it is one of both.
    x, y = (second, first) if first == "mu" and dataset.sizes[second] > 1 else (first, second)
    return x, y, others


def _undecided(dataset: xr.Dataset) -> str:
    count = np.count_nonzero(regimes.is_of(regimes.kinds(dataset), "undecided"))
    return f"undecided: {count} of {int((dataset['status'] == DONE).sum())}"


def _draw_plane(at: xr.Dataset, x: str, y: str, about: str) -> Figure:
    """A plane of regimes, and below it shades of what the motion is like."""
    layout = [["regime", "regime", "key"], list(QUANTITIES)]
    figure, panels = figures.mosaic(layout, 17.0, 15.0, height_ratios=(1.5, 1.0))
    top, key = panels.pop("regime"), panels.pop("key")
    key.axis("off")
    text = "white: no vibration"
    if constants(at)["members"] > 1:
        text = f"(b), (d): mean of the repeat runs\n(c): the one in the middle\n{text}"
    key.text(0.0, 0.0, text, fontsize=8.0, linespacing=1.4)
    key.legend(handles=_in_order(_draw_regimes(top, at, x, y)), loc="upper left", borderaxespad=0.0)
    top.set_title("(a) regime", loc="left", fontsize=9.0)
    for letter, (name, axes) in zip("bcd", panels.items(), strict=True):
        _draw_shades(axes, at, x, y, name)
        axes.set_title(f"({letter}) {QUANTITIES[name][1]}", loc="left", fontsize=9.0)
        axes.label_outer()
    figure.suptitle(figures.fitted(f"Regimes: {about}", 17.0))
    return figure


def _draw_planes(dataset: xr.Dataset, x: str, y: str, varying: Sequence[str], about: str) -> Figure:
    """A plane of regimes for each value of the others, across and down."""

    def size(across: int, down: int) -> tuple[float, float]:
        # A figure of one or two planes across needs room for its title.
        return min(2.0 + 5.0 * max(across, 2), 17.0), 5.0 * down + 3.5

    figure, handles, left_out = planes.multiples(
        dataset, x, y, varying, size, lambda axes, at: _draw_regimes(axes, at, x, y)
    )
    width = 2.54 * figure.get_figwidth()
    figure.legend(
        handles=_in_order([handle for each in handles for handle in each]),
        loc="outside lower center",
        ncols=2 if width < 14.0 else 3,
    )
    figure.suptitle(figures.fitted(f"Regimes: {', '.join(filter(None, (about, left_out)))}", width))
    return figure


def _in_order(handles: Sequence[Any]) -> list[Any]:
    """Each entry of a legend once, the regimes in their order before anything else."""
    once = {handle.get_label(): handle for handle in handles}
    ordered = [once.pop(kind) for kind in KINDS if kind in once]
    return ordered + list(once.values())


def _draw_regimes(axes: Axes, at: xr.Dataset, x: str, y: str) -> list[Any]:
    """Draw the plane of regimes and the marks of its cells; return the handles of its legend."""
    codes, xs, ys = regimes.kinds(at), at[x].values, at[y].values
    planes.classes(axes, x, xs, y, ys, codes, COLOURS)
    figures.one_two_five(axes.xaxis, axes.yaxis)
    ends = planes.edges(planes.shown(x, xs)), planes.edges(planes.shown(y, ys))
    failed = np.ma.masked_not_equal(codes, KINDS.index("failed"))
    axes.pcolor(*ends, failed, hatch="xxxx", facecolor="none", edgecolor=figures.GREY, linewidth=0.0)
    handles: list[Any] = planes.patches(np.unique(codes))
    if _draw_onset(axes, at, x, y):
        handles.append(Line2D([], [], **ONSET, label=f"onset of flutter\n{BELOW}"))

    def mark(chosen: NDArray[np.bool_], **look: Any) -> list[Line2D]:
        rows, columns = np.nonzero(chosen)
        places = zip(planes.shown(x, xs)[columns], planes.shown(y, ys)[rows], strict=True)
        return planes.marks(axes, list(places), **look)

    for name, look in VERDICT_MARKS.items():
        handles += mark(at["verdict"].values == VERDICTS.index(name), markersize=4.0, **RIM, **look)
    differ = mark(uncertain(at), **DIFFER)
    for dot in differ:
        dot.set_markersize(4.0)
    return [*handles, *differ, *_draw_paper(axes, at, x, y)]


def _draw_onset(axes: Axes, at: xr.Dataset, x: str, y: str) -> bool:
    """Where steady sliding loses its stability; false where that is not in the plane."""
    onset = at["onset_mu"].values
    if "mu" not in (x, y) or not np.any(np.isfinite(onset)):
        return False
    if y == "mu" and x == "theta":
        axes.plot(at["theta"].values, onset, **ONSET)
    else:
        (axes.axhline if y == "mu" else axes.axvline)(float(onset), **ONSET)
    return True


def _draw_paper(axes: Axes, at: xr.Dataset, x: str, y: str) -> list[Any]:
    """The paper's scenes, where they are in the plane, marked by the kind of vibration it says."""
    if (x, y) != ("V", "mu") or not paper.is_rig(at):
        return []
    if not (np.isclose(at["theta"], paper.THETA) and np.isclose(at["F"], paper.LOAD)):
        return []
    handles = []
    for kind, marker in PAPER_MARKS.items():
        places = [
            (float(planes.shown("V", V)), paper.MU) for V, regime in paper.VIBRATION.items() if regime == kind
        ]
        look = RIM | {"marker": marker, "color": "white", "markersize": 6.0, "label": f"paper: {kind}"}
        handles += planes.marks(axes, places, **look)
    return handles


def _draw_shades(axes: Axes, at: xr.Dataset, x: str, y: str, name: str) -> None:
    """One quantity over the plane, with its scale."""
    values = _shown(at, name)
    finite = values[np.isfinite(values)]
    norm, extend, ticks = Normalize(0.0, 1.0), "neither", None
    if name != "stick_fraction" and len(finite):
        low, high = np.quantile(finite, [RARE, 1.0 - RARE])
        if 0.0 < WIDE * low < high:
            norm = LogNorm(low, high)
        else:
            levels = np.asarray(MaxNLocator(STEPS, steps=[1, 2, 5, 10]).tick_values(low, high))
            norm, ticks, low, high = BoundaryNorm(levels, 256), levels[::2], levels[0], levels[-1]
        extend = {(1, 1): "both", (1, 0): "min", (0, 1): "max"}.get(
            (finite.min() < low, finite.max() > high), extend
        )
    mesh = planes.shades(axes, x, at[x].values, y, at[y].values, values, norm)
    bar = axes.figure.colorbar(mesh, ax=axes, location="bottom", pad=0.02, aspect=25, extend=extend, ticks=ticks)
    bar.outline.set_visible(False)
    figures.one_two_five(bar.ax.xaxis, axes.xaxis, axes.yaxis)
    _draw_onset(axes, at, x, y)


def _shown(at: xr.Dataset, name: str) -> NDArray[Any]:
    """A quantity in the unit that it is shown in, NaN where the motion has no such thing."""
    factor, _, vibrating = QUANTITIES[name]
    values = factor * at[name].values.astype(float)
    return np.where(regimes.is_of(regimes.kinds(at), *regimes.VIBRATING), values, np.nan) if vibrating else values


def _draw_along(at: xr.Dataset, x: str, about: str) -> Figure:
    """The same along one axis: the spread of the repeat runs, marked by the regime."""
    figure, panels = figures.panels(len(QUANTITIES), 1, 15.0, 16.0, sharex=True)
    values, codes = planes.shown(x, at[x].values), regimes.kinds(at)
    for axes, (name, (factor, text, _)) in zip(panels, QUANTITIES.items(), strict=True):
        heights, spread = _shown(at, name), factor * at[f"{name}_std"].values
        planes.along(axes, values, heights, codes, spread)
        onset = at["onset_mu"].values
        if x == "mu" and np.isfinite(onset):
            axes.axvline(float(onset), **ONSET, label=f"onset of flutter\n{BELOW}")
        axes.set_ylabel(text)
    panels[0].set_ylim(0.0, 1.0)
    ends = planes.edges(values)
    if planes.is_logarithmic(values):
        panels[-1].set_xscale("log")
        figures.one_two_five(panels[-1].xaxis)
    planes.mark_few(panels[-1].xaxis, values)
    panels[-1].set_xlim(ends[0], ends[-1])
    panels[-1].set_xlabel(planes.label(x))
    figures.legend_below(figure, panels, 4)
    note = "mean (of the frequency: middle) and standard deviation of the repeat runs"
    figure.suptitle(figures.fitted(f"Regimes: {about}\n{note}", 15.0))
    return figure
