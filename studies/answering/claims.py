"""Claims of the paper as data, and the table that compares them with a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from studies import paper
from studies.answering.results import settings, structure_in
from studies.declaring import labels
from studies.declaring.parameters import RIG
from studies.declaring.spec import nearest
from studies.motion import regimes
from studies.study import Claim

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

# The damping that Table 3 prints, and the one with which most of the paper's statements on motion hold: what study
# `damping` identifies by the rule of `identified` there.
PRINTED = {name: RIG[name].default for name in ("d1", "d2")}
IDENTIFIED = {"d1": 50.0, "d2": 1.585e-7}
# Words of the paper, with the rule by which they are compared, and the regimes that agree.
MEANT = {"periodic": ("periodic, that is vibration without long sticks", regimes.WITHOUT_STICKS)}
# The operating point of a claim, where it does not say otherwise.
POINT = {"theta": paper.THETA, "mu": paper.MU, "F": paper.LOAD}


def is_papers_rig(dataset: xr.Dataset) -> bool:
    """Whether a result is of the paper's rig, with the printed damping or the identified one."""
    values = settings(dataset)
    rig = {name: parameter.default for name, parameter in RIG.items()}
    return any(
        all(values.get(name) == value for name, value in (rig | each).items()) for each in (PRINTED, IDENTIFIED)
    )


def is_papers_point(dataset: xr.Dataset, **point: float) -> bool:
    """Whether a result is of the paper's rig with these fixed parameters."""
    values = settings(dataset)
    return is_papers_rig(dataset) and all(values.get(name) == value for name, value in point.items())


def rig_text(dataset: xr.Dataset) -> str:
    """The part of a title that names another rig than the paper's."""
    values, own = settings(dataset), "an own structure" if structure_in(dataset) else "not the paper's rig"
    other = [name for name, parameter in RIG.items() if values.get(name) != parameter.default]
    if len(other) == 1 and other[0] in values:
        own = labels.named(other[0], values[other[0]], RIG[other[0]].units)
    return f" ({own})" if other else ""


def beside(dataset: xr.Dataset, claims: Sequence[Claim]) -> pd.DataFrame:
    """The claims that a result of the paper's rig answers: quantity, at, paper, computed, deviation, section."""
    import pandas as pd

    rows = []
    if is_papers_rig(dataset):
        answers = ((claim, answer(dataset, claim)) for claim in claims)
        rows = [_row(claim, found, _interval(dataset, claim)) for claim, found in answers if found is not None]
    return pd.DataFrame(rows, columns=["quantity", "at", "paper", "computed", "deviation", "section"])


def answer(dataset: xr.Dataset, claim: Claim) -> xr.DataArray | None:
    """The value or the values to which a claim refers; None if the result lacks them."""
    fixed, found = settings(dataset), dataset.get(claim.variable)
    for name, value in (POINT | dict(claim.at)).items():
        if found is None or not found.size or (isinstance(value, tuple) and name not in found.dims):
            return None
        if isinstance(value, tuple):
            found = found.isel({name: (found[name].values > value[0]) & (found[name].values < value[1])})
        elif name in found.dims and name in dataset.coords:
            values = dataset[name].values
            if values.dtype.kind in "iuf":
                near, matches = nearest(values, float(value))
                value = near if matches or (claim.cells and values.min() <= value <= values.max()) else np.nan
            if value not in values:
                return None
            found = found.sel({name: value})
        elif name in found.dims:
            if int(value) > dataset.sizes[name]:
                return None
            found = found.isel({name: int(value) - 1}).assign_coords({name: int(value)})
        elif name in fixed and fixed[name] != value:
            return None
    return found if found is not None and found.size else None


def _interval(dataset: xr.Dataset, claim: Claim) -> str:
    """The interval of a claim's answer, if the result has one."""
    ends = [answer(dataset, replace(claim, variable=f"{claim.variable}_{end}")) for end in ("low", "high")]
    known = [labels.readable(end).item() for end in ends if end is not None and end.size == 1]
    texts = [labels.number(end) for end in known]
    return f" ({' to '.join(texts)})" if len(texts) == 2 and "-" not in texts else ""


def _row(claim: Claim, found: xr.DataArray, interval: str) -> tuple[Any, ...]:
    # Parameters that the claim leaves out are listed only where they differ from the paper's.
    left_out = [name for name in POINT if name in found.coords and name not in claim.at]
    others = [name for name in left_out if found[name] != POINT[name]]
    place = ", ".join(_place(found, name, claim.at.get(name, 0.0)) for name in (*claim.at, *others))
    unit, factor = labels.unit_of(found)
    quantity = f"{claim.variable.replace('_', ' ')} {unit}".strip()
    if isinstance(claim.value, str):
        words = {*labels.words(found).ravel()}
        text, meant = MEANT.get(claim.value, (claim.value, (claim.value,)))
        deviation = "-" if words == {"-"} else "none" if words <= {*meant} else "differs"
        return quantity, place, text, ", ".join(sorted(words)), deviation, claim.section
    value, low, high = (factor * float(each) for each in (claim.value, found.min(), found.max()))
    computed = " to ".join(dict.fromkeys(map(labels.number, (low, high))))
    deviation = f"{100.0 * (low / value - 1.0):+.1f} %" if value and low == high else "differs"
    if np.isnan(low + value) or low == high == value:
        deviation = "-" if np.isnan(low + value) else "none"
    return quantity, place, labels.number(value), computed + interval, deviation, claim.section


def _place(found: xr.DataArray, name: str, value: Any) -> str:
    """The coordinate of the answer, or the range to which a claim refers."""
    if isinstance(value, str):
        return value.replace("_", " ")
    if isinstance(value, tuple):
        unit, factor = labels.unit_of(found[name])
        ends = [f"{sign} {factor * end:g}" for sign, end in zip("><", value, strict=True) if np.isfinite(end)]
        return f"{labels.title(name)} {' and '.join(ends)} {unit}".strip()
    return labels.named(name, found[name]) if name in found.coords else f"{labels.title(name)} {value:g}"
