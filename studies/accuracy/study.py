"""Run time against error: every method and setting on the same scenes, beside what one would use instead."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from fivcore import Scene, checks
from fivcore.contact.reduced import TERMINATIONS, full_model
from fivcore.transient.published import STEP
from studies import paper
from studies.accuracy import runs
from studies.accuracy import settings as choices
from studies.accuracy.errors import with_errors
from studies.accuracy.findings import findings
from studies.accuracy.linear import stability
from studies.motion import ensembles, transients
from studies.rig import rig_of, rig_settings
from studies.study import Setting, Study, deferred
from sweeps import Axis, Variable

MOST_MEMBERS = 100
# These alone are not the same whenever they are computed.
COSTS = {
    "cpu_per_second": "processor time of one run alone",
    "batch_cpu_per_second": "processor time of each run of an ensemble computed together",
}
VARIABLES = {
    **{name: Variable("1", f"{what} per simulated second") for name, what in COSTS.items()},
    "step": Variable("s", "time step"),
    "modes": Variable("1", "number of modes"),
    **{
        name: Variable(each.units, f"{each.long_name}, of each member", ("member",))
        for name, each in transients.SUMMARY.items()
        if name in runs.FIGURES
    },
    "observed_time": Variable("s", "time simulated after settling, of each member", ("member",)),
    "stick_time": Variable("s", "duration of each long stick", ("member", "stick"), "float32", digits=5),
    "slip_velocity_error": Variable(
        "1", "largest error of the velocity of B half-way to the first separation, over its largest value"
    ),
    "onset_mu": Variable("1", "lowest coefficient of friction at which sliding flutters", ("termination",)),
}


def points(points: Mapping[str, Any], **fixed: Any) -> dict[str, Any]:
    """Costs, figures and errors of each method, setting and scene: one point at a time, for they are timed."""
    values = []
    for method, setting, scene in zip(points["method"], points["setting"], points["scene"], strict=True):
        with runs.TURN:
            start = time.perf_counter()
            own = point(method, setting, scene, fixed)
            values.append(own | {"wall_time": time.perf_counter() - start})
    return {name: np.stack([each[name] for each in values]) for name in values[0]}


def point(method: str, setting: str, scene: str, fixed: Mapping[str, Any]) -> dict[str, Any]:
    """Every variable of one point, NaN where it does not belong to the method."""
    option, sizes = choices.OPTIONS[setting], {dim: len(axis) for dim, axis in coords(**fixed).items()}
    values: dict[str, Any] = {
        name: np.full([sizes[dim] for dim in each.dims], np.nan) for name, each in VARIABLES.items()
    }
    own = choices.meshed(Scene(*choices.SCENES[scene], fixed["rig"]), option)
    if method == choices.LINEAR:
        return values | stability(own, option)
    options, full = choices.arguments(method, option, own), method in (choices.PAPER, choices.ELEMENTS)
    if method in choices.SIMULATED:
        values |= runs.ensemble(method, option, own, options, fixed)
    values |= runs.burst(method, option, own, options, fixed)
    model = full_model(own.rig, own.theta) if full else choices.model_of(own, options)
    values["modes"] = len(model.stiffness)
    if full or method == choices.FAST:
        values["step"] = options.get("step", STEP if full else model.default_step)
    return values


def constants(settings: Mapping[str, float]) -> dict[str, Any]:
    """The rig, and the settings that do not belong to it."""
    rig, _ = rig_of({**settings, "theta": paper.THETA})
    counts = {name: checks.count(name, settings[name], MOST_MEMBERS) for name in SETTINGS if "members" in name}
    return {name: settings[name] for name in SETTINGS} | counts | {"rig": rig}


def coords(**fixed: Any) -> dict[str, Axis]:
    """What the variables of a point run over."""
    members = np.arange(1, runs.most_members(fixed) + 1)
    return {
        "member": Axis(members, "1", "member; members differ by the drive's ramp"),
        "stick": Axis(np.arange(1, runs.KEPT + 1), "1", "long stick, in the order in which they begin"),
        "termination": Axis(np.array(TERMINATIONS), long_name="what stands for the modes above the cut-off"),
    }


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse, before anything is planned, runs that are too short or all alike."""
    checks.between("ramp", fixed["ramp"], 1e-6, 1.0, "s, for members differ by it")
    loading = max(ensembles.load_up(Scene(*choices.SCENES[name], fixed["rig"])) for name in axes["scene"].values)
    # After settling the slowest has some windows of its spectrum.
    longest = fixed["ramp"] + loading + transients.SETTLING + 4.0 * transients.WINDOW
    for name in ("duration", "variant_duration"):
        checks.between(name, fixed[name], longest, 1e3, "s, for the slowest scene to have settled")


SETTINGS = {
    "duration": Setting(2.0, "s", "simulated time of each run of fast, of exact, and of paper by default"),
    "members": Setting(16.0, "1", "runs of each scene and setting of fast"),
    "reference_members": Setting(4.0, "1", "runs of each scene of paper by default, the reference"),
    "variant_duration": Setting(0.8, "s", "simulated time of each run of paper's other settings"),
    "variant_members": Setting(2.0, "1", "runs of each scene of exact, and of paper's other settings"),
    "ramp": Setting(1e-3, "s", "time in which P2's clamp reaches its velocity"),
}
STUDY = Study(
    name="accuracy",
    title="Run time against error",
    question="What does each method cost, how wrong is it, and which setting is the cheapest that is right?",
    paper="Section 3.3: one scheme, in finite elements, at a step of 2e-8 s with beta2 = 0.8. Its cost and its "
    "error are not in the paper.",
    axes={
        "method": Axis(choices.METHODS, long_name="method of integration, or of stability"),
        "setting": Axis(list(choices.OPTIONS), long_name="what is not as by default, and its value"),
        "scene": Axis(list(choices.SCENES), long_name="scene, named by its speed or inclination"),
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
