"""Any grid of scenes over V, theta, mu and F: the summary of the motion in time and, with --record, series."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Scene, Transient, Until, checks
from studies import paper
from studies.declaring import labels
from studies.motion import ensemble, regimes, run, series
from studies.motion.jobs import Job, outcomes
from studies.plotting import contacts, general
from studies.plotting.regimes import draw_planes
from studies.study import Parameter, Study
from sweeps import DONE, Variable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUTPUTS: dict[str, Variable] = {
    name: replace(variable, scale="load") if name in run.SCALED else variable
    for name, variable in run.SUMMARY.items()
} | {"simulated_time": Variable("s", "simulated time")}
# Shown of each contact.
OF_CONTACT = ("stick_fraction", "separation_fraction", "mean_normal_force")
BY_CONTACT = {
    name: replace(variable, scale="load") if name.removeprefix("contact_") in run.SCALED else variable
    for name, variable in run.CONTACTS.items()
}
COLUMNS = (
    "V",
    "theta",
    "mu",
    "F",
    "regime",
    "stick_fraction",
    "separation_fraction",
    "velocity_rms",
    "dominant_frequency",
)
# Rows of the summary's table.
MOST_ROWS = 40


def motions(
    scenes: Sequence[Scene], duration: float | None, standard_error: float, min_duration: float,
    max_duration: float, record: Sequence[str], times: Any, **options: Any,
) -> dict[str, Any]:  # fmt: skip
    """Summary and recorded series of each scene."""

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        time = {"simulated_time": runs[0].summary["simulated_time"]}
        return series.kept(runs[0], record) | run.summary_of(runs[0]) | run.contacts_of(runs[0]) | time

    until = duration or Until(standard_error, min_duration, max_duration)
    recording = series.sampling(record, times)
    return outcomes([[run.job(scene, until, options, **recording)] for scene in scenes], values)


def check(duration: Any, settle: Any, **others: Any) -> None:
    """Refuse parameters with which no scene can be simulated."""
    for name, value in (("duration", duration), ("settle", settle)):
        if value is not None:
            checks.between(name, np.min(value), 1e-6 if name == "duration" else 0.0, 1e6, "s, or auto")
    ensemble.check(**others)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The number of scenes in each regime, and a table of the first scenes."""
    numbers = np.bincount(regimes.kinds(dataset).ravel(), minlength=len(regimes.KINDS))
    counts = ", ".join(f"{n} {kind}" for n, kind in zip(numbers, regimes.KINDS, strict=True) if n)
    yield f"{numbers.sum()} scene{'s' * int(numbers.sum() != 1)}, {regimes.damping_text(dataset)}: {counts}."
    points = dataset[[*COLUMNS, "status"]].stack(point=dataset["status"].dims, create_index=False)
    table = labels.frame(points.isel(point=slice(MOST_ROWS)), COLUMNS, along="point")
    table.columns = [str(head).replace("_fraction", "").replace("velocity_rms", "RMS") for head in table]
    more = f" (the first {MOST_ROWS} of {points.sizes['point']})" if points.sizes["point"] > MOST_ROWS else ""
    yield f"Scenes{more}", table
    if "contact" in dataset.dims:
        names = [*COLUMNS[:4], "contact", *(f"contact_{name}" for name in OF_CONTACT)]
        first = dataset[names].stack(point=dataset["status"].dims, create_index=False)
        first = first.isel(point=slice(max(MOST_ROWS // dataset.sizes["contact"], 1)))
        table = labels.frame(first, names, along=["point", "contact"])
        yield "Contacts", table.rename(columns=lambda head: str(head).removeprefix("contact_"))


def draw(dataset: xr.Dataset) -> Figure:
    """Regimes; or, where the state of several contacts was recorded, the state of each contact over time."""
    recorded = "contact_state" in dataset and bool((dataset["status"] == DONE).any())
    if recorded:
        return contacts.draw(dataset)
    varying = [name for name in dataset["status"].dims if dataset.sizes[name] > 1]
    return draw_planes(dataset) if len(varying) > 1 else general.draw(dataset)


STUDY = Study(
    name="scenes",
    title="Scenes: any grid over V, theta, mu and F",
    question="How does the rig move at each speed, inclination, friction and load?",
    paper="Table 2 and Sections 2, 3.5 and 3.6 cover single scenes, at 5, 10 and 15 degrees, and no grid.",
    parameters={
        "V": Parameter(np.array([1e-3, 2e-3, 4e-3, 8e-3]), "m s-1", "speed of the drive"),
        "theta": Parameter(np.array([0.0, 5.0, 10.0, 15.0]), "degree", "inclination of P1"),
        "mu": Parameter(np.array([0.1, paper.MU, 0.3]), "1", "coefficient of friction"),
        "F": Parameter(np.array([0.5 * paper.LOAD, paper.LOAD]), "N", "load on A"),
        "duration": Parameter(
            None, "s", f"simulated time; auto: until statistics are known, or {series.DURATION:g} s if recorded",
            common=True,
        ),
        "settle": Parameter(None, "s", "discarded transient; auto: until 0.1 s after the first slip", common=True),
    }
    | ensemble.until(0.3, 16.0),
    outputs=OUTPUTS,
    by_contact=BY_CONTACT,
    function=motions,
    check=check,
    summary=summarise,
    figure=draw,
    normalised=True,
    chaotic=True,
    roles=("motions",),
)  # fmt: skip
