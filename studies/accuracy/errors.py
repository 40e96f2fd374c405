"""Errors of every method and setting, with their standard errors, from the stored runs.

Runs with the published scheme's numerical damping are compared with that scheme, all others with a reference for
the model as given: `fast` with three times the cut-off and half the default step of such a model. `paper` without
numerical damping at half its step would be a more independent reference, but it costs two hundred times as much;
it checks the reference where it is affordable. The motion is chaotic, so statistics are compared over ensembles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from studies.accuracy.settings import FAST, GIVEN, PUBLISHED, SCHEME
from studies.answering.results import with_variables
from studies.motion.stability import with_flags

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
    """Add all errors; missing points have none."""
    data = dataset.assign_coords(quantity=("quantity", list(QUANTITIES), {"long_name": "compared statistic"}))
    time = data["observed_time"].where(data["observed_time"] > 0.0).mean("member")
    damped = (data["method"] == FAST) & (data["setting"] == PUBLISHED)
    scheme, given = (_compare(data, time, *reference) for reference in (SCHEME, GIVEN))
    error, standard, late = (a.where(damped, b) for a, b in zip(scheme, given, strict=True))
    # The standard error over a second is the motion's, common to all methods: the median over settings of `fast`.
    variance = xr.concat([data[name].var("member", ddof=1) for name in FRACTIONS], "fraction").max("fraction")
    second = (variance.where(variance > 0.0) * time) ** 0.5
    second = second.reindex({"method": [FAST]}).median(("method", "setting"))
    cost = data["cpu_per_second"] * (second / STANDARD_ERROR) ** 2
    # Off by more than tolerance and standard errors; "unknown" where no error is finite.
    wrong = (abs(error) > TOLERANCES + ERRORS_ALLOWED * standard.fillna(0.0)).any("quantity")
    within = (
        xr.full_like(late, YES)
        .where(~(wrong | (abs(late) > FIRST_SLIP)), NO)
        .where(error.notnull().any("quantity"), UNKNOWN)
    )
    mismatch, scatter = (rms(part / TOLERANCES, "quantity") for part in (error, standard))
    added: dict[str, tuple[Array, str, str]] = {
        "quantity_error": (error, "1", "error of each statistic; but for fractions of time, over the reference's"),
        "quantity_standard_error": (standard, "1", "standard error of each statistic's error"),
        "mismatch": (mismatch, "1", "errors over tolerances, rms"),
        "mismatch_standard_error": (scatter, "1", "standard errors over tolerances"),
        "first_slip_error": (late, "1", "error of the time of the first slip, over it"),
        "one_second_error": (second, "1", "largest standard error of a fraction of time over a simulated second"),
        "time_to_standard_error": (
            cost, "s", f"CPU time until fractions of time are known to {STANDARD_ERROR:g}",
        ),
        "within": (within.astype(np.int8), "1", "whether first slip and statistics are within tolerance"),
    }  # fmt: skip
    data = with_variables(data, {name: (a.dims, a.values, u, text) for name, (a, u, text) in added.items()})
    return with_flags(data, WITHIN, "within")


def difference(values: Array, reference: Array, time: Any, reference_time: Any) -> tuple[Array, Array, Array]:
    """Difference of means along "member", its standard error, and the reference's mean; values are over `time`.

    The variance of a statistic is inversely proportional to the time over which it is taken. Since that time and
    the number of runs may differ, variances are pooled per unit of time.
    """
    squares, freedom, inverse = Array(0.0), Array(0.0), Array(0.0)
    for ensemble, duration in ((values, time), (reference, reference_time)):
        number = ensemble.count("member")
        free = (number - 1.0).clip(min=0.0)
        squares = squares + free * ensemble.var("member", ddof=1).fillna(0.0) * duration
        freedom = freedom + free
        inverse = inverse + 1.0 / (number * duration).where(number > 0)
    mean = reference.mean("member")
    return values.mean("member") - mean, (squares / freedom.where(freedom > 0.0) * inverse) ** 0.5, mean


def at(values: Array, method: str, setting: str) -> Array:
    """Values of one method and setting; NaN where it is missing."""
    return values.reindex({"method": [method], "setting": [setting]}).isel(method=0, setting=0, drop=True)


def rms(values: Array, dim: str = "scene") -> Array:
    """Root mean square of the finite values; NaN without finite values."""
    return (values**2).mean(dim) ** 0.5


def _compare(data: xr.Dataset, time: Array, *pair: str) -> list[Array]:
    """Errors and standard errors along "quantity", and errors of the first slip; none for the reference."""
    enough = data["long_sticks"].sum("member") >= LEAST_STICKS
    data = data.assign(mean_stick_time=data["mean_stick_time"].where(enough))
    values = xr.concat([data[name].astype(float) for name in QUANTITIES], data["quantity"])
    error, standard, reference = difference(values, at(values, *pair), time, at(time, *pair))
    scale = reference.where(RELATIVE, 1.0)
    # A dominant frequency is compared with the nearest of the reference's runs and of its rival peaks.
    found, random = data["dominant_frequency"], data["quantity"] != "dominant_frequency"
    peaks = at(found, *pair).rename(member="peak")
    rivals = at(data["rival_peaks"], *GIVEN).rename(rival="peak").where(peaks.notnull().any("peak"))
    peak_error = abs(found / xr.concat([peaks, rivals], "peak") - 1.0).min(("member", "peak"))
    late = (data["first_slip_time"] / at(data["first_slip_time"], *pair) - 1.0).mean("member")
    parts = (error / scale).where(random, peak_error), (standard / scale).where(random, 0.0 * standard), late
    others = (data["method"] != pair[0]) | (data["setting"] != pair[1])
    return [part.where(others).transpose(*late.dims, ...) for part in parts]
