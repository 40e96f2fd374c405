"""Errors of every method and setting, from what is stored of each, with their scatter.

After the first burst motion is chaotic, so figures are compared over ensembles with those of the published scheme
on all modes, at the paper's own settings: the reference. The variance of a figure falls with the time it is taken
over; that time and the number of members may differ, so variances are pooled per unit of time, and the standard
error of a difference follows from both ensembles.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
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
        both = (self, reference)
        freedom = sum((each.number - 1.0).clip(min=0.0) for each in both)
        spread = sum((each.number - 1.0).clip(min=0.0) * each.variance * each.time for each in both)
        per_time = spread / freedom.where(freedom > 0.0)
        shares = sum(1.0 / (each.number * each.time).where(each.number > 0.0) for each in both)
        return self.mean - reference.mean, np.sqrt(per_time * shares)

    def at(self, place: Mapping[Hashable, str]) -> Ensembles:
        """One method and setting, for comparison with all."""
        return Ensembles(*(part.sel(place, drop=True) for part in self))


def with_errors(dataset: xr.Dataset, *, rig: Rig) -> xr.Dataset:
    """Add the cut-off of each setting, and every error that the file can tell."""
    cutoffs = [cutoff_of(OPTIONS[name], rig) for name in dataset["setting"].values]
    told = {"units": "Hz", "long_name": "cut-off"}
    data = dataset.transpose(*DIMS, ...).assign_coords(cutoff=("setting", cutoffs, told))
    reference, undamped = ({"method": PAPER, "setting": setting} for setting in (DEFAULT, UNDAMPED))
    found = _stability(data) if LINEAR in data["method"] else {}
    if _others(data, reference).all():
        return _assigned(data, found)
    observed = data["observed_time"]
    time = Ensembles.of(observed.where(observed > 0.0)).mean
    compared = _compared(data, time, reference)
    for figure, (error, standard) in zip(FIGURES, compared, strict=True):
        how = "over the reference's" if figure.relative else "as a difference"
        found[f"{figure.name}_error"] = error, f"error of {figure.name}, {how}"
        found[f"{figure.name}_deviation"] = error / standard, f"error of {figure.name} in standard errors"
    found |= _mismatches(compared, "", "")
    if not _others(data, undamped).all():
        found |= _mismatches(_compared(data, time, undamped), "_undamped", ", against paper with beta2 = 0.5")
    others = _others(data, reference)
    more = _sticks(data, reference) | _spectra(data, time, reference) | _first_times(data, reference)
    found |= {name: (values.where(others), text) for name, (values, text) in more.items()}
    flags = {
        "long_name": f"whether the first slip and every figure are within tolerance, with {ERRORS_ALLOWED:g} "
        "standard errors",
        "flag_values": np.arange(3, dtype=np.int8),
        "flag_meanings": "no yes unknown",
    }
    return _assigned(data, found).assign(
        within=_within(compared, found["first_slip_error"][0]).assign_attrs(flags)
    )


def _assigned(data: xr.Dataset, found: Errors) -> xr.Dataset:
    return data.assign(
        {name: each.assign_attrs(units="1", long_name=text) for name, (each, text) in found.items()}
    )


def _others(data: xr.Dataset, place: Mapping[Hashable, str]) -> xr.DataArray:
    """Where something else than this method and setting is."""
    return (data["method"] != place["method"]) | (data["setting"] != place["setting"])


def _compared(
    data: xr.Dataset, time: xr.DataArray, reference: Mapping[Hashable, str]
) -> list[tuple[xr.DataArray, xr.DataArray]]:
    """Of each of FIGURES the error and its standard error; the reference has none."""
    # Single sticks, as if they were independent; nothing where there is only a handful.
    sticks = Ensembles.of(data["stick_time"].astype(float), 1.0, "stick")
    sticks = sticks._replace(mean=sticks.mean.where(sticks.number >= LEAST_STICKS))
    found = []
    for figure in FIGURES:
        own = sticks if figure.name == "mean_stick_time" else Ensembles.of(data[figure.name], time)
        known = own.at(reference)
        pair = (part / known.mean if figure.relative else part for part in own.minus(known))
        error, standard = (part.where(_others(data, reference)) for part in pair)
        found.append((error, standard))
    return found


def _mismatches(compared: Sequence[tuple[xr.DataArray, xr.DataArray]], kind: str, text: str) -> Errors:
    """All errors in one number, in units of their tolerances."""
    shares, scatters = (
        xr.concat(
            [pair[k] / each.tolerance for each, pair in zip(FIGURES, compared, strict=True) if each in BOUNDED],
            "of",
        )
        for k in (0, 1)
    )
    what = "errors in units of their tolerances"
    return {
        f"mismatch{kind}": (root_mean_square(shares, "of"), f"{what}, root mean square{text}"),
        f"mismatch{kind}_scatter": (
            root_mean_square(scatters, "of"), f"mismatch that scatter alone would make{text}"
        ),
        f"worst_mismatch{kind}": (abs(shares).max("of"), f"largest of the {what}{text}"),
    }  # fmt: skip


def root_mean_square(values: xr.DataArray, dim: str = "scene") -> xr.DataArray:
    """Root mean square of the finite values; NaN where there is none."""
    finite = values.where(np.isfinite(values))
    number = finite.count(dim)
    return np.sqrt((finite**2).sum(dim) / number.where(number > 0))


def _within(compared: Sequence[tuple[xr.DataArray, xr.DataArray]], first_slip: xr.DataArray) -> xr.DataArray:
    """YES where every figure that is known is within its tolerance and scatter, UNKNOWN where none is known."""
    known, right = xr.zeros_like(first_slip, dtype=bool), ~(abs(first_slip) > FIRST_SLIP)
    for figure, (error, standard) in zip(FIGURES, compared, strict=True):
        if figure in BOUNDED:
            known |= error.notnull()
            right &= ~(abs(error) > figure.tolerance + ERRORS_ALLOWED * standard.fillna(0.0))
    return xr.where(known, xr.where(right, YES, NO), UNKNOWN).astype(np.int8)


def _sticks(data: xr.Dataset, reference: Mapping[Hashable, str]) -> Errors:
    """Two-sample distances of the long sticks from the reference's."""

    def distances(own: np.ndarray, known: np.ndarray) -> tuple[float, float, float]:
        own, known = (row[np.isfinite(row)].astype(float) for row in (own, known))
        if min(len(own), len(known)) < LEAST_STICKS:
            return np.nan, np.nan, np.nan
        test = stats.ks_2samp(own, known)
        return test.statistic, test.pvalue, stats.wasserstein_distance(own, known) / known.mean()

    every, core = data["stick_time"], [["member", "stick"]] * 2
    pair = (every, every.sel(reference, drop=True))
    found = xr.apply_ufunc(distances, *pair, input_core_dims=core, output_core_dims=[[]] * 3, vectorize=True)
    texts = {
        "stick_time_ks": "largest difference of the distributions of long sticks (Kolmogorov, Smirnov)",
        "stick_time_ks_probability": "probability of at least this difference if both were of one distribution",
        "stick_time_wasserstein": "Wasserstein distance of the long sticks over their mean",
    }
    return {name: (values, text) for (name, text), values in zip(texts.items(), found, strict=True)}


def _spectra(data: xr.Dataset, time: xr.DataArray, reference: Mapping[Hashable, str]) -> Errors:
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


def _first_times(data: xr.Dataset, reference: Mapping[Hashable, str]) -> Errors:
    """Errors of first slip and first separation, member by member, for these are no chance."""
    slip = data["first_slip_time"]
    times = {
        "first_slip_error": (slip, "error of the time of the first slip, over it"),
        "first_delay_error": (
            data["first_separation_time"] - slip, "error of the time from first slip to first separation, over it"
        ),
    }  # fmt: skip
    return {
        name: (Ensembles.of(each / each.sel(reference, drop=True) - 1.0).mean, text)
        for name, (each, text) in times.items()
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
