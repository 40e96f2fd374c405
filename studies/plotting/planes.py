"""How quantities over two axes are drawn: names of axes, cells of true extent, and colours of regimes.

Colours survive colour blindness and grey print: shades rise in lightness, classes alternate light and dark.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.motion import transients
from studies.motion.regimes import KINDS
from studies.plotting import figures

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.colorbar import Colorbar
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

# Symbol, unit and factor of what may be an axis, for a reader.
SYMBOLS = {
    "V": ("V", "mm/s", 1e3),
    "theta": ("θ", "°", 1.0),
    "mu": ("μ", "", 1.0),
    "F": ("F", "N", 1.0),
    "contact_position": ("contact position", "mm", 1e3),
    "head_mass": ("head mass", "kg", 1.0),
    "point_b": ("position of B", "", 1.0),
    "d1": ("damping on the mass d1", "1/s", 1.0),
    "d2": ("damping on the stiffness d2", "s", 1.0),
}
BEAM_SYMBOLS = {
    "length": ("length", "mm", 1e3),
    "width": ("width", "mm", 1e3),
    "thickness": ("thickness", "mm", 1e3),
    "young_modulus": ("Young's modulus", "GPa", 1e-9),
    "density": ("density", "kg/m³", 1.0),
    "elements": ("elements", "", 1.0),
}
for _beam in ("p1", "p2"):
    for _name, (_symbol, _unit, _factor) in BEAM_SYMBOLS.items():
        SYMBOLS[f"{_beam}_{_name}"] = (f"{_symbol} of {_beam.upper()}", _unit, _factor)

# Of Okabe and Ito's colours; light and dark ones alternate.
COLOURS = ("#d9d9d9", "#4d4d4d", "#a6dcf7", figures.ORANGE, figures.BLUE, figures.RED, "white", "white")
STATE_COLOURS = {"stick": "#4d4d4d", "slip": "#a6dcf7", "separation": figures.ORANGE}
DARK = ("stuck", "periodic", "irregular")
HATCHES = {"failed": "xxxx"}
# Of the regimes along an axis.
MARKERS = "svo^Dp"
# Panels across and down a figure; of more values it shows so many, evenly chosen.
MOST_ACROSS, MOST_DOWN = 4, 3
# From this ratio of neighbours on values are apart.
GAP = 1.5
# From this ratio of its ends on an axis is logarithmic; of so many values each has a tick.
WIDE, FEW = 20.0, 2


def named(name: str, value: Any) -> str:
    """A value of an axis as a reader writes it."""
    symbol, unit, factor = SYMBOLS[name]
    space = "" if unit in ("", "°") else " "
    return f"{symbol} = {factor * float(value):.4g}{space}{unit}"


def name(axis: str) -> str:
    """The symbol of an axis or of a number of the rig."""
    return SYMBOLS[axis][0]


def label(name: str) -> str:
    """The label of an axis: its symbol and unit."""
    symbol, unit, _ = SYMBOLS[name]
    return f"{symbol} / {f'({unit})' if '/' in unit else unit}" if unit else symbol


def shown(name: str, values: Any) -> NDArray[Any]:
    """Values of an axis in the unit of its label."""
    return np.asarray(SYMBOLS[name][2] * np.asarray(values, dtype=float))


def is_logarithmic(values: Any) -> bool:
    """Whether ascending values read better on a logarithmic axis: they span much, and their steps grow."""
    wide = values[0] > 0.0 and values[-1] >= WIDE * values[0]
    return bool(wide and (len(values) == 2 or values[-1] - values[-2] >= 2.0 * (values[1] - values[0])))


def edges(values: NDArray[Any]) -> NDArray[Any]:
    """Ends of the stretch that each of the ascending values stands for: half-way to its neighbours."""
    if len(values) == 1:
        reach = 0.5 * abs(float(values[0])) or 0.5
        return np.array([values[0] - reach, values[0] + reach])
    if is_logarithmic(values):
        return np.asarray(np.exp(_half_way(np.log(values))))
    return _half_way(values)


def _half_way(values: NDArray[Any]) -> NDArray[Any]:
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


def mark_few(side: Axis, values: NDArray[Any]) -> None:
    """Ticks at the values themselves, where they are few."""
    if len(values) <= FEW:
        side.set_ticks(values, [f"{value:.4g}" for value in values])
        side.set_ticks([], minor=True)


def set_axes(axes: Axes, x: str, xs: Any, y: str, ys: Any) -> None:
    """Labels and scales of a plane whose cells stand about the values xs and ys; of few values those are ticks."""
    for name, values, side in ((x, xs, "x"), (y, ys, "y")):
        ends = edges(shown(name, values))
        if is_logarithmic(shown(name, values)):
            axes.set(**{f"{side}scale": "log"})
            getattr(axes, f"{side}axis").set_major_formatter("{x:g}")
        mark_few(getattr(axes, f"{side}axis"), shown(name, values))
        axes.set(**{f"{side}lim": (ends[0], ends[-1]), f"{side}label": label(name)})
    axes.grid(False)


def shades(
    axes: Axes, x: str, xs: Any, y: str, ys: Any, values: NDArray[Any], norm: Normalize | None = None
) -> Any:
    """A number as lightness, (y, x), white where there is none; what a colour bar is made from."""
    mesh = axes.pcolormesh(
        edges(shown(x, xs)), edges(shown(y, ys)), values, cmap="cividis", norm=norm, rasterized=True
    )
    set_axes(axes, x, xs, y, ys)
    return mesh


def classes(axes: Axes, x: str, xs: Any, y: str, ys: Any, codes: NDArray[Any], colours: Sequence[str]) -> None:
    """Classes, (y, x), each in its colour; white where there is none."""
    from matplotlib.colors import ListedColormap

    axes.pcolormesh(
        edges(shown(x, xs)),
        edges(shown(y, ys)),
        np.ma.masked_invalid(np.asarray(codes, dtype=float)),
        cmap=ListedColormap(list(colours)),
        vmin=-0.5,
        vmax=len(colours) - 0.5,
        rasterized=True,
    )
    set_axes(axes, x, xs, y, ys)


def multiples(
    dataset: xr.Dataset,
    x: str,
    y: str,
    others: Sequence[str],
    size: Callable[[int, int], tuple[float, float]],
    draw: Callable[[Axes, xr.Dataset], Any],
) -> tuple[Figure, list[Any], str]:
    """A panel of x and y for each value of up to two other axes, across and down.

    Parameters
    ----------
    dataset : xarray.Dataset
        Over V, theta, mu and F.
    x, y : str
        Axes of each panel.
    others : sequence of str
        Axes of the panels; of what is neither, the first value is shown.
    size : callable
        `size(across, down)` returns the figure's width and height, cm.
    draw : callable
        `draw(axes, at)` draws one panel of what `at` holds, (y, x, ...).

    Returns
    -------
    figure : Figure
    returned : list
        What `draw` returned for each panel.
    left_out : str
        Of how many values not all are shown, like "4 of 13 θ"; else nothing.
    """
    picked = {
        name: transients.some(dataset.sizes[name], most)
        for name, most in zip(others, (MOST_ACROSS, MOST_DOWN), strict=False)
    }
    across, down = (picked.get(name, [0]) for name in [*others, "", ""][:2])
    figure, panels = figures.panels(
        len(down), len(across), *size(len(across), len(down)), sharex=True, sharey=True
    )
    returned = []
    for k, axes in enumerate(panels):
        place = dict(zip(others, (across[k % len(across)], down[k // len(across)]), strict=False))
        at = dataset.isel({name: place.get(name, 0) for name in transients.SCENE if name not in (x, y)})
        returned.append(draw(axes, at.transpose(y, x, ...)))
        axes.set_title(", ".join(named(name, at[name]) for name in place), loc="left", fontsize=9.0)
        axes.label_outer()
    left_out = ", ".join(
        f"{len(shown)} of {dataset.sizes[name]} {SYMBOLS[name][0]}"
        for name, shown in picked.items()
        if len(shown) < dataset.sizes[name]
    )
    return figure, returned, left_out


def along(
    axes: Axes, x: Any, heights: NDArray[Any], codes: NDArray[Any], spread: Any = None, size: float = 5.0
) -> None:
    """A quantity along one axis, each point marked by its regime (a place in KINDS), or by a cross."""
    axes.plot(x, heights, color=figures.GREY, linewidth=0.8, zorder=1.5)
    for code in np.unique(codes):
        chosen = codes == code
        if KINDS[code] in ("failed", "pending"):
            look: dict[str, Any] = {"color": "black", "transform": axes.get_xaxis_transform(), "clip_on": False}
            axes.plot(x[chosen], np.zeros(chosen.sum()), "x", label=KINDS[code], **look)
            continue
        axes.errorbar(
            x[chosen],
            heights[chosen],
            None if spread is None else spread[chosen],
            linestyle="none",
            marker=MARKERS[code],
            markersize=size,
            color=COLOURS[code],
            ecolor=figures.GREY,
            markeredgecolor="black",
            markeredgewidth=0.5,
            label=KINDS[code],
            clip_on=False,
            zorder=2.5,
        )


def marks(axes: Axes, places: Sequence[tuple[float, float]], **look: Any) -> list[Line2D]:
    """Mark those points of a plane that lie within its limits; for a legend, what stands for them."""
    from matplotlib.lines import Line2D

    (left, right), (low, high) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    inside = [(x, y) for x, y in places if left <= x <= right and low <= y <= high]
    if not inside:
        return []
    axes.plot(*zip(*inside, strict=True), **look | {"linestyle": "none"})
    return [Line2D([], [], **look)]


def shares(axes: Axes, ends: NDArray[Any], at: xr.Dataset) -> None:
    """The contact's states as shares of the time, stacked, along the one axis whose cells have these `ends`."""
    below = np.zeros(len(ends) - 1)
    for state, colour in STATE_COLOURS.items():
        share = np.nan_to_num(at[f"{state}_fraction"].values)
        look: dict[str, Any] = {"edgecolor": "white", "linewidth": 0.3 if len(share) <= 80 else 0.0}
        axes.bar(ends[:-1], share, np.diff(ends), below, align="edge", label=state, color=colour, **look)
        below += share
    axes.set_ylim(0.0, 1.0)


