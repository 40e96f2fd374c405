"""The plane of inclination and friction: where steady sliding is unstable, how fast, and at which frequency."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import OnsetCurves, Rig, onset_curves
from studies import paper
from studies.answering import results
from studies.answering.claims import is_papers_rig, rig_text
from studies.declaring import labels, spec
from studies.declaring.parameters import SLIDING, Parameter
from studies.motion.run import BAND
from studies.motion.stability import (
    first_onsets,
    friction_in,
    growths,
    intervals_summary,
    with_flags,
    with_unstable_intervals,
)
from studies.plotting import figures, general, planes
from studies.study import Claim, Study
from sweeps import Variable

OUTPUTS = {
    "growth_rate": Variable("s-1", "largest growth rate of steady sliding below 10 kHz", (), "float32", digits=4),
    "frequency": Variable("Hz", "frequency of the least stable mode", (), "float32", digits=5),
    "unstable_modes": Variable("1", "number of unstable pairs of modes below 10 kHz", (), "int8"),
}
ENDS = ("range", "mu_max", "fmax", "fold")
TRACED = {"theta": "degree", "mu": "1", "frequency": "Hz"}
# Branches: dimension, name of their variables, description.
BRANCHES = {"pair": ("onset", "the pair's flutter onset"), "recovery": ("recovery", "a pair's recovery")}
STEADY = "3.6, measured: slides steadily"
# A pair is the one with the nearest frequency.
CLAIMS = (
    *(
        Claim(f"pair_onset_{name}", {"pair": onset[1]}, onset[k], "3.4.2, first unstable", cells=True)
        for onset in paper.ONSETS
        for k, name in enumerate(("mu", "frequency"))
    ),
    Claim("unstable_modes", {}, len(paper.ANGLES_UNSTABLE[paper.THETA]), "3.4.2"),
    *(Claim("unstable_modes", {"theta": x}, 0.0, STEADY) for x in (15.0, *paper.STEADY_ANGLES)),
)
# Of so many unstable pairs, the last of more as well.
COUNTS = (planes.STABLE, "#a6dcf7", figures.BLUE, "#00304d")
STYLES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (1.3, 1.3)), (0, (6, 1.5, 1.3, 1.5)))
# Growth rates below this fraction of the largest have one shade.
FAINTEST = 0.01


def plane(rig: Rig, theta: np.ndarray, mu: np.ndarray, **sliding: Any) -> dict[str, np.ndarray]:
    """Growth rate and frequency of the least stable mode, and the number of unstable pairs."""
    return dict(zip(OUTPUTS, growths(rig, theta, mu, **sliding), strict=True))


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add branches of onsets and recoveries over theta, unstable intervals at the paper's friction, and the bound.

    Where branches or intervals cannot be separated there are none, and a `comment` gives the reason.
    """
    theta, mu, comment = dataset["theta"].values, dataset["mu"].values, ""
    curves = OnsetCurves((), (), theta, *np.empty((4, len(theta), 0)))
    rig = results.rig_of(dataset)
    if not isinstance(rig, Rig):
        comment = "a structure has one inclination"
    elif friction_in(dataset).kinetic_ratio != 1.0:
        comment = "friction depends on the speed"
    elif mu.max() > 0.0:
        try:
            curves = onset_curves(rig, theta, BAND, float(mu.max()))
        except ArithmeticError as problem:
            comment = str(problem)
    friction, tangent = float(np.clip(paper.MU, mu.min(), mu.max())), np.tan(np.radians(theta))
    dataset = with_unstable_intervals(dataset, rig, friction)
    added = branches("pair", curves.onsets, curves.mu, curves.frequency)
    added |= branches("recovery", curves.recoveries, curves.recovery_mu, curves.recovery_frequency)
    # The lowest onset at each angle, NaN where there is none.
    table = np.pad([curves.mu, curves.frequency], ((0, 0), (0, 0), (0, 1)), constant_values=np.nan)
    first = np.where(np.isnan(table[0]), np.inf, table[0]).argmin(axis=1)
    lowest = table[:, np.arange(len(theta)), first]
    if comment:
        lowest = np.array(first_onsets(dataset, rig)[1:])
    text = "at the lowest flutter onset; pairs that enter the band unstable are not counted"
    added["onset_mu"] = "theta", lowest[0], "1", f"coefficient of friction {text}"
    added["onset_frequency"] = "theta", lowest[1], "Hz", f"frequency {text}"
    added["bound_mu"] = "theta", np.where(tangent > 0.0, tangent, np.nan), "1", "tan(theta), if above 0"
    added["window_mu"] = (), friction, "1", "coefficient of friction of the unstable intervals"
    # The branches as they were followed, to their ends, one after the other.
    traces = (*curves.onsets, *curves.recoveries)
    number = np.repeat(np.arange(len(traces), dtype=np.int16), [len(curve.theta) for curve in traces])
    added["trace_branch"] = "trace", number, "1", "number of the branch, from 0; onsets first"
    for name, units in TRACED.items():
        values = np.concatenate([np.empty(0), *(getattr(curve, name) for curve in traces)])
        added[f"trace_{name}"] = "trace", np.float32(values), units, f"{name} along the branches"
    for name, (dims, values, units, text) in added.items():
        dataset[name] = dims, values, {"units": units, "long_name": text}
    numbers = {dim: dataset[f"{dim}_lowest_frequency"] for dim in BRANCHES if dataset.sizes[dim]}
    dataset = dataset.assign_coords(numbers)
    if comment:
        dataset["pair_onset_mu"].attrs["comment"] = comment
    return with_flags(dataset, ENDS, *(f"{dim}_{end}" for dim in BRANCHES for end in ("begins", "ends")))


