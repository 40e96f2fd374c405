"""Sweeps of one parameter up and down, and the intervals in which two motions are stable."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from studies.declaring import labels
from studies.declaring.parameters import RUN, SCENE
from studies.declaring.spec import edges, evenly
from studies.motion import following, regimes
from studies.plotting import figures, general, planes
from studies.study import Parameter, Study


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The interval in which the motion depends on the direction, and the motion at each value."""
    name, (unit, factor) = following.followed(dataset), labels.unit_of(dataset[following.followed(dataset)])
    ends = [
        f"beyond {factor * value:.4g}" if is_open else f"{factor * value:.4g} ± {factor * error:.2g}"
        for value, error, is_open in following.interval(dataset)
    ]
    where = f"{labels.title(name)} from {' to '.join(ends)}{f' {unit}' if unit else ''}"
    count, size = int(np.isfinite(dataset["bistable_low"]).sum()), dataset["bistable_low"].size
    if ends:
        yield f"Sliding and vibration are both stable at {where}, in {labels.counted(count, size, 'loop')}."
    else:
        yield "Up and down the motion is the same, steady or vibrating, at each value: there is no hysteresis."
    at = dataset.isel({dim: 0 for dim in dataset["status"].dims})
    table = pd.DataFrame({name: labels.readable(dataset[name]).values})
    for way in following.DIRECTIONS:
        codes, rms = (at[key].sel(direction=way).values for key in ("regime", "velocity_rms"))
        table[way] = [regimes.KINDS[int(code)] if np.isfinite(code) else "-" for code in codes]
        table[f"{way}, rms mm/s"] = (1e3 * rms).round(4)
    table["growth rate 1/s"] = at["growth_rate"].values
    yield "Motion at each value, first loop", table


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Extrema of the velocity of B both ways, and growth rates."""
    if not bool(np.isfinite(dataset["regime"]).any()):
        return general.draw(dataset)
    name, ends = following.followed(dataset), following.interval(dataset)
    figure, panels = figures.panels(3, 1, 6.5, 4.2, 4.0, sharex=True)
    top, middle, below = panels
    x, factor = labels.readable(dataset[name]).values, labels.unit_of(dataset[name])[1]
    shift = 0.12 * np.diff(edges(x))
    for (way, (colour, marker)), side in zip(figures.WAYS.items(), (-1.0, 1.0), strict=True):
        at = dataset.sel(direction=way).transpose(name, ...)
        extrema, rms = (1e3 * at[key].values.reshape(len(x), -1) for key in ("extremum", "velocity_rms"))
        along = np.broadcast_to((x + side * shift)[:, None], extrema.shape)
        top.plot(along.ravel(), extrema.ravel(), ".", color=colour, markersize=1.5, alpha=0.5)
        middle.plot(
            x, rms, color=colour, marker=marker, linewidth=0.6, markersize=4.0, mfc="none", label=f"{way}ward"
        )
    at = dataset.isel({dim: 0 for dim in dataset["status"].dims if dim in dataset["growth_rate"].dims})
    below.plot(x, at["growth_rate"], color=figures.BLACK, label="modes below 10 kHz")
    below.plot(x, at["model_growth_rate"], ":", color=figures.GREY, label="all modes that are simulated")
    below.axhline(0.0, color=figures.GREY, linewidth=0.8)
    sides = ("extrema of the velocity of B / (mm/s)", "RMS velocity of B / (mm/s)", "growth rate / (1/s)")
    for axes, text in zip(panels, sides, strict=True):
        figures.spans(axes, [[factor * end[0] for end in ends]])
        axes.set_ylabel(text)
    planes.set_side(below, "x", dataset[name])
    figures.entitle(panels, ("motion", "its size", "linear stability of steady sliding"))
    figures.legend_below(figure, [middle, below], 4)
    both = "; grey: sliding and vibration are both stable" if ends else ""
    figure.suptitle(f"{labels.title(name)} followed up and down{both}")
    return figure


STUDY = Study(
    name="hysteresis",
    title="Hysteresis: one parameter followed up and down",
    question="Where a parameter rises and falls again, does the rig begin and cease to vibrate at one value?",
    paper="Each test starts from rest at one set of parameters.",
    parameters={
        "mu": Parameter(evenly(0.08, 0.13, 26), "1", SCENE["mu"].text, inner=True),
        "member": Parameter(np.arange(1, 4), "1", "realisation, by the ramp of the drive"),
        "follow": Parameter("mu", "1", "parameter that is followed", following.FOLLOWED, common=True),
        "hold": Parameter(0.5, "s", "time of statistics at each value", common=True),
        "knock": Parameter(
            0.0, "N s", "start by this impulse on sliding P1, positive onto P2; 0: start of the drive", common=True
        ),
    }
    | RUN,
    outputs=following.OUTPUTS, function=following.follow, coords=following.COORDS, derive=following.derive,
    summary=summarise, figure=draw, check=following.check, chaotic=True,
)  # fmt: skip
