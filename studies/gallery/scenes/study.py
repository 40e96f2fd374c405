"""Any grid of scenes over V, theta, mu and F: the motion of each in time, as figures and, if asked, as series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import Scene, Transient, checks
from fivcore.transient.normalised import Normalised
from studies import paper
from studies.motion import recording, regimes, transients
from studies.motion.jobs import BATCH_MULTIPLE, Job, check_jobs, outcomes
from studies.rig import rig_of, rig_settings
from studies.study import Setting, Study, constants, deferred
from studies.tables import Part, Table
from sweeps import DONE, FAILED, Axis, Grid, Sweep, Variable

# What F = 1 is multiplied by; the other figures are the same for every copy of a scene.
SCALED = (
    "velocity_rms",
    "mean_normal_force",
    "max_normal_force",
    "normal_force_999",
    "max_slip_speed",
    "slip_speed_999",
)
VARIABLES: dict[str, Variable] = {
    name: replace(variable, scale="load") if name in SCALED else variable
    for name, variable in transients.SUMMARY.items()
}
# Rows of the report's table, and failures that it names.
MOST_ROWS, MOST_FAILURES = 40, 5
# What the table shows besides shares of time: head, digits, factor.
COLUMNS = {
    "velocity_rms": ("RMS mm/s", 2, 1e3),
    "dominant_frequency": ("main line Hz", 0, 1.0),
    "normal_force_999": ("99.9 % of N", 1, 1.0),
    "first_slip_time": ("first slip ms", 1, 1e3),
}


def canonical(points: Mapping[str, Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """The scene for V > 0 and F = 1 that each point is a copy of: its V, theta and mu.

    (V, F) and (a V, a F) are one motion times a; (theta, V) and (-theta, -V) are one in a mirror. (theta, V) and
    (-theta, V) are different physics: theta is turned with V, never by itself.
    """
    V, F, mu = (np.asarray(points[name], dtype=float) for name in ("V", "F", "mu"))
    # V / F is rounded as the solver rounds it; each pair once, for a grid has far fewer pairs than points.
    speeds, which = np.unique(V, return_inverse=True)
    loads, under = np.unique(F, return_inverse=True)
    pairs, place = np.unique(which * len(loads) + under, return_inverse=True)
    paces = [
        Normalised.of(
            Scene(float(speeds[pair // len(loads)]), 0.0, 0.0, float(loads[pair % len(loads)]))
        ).speed_per_load
        for pair in pairs
    ]
    # Adding zero makes -0 of a turned 0 what it equals.
    theta = np.where(V > 0.0, points["theta"], -np.asarray(points["theta"], dtype=float)) + 0.0
    return np.asarray(paces)[place], theta, mu


def key(points: Mapping[str, Any]) -> NDArray[Any]:
    """Equal rows for points that are copies of one scene."""
    return np.stack(canonical(points), axis=1)


def scale(points: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """What a point's figures are, in units of its canonical scene's."""
    load = np.asarray(points["F"], dtype=float)
    return {"load": load, "along": load * np.sign(points["V"])}


def motions(
    points: Mapping[str, Any], *, record: Sequence[str] = (), sample_rate: float = 0.0, **fixed: Any
) -> dict[str, Any]:
    """Summary figures and recorded series of each point's canonical scene."""
    times = transients.even_times(fixed["duration"], sample_rate).values if record else np.zeros(0)
    every = [
        Scene(float(V), float(theta), float(mu), 1.0, fixed["rig"])
        for V, theta, mu in zip(*canonical(points), strict=True)
    ]

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        return recording.series(runs[0], record) | transients.figures_of(runs[0])

    asked = recording.asked(record, times)
    return outcomes([[transients.job(scene, fixed, **asked)] for scene in every], values, copies=True)


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Find out, before anything is planned, what cannot be run.

    A scene whose contact has no unique solution is not refused: its point fails by itself.

    Raises
    ------
    ValueError
        Naming the axis or setting.
    """
    checks.between("duration", fixed["duration"], 1e-6, 1e6, "s")
    check_jobs([transients.job(scene, fixed, 1e-6) for scene in transients.extremes(axes, fixed["rig"])])


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """The sweep over V, theta, mu and F; copies of a scene are computed once."""
    rig, _ = rig_of({**settings, "theta": 0.0})
    settle = settings["settle"]
    fixed = transients.held(settings, rig) | {"settle": None if settle < 0.0 else settle}
    check(axes, fixed)
    return Sweep(
        "scenes",
        motions,
        Grid(axes),
        VARIABLES,
        fixed,
        key=key,
        scale=scale,
        # The modes of P1 and the contact law's matrices are made anew for each theta.
        order_by=("theta",),
        title="Motion of scenes over V, theta, mu and F",
        batch_multiple=BATCH_MULTIPLE,
    )


def findings(dataset: xr.Dataset) -> list[Part]:
    """Main figures of the scenes, how many move in which way, and what failed."""
    given = constants(dataset)
    place = np.meshgrid(*(dataset[name].values for name in transients.SCENE), indexing="ij")
    points = {name: values.ravel() for name, values in zip(transients.SCENE, place, strict=True)}
    status = dataset["status"].values.ravel()
    some = np.flatnonzero((status == DONE) | (status == FAILED))
    distinct = len(np.unique(key({name: values[some] for name, values in points.items()}), axis=0))
    rig = "the paper's rig" if paper.is_rig(dataset) else "another rig than the paper's"
    copies = f"{distinct} computed" + (", of which the others are copies" if distinct < len(some) else "")
    settle = given["settle"]
    since = f"{transients.SETTLING:g} s after the first slip" if settle is None else f"{settle:g} s"
    lines: list[Part] = [
        f"{len(status)} scene{'s' if len(status) > 1 else ''} of {given['duration']:g} s on {rig}, {copies}.",
        f"Shares of time, RMS, main line and normal force: from {since} on.",
        "",
        *_table(dataset, points, status),
        "",
    ]
    words = np.append(transients.REGIMES, ["failed", "pending"])
    counts = np.bincount(regimes.kinds(dataset).ravel(), minlength=len(words))
    lines.append("Scenes: " + ", ".join(f"{n} {word}" for n, word in zip(counts, words, strict=True) if n) + ".")
    failed = np.flatnonzero(status == FAILED)
    for k in failed[:MOST_FAILURES]:
        where = ", ".join(f"{name} = {values[k]:g}" for name, values in points.items())
        lines.append(f"failed: {where}: {dataset['error'].values.ravel()[k]}")
    if len(failed) > MOST_FAILURES:
        lines.append(f"and {len(failed) - MOST_FAILURES} more failed.")
    if "elapsed" in dataset.dims:
        kept = ", ".join(given["record"])
        lines.append(
            f"Recorded of each: {kept}; {dataset.sizes['elapsed']} samples at {given['sample_rate']:g} Hz."
        )
    return lines


def _table(dataset: xr.Dataset, points: Mapping[str, Any], status: NDArray[Any]) -> list[Part]:
    """A line for each scene, up to MOST_ROWS of them."""
    count = min(len(status), MOST_ROWS)
    names = (*(f"{state}_fraction" for state in transients.STATES), *COLUMNS)
    found = {name: dataset[name].values.ravel()[:count] for name in names}
    words = (*transients.REGIMES, "failed", "pending")
    kinds, text = regimes.kinds(dataset).ravel(), transients.text
    # What is left of a vibration that dies has a strongest line too, but none that sounds.
    steady = transients.REGIMES.index("steady sliding")
    found["dominant_frequency"] = np.where(kinds[:count] == steady, np.nan, found["dominant_frequency"])
    rows = [
        [
            f"{1e3 * points['V'][k]:.4g}",
            *(f"{points[name][k]:.4g}" for name in ("theta", "mu", "F")),
            words[kinds[k]],
            *(text(found[f"{state}_fraction"][k], 3) for state in transients.STATES[1:] + transients.STATES[:1]),
            *(text(found[name][k], digits, factor) for name, (_, digits, factor) in COLUMNS.items()),
        ]
        for k in range(count)
    ]
    heads = ["V mm/s", "theta deg", "mu", "F N", "vibration", "stick", "slip", "separation"]
    lines: list[Part] = [Table([*heads, *(head for head, _, _ in COLUMNS.values())], rows)]
    return lines + ([f"and {len(status) - count} more in the file."] if count < len(status) else [])


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
    settings={name: each for name, each in transients.run_settings(1.0).items() if name not in transients.SCENE}
    | {"settle": Setting(-1.0, "s", "when statistics start; below 0: 0.1 s after the first slip")}
    | {name: each for name, each in rig_settings().items() if name != "theta"},
    build=build,
    draw=deferred("studies.gallery.scenes.figure:draw"),
    findings=findings,
    record=recording.whole_runs,
)
