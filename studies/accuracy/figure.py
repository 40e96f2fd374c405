"""Figures of costs and errors: work-precision diagrams, what the parts are worth, and how errors converge."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.accuracy.errors import BOUNDED, DIMS, ERRORS_ALLOWED, root_mean_square
from studies.accuracy.rows import default, table
from studies.accuracy.settings import DEFAULT, ELEMENTS, EVENTS, EXACT, FAST, OPTIONS, PAPER
from studies.plotting import figures
from studies.plotting.figures import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from studies.study import constants

Look = dict[str, Any]

# Of scenes, and of curves of `fast`.
LINES: tuple[Look, ...] = tuple(
    {"color": color, "marker": marker, "linestyle": style}
    for color, marker, style in ((BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "D", "-."), (RED, "^", ":"))
)
TERMINATIONS = (*LINES[:2], LINES[3] | {"color": GREY})
HOLLOW: Look = {"markerfacecolor": "none"}
POINTS: Look = {"linestyle": "none"}
# Methods and what is set of `fast`, as the legend calls them.
STAR, STEP, CUTOFF, BOTH, OTHER = (
    f"fast: {name}" for name in ("default", "step", "cut-off", "cut-off and step", "other settings")
)
LOOKS: dict[str, Look] = {
    STEP: LINES[0],
    CUTOFF: LINES[1],
    BOTH: LINES[1] | POINTS | HOLLOW,
    OTHER: POINTS | {"color": GREY, "marker": "x"},
    EXACT: LINES[2] | POINTS,
    PAPER: LINES[3] | POINTS,
    ELEMENTS: POINTS | HOLLOW | {"color": RED, "marker": "v"},
    EVENTS: HOLLOW | {"color": GREEN, "marker": "P", "linestyle": ":"},
    STAR: POINTS | {"color": BLACK, "marker": "*", "markersize": 10.0, "zorder": 5},
}
TINY = 6.5
# A run alone is drawn beside one of a batch if its cost is that much greater.
DEARER = 1.1
COST, MISMATCH = "processor s per simulated s", "error / tolerance, rms"


def draw(dataset: xr.Dataset) -> Figure:
    """Errors against cost, against cut-off and step, of each part and figure, and of sliding stability."""
    data = dataset.transpose(*DIMS, ...)
    frame = table(data)
    frame["group"] = [_group(*pair) for pair in zip(frame["method"], frame["setting"], strict=True)]
    figure, panels = figures.panels(4, 2, 17.0, 25.5, gridspec_kw={"height_ratios": (1.2, 0.95, 1.25, 0.9)})
    drawn = {
        "figures after the first burst": _draw_statistics,
        "half-way to the first separation": _draw_bursts,
        "cut-off of fast": _draw_cutoffs,
        "step of fast": _draw_steps,
        "what the parts are worth": _draw_parts,
        "fast by default": _draw_default,
        "sliding stability: cut-off": _draw_modes,
        "sliding stability: mesh": _draw_elements,
    }
    for letter, axes, (title, panel) in zip("abcdefgh", panels, drawn.items(), strict=True):
        panel(axes, data, frame)
        axes.set_title(f"({letter}) {title}", loc="left", fontsize=9.0)
        axes.xaxis.set_minor_formatter("")
        if letter > "b" and axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=TINY)
    figures.legend_below(figure, panels[:2], 3)
    for legend in figure.legends:
        legend.set_title("(a) and (b)")
    figure.suptitle("Run time against error")
    return figure


def _group(method: str, setting: str) -> str:
    option = OPTIONS[setting]
    if method != FAST:
        return method
    return BOTH if option.share else {"default": STAR, "step": STEP, "cut-off": CUTOFF}.get(option.kind, OTHER)


def _plot(axes: Axes, x: Any, y: Any, **look: Any) -> None:
    """Those points of a curve that can be drawn on logarithmic axes."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    known = np.isfinite(x) & np.isfinite(y) & (y > 0.0)
    if known.any():
        axes.plot(x[known], y[known], **{"markersize": 4.0, "linewidth": 1.0, **look})


def _upright(axes: Axes, x: float, text: str, y: float, rotation: float = 90.0) -> None:
    """A vertical line with a text along or beside it."""
    axes.axvline(x, color=GREY, linewidth=0.8, linestyle="--")
    how: Look = {"va": "bottom" if y < 0.5 else "top", "ha": "right", "rotation": rotation, "fontsize": TINY}
    axes.text(x, y, text, transform=axes.get_xaxis_transform(), **how)


