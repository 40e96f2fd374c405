"""Table 6: linear stability of steady sliding, and the motion in time, over the inclination."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Scene, Transient, checks
from studies import paper
from studies.answering.claims import is_papers_point
from studies.answering.results import rig_of
from studies.declaring import labels, spec
from studies.declaring.parameters import Parameter
from studies.motion import ensemble, regimes, stability
from studies.motion.jobs import Job, outcomes
from studies.plotting import angles, figures, planes
from studies.study import Claim, Study
from sweeps import Axis, Variable

MOST_ROWS = 31  # of the table by inclination
OUTPUTS = {
    **stability.UNSTABLE_PAIRS,
    **stability.LEAST_STABLE,
    "duration": Variable("s", "simulated time, mean of the realisations"),
    **ensemble.average_outputs(),
}
AT = {"theta": paper.THETA, "V": paper.ANGLES_SPEED}
CLAIMS = (
    Claim("dominant_frequency", AT, paper.ANGLES_MEASURED[paper.THETA], "2, measured"),
    Claim("dominant_frequency", AT, paper.ANGLES_SIMULATED[paper.THETA], "3.5.3, simulated"),
    *(Claim("frequency", AT | {"pair": k}, paper.ANGLES_UNSTABLE[paper.THETA][k - 1], "3.4.2") for k in (1, 2)),
    Claim("dominant_frequency", AT | {"theta": 10.0}, paper.ANGLES[10.0], "3.6, measured"),
    Claim("regime", AT | {"theta": 10.0}, "periodic", "3.6, measured"),
    *(Claim("regime", AT | {"theta": x}, regimes.STEADY, "3.6, measured") for x in (15.0, *paper.STEADY_ANGLES)),
)


def inclinations(scenes: Sequence[Scene], members: int, **run: Any) -> dict[str, Any]:
    """Unstable pairs of steady sliding, and the motion of an ensemble, at each inclination."""

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        scene, duration = jobs[0].scene, np.mean([run.summary["simulated_time"] for run in runs])
        least = dict(zip(stability.LEAST_STABLE, stability.least_stable(scene), strict=True))
        return stability.unstable_pairs(scene) | least | ensemble.averages(runs) | {"duration": duration}

    return outcomes([ensemble.ensemble(scene, members, run) for scene in scenes], values)


def coords(members: int) -> dict[str, Axis]:
    """The pairs and the realisations, numbered from 1."""
    pair = Axis(np.arange(1, stability.PAIRS + 1), "1", "unstable pair, ascending in frequency")
    member = Axis(np.arange(1, members + 1), "1", "realisation, by the ramp of the drive")
    return {"pair": pair, "member": member} | ensemble.APART


def check(members: int, **others: Any) -> None:
    """Refuse parameters with which no scene can be simulated; points without a unique contact force fail alone."""
    checks.count("members", members, 1000)
    ensemble.check(**others)


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add the unstable intervals."""
    return stability.with_unstable_intervals(dataset, rig_of(dataset), float(dataset["mu"]), float(dataset["V"]))


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Stability and motion at each inclination, the unstable intervals, and remarks on special inclinations."""
    theta, unstable = dataset["theta"].values, dataset["unstable_modes"].values
    kinds = np.array(regimes.KINDS)[regimes.kinds(dataset)]
    vibrates = regimes.ranges(theta, np.isin(kinds, regimes.VIBRATING))
    yield f"Steady sliding is unstable at {regimes.ranges(theta, unstable > 0)}; the rig vibrates at {vibrates}."
    papers = np.flatnonzero(np.isin(theta, [*paper.ANGLES_MEASURED, *paper.ANGLES])).tolist()
    rows = sorted({*planes.subset(len(theta), MOST_ROWS), *papers})
    names = (
        "theta mode_growth_rate dominant_frequency velocity_rms stick_fraction separation_fraction regime_share"
    )
    table = labels.frame(dataset.isel(theta=rows), names.split(), along="theta")
    table.columns = ["θ °", "growth 1/s", "dominant Hz", "RMS mm/s", "stick", "separation", "share of runs"]
    hertz = dataset["frequency"].values[rows]
    table.insert(1, "unstable Hz", [", ".join(f"{f:.0f}" for f in row[np.isfinite(row)]) or "-" for row in hertz])
    table.insert(7, "regime", kinds[rows])
    yield f"By inclination{planes.of_all(rows, len(theta))}; growth of the least stable mode", table
    yield from stability.intervals_summary(dataset, float(dataset["mu"]))
    motion = labels.words(dataset["member_regime"])
    counts = pd.crosstab(motion.ravel(), np.repeat(unstable, motion.shape[1]), colnames=["unstable modes"])
    counts = counts.rename(columns="{:g}".format).rename_axis("regime").reset_index()
    yield "Realisations by regime and number of unstable modes", counts
    at = dataset["theta"]
    inside = ((dataset["window_from"] <= at) & (at <= dataset["window_to"])).sum("window")
    most = float(dataset["max_duration"])
    limit = f"the runs stopped at the limit of {most:g} s, before the standard error was as small as requested"
    cases = {
        "a mode is unstable outside of the unstable intervals": (len(theta) > 1) & (unstable > inside.values),
        f"more than {stability.PAIRS} modes are unstable; the least stable are stored": unstable > stability.PAIRS,
        "the realisations differ in regime": dataset["regime_share"].values < 1.0,
        limit: dataset["duration"].values >= most,
    }
    yield from (f"At {regimes.ranges(theta, where)} {case}." for case, where in cases.items() if where.any())


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Frequencies, growth rates and fractions of time; unstable intervals, regimes and the paper's text."""
    theta, bounds = dataset["theta"].values, np.stack([dataset["window_from"], dataset["window_to"]], axis=1)
    papers = is_papers_point(dataset, mu=paper.MU, F=paper.LOAD, V=paper.ANGLES_SPEED)
    pairs = 1e-3 * dataset["frequency"].where(dataset["frequency"] > 0.0)
    dominant = 1e-3 * dataset["member_dominant_frequency"]
    bands = angles.bands([*np.ravel(pairs), *np.ravel(dominant)])
    heights = *[5.0 if len(bands) < 2 else 3.4] * len(bands), 4.0, 2.6, 2.6 + 0.6 * len(bounds)
    figure, panels = figures.panels(len(heights), 1, *heights, sharex=True)
    *lines, growth, fractions, strips = panels
    for axes in (*lines, growth):
        figures.spans(axes, bounds, color=figures.BLACK, alpha=0.06, zorder=0.5)
    for axes, ends in zip(lines, bands, strict=True):
        angles.points(axes, pairs, "unstable pair")
        angles.points(axes, dominant, "dominant, of a realisation", color=figures.BLUE, mfc="none", markersize=5.0)
        if papers:
            angles.paper_frequencies(axes, theta)
        axes.set(ylim=ends, ylabel="frequency / kHz", yscale="log" if ends[1] > 3.0 * ends[0] > 0.0 else "linear")
        figures.one_two_five(axes.yaxis)
    growth.axhline(0.0, color=figures.BLACK, linewidth=0.6)
    angles.points(growth, dataset["growth_rate"], "unstable pair")
    decays = dataset["mode_growth_rate"].where(~(dataset["mode_growth_rate"] > 0.0))
    angles.points(growth, decays, "least stable mode, where it decays", color=figures.GREEN)
    growth.margins(y=0.15)
    growth.set_ylabel("growth rate / (1/s)")
    parts = {state: dataset[f"{state}_fraction"].values for state in planes.STATE_COLOURS}
    planes.stack(fractions, spec.edges(theta), parts, [*planes.STATE_COLOURS.values()])
    for bar in fractions.containers[-1]:
        bar.set(hatch="//////", edgecolor="white", linewidth=0.0)  # not as the regimes below
    planes.draw_mixed(fractions, dataset, "theta", "stick_fraction")
    fractions.set(ylim=(0.0, 1.0), ylabel="fraction\nof time")
    angles.regime_strips(strips, dataset, papers)
    figures.legend_below(figure, panels, 3)
    titles = "growth rate", "motion of the contact", "unstable angles and regimes"
    figures.entitle(panels, ("frequency", *[""] * (len(bands) - 1), *titles))
    figure.suptitle("Stability and motion over the inclination")
    return figure


STUDY = Study(
    name="table6",
    title="Table 6: stability and motion over the inclination",
    question="At which inclinations is steady sliding unstable, and how does the rig then move, with the "
    "published scheme's numerical damping?",
    paper="Section 3.6, on Table 6, at 2 mm/s: vibration at 2700 Hz at 10 degrees, steady sliding at 15, above 12 "
    "and at negative angles; Sections 2, 3.4.2 and 3.5.3, at 5 degrees: 2700 Hz measured and simulated, unstable "
    "pairs at 400 and 2800 Hz. The body of the table is not available.",
    parameters={
        "theta": Parameter(spec.evenly(-10.0, 20.0, 61), "degree", "inclination of P1"),
        "members": Parameter(6, "1", "number of realisations at each inclination", common=True),
        **ensemble.until(0.3, 8.0, "published"),
    },
    outputs=OUTPUTS, function=inclinations, coords=coords, derive=derive, summary=summarise, figure=draw,
    claims=CLAIMS, check=check, chaotic=True, beams=True, roles=("motions",),
)  # fmt: skip
