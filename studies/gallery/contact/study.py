"""Figs. 8 to 10: forces and motion at the contact while the rig vibrates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.integrate import cumulative_trapezoid

from fivcore import Transient, checks
from studies import paper
from studies.motion import recording, regimes, transients
from studies.motion.jobs import BATCH_MULTIPLE, Job, outcomes
from studies.rig import rig_of, rig_settings
from studies.study import Setting, Study, constants, deferred
from studies.tables import Part, Table
from sweeps import Axis, Grid, Sweep, Variable

SEPARATION, STICK, SLIP = range(3)
# The motion is recorded at every step of the method.
RECORDED = 1e6
# Of the overview: its intervals, s, and how long after the first slip the start-up is, s.
INTERVAL = 1e-3
START_UP = 0.1


SERIES = {
    "normal_force": Variable("N", "normal force on P1", ("elapsed",), "float32"),
    "apparent_friction": Variable("1", "tangential over normal force; 0 in separation", ("elapsed",), "float32"),
    "slip_velocity": Variable("m s-1", "velocity of P1's surface relative to P2's", ("elapsed",), "float32"),
    "slip_displacement": Variable(
        "m", "displacement of P1's surface relative to P2's since the window began", ("elapsed",), "float32"
    ),
    "state": Variable("1", "state of the contact", ("elapsed",), "int8", flags=dict(enumerate(transients.STATES))),
}
OVERVIEW = {
    "largest_normal_force": Variable("N", "largest normal force in the interval", ("interval",), "float32"),
    "largest_slip_speed": Variable("m s-1", "largest slip speed in the interval", ("interval",), "float32"),
}
STARTING = {
    "start_up_normal_force": Variable("N", "largest normal force in the first 0.1 s after the first slip"),
    "start_up_slip_speed": Variable("m s-1", "largest slip speed in the first 0.1 s after the first slip"),
}
VARIABLES = SERIES | OVERVIEW | STARTING | transients.SUMMARY


def contacts(
    points: Mapping[str, Any],
    *,
    window_start: float,
    window: float,
    overview: float,
    sample_rate: float,
    **fixed: Any,
) -> dict[str, Any]:
    """The contact of each point in the window and at large, and the summary figures of its whole run."""
    times = window_times(window_start, window, sample_rate).values
    # Every step of the whole run would fill the memory: what is shown is run again.
    until = max(window_start + window, overview)
    shown = {"duration": until, "record": True, "sample_rate": RECORDED}

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        whole, run = runs
        return within(run, times) | at_large(run, overview) | starting(run) | transients.figures_of(whole)

    every = transients.scenes(points, fixed)
    jobs = [[transients.job(scene, fixed), transients.job(scene, fixed, **shown)] for scene in every]
    return outcomes(jobs, values)


def window_times(start: float, length: float, sample_rate: float) -> Axis:
    """The `elapsed` of the window."""
    count = int(length * sample_rate * (1.0 + 1e-12)) + 1
    return Axis(start + np.arange(count) / sample_rate, "s", "time since the drive started")


def within(run: Transient, times: np.ndarray) -> dict[str, Any]:
    """What the contact does at `times`: the nearest step, so that force, speed and state belong together."""
    begin = max(int(np.searchsorted(run.time, times[0])) - 1, 0)
    time, slip = run.time[begin:], run.slip_velocity[begin:]
    nearest = np.searchsorted(0.5 * (time[1:] + time[:-1]), times)
    N, T = run.normal_force[begin:][nearest], run.tangential_force[begin:][nearest]
    moved = cumulative_trapezoid(slip, time, initial=0.0)
    return {
        "normal_force": N,
        "apparent_friction": np.divide(T, N, out=np.zeros_like(N), where=N > 0.0),
        "slip_velocity": slip[nearest],
        "slip_displacement": moved[nearest] - moved[nearest[0]],
        "state": run.state[begin:][nearest],
    }


def at_large(run: Transient, overview: float) -> dict[str, Any]:
    """The largest force and speed in every interval of the overview."""
    edges = np.searchsorted(run.time, INTERVAL * np.arange(len(intervals(overview))))
    # With a very low cut-off a step is longer than an interval.
    edges = np.minimum(edges, len(run.time) - 1)
    last = max(np.searchsorted(run.time, INTERVAL * len(edges)), edges[-1] + 1)
    return {
        "largest_normal_force": np.maximum.reduceat(run.normal_force[:last], edges),
        "largest_slip_speed": np.maximum.reduceat(np.abs(run.slip_velocity[:last]), edges),
    }


def intervals(overview: float) -> Axis:
    """The intervals of the overview, by their middles."""
    count = int(overview / INTERVAL * (1.0 + 1e-12))
    return Axis(INTERVAL * (np.arange(count) + 0.5), "s", "middle of the interval, since the drive started")


def starting(run: Transient) -> dict[str, Any]:
    """The largest force and speed soon after the first slip; NaN unless all of it is known."""
    first = run.summary["first_slip_time"]
    if not first + START_UP <= run.time[-1]:
        return dict.fromkeys(STARTING, np.nan)
    soon = slice(*np.searchsorted(run.time, [first, first + START_UP]))
    return {
        "start_up_normal_force": run.normal_force[soon].max(),
        "start_up_slip_speed": np.abs(run.slip_velocity[soon]).max(),
    }


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """The sweep over V."""
    rig, _ = rig_of(settings)
    fixed = transients.held(settings, rig, "theta", "mu", "F")
    shown = {name: settings[name] for name in ("window_start", "window", "overview", "sample_rate")}
    grid = Grid(axes)
    transients.check(axes, fixed | shown)
    most = transients.MOST_SAMPLES / RECORDED
    checks.between("window", shown["window"], 1e-5, 0.1, "s")
    checks.between("window_start", shown["window_start"], 0.0, most - shown["window"], "s")
    checks.between("overview", shown["overview"], 10.0 * INTERVAL, most, "s")
    return Sweep(
        "contact",
        contacts,
        grid,
        VARIABLES,
        fixed | shown,
        coords={
            "elapsed": window_times(shown["window_start"], shown["window"], shown["sample_rate"]),
            "interval": intervals(shown["overview"]),
        },
        title="Forces and motion at the contact (Figs. 8 to 10)",
        batch_multiple=BATCH_MULTIPLE,
    )


def findings(dataset: xr.Dataset) -> list[Part]:
    """How hard the contact is loaded and how fast it slips, beside the paper's."""
    given, text = constants(dataset), transients.text
    papers = paper.is_point(dataset, mu=paper.MU, F=paper.LOAD, theta=paper.THETA)
    lines: list[Part] = [
        f"The contact, theta = {given['theta']:g} degrees, mu = {given['mu']:g}, F = {given['F']:g} N, "
        f"{given['duration']:g} s; from {transients.SETTLING:g} s after the first slip on unless said otherwise.",
        "",
        "Shares of time.",
    ]
    shares, forces, speeds = [], [], []
    for k, speed in enumerate(dataset["V"].values):
        at = dataset.isel(V=k)
        head = [f"{1e3 * speed:.4g}"]
        said = paper.CONTACT_PEAKS.get(speed, (np.nan, np.nan)) if papers else (np.nan, np.nan)
        order = transients.STATES[1:] + transients.STATES[:1]
        shares.append([*head, regimes.kind(at), *(text(at[f"{n}_fraction"], 3) for n in order)])
        forces.append(
            [*head, text(at["mean_normal_force"], 3)]
            + [text(at[name], 1) for name in ("normal_force_999", "max_normal_force", "start_up_normal_force")]
            + [text(said[0], 0)]
        )
        speeds.append(
            head
            + [text(at[name], 1, 1e3) for name in ("slip_speed_999", "max_slip_speed", "start_up_slip_speed")]
            + [text(said[1], 0, 1e3)]
        )
    lines.append(Table(["V mm/s", "vibration", "stick", "slip", "separation"], shares))
    heads = ["99.9 %", "largest", "start-up", "paper"]
    lines += ["", "Normal force, N.", Table(["V mm/s", "mean", *heads], forces)]
    lines += ["", "Slip speed, mm/s.", Table(["V mm/s", *heads], speeds)]
    lines += [
        "",
        f"99.9 %: not passed for that share of the time; start-up: the largest within {START_UP:g} s of the first",
        "slip. Largest values are spikes of microseconds and grow with the length of the run"
        + ("; the paper's are of the stretch it shows." if papers else "."),
    ]
    if papers:
        lines += _phases(dataset)
    return lines


