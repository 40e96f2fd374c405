"""Findings at scattered points: how the results scatter, and their correlation with the drawn values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.query.columns import MAKING, configuration
from studies.tables import Part, Table, number
from sweeps import DONE, FAILED

if TYPE_CHECKING:
    import xarray as xr

QUANTILES = (0.05, 0.5, 0.95)
# A variable with more values at each draw is left out of the report.
MOST_BESIDE = 12
# Rows of a table.
MOST_ROWS = 24
# Correlations of fewer points say nothing.
LEAST_POINTS = 8


@dataclass(frozen=True, eq=False)
class Series:
    """One number of each draw.

    Attributes
    ----------
    name : str
        Of its variable.
    beside : str
        Which of its values at each draw: `mode = 1`; "" where there is one.
    units : str
    values : ndarray, (draws,)
        NaN where there is none.
    """

    name: str
    beside: str
    units: str
    values: NDArray[np.float64]

    @property
    def label(self) -> str:
        """How a table calls it."""
        return f"{self.name}, {self.beside}" if self.beside else self.name


def draws(dataset: xr.Dataset) -> list[str]:
    """The numbers that scatter."""
    along = dataset["status"].dims[0]
    own = [str(name) for name, each in dataset.coords.items() if each.dims == (along,) and name != along]
    return [name for name in own if dataset[name].dtype.kind in "iuf"]


def series(dataset: xr.Dataset) -> tuple[list[Series], list[str]]:
    """Every variable of numbers, one series for each of its few values at a draw; and those that have too many."""
    every, left = list[Series](), list[str]()
    for variable in _variables(dataset):
        name, along = str(variable.name), dataset["status"].dims[0]
        if "flag_values" in variable.attrs:
            continue
        beside = [str(dim) for dim in variable.dims if dim != along]
        if prod(variable.sizes[dim] for dim in beside) > MOST_BESIDE:
            left.append(name)
            continue
        units = str(variable.attrs.get("units", "1")).removeprefix("1")
        for place in product(*(range(variable.sizes[dim]) for dim in beside)):
            at = dict(zip(beside, place, strict=True))
            values = np.asarray(variable.isel(at).values, dtype=float)
            every.append(Series(name, _place_text(dataset, at), units, values))
    return every, left


def _variables(dataset: xr.Dataset) -> Iterator[xr.DataArray]:
    """Variables computed at the draws, without standard errors."""
    along = dataset["status"].dims[0]
    for name, variable in dataset.data_vars.items():
        numeric = along in variable.dims and name not in MAKING and variable.dtype.kind in "iuf"
        if numeric and not (str(name).endswith("_se") and str(name).removesuffix("_se") in dataset):
            yield variable


def _place_text(dataset: xr.Dataset, at: dict[str, int]) -> str:
    """The place along further dimensions in words; those of a single value are left out."""
    several = {dim: k for dim, k in at.items() if dataset.sizes[dim] > 1}
    labels = {dim: dataset[dim].values[k] if dim in dataset else k for dim, k in several.items()}
    return ", ".join(
        f"{dim} = {label if isinstance(label, str) else f'{label:g}'}" for dim, label in labels.items()
    )


def rank_correlation(one: NDArray[Any], other: NDArray[Any]) -> float:
    """Spearman's, of the pairs that are finite; NaN where one of the two is the same at all."""
    # Slow to import.
    from scipy.stats import spearmanr

    finite = np.isfinite(one) & np.isfinite(other)
    if np.count_nonzero(finite) < LEAST_POINTS or np.ptp(one[finite]) == 0.0 or np.ptp(other[finite]) == 0.0:
        return float("nan")
    return float(spearmanr(one[finite], other[finite]).statistic)


def correlations(dataset: xr.Dataset, every: list[Series]) -> list[tuple[Series, str, float]]:
    """Each series with each number that scatters, the strongest rank correlation first."""
    triples = [
        (each, name, rank_correlation(dataset[name].values, each.values))
        for each in every
        for name in draws(dataset)
    ]
    return sorted((each for each in triples if not np.isnan(each[2])), key=lambda each: -abs(each[2]))


def findings(dataset: xr.Dataset) -> list[Part]:
    """How many points, what was cut away, how each number scatters, and with what."""
    every, left = series(dataset)
    lines: list[Part] = [*_counted(dataset), ""]
    rows = [
        [each.label, each.units, *_quantiles(each.values)] for each in every if np.any(np.isfinite(each.values))
    ]
    if rows:
        lines += [Table(("variable", "unit", "5 %", "50 %", "95 %"), rows[:MOST_ROWS], 2), *_more(rows)]
    lines += _shares(dataset)
    strongest = correlations(dataset, every)
    if strongest:
        ranks = [[each.label, name, f"{rho:+.3f}"] for each, name, rho in strongest]
        lines += ["", "Rank correlation (Spearman), the strongest first:", ""]
        lines += [
            Table(("variable", "with", "rank correlation"), ranks[:MOST_ROWS], 2),
            *_more(ranks),
        ]
    if left:
        lines.append(
            f"In the file alone, with more than {MOST_BESIDE} values at each point: {', '.join(left)}; hold an "
            "axis at one value (--set) to see them here."
        )
    return lines


def _counted(dataset: xr.Dataset) -> list[Part]:
    """How many points of what, and how each number is distributed, with what was cut away."""
    status, names = dataset["status"], draws(dataset)
    request = configuration(dataset).get("request", {})
    how = f" ({request['sampling']}, seed {request['seed']})" if "scatter" in request else ""
    plural = "s" if len(status) > 1 else ""
    what = f"draw{plural}{how}" if "sample" in status.dims else f"row{plural} of a table"
    beside = ", ".join(str(dim) for dim in status.dims[1:] if status.sizes[dim] > 1)
    each = f", each at {status.size // len(status)} points of {beside}" if beside else ""
    done, failed = (int(np.count_nonzero(status.values == code)) for code in (DONE, FAILED))
    attributes = [dataset[name].attrs for name in names]
    return [
        f"{len(status)} {what} of {', '.join(names)}{each}: {done} points computed, {failed} failed.",
        *(
            f"{name}: {own['distribution']}"
            for name, own in zip(names, attributes, strict=True)
            if "distribution" in own
        ),
        *(str(own["comment"]) for own in attributes if "comment" in own),
    ]


def _quantiles(values: NDArray[Any]) -> list[str]:
    return [number(each, ".4g") for each in np.quantile(values[np.isfinite(values)], QUANTILES)]


def _shares(dataset: xr.Dataset) -> list[Part]:
    """Shares of the draws by code, for each variable whose codes have words."""
    lines: list[Part] = []
    for variable in _variables(dataset):
        if "flag_values" not in variable.attrs or variable.dims != dataset["status"].dims:
            continue
        codes = np.atleast_1d(variable.attrs["flag_values"]).tolist()
        words = str(variable.attrs["flag_meanings"]).split()
        finite = variable.values[np.isfinite(variable.values)]
        shares = {
            word: np.mean(finite == code) if len(finite) else 0.0 for code, word in zip(codes, words, strict=True)
        }
        most = sorted(((share, word) for word, share in shares.items() if share > 0.0), reverse=True)
        each = ", ".join(f"{100.0 * share:.3g} % {word.replace('_', ' ')}" for share, word in most)
        lines.append(f"{variable.name}: {each or 'none'}")
    return ["", *lines] if lines else []


def _more(rows: list[list[str]]) -> list[Part]:
    return [f"and {len(rows) - MOST_ROWS} more"] if len(rows) > MOST_ROWS else []
