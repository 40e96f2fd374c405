"""Ensembles: runs of one scene that chaos makes independent, as long as the scene's own time scale asks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Scene, Transient, checks
from fivcore.transient.normalised import Normalised, slip_distance
from studies.motion import transients
from studies.motion.jobs import Job, check_jobs
from studies.study import Setting
from sweeps import Axis, InputError

# Members differ by the ramp of the drive: each is longer than the one before by this share of the first. Motion
# forgets it within milliseconds of the first separation, but no two members then move alike.
STRETCH = 0.013
# What says how long a member runs.
SETTINGS = ("least", "load_ups", "most")
# What else is asked of it.
RUN = ("ramp", "cutoff", "leap", "numerical_damping")


def settings(
    least: float, load_ups: float, most: float, numerical_damping: str = transients.NONE
) -> dict[str, Setting]:
    """Settings of runs as long as their own time scale asks (`own_duration`)."""
    run = transients.run_settings(most, numerical_damping)
    slip = "least time after settling, in times that a stuck contact takes to slip"
    return {
        "least": Setting(least, "s", "least time simulated after settling"),
        "load_ups": Setting(load_ups, "1", slip),
        "most": Setting(most, "s", "longest simulated time"),
    } | {name: run[name] for name in RUN}


def held(settings: Mapping[str, float]) -> dict[str, Any]:
    """What every run of an ensemble has in common."""
    return {name: settings[name] for name in (*RUN, *SETTINGS)} | {"method": transients.METHOD}


def check(fixed: Mapping[str, Any]) -> None:
    """Refuse settings that say nothing of how long a run is to be."""
    # Without a ramp all members would be one run.
    checks.between("ramp", fixed["ramp"], 1e-9, 1e3, "s, for members differ by it")
    checks.between("least", fixed["least"], 0.0, 1e6, "s")
    checks.between("load_ups", fixed["load_ups"], 0.0, 1e6, "load-ups")
    checks.between("most", fixed["most"], 1e-3, 1e6, "s")


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


def own_duration(scene: Scene, ramp: float, least: float, load_ups: float, most: float) -> float:
    """How long a scene must run for its statistics, s.

    To the first slip, then until it has settled, then at least the time `least` and at least so many load-ups,
    during which a scene that sticks and slips does so as many times; but no longer than `most`.
    """
    once = load_up(scene)
    return min(0.5 * ramp + once + transients.SETTLING + max(least, load_ups * once), most)


def member(scene: Scene, number: float, fixed: Mapping[str, Any], duration: float) -> Job:
    """The run of one member of a scene's ensemble, by its number from 1 on."""
    return transients.job(scene, {**fixed, "ramp": ramp_of(number, fixed["ramp"])}, duration)


def ensemble(scene: Scene, members: int, fixed: Mapping[str, Any], *rule: float) -> list[Job]:
    """The runs of the first members of a scene's ensemble; `rule` says how long they are (`own_duration`)."""
    duration = own_duration(scene, fixed["ramp"], *rule)
    return [member(scene, number, fixed, duration) for number in range(1, members + 1)]


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
