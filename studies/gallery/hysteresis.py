"""One parameter followed up and down, each motion from the end of the last: where two motions are stable."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from studies.declaring import labels
from studies.declaring.parameters import RUN, SCENE
from studies.declaring.spec import edges, evenly
from studies.motion import regimes
from studies.motion.following import (
    COORDS,
    DIRECTIONS,
    FOLLOWED,
    OUTPUTS,
    check,
    derive,
    follow,
    followed,
    interval,
)
from studies.plotting import figures, general, planes
from studies.study import Parameter, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Where the motion depends on the direction, and the motion at each value."""
    name = followed(dataset)
    factor, unit = labels.unit_of(dataset[name])[1], labels.unit_of(dataset[name])[0]
    ends = [
        f"{'beyond ' if is_open else ''}{factor * value:.4g} ± {factor * error:.2g}"
        for value, error, is_open in interval(dataset)
    ]
    where = f"{labels.title(name)} from {' to '.join(ends)}{f' {unit}' if unit else ''}"
    count = int(np.isfinite(dataset["bistable_low"]).sum())
    loops = dataset["bistable_low"].size
    if ends:
        yield f"Sliding and vibration are both stable at {where}, in {count} of {loops} loops."
    else:
        yield "Up and down the motion is the same, steady or vibrating, at each value: there is no hysteresis."
    at = dataset.isel({dim: 0 for dim in dataset["status"].dims})
    table = pd.DataFrame({name: labels.readable(dataset[name]).values})
    for k, way in enumerate(DIRECTIONS):
        codes = at["regime"].isel(direction=k).values
        table[f"{way}"] = [regimes.KINDS[int(code)] if np.isfinite(code) else "-" for code in codes]
        table[f"{way}, rms mm/s"] = (1e3 * at["velocity_rms"].isel(direction=k)).round(4).values
    table["growth rate 1/s"] = at["growth_rate"].values
    yield "Motion at each value, first loop", table


def draw(dataset: xr.Dataset) -> Figure:
    """Extrema of the velocity of B both ways, and growth rates."""
    if not bool(np.isfinite(dataset["regime"]).any()):
        return general.draw(dataset)
    name, ends = followed(dataset), interval(dataset)
    figure, (top, middle, below) = figures.panels(3, 1, 16.0, 19.0, sharex=True, height_ratios=(2.0, 1.2, 1.0))
    x, factor = labels.readable(dataset[name]), labels.unit_of(dataset[name])[1]
    looks = (("up", figures.BLUE, "^", -1.0), ("down", figures.ORANGE, "v", 1.0))
    shift = 0.12 * np.diff(edges(x.values))
    rest = [dim for dim in dataset["status"].dims]
    for k, (way, colour, marker, side) in enumerate(looks):
        at = dataset.isel(direction=k).transpose(name, ...)
        points = 1e3 * at["extremum"].values.reshape(len(x), -1)
        along = np.broadcast_to((x.values + side * shift)[:, None], points.shape)
        top.plot(along.ravel(), points.ravel(), ".", color=colour, markersize=1.5, alpha=0.5)
        rms = 1e3 * at["velocity_rms"].values.reshape(len(x), -1)
        middle.plot(x, rms, color=colour, linewidth=0.6)
        middle.plot(x, rms, marker, color=colour, markersize=4.0, mfc="none", label=None)
        middle.plot([], [], color=colour, marker=marker, mfc="none", label=f"{way}ward")
    at = dataset.isel({dim: 0 for dim in rest if dim in dataset["growth_rate"].dims})
    below.plot(x, at["growth_rate"], color=figures.BLACK, label="modes below 10 kHz")
    below.plot(x, at["model_growth_rate"], ":", color=figures.GREY, label="all modes that are simulated")
    below.axhline(0.0, color=figures.GREY, linewidth=0.8)
    for axes in (top, middle, below) if ends else ():
        axes.axvspan(factor * ends[0][0], factor * ends[1][0], color=figures.GREY, alpha=0.2, linewidth=0.0)
    top.set_ylabel("extrema of the velocity of B / (mm/s)")
    middle.set_ylabel("RMS velocity of B / (mm/s)")
    below.set_ylabel("growth rate / (1/s)")
    planes.set_side(below, "x", dataset[name])
    figures.letter((top, middle, below), ("motion", "its size", "linear stability of steady sliding"))
    figures.legend_below(figure, [middle, below], 4)
    where = [labels.named(each, dataset[each]) for each in ("V", "theta", "mu", "F") if dataset[each].ndim == 0]
    both = "; grey: sliding and vibration are both stable" if ends else ""
    figure.suptitle(figures.fitted(f"{labels.title(name)} followed up and down, {', '.join(where)}{both}", 16.0))
    return figure


STUDY = Study(
    name="hysteresis",
    title="Hysteresis: one parameter followed up and down",
    question="Where a parameter rises and falls again, does the rig begin and cease to vibrate at one value?",
    paper="Each test starts from rest at one set of parameters.",
    parameters={
        "mu": Parameter(evenly(0.08, 0.13, 26), "1", SCENE["mu"].text, inner=True),
        "member": Parameter(np.arange(1, 4), "1", "realisation, by the ramp of the drive"),
        "follow": Parameter("mu", "1", "parameter that is followed", FOLLOWED, common=True),
        "hold": Parameter(0.5, "s", "time of statistics at each value", common=True),
        "knock": Parameter(
            0.0, "N s", "start by this impulse on sliding P1, positive onto P2; 0: start of the drive", common=True
        ),
    }
    | RUN,
    outputs=OUTPUTS, function=follow,
    coords=COORDS,
    derive=derive, summary=summarise, figure=draw, check=check, chaotic=True,
)  # fmt: skip
