"""Quantities and regimes over one or two parameters: cells of true extent, colours, markers.

Colours suit colour-blind readers and grey print: shades increase in lightness, classes alternate light and dark.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.declaring import labels
from studies.declaring.spec import edges, is_logarithmic
from studies.motion.mixed import several
from studies.motion.regimes import KINDS
from studies.plotting import figures

# Of Okabe and Ito's colours, by index in KINDS; light and dark ones alternate.
COLOURS = ("#d9d9d9", "#4d4d4d", "#a6dcf7", figures.ORANGE, figures.BLUE, figures.RED, "white", "white")
STATE_COLOURS = {"stick": "#4d4d4d", "slip": "#a6dcf7", "separation": figures.ORANGE}
# Markers of the regimes along an axis.
MARKERS = "svo^Dp"
FAILED = KINDS.index("failed")
# Points whose realisations follow different motions.
MIXED: dict[str, Any] = {"marker": "D", "markersize": 6.0, "color": "white", "markeredgecolor": "black"}
MIXED |= {"linestyle": "none", "label": "realisations follow\ndifferent motions"}
# Area of the mark of a motion that all realisations follow, square points.
LARGEST = 40.0
# Of stable points, which no shade is like.
STABLE = "#ececec"
# The paper's points, by what they are.
PAPER: dict[str, dict[str, Any]] = {
    what: {"marker": marker, "color": "white", "markeredgecolor": "black", "markersize": 6.0, "zorder": 4.0}
    | {"label": f"paper: {what}"}
    for what, marker in {
        "first unstable μ": "D", "periodic": "D", "intermittent": "^", "vibrates (measured)": "^",
        "slides steadily (measured)": "o",
    }.items()
}  # fmt: skip
PAPER["slides steadily (measured)"]["color"] = figures.BLUE
# Up to so many values each has a tick.
FEW = 2
# Planes across and down.
PANELS, PANELS_NARROW = (4, 3), (2, 3)


def set_side(axes: figures.Axes, side: str, array: xr.DataArray) -> NDArray[Any]:
    """Set label, scale and limits of a side, "x" or "y", for a parameter; return the ends of its cells."""
    values = labels.readable(array).values.astype(float)
    ends, which = edges(values), getattr(axes, f"{side}axis")
    if is_logarithmic(values):
        axes.set(**{f"{side}scale": "log"})
        figures.one_two_five(which)
    if len(values) <= FEW:
        which.set_ticks(values, [labels.number(value) for value in values])
        which.set_ticks([], minor=True)
    axes.set(**{f"{side}lim": (ends[0], ends[-1]), f"{side}label": labels.label(array)})
    return ends


def cells(axes: figures.Axes, array: xr.DataArray, x: str, y: str, **options: Any) -> Any:
    """Draw a number over two parameters as lightness, white where it is missing; return it for a colour bar."""
    ends = set_side(axes, "x", array[x]), set_side(axes, "y", array[y])
    axes.grid(False)
    look: dict[str, Any] = {"cmap": "cividis", "rasterized": True} | options
    return axes.pcolormesh(*ends, np.ma.masked_invalid(array.transpose(y, x).values.astype(float)), **look)


def classes(axes: figures.Axes, codes: xr.DataArray, x: str, y: str) -> None:
    """Regimes over two parameters, by index in KINDS, failed points hatched."""
    from matplotlib.colors import ListedColormap

    cells(axes, codes, x, y, cmap=ListedColormap(COLOURS), vmin=-0.5, vmax=len(KINDS) - 0.5)
    hatch_failed(axes, codes == FAILED, x, y, linewidth=0.0, label=None)
    for k in np.unique(codes):
        look: dict[str, Any] = {"facecolor": COLOURS[k], "hatch": "xxxx" if k == FAILED else ""}
        axes.fill_between([], [], edgecolor="black", linewidth=0.5, label=KINDS[k], **look)


def numbers(
    axes: figures.Axes, array: xr.DataArray, x: str, y: str, label: str = "", stable: Any = None, **look: Any
) -> Any:
    """Draw a number over two parameters as lightness, with its colour bar; grey where it is `stable`.

    Without a label there is no colour bar. `norm="log"`, `vmin` and `vmax` give a logarithmic scale. Returns the
    mappable of the colour bar.
    """
    from matplotlib.colors import ListedColormap

    if stable is not None:
        cells(axes, xr.zeros_like(array).where(stable), x, y, cmap=ListedColormap([STABLE]))
        axes.fill_between([], [], color=STABLE, edgecolor="black", label="stable")
        array = array.where(~stable)
    mesh = cells(axes, array, x, y, **look)
    if label and bool(array.notnull().any()):
        axes.figure.colorbar(mesh, ax=axes, pad=0.02, label=label)
    return mesh


def outline(axes: figures.Axes, inside: xr.DataArray, x: str, y: str) -> bool:
    """Draw a line around some of the cells, along their sides; return False if all or none are chosen."""
    if not 0.0 < float(inside.mean()) < 1.0:
        return False
    # Twice the values at both ends of each cell.
    sides = [np.repeat(edges(labels.readable(inside[name]).values.astype(float)), 2)[1:-1] for name in (x, y)]
    for colour, width in (("white", 2.6), ("black", 1.3)):
        twice = np.kron(inside.transpose(y, x), np.ones((2, 2)))
        axes.contour(*sides, twice, levels=[0.5], colors=colour, linewidths=width)
    return True


def stack(
    axes: figures.Axes,
    ends: Any,
    shares: Mapping[str, Any],
    colours: Sequence[str],
    base: float = 0.0,
    **look: Any,
) -> None:
    """Draw named fractions stacked from `base` upwards, over the cells with these `ends`."""
    below = np.full(len(ends) - 1, base)
    for (name, share), colour in zip(shares.items(), colours, strict=True):
        part = np.nan_to_num(share)
        options: dict[str, Any] = {"align": "edge", "color": colour, "label": name} | look
        axes.bar(ends[:-1], part, np.diff(ends), below, **options)
        below = below + part


def hatch_failed(axes: figures.Axes, failed: xr.DataArray, x: str, y: str, **look: Any) -> None:
    """Hatch the cells of failed points."""
    ends = (edges(labels.readable(failed[name]).values.astype(float)) for name in (x, y))
    cells = np.ma.masked_equal(failed.transpose(y, x).values.astype(float), 0.0)
    if cells.count():
        look = {"facecolor": "none", "edgecolor": figures.GREY, "label": "failed"} | look
        axes.pcolor(*ends, cells, hatch="xxxx", **look)


def over_others(
    data: Any, x: str, y: str, others: Sequence[str], title: str, draw: Callable[..., Any]
) -> figures.Figure:
    """Draw a plane by `draw(axes, part, x, y)` for each value, or a selection, of up to two other parameters."""
    most = PANELS if figures.is_wide() else PANELS_NARROW
    across, down = (subset(data.sizes[name], count) for name, count in zip(others, most, strict=True))
    how: dict[str, Any] = {"stack": False, "sharex": True, "sharey": True}
    figure, panels = figures.panels(len(down), len(across), 5.0, **how)
    for k, axes in enumerate(panels):
        at = {others[0]: across[k % len(across)], others[1]: down[k // len(across)]}
        draw(axes, data.isel(at).transpose(y, x, ...), x, y)
        varying = [name for name in others if data.sizes[name] > 1]
        text = ", ".join(labels.named(name, data[name][at[name]]) for name in varying)
        axes.set_title(text, loc="left")
        axes.label_outer()
    figures.legend_below(figure, panels, 3)
    left_out = "".join(
        of_all(chosen, data.sizes[n], f"values of {labels.title(n)}")
        for n, chosen in zip(others, (across, down), strict=True)
    )
    figure.suptitle(f"{title}{left_out}")
    return figure


def along(
    axes: figures.Axes, x: Any, heights: NDArray[Any], codes: NDArray[Any], spread: Any = None, size: float = 5.0
) -> None:
    """Draw a quantity along one parameter, with a marker for the regime (an index in KINDS) of each point."""
    axes.plot(x, heights, color=figures.GREY, linewidth=0.8, zorder=1.5)
    for code in np.unique(codes):
        chosen = codes == code
        if code >= FAILED:
            look: dict[str, Any] = {"color": "black", "transform": axes.get_xaxis_transform(), "clip_on": False}
            axes.plot(x[chosen], np.zeros(chosen.sum()), "x", label=KINDS[code], **look)
            continue
        look = {"linestyle": "none", "marker": MARKERS[code], "markersize": size, "color": COLOURS[code]}
        look |= {"ecolor": figures.GREY, "markeredgecolor": "black", "markeredgewidth": 0.5, "label": KINDS[code]}
        error = None if spread is None else spread[chosen]
        figures.curve(axes, x[chosen], heights[chosen], error, **look, capsize=0.0, clip_on=False, zorder=2.5)


def marks(axes: figures.Axes, places: Iterable[tuple[float, float]], **look: Any) -> None:
    """Mark the points of a plane within its limits."""
    (left, right), (low, high) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    inside = [(x, y) for x, y in places if left <= x <= right and low <= y <= high]
    if inside:
        axes.plot(*zip(*inside, strict=True), **look | {"linestyle": "none"})


def mark_mixed(axes: figures.Axes, dataset: xr.Dataset, x: str, y: str) -> None:
    """Mark the points of a plane whose realisations follow different motions."""
    marks(axes, places(several(dataset), x, y), **MIXED)


def places(chosen: xr.DataArray, x: str, y: str) -> list[tuple[float, float]]:
    """The chosen points of a plane, in readers' units."""
    rows, columns = np.nonzero(chosen.transpose(y, x).values)
    xs, ys = (labels.readable(chosen[name]).values for name in (x, y))
    return list(zip(xs[columns], ys[rows], strict=True))


