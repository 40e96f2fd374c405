"""Errors of every method and setting, with their standard errors, from the stored runs.

What has the published scheme's numerical damping is compared with that scheme, everything else with the model as
given: `fast` at three times the cut-off in steps half as long as such a model's default. `paper` without numerical
damping in half its step would be the plainer reference, but costs two hundred times as much; it checks the other
one where it is affordable.

After the first burst the motion is chaotic, so statistics are compared over ensembles. The variance of a statistic
falls with the time it is taken over; that time and the number of runs may differ, so variances are pooled per unit
of time, and the standard error of a difference follows from both ensembles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from studies.accuracy.settings import FAST, GIVEN, REFERENCES

Array = xr.DataArray

LEAST_STICKS = 20  # fewer long sticks have no mean
FRACTIONS = ("stick_fraction", "slip_fraction", "separation_fraction")
# What is compared: its name, whether its error is over the reference's value, and the tolerance, that of `fast`.
QUANTITIES = {name: (name.removesuffix("_fraction"), False, 0.02) for name in FRACTIONS} | {
    "dominant_frequency": ("dominant frequency", True, 0.015),
    "velocity_rms": ("RMS of v_B", True, 0.10),
    "mean_stick_time": ("mean stick", True, 0.10),
}
RELATIVE, TOLERANCES = (Array(np.array([row[k] for row in QUANTITIES.values()]), dims="quantity") for k in (1, 2))
# A statistic is right if it is off by no more than its tolerance and so many standard errors; the first slip,
# which is not random, if its time is off by no more than this share.
ERRORS_ALLOWED, FIRST_SLIP = 2.0, 0.01
WITHIN, NO, YES, UNKNOWN = ("no", "yes", "unknown"), 0, 1, 2
STANDARD_ERROR = 0.005  # of the fractions of time: the CPU time to reach it is a result


def with_errors(dataset: xr.Dataset) -> xr.Dataset:
    """Add every error; points that are missing have none."""
    data = dataset.assign_coords(quantity=("quantity", list(QUANTITIES), {"long_name": "compared statistic"}))
    time = data["observed_time"].where(data["observed_time"] > 0.0).mean("member")
    error, standard, late = _compare(data, time, GIVEN)
    for pair, reference in REFERENCES.items():
        here = (data["method"] == pair[0]) & (data["setting"] == pair[1])
        new = _compare(data, time, reference)
        error, standard, late = (a.where(here, b) for a, b in zip(new, (error, standard, late), strict=True))
    # The standard error over a second is the motion's, common to all methods: the median over settings of `fast`.
    variance = xr.concat([data[name].var("member", ddof=1) for name in FRACTIONS], "fraction").max("fraction")
    second = (variance.where(variance > 0.0) * time) ** 0.5
    second = second.reindex({"method": [FAST]}).median(("method", "setting"))
    cost = data["cpu_per_second"] * (second / STANDARD_ERROR) ** 2
    added: dict[str, tuple[Array, str]] = {
        "quantity_error": (error, "error of each statistic; but for fractions of time, over the reference's"),
        "quantity_standard_error": (standard, "standard error of each statistic's error"),
        "mismatch": (rms(error / TOLERANCES, "quantity"), "errors over tolerances, rms"),
        "mismatch_standard_error": (rms(standard / TOLERANCES, "quantity"), "standard errors over tolerances"),
        "first_slip_error": (late, "error of the time of the first slip, over it"),
        "one_second_error": (second, "largest standard error of a fraction of time over a simulated second"),
        "time_to_standard_error": (cost, f"CPU time until fractions of time are known to {STANDARD_ERROR:g}"),
    }
    data = data.assign(
        {name: part.assign_attrs(units="1", long_name=text) for name, (part, text) in added.items()}
    )
    data["time_to_standard_error"].attrs["units"] = "s"
    text = "whether first slip and statistics are within tolerance"
    flags = {"flag_values": np.arange(len(WITHIN), dtype=np.int8), "flag_meanings": " ".join(WITHIN)}
    return data.assign(
        within=_within(error, standard, late).drop_attrs(deep=False).assign_attrs(flags, long_name=text)
    )


def difference(values: Array, reference: Array, time: Any, reference_time: Any) -> tuple[Array, Array, Array]:
    """Difference of means along "member", its standard error, and the reference's mean; values are over `time`."""
    parts = []
    for ensemble, duration in ((values, time), (reference, reference_time)):
        number = ensemble.count("member").astype(float)
        mean = ensemble.sum("member") / number.where(number > 0.0)
        squares = ((ensemble - mean) ** 2).sum("member")
        variance = (squares / (number - 1.0).where(number > 1.0)).fillna(0.0)
        freedom = (number - 1.0).clip(min=0.0)
        parts.append((mean, freedom * variance * duration, freedom, 1.0 / (number * duration).where(number > 0.0)))
    (mean, squares, freedom, inverse), (of, *others) = parts
    per_time = (squares + others[0]) / (freedom + others[1]).where(freedom + others[1] > 0.0)
    return mean - of, (per_time * (inverse + others[2])) ** 0.5, of


def at(values: Array, method: str, setting: str) -> Array:
    """Values of one method and setting; NaN where it is missing."""
    return values.reindex({"method": [method], "setting": [setting]}).isel(method=0, setting=0, drop=True)


def _compare(data: xr.Dataset, time: Array, pair: tuple[str, str]) -> list[Array]:
    """Errors and standard errors along "quantity", and errors of the first slip; the reference itself has none."""
    enough = data["long_sticks"].sum("member") >= LEAST_STICKS
    data = data.assign(mean_stick_time=data["mean_stick_time"].where(enough))
    values = xr.concat([data[name].astype(float) for name in QUANTITIES], data["quantity"])
    error, standard, reference = difference(values, at(values, *pair), time, at(time, *pair))
    scale = reference.where(RELATIVE, 1.0)
    random = data["quantity"] != "dominant_frequency"
    error = (error / scale).where(random, _peak_error(data, pair))
    standard = (standard / scale).where(random, 0.0 * standard)
    slip = data["first_slip_time"]
    late = (slip / at(slip, *pair) - 1.0).mean("member")
    others = (data["method"] != pair[0]) | (data["setting"] != pair[1])
    return [part.where(others).transpose(*late.dims, ...) for part in (error, standard, late)]


def _peak_error(data: xr.Dataset, pair: tuple[str, str]) -> Array:
    """Least relative error of a run's dominant frequency, against the reference's runs and its rival peaks."""
    found = data["dominant_frequency"]
    peaks = at(found, *pair).rename(member="peak")
    rivals = at(data["rival_peaks"], *GIVEN).rename(rival="peak").where(peaks.notnull().any("peak"))
    return abs(found / xr.concat([peaks, rivals], "peak") - 1.0).min(("member", "peak"))


def _within(error: Array, standard: Array, late: Array) -> Array:
    """Whether every finite error is within tolerance and standard errors; "unknown" where none is finite."""
    wrong = (abs(error) > TOLERANCES + ERRORS_ALLOWED * standard.fillna(0.0)).any("quantity")
    wrong |= abs(late) > FIRST_SLIP
    codes = xr.full_like(late, YES, dtype=np.int8).where(~wrong, NO)
    return codes.where(error.notnull().any("quantity"), UNKNOWN)


def rms(values: Array, dim: str = "scene") -> Array:
    """Root mean square of the finite values; NaN where none is."""
    return (values**2).mean(dim) ** 0.5
