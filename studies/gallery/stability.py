"""Stability of steady sliding over inclination and friction: growth rate, frequency, number of unstable pairs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Rig
from studies import paper
from studies.answering import results
from studies.answering.claims import is_papers_rig, rig_text
from studies.declaring import labels, spec
from studies.declaring.parameters import SLIDING, Parameter
from studies.motion.run import BAND
from studies.motion.stability import growths, intervals_summary
from studies.physics.onsets import BRANCHES, with_branches
from studies.plotting import angles, figures, general, planes
from studies.study import Claim, Study
from sweeps import Variable

OUTPUTS = {
    "growth_rate": Variable("s-1", "largest growth rate of steady sliding below 10 kHz", (), "float32", digits=4),
    "frequency": Variable("Hz", "frequency of the least stable mode", (), "float32", digits=5),
    "unstable_modes": Variable("1", "number of unstable pairs of modes below 10 kHz", (), "int8"),
}
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
# Growth rates below this fraction of the largest have one shade.
FAINTEST = 0.01


def plane(rig: Rig, theta: np.ndarray, mu: np.ndarray, **sliding: Any) -> dict[str, np.ndarray]:
    """Growth rate and frequency of the least stable mode, and the number of unstable pairs."""
    return dict(zip(OUTPUTS, growths(rig, theta, mu, **sliding), strict=True))


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add branches of onsets and recoveries over theta, and unstable intervals at the paper's friction."""
    return with_branches(dataset, results.rig_of(dataset))


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The unstable fraction of the plane, branches of onsets and recoveries, and unstable intervals."""
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
    figure, panels = figures.mosaic(layout, 8.0, 5.5)
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
    angles.onset_branches(panels["growth"], dataset)
    for axes in panels.values():
        theta = np.linspace(*axes.get_xlim(), 500)
        bound = np.tan(np.radians(theta))
        bound[(bound < 0.0) | (bound > axes.get_ylim()[1])] = np.nan
        if np.isfinite(bound).any():
            axes.plot(theta, bound, "--", color=figures.GREEN, label="tan θ = μ")
    if is_papers_rig(dataset):
        angles.paper_plane(panels["growth"])
    figures.legend_below(figure, [panels["growth"]], 3)
    titles = "growth of the least stable mode, and onsets", "its frequency", "unstable pairs"
    figures.entitle(panels.values(), titles)
    figure.suptitle(f"Steady sliding, modes below {BAND / 1e3:g} kHz{rig_text(dataset)}")
    return figure


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
