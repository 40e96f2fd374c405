"""Ensembles: runs of one scene that chaos makes independent, as long as the scene's own time scale asks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Scene, Transient, Until, checks
from fivcore.transient.normalised import Normalised, slip_distance
from studies.motion import transients
from studies.motion.jobs import Job, check_jobs
from studies.study import Setting
from sweeps import Axis, InputError

# Repeat runs differ by the ramp of the drive: each is longer than the one before by this share of the first. Its
# effect on averages is gone within milliseconds of the first separation, but no two runs then move alike.
STRETCH = 0.013
# Settings of the duration of a run: until its shares of time are known, or for so many loading times to slip.
KNOWN = Setting(0.005, "1", "largest standard error of a share of time at which a run ends")
LOADING_TIMES = "least time after settling, in loading times to slip"
SETTINGS = ("standard_error", "loading_times", "least", "most")
# Settings of each run besides.
RUN = ("ramp", "cutoff", "leap", "numerical_damping")


def settings(
    least: float, most: float, numerical_damping: str = transients.NONE, **rule: Setting
) -> dict[str, Setting]:
    """Settings of runs whose length is decided by a `rule`: `standard_error` or `loading_times`."""
    run = transients.run_settings(most, numerical_damping)
    return (
        rule
        | {
            "least": Setting(least, "s", "least time simulated after settling"),
            "most": Setting(most, "s", "longest simulated time"),
        }
        | {name: run[name] for name in RUN}
    )


def shared(settings: Mapping[str, float]) -> dict[str, Any]:
    """Settings that all repeat runs share."""
    names = (*RUN, *(name for name in SETTINGS if name in settings))
    return {name: settings[name] for name in names} | {"method": transients.METHOD}


def check(fixed: Mapping[str, Any]) -> None:
    """Refuse a ramp of zero, and settings of the duration that are out of range."""
    # Without a ramp all repeat runs would be one.
    checks.between("ramp", fixed["ramp"], 1e-9, 1e3, "s, for repeat runs differ by it")
    if "loading_times" in fixed:
        checks.between("loading_times", fixed["loading_times"], 0.0, 1e6, "loading times to slip")
    checks.between("most", fixed["most"], 1e-3, 1e6, "s")
    until({"standard_error": 1.0, **fixed})


def check_grid(axes: Mapping[str, Axis], fixed: Mapping[str, Any], **more: float) -> None:
    """Refuse, before anything is planned, a grid of normalised scenes that cannot be run.

    A scene whose contact has no unique solution is not refused: its point fails by itself.
    """
    check(fixed)
    slowest = float(axes["V"].values.min())
    if slowest <= 0.0:
        raise InputError(f"V = {slowest:g}: it must be above 0; the mirror image has -V and -theta")
    ends = transients.extremes(axes, fixed["rig"], **more)
    check_jobs([member(scene, fixed.get("members", 1), fixed, 1e-6) for scene in ends])


def ramp_of(member: Any, ramp: float) -> Any:
    """The ramp of a repeat run, counted from 1, s."""
    return ramp * (1.0 + STRETCH * (member - 1.0))


def loading_time(scene: Scene) -> float:
    """Loading time to slip, s: the drive loads a stuck contact from rest until it slips, in mu F / (k_t V)."""
    normalised = Normalised.of(scene)
    return slip_distance(normalised) / normalised.speed_per_load


def until(fixed: Mapping[str, Any]) -> Until:
    """The rule that ends a run whose duration is not given."""
    return Until(fixed["standard_error"], fixed["least"], fixed["most"])


def own_duration(scene: Scene, ramp: float, fixed: Mapping[str, Any]) -> float | Until:
    """How long a scene must run for its statistics: until they are known, or for a time, s.

    The time is that to the first slip, then until it has settled, then at least `least` and at least so many
    loading times to slip, during which a scene that sticks and slips does so as many times; at most `most`.
    """
    least, most = fixed["least"], fixed["most"]
    if "loading_times" not in fixed:
        return until(fixed)
    once = loading_time(scene)
    settled = 0.5 * ramp + once + transients.SETTLING
    return float(min(settled + max(least, fixed["loading_times"] * once), most))


def duration_text(fixed: Mapping[str, Any]) -> str:
    """The rule of the duration, in words."""
    rule = (
        f"at least {fixed['loading_times']:g} loading times to slip"
        if "loading_times" in fixed
        else (f"until the shares of time are known to {fixed['standard_error']:g}")
    )
    return f"{rule}, at least {fixed['least']:g} s, {fixed['most']:g} s in all at most"


def member(scene: Scene, number: float, fixed: Mapping[str, Any], duration: float | Until | None = None) -> Job:
    """One repeat run of a scene, by its number from 1 on."""
    own = {**fixed, "ramp": ramp_of(number, fixed["ramp"])}
    return transients.job(scene, own, own_duration(scene, own["ramp"], fixed) if duration is None else duration)


def ensemble(scene: Scene, members: int, fixed: Mapping[str, Any]) -> list[Job]:
    """The first repeat runs of a scene."""
    return [member(scene, number, fixed) for number in range(1, members + 1)]


def figures_of(runs: Sequence[Transient]) -> dict[str, NDArray[Any]]:
    """Every figure of `studies.motion.transients.SUMMARY` of each repeat run, (members,)."""
    figures = [transients.figures_of(run) for run in runs]
    return {name: np.array([each[name] for each in figures]) for name in figures[0]}


def majority(regimes: NDArray[Any]) -> tuple[int, NDArray[np.intp]]:
    """The regime of most repeat runs, and how many are in each of `studies.motion.transients.REGIMES`.

    Of regimes with equally many runs it is the one that comes last: a vibration goes before rest, and anything
    before "undecided".
    """
    counts = np.bincount(regimes, minlength=len(transients.REGIMES))
    return len(counts) - 1 - int(np.argmax(counts[::-1])), counts


def middle(values: NDArray[Any]) -> float:
    """The lower median of the values there are: one of them, for half-way between two rival peaks lies none."""
    ordered = np.sort(values[np.isfinite(values)])
    return float(ordered[(len(ordered) - 1) // 2]) if len(ordered) else float("nan")
