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
        Where: values of axes and of what the study holds fixed, or places along a dimension that has no values; a
        pair means all values of an axis between its ends, both excluded. Of theta, mu and F what is not named is
        the paper's operating point.
    value : float or str
        In the variable's units; the word of a variable with flags.
    section : str
        Of the paper: section, figure or table.
    """

    variable: str
    at: Mapping[str, float | str | tuple[float, float]]
    value: float | str
    section: str


def beside(dataset: xr.Dataset, claims: Sequence[Claim], cells: bool = False) -> list[Part]:
    """A table of the claims that a result of the paper's rig answers; nothing where it answers none.

    With `cells` a value of an axis stands for all about it: the nearest one within the axis's range answers.
    """
    if not paper.is_rig(dataset):
        return []
    rows = [_row(claim, point) for claim in claims if (point := answer(dataset, claim, cells)) is not None]
    heads = ["beside the paper", "at", "paper", "here", "difference", "section"]
    return ["", Table(heads, rows, words=2)] if rows else []


def answer(dataset: xr.Dataset, claim: Claim, cells: bool = False) -> xr.DataArray | None:
    """The value that a claim speaks of, or all of its values; None where the result does not hold it."""
    if claim.variable not in dataset:
        return None
    fixed, answer = constants(dataset), dataset[claim.variable]
    for name, value in (POINT | dict(claim.at)).items():
        if isinstance(value, tuple):
            if name not in answer.dims:
                return None
            answer = answer.isel({name: (answer[name].values > value[0]) & (answer[name].values < value[1])})
            if not answer.size:
                return None
        elif name in answer.dims and name in dataset.coords:
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
        elif name in fixed and fixed[name] != value:
            return None
    return answer


def _row(claim: Claim, answer: xr.DataArray) -> list[str]:
    # Of what the claim does not name only what is not the paper's.
    others = [
        name for name in POINT if name in answer.coords and name not in claim.at and answer[name] != POINT[name]
    ]
    where = ", ".join(
        _named(answer, name, claim.at.get(name, 0.0)) for name in (*claim.at, *others) if name in answer.coords
    )
    # As `fiv query` knows it, and shorter than its long name.
    name = claim.variable
    if isinstance(claim.value, str):
        values = [answer[k] for k in range(len(answer))] if answer.ndim else [answer]
        here = ", ".join(sorted({word(value) for value in values}))
        difference = "-" if here == "-" else "none" if here == claim.value else "differs"
        return [name, where, claim.value, here, difference, claim.section]
    units = str(answer.attrs.get("units", "1"))
    shown, factor = READABLE.get(units, (units, 1.0))
    value, low, high = (factor * float(each) for each in (claim.value, answer.min(), answer.max()))
    here = "-" if np.isnan(low) else " to ".join(dict.fromkeys(f"{end:.4g}" for end in (low, high)))
    difference = f"{100.0 * (low / value - 1.0):+.1f} %" if value and low == high else "differs"
    if np.isnan(low) or low == high == value:
        difference = "-" if np.isnan(low) else "none"
    return [f"{name}{shown and f', {shown}'}", where, f"{value:.4g}", here, difference, claim.section]


def _named(answer: xr.DataArray, name: str, value: Any) -> str:
    """A coordinate of the answer, or the range that a claim speaks of, in the units of a reader."""
    if isinstance(value, str):
        return value.replace("_", " ")
    units = str(answer[name].attrs.get("units", "1"))
    shown, factor = READABLE.get(units, (units, 1.0))
    if isinstance(value, tuple):
        ends = [f"{sign} {factor * end:g}" for sign, end in zip("><", value, strict=True) if np.isfinite(end)]
        return f"{name} {' and '.join(ends)} {shown}".strip()
    return f"{name} = {factor * float(answer[name]):.4g} {shown}".strip()
