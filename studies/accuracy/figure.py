"""Figures of costs and errors: work-precision diagrams, every setting by scene, and how stability converges."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.accuracy.errors import root_mean_square
from studies.accuracy.findings import default, table
from studies.accuracy.settings import ELEMENTS, EVENTS, EXACT, FAST, OPTIONS, PAPER
from studies.plotting import figures
from studies.plotting.figures import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from studies.study import constants

Look = dict[str, Any]

# Of scenes, and of curves of `fast`.
LINES: tuple[Look, ...] = tuple(
    {"color": color, "marker": marker, "linestyle": style}
    for color, marker, style in ((BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "D", "-."), (RED, "^", ":"))
)
POINTS: Look = {"linestyle": "none"}
# Methods and what is set of `fast`, as the legend calls them.
STAR, STEP, CUTOFF, OTHER = (f"fast: {name}" for name in ("default", "step", "cut-off", "other settings"))
LOOKS: dict[str, Look] = {
    STEP: LINES[0],
    CUTOFF: LINES[1],
    OTHER: POINTS | {"color": GREY, "marker": "x"},
    EXACT: LINES[2] | POINTS,
    PAPER: LINES[3] | POINTS,
    ELEMENTS: POINTS | {"color": RED, "marker": "v", "markerfacecolor": "none"},
    EVENTS: {"color": GREEN, "marker": "P", "linestyle": ":", "markerfacecolor": "none"},
    STAR: POINTS | {"color": BLACK, "marker": "*", "markersize": 10.0, "zorder": 5},
}
TINY = 6.5
COST, MISMATCH = "processor s per simulated s", "error / tolerance, rms"
ONSET = r"error of the lowest onset's $\mu$"
LAYOUT = (("a", "b"), ("c", "d"), ("c", "e"))


def draw(data: xr.Dataset) -> Figure:
    """Errors against cost, of every setting at each scene, and of sliding stability."""
    frame = table(data)
    frame["group"] = [_group(*pair) for pair in zip(frame["method"], frame["setting"], strict=True)]
    figure, panels = figures.mosaic(LAYOUT, 17.0, 23.0, height_ratios=(1.1, 1.0, 1.0))
    drawn = {
        "figures after the first burst": _draw_statistics,
        "half-way to the first separation": _draw_bursts,
        "error of every setting": _draw_settings,
        "sliding stability: cut-off": _draw_modes,
        "sliding stability: mesh": _draw_elements,
    }
    for (letter, axes), (title, panel) in zip(panels.items(), drawn.items(), strict=True):
        panel(axes, data, frame)
        axes.set_title(f"({letter}) {title}", loc="left", fontsize=9.0)
        axes.xaxis.set_minor_formatter("")
        if letter > "b" and axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=TINY)
    figures.legend_below(figure, [panels["a"], panels["b"]], 3)
    for legend in figure.legends:
        legend.set_title("(a) and (b)")
    figure.suptitle("Run time against error")
    return figure


def _group(method: str, setting: str) -> str:
    kinds = {"default": STAR, "step": STEP, "cut-off": CUTOFF}
    return kinds.get(OPTIONS[setting].kind, OTHER) if method == FAST else method


def _plot(axes: Axes, x: Any, y: Any, **look: Any) -> None:
    """A curve through those of its points that logarithmic axes can show."""
    known = np.isfinite(np.asarray(x)) & (np.asarray(y) > 0.0)
    if known.any():
        axes.plot(x[known], y[known], **{"markersize": 4.0, "linewidth": 1.0, **look})


def _order(axes: Axes, x: float, y: float, order: int) -> None:
    """A short line below a point, which falls with an order."""
    if np.isfinite(x) and y > 0.0:
        axes.plot([x, 3.0 * x], [0.3 * y, 0.3 * y / 3.0**order], color=BLACK, linewidth=0.8)
        axes.text(3.0 * x, 0.3 * y / 3.0**order, f" order {order}", fontsize=TINY, verticalalignment="center")


def _draw_groups(axes: Axes, frame: pd.DataFrame, groups: Iterable[str], cost: str, error: str) -> None:
    for name in groups:
        rows = frame[frame["group"] == name]
        _plot(axes, rows[cost], rows[error], **LOOKS[name], label=name)
    axes.set(xscale="log", yscale="log", xlabel=COST)
    axes.yaxis.set_minor_formatter("")


def _draw_statistics(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Mismatch of the figures against cost."""
    _draw_groups(axes, frame, LOOKS, "cost", "mismatch")
    for scatter in default(frame)["scatter"].dropna():
        axes.axhspan(0.0, scatter, color=GREY, alpha=0.25, linewidth=0.0, label="scatter alone")
    axes.axhline(1.0, color=BLACK, linewidth=0.8, linestyle=":")
    axes.set_ylabel(MISMATCH)


