"""Power laws T ~ V^n of sticks: means and exponents with bootstrap intervals.

Sticks of one run depend on each other, realisations do not; so the bootstrap resamples whole runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from fivcore import LONG_SHARE, Scene, checks, loading_time
from studies import paper
from studies.declaring import labels
from studies.motion import ensemble
from studies.motion.jobs import outcomes
from studies.motion.run import SETTLING
from sweeps import Variable

# Kinds of sticks, by when they begin: before or after the motion has settled.
KINDS = ("start_up", "sustained")
# Over the paper's intermittent speeds; up to the end of intermittence; up to SLOW of it; up to it within SPAN, the
# speeds, m/s, about those at which the paper has sticks.
LAWS = ("start_up", "sustained", "sustained_slow", "sustained_0.5_to_4_mm/s")
SLOW, SPAN = 1.0 / 3.0, (0.5e-3, 4e-3)
SAMPLES, COVERAGE, SEED = 2000, 0.95, 2010
# Fewest runs with sticks, if there are as many runs: one or two of many show no scatter.
FEWEST = 3
ENDS = {"": "", "_low": "lower end of the 95 % interval: ", "_high": "upper end of the 95 % interval: "}
# Dimensions beyond mu and F, units and meaning of the derived variables; the first INTERVALS have an interval.
DERIVED: dict[str, tuple[tuple[str, ...], str, str]] = {
    "mean_stick_time": (("kind", "V"), "s", "mean duration of the long sticks"),
    "local_exponent": (("kind", "V"), "1",
                       "exponent of the mean stick time over V, from a speed and its neighbours"),
    "exponent": (("law",), "1", "exponent of the mean stick time over V"),
    "start_up_ratio": ((), "1", "mean start-up stick at 2 mm/s over that at 1 mm/s"),
    "sustained_ratio": ((), "1", "mean sustained stick at 2 mm/s over that at 1 mm/s"),
    "sustained_share": (("V",), "1", "fraction of time after settling in the long sticks begun after it"),
    "intermittence_end": ((), "m s-1", "speed above which sustained sticks fill less than a tenth of the time"),
}  # fmt: skip
INTERVALS = 5
# So many sticks of a run are stored one by one; its counts and totals are of all.
KEPT = 64
OUTPUTS = {
    "stick_time": Variable("s", "duration of each long stick, start-up first", ("stick",), "float32", digits=4),
    "start_up_count": Variable("1", "number of long sticks begun before settling", (), "int32"),
    "start_up_total": Variable("s", "time in long sticks begun before settling", (), "float32"),
    "sustained_count": Variable("1", "number of long sticks begun after settling", (), "int32"),
    "sustained_total": Variable("s", "time in long sticks begun after settling", (), "float32"),
    "observed_time": Variable("s", "time simulated after settling", (), "float32"),
    "first_slip_time": Variable("s", "time of the first slip, the end of the first stick", (), "float32"),
    "loading_time": Variable("s", "static stick time t0 = mu F / (k_t V)", (), "float32"),
}
# Of fewer sticks a realisation no mean is drawn.
LEAST_STICKS = 1.25


def sticks(scenes: Sequence[Scene], member: Any, **run: Any) -> dict[str, Any]:
    """The long sticks of one realisation of each normalised scene."""
    numbers = np.broadcast_to(member, len(scenes)).tolist()
    jobs = [[ensemble.realisation(scene, number, run)] for scene, number in zip(scenes, numbers, strict=True)]
    return outcomes(jobs, lambda jobs, runs: of_sticks(jobs[0].scene, runs[0].summary))


def of_sticks(scene: Scene, run: Any) -> dict[str, Any]:
    """Long sticks of a run, start-up and sustained: begun before or after the motion had settled."""
    first, long = run["first_slip_time"], run["stick_times"]
    early = run["stick_starts"] - first < SETTLING
    return {
        "stick_time": np.append(long, np.full(KEPT, np.nan))[:KEPT],
        "start_up_count": np.count_nonzero(early),
        "start_up_total": long[early].sum(),
        "sustained_count": np.count_nonzero(~early),
        "sustained_total": long[~early].sum(),
        "observed_time": np.fmax(run["simulated_time"] - first - SETTLING, 0.0),
        "first_slip_time": first,
        "loading_time": loading_time(scene),
    }


def with_laws(dataset: xr.Dataset) -> xr.Dataset:
    """Add means over the realisations, exponents, and their intervals."""
    fits = [[_fit(dataset.isel(mu=m, F=f)) for f in range(dataset.sizes["F"])] for m in range(dataset.sizes["mu"])]
    derived = dict[str, Any]()
    for place, (name, (dims, units, text)) in enumerate(DERIVED.items()):
        whole = np.array([[fit[name] for fit in row] for row in fits])
        for k, (suffix, end) in enumerate(ENDS.items() if place < INTERVALS else [("", "")]):
            values = whole[:, :, k] if place < INTERVALS else whole
            derived[name + suffix] = (("mu", "F", *dims), values, {"units": units, "long_name": end + text})
    kinds, laws = (np.array(names, dtype=object) for names in (KINDS, LAWS))
    derived["kind"] = ("kind", kinds, {"long_name": "begun before or after the motion settled"})
    derived["law"] = ("law", laws, {"long_name": "which sticks, over which speeds"})
    return dataset.assign_coords({name: derived.pop(name) for name in ("kind", "law")}).assign(derived)


def _fit(at: xr.Dataset) -> dict[str, Any]:
    """The derived variables of one mu and F."""
    at = at.transpose("V", "member", ...)
    V, both = at["V"].values, list[tuple[Any, Any]]()
    for kind in KINDS:
        total, count = (np.nan_to_num(at[f"{kind}_{what}"].values.astype(float)) for what in ("total", "count"))
        both.append(bootstrap(total, count))
    with np.errstate(invalid="ignore", divide="ignore"):
        share = at["sustained_total"].sum("member").values / at["observed_time"].sum("member").values
    end = crossing(V, share, LONG_SHARE)
    # Where no end is found, every speed at which sticks fill more than that counts.
    lasting = (share > LONG_SHARE) & ~(end <= V)
    speeds = [speed for speed, kind in paper.VIBRATION.items() if kind == "intermittent"]
    papers, span = (
        (ends[0] * (1.0 - 1e-9) <= V) & (ends[-1] * (1.0 + 1e-9) >= V) for ends in (sorted(speeds), SPAN)
    )
    laws = (both[0], papers), *((both[1], lasting & part) for part in (True, SLOW * end >= V, span))
    return {
        "mean_stick_time": np.stack([[mean, *interval(samples)] for mean, samples in both], axis=1),
        "local_exponent": np.stack([local_exponents(V, *means) for means in both], axis=1),
        "exponent": np.stack([exponent(V, mean, samples, chosen) for (mean, samples), chosen in laws], axis=1),
        **{f"{kind}_ratio": ratio(V, *of, paper.STICK_RATIO_SPEEDS) for kind, of in zip(KINDS, both, strict=True)},
        "sustained_share": share,
        "intermittence_end": end,
    }


def bootstrap(time: Any, count: Any) -> tuple[Any, Any]:
    """Mean stick time at each speed and bootstrap samples of it, from totals of runs, (speeds, runs); or NaN."""
    speeds, members = time.shape
    chosen = np.random.default_rng(SEED).integers(members, size=(SAMPLES, speeds, members))
    row, few = np.arange(speeds)[None, :, None], np.count_nonzero(count, axis=1) < min(FEWEST, members)
    with np.errstate(invalid="ignore", divide="ignore"):
        samples = time[row, chosen].sum(axis=2) / count[row, chosen].sum(axis=2)
        mean = time.sum(axis=1) / count.sum(axis=1)
    return np.where(few, np.nan, mean), np.where(few, np.nan, samples)


def exponent(V: Any, mean: Any, samples: Any, chosen: Any) -> Any:
    """Exponent of T ~ V^n over the chosen speeds and its interval, (3,); NaN for fewer than two."""
    chosen = chosen & np.isfinite(mean)
    if chosen.sum() < 2:
        return np.full(3, np.nan)
    x, y, drawn = (np.log(of) for of in (V[chosen], mean[chosen], samples[:, chosen]))
    away = x - x.mean()
    return np.append(y @ away / (away @ away), interval(drawn @ away / (away @ away)))


def local_exponents(V: Any, mean: Any, samples: Any) -> Any:
    """Exponent at each speed from its neighbours, with the ends of its interval, (3, speeds)."""
    index = np.arange(len(V))
    near = [(np.abs(index - k) <= 1) & np.isfinite(mean[k]) for k in index]
    return np.stack([exponent(V, mean, samples, chosen) for chosen in near], axis=1)


def ratio(V: Any, mean: Any, samples: Any, speeds: tuple[float, float]) -> Any:
    """Mean at one speed over that at another, and the ends of its interval, (3,); NaN if either is missing."""
    at = [np.flatnonzero(np.isclose(V, speed, rtol=1e-9, atol=0.0)) for speed in speeds]
    if not all(map(len, at)):
        return np.full(3, np.nan)
    a, b = (places[0] for places in at)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.append(mean[a] / mean[b], interval(samples[:, a] / samples[:, b]))


def interval(samples: Any) -> Any:
    """Bounds of the middle COVERAGE of samples without missing values, (2, ...) from (samples, ...)."""
    none = np.all(np.isnan(samples), axis=0)
    ends = np.nanquantile(np.where(none, 0.0, samples), [0.5 - 0.5 * COVERAGE, 0.5 + 0.5 * COVERAGE], axis=0)
    return np.where(none, np.nan, ends)


def crossing(V: Any, share: Any, level: float) -> float:
    """Highest speed at which a fraction falls below a level, interpolated linearly in V; NaN if it never does."""
    V, share = V[np.isfinite(share)], share[np.isfinite(share)]
    above = np.flatnonzero(share > level)
    if not len(above) or above[-1] == len(V) - 1:
        return float("nan")
    k = int(above[-1])
    return float(V[k] + (share[k] - level) / (share[k] - share[k + 1]) * (V[k + 1] - V[k]))


def means(at: xr.Dataset, kind: str) -> np.ndarray:
    """Mean stick times and the ends of their intervals, (3, V), s; NaN where sticks are few."""
    values = np.stack([at[f"mean_stick_time{end}"].sel(kind=kind).values for end in ("", "_low", "_high")])
    enough = at[f"{kind}_count"].sum("member").values >= LEAST_STICKS * at.sizes["member"]
    return np.where(enough, values, np.nan)


def at_paper(dataset: xr.Dataset) -> xr.Dataset:
    """The part at the coefficient of friction and the load nearest to the paper's."""
    return dataset.sel(mu=paper.MU, F=paper.LOAD, method="nearest")


def with_ends(at: xr.Dataset, name: str, factor: float = 1.0) -> str:
    """A value with its interval; a dash where it is missing."""
    value, low, high = (labels.number(factor * float(at[f"{name}{end}"])) for end in ("", "_low", "_high"))
    return value if value == "-" else f"{value} ({low} to {high})"


def lasting(at: xr.Dataset) -> dict[float, Any]:
    """T V of the sustained sticks, um, at the speeds with enough of them."""
    times = at["stick_time"].where(at["stick"] > at["start_up_count"]).transpose("V", ...)
    found = {float(of["V"]): (1e6 * float(of["V"]) * of.values)[np.isfinite(of.values)] for of in times}
    return {V: values for V, values in found.items() if len(values) >= LEAST_STICKS * at.sizes["member"]}


def check(member: Any, **others: Any) -> None:
    """Refuse parameters with which no scene can be simulated."""
    checks.between("member", float(np.min(member)), 1.0, 1e6, "a number counted from 1")
    ensemble.check(**others)
