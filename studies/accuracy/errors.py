"""Errors of every method and setting, from what is stored of each, with their scatter.

There are two references. What has the published scheme's numerical damping is compared with that scheme:
`paper` at its own step. Everything else, that scheme included, is compared with the model as given: `fast` at
three times the cut-off in steps half as long as such a model's own. `paper` without numerical damping in half
its step would be the plainer reference, but costs two hundred times as much; it is run where it is affordable,
and its error says whether the two are the same (on more rigs `tests/fivcore/transient/test_random_rigs.py`
does).

After the first burst motion is chaotic, so figures are compared over ensembles. The variance of a figure falls
with the time it is taken over; that time and the number of repeat runs may differ, so variances are pooled per
unit of time, and the standard error of a difference follows from both ensembles.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from studies.accuracy.settings import FAST, GIVEN, REFERENCES
from studies.motion import transients

# Of fewer long sticks there is no mean.
LEAST_STICKS = 20
# A figure is right if it is off by no more than its tolerance and so many standard errors.
ERRORS_ALLOWED = 2.0
# And the first slip, which is no chance, comes when it should, up to this share of its time.
FIRST_SLIP = 0.01
WITHIN = ("no", "yes", "unknown")
# Of the shares of time: to reach it takes some time of each method.
STANDARD_ERROR = 0.005


class Figure(NamedTuple):
    """A figure that is compared: a variable of each repeat run."""

    name: str
    # Whether its error is over the reference's value.
    relative: bool
    # What the project asks of `fast` (`tests/fivcore/transient/test_random_rigs.py`).
    tolerance: float
    long_name: str


SHARES = ("stick_fraction", "slip_fraction", "separation_fraction")
FIGURES = (
    *(Figure(name, False, 0.02, name.removesuffix("_fraction")) for name in SHARES),
    Figure("dominant_frequency", True, 0.015, "dominant frequency"),
    Figure("velocity_rms", True, 0.10, "RMS of v_B"),
    Figure("mean_stick_time", True, 0.10, "mean stick"),
)
TOLERANCES = xr.DataArray([each.tolerance for each in FIGURES], dims="figure")


class Ensembles(NamedTuple):
    """Number, mean and variance of a figure's values, and the time each is taken over, at each point."""

    number: xr.DataArray
    mean: xr.DataArray
    variance: xr.DataArray
    time: xr.DataArray

    @classmethod
    def of(cls, values: xr.DataArray, time: xr.DataArray | float = 1.0) -> Ensembles:
        """Summarise values along "member"; a point without values has NaN for its mean."""
        number = values.count("member").astype(float)
        mean = values.sum("member") / number.where(number > 0.0)
        squares = ((values - mean) ** 2).sum("member")
        variance = (squares / (number - 1.0).where(number > 1.0)).fillna(0.0)
        return cls(number, mean, variance, xr.zeros_like(mean) + time)

    def minus(self, reference: Ensembles) -> tuple[xr.DataArray, xr.DataArray]:
        """Difference of the means and its standard error; NaN where either cannot be computed."""
        one, other = ((each.number - 1.0).clip(min=0.0) for each in (self, reference))
        spread = one * self.variance * self.time + other * reference.variance * reference.time
        per_time = spread / (one + other).where(one + other > 0.0)
        one, other = (1.0 / (each.number * each.time).where(each.number > 0.0) for each in (self, reference))
        return self.mean - reference.mean, (per_time * (one + other)) ** 0.5


