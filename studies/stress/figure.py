"""How the battery is drawn: cases and methods by what came, and how near every check came to failing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from studies.plotting import figures
from studies.stress.case import APART, CAME, DEAR, FAILS, METHODS, PASSES, PENDING
from studies.stress.findings import outcomes, worst

# Rows of a column of the matrix, and columns, at most; what a row is high, cm.
MOST_ROWS, MOST_COLUMNS, ROW = 54, 3, 0.32
# Each outcome's colour, in the order of CAME, and what stands in its cells; of a pass the margin does.
REFUSED = "#bdbdbd"
REFUSALS = tuple(code for code, word in enumerate(CAME) if word.endswith("Error"))
COLOURS = ("#a6dcf7", REFUSED, REFUSED, REFUSED, figures.RED, "white", "white", "white")
WRITTEN = ("", "value", "cont.", "div.", "FAILS", "-", "dear", "")
# Marker, colour and place beside a check's middle of each method.
LOOKS = {
    "fast": ("o", figures.BLUE, -0.25),
    "exact": ("^", figures.ORANGE, 0.0),
    "paper": ("s", figures.BLACK, 0.25),
}
# Margins below are drawn as this, for none is nearer to failing than another.
LEAST = 1e-6


def draw(dataset: xr.Dataset) -> Figure:
    """The matrix in columns, groups under their names; below, the margins of each check."""
    columns = _columns(dataset)
    high = max(map(len, columns))
    matrix = ROW * high + 1.2
    figure, _ = figures.panels(1, 1, 17.0, matrix + 8.0)
    figure.clear()
    parts: Any = figure.subfigures(2, 1, height_ratios=(matrix, 8.0))
    upper, lower = parts
    # A single column is no wider than one of two.
    panels = upper.subplots(1, max(len(columns), 2), squeeze=False)[0]
    for axes in panels[len(columns) :]:
        axes.axis("off")
    for axes, rows in zip(panels, columns, strict=False):
        _draw_column(axes, dataset, rows, high)
    _draw_margins(lower.subplots(), dataset)
    lower.legend(handles=_handles(dataset), loc="outside lower center", ncols=3, fontsize=7.0)
    failed = int(np.count_nonzero(outcomes(dataset) == FAILS))
    count = dataset.sizes["case"]
    cases = f"{count} case{'s' if count > 1 else ''}"
    figure.suptitle(f"{cases} under stress: {failed or 'none'} failed")
    return figure


def _columns(dataset: xr.Dataset) -> list[list[int | str]]:
    """Columns of the matrix: the places of cases under the names of their groups, each begun anew in a column."""
    groups = [str(group) for group in dataset["group"].values]
    count = len(groups) + len(set(groups))
    wanted = min(MOST_COLUMNS, -(-count // MOST_ROWS))
    high = -(-(count + wanted - 1) // wanted)
    columns: list[list[int | str]] = [[]]
    for k, group in enumerate(groups):
        begins = not k or group != groups[k - 1]
        # No name stands alone at the foot of a column.
        if len(columns[-1]) + 1 + begins > high and len(columns) < wanted:
            columns.append([])
        if begins or not columns[-1]:
            columns[-1].append(group if begins else f"{group}, continued")
        columns[-1].append(k)
    return columns


def _draw_column(axes: Axes, dataset: xr.Dataset, rows: Sequence[int | str], high: int) -> None:
    """One column of the matrix: a name and a cell for each method in every row."""
    outcome, (margin, _) = outcomes(dataset), worst(dataset)
    methods = [str(name) for name in dataset["method_name"].values]
    codes = np.full((high, len(methods)), np.nan)
    labels = []
    for y, row in enumerate(rows):
        if isinstance(row, str):
            axes.text(-0.6, y, row, fontsize=6.0, fontweight="bold", ha="right", va="center")
            labels.append("")
            continue
        codes[y] = outcome[row]
        labels.append(f"{dataset['case_name'].values[row]}  {int(dataset['case'].values[row])}")
        for x, code in enumerate(outcome[row]):
            passed = CAME[code] == PASSES
            text = _percent(margin[row, x]) if passed else WRITTEN[code]
            colour = "white" if code == FAILS else "black"
            axes.text(x, y, text, fontsize=5.0, ha="center", va="center", color=colour)
    axes.pcolormesh(
        np.arange(len(methods) + 1) - 0.5,
        np.arange(high + 1) - 0.5,
        np.ma.masked_invalid(codes),
        cmap=ListedColormap(COLOURS),
        vmin=-0.5,
        vmax=len(COLOURS) - 0.5,
        edgecolors="white",
        linewidth=0.6,
    )
    axes.set_ylim(high - 0.5, -0.5)
    axes.set_yticks(np.arange(len(labels)), labels, fontsize=5.5)
    axes.set_xticks(np.arange(len(methods)), methods, fontsize=6.0)
    axes.xaxis.tick_top()
    axes.tick_params(length=0.0, pad=1.5)
    axes.grid(False)
    for side in axes.spines.values():
        side.set_visible(False)


def _percent(margin: float) -> str:
    """A margin in per cent of its bound; nothing where it is far from it."""
    return f"{100.0 * margin:.0f}" if margin >= 0.01 else ""


def _draw_margins(axes: Axes, dataset: xr.Dataset) -> None:
    """Every margin of every check, by method."""
    margin = dataset["margin"].transpose("check", "method", "case").values
    known = [k for k in range(len(margin)) if np.isfinite(margin[k]).any() or np.isinf(margin[k]).any()]
    for m, name in enumerate(dataset["method_name"].values):
        marker, colour, beside = LOOKS[str(name)]
        for x, k in enumerate(known):
            values = margin[k, m][~np.isnan(margin[k, m])]
            spread = beside + 0.16 * (_apart(len(values)) - 0.5)
            shown = np.clip(values, LEAST, 30.0)
            look: dict[str, Any] = {"markersize": 2.6, "markerfacecolor": "none", "markeredgewidth": 0.6}
            axes.plot(x + spread, shown, marker, color=colour, **look)
    axes.axhline(1.0, color=figures.RED, linestyle="--", linewidth=1.0)
    axes.set_yscale("log")
    axes.set_ylim(0.5 * LEAST, 40.0 if np.nanmax(margin, initial=0.0) > 1.0 else 4.0)
    axes.set_xticks(np.arange(len(known)), dataset["check"].values[known], rotation=30.0, ha="right", fontsize=7.0)
    axes.set_xlim(-0.5, max(len(known), 1) - 0.5)
    axes.set_ylabel("found / allowed\n(least and below at the bottom)", fontsize=7.0)
    axes.tick_params(axis="y", labelsize=7.0)
    axes.grid(axis="x", visible=False)


def _apart(count: int) -> NDArray[Any]:
    """Places in (0, 1), spread evenly whatever their number: multiples of the golden section."""
    return np.asarray((np.arange(count) * 0.6180339887498949) % 1.0)


def _handles(dataset: xr.Dataset) -> list[Any]:
    """What the colours and markers stand for."""
    outcome = outcomes(dataset)
    kinds = {
        "passes; its nearest check but cost, in % of what it may be": (COLOURS[0], (CAME.index(PASSES),)),
        "refused as expected: Value-, Contact-, DivergenceError": (REFUSED, REFUSALS),
        "fails": (COLOURS[FAILS], (FAILS,)),
    }
    blank = {APART: "-: not asked", DEAR: "dear: too dear to ask", PENDING: "empty: pending"}
    kinds["; ".join(word for code, word in blank.items() if code in outcome)] = ("white", tuple(blank))
    shown = [
        Patch(facecolor=colour, edgecolor="black", linewidth=0.4, label=label)
        for label, (colour, codes) in kinds.items()
        if np.isin(outcome, codes).any()
    ]
    methods = [name for name in METHODS if name in dataset["method_name"].values]
    lines = [
        Line2D(
            [], [], marker=LOOKS[name][0], color=LOOKS[name][1], label=name, linestyle="", markerfacecolor="none"
        )
        for name in methods
    ]
    return [*shown, *lines, Line2D([], [], color=figures.RED, linestyle="--", label="what is allowed")]
