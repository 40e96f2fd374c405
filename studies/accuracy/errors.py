"""Errors of every method and setting, from what is stored of each, with their scatter.

After the first burst motion is chaotic, so figures are compared over ensembles with those of the published scheme
on all modes, at the paper's own settings: the reference. The variance of a figure falls with the time it is taken
over; that time and the number of members may differ, so variances are pooled per unit of time, and the standard
error of a difference follows from both ensembles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats

from fivcore import Rig
from studies.accuracy import settings as asked

Array = NDArray[np.float64]
DIMS = ("method", "setting", "scene")
# Of fewer long sticks there is no distribution.
LEAST_STICKS = 20
# A figure is right if it is off by no more than its tolerance and so many standard errors.
ERRORS_ALLOWED = 2.0
# And the first slip, which is no chance, comes when it should, up to this share of its time.
FIRST_SLIP = 0.01
NO, YES, UNKNOWN = range(3)


@dataclass(frozen=True)
class Figure:
    """A figure that is compared.

    Attributes
    ----------
    name : str
        A variable of each member, or "mean_stick_time", of all sticks together.
    relative : bool
        Whether its error is over the reference's value.
    tolerance : float
        What the project asks of `fast` (`tests/ensembles.py`); NaN: nothing.
    long_name : str
    """

    name: str
    relative: bool
    tolerance: float
    long_name: str

    @property
    def asked(self) -> bool:
        """Whether it has a tolerance."""
        return bool(np.isfinite(self.tolerance))


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


@dataclass(frozen=True, eq=False)
class Ensembles:
    """Count, mean and variance of a figure, and the time each value is taken over, (method, setting, scene)."""

    count: Array
    mean: Array
    variance: Array
    time: Array

    @classmethod
    def of(cls, values: Array, time: Array | float) -> Ensembles:
        """Of values with members along the last axis; NaN where there is none."""
        known = np.isfinite(values)
        count = known.sum(axis=-1)
        some, several = np.maximum(count, 1), np.maximum(count - 1, 1)
        mean = np.where(count, np.where(known, values, 0.0).sum(axis=-1) / some, np.nan)
        squares = np.where(known, (values - mean[..., None]) ** 2, 0.0).sum(axis=-1)
        variance = np.where(count > 1, squares / several, 0.0)
        return cls(count, mean, variance, np.broadcast_to(np.asarray(time, dtype=float), mean.shape))

    def beside(self, reference: Ensembles) -> tuple[Array, Array]:
        """Difference of the means and its standard error; NaN where either has no value or nothing tells."""
        parts = (self, reference)
        freedom = sum(np.maximum(each.count - 1.0, 0.0) for each in parts)
        spread = sum(np.maximum(each.count - 1.0, 0.0) * each.variance * each.time for each in parts)
        with np.errstate(divide="ignore", invalid="ignore"):
            per_time = np.where(freedom > 0.0, spread / np.maximum(freedom, 1.0), np.nan)
            error = np.sqrt(per_time * sum(1.0 / (each.count * each.time) for each in parts))
        return self.mean - reference.mean, np.where(np.isfinite(error), error, np.nan)

    def at(self, place: tuple[int, int]) -> Ensembles:
        """One method and setting, to be held against all."""
        return Ensembles(*(part[place][None, None] for part in (self.count, self.mean, self.variance, self.time)))


def with_errors(dataset: xr.Dataset, *, rig: Rig) -> xr.Dataset:
    """Add what methods, settings and scenes are called, and every error that the file can tell."""
    found = dataset.assign_coords(
        method_name=("method", [asked.METHODS[int(k)] for k in dataset["method"].values], _named("method")),
        setting_name=(
            "setting",
            [asked.OPTIONS[int(k)].label(rig) for k in dataset["setting"].values],
            _named("setting"),
        ),
        scene_name=("scene", [asked.SCENES[int(k)][0] for k in dataset["scene"].values], _named("scene")),
    )
    found = _with_stability(found)
    reference = _reference(found)
    return found if reference is None else _with_statistics(found.transpose(*DIMS, ...), reference)


def _named(what: str) -> dict[str, str]:
    return {"long_name": f"name of the {what}"}


def place(dataset: xr.Dataset, method: int, setting: int) -> tuple[int, int] | None:
    """Where a method with a setting stands in the file."""
    rows, columns = (
        np.flatnonzero(dataset[name].values == k) for name, k in (("method", method), ("setting", setting))
    )
    return (int(rows[0]), int(columns[0])) if len(rows) and len(columns) else None


def _reference(dataset: xr.Dataset) -> tuple[int, int] | None:
    return place(dataset, asked.PAPER, asked.DEFAULT)


def _with_statistics(dataset: xr.Dataset, reference: tuple[int, int]) -> xr.Dataset:
    """Errors of every figure, of the distribution of sticks, and of the spectrum."""
    observed = dataset["observed_time"].values
    time = Ensembles.of(np.where(observed > 0.0, observed, np.nan), 1.0).mean
    itself = np.zeros(time.shape, dtype=bool)
    itself[reference] = True
    compared = _compared(dataset, time, reference)
    added: dict[str, tuple[Array, str]] = {}
    for figure, (error, standard) in zip(FIGURES, compared, strict=True):
        how = "over the reference's" if figure.relative else "as a difference"
        added[f"{figure.name}_error"] = (error, f"error of {figure.name}, {how}")
        with np.errstate(divide="ignore", invalid="ignore"):
            added[f"{figure.name}_deviation"] = (error / standard, f"error of {figure.name} in standard errors")
    added |= _mismatches(compared, "", "")
    undamped = place(dataset, asked.PAPER, asked.UNDAMPED)
    if undamped is not None:
        added |= _mismatches(_compared(dataset, time, undamped), "_undamped", ", against paper with beta2 = 0.5")
    added |= _stick_distances(dataset, reference, itself) | _spectra(dataset, reference, itself, time)
    added |= _first_times(dataset, reference, itself)
    within = _within(compared, added["first_slip_error"][0])
    found = dataset.assign({
        name: (DIMS, values, {"units": "1", "long_name": text}) for name, (values, text) in added.items()
    })  # fmt: skip
    flags = {
        "long_name": f"whether the first slip and every figure are within tolerance, with {ERRORS_ALLOWED:g} "
        "standard errors",
        "flag_values": np.arange(3, dtype=np.int8),
        "flag_meanings": "no yes unknown",
    }
    return found.assign(within=(DIMS, within.astype(np.int8), flags))


def _compared(dataset: xr.Dataset, time: Array, reference: tuple[int, int]) -> list[tuple[Array, Array]]:
    """Of each of FIGURES the error and its standard error, (method, setting, scene); the reference has none."""
    found = []
    for figure in FIGURES:
        by_stick = figure.name == "mean_stick_time"
        own = _sticks(dataset) if by_stick else Ensembles.of(dataset[figure.name].values, time)
        known = own.at(reference)
        error, standard = (part / known.mean if figure.relative else part for part in own.beside(known))
        error[reference] = standard[reference] = np.nan
        found.append((error, standard))
    return found


def _mismatches(compared: list[tuple[Array, Array]], kind: str, text: str) -> dict[str, tuple[Array, str]]:
    """All errors in one number, in units of their tolerances."""
    shares, scatters = (
        [pair[k] / each.tolerance for each, pair in zip(FIGURES, compared, strict=True) if each.asked]
        for k in (0, 1)
    )
    what = "errors in units of their tolerances"
    return {
        f"mismatch{kind}": (_root_mean_square(shares), f"{what}, root mean square{text}"),
        f"mismatch{kind}_scatter": (_root_mean_square(scatters), f"mismatch that scatter alone would make{text}"),
        f"worst_mismatch{kind}": (_largest(np.abs(shares)), f"largest of the {what}{text}"),
    }


def _within(compared: list[tuple[Array, Array]], first_slip: Array) -> Array:
    """YES where every figure that is known is within its tolerance and scatter, UNKNOWN where none is known."""
    known, right = np.zeros(first_slip.shape, dtype=bool), ~(np.abs(first_slip) > FIRST_SLIP)
    for figure, (error, standard) in zip(FIGURES, compared, strict=True):
        if figure.asked:
            known |= np.isfinite(error)
            right &= ~(np.abs(error) > figure.tolerance + ERRORS_ALLOWED * np.nan_to_num(standard))
    return np.where(known, np.where(right, YES, NO), UNKNOWN)


def _root_mean_square(parts: list[Array]) -> Array:
    known = np.isfinite(parts)
    count = known.sum(axis=0)
    total = np.where(known, np.square(parts), 0.0).sum(axis=0)
    return np.where(count, np.sqrt(total / np.maximum(count, 1)), np.nan)


def _largest(parts: Array) -> Array:
    largest = np.where(np.isfinite(parts), parts, -np.inf).max(axis=0)
    return np.where(np.isfinite(largest), largest, np.nan)


def _all_sticks(dataset: xr.Dataset) -> Array:
    """Of all members together, in a row."""
    values = dataset["stick_time"].transpose(*DIMS, "member", "stick").values.astype(float)
    return np.asarray(values.reshape(*values.shape[:3], -1))


def _sticks(dataset: xr.Dataset) -> Ensembles:
    """Of single sticks, as if they were independent; nothing where there is only a handful."""
    own = Ensembles.of(_all_sticks(dataset), 1.0)
    return Ensembles(own.count, np.where(own.count >= LEAST_STICKS, own.mean, np.nan), own.variance, own.time)


def _stick_distances(
    dataset: xr.Dataset, reference: tuple[int, int], itself: NDArray[np.bool_]
) -> dict[str, tuple[Array, str]]:
    """Two-sample distances of the long sticks from the reference's."""
    every = _all_sticks(dataset)
    found = np.full((3, *every.shape[:3]), np.nan)
    for at in np.ndindex(*every.shape[:3]):
        own, known = (row[np.isfinite(row)] for row in (every[at], every[(*reference, at[2])]))
        if min(len(own), len(known)) < LEAST_STICKS or itself[at]:
            continue
        test = stats.ks_2samp(own, known)
        near = stats.wasserstein_distance(own, known) / known.mean()
        found[(slice(None), *at)] = test.statistic, test.pvalue, near
    texts = (
        "largest difference of the distributions of long sticks (Kolmogorov, Smirnov)",
        "probability of at least this difference if both were of one distribution",
        "Wasserstein distance of the long sticks over their mean",
    )
    names = ("stick_time_ks", "stick_time_ks_probability", "stick_time_wasserstein")
    return {name: (values, text) for name, values, text in zip(names, found, texts, strict=True)}


