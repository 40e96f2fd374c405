"""Errors of every method and setting, from what is stored of each, with their scatter.

After the first burst motion is chaotic, so figures are compared over ensembles with those of the published scheme
on all modes, at the paper's own settings: the reference. The variance of a figure falls with the time it is taken
over; that time and the number of members may differ, so variances are pooled per unit of time, and the standard
error of a difference follows from both ensembles.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from fivcore import Rig
from studies.accuracy.settings import DEFAULT, LINEAR, OPTIONS, PAPER, UNDAMPED, cutoff_of
from studies.motion import transients

# Of fewer long sticks there is no mean.
LEAST_STICKS = 20
# A figure is right if it is off by no more than its tolerance and so many standard errors.
ERRORS_ALLOWED = 2.0
# And the first slip, which is no chance, comes when it should, up to this share of its time.
FIRST_SLIP = 0.01
WITHIN = ("no", "yes", "unknown")
REFERENCE = {"method": PAPER, "setting": DEFAULT}


class Figure(NamedTuple):
    """A figure that is compared: a variable of each member, or "mean_stick_time", of all sticks together."""

    name: str
    # Whether its error is over the reference's value.
    relative: bool
    # What the project asks of `fast` (`tests/benchmarks/ensembles.py`); NaN: nothing.
    tolerance: float
    long_name: str


FIGURES = (
    Figure("stick_fraction", False, 0.02, "stick"),
    Figure("slip_fraction", False, 0.02, "slip"),
    Figure("separation_fraction", False, 0.02, "separation"),
    Figure("dominant_frequency", True, 0.015, "main line"),
    Figure("velocity_rms", True, 0.10, "RMS of v_B"),
    Figure("mean_stick_time", True, 0.10, "mean stick"),
    Figure("normal_force_999", True, np.nan, "99.9 % of N"),
    Figure("slip_speed_999", True, np.nan, "99.9 % of slip"),
)
TOLERANCES = xr.DataArray([each.tolerance for each in FIGURES], dims="figure")


class Ensembles(NamedTuple):
    """Number, mean and variance of a figure's values, and the time each is taken over, at each point."""

    number: xr.DataArray
    mean: xr.DataArray
    variance: xr.DataArray
    time: xr.DataArray

    @classmethod
    def of(cls, values: xr.DataArray, time: xr.DataArray | float = 1.0, *also: str) -> Ensembles:
        """Of values along "member" and `also`; NaN where there is none."""
        dims = ("member", *also)
        number = values.count(dims).astype(float)
        mean = values.sum(dims) / number.where(number > 0.0)
        squares = ((values - mean) ** 2).sum(dims)
        variance = (squares / (number - 1.0).where(number > 1.0)).fillna(0.0)
        return cls(number, mean, variance, xr.zeros_like(mean) + time)

    def minus(self, reference: Ensembles) -> tuple[xr.DataArray, xr.DataArray]:
        """Difference of the means and its standard error; NaN where either has no value or nothing tells."""
        one, other = ((each.number - 1.0).clip(min=0.0) for each in (self, reference))
        spread = one * self.variance * self.time + other * reference.variance * reference.time
        per_time = spread / (one + other).where(one + other > 0.0)
        one, other = (1.0 / (each.number * each.time).where(each.number > 0.0) for each in (self, reference))
        return self.mean - reference.mean, (per_time * (one + other)) ** 0.5


