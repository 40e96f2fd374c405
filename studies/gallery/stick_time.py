"""How long the contact sticks against the speed of the drive: T_st ~ 1/V, at start-up and later."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Scene, checks, loading_time
from studies import paper
from studies.declaring import labels, spec
from studies.declaring.parameters import RUN, Parameter
from studies.motion import ensemble
from studies.motion.jobs import outcomes
from studies.motion.regimes import damping_text
from studies.motion.run import SETTLING
from studies.motion.stick_fit import SLOW, SPAN, with_laws
from studies.plotting import figures, planes
from studies.study import Claim, Study
from sweeps import Axis, Variable

# So many sticks of a run are stored one by one; its counts and totals are of all.
KEPT = 64
# Five times the default, Hz: where bursts are rare, a stick is only as right as they are. At 0.5 mm/s T V is 61 um
# by default, 70 with twice and three times that; at 0.25 mm/s it is 57 with twice and 69.5 with five times.
CUTOFF = 585e3
# mm/s; most of them have their half and their double among them: of loads, only equivalent scenes.
SPEEDS = (0.25, 0.325, 0.4, 0.5, 0.65, 0.8, 1.0, 1.15, 1.3, 1.45, 1.6, 2.0, 2.6, 3.2, 4.0, 5.0)
OUTPUTS = {
    "stick_time": Variable("s", "duration of each long stick, start-up first", ("stick",), "float32", digits=4),
    "start_up_count": Variable("1", "number of long sticks begun before settling", (), "int32"),
    "start_up_total": Variable("s", "time in long sticks begun before settling", (), "float32"),
    "sustained_count": Variable("1", "number of long sticks begun after settling", (), "int32"),
    "sustained_total": Variable("s", "time in long sticks begun after settling", (), "float32"),
    "observed_time": Variable("s", "time simulated after settling", (), "float32"),
    "first_slip_time": Variable("s", "time of the first slip, the end of the first stick", (), "float32"),
    "loading_time": Variable("s", "static stick time t0 = mu F / (k_t V)", (), "float32"),
}
# How each kind of stick is drawn; colours of mu or speeds, markers of F.
LINE: dict[str, Any] = {"markersize": 4.0, "linewidth": 0.8, "capsize": 2.0}
LOOKS: dict[str, dict[str, Any]] = {
    "start_up": {"color": figures.ORANGE, "marker": "s", "label": "start-up", **LINE},
    "sustained": {"color": figures.BLUE, "marker": "o", "label": "sustained", **LINE},
}
COLOURS = (figures.BLUE, figures.BLACK, figures.ORANGE, figures.GREEN, figures.RED)
MARKERS, STYLES = "ov^Ds", ("-", "--", "-.", ":")
# Of fewer sticks a realisation no mean is drawn.
LEAST_STICKS = 1.25


def sticks(scenes: Sequence[Scene], member: Any, **run: Any) -> dict[str, Any]:
    """The long sticks of one realisation of each normalised scene."""
    numbers = np.broadcast_to(member, len(scenes)).tolist()
    jobs = [[ensemble.realisation(scene, number, run)] for scene, number in zip(scenes, numbers, strict=True)]
    return outcomes(jobs, lambda jobs, runs: of_sticks(jobs[0].scene, runs[0].summary))


def of_sticks(scene: Scene, run: Any) -> dict[str, Any]:
    """A run's long sticks, by whether the motion had settled when they began."""
    first, long = run["first_slip_time"], run["stick_times"]
    early = run["stick_starts"] - first < SETTLING
    return {
        "stick_time": np.append(long, np.full(KEPT, np.nan))[:KEPT],
        "start_up_count": np.count_nonzero(early),
        "start_up_total": long[early].sum(),
        "sustained_count": np.count_nonzero(~early),
        "sustained_total": long[~early].sum(),
        "observed_time": np.fmax(run["simulated_time"] - first - SETTLING, 0.0),
        "first_slip_time": first,
        "loading_time": loading_time(scene),
    }


def check(member: Any, **others: Any) -> None:
    """Refuse what cannot be run."""
    checks.between("member", float(np.min(member)), 1.0, 1e6, "a number counted from 1")
    ensemble.check(**others)


def at_paper(dataset: xr.Dataset) -> xr.Dataset:
    """The part at the coefficient of friction and the load nearest to the paper's."""
    return dataset.sel(mu=paper.MU, F=paper.LOAD, method="nearest")


