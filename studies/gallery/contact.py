"""Figs. 8 to 10: forces and motion at the contact while the rig vibrates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Scene, Transient, checks
from studies import paper
from studies.answering.claims import is_papers_point
from studies.declaring import labels
from studies.declaring.parameters import RUN, published
from studies.motion import regimes, run, series
from studies.motion.jobs import Job, outcomes
from studies.physics import cycles, phases
from studies.plotting import figures, moving, planes, signals
from studies.study import Claim, Parameter, Study

MOST_COLUMNS, PEAKS = 3, ("normal_force", "slip_speed")
CLAIMS = tuple(
    Claim(name, {"V": V}, value, "3.5.4.1" if V == 5e-3 else "3.5.4.2")
    for V, peaks in paper.CONTACT_PEAKS.items()
    for names in (("normal_force_999", "slip_speed_999"), phases.START)
    for name, value in zip(names, peaks, strict=True)
) + tuple(
    Claim(f"cycle_max_{name}", {"V": 5e-3}, value, "Figs. 8, 9")
    for name, value in zip(PEAKS, paper.CONTACT_PEAKS[5e-3], strict=True)
)


def contacts(
    scenes: Sequence[Scene], duration: float, window_start: float, window: float, overview: float,
    sample_rate: float, most: int, **options: Any,
) -> dict[str, Any]:  # fmt: skip
    """The contact of each scene in the window and in the overview, and the summary of its whole run."""
    times = phases.coords(window_start, window, overview, sample_rate)["elapsed"].values
    # Every step of the whole run would fill the memory: the recorded part is run again.
    lengths: Any = ((duration, {}), (max(window_start + window, overview), {"record": True, "sample_rate": None}))

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        whole, part = runs
        found = phases.within(part, times) | phases.interval_peaks(part, overview) | phases.start_peaks(part)
        cycle = cycles.values(jobs[0].scene, part, most, options["numerical_damping"], options["cutoff"])
        return found | run.summary_of(whole) | cycle

    jobs = [[run.job(scene, length, options, **how) for length, how in lengths] for scene in scenes]
    return outcomes(jobs, values)


def check(duration: Any, most: Any, **others: Any) -> None:
    """Refuse runs that cannot be simulated or stored."""
    checks.between("most", float(np.max(most)), 0.0, 1000.0, "points")
    checks.between("duration", np.min(duration), 2.0 * series.WINDOW, 1e6, "s")
    phases.check(**{name: others.pop(name) for name in phases.SETTINGS})
    run.check(**{name: others[name] for name in ("V", "F", *RUN)})


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Peaks of normal force and slip speed at each speed, limit cycles, and statistics."""
    points = [dataset.isel(V=k) for k in range(dataset.sizes["V"])]
    for point in points:
        force, speed = (labels.number(float(labels.readable(point[f"{name}_999"]))) for name in PEAKS)
        below = f"the normal force stays below {force} N and the slip speed below {speed} mm/s"
        yield f"At {labels.named('V', point['V'])}, {below} for 99.9 % of the time."
    if int(dataset["most"]):
        yield from map(cycle_text, points)
    changes = dataset["switches_per_second"] / regimes.dominant_frequency(dataset)
    table = dataset.assign(state_changes_per_period=changes.assign_attrs(units="1"))
    for caption, names in {
        "Fractions of time, and changes of state in a period of the dominant frequency":
            "regime stick_fraction slip_fraction separation_fraction state_changes_per_period",
        "Normal force": "mean_normal_force normal_force_999 max_normal_force start_up_normal_force",
        "Slip speed": "slip_speed_999 max_slip_speed start_up_slip_speed",
    }.items():  # fmt: skip
        yield caption, labels.frame(table, ["V", *names.split()])
    yield "Maxima last for microseconds and grow with the length of the run; compare the 99.9 % quantiles (_999)."