def _spectra(
    dataset: xr.Dataset, reference: tuple[int, int], itself: NDArray[np.bool_], time: Array
) -> dict[str, tuple[Array, str]]:
    """Spectra in bands: what of the power lies elsewhere, and by how many standard errors a band is off."""
    powers = dataset["band_power"].transpose(*DIMS, "member", "band").values
    gone, scaled, whole = [], [], np.zeros(())
    for k in range(powers.shape[-1]):
        own = Ensembles.of(powers[..., k], time)
        known = own.at(reference)
        error, standard = own.beside(known)
        gone.append(np.abs(error))
        with np.errstate(divide="ignore", invalid="ignore"):
            scaled.append(error / standard)
        whole = whole + known.mean
    error = np.where(itself, np.nan, np.sum(gone, axis=0) / whole)
    deviation = np.where(itself, np.nan, _root_mean_square(scaled))
    return {
        "spectrum_error": (error, "sum of the differences of third-octave bands over their sum"),
        "spectrum_deviation": (deviation, "difference of a band in standard errors, root mean square over bands"),
    }


def _first_times(
    dataset: xr.Dataset, reference: tuple[int, int], itself: NDArray[np.bool_]
) -> dict[str, tuple[Array, str]]:
    """Errors of first slip and first separation, member by member, for these are no chance."""
    slip = dataset["first_slip_time"].values
    delay = dataset["first_separation_time"].values - slip
    texts = (
        ("first_slip_error", slip, "error of the time of the first slip, over it"),
        ("first_delay_error", delay, "error of the time from first slip to first separation, over it"),
    )
    found = {}
    for name, values, text in texts:
        pairs = Ensembles.of(values / values[reference][None, None] - 1.0, 1.0)
        found[name] = (np.where(itself, np.nan, pairs.mean), text)
    return found