def _draw_bursts(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Error of the first slip's motion against cost."""
    ordered = pd.concat([frame[frame["method"] == FAST], frame[frame["method"] != FAST].sort_values("alone")])
    _draw_groups(axes, ordered, [name for name in LOOKS if name != OTHER], "alone", "half_way")
    for own in default(frame).itertuples():
        _order(axes, own.alone, own.half_way, 2)
    axes.set_ylabel("largest error of $v_B$")


def _draw_settings(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Mismatch of every setting at each scene, and of all scenes against the scheme without numerical damping."""
    rows = frame[frame["mismatch"].notna()].reset_index(drop=True)
    at = rows[["undamped", *(f"mismatch at {scene}" for scene in data["scene"].values)]]
    at = at.where(at > 0.0)
    axes.plot(at.pop("undamped"), rows.index, **POINTS, color=BLACK, marker="|", label="all, paper undamped")
    axes.hlines(rows.index, at.min(axis=1), at.max(axis=1), color=GREY, linewidth=0.5)
    for name, look in zip(at, LINES, strict=False):
        axes.plot(at[name], rows.index, **look | POINTS, markersize=4.0, label=name.removeprefix("mismatch at "))
    axes.axvline(1.0, color=BLACK, linewidth=0.8, linestyle=":")
    axes.set_yticks(rows.index, rows["method"] + ", " + rows["label"], fontsize=TINY)
    axes.set(xscale="log", xlabel=MISMATCH, ylim=(max(len(rows), 1) - 0.5, -0.5))


def _draw_modes(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Error of the lowest onset against the cut-off, by termination."""
    settings = [name for name in data["setting"].values if OPTIONS[name].kind == "cut-off"]
    errors = root_mean_square(data["onset_error"]).sel(setting=settings)
    x = 1e-3 * errors["cutoff"].values
    looks = {"absorbing": LINES[0], "elastic": LINES[1], "none": LINES[3] | {"color": GREY}}
    for kind, look in looks.items():
        _plot(axes, x, errors.sel(termination=kind), **look, label=kind)
    for kind, order in {"none": 1, "elastic": 3}.items() if len(x) else ():
        _order(axes, x[2 * len(x) // 3], errors.sel(termination=kind).values[2 * len(x) // 3], order)
    axes.set(xscale="log", yscale="log", xlabel="cut-off / kHz", ylabel=ONSET)


def _draw_elements(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Error of the lowest onset against the number of elements."""
    axes.set(xscale="log", yscale="log", xlabel="elements of P1", ylabel=ONSET)
    sizes = {name: size for name in data["setting"].values if (size := OPTIONS[name].size)}
    settings = sorted(sizes, key=lambda name: sizes[name])
    onset = root_mean_square(data["onset_error"].isel(termination=0)).sel(setting=settings).values
    x = constants(data)["rig"]["p1"]["elements"] * np.array([sizes[name] for name in settings])
    _plot(axes, x, onset, **LINES[0])
    for point in zip(x[:1], onset[:1], strict=True):
        _order(axes, *point, 4)
    known = x[np.isfinite(onset)]
    axes.set_xticks(known, [f"{count:.0f}" for count in known])