def patches(kinds: Any) -> list[Patch]:
    """Patches for a legend of the regimes that occur, by their places in KINDS."""
    from matplotlib.patches import Patch

    return [
        Patch(
            facecolor=COLOURS[k], edgecolor="black", linewidth=0.5, hatch=HATCHES.get(KINDS[k], ""), label=KINDS[k]
        )
        for k in sorted(int(kind) for kind in kinds)
    ]


def banded(values: NDArray[Any]) -> tuple[Normalize, NDArray[Any]]:
    """A scale for what comes in bands with wide gaps between: each has an equal share of it; and its ticks."""
    from matplotlib.colors import FuncNorm
    from matplotlib.ticker import MaxNLocator

    ordered = np.unique(values[np.isfinite(values)])
    parts = np.split(ordered, np.flatnonzero(ordered[1:] >= GAP * ordered[:-1]) + 1)
    ends = np.concatenate([part[[0, -1]] + [0.0, 1e-6 * part[-1]] for part in parts])
    places = (np.arange(len(parts))[:, None] + [0.0, 0.7]).ravel()
    ticks = [MaxNLocator(4).tick_values(part[0], part[-1]) for part in parts]
    inside = [each[(each >= part[0]) & (each <= part[-1])] for each, part in zip(ticks, parts, strict=True)]
    scale = FuncNorm(
        (lambda x: np.interp(x, ends, places), lambda x: np.interp(x, places, ends)), ends[0], ends[-1]
    )
    return scale, np.concatenate(inside)


def colour_bar(figure: Figure, mesh: Any, axes: Axes, text: str, ticks: Any = None) -> Colorbar:
    """The scale of a shaded plane beside it."""
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, ticks=ticks, format=None if ticks is None else "{x:g}")
    bar.set_label(text)
    bar.outline.set_visible(False)
    return bar