def branches(dim: str, curves: Any, mu: np.ndarray, frequency: np.ndarray) -> dict[str, Any]:
    """Branches at the grid's angles, where each is lowest, and how it begins and ends."""
    kind, text = BRANCHES[dim]
    added: dict[str, Any] = {
        f"pair_{kind}_mu": (("theta", dim), mu, "1", f"coefficient of friction at {text}"),
        f"pair_{kind}_frequency": (("theta", dim), frequency, "Hz", f"frequency at {text}"),
    }
    places = np.array([curve.lowest for curve in curves]).reshape(-1, 3).T
    for (name, units), values in zip(TRACED.items(), places, strict=True):
        added[f"{dim}_lowest_{name}"] = (dim, values, units, f"{name} where {text} is lowest in mu")
    for k, name in enumerate(("begins", "ends")):
        codes = np.array([ENDS.index(curve.ends[k]) for curve in curves], dtype=np.int8)
        added[f"{dim}_{name}"] = (dim, codes, "1", f"where {text} {name} as theta rises")
    return added


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The unstable part of the plane, branches of onsets and recoveries, and unstable intervals."""
    at = dataset.transpose("theta", "mu", ...)
    growth, modes, frequency = (at[name].values for name in ("growth_rate", "unstable_modes", "frequency"))
    grows, tangent = growth > 0.0, np.tan(np.radians(at["theta"].values))[:, None]
    finite, inside = np.isfinite(growth), (tangent > 0.0) & (tangent < at["mu"].values)
    text = f"Steady sliding is unstable at {grows.sum()} of {finite.sum()} points"
    if dataset.sizes["pair"]:
        first = dataset.isel(pair=int(np.argmin(dataset["pair_lowest_mu"].values)))
        hertz, mu, theta = (float(first[f"pair_lowest_{name}"]) for name in ("frequency", "mu", "theta"))
        text += f"; the lowest onset is at mu = {mu:.4f}, theta = {theta:.2f} degrees, {hertz:.0f} Hz"
    yield f"{text}."
    if comment := dataset["pair_onset_mu"].attrs.get("comment", ""):
        yield f"The onsets could not be followed over theta: {comment}."
    frames = [
        labels.frame(dataset, [f"{dim}_lowest_{name}" for name in ("frequency", "mu", "theta")], along=dim)
        for dim in BRANCHES
    ]
    table = pd.concat([of.set_axis(["Hz", "lowest mu", "at °"], axis=1) for of in frames], ignore_index=True)
    if len(table):
        table.insert(0, "branch", np.repeat([kind for kind, _ in BRANCHES.values()], [len(of) for of in frames]))
        over = pd.Series(dataset["trace_theta"].values).groupby(dataset["trace_branch"].values)
        yield "Branches of onsets and recoveries", table.assign(**{"from °": over.min(), "to °": over.max()})
    if not results.structure_in(dataset):
        yield from intervals_summary(dataset, float(dataset["window_mu"]))
    rows = {"most unstable pairs at a point": np.nanmax(modes, initial=0.0)}
    rows["largest growth rate, 1/s"] = np.nanmax(growth, initial=-np.inf)
    rows["points whose least stable mode does not oscillate"] = (grows & (frequency == 0.0)).sum()
    rows["points unstable outside 0 < tan(theta) < mu"] = (grows & ~inside).sum()
    if not comment:
        # A mode may be unstable without an onset: of a pair that has become two that diverge, or above the band.
        names, x = ("pair_onset_mu", "pair_recovery_mu"), dataset["mu"].values[:, None]
        onsets, recoveries = (np.sum(dataset[name].values[:, None, :] < x, axis=-1) for name in names)
        differs = finite & (modes != onsets - recoveries)
        rows["points with more or fewer unstable pairs than branches"] = differs.sum()
    yield "Over the plane", pd.DataFrame(rows.items(), columns=["quantity", "value"])


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Growth rate over the plane with the branches; below, frequency and number of unstable pairs."""
    from matplotlib.colors import ListedColormap

    if min(dataset.sizes["theta"], dataset.sizes["mu"]) == 1:
        return general.draw(dataset)
    layout, sides = [["growth", "growth"], ["frequency", "count"]], ("theta", "mu")
    figure, panels = figures.mosaic(layout, 17.0, 17.5, height_ratios=(1.45, 1.0))
    growth, count, last = dataset["growth_rate"], dataset["unstable_modes"], len(COUNTS) - 1
    grows, look = growth.where(growth > 0.0), dict[str, Any]()
    if bool(grows.notnull().any()):
        largest, faintest = float(grows.max()), float(grows.min())
        faintest = max(min(faintest, 0.5 * largest), FAINTEST * largest)
        look = {"norm": "log", "vmin": faintest, "vmax": largest}
    planes.numbers(panels["growth"], growth, *sides, "growth rate / (1/s)", growth <= 0.0, **look)
    kilohertz = 1e-3 * dataset["frequency"].where(growth.notnull())
    planes.numbers(panels["frequency"], kilohertz, *sides, "frequency / kHz", growth <= 0.0)
    look = {"cmap": ListedColormap(list(COUNTS)), "vmin": -0.5, "vmax": last + 0.5}
    mesh = planes.numbers(panels["count"], count.clip(max=last), *sides, "unstable pairs", **look)
    if mesh.colorbar:
        mesh.colorbar.set_ticks(
            range(last + 1), labels=[*map(str, range(last)), f"{last}{'+' * bool((count > last).any())}"]
        )
    draw_branches(panels["growth"], dataset)
    for axes in panels.values():
        theta = np.linspace(*axes.get_xlim(), 500)
        bound = np.tan(np.radians(theta))
        bound[(bound < 0.0) | (bound > axes.get_ylim()[1])] = np.nan
        if np.isfinite(bound).any():
            axes.plot(theta, bound, "--", color=figures.GREEN, label="tan θ = μ")
    if is_papers_rig(dataset):
        draw_paper(panels["growth"])
    figures.legend_below(figure, [panels["growth"]], 3)
    titles = "growth of the least stable mode, and onsets", "its frequency", "unstable pairs"
    figures.letter(panels.values(), titles)
    figure.suptitle(f"Steady sliding, modes below {BAND / 1e3:g} kHz{rig_text(dataset)}")
    return figure


