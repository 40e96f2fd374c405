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

# Members differ by the ramp of the drive: each is longer than the one before by this share of the first. Motion
# forgets it within milliseconds of the first separation, but no two members then move alike.
STRETCH = 0.013
# What says how long a member runs: until its shares of time are known, or for so many load-ups.
KNOWN = Setting(0.005, "1", "largest standard error of a share of time at which a run ends")
LOAD_UPS = "least time after settling, in times that a stuck contact takes to slip"
SETTINGS = ("standard_error", "load_ups", "least", "most")
# What else is asked of it.
RUN = ("ramp", "cutoff", "leap", "numerical_damping")


def settings(
    least: float, most: float, numerical_damping: str = transients.NONE, **rule: Setting
) -> dict[str, Setting]:
    """Settings of runs whose length is decided by a `rule`: `standard_error` or `load_ups`."""
    run = transients.run_settings(most, numerical_damping)
    return (
        rule
        | {
            "least": Setting(least, "s", "least time simulated after settling"),
            "most": Setting(most, "s", "longest simulated time"),
        }
        | {name: run[name] for name in RUN}
    )


def held(settings: Mapping[str, float]) -> dict[str, Any]:
    """What every run of an ensemble has in common."""
    names = (*RUN, *(name for name in SETTINGS if name in settings))
    return {name: settings[name] for name in names} | {"method": transients.METHOD}


def check(fixed: Mapping[str, Any]) -> None:
    """Refuse settings that say nothing of how long a run is to be."""
    # Without a ramp all members would be one run.
    checks.between("ramp", fixed["ramp"], 1e-9, 1e3, "s, for members differ by it")
    if "load_ups" in fixed:
        checks.between("load_ups", fixed["load_ups"], 0.0, 1e6, "load-ups")
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
    """The ramp of a member, counted from 1, s."""
    return ramp * (1.0 + STRETCH * (member - 1.0))


def load_up(scene: Scene) -> float:
    """Time in which the drive loads a stuck contact from rest until it slips, s: mu F / (k_t V)."""
    normalised = Normalised.of(scene)
    return slip_distance(normalised) / normalised.speed_per_load


def until(fixed: Mapping[str, Any]) -> Until:
    """What ends a run whose length is not given."""
    return Until(fixed["standard_error"], fixed["least"], fixed["most"])


def own_duration(scene: Scene, ramp: float, fixed: Mapping[str, Any]) -> float | Until:
    """How long a scene must run for its statistics: until they are known, or for a time, s.

    The time is that to the first slip, then until it has settled, then at least `least` and at least so many
    load-ups, during which a scene that sticks and slips does so as many times; but no longer than `most`.
    """
    least, most = fixed["least"], fixed["most"]
    if "load_ups" not in fixed:
        return until(fixed)
    once = load_up(scene)
    settled = 0.5 * ramp + once + transients.SETTLING
    return float(min(settled + max(least, fixed["load_ups"] * once), most))


def told(fixed: Mapping[str, Any]) -> str:
    """How long runs last, in words."""
    rule = (
        f"at least {fixed['load_ups']:g} load-ups"
        if "load_ups" in fixed
        else (f"until the shares of time are known to {fixed['standard_error']:g}")
    )
    return f"{rule}, at least {fixed['least']:g} s, {fixed['most']:g} s in all at most"


def member(scene: Scene, number: float, fixed: Mapping[str, Any], duration: float | Until | None = None) -> Job:
    """The run of one member of a scene's ensemble, by its number from 1 on."""
    own = {**fixed, "ramp": ramp_of(number, fixed["ramp"])}
    return transients.job(scene, own, own_duration(scene, own["ramp"], fixed) if duration is None else duration)


def ensemble(scene: Scene, members: int, fixed: Mapping[str, Any]) -> list[Job]:
    """The runs of the first members of a scene's ensemble."""
    return [member(scene, number, fixed) for number in range(1, members + 1)]


def figures_of(runs: Sequence[Transient]) -> dict[str, NDArray[Any]]:
    """Every figure of `studies.motion.transients.SUMMARY` of each member, (members,)."""
    figures = [transients.figures_of(run) for run in runs]
    return {name: np.array([each[name] for each in figures]) for name in figures[0]}


def majority(regimes: NDArray[Any]) -> tuple[int, NDArray[np.intp]]:
    """The regime that most members are in, and how many are in each of `studies.motion.transients.REGIMES`.

    Of regimes with equally many members it is the one that comes last: a vibration goes before rest, and anything
    before "undecided".
    """
    counts = np.bincount(regimes, minlength=len(transients.REGIMES))
    return len(counts) - 1 - int(np.argmax(counts[::-1])), counts


def middle(values: NDArray[Any]) -> float:
    """The lower median of the values there are: one of them, for half-way between two rival lines lies none."""
    known = np.sort(values[np.isfinite(values)])
    return float(known[(len(known) - 1) // 2]) if len(known) else float("nan")