def with_errors(dataset: xr.Dataset, **_: Any) -> xr.Dataset:
    """Add every error; what is not in the file has none."""
    data = dataset.assign_coords(
        figure=("figure", [each.name for each in FIGURES], {"long_name": "figure that is compared"})
    )
    time = data["observed_time"].where(data["observed_time"] > 0.0)
    error, standard, late = _compared(data, time.mean("member"), GIVEN)
    for pair, reference in REFERENCES.items():
        place = (data["method"] == pair[0]) & (data["setting"] == pair[1])
        other = _compared(data, time.mean("member"), reference)
        error, standard, late = (
            new.where(place, old) for new, old in zip(other, (error, standard, late), strict=True)
        )
    scatter = standard / TOLERANCES
    second = scatter_of_a_second(data, time)
    added = {
        "figure_error": (error, "error of each figure; but of shares of time, over the reference's", "1"),
        "figure_standard_error": (standard, "standard error of each figure's error", "1"),
        "mismatch": (root_mean_square(error / TOLERANCES, "figure"), "errors over tolerances, rms", "1"),
        "mismatch_scatter": (root_mean_square(scatter, "figure"), "mismatch by scatter alone", "1"),
        "first_slip_error": (late, "error of the time of the first slip, over it", "1"),
        "within": (_within(error, standard, late), "whether first slip and figures are within tolerance", "1"),
        "one_second_error": (second, "largest standard error of a share of time over a simulated second", "1"),
        "time_to_standard_error": (
            data["cpu_per_second"] * (second / STANDARD_ERROR) ** 2,
            f"CPU time until every share of time has a standard error of {STANDARD_ERROR:g}",
            "s",
        ),
    }
    named = {name: part.assign_attrs(units=u, long_name=text) for name, (part, text, u) in added.items()}
    return transients.with_flags(data.assign(named), within=WITHIN)


def scatter_of_a_second(data: xr.Dataset, time: xr.DataArray) -> xr.DataArray:
    """Largest standard error of a share of time over one simulated second, at each scene.

    That of the motion, which methods have in common: the median over all settings of `fast`.
    """
    spread = xr.concat([data[name].var("member", ddof=1) for name in SHARES], "share").max("share")
    second = (spread.where(spread > 0.0) * time.mean("member")) ** 0.5
    return second.reindex({"method": [FAST]}).median(("method", "setting"))


def _at(values: xr.DataArray, method: str, setting: str) -> xr.DataArray:
    """Values at one place; NaN where it is not there."""
    return values.reindex({"method": [method], "setting": [setting]}).isel(method=0, setting=0, drop=True)


def _compared(data: xr.Dataset, time: xr.DataArray, place: tuple[str, str]) -> list[xr.DataArray]:
    """Errors and standard errors along "figure" and of the first slip; what they are compared with has none."""
    pairs = []
    for figure in FIGURES:
        values = data[figure.name].astype(float)
        if figure.name == "mean_stick_time":
            values = values.where(data["long_sticks"].sum("member") >= LEAST_STICKS)
        own = Ensembles.of(values, time)
        reference = Ensembles(*(_at(part, *place) for part in own))
        error, standard = (part / reference.mean if figure.relative else part for part in own.minus(reference))
        if figure.name == "dominant_frequency":
            error, standard = _line_error(data, place), 0.0 * standard
        pairs.append([error, standard])
    slip = data["first_slip_time"]
    first = Ensembles.of(slip / _at(slip, *place) - 1.0).mean
    others = (data["method"] != place[0]) | (data["setting"] != place[1])
    error, standard = (xr.concat(parts, "figure") for parts in zip(*pairs, strict=True))
    return [
        each.where(others).transpose(..., *("figure",) * (each is not first)) for each in (error, standard, first)
    ]


def _line_error(data: xr.Dataset, place: tuple[str, str]) -> xr.DataArray:
    """Smallest relative error of a run's dominant frequency, against the reference's runs and its rival peaks."""
    lines = data["dominant_frequency"]
    reference = _at(lines, *place).rename(member="line")
    rivals = _at(data["rival_lines"], *GIVEN).rename(rival="line").where(reference.notnull().any("line"))
    reference = xr.concat([reference, rivals], "line")
    return abs(lines / reference - 1.0).min(("member", "line"))


def _within(error: xr.DataArray, standard: xr.DataArray, first_slip: xr.DataArray) -> xr.DataArray:
    """Whether every finite figure is within its tolerance and scatter; "unknown" where none is finite."""
    wrong = (abs(error) > TOLERANCES + ERRORS_ALLOWED * standard.fillna(0.0)).any("figure")
    wrong |= abs(first_slip) > FIRST_SLIP
    codes = xr.full_like(first_slip, WITHIN.index("yes"), dtype=np.int8).where(~wrong, WITHIN.index("no"))
    return codes.where(error.notnull().any("figure"), WITHIN.index("unknown"))


def root_mean_square(values: xr.DataArray, dim: str = "scene") -> xr.DataArray:
    """Root mean square of the finite values; NaN where there are none."""
    return (values**2).mean(dim) ** 0.5