def draw_branches(axes: figures.Axes, dataset: xr.Dataset) -> None:
    """Each branch of onsets, and of recoveries, to its ends."""
    from matplotlib.patheffects import withStroke

    number, count = dataset["trace_branch"].values, 0
    for (dim, (kind, _)), colour in zip(BRANCHES.items(), (figures.BLACK, figures.RED), strict=True):
        for k, frequency in enumerate(dataset[f"{dim}_lowest_frequency"].values):
            chosen, count = np.flatnonzero(number == count), count + 1
            look: dict[str, Any] = {"color": colour, "linestyle": STYLES[k % len(STYLES)], "linewidth": 1.4}
            look |= {"marker": "." if len(chosen) == 1 else "", "label": f"{kind}, {frequency:.0f} Hz"}
            places = dataset["trace_theta"].values[chosen], dataset["trace_mu"].values[chosen]
            axes.plot(*places, path_effects=[withStroke(linewidth=2.8, foreground="white")], **look)


def draw_paper(axes: figures.Axes) -> None:
    """The paper's onsets, and at its friction where the rig vibrates and where it slides steadily."""
    slides = [(theta, paper.MU) for theta, frequency in paper.ANGLES.items() if np.isnan(frequency)]
    planes.marks(axes, [(paper.THETA, mu) for mu, _ in paper.ONSETS], **planes.PAPER["first unstable μ"])
    planes.marks(
        axes, [(theta, paper.MU) for theta in sorted(paper.ANGLES_MEASURED)], **planes.PAPER["vibrates (measured)"]
    )
    planes.marks(axes, slides, **planes.PAPER["slides steadily (measured)"])
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for ends in np.clip(paper.STEADY_ANGLES, left, right):
        if ends[0] < ends[1] and low <= paper.MU <= high:
            axes.plot(ends, [paper.MU] * 2, color=figures.BLUE, linewidth=2.0, zorder=3.5)


STUDY = Study(
    name="stability",
    title="Stability of steady sliding over inclination and friction",
    question="At which inclinations and coefficients of friction is steady sliding unstable, how fast does "
    "vibration grow, and at which frequency?",
    paper="Section 3.4.2: at 5 degrees pairs are first unstable at mu = 0.12 (2800 Hz), 0.16 (400 Hz), 0.23 "
    "(7700 Hz). Section 3.6: at mu = 0.2 the rig vibrates at 10 degrees and slides steadily at 15, above 12 and "
    "at negative angles. It has no map over both.",
    parameters={
        "theta": Parameter(spec.evenly(-10.0, 20.0, 241), "degree", "inclination of P1"),
        "mu": Parameter(spec.evenly(0.0, 0.5, 201), "1", "coefficient of friction"),
    }
    | SLIDING,
    outputs=OUTPUTS, function=plane, derive=derive, summary=summarise, figure=draw, claims=CLAIMS, normalised=True,
)  # fmt: skip
