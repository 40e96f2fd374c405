"""How a map is drawn: one plane, shaded or in classes, with the points that were computed and the paper's."""

from __future__ import annotations

from typing import Any, NamedTuple

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from scipy.ndimage import convolve, distance_transform_edt

from studies import paper
from studies.maps.findings import held, readable
from studies.maps.quantities import AXES, GROWTH, QUANTITIES, RIG
from studies.motion import regimes
from studies.plotting import figures, planes
from studies.scatter import instability
from studies.study import constants
from sweeps import DONE, FAILED, INTERPOLATED, PENDING

STABLE = "#e9e9e9"
# A map has room for that many dots; more would hide it.
MOST_DOTS = 3000
MARKER: dict[str, Any] = {"linestyle": "none", "markerfacecolor": "white", "markeredgecolor": "black"}


class Panel(NamedTuple):
    """Where to draw, and the two axes of the map; as the functions of `studies.plotting.planes` take them."""

    axes: Axes
    x: str
    xs: NDArray[Any]
    y: str
    ys: NDArray[Any]


def draw(dataset: xr.Dataset) -> Figure:
    """The plane, with x across; a number along one axis as a line."""
    quantity = constants(dataset)["quantity"]
    variable = dataset[quantity]
    x, y = map(str, variable.dims)
    if min(variable.shape) == 1 < max(variable.shape) and not QUANTITIES[quantity].is_whole:
        return _draw_line(dataset, *((x, y) if len(variable[y]) == 1 else (y, x)))
    values = variable.values.T.astype(float)
    status = dataset["status"].values.T
    figure, (axes,) = figures.panels(1, 1, 17.0, 12.0)
    panel = Panel(axes, x, dataset[x].values, y, dataset[y].values)
    if QUANTITIES[quantity].is_whole:
        handles = _draw_classes(panel, quantity, values)
    else:
        handles = _draw_shades(figure, panel, quantity, values)
    handles += _draw_gaps(panel, values, status)
    handles += _draw_computed(panel, status)
    handles += _draw_paper(axes, dataset)
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 3))
    figure.suptitle(_title(variable, held(dataset)))
    return figure


def _title(variable: xr.DataArray, about: list[str]) -> str:
    """The quantity, and below it the fixed values."""
    name = variable.attrs["long_name"]
    return f"{name[0].upper()}{name[1:]}\n{', '.join(about)}".rstrip()


def _draw_line(dataset: xr.Dataset, along: str, other: str) -> Figure:
    """A number along the one axis that has several values; gaps where it has none."""
    fixed = constants(dataset)
    quantity = fixed["quantity"]
    at = dataset.isel({other: 0})
    label, factor = readable(quantity)
    figure, (axes,) = figures.panels(1, 1, 15.0, 9.0)
    x, y = planes.shown(along, at[along].values), factor * at[quantity].values
    if "scatter" in fixed:
        low, high = instability.wilson(y, fixed["samples"])
        axes.fill_between(x, low, high, color=figures.BLUE, alpha=0.3, linewidth=0.0, label="Wilson 95 %")
    axes.plot(x, y, color=figures.BLACK, marker="." if len(x) < 60 else "", label=quantity.replace("_", " "))
    if np.any(at["status"].values == INTERPOLATED):
        done = np.isin(at["status"].values, (DONE, FAILED))
        look = MARKER | {"marker": "o", "markersize": 4.0}
        axes.plot(x[done], y[done], **look, label=_share_computed(at["status"].values))
    for threshold in QUANTITIES[quantity].thresholds:
        axes.axhline(factor * threshold, color=figures.GREY, linewidth=0.8)
    if planes.is_logarithmic(x):
        axes.set_xscale("log")
        figures.one_two_five(axes.xaxis)
    axes.set(xlabel=planes.label(along), ylabel=label)
    if len(axes.lines) + len(axes.collections) - len(QUANTITIES[quantity].thresholds) > 1:
        figures.legend_below(figure, [axes])
    figure.suptitle(_title(dataset[quantity], [planes.named(other, dataset[other].values[0]), *held(dataset)]))
    return figure


def _draw_classes(panel: Panel, quantity: str, values: NDArray[Any]) -> list[Any]:
    """Each class in its colour; what stands for it in the legend."""
    kinds = np.unique(values[np.isfinite(values)]).astype(int)
    if quantity == "regime":
        planes.classes(*panel, values, planes.COLOURS)
        return planes.patches(kinds)
    most = int(kinds.max(initial=0))
    shades = matplotlib.colormaps["cividis"](np.linspace(0.0, 1.0, max(most, 1)))
    colours = [STABLE, *(to_hex(shade) for shade in shades)]
    planes.classes(*panel, values, colours)
    name = quantity.replace("_", " ")
    return [
        Patch(facecolor=colours[k], edgecolor="black", linewidth=0.5, label=f"{k} {name if k == kinds[0] else ''}")
        for k in kinds.tolist()
    ]


