"""Summary, tables and figure of pairs of a fit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from studies import labels, uncertainty
from studies.fitting.sampling import effective_size
from studies.plotting import figures
from studies.results import configuration
from studies.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Ends of the intervals, and their share.
ENDS, SHARE = (0.05, 0.5, 0.95), "90 %"
# A target is met by a draw within so many standard deviations.
MET = 2.0
# Distance of posterior and prior distribution functions below which the data say nothing: Kolmogorov's at 1 %.
SILENT, KOLMOGOROV = 0.1, 1.63
# Correlation from which on two unknowns are named together.
TOGETHER = 0.7
# Effective draws below which intervals are rough.
FEW = 100.0
BINS, SMOOTH = 26, 1.0
LOGARITHMIC = ("lognormal:", "loguniform:")


def quantiles(values: Any, weights: Any, levels: Any = ENDS) -> Any:
    """Quantiles of weighted values."""
    order = np.argsort(values)
    below = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(levels, below / weights.sum(), values[order])


def parts(dataset: xr.Dataset) -> tuple[dict[str, uncertainty.Distribution], list[Any], Any]:
    """The priors of the unknowns, the targets, and the weights of a result."""
    stated = configuration(dataset)["constants"]
    units = {name: str(dataset[name].attrs.get("units", "1")) for name in stated["unknown"]}
    priors = {name: uncertainty.parse(text, name, units[name]) for name, text in stated["unknown"].items()}
    weights = dataset["weight"].values if "weight" in dataset else np.zeros(dataset.sizes["draw"])
    return priors, stated["targets"], weights


def learnt(dataset: xr.Dataset) -> tuple[list[str], list[str]]:
    """Unknowns whose posterior is their prior, as far as so many draws tell, and pairs that are known together."""
    priors, _, weights = parts(dataset)
    levels = np.stack([prior.cdf(dataset[name].values) for name, prior in priors.items()])
    spread = np.atleast_2d(np.cov(levels, aweights=weights, ddof=0))
    together = spread / np.maximum(np.sqrt(np.outer(np.diag(spread), np.diag(spread))), 1e-300)
    least = max(SILENT, KOLMOGOROV / np.sqrt(effective_size(weights)))
    silent, pairs = list[str](), list[str]()
    for k, (name, level) in enumerate(zip(priors, levels, strict=True)):
        order = np.argsort(level)
        distance = np.abs(np.cumsum(weights[order]) - level[order]).max()
        if distance < least and not np.any(np.abs(np.delete(together[k], k)) > 2.0 * least):
            silent.append(labels.title(name))
        for j in range(k):
            if abs(together[j, k]) > TOGETHER:
                pairs.append(f"{labels.title(list(priors)[j])} with {labels.title(name)} ({together[j, k]:.2f})")
    return silent, pairs


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Yield posterior medians and intervals, the effective sample size, and predictions beside measurements."""
    import pandas as pd

    priors, targets, weights = parts(dataset)
    if not weights.any():
        yield "No weights yet: the first round is not finished."
        return
    rows, found = [], list[str]()
    for name, prior in priors.items():
        unit, factor = labels.unit_of(dataset[name])
        low, middle, high = factor * quantiles(dataset[name].values, weights)
        before = factor * prior.ppf(ENDS)
        found.append(f"{labels.title(name)} {middle:.4g} {unit} ({low:.4g} to {high:.4g})".replace("  ", " "))
        rows.append((f"{name} {unit}".strip(), middle, low, high, before[1], before[0], before[2]))
    yield f"Medians, and {SHARE} intervals: {', '.join(found)}."
    ess, rounds = effective_size(weights), int(dataset["round"].max())
    rough = "; intervals are rough, take more samples or rounds" if ess < FEW else ""
    yield f"{len(weights)} draws in {rounds} rounds count like {ess:.0f} (effective sample size){rough}."
    heads = ["unknown", "median", "5 %", "95 %", "prior median", "prior 5 %", "prior 95 %"]
    yield "Unknowns", pd.DataFrame(rows, columns=heads)
    silent, pairs = learnt(dataset)
    if silent:
        yield f"The data say nothing of: {', '.join(silent)}."
    if pairs:
        yield f"Known together better than alone (correlation): {', '.join(pairs)}."
    table, never = [], list[str]()
    for target in targets:
        values = dataset[target["name"]].values
        finite = np.isfinite(values) & (weights > 0.0)
        unit, factor = labels.unit_of(dataset[target["name"]])
        low, middle, high = quantiles(values[finite], weights[finite])
        spread = target["within"] or 0.5
        away = np.abs(values - target["value"]) / spread
        nearest = factor * values[np.nanargmin(away)]
        never += [] if np.nanmin(away) < MET else [f"{target['name']} (nearest {nearest:.5g} {unit})"]
        numbers = factor * np.array([target["value"], target["within"], middle, low, high])
        table.append((f"{target['name']} {unit}".strip(), *numbers, (middle - target["value"]) / spread))
    heads = ["target", "measured", "within", "predicted", "5 %", "95 %", "off by SDs"]
    yield "Predictions beside measurements", pd.DataFrame(table, columns=heads)
    if never:
        yield f"No draw meets: {', '.join(never)}."
    if missed := [row[0] for row in table if abs(row[-1]) > MET]:
        yield f"Predictions are off by more than {MET:g} standard deviations: {', '.join(missed)}."


