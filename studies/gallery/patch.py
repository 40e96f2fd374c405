"""Several contacts below P1's tip in place of the point: how a foot changes the onset and the motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from fivcore import Rig, Scene, Structure, checks, on_foot, reduced_model
from studies.declaring import labels
from studies.declaring.spec import evenly
from studies.motion import ensemble, mixed
from studies.motion.jobs import Job, outcomes
from studies.motion.stability import largest_growth
from studies.plotting import figures, planes
from studies.study import Parameter, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
OUTPUTS |= {
    f"{name}_std": (unit, f"standard deviation over realisations of the {name.replace('_', ' ')}")
    for name, unit in zip(STATISTICS, ("1", "1", "m s-1"), strict=True)
}
# The onset is sought on this grid, and by halving between two of its values. In statics the rigid motion has a
# spring, so much softer than any mode. At most so many contacts are closed at once: of a rigid foot on a beam two.
GRID, HALVINGS, SOFT, MOST_CLOSED, MOST = np.linspace(0.0, 1.0, 101), 12, 1e-8, 4, 20
ABOUT = ("onset_mu", "onset_frequency", "closed_at_rest", "closed_at_onset")
COLUMNS = ("nodes", "mu", "finer", "closed", "regime", *STATISTICS, "stick_fraction_std")
COLOURS = (figures.BLACK, figures.ORANGE, figures.RED, figures.BLUE, figures.GREY)


foot = lru_cache(maxsize=64)(on_foot)


def sliding(own: Structure, mu: float) -> tuple[Structure, int]:
    """The structure with the contacts alone that are closed in steady sliding, and their number; 0: there is none.

    Friction turns the foot, so that these are not the contacts that the load closes at rest. Forces N, T = mu N,
    are those without which a contact would be open or pull. The load is what they balance.
    """
    if own.gap is None:
        return own, 1
    least = own.stiffness[own.stiffness > 0.0].min()
    soft, push = own.normal / np.maximum(own.stiffness, SOFT * least), own.normal + mu * own.tangential
    flexibility, free = soft @ push.T, soft @ own.load
    for count in range(1, min(len(free), MOST_CLOSED) + 1):
        for closed in map(list, combinations(range(len(free)), count)):
            force = -np.linalg.solve(flexibility[np.ix_(closed, closed)], free[closed])
            gaps = free + flexibility[:, closed] @ force
            if np.all(force > 0.0) and gaps.min() >= -1e-9 * np.abs(free).max():
                rows = {name: getattr(own, name)[closed] for name in ("normal", "tangential", "gap", "friction")}
                return replace(own, **rows, load=-force @ rows["normal"]), count
    return own, 0


def growth(own: Structure, mu: float) -> tuple[float, float, int]:
    """Growth rate, 1/s, and frequency, Hz, of steady sliding's least stable mode, and its closed contacts."""
    part, count = sliding(own, mu)
    return (*(map(float, largest_growth(part, 0.0, mu)[:2]) if count else (np.nan, np.nan)), count)


@lru_cache(maxsize=64)
def onset(own: Structure) -> tuple[float, float, int]:
    """The lowest friction at which steady sliding is unstable, its frequency, Hz, and its closed contacts."""
    high = next((mu for mu in GRID.tolist() if growth(own, mu)[0] > 0.0), np.nan)
    low = high - GRID[1]
    for _ in range(HALVINGS if high > 0.0 else 0):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if growth(own, middle)[0] > 0.0 else (middle, high)
    return (high, *growth(own, high)[1:]) if high >= 0.0 else (np.nan, np.nan, 0)


def motions(
    rig: Rig, V: Any, theta: Any, mu: Any, F: Any, nodes: Any, finer: Any, foot_length: float, members: int,
    **options: Any,
) -> dict[str, Any]:  # fmt: skip
    """Onset of each foot, and the motion on it."""
    columns = np.broadcast_arrays(V, theta, mu, F, nodes, finer)

    def jobs(V: float, theta: float, mu: float, F: float, nodes: int, finer: float) -> list[Job]:
        own = foot(rig, theta, int(nodes), foot_length)
        step = reduced_model(own, 0.0, options["cutoff"]).default_step / finer
        runs = ensemble.ensemble(Scene(V, 0.0, mu, F, own), members, options)
        return [replace(job, options={**job.options, "step": step}) for job in runs]

    def values(jobs: Any, runs: Any) -> dict[str, Any]:
        own, mu = jobs[0].scene.rig, jobs[0].scene.mu
        rate, _, closed = growth(own, mu)
        at_rest = int(np.sum(own.equilibrium(1.0)[0] > 0.0)) if own.several else 1
        numbers = (*onset(own)[:2], at_rest, onset(own)[2], closed, rate)
        motion, each = ensemble.statistics(runs), ensemble.summaries(runs)
        scatter = {f"{name}_std": each[name].std(ddof=1) if len(runs) > 1 else np.nan for name in STATISTICS}
        return dict(zip(OUTPUTS, numbers, strict=False)) | {name: motion[name] for name in MOTION} | scatter

    return outcomes([jobs(*point) for point in zip(*(c.ravel().tolist() for c in columns), strict=True)], values)


