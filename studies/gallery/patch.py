"""Several contacts on a rigid foot below P1's tip in place of the point contact: onset and motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Rig, Scene, checks, reduced_model
from studies.declaring import labels
from studies.declaring.spec import evenly
from studies.motion import ensemble, mixed
from studies.motion.jobs import Job, outcomes
from studies.physics.foot import closed, foot, growth, onset
from studies.plotting import figures, planes
from studies.study import Parameter, Study

SHARES = ("stick_fraction", "separation_fraction")
STATISTICS = (*SHARES, "velocity_rms")
MOTION = ("regime", "dominant_frequency", "motions", *STATISTICS, *mixed.SHOWN)
OUTPUTS = {
    "onset_mu": ("1", "lowest coefficient of friction at which steady sliding is unstable; NaN: none up to 1"),
    "onset_frequency": ("Hz", "frequency of the unstable mode at the onset; 0: it does not oscillate"),
    "closed_at_rest": ("1", "number of contacts that the load closes without friction"),
    "closed_at_onset": ("1", "number of contacts that are closed in steady sliding at the onset"),
    "closed": ("1", "number of contacts that are closed in steady sliding"),
    "growth_rate": ("s-1", "growth rate of steady sliding's least stable mode below 10 kHz"),
} | {name: replace(variable, scale="") for name, variable in ensemble.outputs().items() if name in MOTION}
for name, unit in zip(STATISTICS, ("1", "1", "m s-1"), strict=True):
    OUTPUTS[f"{name}_std"] = unit, f"standard deviation over realisations of the {name.replace('_', ' ')}"
MOST, ABOUT = 20, ("onset_mu", "onset_frequency", "closed_at_rest", "closed_at_onset")
COLUMNS = ("nodes", "mu", "finer", "closed", "regime", *STATISTICS)
COLOURS = (figures.BLACK, figures.ORANGE, figures.RED, figures.BLUE, figures.GREY)


def motions(
    rig: Rig, V: Any, theta: Any, mu: Any, F: Any, nodes: Any, finer: Any, foot_length: float, members: int,
    **options: Any,
) -> dict[str, Any]:  # fmt: skip
    """Onset and motion of each foot."""

    def jobs(V: float, theta: float, mu: float, F: float, nodes: float, finer: float) -> list[Job]:
        own = foot(rig, theta, int(nodes), foot_length)
        step = reduced_model(own, 0.0, options["cutoff"]).default_step / finer
        runs = ensemble.ensemble(Scene(V, 0.0, mu, F, own), members, options)
        return [replace(job, options={**job.options, "step": step}) for job in runs]

    def values(jobs: Any, runs: Any) -> dict[str, Any]:
        own, mu = jobs[0].scene.rig, jobs[0].scene.mu
        lowest, hertz = onset(own)
        numbers = (lowest, hertz, closed(own, 0.0), closed(own, lowest), closed(own, mu), growth(own, mu))
        motion, each = ensemble.statistics(runs), ensemble.summaries(runs)
        scatter = {f"{name}_std": each[name].std(ddof=1) if len(runs) > 1 else np.nan for name in STATISTICS}
        return dict(zip(OUTPUTS, numbers, strict=False)) | {name: motion[name] for name in MOTION} | scatter

    points = np.broadcast(V, theta, mu, F, nodes, finer)
    return outcomes([jobs(*map(float, point)) for point in points], values)


def check(rig: Rig, nodes: Any, finer: Any, foot_length: Any, **others: Any) -> None:
    """Refuse a foot longer than P2 can carry, and parameters with which no scene can be simulated."""
    for count in np.ravel(nodes):
        checks.count("nodes", count, MOST)
    checks.between("finer", np.min(finer), 1.0, 1e3, "1")
    most = 2.0 * min(rig.contact_position, rig.p2.length - rig.contact_position)
    text = f"above 0 and below {most:.4g} m, so that P2 carries both ends"
    checks.number("foot_length", np.max(foot_length), text, lambda x: 0.0 < x < most)
    checks.between("V", np.min(others["V"]), 1e-12, 1e6, "m/s")
    ensemble.check(**others)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Onset and motion on a foot and on a point, and the influence of the number of nodes and of the step."""
    table = labels.frame(dataset[[*ABOUT]].max(("mu", "finer")), ["nodes", *ABOUT])
    point, feet = table[table["nodes"] == 1], table[table["nodes"] > 1].dropna()
    if len(point) and len(feet):
        onsets = " or ".join(dict.fromkeys(map(labels.number, feet["onset_mu"])))
        rest, sliding = (" or ".join(f"{n:.0f}" for n in sorted(set(feet[name]))) for name in ABOUT[2:])
        length = labels.number(1e3 * float(dataset["foot_length"]))
        yield (
            f"Steady sliding is unstable from mu = {labels.number(point['onset_mu'].item())} on with a point, from"
            f" {onsets} on with a patch of {length} mm: two closed contacts keep P1's tip from turning, until"
            f" friction has tilted the foot. At rest {rest} contacts are closed, at the onset {sliding}."
        )
    several = dataset.isel(nodes=dataset["nodes"].values > 2)
    for over, text in (("nodes", "The number of nodes, from three on,"), ("finer", "A finer step")):
        if several.sizes["nodes"] and several.sizes[over] > 1:
            stick, open_ = (float((several[n].max(over) - several[n].min(over)).max()) for n in SHARES)
            text += (
                f" changes the fraction of time in stick by at most {stick:.3f} and in separation by {open_:.3f}"
            )
            scatter = max(float(several[f"{n}_std"].max()) for n in SHARES)
            yield f"{text}; between realisations they scatter by up to {scatter:.3f}."
    yield "By number of nodes", table
    yield "Motion", labels.frame(dataset, COLUMNS, along=["nodes", "mu", "finer"])


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Onset by number of nodes; statistics along the friction by number of nodes and step."""
    figure, (first, *panels) = figures.panels(2, 2, 5.2)
    nodes, mu, onsets = dataset["nodes"].values, dataset["mu"].values, dataset[[*ABOUT]].max(("mu", "finer"))
    colours = [COLOURS[k % len(COLOURS)] for k in range(len(nodes))]
    bars = first.bar(nodes.astype(str), np.nan_to_num(onsets["onset_mu"]), color=colours, width=0.6)
    hertz = ["none" if np.isnan(x) else f"{x:.0f} Hz" for x in onsets["onset_frequency"].values]
    first.bar_label(bars, hertz, padding=2.0)
    first.set(xlabel="nodes", ylabel="μ at flutter onset", ymargin=0.12)
    apart = np.diff(mu).min(initial=np.ptp(mu) or 0.1)
    for axes, name in zip(panels, STATISTICS, strict=True):
        planes.set_side(axes, "x", dataset["mu"])
        for k, j in np.ndindex(len(nodes), min(dataset.sizes["finer"], 2)):
            at = dataset.isel(nodes=k, finer=j).transpose("mu", ...)
            values, error = (labels.readable(at[each]).values for each in (name, f"{name}_std"))
            named = f"open: step / {at['finer']:g}" if j else f"{nodes[k]} nodes" if nodes[k] > 1 else "point"
            look: dict[str, Any] = {
                "color": colours[k],
                "mfc": "white" if j else colours[k],
                "marker": "o",
                "linestyle": "none",
            }
            # Side by side, for many are equal.
            place = mu + apart * (0.15 * (k - 0.5 * (len(nodes) - 1)) + 0.06 * j)
            axes.errorbar(place, values, np.nan_to_num(error), markersize=4.0, **look)
            if j == 0 or k == len(nodes) - 1:
                axes.plot([], [], **look, label=named)
        axes.set_ylabel(labels.label(dataset[name]))
    panels[-1].set_yscale("log")
    figures.entitle((first, *panels), ("steady sliding", "stick", "separation", "velocity of B"))
    figures.legend_below(figure, panels[:1], 6)
    figure.suptitle("Point and patch")
    return figure


STUDY = Study(
    "patch",
    "A patch of several contacts in place of a point",
    "How do the onset and the motion change if P1 stands on a foot that touches P2 in several places?",
    {
        "nodes": Parameter(np.array([1, 2, 3, 5, 10]), "1", "contacts, evenly along the foot; 1: the point"),
        "mu": Parameter(evenly(0.1, 0.5, 5), "1", "coefficient of friction"),
        "finer": Parameter(np.array([1.0, 3.0]), "1", "by how much shorter the step is than the default one"),
        "V": Parameter(2e-3, "m s-1", "speed of the drive"),
        "foot_length": Parameter(15e-3, "m", "length of the foot, the point in its middle", common=True),
    } | ensemble.members(4) | ensemble.until(0.3, 1.0),
    OUTPUTS,
    motions,
    paper="P1 touches P2 in one point.",
    coords=ensemble.coords, check=check, summary=summarise, figure=draw, chaotic=True, beams=True,
)  # fmt: skip