def _with_stability(dataset: xr.Dataset) -> xr.Dataset:
    """Errors of onset and growth: of a cut-off against all modes, of a mesh against the finest."""
    if asked.LINEAR not in dataset["method"].values:
        return dataset
    at = dataset.sel({"method": asked.LINEAR}).transpose("setting", "scene", "termination", ...)
    pairs = _held_against([asked.OPTIONS[int(k)] for k in at["setting"].values])
    added = {}
    for name, what in (("onset_mu", "onset"), ("growth_rate", "growth")):
        values = at[name].values
        wrong = np.full(values.shape, np.nan)
        for k, known in pairs:
            wrong[k] = np.abs(values[k] / values[known] - 1.0)
        text = f"error of the {what} of sliding's flutter, over it"
        added[f"{what}_error"] = (("setting", "scene", "termination"), wrong, {"units": "1", "long_name": text})
    return dataset.assign(added)


def _held_against(options: list[asked.Option]) -> list[tuple[int, int]]:
    """Places of settings of sliding stability, each with that of what it is held against, if that is there."""
    sizes = {k: each.size for k, each in enumerate(options) if each.size is not None}
    finest, own = (
        max(sizes, key=lambda k: sizes[k], default=None),
        next((k for k in sizes if sizes[k] == 1.0), None),
    )
    meshes = [(k, finest) for k in sizes if finest is not None and k != finest]
    cutoffs = [(k, own) for k, each in enumerate(options) if each.kind == "cut-off" and own is not None]
    return meshes + cutoffs
