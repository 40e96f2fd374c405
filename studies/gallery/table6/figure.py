"""Frequencies, growth rates, shares of time and windows of instability over the inclination, beside the paper."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from studies import paper
from studies.motion.regimes import KINDS, STEADY
from studies.motion.transients import damping
from studies.plotting import figures, planes
from studies.plotting.planes import COLOURS, HATCHES
from studies.study import constants
from sweeps import DONE, FAILED

Array = NDArray[Any]

# Pairs at neighbouring angles whose frequencies are nearer than this share are one branch.
SAME = 0.25
# Frequencies that differ by this factor or more, with nothing between, have panels of their own; so many at most.
APART, MOST_BANDS = 2.0, 3
# What a label takes, as a share of the axis.
LABEL = 0.12
# Frequencies by angle that the paper's text gives, and how they are marked.
PAPER: dict[str, tuple[dict[float, Any], str, float]] = {
    "paper: dominant, measured": (paper.ANGLES_MEASURED, "D", 8.0),
    "paper: dominant, simulated": (paper.ANGLES_SIMULATED, "x", 5.0),
    "paper: unstable pair": (paper.ANGLES_UNSTABLE, "^", 8.0),
}
# Where it says that the rig vibrates, but not in which regime; where it says nothing.
VIBRATES: dict[str, Any] = {"facecolor": "white", "edgecolor": figures.GREY, "hatch": "//////"}
SILENT = VIBRATES | {"hatch": ""}
STEADY_COLOUR = COLOURS[KINDS.index(STEADY)]
KHZ = 1e-3
# Of a window: what is written where its pair grows fastest, and where that is.
PEAK = ("frequency", "theta", "growth_rate")


def draw(dataset: xr.Dataset) -> Figure:
    """Frequencies, growth rates and shares of time over theta; at the foot windows, runs and the paper's text."""
    fixed, theta = constants(dataset), dataset["theta"].values
    of_paper = paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, V=paper.ANGLES_SPEED)
    points = paper_points(theta) if of_paper else {}
    lines = [dataset[name].values.ravel() for name in ("frequency", "member_dominant_frequency")]
    every = np.concatenate([*lines, *(places[:, 1] for places in points.values())])
    tiers = bands(np.sort(every[every > 0.0]))
    windows = dataset.sizes["window"]
    # Of panels, cm; legends, titles and labels come on top.
    heights = [1.0 + 4.0 * min(high / low - 1.0, 1.0) for low, high in tiers[::-1]]
    tallest = int(np.argmax(heights))
    heights[tallest] = max(heights[tallest], 3.0)
    heights += [3.6, 2.2, 2.4 + 0.6 * max(windows - 1, 0)]
    figure, panels = figures.panels(
        len(heights), 1, 17.0, 6.5 + sum(heights), sharex=True, gridspec_kw={"height_ratios": heights}
    )
    *upper, growth, shares, strips = panels
    for axes in (*upper, growth):
        for low, high in zip(dataset["window_from"].values, dataset["window_to"].values, strict=True):
            axes.axvspan(low, high, color=figures.BLACK, alpha=0.06, linewidth=0.0, zorder=0.5)
    for axes, (low, high) in zip(upper, tiers[::-1], strict=True):
        _draw_lines(axes, dataset, points)
        axes.set_ylim(KHZ * low, KHZ * high)
        # Slanted strokes where the axis of frequency is broken.
        for end, cut in ((0.0, axes is not upper[-1]), (1.0, axes is not upper[0])):
            if cut:
                stroke: dict[str, Any] = {"marker": [(-1, -0.5), (1, 0.5)], "color": "black", "clip_on": False}
                axes.plot(0.0, end, transform=axes.transAxes, markersize=9.0, **stroke)
        if axes is not upper[-1]:
            axes.spines["bottom"].set_visible(False)
            axes.tick_params(axis="x", length=0.0)
    upper[tallest].set_ylabel("frequency / kHz")
    _draw_growth(growth, dataset)
    edges = planes.edges(theta)
    planes.shares(shares, edges, dataset)
    shares.set_ylabel("share of\nthe time")
    shares.grid(False)
    # Over its panel a legend hides nothing.
    above: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2}
    strips.legend(handles=_draw_strips(strips, dataset, edges, of_paper), ncols=5, **above)
    for axes in (upper[0], growth, shares):
        if axes.get_legend_handles_labels()[0]:
            axes.legend(ncols=4 if axes is growth else 3, columnspacing=1.2, **above)
    strips.set_xlim(edges[0], edges[-1])
    strips.set_xlabel(planes.label("theta"))
    point = ", ".join(planes.named(name, fixed[name]) for name in ("V", "mu", "F"))
    figure.suptitle(f"Stability and motion over the inclination, {point}\n{damping(fixed)}")
    return figure


