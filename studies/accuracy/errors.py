"""Errors of every method and setting, from what is stored of each, with their scatter.

After the first burst motion is chaotic, so figures are compared over ensembles with those of the published scheme
on all modes, at the paper's own settings: the reference. The variance of a figure falls with the time it is taken
over; that time and the number of members may differ, so variances are pooled per unit of time, and the standard
error of a difference follows from both ensembles.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy import stats

from fivcore import Rig
from studies.accuracy.settings import DEFAULT, LINEAR, OPTIONS, PAPER, UNDAMPED, cutoff_of

Errors = dict[str, tuple[xr.DataArray, str]]

DIMS = ("method", "setting", "scene")
# Of fewer long sticks there is no distribution.
LEAST_STICKS = 20
# A figure is right if it is off by no more than its tolerance and so many standard errors.
ERRORS_ALLOWED = 2.0
# And the first slip, which is no chance, comes when it should, up to this share of its time.
FIRST_SLIP = 0.01
NO, YES, UNKNOWN = range(3)


class Figure(NamedTuple):
    """A figure that is compared: a variable of each member, or "mean_stick_time", of all sticks together."""

    name: str
    # Whether its error is over the reference's value.
    relative: bool
    # What the project asks of `fast` (`tests/ensembles.py`); NaN: nothing.
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
# Those that have a tolerance.
BOUNDED = [each for each in FIGURES if np.isfinite(each.tolerance)]
TOLERANCES = xr.DataArray([each.tolerance for each in FIGURES], dims="figure")


class Ensembles(NamedTuple):
    """Number, mean and variance of a figure's values, and the time each is taken over, by DIMS."""

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

    def at(self, place: Mapping[str, str]) -> Ensembles:
        """One method and setting, for comparison with all."""
        return Ensembles(*(part.sel(place, drop=True) for part in self))


def with_errors(dataset: xr.Dataset, *, rig: Rig) -> xr.Dataset:
    """Add the cut-off of each setting, and every error that the file can tell."""
    cutoffs = [cutoff_of(OPTIONS[name], rig) for name in dataset["setting"].values]
    attributes = {"units": "Hz", "long_name": "cut-off"}
    data = dataset.transpose(*DIMS, ...).assign_coords(cutoff=("setting", cutoffs, attributes))
    added = _stability(data) if LINEAR in data["method"] else {}
    reference, undamped = ({"method": PAPER, "setting": setting} for setting in (DEFAULT, UNDAMPED))
    others = _others(data, reference)
    if not others.all():
        time = Ensembles.of(data["observed_time"].where(data["observed_time"] > 0.0)).mean
        error, standard = _compared(data, time, reference)
        for figure, own, scatter in zip(FIGURES, error, standard, strict=True):
            how = "over the reference's" if figure.relative else "as a difference"
            added[f"{figure.name}_error"] = own, f"error of {figure.name}, {how}"
            added[f"{figure.name}_deviation"] = own / scatter, f"error of {figure.name} in standard errors"
        added |= _mismatches(error, standard, "", "")
        if not _others(data, undamped).all():
            pair = _compared(data, time, undamped)
            added |= _mismatches(*pair, "_undamped", ", against paper with beta2 = 0.5")
        more = _sticks(data, reference) | _spectra(data, time, reference) | _first_times(data, reference)
        added |= {name: (values.where(others), text) for name, (values, text) in more.items()}
        data["within"] = _within(error, standard, added["first_slip_error"][0])
    return data.assign(
        {name: part.assign_attrs(units="1", long_name=text) for name, (part, text) in added.items()}
    )


def _others(data: xr.Dataset, place: Mapping[str, str]) -> xr.DataArray:
    """Where something else than this method and setting is."""
    return (data["method"] != place["method"]) | (data["setting"] != place["setting"])


def _compared(
    data: xr.Dataset, time: xr.DataArray, reference: Mapping[str, str]
) -> tuple[xr.DataArray, xr.DataArray]:
    """Errors and their standard errors along "figure", as FIGURES are; the reference has none."""
    # Single sticks, as if they were independent; nothing where there is only a handful.
    sticks = Ensembles.of(data["stick_time"].astype(float), 1.0, "stick")
    sticks = sticks._replace(mean=sticks.mean.where(sticks.number >= LEAST_STICKS))
    pairs = []
    for figure in FIGURES:
        own = sticks if figure.name == "mean_stick_time" else Ensembles.of(data[figure.name], time)
        known = own.at(reference)
        pairs.append([part / known.mean if figure.relative else part for part in own.minus(known)])
    others = _others(data, reference)
    error, standard = (xr.concat(parts, "figure").where(others) for parts in zip(*pairs, strict=True))
    return error, standard


