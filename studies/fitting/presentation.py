"""Summary, tables and figure of pairs of a fit."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from studies.answering.results import configuration
from studies.declaring import labels, spec
from studies.fitting.sampling import effective_size
from studies.motion import uncertainty
from studies.plotting import figures, planes
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
    """Quantiles of weighted values; draws without a value or a weight do not count."""
    counts = np.isfinite(values) & (weights > 0.0)
    values, weights = values[counts], weights[counts]
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
    """Unknowns whose posterior equals their prior within the sampling error, and strongly correlated pairs."""
    priors, _, weights = parts(dataset)
    levels = np.stack([prior.cdf(dataset[name].values) for name, prior in priors.items()])
    spread = np.atleast_2d(np.cov(levels, aweights=weights, ddof=0))
    together = spread / np.maximum(np.sqrt(np.outer(np.diag(spread), np.diag(spread))), 1e-300)
    least = max(SILENT, KOLMOGOROV / np.sqrt(effective_size(weights)))
    silent, names = list[str](), [labels.title(name) for name in priors]
    for k, level in enumerate(levels):
        order = np.argsort(level)
        distance = np.abs(np.cumsum(weights[order]) - level[order]).max()
        if distance < least and not np.any(np.abs(np.delete(together[k], k)) > 2.0 * least):
            silent.append(names[k])
    pairs = [(j, k) for j, k in combinations(range(len(names)), 2) if abs(together[j, k]) > TOGETHER]
    return silent, [f"{names[j]} with {names[k]} ({together[j, k]:.2f})" for j, k in pairs]


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Yield posterior medians and intervals, the effective sample size, and predictions beside measurements."""
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
        yield f"The data do not constrain {', '.join(silent)}."
    if pairs:
        yield f"Known better together than alone (correlated): {', '.join(pairs)}."
    table, never = [], list[str]()
    for target in targets:
        values, (unit, factor) = dataset[target["name"]].values, labels.unit_of(dataset[target["name"]])
        low, middle, high = quantiles(values, weights)
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
    """Predictions beside measurements, unknowns with their priors, and 50 and 90 % regions of pairs."""
    priors, targets, weights = parts(dataset)
    names, n = list(priors), len(priors)
    layout = [["targets"] * n, *([f"{k} {j}" if j <= k else "." for j in range(n)] for k in range(n))]
    rows = 2.0 + 0.4 * len(targets), *[0.8 * figures.width_cm() / n] * n
    figure, panels = figures.mosaic(layout, *rows, stack=False)
    middles = {name: _middles(dataset[name], weights, prior.text) for name, prior in priors.items()}
    for k, j in zip(*np.tril_indices(n), strict=True):
        axes, x, y = panels[f"{k} {j}"], names[j], names[k]
        across = planes.set_side(axes, "x", middles[x])
        if x == y:
            axes.hist(labels.readable(dataset[x]), list(across), weights=weights, color=figures.BLUE, alpha=0.5)
            before = np.diff(priors[x].cdf(across / labels.unit_of(dataset[x])[1]))
            axes.stairs(before, across, color=figures.BLACK)
            axes.set(yticks=[], ylim=(0.0, None))
        else:
            edges = [across, planes.set_side(axes, "y", middles[y])]
            _pair(axes, [labels.readable(dataset[name]) for name in (x, y)], weights, edges)
        axes.label_outer()
    _predictions(panels["targets"], dataset, targets, weights)
    figure.suptitle(f"{dataset.attrs['title']}: posterior (blue) and prior (line)")
    return figure


def _middles(draws: xr.DataArray, weights: Any, prior: str) -> xr.DataArray:
    """Midpoints of the bins of an unknown, around its posterior."""
    ends = quantiles(draws.values, weights, (0.002, 0.998))
    wide = prior.startswith(LOGARITHMIC) and ends[1] > spec.WIDE * ends[0]
    low, high = np.log(ends) if wide else ends
    reach = 0.2 * (high - low) or 1e-3 * abs(low) + 1e-12  # one draw may have all the weight
    values = np.linspace(low - reach, high + reach, BINS)
    return xr.DataArray(np.exp(values) if wide else values, name=draws.name, attrs=draws.attrs)


def _pair(axes: Axes, draws: Any, weights: Any, edges: Any) -> None:
    """Regions of highest density, 50 and 90 %, of a smoothed histogram of two unknowns."""
    from scipy.ndimage import gaussian_filter

    counts = gaussian_filter(np.histogram2d(draws[0], draws[1], edges, weights=weights)[0], SMOOTH)
    ordered = np.sort(counts.ravel())[::-1]
    levels = [ordered[np.searchsorted(np.cumsum(ordered), share * ordered.sum())] for share in (0.9, 0.5)]
    middles = [0.5 * (each[1:] + each[:-1]) for each in edges]
    axes.contourf(*middles, counts.T, [*levels, 1.01 * ordered[0]], colors=[figures.BLUE], alpha=(0.3, 0.7))


def _predictions(axes: Axes, dataset: xr.Dataset, targets: Any, weights: Any) -> None:
    """Median and interval of each target's prediction, as deviations from the measurement."""
    for k, target in enumerate(targets):
        off = (quantiles(dataset[target["name"]].values, weights) - target["value"]) / (target["within"] or 1.0)
        axes.plot(off[[0, 2]], [k, k], color=figures.BLUE)
        axes.plot(off[1], k, "o", color=figures.BLUE, markersize=4.0)
    axes.axvspan(-1.0, 1.0, color="#e0e0e0", zorder=0)
    axes.set_yticks(range(len(targets)), [labels.title(target["name"]) for target in targets])
    axes.set_title("Predictions, median and 90 %; grey: within one standard deviation")
    axes.set(xlabel="predicted - measured, in its standard deviations", ylim=(len(targets) - 0.5, -0.5))


def study(dataset: xr.Dataset) -> Study:
    """A study that presents the result of a fit."""
    about = (
        str(dataset.attrs["sweep"]),
        str(dataset.attrs["title"]),
        "Which parameters agree with the measurements?",
    )
    figure = draw if "weight" in dataset else None  # a first round that is not finished has none
    return Study(*about, {}, {"-": ("1", "")}, lambda: {}, summary=summarise, figure=figure)
