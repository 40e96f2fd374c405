"""Figures of costs and errors: work-precision diagrams, every setting by scene, and time to a standard error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.accuracy.errors import STANDARD_ERROR
from studies.accuracy.findings import GROUPS, default, table
from studies.accuracy.settings import (
    CONVERGED,
    DEFAULT,
    EVENTS,
    EXACT,
    FAST,
    MODEL,
    OPTIONS,
    OWN,
    PAPER,
    PUBLISHED,
)
from studies.plotting import figures
from studies.plotting.figures import BLACK, BLUE, GREEN, GREY, ORANGE, RED

Look = dict[str, Any]

# What is drawn as one curve or as points: a method, or a kind of setting of `fast`.
STAR, STEP, CUTOFF, DAMPING, TRUNCATION, PSEUDO, SCHEME, OTHER = (
    f"fast: {name}"
    for name in (
        "default", "step", "cut-off", "damping of the element", "truncation", "pseudo-modes", "published damping",
        "other settings",
    )
)  # fmt: skip
KINDS = {
    "default": STAR,
    "step": STEP,
    "cut-off": CUTOFF,
    "damping": DAMPING,
    "truncation": TRUNCATION,
    "pseudo-modes": PSEUDO,
    "numerical damping": SCHEME,
}
POINTS: Look = {"linestyle": "none"}
LOOKS: dict[str, Look] = {
    STEP: {"color": BLUE, "marker": "o"},
    CUTOFF: {"color": ORANGE, "marker": "s", "linestyle": "--"},
    DAMPING: POINTS | {"color": GREEN, "marker": "D"},
    TRUNCATION: {"color": GREY, "marker": "v", "linestyle": ":"},
    PSEUDO: POINTS | {"color": RED, "marker": "^"},
    SCHEME: POINTS | {"color": BLACK, "marker": "*", "markersize": 10.0, "markerfacecolor": "none"},
    OTHER: POINTS | {"color": GREY, "marker": "x"},
    EXACT: POINTS | {"color": GREEN, "marker": "P"},
    PAPER: POINTS | {"color": RED, "marker": "p", "markerfacecolor": "none"},
    STAR: POINTS | {"color": BLACK, "marker": "*", "markersize": 10.0, "zorder": 5},
}
# Of scenes of both groups, unlike any method or setting.
DOT: Look = POINTS | {"marker": "o", "markersize": 4.5, "markeredgewidth": 0.8}
SCENES = {group: DOT | {"color": colour, "markerfacecolor": fill} for group, colour, fill in zip(
    GROUPS, (BLACK, GREY), (BLACK, "white"), strict=True)}  # fmt: skip
SMALL = 7.5
# Errors that are smaller are drawn as this.
LEAST = 0.05
COST, MISMATCH = "CPU time / simulated time", "error / tolerance, rms"
# Whose time to a standard error is drawn.
TIMED = (
    (FAST, DEFAULT), (FAST, PUBLISHED), (FAST, CONVERGED), (EXACT, DEFAULT), (PAPER, DEFAULT), (PAPER, MODEL),
    (EVENTS, DEFAULT),
)  # fmt: skip


def draw(data: xr.Dataset) -> Figure:
    """Error against cost on the paper's rig and on random ones, error of every setting, and time to be certain."""
    frame = table(data)
    frame["group"] = [_group(*pair) for pair in zip(frame["method"], frame["setting"], strict=True)]
    figure, panels = figures.mosaic(
        (("a", "b"), ("c", "c"), ("d", "d")), 17.0, 24.0, height_ratios=(1.3, 1.9, 0.75)
    )
    panels["b"].sharey(panels["a"])
    for letter, group in zip("ab", GROUPS, strict=True):
        _draw_costs(panels[letter], frame, group)
    panels["b"].set_ylabel("")
    panels["b"].tick_params(labelleft=False)
    _draw_scenes(panels["c"], data["mismatch"].clip(min=LEAST), frame[["method", "setting"]])
    panels["c"].axvline(1.0, color=BLACK, linewidth=0.8, linestyle=":")
    panels["c"].set(xlabel=MISMATCH)
    chosen = [pair for pair in zip(frame["method"], frame["setting"], strict=True) if pair in TIMED]
    _draw_scenes(panels["d"], data["time_to_standard_error"], pd.DataFrame(chosen, columns=["method", "setting"]))
    panels["d"].set(xlabel="CPU time / s")
    until = f"CPU time to a standard error of {STANDARD_ERROR:g} of the shares of time"
    figures.letter(panels.values(), (*GROUPS, "every setting at each scene", until))
    figures.legend_below(figure, list(panels.values()), 3)
    figure.suptitle("Run time against error")
    return figure


def _group(method: str, setting: str) -> str:
    kind = "truncation" if setting == "termination none" else OPTIONS[setting].kind
    return KINDS.get(kind, OTHER) if method == FAST else method


def _draw_costs(axes: Axes, frame: pd.DataFrame, group: str) -> None:
    """Errors of a group of scenes against cost; scatter alone is shaded."""
    error = f"mismatch {group}"
    for name, look in LOOKS.items():
        rows = frame[(frame["group"] == name) & (frame[error] > 0.0)].sort_values("cost")
        if len(rows):
            axes.plot(rows["cost"], rows[error], **{"markersize": 4.0, "linewidth": 1.0, **look}, label=name)
    for scatter in default(frame)[f"scatter {group}"].dropna():
        axes.axhspan(0.0, scatter, color=GREY, alpha=0.25, linewidth=0.0, label="scatter alone")
    axes.axhline(1.0, color=BLACK, linewidth=0.8, linestyle=":")
    axes.set(xscale="log", yscale="log", xlabel=COST, ylabel=MISMATCH)
    axes.yaxis.set_minor_formatter("")


def _draw_scenes(axes: Axes, values: xr.DataArray, rows: pd.DataFrame) -> None:
    """A row of points, one for each scene, for each method and setting of which there is a value."""
    values = values.where(values > 0.0)
    labels = list[str]()
    own = np.isin(values["scene"].values, list(OWN))
    for method, setting in rows.itertuples(index=False):
        at = values.sel({"method": method, "setting": setting}).values
        if np.isfinite(at).any():
            y = len(labels)
            axes.hlines(y, np.nanmin(at), np.nanmax(at), color=GREY, linewidth=0.5)
            for group, there in zip(GROUPS, (own, ~own), strict=True):
                look = SCENES[group] | {"label": f"(c), (d): {group}"}
                axes.plot(at[there], np.full(there.sum(), y), **look)
            labels.append(f"{method}, {setting}")
    axes.set_yticks(range(len(labels)), labels, fontsize=SMALL)
    axes.set(xscale="log", ylim=(max(len(labels), 1) - 0.5, -0.5))
    axes.xaxis.set_minor_formatter("")
