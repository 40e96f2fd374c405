"""Any grid of scenes over V, theta, mu and F: figures of the motion in time and, with --record, series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Transient, checks
from studies import paper
from studies.motion import ensembles, normalised, recording, regimes, transients
from studies.motion.jobs import Job, check_jobs, outcomes
from studies.rig import rig_of, rig_settings
from studies.study import Setting, Study, constants, deferred
from studies.tables import Column, Part, Table
from sweeps import DONE, FAILED, Axis, Variable

VARIABLES: dict[str, Variable] = {
    name: replace(variable, scale="load") if name in normalised.SCALED else variable
    for name, variable in transients.SUMMARY.items()
} | {"simulated_time": Variable("s", "simulated time")}
# Rows of the report's table.
MOST_ROWS = 40
COLUMNS: dict[str, Column] = {
    "V mm/s": ("V", ".4g", 1e3),
    "theta deg": ("theta", ".4g"),
    "mu": ("mu", ".4g"),
    "F N": ("F", ".4g"),
    "vibration": regimes.kind,
    **regimes.SHARES,
    "RMS mm/s": ("velocity_rms", ".2f", 1e3),
    "dominant Hz": (regimes.dominant_frequency, ".0f"),
    "99.9 % of N": ("normal_force_999", ".1f"),
    "first slip ms": ("first_slip_time", ".1f", 1e3),
}


def motions(
    points: Mapping[str, Any], *, record: Sequence[str] = (), sample_rate: float = 0.0, **fixed: Any
) -> dict[str, Any]:
    """Summary figures and recorded series of each point's normalised scene."""
    times = transients.even_times(fixed["duration"], sample_rate).values if record else np.zeros(0)

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        time = {"simulated_time": runs[0].summary["simulated_time"]}
        return recording.series(runs[0], record) | transients.figures_of(runs[0]) | time

    series, until = recording.options(record, times), fixed["duration"] or ensembles.until(fixed)
    jobs = [[transients.job(scene, fixed, until, **series)] for scene in normalised.scenes(points, fixed["rig"])]
    return outcomes(jobs, values, copies=True)


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse, before anything is planned, what cannot be run."""
    if fixed["duration"] != 0.0:
        checks.between("duration", fixed["duration"], 1e-6, 1e6, "s; 0 where runs end by themselves")
    ensembles.until(fixed)
    check_jobs([transients.job(scene, fixed, 1e-6) for scene in transients.extremes(axes, fixed["rig"])])


def constants_of(settings: Mapping[str, float]) -> dict[str, Any]:
    """The rig and the run of each scene."""
    rig, _ = rig_of({**settings, "theta": 0.0})
    settle = settings["settle"]
    rule = {name: settings[name] for name in ("standard_error", "least", "most")}
    return transients.shared(settings, rig) | rule | {"settle": None if settle < 0.0 else settle}


def findings(dataset: xr.Dataset) -> list[Part]:
    """Main figures of the scenes, how many move in which way, and what failed."""
    fixed = constants(dataset)
    names = [name for name in (*transients.SUMMARY, "status", "error") if name in dataset]
    points = dataset[names].stack(point=transients.SCENE, create_index=False)
    computed = points.isel(point=np.isin(points["status"], [DONE, FAILED]))
    distinct = len(np.unique(normalised.key({name: computed[name].values for name in transients.SCENE}), axis=0))
    rig = "the paper's rig" if paper.is_rig(dataset) else "another rig than the paper's"
    copies = f"{distinct} computed" + ", of which the others are copies" * (distinct < computed.sizes["point"])
    settle, count = fixed["settle"], points.sizes["point"]
    since = f"{transients.SETTLING:g} s after the first slip" if settle is None else f"{settle:g} s"
    length = f" of {fixed['duration']:g} s" if fixed["duration"] else ""
    lines: list[Part] = [
        f"{count} scene{'s' if count > 1 else ''}{length} on {rig}, {transients.damping(fixed)}, {copies}.",
        *([] if length else [f"Each runs {ensembles.duration_text(fixed)}."]),
        f"Shares of time, RMS, dominant frequency and normal force: from {since} on.",
        "",
        Table.of(points.isel(point=slice(MOST_ROWS)), "point", COLUMNS),
        *([f"and {count - MOST_ROWS} more in the file."] if count > MOST_ROWS else []),
        "",
    ]
    numbers = np.bincount(regimes.kinds(points), minlength=len(regimes.KINDS))
    each = [f"{n} {kind}" for n, kind in zip(numbers, regimes.KINDS, strict=True) if n]
    lines.append(f"Scenes: {', '.join(each)}.")
    lines += regimes.failures(points, transients.SCENE)
    if "elapsed" in dataset.dims:
        lines.append(
            f"Recorded of each: {', '.join(fixed['record'])}; {dataset.sizes['elapsed']} samples at "
            f"{fixed['sample_rate']:g} Hz."
        )
    return lines


STUDY = Study(
    name="scenes",
    title="Scenes: any grid over V, theta, mu and F",
    question="How does the rig move at each speed, inclination, friction and load?",
    paper="Table 2 and Sections 2, 3.5 and 3.6 cover single scenes, at 5, 10 and 15 degrees; a grid over all four "
    "is not in it.",
    axes={
        "V": Axis(np.array([1e-3, 2e-3, 4e-3, 8e-3]), "m s-1", "velocity of P2's clamp"),
        "theta": Axis(np.array([0.0, 5.0, 10.0, 15.0]), "degree", "inclination of P1"),
        "mu": Axis(np.array([0.1, paper.MU, 0.3]), "1", "coefficient of friction"),
        "F": Axis(np.array([0.5 * paper.LOAD, paper.LOAD]), "N", "load on A"),
    },
    settings={name: each for name, each in transients.run_settings(0.0).items() if name not in transients.SCENE}
    | {
        "duration": Setting(
            0.0, "s", f"simulated time; 0: until shares are known, or {recording.DURATION:g} s if recorded"
        )
    }
    | ensembles.settings(least=0.3, most=16.0, standard_error=ensembles.KNOWN)
    | {"settle": Setting(-1.0, "s", "when statistics start; below 0: 0.1 s after the first slip")}
    | {name: each for name, each in rig_settings().items() if name != "theta"},
    function=motions,
    variables=VARIABLES,
    constants=constants_of,
    check=check,
    options=normalised.OPTIONS,
    draw=deferred("studies.gallery.scenes.figure:draw"),
    findings=findings,
    record=recording.whole_runs,
)
