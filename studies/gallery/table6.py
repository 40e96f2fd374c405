"""Table 6: linear stability of steady sliding, and the motion in time, over the inclination."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Scene, Transient, checks, sliding_modes
from studies import paper
from studies.answering.claims import is_papers_point
from studies.answering.results import rig_of
from studies.declaring import labels, spec
from studies.declaring.parameters import Parameter
from studies.motion import ensemble, regimes, stability
from studies.motion.jobs import Job, outcomes
from studies.motion.run import BAND, SUMMARY
from studies.motion.series import runs_of_true
from studies.physics import cells
from studies.plotting import angles, figures, planes
from studies.study import Claim, Study
from sweeps import Axis, Variable

PAIRS = 8  # the paper's rig has two unstable ones at mu = 0.2 and at most four up to mu = 2
AVERAGED = ("velocity_rms", "stick_fraction", "slip_fraction", "separation_fraction")
KEPT = ("regime", "dominant_frequency", *AVERAGED)
MOST_ROWS = 31  # of the table by inclination


def _of(name: str, whose: str, *dims: str) -> Variable:
    return replace(SUMMARY[name], long_name=f"{SUMMARY[name].long_name}, {whose}", dims=dims)


OUTPUTS = {
    "unstable_modes": Variable("1", "number of unstable modes of steady sliding below 10 kHz", (), "int16"),
    "frequency": Variable("Hz", "frequency of the unstable pair of steady sliding", ("pair",)),
    "growth_rate": Variable("s-1", "growth rate of the unstable pair of steady sliding", ("pair",)),
    **stability.LEAST_STABLE,
    "duration": Variable("s", "simulated time, mean of the realisations"),
    "regime": replace(SUMMARY["regime"], long_name="regime of most realisations"),
    "regime_share": Variable("1", "fraction of the realisations in the regime of most"),
    "dominant_frequency": _of("dominant_frequency", "lower median of the vibrating realisations"),
    **{name: _of(name, "mean of the realisations") for name in AVERAGED},
    **{f"member_{name}": _of(name, "of one realisation", "member") for name in KEPT},
    **{name: replace(each, scale="") for name, each in ensemble.motion_outputs().items()},
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
        rate, frequency = stability.least_stable(jobs[0].scene)
        motion = averages(runs) | {"duration": np.mean([run.summary["simulated_time"] for run in runs])}
        return unstable_pairs(jobs[0].scene) | {"mode_growth_rate": rate, "mode_frequency": frequency} | motion

    return outcomes([ensemble.ensemble(scene, members, run) for scene in scenes], values)


def unstable_pairs(scene: Scene) -> dict[str, Any]:
    """Number of the unstable pairs; frequency and growth rate of the least stable ones, ascending in frequency."""
    modes = sliding_modes(scene.rig, scene.drive_theta, scene.mu, BAND, **stability.sliding_of(scene))
    unstable = np.flatnonzero(modes.unstable)
    least_stable = np.argsort(-modes.growth_rate[unstable], kind="stable")[:PAIRS]
    chosen = np.sort(unstable[least_stable])  # modes ascend in frequency
    frequency, growth = np.full((2, PAIRS), np.nan)
    frequency[: len(chosen)], growth[: len(chosen)] = modes.frequency[chosen], modes.growth_rate[chosen]
    return {"unstable_modes": len(unstable), "frequency": frequency, "growth_rate": growth}


def averages(runs: Sequence[Transient]) -> dict[str, Any]:
    """The motion of a scene's realisations: of each, and of all together."""
    summaries = ensemble.summaries(runs)
    one = {name: summaries[name] for name in KEPT}
    vibrates = regimes.is_of(one["regime"], *regimes.VIBRATING)
    one["dominant_frequency"] = np.where(vibrates, one["dominant_frequency"], np.nan)
    most, counts = ensemble.majority(one["regime"])
    together = {name: one[name].mean() for name in AVERAGED} | {
        "regime": most,
        "regime_share": counts[most] / len(runs),
    }
    together["dominant_frequency"] = ensemble.middle(one["dominant_frequency"])
    apart = ensemble.motions(summaries, runs[0].scene.V)
    return together | {f"member_{name}": values for name, values in one.items()} | apart


def coords(members: int) -> dict[str, Axis]:
    """The pairs and the realisations, counted from 1."""
    pair = Axis(np.arange(1, PAIRS + 1), "1", "unstable pair, ascending in frequency")
    member = Axis(np.arange(1, members + 1), "1", "realisation, by the ramp of the drive")
    return {"pair": pair, "member": member} | ensemble.APART