def with_ends(at: xr.Dataset, name: str, factor: float = 1.0) -> str:
    """A value with its interval; a dash where it is missing."""
    value, low, high = (labels.number(factor * float(at[f"{name}{end}"])) for end in ("", "_low", "_high"))
    return value if value == "-" else f"{value} ({low} to {high})"


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Exponents of the power laws, sticks at each speed, and all coefficients of friction and loads."""
    at, members = at_paper(dataset), dataset.sizes["member"]
    end, first = labels.number(1e3 * float(at["intermittence_end"])), with_ends(at.sel(law="start_up"), "exponent")
    where = f"mu = {float(at['mu']):g}, F = {float(at['F']):g} N"
    yield f"At {where} start-up sticks last T ~ V^n, n = {first}; sustained ones end at {end} mm/s."
    upto, span = f"sustained, up to {end} mm/s", " to ".join(f"{1e3 * V:g}" for V in SPAN)
    texts = ("start-up, 1 to 2 mm/s", upto, f"sustained, up to {SLOW:.2f} of that", f"{upto}, within {span}")
    laws = [(text, with_ends(at.isel(law=k), "exponent")) for k, text in enumerate(texts)]
    yield "Exponents with 95 % intervals", pd.DataFrame(laws, columns=["sticks", "n"])
    table = labels.frame(at, ["V"])
    for k, (kind, look) in enumerate(LOOKS.items()):
        rows = [at.isel(kind=k, V=place) for place in range(at.sizes["V"])]
        table[look["label"]] = at[f"{kind}_count"].sum("member").values.astype(int)
        table[f"T V μm {look['label']}"] = [with_ends(x, "mean_stick_time", 1e6 * float(x["V"])) for x in rows]
    table["local n"] = at["local_exponent"].sel(kind="sustained").values.round(2)
    table["% of time"] = (100.0 * at["sustained_share"].values).round(1)
    yield f"Long sticks of {members} realisations, begun within {SETTLING:g} s of the first slip or later", table
    near = dataset.sel(V=min(paper.SPEEDS), method="nearest").drop_dims(["member", "law"])
    slow = dataset["mean_stick_time"].isel(V=0).sel(kind="sustained") * dataset["V"][0]
    grip = (near["mu"] * near["F"]).where(near["mu"] > 0.0)
    early, late = (near["mean_stick_time"].sel(kind=kind) for kind in LOOKS)
    limit = near["intermittence_end"]
    columns = {"start-up ms": 1e3 * early, "sustained ms": 1e3 * late, "ends at mm/s": 1e3 * limit}
    columns |= {"V / (μF) mm/s/N": 1e3 * limit / grip, "T V / (μF) μm/N": 1e6 * slow / grip}
    scenes = xr.Dataset(
        {name: column.drop_vars(["V", "kind"], errors="ignore") for name, column in columns.items()}
    )
    table = scenes.drop_vars([name for name in scenes.coords if name not in scenes.dims]).to_dataframe()
    yield (
        f"Sticks at {labels.named('V', near['V'])}; end of intermittence; T V at the lowest V",
        table.reset_index(),
    )


def means(at: xr.Dataset, kind: str) -> np.ndarray:
    """Mean stick times and the ends of their intervals, (3, V), s; NaN where sticks are few."""
    values = np.stack([at[f"mean_stick_time{end}"].sel(kind=kind).values for end in ("", "_low", "_high")])
    enough = at[f"{kind}_count"].sum("member").values >= LEAST_STICKS * at.sizes["member"]
    return np.where(enough, values, np.nan)


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Stick times by speed, their departure from 1 / V, their distribution, and all mu and F in one."""
    figure, panels = figures.panels(2, 2, 17.0, 16.0)
    times, products, spread, collapse = panels
    at = at_paper(dataset)
    V = 1e3 * np.abs(at["V"].values)
    for axes, text in ((times, "mean stick time / ms"), (products, "T V / μm")):
        axes.set(xscale="log", xlim=(0.9 * V.min(), 1.1 * V.max()), xlabel="V / (mm/s)", ylabel=text)
    times.set_yscale("log")
    for kind, look in LOOKS.items():
        mean, low, high = 1e3 * means(at, kind)
        if np.isfinite(mean).any():
            bars = np.nan_to_num([mean - low, high - mean])
            times.errorbar(V, mean, bars, **look)
            products.errorbar(V, V * mean, V * bars, **look)
    once = 1e3 * at["loading_time"].mean("member")
    times.plot(V, once, ".:", markersize=3.0, color=figures.GREY, label="first stick, μF / (k V)")
    start = 1e3 * at["mean_stick_time"].sel(kind="start_up").values[np.isclose(V, 1e3 * min(paper.SPEEDS))]
    red: dict[str, Any] = {"color": figures.RED, "zorder": 3.0}
    if np.isfinite(start).any():
        law = 1e3 * np.sort(paper.STICK_RATIO_SPEEDS), start * [1.0, paper.STICK_RATIO]
        times.plot(*law, linewidth=2.2, label="paper: half at twice V", **red)
    if np.isfinite(end := 1e3 * float(at["intermittence_end"])):
        products.axvline(end, linestyle="--", linewidth=1.0, label=f"intermittence ends, {end:.2f} mm/s", **red)
    draw_spread(spread, at)
    draw_collapse(collapse, dataset)
    products.set_ylim(bottom=0.0)
    figures.one_two_five(times.xaxis, times.yaxis, products.xaxis, collapse.xaxis)
    figures.letter(panels, ("mean", "mean × speed", "sustained sticks", "all μ and F; open: start-up"))
    figures.legend_below(figure, [times, products], 3)
    where = ", ".join(labels.named(name, at[name]) for name in ("theta", "mu", "F"))
    figure.suptitle(f"Duration of long sticks; (a) to (c) {where}\n{damping_text(dataset)}")
    return figure


