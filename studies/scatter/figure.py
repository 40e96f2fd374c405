"""The figure of a study at scattered points: results over drawn values, with running medians."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.plotting import figures, planes
from studies.scatter.findings import Series, correlations, draws, series

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

ROWS, COLUMNS = 3, 4
# A median is of at least so many points, and there are no more of them.
LEAST, MOST = 8, 16


def draw(dataset: xr.Dataset) -> Figure:
    """Scatter plots of at most three variables over at most four draws, those that go together most."""
    every = [each for each in series(dataset)[0] if np.any(np.isfinite(each.values))]
    shown, over = chosen(dataset, every)
    rows, columns = max(len(shown), 1), max(len(over), 1)
    figure, panels = figures.panels(
        rows, columns, 3.5 + 4.6 * columns, 1.8 + 4.2 * rows, sharex="col", sharey="row"
    )
    if not shown or not over:
        panels[0].set_axis_off()
        panels[0].text(0.5, 0.5, "no numbers to show", ha="center", va="center")
    size = float(np.clip(3000.0 / dataset["status"].shape[0], 1.0, 14.0))
    for row, each in enumerate(shown):
        for column, name in enumerate(over):
            axes = panels[row * columns + column]
            x = planes.SYMBOLS.get(name, ("", "", 1.0))[2] * dataset[name].values
            axes.scatter(x, each.values, s=size, color=figures.BLUE, alpha=0.45, linewidths=0.0, rasterized=True)
            axes.plot(*medians(x, each.values), color=figures.ORANGE, linewidth=1.8, label="running median")
            if row == rows - 1:
                axes.set_xlabel(_label(dataset, name))
            if column == 0:
                axes.set_ylabel(_over_lines(each))
    for axes in panels:
        axes.locator_params(nbins=5)
        axes.ticklabel_format(useOffset=False)
    count, along = dataset["status"].shape[0], "draws" if "sample" in dataset.dims else "rows"
    figure.suptitle(f"{dataset.attrs.get('sweep', '')}: {count} {along}")
    figures.legend_below(figure, panels[:1])
    return figure


def chosen(dataset: xr.Dataset, every: list[Series]) -> tuple[list[Series], list[str]]:
    """The variables and the draws that go together most; of a variable with several values the one that varies."""
    widest: dict[str, Series] = {}
    for each in every:
        if each.name not in widest or _spread(each) > _spread(widest[each.name]):
            widest[each.name] = each
    own = list(widest.values())
    strongest = correlations(dataset, own)
    shown = list(dict.fromkeys([each.name for each, *_ in strongest] + list(widest)))[:ROWS]
    over = list(dict.fromkeys([name for _, name, _ in strongest] + draws(dataset)))[:COLUMNS]
    return [each for each in own if each.name in shown], [name for name in draws(dataset) if name in over]


def _spread(each: Series) -> float:
    low, high = np.quantile(each.values[np.isfinite(each.values)], (0.05, 0.95))
    return float(high - low)


def medians(x: NDArray[Any], y: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Medians of both over groups of points that are neighbours in x and equally many."""
    finite = np.isfinite(x) & np.isfinite(y)
    order = np.argsort(x[finite], kind="stable")
    x, y = x[finite][order], y[finite][order]
    groups = min(MOST, len(x) // LEAST)
    if groups < 2:
        return np.empty(0), np.empty(0)
    pieces = np.array_split(np.arange(len(x)), groups)
    return np.array([np.median(x[p]) for p in pieces]), np.array([np.median(y[p]) for p in pieces])


def _label(dataset: xr.Dataset, name: str) -> str:
    if name in planes.SYMBOLS:
        return planes.label(name)
    units = str(dataset[name].attrs.get("units", "1"))
    return name if units == "1" else f"{name} / ({units})"


def _over_lines(each: Series) -> str:
    lines = [each.name, each.beside, f"({each.units})" if each.units else ""]
    return "\n".join(filter(None, lines))
