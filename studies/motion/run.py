"""One run of a scene: its options as parameters, its summary as variables of a result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fivcore import SETTLING as SETTLING_TIME
from fivcore import Options, Scene, Transient, Until, checked_run
from studies.motion.jobs import Job
from sweeps import Variable

METHOD = "fast"
# The paper's spectra and its stability analysis end here, Hz.
BAND = 10e3
# Statistics start this long after the first slip, s.
SETTLING = SETTLING_TIME
STATES = ("separation", "stick", "slip")
REGIMES = ("undecided", "stuck", "steady sliding", "intermittent", "periodic", "irregular")

SUMMARY = {
    "regime": Variable("1", "regime of the motion", (), "int8", flags=dict(enumerate(REGIMES))),
    "stick_fraction": Variable("1", "fraction of time in stick"),
    "slip_fraction": Variable("1", "fraction of time in slip"),
    "separation_fraction": Variable("1", "fraction of time in separation"),
    "dominant_frequency": Variable("Hz", "dominant frequency of the velocity of B outside long sticks"),
    "stuck_frequency": Variable("Hz", "dominant frequency of the velocity of B within long sticks"),
    "periodicity": Variable("1", "autocorrelation of the velocity of B after 20 periods"),
    "velocity_rms": Variable("m s-1", "RMS velocity of B"),
    "mean_normal_force": Variable("N", "mean normal force"),
    "max_normal_force": Variable("N", "largest normal force"),
    "normal_force_999": Variable("N", "99.9 % quantile of the normal force"),
    "max_slip_speed": Variable("m s-1", "largest slip speed"),
    "slip_speed_999": Variable("m s-1", "99.9 % quantile of the slip speed"),
    "switches_per_second": Variable("s-1", "changes of contact state per second"),
    "first_slip_time": Variable("s", "time of the first slip"),
    "first_separation_time": Variable("s", "time of the first separation"),
    "long_sticks": Variable("1", "number of long sticks after the first slip", (), "int32"),
    "mean_stick_time": Variable("s", "mean duration of the long sticks"),
    "energy_residual": Variable("1", "relative residual of the energy balance"),
    "cutoff_error": Variable("1", "expected error of the fractions of time by the default cut-off"),
}
# Statistics of a run that have a standard error, X_se.
ESTIMATED = (
    *(f"{state}_fraction" for state in STATES),
    "velocity_rms", "mean_normal_force", "normal_force_999", "slip_speed_999", "switches_per_second",
    "mean_stick_time",
)  # fmt: skip
SUMMARY |= {
    f"{name}_se": replace(SUMMARY[name], long_name=f"standard error: {SUMMARY[name].long_name}")
    for name in ESTIMATED
}
# Of each of several contacts.
CONTACTS = {
    f"contact_{name}": replace(each, long_name=f"{each.long_name}, of each contact", dims=("contact",))
    for name, each in SUMMARY.items()
    if name in {f"{state}_fraction" for state in STATES}
    or name in ("mean_normal_force", "max_normal_force", "max_slip_speed", "switches_per_second")
}
CONTACTS |= {
    "any_open_fraction": Variable("1", "fraction of time in which a contact that the load closes is open"),
    "all_stick_fraction": Variable("1", "fraction of time in which all contacts that the load closes stick"),
}
# Quantities that the load multiplies; the others are equal for equivalent scenes.
SCALED: tuple[str, ...] = ("velocity_rms", "mean_normal_force", "normal_force_999", "slip_speed_999")
SCALED = (*SCALED, "max_normal_force", "max_slip_speed", *(f"{name}_se" for name in SCALED))


def options(
    *, ramp: float, cutoff: float | None, skip_long_sticks: int, numerical_damping: str, **others: Any
) -> dict[str, Any]:
    """Arguments of `fivcore.simulate` from the parameters of a run (`studies.declaring.parameters.RUN`)."""
    run = {"method": METHOD, "ramp": ramp, "cutoff": cutoff, "settle": others.get("settle")}
    return run | {"skip_sticks": bool(skip_long_sticks), "numerical_damping": numerical_damping}


def job(scene: Scene, duration: float | Until, run: Mapping[str, Any], **recording: Any) -> Job:
    """A run of a scene with these parameters."""
    given = options(**run) | recording
    if getattr(given.get("initial"), "running", False):
        # Its drive runs already.
        given["ramp"] = None
    return Job(scene, duration, given)


def summary_of(run: Transient) -> dict[str, Any]:
    """Values of the variables of SUMMARY."""
    regime, sticks = REGIMES.index(run.summary["regime"]), len(run.summary["stick_times"])
    values = {**run.summary, "regime": regime, "long_sticks": sticks}
    return {name: values[name] for name in SUMMARY if name in values}


def contacts_of(run: Transient) -> dict[str, Any]:
    """Values of the variables of CONTACTS, (c,); nothing with one contact."""
    return {name: run.summary[name] for name in CONTACTS if name in run.summary}


def check(
    V: Any,
    F: Any,
    ramp: Any,
    cutoff: Any,
    skip_long_sticks: Any,
    numerical_damping: Any,
) -> None:
    """Raise a `ValueError` for options that cannot be simulated at the least or the greatest V / F."""
    speeds, loads = np.abs(np.ravel(V)), np.ravel(F)
    runs = {"ramp": ramp, "cutoff": cutoff, "skip_long_sticks": skip_long_sticks}
    runs["numerical_damping"] = numerical_damping
    run: Any = {name: np.ravel(value)[0].item() if np.ndim(value) else value for name, value in runs.items()}
    for speed, load in ((speeds.min(), loads.max()), (speeds.max(), loads.min())):
        checked_run(Scene(float(speed), 0.0, 0.0, float(load)), 1e-6, Options(**options(**run)))
