"""Claims of the paper as data, and the one table that shows them beside a result: paper, here, difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
    """

    variable: str
    at: Mapping[str, float | str]
    value: float | str
    section: str


def beside(dataset: xr.Dataset, claims: Sequence[Claim], cells: bool = False) -> list[Part]:
    """A table of the claims that a result of the paper's rig answers; nothing where it answers none.

    With `cells` a value of an axis stands for all about it: the nearest one within the axis's range answers.
    """
    if not paper.is_rig(dataset):
        return []
    rows = [_row(claim, point) for claim in claims if (point := _answer(dataset, claim, cells)) is not None]
    heads = ["beside the paper", "at", "paper", "here", "difference", "section"]
    return ["", Table(heads, rows, words=2)] if rows else []


def _answer(dataset: xr.Dataset, claim: Claim, cells: bool) -> xr.DataArray | None:
    """The value that a claim speaks of; None where the result does not hold it."""
    if claim.variable not in dataset:
        return None
    given, answer = constants(dataset), dataset[claim.variable]
    for name, value in (POINT | dict(claim.at)).items():
        if name in answer.dims and name in dataset.coords:
            if dataset[name].dtype.kind in "iuf":
                values = dataset[name].values
                near, is_there = nearest(values, float(value))
                if not (is_there or (cells and values.min() <= value <= values.max())):
                    return None
                value = near
            answer = answer.sel({name: value})
        elif name in answer.dims:
            if int(value) >= dataset.sizes[name]:
                return None
            # Counted from 1 where it is named.
            answer = answer.isel({name: int(value)}).assign_coords({name: int(value) + 1})
        elif name in given and given[name] != value:
            return None
    return answer


def _row(claim: Claim, answer: xr.DataArray) -> list[str]:
    # Of what the claim does not name only what is not the paper's.
    names = [
        *claim.at,
        *(name for name, value in POINT.items() if name in answer.coords and answer[name] != value),
    ]
    where = ", ".join(_named(answer, name) for name in dict.fromkeys(names) if name in answer.coords)
    name = str(answer.attrs["long_name"])
    if isinstance(claim.value, str):
        here = word(answer)
        return [name, where, claim.value, here, "none" if here == claim.value else "differs", claim.section]
    units = str(answer.attrs.get("units", "1"))
    shown, factor = READABLE.get(units, (units, 1.0))
    value, here_value = factor * claim.value, factor * float(answer)
    away = 100.0 * (here_value / value - 1.0) if value else np.nan
    difference = "-" if np.isnan(away) else f"{away:+.1f} %"
    here = "-" if np.isnan(here_value) else f"{here_value:.4g}"
    return [f"{name}{shown and f', {shown}'}", where, f"{value:.4g}", here, difference, claim.section]


def _named(answer: xr.DataArray, name: str) -> str:
    """A coordinate of the answer, in the units of a reader."""
    value: Any = answer[name].item()
    if isinstance(value, str):
        return value.replace("_", " ")
    units = str(answer[name].attrs.get("units", "1"))
    shown, factor = READABLE.get(units, (units, 1.0))
    return f"{name} = {factor * value:.4g} {shown}".strip()
