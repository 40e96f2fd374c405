"""Ensembles: realisations of one scene, which chaos makes independent, and the duration that the scene needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincc

from fivcore import Scene, Transient, Until, checks, loading_time
from studies.declaring.parameters import RUN, Parameter
from studies.motion import mixed
from studies.motion import run as runs
from studies.motion.jobs import Job
from studies.motion.regimes import VIBRATING, is_of
from sweeps import Axis, Variable

# A point's value is the largest of its realisations; of a frequency the middle one, for the mean of two spectral
# peaks is neither; otherwise the mean.
LARGEST = ("max_normal_force", "max_slip_speed")
MIDDLE = ("dominant_frequency", "stuck_frequency")
HOW = dict.fromkeys(
    (f"{name}_se" for name in runs.ESTIMATED),
    "of the mean over realisations; by their spread where they follow different motions",
)
HOW |= dict.fromkeys(LARGEST, "largest of the realisations") | dict.fromkeys(MIDDLE, "of the middle realisation")
QUANTITIES = tuple(name for name in runs.SUMMARY if name != "regime")
# Quantities whose standard deviation over realisations is stored too.
SPREAD = ("stick_fraction", "velocity_rms", "dominant_frequency", "normal_force_999")
MOST_MEMBERS = 1000
# What `averages` keeps.
AVERAGED = ("velocity_rms", "stick_fraction", "slip_fraction", "separation_fraction")
KEPT = ("regime", "dominant_frequency", *AVERAGED)
# Places for the different motions of realisations, and the regime of a place without one.
NONE = -1
APART = {"motion": Axis(np.arange(1, mixed.MOST + 1), "1", "motion, that of most realisations first")}
# Realisations differ by the ramp of the drive: each is longer than the one before by this share of the first. Its
# effect on averages is gone within milliseconds of the first separation, but no two runs then move alike.
STRETCH = 0.013


def until(min_duration: float, max_duration: float, numerical_damping: str = "none") -> dict[str, Parameter]:
    """Parameters of runs that end when the standard errors of their fractions of time are small enough."""
    error = Parameter(0.005, "1", "largest standard error of a fraction of time at which a run ends", common=True)
    return {"standard_error": error} | _limits(min_duration, max_duration, numerical_damping)


def loading_times(count: float, min_duration: float, max_duration: float, damping: str) -> dict[str, Parameter]:
    """Parameters of runs whose duration is a number of static stick times."""
    text = "least duration after settling, in static stick times t0 = mu F / (k_t V)"
    return {"loading_times": Parameter(count, "1", text, common=True)} | _limits(
        min_duration, max_duration, damping
    )


def _limits(min_duration: float, max_duration: float, numerical_damping: str) -> dict[str, Parameter]:
    return {
        "min_duration": Parameter(min_duration, "s", "least simulated time after settling", common=True),
        "max_duration": Parameter(max_duration, "s", "longest simulated time", common=True),
    } | RUN | {"numerical_damping": replace(RUN["numerical_damping"], default=numerical_damping)}  # fmt: skip


def members(count: int) -> dict[str, Parameter]:
    """The parameter for the number of realisations."""
    return {
        "members": Parameter(count, "1", "number of realisations; they differ by the drive's ramp", common=True)
    }


def check(V: Any, F: Any, ramp: Any, max_duration: Any, min_duration: Any, **others: Any) -> None:
    """Refuse a ramp of zero, durations out of range, and parameters that `run.check` refuses."""
    for value in np.ravel(ramp):
        # Without a ramp all realisations would be one.
        checks.between("ramp", value, 1e-9, 1e3, "s, for realisations differ by it")
    checks.count("members", np.max(others.get("members", 1)), MOST_MEMBERS)
    checks.between("max_duration", np.min(max_duration), 1e-3, 1e6, "s")
    if "loading_times" in others:
        checks.between("loading_times", np.min(others["loading_times"]), 0.0, 1e6, "static stick times")
    Until(np.min(others.get("standard_error", 1.0)), np.max(min_duration), np.min(max_duration))
    run = {name: others[name] for name in ("cutoff", "skip_long_sticks", "numerical_damping")}
    runs.check(V, F, ramp, **run)


def duration(scene: Scene, ramp: float, options: Mapping[str, Any]) -> float | Until:
    """Duration of a run: until its statistics are known, or a time, s.

    A time includes the loading until the first slip, the settling, and then at least `min_duration` and at least
    `loading_times` static stick times, so that a scene that sticks and slips does so that often. It is at most
    `max_duration`.
    """
    least, most = options["min_duration"], options["max_duration"]
    if "loading_times" not in options:
        return Until(options["standard_error"], least, most)
    once = loading_time(scene)
    settled = 0.5 * ramp + once + runs.SETTLING
    return float(min(settled + max(least, options["loading_times"] * once), most))


def realisation(scene: Scene, number: float, options: Mapping[str, Any]) -> Job:
    """One run of a scene; realisations are numbered from 1."""
    ramp = options["ramp"] * (1.0 + STRETCH * (number - 1.0))
    run = {name: options[name] for name in RUN} | {"ramp": ramp}
    return runs.job(scene, duration(scene, ramp, options), run)


def ensemble(scene: Scene, members: int, options: Mapping[str, Any]) -> list[Job]:
    """The first realisations of a scene."""
    return [realisation(scene, number, options) for number in range(1, members + 1)]


def summaries(results: Sequence[Transient]) -> dict[str, NDArray[Any]]:
    """Every variable of `run.SUMMARY` of each realisation, (members,)."""
    values = [runs.summary_of(run) for run in results]
    return {name: np.array([each[name] for each in values]) for name in values[0]}


def majority(regimes: NDArray[Any]) -> tuple[int, NDArray[np.intp]]:
    """The regime of most realisations, and the number of realisations in each of `run.REGIMES`.

    Of equally frequent regimes the one listed last counts: vibration before rest, and any regime before
    "undecided".
    """
    counts = np.bincount(regimes, minlength=len(runs.REGIMES))
    return len(counts) - 1 - int(np.argmax(counts[::-1])), counts


def of(name: str, how: str, digits: int, *dims: str) -> Variable:
    """A variable of `run.SUMMARY` from realisations of a normalised scene."""
    variable, scale = runs.SUMMARY[name], "load" if name in runs.SCALED else ""
    text = f"{variable.long_name}, {how}"
    return replace(variable, long_name=text, dtype="float32", digits=digits, scale=scale, dims=dims)


def motion_outputs() -> dict[str, Variable]:
    """Variables of `motions`."""
    flags, along = {NONE: "none", **dict(enumerate(runs.REGIMES))}, ("motion",)
    how = "mean over the realisations in a motion"
    text = f"number of motions that the realisations follow, up to {mixed.MOST}"
    return {
        "motions": Variable("1", text, (), "int8"),
        "member_motion": Variable("1", "motion of each realisation; 0: none", ("member",), "int8"),
        "motion_share": Variable("1", "fraction of the realisations in a motion", along, "float32", 6),
        "motion_regime": Variable("1", "regime of most realisations in a motion", along, "int8", flags=flags),
    } | {f"motion_{name}": of(name, how, 5, "motion") for name in mixed.QUANTITIES}


def outputs() -> dict[str, Variable]:
    """Variables of `statistics`; of normalised scenes."""
    regime = runs.SUMMARY["regime"]
    certainty = "probability that more than half of all realisations of the scene are in this regime"
    return (
        {
            "regime": replace(regime, long_name="regime of most realisations"),
            "regime_certainty": Variable("1", certainty, (), "float32", 6),
            "regime_share": Variable("1", "fraction of the realisations in a regime", ("kind",), "float32", 6),
            "member_regime": replace(regime, long_name="regime of each realisation", dims=("member",)),
        }
        | {f"member_{name}": of(name, "of each realisation", 5, "member") for name in mixed.QUANTITIES}
        | motion_outputs()
        | {name: of(name, HOW.get(name, "mean over realisations"), 5) for name in QUANTITIES}
        | {f"{name}_std": of(name, "standard deviation over realisations", 4) for name in SPREAD}
    )


def coords(members: int) -> dict[str, Axis]:
    """The regimes, and the realisations from 1 on."""
    return {
        "kind": Axis(np.array(runs.REGIMES), long_name="regime"),
        "member": Axis(np.arange(1, members + 1), "1", "realisation (ensemble member)"),
    } | APART


def statistics(results: Sequence[Transient]) -> dict[str, Any]:
    """Values of `outputs` from the realisations of one scene.

    A quantity is the mean of its finite values; a quantity in LARGEST is the largest of them, one in MIDDLE the
    lower median. It is NaN without finite values, and a standard deviation is NaN for fewer than two. The standard
    error of a mean follows from those of the realisations. Where realisations follow different motions, or a
    standard error is not known, it is at least the one that follows from their spread.
    """
    found = summaries(results)
    regimes, apart = found["regime"], motions(found, results[0].scene.V)
    regime, certainty = vote(regimes)
    values: dict[str, Any] = (
        {
            "regime": regime,
            "regime_certainty": certainty,
            "regime_share": majority(regimes)[1] / len(regimes),
            "member_regime": regimes,
        }
        | {f"member_{name}": found[name] for name in mixed.QUANTITIES}
        | apart
    )
    for name in QUANTITIES:
        finite = found[name][np.isfinite(found[name])]
        how: Any = np.max if name in LARGEST else middle if name in MIDDLE else np.mean
        how = of_mean if name.endswith("_se") else how
        values[name] = float(how(finite)) if len(finite) else np.nan
        if name in SPREAD:
            values[f"{name}_std"] = finite.std(ddof=1) if len(finite) > 1 else np.nan
        if name.endswith("_se"):
            known = found[name.removesuffix("_se")]
            known = known[np.isfinite(known)]
            if len(finite) and len(known) > 1 and (apart["motions"] > 1 or len(finite) < len(known)):
                values[name] = max(values[name], float(known.std(ddof=1) / np.sqrt(len(known))))
    return values


def motions(found: Mapping[str, NDArray[Any]], V: float) -> dict[str, Any]:
    """Values of `motion_outputs` from the `summaries` of a scene with this speed of the drive, m/s."""
    apart, regimes = mixed.motions(found, V), found["regime"]
    member, none = np.zeros(len(regimes), dtype=int), mixed.MOST - len(apart)
    for k, part in enumerate(apart):
        member[part] = k + 1
    means = {f"motion_{n}": [found[n][part].mean() for part in apart] for n in mixed.QUANTITIES}
    means["motion_share"] = [len(part) / len(regimes) for part in apart]
    kinds = [majority(regimes[part])[0] for part in apart] + [NONE] * none
    own = {"motions": len(apart), "member_motion": member, "motion_regime": kinds}
    return own | {name: value + [np.nan] * none for name, value in means.items()}


def vote(regimes: NDArray[Any]) -> tuple[int, float]:
    """The regime of most realisations, and the probability that more than half of all would be in it.

    The probability follows by Bayes with Jeffreys' prior: 0.985 for 4 of 4 realisations, 0.84 for 3, 0.5 for 2.
    """
    most, counts = majority(regimes)
    inside = int(counts[most])
    return most, float(betaincc(inside + 0.5, len(regimes) - inside + 0.5, 0.5))


def of_mean(errors: NDArray[Any]) -> float:
    """Standard error of the mean of realisations, from the standard errors of each."""
    return float(np.sqrt(np.sum(errors**2)) / len(errors))


def middle(values: NDArray[Any]) -> float:
    """The lower median of the finite values, which is one of them: between two spectral peaks there is no peak."""
    ordered = np.sort(values[np.isfinite(values)])
    return float(ordered[(len(ordered) - 1) // 2]) if len(ordered) else float("nan")


def average_outputs() -> dict[str, Variable]:
    """Variables of `averages`; of scenes as they are."""

    def of(name: str, how: str, *dims: str) -> Variable:
        return replace(runs.SUMMARY[name], long_name=f"{runs.SUMMARY[name].long_name}, {how}", dims=dims)

    return {
        "regime": replace(runs.SUMMARY["regime"], long_name="regime of most realisations"),
        "regime_share": Variable("1", "fraction of the realisations in the regime of most"),
        "dominant_frequency": of("dominant_frequency", "lower median of the vibrating realisations"),
        **{name: of(name, "mean of the realisations") for name in AVERAGED},
        **{f"member_{name}": of(name, "of one realisation", "member") for name in KEPT},
        **{name: replace(each, scale="") for name, each in motion_outputs().items()},
    }


def averages(results: Sequence[Transient]) -> dict[str, Any]:
    """Regimes and statistics of each realisation of a scene, and of all realisations together."""
    found = summaries(results)
    one = {name: found[name] for name in KEPT}
    vibrates = is_of(one["regime"], *VIBRATING)
    one["dominant_frequency"] = np.where(vibrates, one["dominant_frequency"], np.nan)
    most, counts = majority(one["regime"])
    together = {name: one[name].mean() for name in AVERAGED}
    together |= {"regime": most, "regime_share": counts[most] / len(results)}
    together["dominant_frequency"] = middle(one["dominant_frequency"])
    own = {f"member_{name}": values for name, values in one.items()}
    return together | own | motions(found, results[0].scene.V)