def draw_spread(axes: Any, at: xr.Dataset) -> None:
    """Distribution of the sustained sticks at some speeds."""
    lasting = at["stick_time"].where(at["stick"] > at["start_up_count"]).transpose("V", ...)
    T = [(1e6 * float(of["V"]) * of.values)[np.isfinite(of.values)] for of in lasting]
    enough = [k for k, values in enumerate(T) if len(values) >= LEAST_STICKS * at.sizes["member"]]
    chosen = [enough[k] for k in planes.subset(len(enough), len(STYLES))] if enough else []
    for k, colour, style in zip(chosen, COLOURS, STYLES, strict=False):
        label = f"{1e3 * float(at['V'][k]):g} mm/s ({len(T[k])})"
        axes.ecdf(T[k], color=colour, linestyle=style, label=label)
    axes.set(xlabel="T V / μm", ylabel="fraction of the sticks below", ylim=(0.0, 1.02))
    if chosen:
        axes.set_xlim(left=0.0)
        axes.legend(loc="upper left")


def draw_collapse(axes: Any, dataset: xr.Dataset) -> None:
    """T V / (mu F) over V / (mu F): one curve, if friction and load do no more than scale."""
    from matplotlib.lines import Line2D

    axes.set(xscale="log", xlabel="V / (μF) / (mm/s/N)", ylabel="T V / (μF) / (μm/N)")
    look: dict[str, Any] = {"linestyle": "none", "markersize": 4.0, "markeredgewidth": 0.7}
    frictions = list(zip(dataset["mu"].values[dataset["mu"].values > 0.0], COLOURS, strict=False))
    loads = list(zip(dataset["F"].values, MARKERS, strict=False))
    for (mu, colour), (F, marker) in product(frictions, loads):
        at = dataset.sel(mu=mu, F=F)
        V = np.abs(at["V"].values)
        for kind, fill in (("sustained", colour), ("start_up", "none")):
            y = 1e6 * V * means(at, kind)[0] / (mu * F)
            if np.isfinite(y).any():
                axes.plot(1e3 * V / (mu * F), y, color=colour, marker=marker, markerfacecolor=fill, **look)
    handles = [Line2D([], [], color=colour, marker="o", label=f"μ = {mu:g}", **look) for mu, colour in frictions]
    handles += [Line2D([], [], color=figures.GREY, marker=mark, label=f"F = {F:g} N", **look) for F, mark in loads]
    axes.set_ylim(bottom=0.0)
    if axes.lines:
        axes.legend(handles=handles, loc="lower left", fontsize=6.5, ncols=2)


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
    outputs=OUTPUTS, function=sticks,
    coords={"stick": Axis(np.arange(1, KEPT + 1), "1", "long stick, in the order in which they begin")},
    derive=with_laws, summary=summarise, figure=draw,
    claims=(
        Claim("exponent", {"law": "start_up"}, -1.0, "3.5.4.2"),
        Claim("exponent", {"law": "sustained_0.5_to_4_mm/s"}, -1.0, "2, 3.5.4.2"),
        Claim("start_up_ratio", {}, paper.STICK_RATIO, "3.5.4.2"),
        Claim("sustained_ratio", {}, paper.STICK_RATIO, "3.5.4.2"),
    ),
    check=check, normalised=True, chaotic=True,
)  # fmt: skip
