"""Run time against error: every method and setting on the same scenes, beside what one would use instead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from fivcore import checks
from fivcore.contact.reduced import TERMINATIONS, full_model
from fivcore.transient.published import STEP
from studies.accuracy import runs as accuracy_runs
from studies.accuracy import settings as asked
from studies.accuracy.burst import burst
from studies.accuracy.errors import with_errors
from studies.accuracy.findings import findings
from studies.accuracy.linear import stability
from studies.motion import transients
from studies.motion.jobs import Job, check_jobs
from studies.rig import rig_of, rig_settings
from studies.study import Setting, Study, deferred
from sweeps import Axis, Grid, Sweep, Variable

MOST_MEMBERS = 100
# These alone are not the same whenever they are computed.
COSTS = {
    "cpu_per_second": "processor time of one run alone",
    "wall_per_second": "wall time of one run alone",
    "batch_cpu_per_second": "processor time of each run of an ensemble computed together",
}
VARIABLES = {
    **{name: Variable("1", f"{what} per simulated second") for name, what in COSTS.items()},
    "step": Variable("s", "time step"),
    "modes": Variable("1", "number of modes"),
    **{
        name: Variable(each.units, f"{each.long_name}, of each member", ("member",))
        for name, each in transients.SUMMARY.items()
        if name in accuracy_runs.FIGURES
    },
    "observed_time": Variable("s", "time simulated after settling, of each member", ("member",)),
    "stick_time": Variable("s", "duration of each long stick", ("member", "stick"), "float32", digits=5),
    "band_power": Variable(
        "m2 s-2", "mean square of the velocity of B in a third-octave band, of each member", ("member", "band")
    ),
    **{
        f"{stretch}_{name}_error": Variable("1", f"largest error of the {what} {when}, over its largest value")
        for stretch, when in (("slip", "half-way to the first separation"), ("burst", "to the first separation"))
        for name, what in (("velocity", "velocity of B"), ("force", "normal force"))
    },
    "burst_delay_error": Variable("1", "error of the time from first slip to first separation, over it"),
    "gave_up_time": Variable("s", "when an integrator could not go on"),
    "onset_mu": Variable("1", "lowest coefficient of friction at which sliding flutters", ("termination",)),
    "growth_rate": Variable("s-1", "growth rate of sliding's least stable mode", ("termination",)),
}


def points(points: Mapping[str, Any], **fixed: Any) -> dict[str, Any]:
    """Costs, figures and errors of each method, setting and scene, one after the other, for they are timed."""
    found = []
    for place in zip(*(points[name].tolist() for name in ("method", "setting", "scene")), strict=True):
        one, cost = accuracy_runs.timed(partial(_one, place, fixed))
        found.append(one | {"wall_time": cost.wall})
    return {name: np.stack([each[name] for each in found]) for name in found[0]}


def _one(place: tuple[int, int, int], fixed: Mapping[str, Any]) -> dict[str, Any]:
    """Every variable of one point, NaN where it does not belong to the method."""
    method, setting, number = place
    option, scene = asked.OPTIONS[setting], asked.scene_of(number, fixed["rig"])
    sizes = {name: len(axis) for name, axis in coords(fixed).items()}
    found: dict[str, Any] = {
        name: np.full([sizes[dim] for dim in each.dims], np.nan) for name, each in VARIABLES.items()
    }
    if method == asked.LINEAR:
        return found | stability(scene, option)
    own = asked.meshed(scene, option)
    given = asked.arguments(method, option, own)
    if method in asked.SIMULATED:
        found |= accuracy_runs.ensemble(method, option, own, given, fixed)
    found |= burst(method, option, own, given, fixed["ramp"], accuracy_runs.most_members(fixed))
    if method in (asked.PAPER, asked.ELEMENTS):
        return found | {"step": given.get("step", STEP), "modes": len(full_model(own.rig, own.theta).stiffness)}
    model = asked.model_of(own, given)
    step = given.get("step", model.default_step) if method == asked.FAST else np.nan
    return found | {"step": step, "modes": len(model.stiffness)}


def coords(fixed: Mapping[str, Any]) -> dict[str, Axis]:
    """What the variables of a point run over."""
    return {
        "member": Axis(
            np.arange(1, accuracy_runs.most_members(fixed) + 1), "1", "member; members differ by the drive's ramp"
        ),
        "stick": Axis(np.arange(1, accuracy_runs.KEPT + 1), "1", "long stick, in the order in which they begin"),
        "band": Axis(10.0 ** (accuracy_runs.BANDS / 10.0), "Hz", "centre of a third-octave band"),
        "termination": Axis(np.array(TERMINATIONS), long_name="what stands for the modes above the cut-off"),
    }


def key(points: Mapping[str, Any]) -> np.ndarray:
    """Equal rows for points that are one computation: sliding stability knows neither speed nor load."""
    method, setting, scene = (np.asarray(points[name], dtype=float) for name in ("method", "setting", "scene"))
    alike = np.array([each[2:4] for each in asked.SCENES])[scene.astype(int)]
    linear = method == asked.LINEAR
    return np.column_stack([method, setting, np.where(linear, -1.0, scene), np.where(linear[:, None], alike, 0.0)])


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Find out, before anything is planned, what cannot be run.

    Raises
    ------
    ValueError
        Naming the axis or setting.
    """
    for name, known in (("method", asked.METHODS), ("setting", asked.OPTIONS), ("scene", asked.SCENES)):
        values = axes[name].values
        strange = values[(values < 0) | (values >= len(known))]
        if len(strange):
            raise ValueError(f"{name} = {strange[0]}: it must be a whole number from 0 to {len(known) - 1}")
    for name in ("members", "reference_members", "variant_members", "recorded"):
        checks.count(name, fixed[name], MOST_MEMBERS)
    checks.between("ramp", fixed["ramp"], 1e-6, 1.0, "s, for members differ by it")
    scenes = [asked.scene_of(int(number), fixed["rig"]) for number in axes["scene"].values]
    longest = max(accuracy_runs.shortest(scene, fixed) for scene in scenes)
    check_jobs([Job(scene, 1e-6, {"ramp": fixed["ramp"]}) for scene in scenes])
    for name in ("duration", "variant_duration"):
        checks.between(name, fixed[name], longest, 1e3, "s, for the slowest scene to have settled")


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """The sweep over methods, their settings and the scenes; what does not go together is skipped."""
    rig, _ = rig_of({**settings, "theta": 0.0})
    names = ("duration", "members", "recorded", "reference_members", "variant_duration", "variant_members", "ramp")
    fixed: dict[str, Any] = {name: settings[name] for name in names} | {"rig": rig}
    check(axes, fixed)
    fixed |= {name: int(fixed[name]) for name in names if name.endswith("members") or name == "recorded"}
    return Sweep(
        "accuracy",
        points,
        Grid(axes, skip=asked.skip),
        VARIABLES,
        fixed,
        key=key,
        coords=coords(fixed),
        title="Run time against error, by method and setting",
        derive=partial(with_errors, rig=rig),
    )


