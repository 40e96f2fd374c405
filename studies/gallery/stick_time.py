"""Duration of sticks against the speed of the drive, T_st ~ 1/V, at start-up and later."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from studies import paper
from studies.declaring import labels, spec
from studies.declaring.parameters import RUN, Parameter
from studies.motion import ensemble, stick_fit
from studies.motion.run import SETTLING
from studies.plotting import figures, planes
from studies.study import Claim, Study
from sweeps import Axis

# Five times the default, Hz: where bursts are rare, a stick is only as right as they are. At 0.5 mm/s T V is 61 um
# by default, 70 with twice and three times that; at 0.25 mm/s it is 57 with twice and 69.5 with five times.
CUTOFF = 585e3
# mm/s; most of them have their half and their double among them: of loads, only equivalent scenes.
SPEEDS = (0.25, 0.325, 0.4, 0.5, 0.65, 0.8, 1.0, 1.15, 1.3, 1.45, 1.6, 2.0, 2.6, 3.2, 4.0, 5.0)
# How each kind of stick is drawn; colours of mu or speeds, markers of F.
LOOKS: dict[str, dict[str, Any]] = {
    "start_up": {"color": figures.ORANGE, "marker": "s", "label": "start-up"},
    "sustained": {"color": figures.BLUE, "marker": "o", "label": "sustained"},
}
MARKERS = "ov^Ds"


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Exponents of the power laws, sticks at each speed, and all coefficients of friction and loads."""
    at, members = stick_fit.at_paper(dataset), dataset.sizes["member"]
    laws = [stick_fit.with_ends(at.isel(law=k), "exponent") for k in range(at.sizes["law"])]
    end = labels.number(1e3 * float(at["intermittence_end"]))
    where = f"mu = {float(at['mu']):g}, F = {float(at['F']):g} N"
    yield (
        f"The duration of start-up sticks is proportional to V^n with n = {laws[0]} at {where}; sustained sticks"
        f" occur up to {end} mm/s."
    )
    upto, span = f"sustained, up to {end} mm/s", " to ".join(f"{1e3 * V:g}" for V in stick_fit.SPAN)
    third = f"sustained, up to {stick_fit.SLOW:.2f} of that"
    texts = "start-up, 1 to 2 mm/s", upto, third, f"{upto}, within {span}"
    yield "Exponents with 95 % intervals", pd.DataFrame({"sticks": texts, "n": laws})
    table = labels.frame(at, ["V"])
    for k, (kind, look) in enumerate(LOOKS.items()):
        rows = [at.isel(kind=k, V=place) for place in range(at.sizes["V"])]
        table[look["label"]] = at[f"{kind}_count"].sum("member").values.astype(int)
        table[f"T V μm {look['label']}"] = [
            stick_fit.with_ends(x, "mean_stick_time", 1e6 * float(x["V"])) for x in rows
        ]
    table["local n"] = at["local_exponent"].sel(kind="sustained").values.round(2)
    table["% of time"] = (100.0 * at["sustained_share"].values).round(1)
    yield f"Long sticks of {members} realisations, begun within {SETTLING:g} s of the first slip or later", table
    near = dataset.sel(V=min(paper.SPEEDS), method="nearest").stack(point=["mu", "F"], create_index=False)
    lowest = dataset.isel(V=0).stack(point=["mu", "F"], create_index=False)
    grip, limit = (near["mu"] * near["F"]).where(near["mu"] > 0.0), 1e3 * near["intermittence_end"]
    slow = 1e6 * lowest["mean_stick_time"].sel(kind="sustained") * lowest["V"] / grip
    columns = {f"{look['label']} ms": 1e3 * near["mean_stick_time"].sel(kind=kind) for kind, look in LOOKS.items()}
    columns |= {"ends at mm/s": limit, "V / (μF) mm/s/N": limit / grip, "T V / (μF) μm/N": slow}
    table = labels.frame(near, ["mu", "F"], along="point").assign(**{k: v.values for k, v in columns.items()})
    yield f"Sticks at {labels.named('V', near['V'])}; end of intermittence; T V at the lowest V", table
    yield (
        "T: mean duration of a stick; local n: exponent of T ~ V^n between neighbouring speeds; % of time: time in"
        " sustained sticks; ends at: the highest V with them, also divided by mu F."
    )


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Stick times over the speed, their deviation from 1 / V and distribution, and all mu and F in one panel."""
    figure, panels = figures.panels(2, 2, 6.5)
    (times, products, spread, collapse), at = panels, stick_fit.at_paper(dataset)
    V = 1e3 * np.abs(at["V"].values)
    for axes, text in ((times, "mean stick time / ms"), (products, "T V / μm")):
        axes.set(xscale="log", xlim=(0.85 * V.min(), 1.15 * V.max()), xlabel="V / (mm/s)", ylabel=text)
    times.set_yscale("log")
    for kind, look in LOOKS.items():
        mean, *ends = 1e3 * stick_fit.means(at, kind)
        figures.curve(times, V, mean, ends=ends, **look)
        figures.curve(products, V, V * mean, ends=V * np.array(ends), **look)
    once = 1e3 * at["loading_time"].mean("member")
    times.plot(V, once, ".:", markersize=3.0, color=figures.GREY, label="first stick, μF / (k V)")
    start = 1e3 * at["mean_stick_time"].sel(kind="start_up").values[np.isclose(V, 1e3 * min(paper.SPEEDS))]
    red: dict[str, Any] = {"color": figures.RED, "zorder": 3.0}
    if np.isfinite(start).any():
        law = 1e3 * np.sort(paper.STICK_RATIO_SPEEDS), start * [1.0, paper.STICK_RATIO]
        times.plot(*law, linewidth=2.2, label="paper: half at twice V", **red)
    if np.isfinite(end := 1e3 * float(at["intermittence_end"])):
        products.axvline(end, linestyle="--", linewidth=1.0, label=f"intermittence ends, {end:.2f} mm/s", **red)
    products.set_ylim(bottom=0.0)
    T = stick_fit.lasting(at)
    chosen = [[*T][k] for k in planes.subset(len(T), 4)] if T else []
    figures.distributions(spread, {f"{1e3 * V:g} mm/s ({len(T[V])})": T[V] for V in chosen})
    spread.set(xlabel="T V / μm", ylabel="fraction of the sticks below")
    draw_collapse(collapse, dataset)
    figures.one_two_five(times.xaxis, times.yaxis, products.xaxis, collapse.xaxis)
    opened = any(str(line.get_markerfacecolor()) == "none" for line in collapse.lines)
    figures.entitle(
        panels, ("mean", "mean × speed", "sustained sticks", "all μ and F" + "; open: start-up" * opened)
    )
    figure.supxlabel(f"means of fewer than {stick_fit.LEAST_STICKS:g} sticks a realisation are left out")
    figures.legend_below(figure, [times, products], 3)
    figure.suptitle(f"Duration of long sticks; (a) to (c) at {figures.place(at, 'mu', 'F')}")
    return figure


def draw_collapse(axes: figures.Axes, dataset: xr.Dataset) -> None:
    """T V / (mu F) over V / (mu F): one curve, if friction and load only scale the motion."""
    axes.set(xscale="log", xmargin=0.1, xlabel="V / (μF) / (mm/s/N)", ylabel="T V / (μF) / (μm/N)")
    frictions = list(zip(dataset["mu"].values[dataset["mu"].values > 0.0], figures.COLOURS, strict=False))
    loads, V = list(zip(dataset["F"].values, MARKERS, strict=False)), np.abs(dataset["V"].values)
    look: dict[str, Any] = {"linestyle": "none", "markersize": 4.0, "markeredgewidth": 0.7}
    for (mu, colour), (F, marker) in product(frictions, loads):
        for kind, fill in (("sustained", colour), ("start_up", "none")):
            y = 1e6 * V * stick_fit.means(dataset.sel(mu=mu, F=F), kind)[0] / (mu * F)
            figures.curve(axes, 1e3 * V / (mu * F), y, color=colour, marker=marker, markerfacecolor=fill, **look)
    for mu, colour in frictions if axes.lines else ():
        axes.plot([], [], color=colour, marker="o", label=f"μ = {mu:g}", **look)
    for F, marker in loads if axes.lines else ():
        axes.plot([], [], color=figures.GREY, marker=marker, label=f"F = {F:g} N", **look)
    axes.set_ylim(bottom=0.0)
    if axes.lines:
        axes.legend(loc="lower left", ncols=2, handletextpad=0.1, columnspacing=0.8)


STUDY = Study(
    name="stick_time",
    title="T_st ~ 1/V: duration of sticks against speed",
    question="How long does the contact stick between two bursts of vibration, and is that time as 1/V, with the "
    "published scheme's numerical damping?",
    paper="Sections 2 and 3.5.4.2: the mean duration of the sticking phases is as 1/V, that at 2 mm/s half "
    "that at 1 mm/s; from some speed on they vanish (none at 5 mm/s); less friction or less load shortens them.",
    parameters={
        "V": Parameter([float(f"{V}e-3") for V in SPEEDS], "m s-1", "speed of the drive"),
        "member": Parameter(np.arange(1, 17), "1", "realisation, by the ramp of the drive"),
        "mu": Parameter(spec.evenly(0.75 * paper.MU, 1.25 * paper.MU, 3), "1", "coefficient of friction"),
        "F": Parameter([0.5 * paper.LOAD, paper.LOAD, 2.0 * paper.LOAD], "N", "load on A"),
        **ensemble.loading_times(3.0, 1.0, 30.0, "published"),
        "cutoff": replace(RUN["cutoff"], default=CUTOFF),
    },
    outputs=stick_fit.OUTPUTS, function=stick_fit.sticks,
    coords={"stick": Axis(np.arange(1, stick_fit.KEPT + 1), "1", "long stick, in the order in which they begin")},
    derive=stick_fit.with_laws, summary=summarise, figure=draw,
    claims=(
        Claim("exponent", {"law": "start_up"}, -1.0, "3.5.4.2"),
        Claim("exponent", {"law": "sustained_0.5_to_4_mm/s"}, -1.0, "2, 3.5.4.2"),
        *(Claim(f"{kind}_ratio", {}, paper.STICK_RATIO, "3.5.4.2") for kind in LOOKS),
    ),
    check=stick_fit.check, normalised=True, chaotic=True,
)  # fmt: skip
