"""Fit of a law T ~ V^n to the sticks of repeat runs: means and exponents with bootstrap intervals over the runs.

Sticks of one run are not independent of each other, repeat runs are: the bootstrap draws whole runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore.transient.summary import LONG_SHARE
from studies import paper

Array = NDArray[np.float64]

# Kinds of sticks, by when they begin: before or after the motion has settled.
KINDS = ("start_up", "sustained")
# The laws that are fitted: start-up sticks over the paper's intermittent speeds; sustained ones over all speeds
# below the end of intermittence, and over those up to a third of it, where they fill most of the time.
LAWS = ("start_up", "sustained", "sustained_slow")
SLOW = 1.0 / 3.0
# Drawings, what of them an interval holds, and where they start.
DRAWINGS, COVERED, SEED = 2000, 0.95, 2010

# What a value and the ends of its interval are called.
_END = "end of the 95 % interval of the "
ENDS = {"": "", "_low": f"lower {_END}", "_high": f"upper {_END}"}
_KIND, _LAW = ("kind", "V"), ("law",)
# Dimensions beyond mu and F, units and meaning of what is derived; with its interval where that ends in a dash.
DERIVED = {
    "mean_stick_time -": (_KIND, "s", "mean duration of the long sticks"),
    "local_exponent -": (_KIND, "1", "exponent of the mean stick time over V, from a speed and its neighbours"),
    "exponent -": (_LAW, "1", "exponent of the mean stick time over V"),
    "start_up_ratio -": ((), "1", "mean start-up stick at 2 mm/s over that at 1 mm/s"),
    "sustained_share": (("V",), "1", "share of the time after settling in the long sticks begun after it"),
    "intermittence_end": ((), "m s-1", "speed above which sustained sticks fill less than a tenth of the time"),
}


def with_laws(dataset: xr.Dataset, **constants: Any) -> xr.Dataset:
    """Add means over repeat runs, their intervals, and the exponents of the laws."""
    each = [
        [_laws(dataset.isel(mu=m, F=f)) for f in range(dataset.sizes["F"])] for m in range(dataset.sizes["mu"])
    ]
    derived = {}
    for name, (dims, units, text) in DERIVED.items():
        name, _, ends = name.partition(" ")
        for k, (suffix, whose) in enumerate(ENDS.items()):
            if not k or ends:
                values = np.array([[one[name][k] if ends else one[name] for one in row] for row in each])
                derived[name + suffix] = (("mu", "F", *dims), values, {"units": units, "long_name": whose + text})
    coords: dict[str, Any] = {
        "kind": ("kind", np.array(KINDS, dtype=object), {"long_name": "begun before or after the motion settled"}),
        "law": ("law", np.array(LAWS, dtype=object), {"long_name": "which sticks, over which speeds"}),
    }
    return dataset.assign_coords(coords).assign(derived)


def _laws(at: xr.Dataset) -> dict[str, Any]:
    """Compute the variables of DERIVED for one mu and F."""
    at = at.transpose("V", "member", ...)
    V = at["V"].values
    early, late = (
        Means.of(*(np.nan_to_num(at[f"{kind}_{what}"].values.astype(float)) for what in ("total", "count")))
        for kind in KINDS
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        share = at["sustained_total"].sum("member").values / at["observed_time"].sum("member").values
    end = crossing(V, share, LONG_SHARE)
    # Where no end is found, every speed at which sticks fill more than that counts.
    lasting = (share > LONG_SHARE) & ~(end <= V)
    both = (early, late)
    fitted = (early, _intermittent_in_paper(V)), (late, lasting), (late, lasting & (SLOW * end >= V))
    return {
        "mean_stick_time": np.stack([[of.mean, *of.interval()] for of in both], axis=1),
        "local_exponent": np.stack([of.local_exponents(V) for of in both], axis=1),
        "exponent": np.stack([of.exponent(V, chosen) for of, chosen in fitted], axis=1),
        "start_up_ratio": early.ratio(V, *paper.STICK_RATIO_SPEEDS),
        "sustained_share": share,
        "intermittence_end": end,
    }


def _intermittent_in_paper(V: Array) -> NDArray[np.bool_]:
    """Speeds within those at which the paper sees sticks come and go."""
    ends = [speed for speed, kind in paper.VIBRATION.items() if kind == "intermittent"]
    return np.asarray((min(ends) * (1.0 - 1e-9) <= V) & (max(ends) * (1.0 + 1e-9) >= V))


@dataclass(frozen=True, eq=False)
class Means:
    """Mean stick time at each speed, and what it would be in other ensembles.

    Attributes
    ----------
    mean : ndarray, (speeds,)
        s; NaN where there is no stick.
    drawn : ndarray, (drawings, speeds)
        Means of ensembles of as many repeat runs, drawn with replacement.
    """

    mean: Array
    drawn: Array

    @classmethod
    def of(cls, time: Array, count: Array) -> Means:
        """From the total time (s) and the number of each run's sticks, (speeds, runs)."""
        speeds, members = time.shape
        chosen = np.random.default_rng(SEED).integers(members, size=(DRAWINGS, speeds, members))
        row = np.arange(speeds)[None, :, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            drawn = time[row, chosen].sum(axis=2) / count[row, chosen].sum(axis=2)
            return cls(time.sum(axis=1) / count.sum(axis=1), drawn)

    def interval(self) -> Array:
        """Ends of the interval about each mean, (2, speeds), s."""
        return interval(self.drawn)

    def exponent(self, V: Array, chosen: NDArray[np.bool_]) -> Array:
        """Exponent of T ~ V^n over the chosen speeds and its interval, (3,); NaN for fewer than two."""
        chosen = chosen & np.isfinite(self.mean)
        if chosen.sum() < 2:
            return np.full(3, np.nan)
        x, y, drawn = (np.log(each) for each in (V[chosen], self.mean[chosen], self.drawn[:, chosen]))
        return np.append(slope(x, y), interval(slope(x, drawn)))

    def local_exponents(self, V: Array) -> Array:
        """Exponent about each speed, from its neighbours, with the ends of its interval, (3, speeds)."""
        place, exponents = np.arange(len(V)), np.full((3, len(V)), np.nan)
        for k in np.flatnonzero(np.isfinite(self.mean)):
            exponents[:, k] = self.exponent(V, np.abs(place - k) <= 1)
        return exponents

    def ratio(self, V: Array, over: float, under: float) -> Array:
        """Mean at one speed over that at another, and the ends of its interval, (3,); NaN if either is missing."""
        at = [np.isclose(V, speed, rtol=1e-9, atol=0.0) for speed in (over, under)]
        if not all(map(np.any, at)):
            return np.full(3, np.nan)
        a, b = map(np.argmax, at)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.append(self.mean[a] / self.mean[b], interval(self.drawn[:, a] / self.drawn[:, b]))


def interval(drawn: Array) -> Array:
    """Bounds of the middle COVERED share of drawings without missing values, (2, ...) from (drawings, ...)."""
    none = np.all(np.isnan(drawn), axis=0)
    ends = np.nanquantile(np.where(none, 0.0, drawn), [0.5 - 0.5 * COVERED, 0.5 + 0.5 * COVERED], axis=0)
    return np.asarray(np.where(none, np.nan, ends))


def slope(x: Array, y: Array) -> Array:
    """Slope of the least-squares line through y, (..., n), over x, (n,)."""
    away = x - x.mean()
    return np.asarray(y @ away / (away @ away))


def crossing(V: Array, share: Array, level: float) -> float:
    """Speed at which a share falls below a level for good; NaN if it does not, or never was above.

    Between the last speed above and the next one the share is taken as linear in V.
    """
    finite = np.isfinite(share)
    V, share = V[finite], share[finite]
    above = np.flatnonzero(share > level)
    if not len(above) or above[-1] == len(V) - 1:
        return float("nan")
    k = int(above[-1])
    return float(V[k] + (share[k] - level) / (share[k] - share[k + 1]) * (V[k + 1] - V[k]))