def _draw_shades(figure: Figure, panel: Panel, quantity: str, values: NDArray[Any]) -> list[Any]:
    """A number as lightness; of a growth rate only what grows, with the boundary."""
    label, factor = readable(quantity)
    handles: list[Any] = []
    shaded = factor * values
    norm, ticks = None, None
    if quantity == "growth_rate":
        planes.classes(*panel, np.where(values <= 0.0, 0.0, np.nan), [STABLE])
        handles.append(Patch(facecolor=STABLE, edgecolor="black", linewidth=0.5, label="stable"))
        if min(values.shape) > 1 and np.any(values > 0.0) and np.any(values <= 0.0):
            across, up = planes.shown(panel.x, panel.xs), planes.shown(panel.y, panel.ys)
            joined = np.where(_alone(values <= 0.0), np.nan, values)
            line = panel.axes.contour(across, up, joined, levels=[0.0], colors="black", linewidths=1.2)
            if any(np.size(path.vertices) for path in line.get_paths()):
                handles.append(Line2D([], [], color="black", linewidth=1.2, label="growth rate 0"))
        shaded = np.where(values > 0.0, values, np.nan)
        norm = Normalize(0.0)
    if np.any(np.isfinite(shaded)):
        if quantity == "frequency":
            norm, ticks = planes.banded(shaded)
        mesh = planes.shades(*panel, shaded, norm)
        planes.colour_bar(figure, mesh, panel.axes, label, ticks)
    planes.set_axes(*panel)
    return handles


def _alone(stable: NDArray[Any]) -> NDArray[Any]:
    """Cells that are unlike all that surround them: a line about each would be a dot."""
    alike = convolve(stable.astype(int), np.ones((3, 3), dtype=int), mode="nearest")
    return np.asarray(np.where(stable, alike, 9 - alike) == 1)


def _draw_gaps(panel: Panel, values: NDArray[Any], status: NDArray[Any]) -> list[Any]:
    """Hatch failed cells, and explain the white ones in the legend."""
    handles: list[Any] = []
    computed = _nearest_computed(status)
    failed = (computed == FAILED) & ~np.isfinite(values)
    if failed.any():
        mesh = panel.axes.pcolor(
            planes.edges(planes.shown(panel.x, panel.xs)),
            planes.edges(planes.shown(panel.y, panel.ys)),
            np.ma.masked_where(~failed, failed),
            edgecolor=figures.GREY,
            linewidth=0.0,
            hatch=planes.HATCHES["failed"],
        )
        mesh.set_facecolor("none")
        handles += planes.patches([regimes.KINDS.index("failed")])
    for label, there in (
        ("no value", (computed == DONE) & ~np.isfinite(values)),
        ("not computed", status == PENDING),
    ):
        if there.any():
            handles.append(Patch(facecolor="white", edgecolor="black", linewidth=0.5, label=label))
    return handles


def _nearest_computed(status: NDArray[Any]) -> NDArray[Any]:
    """Replace the status of interpolated points by that of the nearest computed one, which is alike."""
    interpolated = status == INTERPOLATED
    if not interpolated.any():
        return status
    nearest = distance_transform_edt(interpolated, return_distances=False, return_indices=True)
    return np.asarray(status[tuple(nearest)])


def _draw_computed(panel: Panel, status: NDArray[Any]) -> list[Any]:
    """A dot for each computed point, where others are not."""
    up, across = np.nonzero(np.isin(status, (DONE, FAILED)))
    if not np.any(status == INTERPOLATED) or len(across) > MOST_DOTS:
        return []
    look = MARKER | {"marker": "o", "markersize": 2.0, "markeredgewidth": 0.3}
    panel.axes.plot(planes.shown(panel.x, panel.xs[across]), planes.shown(panel.y, panel.ys[up]), **look)
    return [Line2D([], [], label=_share_computed(status), **look)]


def _share_computed(status: NDArray[Any]) -> str:
    """How many of the points were computed, for a legend."""
    return f"computed ({100.0 * np.mean(np.isin(status, (DONE, FAILED))):.2g} %), others interpolated"


def _draw_paper(axes: Axes, dataset: xr.Dataset) -> list[Any]:
    """The paper's tests, and where it found modes to become unstable, as far as they lie in the plane."""
    fixed = constants(dataset)
    tests = [{"V": V, "theta": paper.THETA, "mu": paper.MU, "F": paper.LOAD} for V in paper.SPEEDS]
    looks = [("*", 12.0, "paper: tests", tests)]
    if fixed["quantity"] in GROWTH:
        onsets = [tests[0] | {"mu": mu} for mu, _ in paper.ONSETS]
        looks.append(("D", 5.5, "paper: first unstable μ", onsets))
    handles: list[Any] = []
    for marker, size, label, points in looks:
        places = set()
        for point in points:
            numbers = {name: each.value for name, each in AXES.items()} | point
            # None where the map is of another rig, or of another scene in what matters.
            matter = (*QUANTITIES[fixed["quantity"]].matter, *RIG)
            if all(fixed.get(name, numbers[name]) == numbers[name] for name in matter):
                x, y = (float(planes.shown(str(name), numbers[str(name)])) for name in dataset["status"].dims)
                places.add((x, y))
        look = MARKER | {"marker": marker, "markersize": size, "markeredgewidth": 0.9, "label": label}
        handles += planes.marks(axes, sorted(places), zorder=4.0, clip_on=False, **look)
    return handles