def _mismatches(error: xr.DataArray, standard: xr.DataArray, kind: str, text: str) -> Errors:
    """All errors in one number, in units of their tolerances."""
    shares, what = error / TOLERANCES, "errors in units of their tolerances"
    scatter = root_mean_square(standard / TOLERANCES, "figure")
    return {
        f"mismatch{kind}": (root_mean_square(shares, "figure"), f"{what}, root mean square{text}"),
        f"mismatch{kind}_scatter": (scatter, f"mismatch that scatter alone would make{text}"),
        f"worst_mismatch{kind}": (abs(shares).max("figure"), f"largest of the {what}{text}"),
    }


def _within(error: xr.DataArray, standard: xr.DataArray, first_slip: xr.DataArray) -> xr.DataArray:
    """YES where every figure that is known is within its tolerance and scatter, UNKNOWN where none is known."""
    wrong = (abs(error) > TOLERANCES + ERRORS_ALLOWED * standard.fillna(0.0)).any("figure")
    wrong |= abs(first_slip) > FIRST_SLIP
    right = xr.full_like(first_slip, YES, dtype=np.int8).where(~wrong, NO)
    text = f"whether the first slip and every figure are within tolerance, with {ERRORS_ALLOWED:g} standard errors"
    flags = {"flag_values": np.arange(3, dtype=np.int8), "flag_meanings": "no yes unknown"}
    within = right.where((error / TOLERANCES).notnull().any("figure"), UNKNOWN)
    within.attrs = {"long_name": text, **flags}
    return within


def root_mean_square(values: xr.DataArray, dim: str = "scene") -> xr.DataArray:
    """Root mean square of the finite values; NaN where there is none."""
    finite = values.where(np.isfinite(values))
    number = finite.count(dim)
    return ((finite**2).sum(dim) / number.where(number > 0)) ** 0.5


def _sticks(data: xr.Dataset, reference: Mapping[str, str]) -> Errors:
    """Two-sample distances of the long sticks from the reference's."""

    def distances(own: np.ndarray, known: np.ndarray) -> tuple[float, float, float]:
        own, known = (row[np.isfinite(row)].astype(float) for row in (own, known))
        if min(len(own), len(known)) < LEAST_STICKS:
            return np.nan, np.nan, np.nan
        test = stats.ks_2samp(own, known)
        return test.statistic, test.pvalue, stats.wasserstein_distance(own, known) / known.mean()

    pair, core = (data["stick_time"], data["stick_time"].sel(reference, drop=True)), [["member", "stick"]] * 2
    found = xr.apply_ufunc(distances, *pair, input_core_dims=core, output_core_dims=[[]] * 3, vectorize=True)
    texts = {
        "stick_time_ks": "largest difference of the distributions of long sticks (Kolmogorov, Smirnov)",
        "stick_time_ks_probability": "probability of at least this difference if both were of one distribution",
        "stick_time_wasserstein": "Wasserstein distance of the long sticks over their mean",
    }
    return {name: (values, text) for (name, text), values in zip(texts.items(), found, strict=True)}


def _spectra(data: xr.Dataset, time: xr.DataArray, reference: Mapping[str, str]) -> Errors:
    """Spectra in bands: what of the power lies elsewhere, and by how many standard errors a band is off."""
    bands = [Ensembles.of(data["band_power"].isel(band=k, drop=True), time) for k in range(data.sizes["band"])]
    pairs = [(own.at(reference).mean, *own.minus(own.at(reference))) for own in bands]
    power, error, standard = (xr.concat(each, "band") for each in zip(*pairs, strict=True))
    elsewhere = abs(error).sum("band", skipna=False) / power.sum("band", skipna=False)
    text = "difference of a band in standard errors, root mean square over bands"
    return {
        "spectrum_error": (elsewhere, "sum of the differences of third-octave bands over their sum"),
        "spectrum_deviation": (root_mean_square(error / standard, "band"), text),
    }


def _first_times(data: xr.Dataset, reference: Mapping[str, str]) -> Errors:
    """Errors of first slip and first separation, member by member, for these are no chance."""
    slip = data["first_slip_time"]
    delay = data["first_separation_time"] - slip
    error, late = (Ensembles.of(each / each.sel(reference, drop=True) - 1.0).mean for each in (slip, delay))
    return {
        "first_slip_error": (error, "error of the time of the first slip, over it"),
        "first_delay_error": (late, "error of the time from first slip to first separation, over it"),
    }


def _stability(data: xr.Dataset) -> Errors:
    """Errors of onset and growth: of a cut-off against all modes, of a mesh against the finest."""
    at = data.sel({"method": LINEAR}, drop=True)
    sizes = {name: OPTIONS[name].size or 0.0 for name in at["setting"].values.tolist()}
    finest = max(sizes, key=lambda name: sizes[name])
    # Cut-offs have no size of their own; the finest mesh is compared with nothing.
    known = [finest if size else DEFAULT for size in sizes.values()]
    found = {}
    for name, what in (("onset_mu", "onset"), ("growth_rate", "growth")):
        against = at[name].reindex(setting=known).assign_coords(setting=at["setting"])
        error = abs(at[name] / against - 1.0).where(at["setting"] != finest)
        found[f"{what}_error"] = error, f"error of the {what} of sliding's flutter, over it"
    return found