def paper_points(theta: Array) -> dict[str, Array]:
    """The paper's frequencies at some of the angles: by label, (angle in degrees, Hz) in rows."""
    points = {
        label: np.array([(angle, f) for angle in theta for f in np.atleast_1d(frequencies.get(float(angle), []))])
        for label, (frequencies, _, _) in PAPER.items()
    }
    return {label: places for label, places in points.items() if len(places)}


def bands(frequencies: Array) -> list[tuple[float, float]]:
    """Stretches of frequency (Hz) that hold all `frequencies` and leave out wide gaps; both ascending."""
    if not len(frequencies):
        return [(0.1, 1e3)]
    ratios = frequencies[1:] / frequencies[:-1]
    widest = np.argsort(-ratios, kind="stable")[: MOST_BANDS - 1]
    cuts = np.sort(widest[ratios[widest] >= APART]) + 1
    return [(0.93 * float(part[0]), 1.05 * float(part[-1])) for part in np.split(frequencies, cuts)]


def branches(frequency: Array) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Pairs that go over into each other from angle to angle: of each branch the places (angle, pair).

    Parameters
    ----------
    frequency : ndarray, (angles, pairs)
        NaN where there is no pair.
    """
    every: list[list[tuple[int, int]]] = []
    ends: list[list[tuple[int, int]]] = []
    for k, row in enumerate(frequency):
        going = []
        for j in np.flatnonzero(np.isfinite(row)):
            away = [abs(frequency[branch[-1]] - row[j]) for branch in ends]
            if away and min(away) <= SAME * row[j]:
                branch = ends.pop(int(np.argmin(away)))
            else:
                branch = []
                every.append(branch)
            branch.append((k, int(j)))
            going.append(branch)
        ends = going
    return [(np.array(branch)[:, 0], np.array(branch)[:, 1]) for branch in every]


def _draw_lines(axes: Axes, dataset: xr.Dataset, points: dict[str, Array]) -> None:
    """Unstable pairs and the runs' dominant frequencies, with the frequencies that the paper's text gives."""
    theta, frequency = dataset["theta"].values, dataset["frequency"].values
    _draw_branches(axes, theta, frequency, KHZ * frequency)
    each = KHZ * dataset["member_dominant_frequency"].values
    place = np.nonzero(np.isfinite(each))
    if len(place[0]):
        main = KHZ * dataset["dominant_frequency"].values
        axes.plot(theta, main, "s", color=figures.BLUE, markersize=4.5, label="dominant, median of runs")
        look: dict[str, Any] = {"color": STEADY_COLOUR, "markeredgecolor": figures.BLUE, "markeredgewidth": 0.6}
        axes.plot(theta[place[0]], each[place], "o", markersize=2.6, label="dominant, each run", **look)
    look = {"markerfacecolor": "none", "color": figures.RED, "markeredgewidth": 1.3, "zorder": 4.0}
    for label, places in points.items():
        _, marker, size = PAPER[label]
        axes.plot(places[:, 0], KHZ * places[:, 1], marker, markersize=size, label=label, **look)


def _draw_branches(axes: Axes, theta: Array, frequency: Array, y: Array) -> None:
    look: dict[str, Any] = {"color": figures.BLACK, "markersize": 3.0, "linewidth": 0.8}
    for k, place in enumerate(branches(frequency)):
        axes.plot(theta[place[0]], y[place], "o-", label="" if k else "unstable pair", **look)


def _draw_growth(axes: Axes, dataset: xr.Dataset) -> None:
    """Growth rates of the unstable pairs; where there is none, of the mode that decays most slowly."""
    theta, fastest = dataset["theta"].values, dataset["mode_growth_rate"].values
    axes.axhline(0.0, color=figures.BLACK, linewidth=0.6)
    _draw_branches(axes, theta, dataset["frequency"].values, dataset["growth_rate"].values)
    text: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": 8.0}
    for hertz, angle, rate in zip(*(dataset[f"window_peak_{name}"].values for name in PEAK), strict=True):
        axes.annotate(f"{hertz:.0f} Hz", (angle, rate), (0, 4), **text)
    stable = np.where(fastest > 0.0, np.nan, fastest)
    decay = "slowest decay, where none grows"
    axes.plot(theta, stable, ".-", color=figures.GREEN, linewidth=2.0, markersize=5.0, label=decay)
    starts, ends = dataset["window_from"].values, dataset["window_to"].values
    within = [int(np.sum((starts <= start) & (start < ends))) for start in starts]
    for count in range(1, max(within, default=0) + 1):
        # As `count` windows over each other are shaded.
        shade: dict[str, Any] = {"color": figures.BLACK, "alpha": 1.0 - 0.94**count, "linewidth": 0.0}
        axes.fill_between([], [], label=f"{count} pair{'s' * (count > 1)} unstable", **shade)
    axes.margins(y=0.15)
    axes.set_ylabel("growth rate / (1/s)")


def _draw_strips(axes: Axes, dataset: xr.Dataset, edges: Array, of_paper: bool) -> list[Patch]:
    """The paper's text, what the runs do, and windows of instability, upwards; patches for the legend."""
    theta, status, regime = (dataset[name].values for name in ("theta", "status", "member_regime"))
    steady = np.any([(low < theta) & (theta < high) for low, high in paper.STEADY_ANGLES], axis=0)
    vibrates = np.isin(theta, list(paper.ANGLES_MEASURED))
    ticks, kinds, handles = [], set(), []
    look: dict[str, Any] = {"align": "edge", "edgecolor": figures.GREY, "linewidth": 0.0}
    strip = partial(axes.bar, edges[:-1], width=np.diff(edges))
    if of_paper and np.any(steady | vibrates):
        ticks.append("paper's text")
        strip(0.8 * steady, **look | {"facecolor": STEADY_COLOUR})
        strip(0.8 * vibrates, **look | VIBRATES)
        kinds |= {KINDS.index(STEADY)} if steady.any() else set()
        handles = [
            Patch(linewidth=0.5, label=f"paper: {label}", **patch)
            for label, patch in (("vibrates", VIBRATES), ("says nothing", SILENT))
        ]
    below = np.full(len(theta), float(len(ticks)))
    for code, kind in enumerate(KINDS):
        share = (status == FAILED) * 1.0 if kind == "failed" else (regime == code).mean(axis=1) * (status == DONE)
        if share.any():
            strip(0.8 * share, bottom=below, facecolor=COLOURS[code], hatch=HATCHES.get(kind, ""), **look)
            below += 0.8 * share
            kinds.add(code)
    ticks.append("runs")
    windows = dataset.sizes["window"]
    _draw_windows(axes, dataset, len(ticks))
    heights = [*(np.arange(len(ticks)) + 0.4), *([len(ticks) - 0.05 + 0.25 * windows] if windows else [])]
    axes.set_ylim(-0.1, len(ticks) + 0.5 * windows)
    axes.set_yticks(heights, [*ticks, "unstable"][: len(heights)])
    axes.tick_params(axis="y", length=0.0)
    axes.spines["left"].set_visible(False)
    axes.grid(False)
    return planes.patches(kinds) + handles


def _draw_windows(axes: Axes, dataset: xr.Dataset, bottom: float) -> None:
    """Each window as a bar between its bounds; a bound that the range cuts off has no number."""
    wide = LABEL * np.ptp(dataset["theta"].values)
    text: dict[str, Any] = {"va": "center", "fontsize": 8.0}
    for k in range(dataset.sizes["window"]):
        at = dataset.isel(window=k)
        low, high, middle = float(at["window_from"]), float(at["window_to"]), bottom + 0.5 * k + 0.2
        axes.barh(middle, high - low, 0.36, left=low, color=COLOURS[KINDS.index("stuck")], linewidth=0.0)
        if not int(at["window_open_from"]):
            axes.text(low, middle, f"{low:.2f}° ", ha="right", **text)
        if not int(at["window_open_to"]):
            axes.text(high, middle, f" {high:.2f}°", ha="left", **text)
        if high - low > wide:
            peak = f"{float(at['window_peak_frequency']):.0f} Hz"
            axes.text(0.5 * (low + high), middle, peak, ha="center", color="white", **text)