def with_errors(dataset: xr.Dataset, *, rig: Rig, **_: Any) -> xr.Dataset:
    """Add the cut-off of each setting, and every error; what is not in the file has none."""
    cutoffs = [cutoff_of(OPTIONS[name], rig) for name in dataset["setting"].values]
    data = dataset.assign_coords(
        cutoff=("setting", cutoffs, {"units": "Hz", "long_name": "cut-off"}),
        figure=("figure", [each.name for each in FIGURES], {"long_name": "figure that is compared"}),
    )
    error, standard = _compared(data, REFERENCE)
    every = (error, standard, _compared(data, {"method": PAPER, "setting": UNDAMPED})[0])
    mismatch, scatter, undamped = (root_mean_square(each / TOLERANCES, "figure") for each in every)
    slip = data["first_slip_time"]
    late = Ensembles.of(slip / _at(slip, **REFERENCE) - 1.0).mean.where(_others(data, REFERENCE))
    added = {
        "figure_error": (error, "error of each figure; but of shares of time, over the reference's"),
        "figure_standard_error": (standard, "standard error of each figure's error"),
        "mismatch": (mismatch, "errors in units of tolerances, root mean square"),
        "mismatch_scatter": (scatter, "mismatch by scatter alone"),
        "mismatch_undamped": (undamped, "mismatch with paper, beta2 = 0.5"),
        "first_slip_error": (late, "error of the time of the first slip, over it"),
        "within": (_within(error, standard, late), "whether first slip and figures are within tolerance"),
        "onset_error": (_onset_error(data["onset_mu"]), "error of the onset of sliding's flutter, over it"),
    }
    named = {name: part.assign_attrs(units="1", long_name=text) for name, (part, text) in added.items()}
    return transients.with_flags(data.assign(named), within=WITHIN)


def _at(values: xr.DataArray, **place: str) -> xr.DataArray:
    """Values at one place; NaN where it is not there."""
    whole = values.reindex({dim: [name] for dim, name in place.items()})
    return whole.isel(dict.fromkeys(place, 0), drop=True)


def _others(data: xr.Dataset, place: Mapping[str, str]) -> xr.DataArray:
    """Where something else than this method and setting is."""
    return (data["method"] != place["method"]) | (data["setting"] != place["setting"])


def _compared(data: xr.Dataset, place: Mapping[str, str]) -> tuple[xr.DataArray, xr.DataArray]:
    """Errors and their standard errors along "figure"; what they are compared with has none."""
    time = Ensembles.of(data["observed_time"].where(data["observed_time"] > 0.0)).mean
    # Single sticks, as if they were independent; nothing where there is only a handful.
    sticks = Ensembles.of(data["stick_time"].astype(float), 1.0, "stick")
    sticks = sticks._replace(mean=sticks.mean.where(sticks.number >= LEAST_STICKS))
    pairs = []
    for figure in FIGURES:
        own = sticks if figure.name == "mean_stick_time" else Ensembles.of(data[figure.name], time)
        known = Ensembles(*(_at(part, **place) for part in own))
        pairs.append([part / known.mean if figure.relative else part for part in own.minus(known)])
    error, standard = (
        xr.concat(parts, "figure").where(_others(data, place)) for parts in zip(*pairs, strict=True)
    )
    return error.transpose(..., "figure"), standard.transpose(..., "figure")


def _within(error: xr.DataArray, standard: xr.DataArray, first_slip: xr.DataArray) -> xr.DataArray:
    """Whether every figure that is known is within its tolerance and scatter; unknown where none is."""
    wrong = (abs(error) > TOLERANCES + ERRORS_ALLOWED * standard.fillna(0.0)).any("figure")
    wrong |= abs(first_slip) > FIRST_SLIP
    codes = xr.full_like(first_slip, WITHIN.index("yes"), dtype=np.int8).where(~wrong, WITHIN.index("no"))
    return codes.where((error / TOLERANCES).notnull().any("figure"), WITHIN.index("unknown"))


def root_mean_square(values: xr.DataArray, dim: str = "scene") -> xr.DataArray:
    """Root mean square of what is known; NaN where nothing is."""
    return (values**2).mean(dim) ** 0.5


def _onset_error(onset: xr.DataArray) -> xr.DataArray:
    """Error of a cut-off against all modes, of a mesh against the finest."""
    at = _at(onset, method=LINEAR)
    sizes = {name: OPTIONS[name].size or 0.0 for name in at["setting"].values.tolist()}
    finest = max(sizes, key=lambda name: sizes[name])
    # Cut-offs have no size of their own; the finest mesh is compared with nothing.
    known = at.reindex(setting=[finest if size else DEFAULT for size in sizes.values()])
    return abs(at / known.assign_coords(setting=at["setting"]) - 1.0).where(at["setting"] != finest)
