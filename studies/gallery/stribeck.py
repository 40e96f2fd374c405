"""Friction that falls with the sliding speed: its contribution to an instability, and the motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Scene, Transient
from studies.declaring import labels
from studies.declaring.parameters import FRICTION
from studies.declaring.spec import evenly, logarithmically
from studies.motion import ensemble, mixed, regimes
from studies.motion.jobs import Job, outcomes
from studies.motion.stability import largest_growth, sliding_of
from studies.plotting import figures, general, planes
from studies.study import Parameter, Study

MOTION = (
    *("regime", "stick_fraction", "separation_fraction", "velocity_rms", "dominant_frequency", "motions"),
    *mixed.SHOWN,
)
OUTPUTS = {
    "growth_rate": ("s-1", "growth rate of steady sliding's least stable mode below 10 kHz"),
    "growth_coupled": ("s-1", "share of coupled modes: the growth rate with the friction at V, constant"),
    "growth_falling": ("s-1", "share of falling friction: what the fall adds to the growth rate"),
    "growth_frequency": ("Hz", "frequency of the least stable mode below 10 kHz; 0: it does not oscillate"),
} | {name: replace(variable, dtype="float32") if variable.dtype == "float64" else variable
     for name, variable in ensemble.outputs().items() if name in MOTION}  # fmt: skip
# Of the kinetic ratios of which the growth rate is drawn.
COLOURS = (figures.GREY, figures.BLUE, figures.ORANGE, figures.RED)
# The mildest growth that a logarithmic scale shows, 1/s.
FAINTEST = 10.0


def shares(scene: Scene) -> dict[str, float]:
    """Growth rate of the least stable mode, its two contributions, and its frequency.

    Let s(m, k) be the largest growth rate of steady sliding below 10 kHz with T' = m N' + k v', m = mu(V), k = -N0
    mu'(V). The contribution of mode coupling, damping included, is s(m, 0), with a coefficient of friction that
    does not depend on the speed. The contribution of falling friction is the rest, s(m, k) - s(m, 0), to first
    order k Re d(phi)/dk. The oscillator x'' + 2 xi x' + x has the contributions -xi and k / 2.
    """
    kinetic = scene.mu * scene.friction.ratio(scene.V)
    growth, frequency, _ = largest_growth(scene.rig, scene.drive_theta, scene.mu, **sliding_of(scene))
    coupled = largest_growth(scene.rig, scene.drive_theta, kinetic)[0]
    return dict(zip(OUTPUTS, map(float, (growth, coupled, growth - coupled, frequency)), strict=False))


def motions(scenes: Sequence[Scene], members: int, **options: Any) -> dict[str, Any]:
    """Contributions to the growth rate, and the motion, of each scene."""

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        motion = ensemble.statistics(runs)
        return shares(jobs[0].scene) | {name: motion[name] for name in MOTION}

    return outcomes([ensemble.ensemble(scene, members, options) for scene in scenes], values)


def mostly_falling(dataset: xr.Dataset) -> xr.DataArray:
    """Mark unstable points at which falling friction contributes more than half of the growth rate."""
    return (dataset["growth_rate"] > 0.0) & (dataset["growth_falling"] > 0.5 * dataset["growth_rate"])


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The range in which falling friction dominates, its contribution, and the effect of each kinetic ratio."""
    unstable, without = dataset["growth_rate"] > 0.0, dataset["growth_coupled"] > 0.0
    falling, kinds = mostly_falling(dataset), dataset["status"].copy(data=regimes.kinds(dataset))
    vibrates = kinds.copy(data=regimes.is_of(kinds.values, *regimes.VIBRATING))
    counts = [int(each.sum()) for each in (unstable, without, falling, vibrates, vibrates & ~without)]
    every, constant, most, moving, only = (labels.counted(count, kinds.size) for count in counts)
    yield (
        f"Steady sliding is unstable at {every}; it would be at {constant} if friction kept its value at V."
        f" Falling friction makes more than half of the growth rate at {most}. The rig vibrates at {moving}; at"
        f" {only} it does so only because friction falls."
    )
    rows = []
    for ratio in dataset["kinetic_ratio"].values:
        at = {"kinetic_ratio": ratio}
        codes, growth = kinds.sel(at), dataset["growth_rate"].sel(at)
        texts = [f"{regimes.KINDS[code]} {regimes.span(dataset, codes == code, 'V')}" for code in np.unique(codes)]
        rows.append((ratio, float(growth.max()), regimes.span(dataset, falling.sel(at), "V"), ", ".join(texts)))
    heads = ["kinetic ratio", "largest growth 1/s", "mostly by falling friction", "motion"]
    yield "By kinetic ratio; ranges are speeds in mm/s", pd.DataFrame(rows, columns=heads)


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Growth rate and regime over speed and kinetic ratio, and both contributions along the speed."""
    growth, kinds = dataset["growth_rate"], dataset["status"].copy(data=regimes.kinds(dataset))
    if min(dataset.sizes["V"], dataset.sizes["kinetic_ratio"]) == 1 or not bool(growth.notnull().any()):
        return general.draw(dataset)
    figure, panels = figures.panels(3, 1, 4.5, 4.5, 6.5, sharex=True)
    (top, middle, below), sides = panels, ("V", "kinetic_ratio")
    scale: dict[str, Any] = {"norm": "log", "vmin": FAINTEST, "vmax": max(float(growth.max()), 10.0 * FAINTEST)}
    planes.numbers(top, growth, *sides, "growth rate / (1/s)", growth <= 0.0, **scale)
    planes.classes(middle, kinds, *sides)
    for axes in (top, middle):
        planes.outline(axes, mostly_falling(dataset), *sides)
    below.plot([], [], color="black", linewidth=1.5, label="below: mostly by falling friction")
    chosen = planes.subset(dataset.sizes["kinetic_ratio"], len(COLOURS))[::-1]
    speeds = labels.readable(dataset["V"]).values
    for k, colour in zip(chosen, COLOURS, strict=False):
        at = dataset.isel(kinetic_ratio=k).transpose("V", ...)
        below.plot(
            speeds, at["growth_rate"], color=colour, label=labels.named("kinetic_ratio", at["kinetic_ratio"])
        )
        below.plot(speeds, at["growth_coupled"], color=colour, linestyle=":")
    below.plot([], [], color="black", linestyle=":", label="by coupled modes alone")
    below.axhline(0.0, color=figures.GREY, linewidth=0.8)
    least = min(float(dataset[name].min()) for name in ("growth_rate", "growth_coupled"))
    below.set_yscale("symlog", linthresh=100.0)
    below.set(ylabel="growth rate / (1/s)", ylim=(min(3.0 * least, -10.0), None))
    for axes in panels:
        planes.set_side(axes, "x", dataset["V"])
        axes.label_outer()
    figures.entitle(
        panels, ("growth rate of the least stable mode", "regime", "growth rate, and without the fall of friction")
    )
    figures.legend_below(figure, panels, 3)
    figure.suptitle("Friction that falls with the speed")
    return figure


STUDY = Study(
    name="stribeck",
    title="Friction that falls with the speed",
    question="How much of an instability is due to friction that falls with the speed, how much to modes that "
    "friction couples, and how does the rig move?",
    paper="Friction has one coefficient: modes that it couples are enough for an instability.",
    parameters={
        "V": Parameter(logarithmically(1e-4, 0.1, 25), "m s-1", "speed of the drive"),
        "kinetic_ratio": Parameter(evenly(0.5, 1.0, 6), "1", FRICTION["kinetic_ratio"].text),
    }
    | ensemble.members(1)
    | ensemble.until(0.3, 6.0),
    outputs=OUTPUTS, function=motions, coords=ensemble.coords, check=ensemble.check, summary=summarise,
    figure=draw, normalised=True, chaotic=True,
)  # fmt: skip
