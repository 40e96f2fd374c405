"""Run time against error: every method and setting on the same scenes, beside what one would use instead."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from fivcore import checks
from studies import paper
from studies.accuracy import runs
from studies.accuracy import settings as choices
from studies.accuracy.errors import with_errors
from studies.accuracy.findings import findings
from studies.motion import ensembles, transients
from studies.rig import rig_of, rig_settings
from studies.study import Setting, Study, deferred
from sweeps import Axis, Variable

MOST_MEMBERS = 100
# This alone is not the same whenever it is computed.
COSTS = {"cpu_per_second": Variable("1", "CPU time of a run per simulated second, nothing of the run beside it")}
VARIABLES = {
    **COSTS,
    "step": Variable("s", "time step"),
    "modes": Variable("1", "number of modes"),
    **{
        name: Variable(each.units, f"{each.long_name}, of each repeat run", ("member",))
        for name, each in transients.SUMMARY.items()
        if name in runs.KEPT
    },
    "observed_time": Variable("s", "time simulated after settling, of each repeat run", ("member",)),
    "rival_lines": Variable(
        "Hz", "peaks of the reference at least half as strong as the dominant one", ("rival",)
    ),
}


def points(points: Mapping[str, Any], **fixed: Any) -> dict[str, Any]:
    """Cost and figures of each method, setting and scene: one point at a time, on one thread."""
    values = []
    for method, setting, scene in zip(points["method"], points["setting"], points["scene"], strict=True):
        with runs.TURN:
            start = time.perf_counter()
            own = point(method, setting, scene, fixed)
            values.append(own | {"wall_time": time.perf_counter() - start})
    return {name: np.stack([each[name] for each in values]) for name in values[0]}


def point(method: str, setting: str, scene: str, fixed: Mapping[str, Any]) -> dict[str, Any]:
    """Every variable of one point, NaN where it does not belong to the method."""
    own = choices.scene_of(scene, fixed["rig"])
    return blank(fixed) | runs.measured(method, choices.OPTIONS[setting], own, fixed)


def blank(fixed: Mapping[str, Any]) -> dict[str, Any]:
    """NaN for every variable of a point."""
    sizes = {dim: len(axis) for dim, axis in coords(**fixed).items()}
    return {name: np.full([sizes[dim] for dim in each.dims], np.nan) for name, each in VARIABLES.items()}


def constants(settings: Mapping[str, float]) -> dict[str, Any]:
    """The rig, and the settings that do not belong to it."""
    rig, _ = rig_of({**settings, "theta": paper.THETA})
    members = checks.count("members", settings["members"], MOST_MEMBERS)
    expensive = checks.count("members_expensive", settings["members_expensive"], members)
    own = {name: settings[name] for name in SETTINGS}
    return own | {"members": members, "members_expensive": expensive, "rig": rig}


def coords(*, members: int, **_: Any) -> dict[str, Axis]:
    """The repeat runs and the rival peaks, counted from 1."""
    return {
        "member": Axis(np.arange(1, members + 1), "1", "repeat run, by the ramp of the drive"),
        "rival": Axis(np.arange(1, runs.RIVALS + 1), "1", "peak, by its strength"),
    }


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse, before anything is planned, runs that are too short or all alike."""
    checks.between("ramp", fixed["ramp"], 1e-6, 1.0, "s, for repeat runs differ by it")
    names = axes["scene"].values.tolist()
    loading = max(ensembles.loading_time(choices.scene_of(name, fixed["rig"])) for name in names)
    # After settling the slowest has some windows of its spectrum.
    longest = fixed["ramp"] + loading + transients.SETTLING + 4.0 * transients.WINDOW
    checks.between("duration", fixed["duration"], longest, 1e3, "s, for the slowest scene to have settled")


SETTINGS = {
    "duration": Setting(1.2, "s", "simulated time of each run"),
    "members": Setting(10.0, "1", "runs of each scene and setting of fast"),
    "members_expensive": Setting(1.0, "1", "runs of each scene and setting of paper and exact"),
    "ramp": Setting(1e-3, "s", "time in which P2's clamp reaches its velocity"),
}
STUDY = Study(
    name="accuracy",
    title="Run time against error",
    question="What does each method cost, how wrong is it, and which setting is the cheapest that is right?",
    paper="Section 3.3: one scheme, in finite elements, at a step of 2e-8 s with beta2 = 0.8. Its cost and its "
    "error are not in the paper.",
    axes={
        "method": Axis(choices.METHODS, long_name="method of integration"),
        "setting": Axis(list(choices.OPTIONS), long_name="setting that differs from the default, and its value"),
        "scene": Axis(choices.SCENES, long_name="scene: the paper's rig by speed, rigs drawn at random by number"),
    },
    settings=SETTINGS | {name: each for name, each in rig_settings().items() if name != "theta"},
    function=points,
    variables=VARIABLES,
    constants=constants,
    coords=coords,
    check=check,
    skip=choices.skip,
    derive=with_errors,
    draw=deferred("studies.accuracy.figure:draw"),
    findings=findings,
)