def _numbered(names: Sequence[str]) -> str:
    return ", ".join(f"({k}) {name}" for k, name in enumerate(names))


STUDY = Study(
    name="accuracy",
    title="Run time against error",
    question="What does each method cost, how wrong is it, and which setting is the cheapest that is right?",
    paper="Section 3.3: one scheme, in finite elements, at a step of 2e-8 s with beta2 = 0.8. Its cost and its "
    "error are not in the paper.",
    axes={
        "method": Axis(np.arange(len(asked.METHODS)), "1", f"method: {_numbered(asked.METHODS)}"),
        "setting": Axis(
            np.arange(len(asked.OPTIONS)), "1", "setting, 0 being the default; setting_name tells all"
        ),
        "scene": Axis(
            np.arange(len(asked.SCENES)), "1", f"scene: {_numbered([each[0] for each in asked.SCENES])}"
        ),
    },
    settings={
        "duration": Setting(2.0, "s", "simulated time of each run of fast, of exact, and of paper by default"),
        "members": Setting(16.0, "1", "runs of each scene and setting of fast"),
        "recorded": Setting(4.0, "1", "of those, how many have a spectrum"),
        "reference_members": Setting(4.0, "1", "runs of each scene of paper by default, the reference"),
        "variant_duration": Setting(0.8, "s", "simulated time of each run of paper's other settings"),
        "variant_members": Setting(2.0, "1", "runs of each scene of exact, and of paper's other settings"),
        "ramp": Setting(1e-3, "s", "time in which P2's clamp reaches its velocity"),
    }
    | {name: each for name, each in rig_settings().items() if name != "theta"},
    build=build,
    draw=deferred("studies.accuracy.figure:draw"),
    findings=findings,
)
