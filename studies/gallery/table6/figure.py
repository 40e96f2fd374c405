"""How the inclinations are drawn: lines, growth rates and contact, model and paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from studies.gallery.scenes.figure import STATE_COLOURS
from studies.gallery.table6.windows import SLIDES, STEADY, VIBRATES
from studies.motion.regimes import KINDS
from studies.plotting import figures, planes
from studies.plotting.planes import COLOURS, HATCHES
from studies.study import constants
from sweeps import DONE, FAILED

# Pairs at neighbouring angles whose frequencies are nearer than this share are one branch.
SAME = 0.25
# Frequencies that differ by this factor or more, with nothing between, have panels of their own; so many at most.
APART, MOST_BANDS = 2.0, 3
# What a label takes, as a share of the axis.
ROOM = 0.12
# The paper's text, and how its lines look.
UNTOLD: dict[str, Any] = {"facecolor": "white", "edgecolor": figures.GREY, "hatch": "//////"}
SAID = {
    "measured_frequency": ("D", 8.0, "paper: main line measured"),
    "simulated_frequency": ("x", 5.0, "paper: main line simulated"),
    "unstable_frequency": ("^", 8.0, "paper: unstable pair"),
}
KHZ = 1e-3


def draw(dataset: xr.Dataset) -> Figure:
    """Frequencies, growth rates and shares of time over theta; at the foot model and paper under each other."""
    given, theta = constants(dataset), dataset["theta"].values
    tiers = bands(_frequencies(dataset))
    rows = window_rows(dataset)
    # Of panels, cm; legends, titles and labels come on top.
    heights = [1.0 + 4.0 * min(high / low - 1.0, 1.0) for low, high in tiers[::-1]]
    tallest = int(np.argmax(heights))
    heights[tallest] = max(heights[tallest], 3.0)
    heights += [3.6, 2.2, 2.4 + 0.6 * max(rows, default=0)]
    figure, panels = figures.panels(
        len(heights), 1, 17.0, 6.5 + sum(heights), sharex=True, gridspec_kw={"height_ratios": heights}
    )
    *upper, growth, shares, strips = panels
    for axes in (*upper, growth):
        for low, high in zip(dataset["window_from"].values, dataset["window_to"].values, strict=True):
            axes.axvspan(low, high, color=figures.BLACK, alpha=0.06, linewidth=0.0, zorder=0.5)
    for axes, (low, high) in zip(upper, tiers[::-1], strict=True):
        _draw_lines(axes, dataset)
        axes.set_ylim(KHZ * low, KHZ * high)
        if axes is not upper[-1]:
            axes.spines["bottom"].set_visible(False)
            axes.tick_params(axis="x", length=0.0)
    edges = planes.edges(theta)
    _draw_growth(growth, dataset)
    _draw_shares(shares, dataset, edges)
    strips.legend(handles=_draw_strips(strips, dataset, edges, rows), **_above(5))
    for axes in (upper[0], growth, shares):
        if axes.get_legend_handles_labels()[0]:
            axes.legend(**_above(3))
    upper[tallest].set_ylabel("frequency / kHz")
    strips.set_xlim(edges[0], edges[-1])
    strips.set_xlabel(planes.label("theta"))
    figure.suptitle(
        f"Stability and motion over the inclination, V = {1e3 * given['V']:g} mm/s, μ = {given['mu']:g}, "
        f"F = {given['F']:g} N"
    )
    return figure


def _above(columns: int) -> dict[str, Any]:
    """Where a panel's legend stands: over it, so that it hides nothing."""
    return {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": columns, "borderaxespad": 0.2}


def _frequencies(dataset: xr.Dataset) -> NDArray[Any]:
    """All frequencies that are drawn, Hz."""
    names = ("frequency", "member_dominant_frequency", *(f"{name}_paper" for name in SAID))
    every = np.concatenate([dataset[name].values.ravel() for name in names])
    return np.asarray(np.sort(every[every > 0.0]))


def bands(frequencies: NDArray[Any]) -> list[tuple[float, float]]:
    """Stretches of frequency (Hz) that hold all `frequencies` and leave out wide gaps; both ascending."""
    if not len(frequencies):
        return [(0.1, 1e3)]
    ratios = frequencies[1:] / frequencies[:-1]
    widest = np.argsort(-ratios, kind="stable")[: MOST_BANDS - 1]
    cuts = np.sort(widest[ratios[widest] >= APART]) + 1
    return [(0.93 * float(part[0]), 1.05 * float(part[-1])) for part in np.split(frequencies, cuts)]


def branches(frequency: NDArray[Any]) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Pairs that go over into each other from angle to angle: of each branch the places (angle, pair).

    Parameters
    ----------
    frequency : ndarray, (angles, pairs)
        NaN where there is no pair.
    """
    found: list[list[tuple[int, int]]] = []
    ends: list[list[tuple[int, int]]] = []
    for k, row in enumerate(frequency):
        going = []
        for j in np.flatnonzero(np.isfinite(row)):
            away = [abs(frequency[branch[-1]] - row[j]) for branch in ends]
            if away and min(away) <= SAME * row[j]:
                branch = ends.pop(int(np.argmin(away)))
            else:
                branch = []
                found.append(branch)
            branch.append((k, int(j)))
            going.append(branch)
        ends = going
    return [(np.array(branch)[:, 0], np.array(branch)[:, 1]) for branch in found]


def _draw_lines(axes: Axes, dataset: xr.Dataset) -> None:
    """Unstable pairs and the runs' main lines, with the frequencies that the paper's text gives."""
    theta, frequency = dataset["theta"].values, dataset["frequency"].values
    _draw_branches(axes, theta, frequency, KHZ * frequency, "unstable pair")
    each = KHZ * dataset["member_dominant_frequency"].values
    place = np.nonzero(np.isfinite(each))
    if len(place[0]):
        main = KHZ * dataset["dominant_frequency"].values
        axes.plot(theta, main, "s", color=figures.BLUE, markersize=4.5, label="main line, median of the runs")
        look: dict[str, Any] = {"color": COLOURS[STEADY], "markeredgecolor": figures.BLUE, "markeredgewidth": 0.6}
        axes.plot(theta[place[0]], each[place], "o", markersize=2.6, label="main line of each run", **look)
    for name, (marker, size, label) in SAID.items():
        said = KHZ * dataset[f"{name}_paper"].values.reshape(len(theta), -1)
        place = np.nonzero(np.isfinite(said))
        if len(place[0]):
            open_look: dict[str, Any] = {"markerfacecolor": "none", "color": figures.RED, "markeredgewidth": 1.3}
            axes.plot(theta[place[0]], said[place], marker, markersize=size, label=label, zorder=4.0, **open_look)


def _draw_branches(axes: Axes, theta: NDArray[Any], frequency: NDArray[Any], y: NDArray[Any], label: str) -> None:
    look: dict[str, Any] = {"color": figures.BLACK, "markersize": 3.0, "linewidth": 0.8}
    for k, place in enumerate(branches(frequency)):
        axes.plot(theta[place[0]], y[place], "o-", label="" if k else label, **look)


def _draw_growth(axes: Axes, dataset: xr.Dataset) -> None:
    """Growth rates of the unstable pairs; where there is none, of the mode that decays most slowly."""
    theta, frequency = dataset["theta"].values, dataset["frequency"].values
    growth, fastest = dataset["growth_rate"].values, dataset["mode_growth_rate"].values
    axes.axhline(0.0, color=figures.BLACK, linewidth=0.6)
    _draw_branches(axes, theta, frequency, growth, "unstable pair")
    for angle, pair in _labelled(theta, frequency, growth):
        spot = (theta[angle], growth[angle, pair])
        look: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": 8.0}
        axes.annotate(f"{frequency[angle, pair]:.0f} Hz", spot, (0, 4), **look)
    stable = np.where(fastest > 0.0, np.nan, fastest)
    decay = "slowest decay, where none grows"
    axes.plot(theta, stable, ".-", color=figures.GREEN, linewidth=2.0, markersize=5.0, label=decay)
    if dataset.sizes["window"]:
        axes.fill_between([], [], color=figures.BLACK, alpha=0.12, linewidth=0.0, label="window of instability")
    axes.margins(y=0.15)
    axes.set_ylabel("growth rate / (1/s)")


def _labelled(theta: NDArray[Any], frequency: NDArray[Any], growth: NDArray[Any]) -> list[tuple[int, int]]:
    """Where branches grow fastest, (angle, pair); of those too near to each other to be labelled, the fastest."""
    tops = [(place[0][k], place[1][k]) for place in branches(frequency) for k in [int(np.argmax(growth[place]))]]
    tops.sort(key=lambda top: -growth[top])
    wide, high = ROOM * np.ptp(theta), ROOM * growth[tops[0]] if tops else 0.0
    kept: list[tuple[int, int]] = []
    for top in tops:
        if all(abs(theta[top[0]] - theta[k]) > wide or growth[k, j] - growth[top] > high for k, j in kept):
            kept.append(top)
    return kept


def _draw_shares(axes: Axes, dataset: xr.Dataset, edges: NDArray[Any]) -> None:
    """How the contact spends its time."""
    below = np.zeros(len(edges) - 1)
    for state, colour in STATE_COLOURS.items():
        share = np.nan_to_num(dataset[f"{state}_fraction"].values)
        look: dict[str, Any] = {
            "color": colour,
            "edgecolor": "white",
            "linewidth": 0.3 if len(share) <= 80 else 0.0,
        }
        axes.bar(edges[:-1], share, np.diff(edges), bottom=below, align="edge", label=state, **look)
        below += share
    axes.set_ylim(0.0, 1.0)
    axes.set_ylabel("share of\nthe time")
    axes.grid(False)


def window_rows(dataset: xr.Dataset) -> list[int]:
    """The row in which each window is drawn, so that none covers another or its bounds."""
    theta = dataset["theta"].values
    margin = ROOM * (theta.max() - theta.min())
    ends: list[float] = []
    rows = []
    for low, high in zip(dataset["window_from"].values, dataset["window_to"].values, strict=True):
        free = [row for row, end in enumerate(ends) if low - margin > end]
        row = free[0] if free else len(ends)
        ends[row : row + 1] = [high + margin]
        rows.append(row)
    return rows


def _draw_strips(axes: Axes, dataset: xr.Dataset, edges: NDArray[Any], rows: Sequence[int]) -> list[Patch]:
    """Windows of instability, what the runs do, and what the paper's text says; patches for the legend."""
    said, names = dataset["stated_paper"].values, []
    handles: list[Patch] = []
    if np.any(np.isin(said, (VIBRATES, SLIDES))):
        # What slides steadily to the paper has the colour that it has here; of a vibration it tells no regime.
        for code, look in ((SLIDES, {"color": COLOURS[STEADY]}), (VIBRATES, UNTOLD)):
            chosen = np.flatnonzero(said == code)
            axes.bar(edges[chosen], 0.8, np.diff(edges)[chosen], bottom=0.0, align="edge", linewidth=0.0, **look)
        handles.append(Patch(linewidth=0.5, label="paper: vibrates", **UNTOLD))
        handles.append(Patch(linewidth=0.5, label="paper: says nothing", **UNTOLD | {"hatch": ""}))
        names.append((0.4, "paper's text"))
    height = float(len(names))
    kinds = _draw_runs(axes, dataset, edges, height)
    if len(names) and np.any(said == SLIDES):
        kinds = sorted({*kinds, STEADY})
    names.append((height + 0.4, "runs"))
    if rows:
        _draw_windows(axes, dataset, rows, height + 1.0)
        names.append((height + 1.2 + 0.25 * max(rows), "unstable"))
    axes.set_ylim(-0.1, height + 1.0 + 0.5 * (1 + max(rows, default=-1)))
    axes.set_yticks([place for place, _ in names], [name for _, name in names])
    axes.tick_params(axis="y", length=0.0)
    axes.spines["left"].set_visible(False)
    axes.grid(False)
    return planes.patches(kinds) + handles


def _draw_runs(axes: Axes, dataset: xr.Dataset, edges: NDArray[Any], bottom: float) -> list[int]:
    """Of each angle the regimes of its runs, stacked by how many have them; the kinds that occur."""
    status, each = dataset["status"].values, dataset["member_regime"].values.astype(float)
    below, found = np.full(len(status), bottom), []
    for code, kind in enumerate(KINDS):
        share = (each == code).mean(axis=1) * (status == DONE)
        if kind == "failed":
            share = (status == FAILED).astype(float)
        if np.any(share):
            look: dict[str, Any] = {"color": COLOURS[code], "hatch": HATCHES.get(kind, "")}
            look["edgecolor"] = figures.GREY
            axes.bar(edges[:-1], 0.8 * share, np.diff(edges), bottom=below, align="edge", linewidth=0.0, **look)
            below += 0.8 * share
            found.append(code)
    return found


def _draw_windows(axes: Axes, dataset: xr.Dataset, rows: Sequence[int], bottom: float) -> None:
    """Each window as a bar between its bounds; a bound that the range cuts off has no number."""
    theta = dataset["theta"].values
    text: dict[str, Any] = {"va": "center", "fontsize": 8.0}
    for k, row in enumerate(rows):
        at = dataset.isel(window=k)
        low, high, middle = float(at["window_from"]), float(at["window_to"]), bottom + 0.5 * row + 0.2
        axes.barh(middle, high - low, 0.36, left=low, color=COLOURS[KINDS.index("stuck")], linewidth=0.0)
        if not int(at["window_open_from"]):
            axes.text(low, middle, f"{low:.2f}° ", ha="right", **text)
        if not int(at["window_open_to"]):
            axes.text(high, middle, f" {high:.2f}°", ha="left", **text)
        if high - low > ROOM * (theta.max() - theta.min()):
            pitch = f"{float(at['window_peak_frequency']):.0f} Hz"
            axes.text(0.5 * (low + high), middle, pitch, ha="center", color="white", **text)