def cycle_text(point: xr.Dataset) -> str:
    """The limit cycle of a point: its frequency, peaks and stability, or why none is found."""
    value = {name: float(labels.readable(point[name])) for name in cycles.CYCLE}
    frequency, force, speed, multiplier, share, d2 = map(labels.number, value.values())
    where = labels.named("V", point["V"])
    if np.isfinite(value["cycle_frequency"]):
        kind = "stable" if value["cycle_multiplier"] < 1.0 else "unstable"
        return (
            f"The limit cycle at {where} has a frequency of {frequency} Hz, a largest normal force of {force} N "
            f"and a largest slip speed of {speed} mm/s. It is {kind}: its largest Floquet multiplier is "
            f"{multiplier}. The motion follows it for a fraction of {share} of the time: normal force and "
            f"velocity of B differ from the cycle's by less than {cycles.NEAR:g} of their standard deviations."
        )
    why = "the search starts from a run that repeats itself without long sticks, and no run does"
    if np.isfinite(value["cycle_d2"]):
        why = f"the cycle found at d2 = {cycles.SOUGHT:g} s exists down to d2 = {d2} s only"
    return f"No limit cycle is found at {where}: {why}."


def draw(dataset: xr.Dataset) -> figures.Figure:
    """A column for each speed: the whole start, two periods in time, and one in the phase plane."""
    columns = planes.subset(dataset.sizes["V"], MOST_COLUMNS)
    sides = ("largest normal\nforce / N", "largest slip\nspeed / (mm/s)", "normal force\n/ N",
             "apparent\nfriction T/N", "slip velocity\n/ (mm/s)", "slip velocity / (mm/s)")  # fmt: skip
    figure, panels = figures.panels(6, len(columns), 2.7, 3.2, 3.0, 2.7, 3.2, 4.8, stack=False)
    grid = np.array(panels).reshape(6, len(columns))
    for column, k in zip(grid.T, columns, strict=True):
        _draw_speed(column, dataset.isel(V=k))
    for row, side in zip(grid, sides, strict=True):
        # Speeds are compared, so a row has one scale.
        low, high = np.transpose([axes.get_ylim() for axes in row])
        row[0].set_ylabel(side)
        for axes in row:
            axes.set_ylim(low.min(), high.max())
    figures.legend_below(figure, panels, 3 if len(columns) > 1 else 2)
    figure.suptitle(f"The contact{planes.of_all(columns, dataset.sizes['V'], 'speeds')}")
    return figure


def _draw_speed(column: np.ndarray, point: xr.Dataset) -> None:
    """One column; the panels of a speed that failed stay empty."""
    (force, speed, *times, phase), kind = column, regimes.kind(point)
    force.sharex(speed)
    force.tick_params(labelbottom=False)
    force.set_title(f"{labels.named('V', point['V'])}: {kind}", loc="left")
    speed.set_xlabel("time since the drive started / s")
    phase.set_xlabel("slip displacement / μm")
    if kind == "failed":
        return
    papers = is_papers_point(point, mu=paper.MU, F=paper.LOAD, theta=paper.THETA)
    peaks = paper.CONTACT_PEAKS.get(float(point["V"]), ()) if papers else ()
    for axes, name in zip((force, speed), phases.OVERVIEW, strict=True):
        axes.step(point["interval"], labels.readable(point[name]), where="mid", color=figures.BLUE, linewidth=0.8)
        axes.set_xlim(0.0, float(point["overview"]))
    for axes, scale, peak in zip((force, speed), (1.0, 1e3), peaks, strict=False):
        axes.axhline(scale * peak, color=figures.RED, linestyle="--", linewidth=1.0, label="paper: reached")
    signals.draw_periods(times, phase, point)


STUDY = Study(
    name="contact",
    title="Figs. 8 to 10: the contact while the rig vibrates",
    question="How do force, slip and contact state go through a period of vibration, and how far beyond the "
    "imposed load and speed do they go, with the published scheme's numerical damping?",
    paper="Section 3.5.4 and Figs. 8 to 10: a period has four phases, stick, slip, separation and slip; at 5 mm/s "
    "the normal force reaches 25 N and the slip speed 30 mm/s, at 2 mm/s 50 N and 120 mm/s, where vibration and "
    "sticking phases alternate.",
    parameters={
        "V": Parameter(np.array([2e-3, 5e-3]), "m s-1", "speed of the drive"),
        "duration": Parameter(2.5, "s", "simulated time", common=True),
        **phases.SETTINGS,
        **cycles.SETTINGS,
        **published(RUN),
    },
    outputs=phases.SERIES | phases.OVERVIEW | phases.START | cycles.CYCLE_SERIES | cycles.CYCLE | run.SUMMARY,
    function=contacts, coords=phases.coords, check=check, summary=summarise, figure=draw,
    animate=moving.contact, claims=CLAIMS,
    chaotic=True,
)  # fmt: skip
