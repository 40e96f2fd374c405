"""Claims of the paper as data, and the one table that shows them beside a result: paper, here, difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from studies import paper
from studies.query.nearest import nearest
from studies.study import constants
from studies.tables import Part, Table, word

# The operating point of a claim, where it does not say otherwise.
POINT = {"theta": paper.THETA, "mu": paper.MU, "F": paper.LOAD}
# Units as a reader writes them, and factors to them.
READABLE = {"m s-1": ("mm/s", 1e3), "s-1": ("1/s", 1.0), "degree": ("degrees", 1.0), "1": ("", 1.0)}


@dataclass(frozen=True)
class Claim:
    """A number or a word that the paper prints, and which value of a result stands beside it.

    Attributes
    ----------
    variable : str
        Of the result.
    at : mapping
        Where: values of axes and of what the study holds fixed, or places along a dimension that has no values.
        Of theta, mu and F what is not named is the paper's operating point.
    value : float or str
        In the variable's units; the word of a variable with flags.
    section : str
        Of the paper: section, figure or table.
    over : mapping, optional
        Where the value stands that this one is divided by, of a claim about a ratio.
    """

    variable: str
    at: Mapping[str, float]
    value: float | str
    section: str
    over: Mapping[str, float] = field(default_factory=dict)


def beside(dataset: xr.Dataset, claims: Sequence[Claim]) -> list[Part]:
    """A table of the claims that a result of the paper's rig answers; nothing where it answers none."""
    if not paper.is_rig(dataset):
        return []
    rows = [row for claim in claims if (row := _row(dataset, claim))]
    heads = ["beside the paper", "at", "paper", "here", "difference", "section"]
    return ["", Table(heads, rows, words=2)] if rows else []


def _answer(dataset: xr.Dataset, variable: str, at: Mapping[str, float]) -> xr.DataArray | None:
    """The value of a variable at a place; None where the result does not hold it."""
    if variable not in dataset:
        return None
    given, answer = constants(dataset), dataset[variable]
    for name, value in (POINT | dict(at)).items():
        if name in answer.dims and name in dataset.coords:
            if dataset[name].dtype.kind in "iuf":
                value, is_there = nearest(dataset[name].values, float(value))
                if not is_there:
                    return None
            answer = answer.sel({name: value})
        elif name in answer.dims:
            if value >= dataset.sizes[name]:
                return None
            answer = answer.isel({name: int(value)})
        elif name in given and given[name] != value:
            return None
    return answer


def _row(dataset: xr.Dataset, claim: Claim) -> list[str] | None:
    answer = _answer(dataset, claim.variable, claim.at)
    if answer is None:
        return None
    name, units = str(answer.attrs["long_name"]), str(answer.attrs.get("units", "1"))
    where = _where(dataset, answer, claim.at)
    if isinstance(claim.value, str):
        here = word(answer)
        return [name, where, claim.value, here, "none" if here == claim.value else "differs", claim.section]
    shown, factor = READABLE.get(units, (units, 1.0))
    here_value = factor * float(answer)
    if claim.over:
        other = _answer(dataset, claim.variable, claim.over)
        if other is None:
            return None
        where += f" over {_where(dataset, other, claim.over)}"
        shown, factor, here_value = "", 1.0, float(answer) / float(other)
    value = factor * claim.value
    away = 100.0 * (here_value / value - 1.0) if value else np.nan
    difference = "-" if np.isnan(away) else f"{away:+.1f} %"
    here = "-" if np.isnan(here_value) else f"{here_value:.4g}"
    return [f"{name}{shown and f', {shown}'}", where, f"{value:.4g}", here, difference, claim.section]


def _where(dataset: xr.Dataset, answer: xr.DataArray, at: Mapping[str, float]) -> str:
    """The coordinates of a claim; places along a dimension without values are counted from 1."""
    named = [_named(answer, name, value) for name, value in at.items() if name in answer.coords]
    placed = [
        f"{name} {int(value) + 1}" for name, value in at.items() if name in set(dataset.dims) - set(dataset.coords)
    ]
    return ", ".join(named + placed)


def _named(answer: xr.DataArray, name: str, value: Any) -> str:
    """A coordinate of a claim, in the units of a reader."""
    if isinstance(value, str):
        return value.replace("_", " ")
    units, factor = READABLE.get(str(answer[name].attrs.get("units", "1")), ("", 1.0))
    return f"{name} = {factor * value:g} {units}".strip()