def draw_mixed(axes: figures.Axes, dataset: xr.Dataset, x: str, name: str) -> None:
    """Along one parameter mark the values of each motion at points with several, larger for frequent ones.

    A quantity without values of each motion has its mean marked.
    """
    if not bool((apart := several(dataset)).any()):
        return
    at = dataset.isel({x: np.flatnonzero(apart)})
    text, heights, share = MIXED["label"], labels.readable(at[name]), xr.ones_like(at[x], dtype=float)
    if f"motion_{name}" in at:
        share = at["motion_share"]
        text, heights = "each motion; larger:\nof more realisations", labels.readable(at[f"motion_{name}"])
    xs, heights, share = xr.broadcast(labels.readable(at[x]), heights.where(share > 0.0), share)
    look: dict[str, Any] = {"marker": MIXED["marker"], "color": "white", "edgecolor": "black", "label": text}
    axes.scatter(xs, heights, LARGEST * share, **look, zorder=3.0, clip_on=False)


def subset(count: int, most: int) -> list[int]:
    """Indices of an evenly spaced subset: all, or `most` of `count`."""
    return [int(k) for k in np.unique(np.linspace(0, count - 1, min(count, most)).round())]


def of_all(chosen: Sequence[Any], count: int, what: str = "") -> str:
    """The part of a title that names the subset drawn."""
    return f" ({len(chosen)} of {count} {what}".rstrip() + ")" if len(chosen) < count else ""