def check(rig: Rig, nodes: Any, finer: Any, foot_length: Any, **others: Any) -> None:
    """Refuse a foot that P2 does not carry, and what cannot be run."""
    for count in (np.min(nodes), np.max(nodes)):
        checks.count("nodes", count, MOST)
    checks.between("finer", np.min(finer), 1.0, 1e3, "1")
    most = 2.0 * min(rig.contact_position, rig.p2.length - rig.contact_position)
    text = f"above 0 and below {most:.4g} m, so that P2 carries both ends"
    checks.number("foot_length", np.max(foot_length), text, lambda x: 0.0 < x < most)
    checks.between("V", np.min(others["V"]), 1e-12, 1e6, "m/s")
    ensemble.check(**others)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """What a foot changes against a point, how much the number of nodes and the step matter, and all numbers."""
    table = labels.frame(dataset[[*ABOUT]].max(("mu", "finer")), ["nodes", *ABOUT])
    point, feet = table[table["nodes"] == 1], table[table["nodes"] > 1].dropna()
    if len(point) and len(feet):
        onsets = " or ".join(dict.fromkeys(map(labels.number, feet["onset_mu"])))
        at_rest, sliding = (
            " or ".join(f"{n:.0f}" for n in sorted(set(feet[name])))
            for name in ("closed_at_rest", "closed_at_onset")
        )
        yield (
            f"Steady sliding is unstable from mu = {labels.number(point['onset_mu'].item())} on with a point, from"
            f" {onsets} on with a patch of {labels.number(1e3 * float(dataset['foot_length']))} mm: two closed"
            " contacts keep P1's tip from turning, until friction has tilted the foot. Closed are"
            f" {at_rest} at rest, {sliding} at the onset."
        )
    several = dataset.isel(nodes=dataset["nodes"].values > 2)
    for over, text in (("nodes", "From three nodes on their number"), ("finer", "A finer step")):
        if several.sizes["nodes"] and several.sizes[over] > 1:
            apart = [float((several[n].max(over) - several[n].min(over)).max()) for n in SHARES]
            scatter = max(float(several[f"{n}_std"].max()) for n in SHARES)
            yield (
                f"{text} moves the shares of stick and separation by at most {apart[0]:.3f} and {apart[1]:.3f};"
                f" between realisations they scatter by up to {scatter:.3f}."
            )
    yield "By number of nodes", table
    yield "Motion", labels.frame(dataset, COLUMNS, along=["nodes", "mu", "finer"])


def draw(dataset: xr.Dataset) -> Figure:
    """Onset by number of nodes; statistics along the friction by number of nodes and step."""
    figure, (first, *panels) = figures.panels(2, 2, 17.0, 13.0)
    nodes, mu, onsets = dataset["nodes"].values, dataset["mu"].values, dataset[[*ABOUT]].max(("mu", "finer"))
    colours = [COLOURS[k % len(COLOURS)] for k in range(len(nodes))]
    first.bar(nodes.astype(str), np.nan_to_num(onsets["onset_mu"]), color=colours, width=0.6)
    for k, hertz in enumerate(onsets["onset_frequency"].values):
        place = k, np.nan_to_num(onsets["onset_mu"].values[k])
        text = f"{hertz:.0f} Hz" if place[1] else "none"
        first.annotate(text, place, (0, 2), textcoords="offset points", ha="center", fontsize=8.0)
    first.set(xlabel="nodes", ylabel="onset in μ", ymargin=0.12)
    apart = np.diff(mu).min(initial=np.ptp(mu) or 0.1)
    for axes, name in zip(panels, STATISTICS, strict=True):
        planes.set_side(axes, "x", dataset["mu"])
        for k, j in np.ndindex(len(nodes), min(dataset.sizes["finer"], 2)):
            at = dataset.isel(nodes=k, finer=j).transpose("mu", ...)
            values, error = (labels.readable(at[each]).values for each in (name, f"{name}_std"))
            # Side by side, for many are equal.
            place = mu + apart * (0.15 * (k - 0.5 * (len(nodes) - 1)) + 0.06 * j)
            look: Any = {
                "color": colours[k],
                "marker": "o",
                "mfc": "white" if j else colours[k],
                "linestyle": "none",
            }
            axes.errorbar(place, values, np.nan_to_num(error), markersize=4.0, **look)
            if axes is panels[0] and (j == 0 or k == len(nodes) - 1):
                named = f"step / {at['finer']:g}" if j else f"{nodes[k]} nodes" if nodes[k] > 1 else "point"
                axes.plot([], [], **look, label=named)
        axes.set_ylabel(labels.label(dataset[name]))
    panels[-1].set_yscale("log")
    figures.letter((first, *panels), ("steady sliding", "stick", "separation", "velocity of B"))
    figures.legend_below(figure, panels[:1], 6)
    where = ", ".join(labels.named(name, dataset[name]) for name in ("foot_length", "V", "theta", "F"))
    figure.suptitle(figures.fitted(f"Point and patch: {where}", 17.0))
    return figure


STUDY = Study(
    name="patch",
    title="A patch of several contacts in place of a point",
    question="How do the onset and the motion change if P1 stands on a foot that touches P2 in several places?",
    paper="P1 touches P2 in one point.",
    parameters={
        "nodes": Parameter(np.array([1, 2, 3, 5, 10]), "1", "contacts, evenly along the foot; 1: the point"),
        "mu": Parameter(evenly(0.1, 0.5, 5), "1", "coefficient of friction"),
        "finer": Parameter(np.array([1.0, 3.0]), "1", "by how much shorter the step is than the default one"),
        "V": Parameter(2e-3, "m s-1", "speed of the drive"),
        "foot_length": Parameter(15e-3, "m", "length of the foot, the point in its middle", common=True),
    }
    | ensemble.members(4)
    | ensemble.until(0.3, 1.0),
    outputs=OUTPUTS,
    function=motions,
    coords=ensemble.coords,
    check=check,
    summary=summarise,
    figure=draw,
    chaotic=True,
    beams=True,
)
