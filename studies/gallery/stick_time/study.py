"""How long the contact sticks against the speed of the drive: T_st ~ 1/V, at start-up and later."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fivcore import Scene, Transient, checks
from studies import paper
from studies.gallery.stick_time.fit import with_laws
from studies.motion import ensembles, normalised, transients
from studies.motion.jobs import BATCH_MULTIPLE, Job, outcomes
from studies.rig import rig_of, rig_settings
from studies.spec import evenly
from studies.study import Setting, Study, deferred
from sweeps import Axis, Variable

# So many sticks of a run are stored one by one; its counts and totals are of all.
KEPT = 64
# Five times the default, Hz: where bursts are rare, a stick is only as right as they are. At 0.5 mm/s T V is 61 um
# by default, 67 with 1.4 times the cut-off, 70 with twice and with three times; at 0.25 mm/s it is 57 with twice,
# 63 with 3.2 times and 69.5 with five times.
CUTOFF = 585e3
# mm/s.
SPEEDS = (0.25, 0.325, 0.4, 0.5, 0.65, 0.8, 1.0, 1.15, 1.3, 1.45, 1.6, 2.0, 2.6, 3.2, 4.0, 5.0)

VARIABLES = {
    "stick_time": Variable(
        "s", "duration of each long stick, the start-up ones first", ("stick",), "float32", digits=4
    ),
    "start_up_count": Variable("1", "number of long sticks begun before settling", (), "int32"),
    "start_up_total": Variable("s", "time in long sticks begun before settling", (), "float32"),
    "sustained_count": Variable("1", "number of long sticks begun after settling", (), "int32"),
    "sustained_total": Variable("s", "time in long sticks begun after settling", (), "float32"),
    "observed_time": Variable("s", "time simulated after settling", (), "float32"),
    "first_slip_time": Variable("s", "time of the first slip, the end of the first stick", (), "float32"),
    "loading_time": Variable(
        "s", "time in which the drive loads a stuck contact from rest until it slips", (), "float32"
    ),
}


def sticks(points: Mapping[str, Any], **fixed: Any) -> dict[str, Any]:
    """The long sticks of each point's normalised scene."""
    speed_per_load, mu = _speed_per_load(points), np.asarray(points["mu"], dtype=float)

    def job_of(k: int, number: float) -> Job:
        scene = Scene(float(speed_per_load[k]), fixed["theta"], float(mu[k]), 1.0, fixed["rig"])
        return ensembles.member(scene, number, fixed)

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        return of_sticks(jobs[0].scene, runs[0].summary, runs[0].summary["simulated_time"])

    return outcomes([[job_of(k, float(number))] for k, number in enumerate(points["member"])], values)


def of_sticks(scene: Scene, summary: Mapping[str, Any], duration: float) -> dict[str, Any]:
    """A run's long sticks, by whether the motion had settled when they began."""
    first, long = summary["first_slip_time"], summary["stick_times"]
    early = summary["stick_starts"] - first < transients.SETTLING
    return {
        "stick_time": np.append(long, np.full(KEPT, np.nan))[:KEPT],
        "start_up_count": np.count_nonzero(early),
        "start_up_total": long[early].sum(),
        "sustained_count": np.count_nonzero(~early),
        "sustained_total": long[~early].sum(),
        "observed_time": np.fmax(duration - first - transients.SETTLING, 0.0),
        "first_slip_time": first,
        "loading_time": ensembles.loading_time(scene),
    }


def key(points: Mapping[str, Any]) -> np.ndarray:
    """Equal rows for the same repeat run of scenes that are copies of each other."""
    return np.column_stack([_speed_per_load(points), points["mu"], points["member"]])


def _speed_per_load(points: Mapping[str, Any]) -> np.ndarray:
    """V / F as the solver rounds it, m/s/N: scenes of one theta and mu differ in it alone."""
    return normalised.coordinates({**points, "theta": np.zeros(len(points["V"]))})[0]


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse, before anything is planned, what cannot be run."""
    for value in axes["member"].values:
        checks.between("member", float(value), 1.0, 1e6, "a number counted from 1")
    ensembles.check_grid(axes, fixed, theta=fixed["theta"])


def constants_of(settings: Mapping[str, float]) -> dict[str, Any]:
    """The rig, theta and the settings of each repeat run."""
    rig, theta = rig_of(settings)
    return ensembles.shared(settings) | {"rig": rig, "theta": theta}


STUDY = Study(
    name="stick_time",
    title="T_st ~ 1/V: duration of sticks against speed",
    question="How long does the contact stick between two bursts of vibration, and is that time as 1/V, with the "
    "published scheme's numerical damping?",
    paper="Sections 2 and 3.5.4.2: the mean duration of the sticking phases is as 1/V, that at 2 mm/s half "
    "that at 1 mm/s; from some speed on they vanish (none at 5 mm/s); less friction or less load shortens them.",
    axes={
        "V": Axis(
            # Most of them have their half and their double among them: of loads, only copies.
            np.array([float(f"{V}e-3") for V in SPEEDS]),
            "m s-1",
            "velocity of P2's clamp",
        ),
        "member": Axis(np.arange(1, 17), "1", "repeat run, by the ramp of the drive"),
        "mu": Axis(evenly(0.75 * paper.MU, 1.25 * paper.MU, 3), "1", "coefficient of friction"),
        "F": Axis(np.array([0.5, 1.0, 2.0]) * paper.LOAD, "N", "load on A"),
    },
    settings=ensembles.settings(
        1.0, 30.0, transients.PUBLISHED, loading_times=Setting(3.0, "1", ensembles.LOADING_TIMES)
    )
    | {"cutoff": replace(transients.run_settings(30.0)["cutoff"], value=CUTOFF)}
    | rig_settings(),
    function=sticks,
    variables=VARIABLES,
    constants=constants_of,
    coords={"stick": Axis(np.arange(1, KEPT + 1), "1", "long stick, in the order in which they begin")},
    check=check,
    derive=with_laws,
    options={"key": key, "batch_multiple": BATCH_MULTIPLE},
    draw=deferred("studies.gallery.stick_time.figure:draw"),
    findings=deferred("studies.gallery.stick_time.findings:findings"),
)