def draw(dataset: xr.Dataset) -> Figure:
    """Predictions beside measurements; each unknown with its prior; pairs, where the densest 50 and 90 % are."""
    from matplotlib.ticker import MaxNLocator

    priors, targets, weights = parts(dataset)
    n, columns = len(priors), {name: labels.readable(dataset[name]) for name in priors}
    layout = [["targets"] * n, *([f"{k} {j}" if j <= k else "." for j in range(n)] for k in range(n))]
    width, above = max(16.0, 4.5 * n), 3.0 + 0.4 * len(targets)
    below = 0.8 * width / n
    ratios = {"height_ratios": [above, *[below] * n]}
    figure, panels = figures.mosaic(layout, width, above + n * below, gridspec_kw=ratios)
    edges, log = dict[str, Any](), {name for name in priors if priors[name].text.startswith(LOGARITHMIC)}
    for name, values in columns.items():
        low, high = quantiles(values.values, weights, (0.002, 0.998))
        if not low < high:
            # One draw has all the weight.
            low, high = low - 1e-3 * abs(low) - 1e-12, high + 1e-3 * abs(high) + 1e-12
        if name in log:
            edges[name] = np.geomspace(low**1.2 * high**-0.2, high**1.2 * low**-0.2, BINS)
        else:
            edges[name] = np.linspace(1.2 * low - 0.2 * high, 1.2 * high - 0.2 * low, BINS)
    for k, (y, prior) in enumerate(priors.items()):
        for j, x in enumerate(list(priors)[: k + 1]):
            axes = panels[f"{k} {j}"]
            axes.set_xscale("log" if x in log else "linear")
            if x == y:
                axes.hist(columns[x].values, list(edges[x]), weights=weights, color=figures.BLUE, alpha=0.5)
                before = np.diff(prior.cdf(edges[x] / labels.unit_of(dataset[x])[1]))
                axes.stairs(before, edges[x], color=figures.BLACK)
                axes.set(yticks=[], ylim=(0.0, None))
            else:
                axes.set_yscale("log" if y in log else "linear")
                _pair(axes, columns[x], columns[y], weights, edges[x], edges[y])
                axes.set_ylabel(labels.label(dataset[y]) if j == 0 else "")
            axes.set(xlim=edges[x][[0, -1]], xlabel=labels.label(dataset[x]) if k == n - 1 else "")
            for name, side in ((x, axes.xaxis), (y, axes.yaxis)):
                if name in log:
                    # Matplotlib's own ticks over more than a decade.
                    if edges[name][-1] < 10.0 * edges[name][0]:
                        figures.one_two_five(side)
                elif side.get_scale() == "linear" and len(side.get_ticklocs()):
                    side.set_major_locator(MaxNLocator(4))
    _predictions(panels["targets"], dataset, targets, weights)
    figure.suptitle(f"{dataset.attrs['title']}: posterior (blue) and prior (line)")
    return figure


def _pair(axes: Axes, x: Any, y: Any, weights: Any, across: Any, up: Any) -> None:
    """The densest 50 and 90 % of a smoothed histogram of two unknowns."""
    from scipy.ndimage import gaussian_filter

    counts = gaussian_filter(np.histogram2d(x, y, [across, up], weights=weights)[0], SMOOTH)
    ordered = np.sort(counts.ravel())[::-1]
    levels = [ordered[np.searchsorted(np.cumsum(ordered), share * ordered.sum())] for share in (0.9, 0.5)]
    middles = [0.5 * (each[1:] + each[:-1]) for each in (across, up)]
    axes.contourf(*middles, counts.T, [*levels, 1.01 * ordered[0]], colors=[figures.BLUE], alpha=(0.3, 0.7))
    axes.set_ylim(up[0], up[-1])


def _predictions(axes: Axes, dataset: xr.Dataset, targets: Any, weights: Any) -> None:
    """Medians and intervals of the prediction of each target, by how many deviations it is off the measurement."""
    for k, target in enumerate(targets):
        values = dataset[target["name"]].values
        finite = np.isfinite(values) & (weights > 0.0)
        off = (quantiles(values[finite], weights[finite]) - target["value"]) / (target["within"] or 1.0)
        axes.plot(off[[0, 2]], [k, k], color=figures.BLUE)
        axes.plot(off[1], k, "o", color=figures.BLUE, markersize=4.0)
    axes.axvspan(-1.0, 1.0, color="#e0e0e0", zorder=0)
    axes.set_yticks(range(len(targets)), [labels.title(target["name"]) for target in targets])
    axes.set_title("Predictions, median and 90 %; grey: within one standard deviation", fontsize=9.0)
    axes.set(xlabel="predicted - measured, in its standard deviations", ylim=(len(targets) - 0.5, -0.5))


def study(dataset: xr.Dataset) -> Study:
    """A study that presents the result of a fit."""
    about = str(dataset.attrs["sweep"]), str(dataset.attrs["title"]), "Which parameters give what was observed?"
    figure = draw if "weight" in dataset else None  # a first round that is not finished has none
    return Study(*about, {}, {"-": ("1", "")}, lambda: {}, summary=summarise, figure=figure)