def _phases(dataset: xr.Dataset) -> list[str]:
    """How many changes of state a period has, where the paper has four."""
    lines = []
    for k, speed in enumerate(dataset["V"].values):
        at = dataset.isel(V=k)
        changes = float(at["switches_per_second"] / at["dominant_frequency"])
        if np.isfinite(changes):
            lines.append(
                f"{1e3 * speed:.4g} mm/s: {changes:.0f} changes of state in a period of the main line; the paper "
                "shows four phases (stick, slip, separation, slip)."
            )
    return lines


STUDY = Study(
    name="contact",
    title="Figs. 8 to 10: the contact while the rig vibrates",
    question="How do force, slip and contact state go through a period of vibration, and how far beyond the "
    "imposed load and speed do they go?",
    paper="Section 3.5.4 and Figs. 8 to 10: a period has four phases, stick, slip, separation and slip; at 5 mm/s "
    "the normal force reaches 25 N and the slip speed 30 mm/s, at 2 mm/s 50 N and 120 mm/s, where vibration and "
    "sticking phases alternate.",
    axes={"V": Axis(np.array([2e-3, 5e-3]), "m s-1", "velocity of P2's clamp")},
    settings=transients.run_settings(2.5)
    | {
        "window_start": Setting(0.5, "s", "beginning of the window shown closely"),
        "window": Setting(2e-3, "s", "length of the window"),
        "overview": Setting(0.5, "s", "length of the overview from the start"),
        "sample_rate": Setting(500e3, "Hz", "of the series in the window"),
    }
    | rig_settings(),
    build=build,
    draw=deferred("studies.gallery.contact.figure:draw"),
    findings=findings,
    record=recording.in_a_window,
)