def check(members: int, **others: Any) -> None:
    """Refuse what cannot be run; a scene whose contact has no unique solution fails as a point."""
    checks.count("members", members, 1000)
    ensemble.check(**others)


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add the unstable intervals."""
    return stability.with_unstable_intervals(dataset, rig_of(dataset), float(dataset["mu"]), float(dataset["V"]))


def ranges(theta: Any, chosen: Any) -> str:
    """The chosen inclinations as ranges of neighbours: "-10 to 0.5, 11 to 20 degrees"."""
    texts = [" to ".join(f"{x:g}" for x in np.unique(theta[[a, b - 1]])) for a, b in runs_of_true(chosen)]
    return f"{', '.join(texts)} degrees" if texts else "no inclination"


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Stability and motion at each inclination, the unstable intervals, and what is unusual."""
    theta, unstable = dataset["theta"].values, dataset["unstable_modes"].values
    kinds = np.array(regimes.KINDS)[regimes.kinds(dataset)]
    vibrates = ranges(theta, np.isin(kinds, regimes.VIBRATING))
    yield f"Steady sliding is unstable at {ranges(theta, unstable > 0)}; the rig vibrates at {vibrates}."
    papers = np.flatnonzero(np.isin(theta, [*paper.ANGLES_MEASURED, *paper.ANGLES])).tolist()
    rows = sorted({*planes.subset(len(theta), MOST_ROWS), *papers})
    names = ("theta", "mode_growth_rate", "dominant_frequency", *AVERAGED[:2], AVERAGED[3], "regime_share")
    table = labels.frame(dataset.isel(theta=rows), names, along="theta")
    table.columns = ["θ °", "growth 1/s", "dominant Hz", "RMS mm/s", "stick", "separation", "of realisations"]
    pairs = [
        ", ".join(f"{f:.0f}" for f in row[np.isfinite(row)]) or "-" for row in dataset["frequency"].values[rows]
    ]
    table.insert(1, "unstable Hz", pairs)
    table.insert(7, "regime", kinds[rows])
    yield f"By inclination{planes.of_all(rows, len(theta))}; growth of the least stable mode", table
    yield from stability.intervals_summary(dataset, float(dataset["mu"]))
    motion = labels.words(dataset["member_regime"])
    counts = pd.crosstab(motion.ravel(), np.repeat(unstable, motion.shape[1]), colnames=["unstable modes"])
    counts = counts.rename(columns="{:g}".format).rename_axis("regime").reset_index()
    yield "Realisations by regime and number of unstable modes", counts
    inside = (dataset["window_from"] <= dataset["theta"]) & (dataset["theta"] <= dataset["window_to"])
    most = float(dataset["max_duration"])
    cases = {
        "A mode is unstable outside of the unstable intervals": (len(theta) > 1)
        & (unstable > inside.sum("window").values),
        f"More than {PAIRS} modes are unstable, and the least stable are kept": unstable > PAIRS,
        "The realisations differ in regime": dataset["regime_share"].values < 1.0,
        f"The longest simulated time, {most:g} s, ended the runs": dataset["duration"].values >= most,
    }
    yield from (f"{case}: {ranges(theta, where)}." for case, where in cases.items() if where.any())


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Frequencies, growth rates and fractions of time; unstable intervals, regimes and the paper's text."""
    theta, bounds = dataset["theta"].values, np.stack([dataset["window_from"], dataset["window_to"]], axis=1)
    papers = is_papers_point(dataset, mu=paper.MU, F=paper.LOAD, V=paper.ANGLES_SPEED)
    heights = (3.0, 2.6, 1.4, 1.5 + 0.3 * len(bounds))
    figure, panels = figures.panels(4, 1, 17.0, 18.0 + 0.6 * len(bounds), sharex=True, height_ratios=heights)
    lines, growth, fractions, strips = panels
    for axes in (lines, growth):
        figures.spans(axes, bounds, color=figures.BLACK, alpha=0.06, zorder=0.5)
    angles.points(lines, 1e-3 * dataset["frequency"].where(dataset["frequency"] > 0.0), "unstable pair")
    dominant = 1e-3 * dataset["member_dominant_frequency"]
    angles.points(lines, dominant, "dominant, of each realisation", color=figures.BLUE)
    if papers:
        angles.paper_frequencies(lines, theta)
    lines.set(yscale="log", ylabel="frequency / kHz")
    figures.one_two_five(lines.yaxis)
    growth.axhline(0.0, color=figures.BLACK, linewidth=0.6)
    angles.points(growth, dataset["growth_rate"], "unstable pair")
    decays = dataset["mode_growth_rate"].where(~(dataset["mode_growth_rate"] > 0.0))
    angles.points(growth, decays, "least stable mode, where it decays", color=figures.GREEN)
    growth.margins(y=0.15)
    growth.set_ylabel("growth rate / (1/s)")
    parts = {state: dataset[f"{state}_fraction"].values for state in planes.STATE_COLOURS}
    planes.stack(fractions, cells.edges(theta), parts, [*planes.STATE_COLOURS.values()])
    planes.draw_mixed(fractions, dataset, "theta", "stick_fraction")
    fractions.set(ylim=(0.0, 1.0), ylabel="fraction\nof time")
    angles.regime_strips(strips, dataset, papers)
    for axes in panels:
        if axes.get_legend_handles_labels()[0]:
            axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    strips.set_xlabel(labels.label(dataset["theta"]))
    title = f"Stability and motion over the inclination, {figures.place(dataset, 'V', 'mu', 'F')}"
    figure.suptitle(f"{title}\n{regimes.damping_text(dataset)}")
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
    claims=CLAIMS, check=check, chaotic=True, beams=True,
)  # fmt: skip