def _order(axes: Axes, x: float, y: float, order: int, beside: float) -> None:
    """A short line that falls with an order, `beside` times as high as the point (x, y)."""
    if np.isfinite(x + y) and y > 0.0:
        ends = np.array([1.0, 3.0])
        axes.plot(x * ends, beside * y * ends ** -float(order), color=BLACK, linewidth=0.8)
        middle = (x * ends[1] ** 0.5, beside * y * ends[1] ** (-0.5 * order))
        side: Look = {"xytext": (3, 2)} if beside > 1.0 else {"xytext": (-3, -2), "ha": "right", "va": "top"}
        axes.annotate(f"order {order}", middle, textcoords="offset points", fontsize=TINY, **side)


def _draw_groups(axes: Axes, frame: pd.DataFrame, groups: Iterable[str], cost: str, error: str) -> None:
    for name in groups:
        rows = frame[frame["group"] == name]
        _plot(axes, rows[cost], rows[error], **LOOKS[name], label=name)
    axes.set(xscale="log", yscale="log", xlabel=COST)
    axes.yaxis.set_minor_formatter("")


def _draw_statistics(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Mismatch of the figures against cost."""
    _draw_groups(axes, frame, LOOKS, "cost", "mismatch")
    for own in default(frame).itertuples():
        if own.alone > DEARER * own.cost:
            _plot(axes, [own.alone], [own.mismatch], **LOOKS[STAR] | HOLLOW, label=f"{STAR}, one run alone")
        if np.isfinite(own.scatter):
            axes.axhspan(0.0, own.scatter, color=GREY, alpha=0.25, linewidth=0.0, label="scatter alone")
    axes.axhline(1.0, color=BLACK, linewidth=0.8, linestyle=":")
    # What has a cost and no ensemble.
    for method, text in ((PAPER, "paper, the reference"), (ELEMENTS, ELEMENTS), (EVENTS, "solve_ivp")):
        for cost in default(frame, method)["alone"]:
            _upright(axes, cost, text, 0.97)
    axes.set_ylabel(MISMATCH)


def _draw_bursts(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Error of the first slip's motion against cost."""
    ordered = pd.concat([frame[frame["method"] == FAST], frame[frame["method"] != FAST].sort_values("alone")])
    _draw_groups(axes, ordered, [name for name in LOOKS if name not in (BOTH, OTHER)], "alone", "half_way")
    for own in default(frame).itertuples():
        _order(axes, own.alone, own.half_way, 2, 2.5)
    axes.set_ylabel("largest error of $v_B$")


def _draw_scenes(axes: Axes, data: xr.Dataset, settings: list[str], x: Any, label: str) -> None:
    """Mismatch of settings of `fast`, one line a scene."""
    if "mismatch" in data and FAST in data["method"]:
        at = data["mismatch"].sel({"method": FAST, "setting": settings})
        for scene, look in zip(data["scene"].values, LINES, strict=False):
            _plot(axes, x, at.sel(scene=scene), **look, label=f"{label}{scene}")
    axes.axhline(1.0, color=BLACK, linewidth=0.8, linestyle=":")
    axes.set(yscale="log", ylabel=MISMATCH, ylim=(0.05, 5.0))


def _draw_cutoffs(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Mismatch of `fast` at each scene against the cut-off, each at its default step; (d) says the scenes."""
    rows = frame[frame["group"] == CUTOFF]
    x, settings = 1e-3 * rows["cutoff"].to_numpy(), rows["setting"].tolist()
    _draw_scenes(axes, data, settings, x, "_")
    _plot(axes, x, rows["undamped"], color=BLACK, linewidth=2.2, label="all scenes, against\npaper undamped")
    axes.set(xscale="log", xlabel="cut-off / kHz")
    if settings:
        _upright(axes, 3.0 * x[0] / float(OPTIONS[settings[0]].value), "P1's 2nd axial mode ", 0.05, 0.0)
        ticks = [tick for tick in (10, 25, 50, 100, 200, 500) if 0.8 * x[0] < tick < 1.3 * x[-1]]
        axes.set_xticks(ticks, [str(tick) for tick in ticks])


def _draw_steps(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Mismatch of `fast` at each scene against the step."""
    rows = frame[frame["group"] == STEP]
    shares = np.array([OPTIONS[setting].value for setting in rows["setting"]])
    _draw_scenes(axes, data, rows["setting"].tolist(), shares, "")
    for own in default(frame).itertuples():
        if len(rows):
            _upright(axes, own.step * shares[0] / rows["step"].iloc[0], "default", 0.03)
    axes.set(xlabel="step / largest stable step", xlim=(0.0, 1.05))


def _draw_parts(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Mismatch at each scene of what is no scale: what each part of a method is worth."""
    rows = frame[frame["mismatch"].notna() & ~frame["group"].isin([STEP, CUTOFF, BOTH])]
    for y, row in enumerate(rows.itertuples()):
        at = data["mismatch"].sel({"method": row.method, "setting": row.setting}).values
        axes.plot(at, np.full(len(at), y), color=GREY, linewidth=0.5)
        for value, look in zip(at, LINES, strict=False):
            axes.plot(value, y, **look | POINTS, markersize=4.0)
    axes.axvline(1.0, color=BLACK, linewidth=0.8, linestyle=":")
    axes.set_yticks(range(len(rows)), rows["method"] + ", " + rows["label"], fontsize=TINY)
    axes.set(xscale="log", xlabel=MISMATCH, ylim=(max(len(rows), 1) - 0.5, -0.5))


def _draw_default(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Each figure of `fast` by default at each scene, in units of its tolerance, with two standard errors."""
    if "mismatch" in data and FAST in data["method"] and DEFAULT in data["setting"]:
        own = data.sel({"method": FAST, "setting": DEFAULT})
        for y, each in enumerate(BOUNDED):
            errors = own[f"{each.name}_error"].values / each.tolerance
            deviations = own[f"{each.name}_deviation"]
            # No error has no deviation, whatever the scatter.
            spans = ERRORS_ALLOWED * errors / deviations.where(deviations != 0.0).values
            heights = y + 0.6 * ((np.arange(len(errors)) + 0.5) / len(errors) - 0.5)
            for x, span, height, look in zip(errors, np.nan_to_num(spans), heights, LINES, strict=False):
                axes.plot([x - span, x + span], [height] * 2, color=look["color"])
                axes.plot(x, height, **look | POINTS, markersize=4.0)
    for x in (-1.0, 1.0):
        axes.axvline(x, color=BLACK, linewidth=0.8, linestyle=":")
    axes.set_yticks(range(len(BOUNDED)), [each.long_name for each in BOUNDED], fontsize=7.0)
    axes.set(xlabel=f"error / tolerance, ± {ERRORS_ALLOWED:g} standard errors", ylim=(len(BOUNDED) - 0.5, -0.5))


def _draw_modes(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Error of the lowest onset against the cut-off, by termination."""
    if "onset_error" in data:
        options = [OPTIONS[name] for name in data["setting"].values]
        plain = [option.kind == "cut-off" and not option.share for option in options]
        errors = root_mean_square(data["onset_error"]).isel(setting=plain)
        x = 1e-3 * errors["cutoff"].values
        for kind, look in zip(data["termination"].values, TERMINATIONS, strict=True):
            y = errors.sel(termination=kind).values
            _plot(axes, x, y, **look, label=kind)
            for order in {"none": [1], "elastic": [3]}.get(kind, []) if len(x) else []:
                _order(axes, x[2 * len(x) // 3], y[2 * len(x) // 3], order, 2.0)
    axes.set(xscale="log", yscale="log", xlabel="cut-off / kHz", ylabel=r"error of the lowest onset's $\mu$")


def _draw_elements(axes: Axes, data: xr.Dataset, frame: pd.DataFrame) -> None:
    """Errors of onset and growth against the number of elements."""
    axes.set(xscale="log", yscale="log", xlabel="elements of P1", ylabel="relative error")
    sizes = {name: size for name in data["setting"].values if (size := OPTIONS[name].size)}
    if "onset_error" in data and sizes:
        settings = sorted(sizes, key=lambda name: sizes[name])
        x = constants(data)["rig"]["p1"]["elements"] * np.array([sizes[name] for name in settings])
        at = data.isel(termination=0).sel(setting=settings)
        onset, growth = (root_mean_square(at[f"{what}_error"]).values for what in ("onset", "growth"))
        _plot(axes, x, onset, **LINES[0], label=r"lowest onset's $\mu$")
        _plot(axes, x, growth, **LINES[1], label="largest growth rate")
        _order(axes, x[0], onset[0], 4, 0.3)
        known = x[np.isfinite(onset)]
        axes.set_xticks(known, [f"{count:.0f}" for count in known])
