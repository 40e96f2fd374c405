"""What methods, settings and scenes look like in the figure of `accuracy`, and small pieces of drawing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from fivcore import Beam, Rig
from studies.accuracy import settings as asked
from studies.plotting import figures
from studies.study import constants

Look = dict[str, Any]

# Of fast, by what is set: those that make a curve, and the others.
CURVES: dict[str, Look] = {
    "step": {"color": figures.BLUE, "marker": "o", "linestyle": "-", "label": "fast: step"},
    "cut-off": {"color": figures.ORANGE, "marker": "s", "linestyle": "--", "label": "fast: cut-off"},
}
BOTH: Look = CURVES["cut-off"] | {
    "linestyle": "none",
    "markerfacecolor": "none",
    "label": "fast: cut-off and step",
}
OTHER: Look = {"color": figures.GREY, "marker": "x", "linestyle": "none", "label": "fast: other settings"}
DEFAULT: Look = {
    "color": figures.BLACK,
    "marker": "*",
    "markersize": 10.0,
    "linestyle": "none",
    "zorder": 5,
    "label": "fast: default",
}
METHODS: dict[int, Look] = {
    asked.PAPER: {"color": figures.RED, "marker": "^", "linestyle": "none"},
    asked.ELEMENTS: {"color": figures.RED, "marker": "v", "linestyle": "none", "markerfacecolor": "none"},
    asked.EXACT: {"color": figures.GREEN, "marker": "D", "linestyle": "none"},
    asked.EVENTS: {"color": figures.GREEN, "marker": "P", "linestyle": ":", "markerfacecolor": "none"},
}
SCENES: tuple[Look, ...] = (
    {"color": figures.BLUE, "marker": "o", "linestyle": "-"},
    {"color": figures.ORANGE, "marker": "s", "linestyle": "--"},
    {"color": figures.GREEN, "marker": "D", "linestyle": "-."},
    {"color": figures.RED, "marker": "^", "linestyle": ":"},
)
TERMINATIONS: dict[str, Look] = {
    "absorbing": {"color": figures.BLUE, "marker": "o", "linestyle": "-"},
    "elastic": {"color": figures.ORANGE, "marker": "s", "linestyle": "--"},
    "none": {"color": figures.GREY, "marker": "^", "linestyle": "-."},
}
SMALL: Look = {"markersize": 4.0, "linewidth": 1.0}
TINY = 6.5


def plot(axes: Axes, pairs: Sequence[tuple[float, float]], look: Look) -> None:
    """Those points of a curve that there are, on logarithmic axes."""
    known = [pair for pair in pairs if np.isfinite(pair[0] + pair[1]) and pair[1] > 0.0]
    if known:
        axes.plot(*zip(*known, strict=True), **{**SMALL, **look})


def legend(axes: Axes, **how: Any) -> None:
    """A small legend, if there is anything to tell."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**{"fontsize": TINY, **how})


def slope(axes: Axes, x: float, y: float, order: int, beside: float) -> None:
    """A short line that falls with an order, `beside` times as high as the point (x, y)."""
    if not np.isfinite(x + y) or y <= 0.0:
        return
    ends = np.array([1.0, 3.0])
    axes.plot(x * ends, beside * y * ends ** -float(order), color=figures.BLACK, linewidth=0.8)
    middle = (x * ends[1] ** 0.5, beside * y * ends[1] ** (-0.5 * order))
    side: Look = (
        {"xytext": (3, 2), "ha": "left"} if beside > 1.0 else {"xytext": (-3, -2), "ha": "right", "va": "top"}
    )
    axes.annotate(f"order {order}", middle, textcoords="offset points", fontsize=TINY, **side)


def upright(axes: Axes, x: float, text: str, bottom: bool = True) -> None:
    """A vertical line with a text along it."""
    axes.axvline(x, color=figures.GREY, linewidth=0.8, linestyle="--")
    how: Look = {"y": 0.03, "va": "bottom"} if bottom else {"y": 0.97, "va": "top"}
    how |= {"rotation": 90, "fontsize": TINY, "ha": "right", "transform": axes.get_xaxis_transform()}
    axes.text(x=x, s=text, **how)


def tolerance(axes: Axes) -> None:
    """Where an error is as large as its tolerance."""
    axes.axhline(1.0, color=figures.BLACK, linewidth=0.8, linestyle=":")


def options(data: xr.Dataset) -> list[tuple[int, asked.Option]]:
    """Places along `setting`, and what is set there."""
    return [(k, asked.OPTIONS[int(setting)]) for k, setting in enumerate(data["setting"].values)]


def rig_of(data: xr.Dataset) -> Rig:
    """The rig of the file."""
    given = constants(data)["rig"]
    return Rig(**{**given, "p1": Beam(**given["p1"]), "p2": Beam(**given["p2"])})
