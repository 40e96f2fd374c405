"""What a plane of regimes says in numbers: how many scenes are in which, how sure, and against what."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies import paper
from studies.gallery.regimes.compare_linear import BELOW, CERTAIN, VERDICTS, uncertain
from studies.motion import regimes, transients
from studies.plotting import planes
from studies.study import constants
from studies.tables import Part, Table
from sweeps import DONE

# Inclinations up to which each has a line.
MOST_ONSETS = 6
# Of an axis, for a reader: factor and unit.
UNITS = {"V": (1e3, " mm/s"), "mu": (1.0, ""), "theta": (1.0, " degrees"), "F": (1.0, " N")}
# What the table shows of a regime besides its size: head, digits, factor.
COLUMNS = {
    "stick_fraction": ("stick", 3, 1.0),
    "velocity_rms": ("RMS mm/s", 2, 1e3),
    "dominant_frequency": ("main line Hz", 0, 1.0),
    "normal_force_999": ("99.9 % of N", 1, 1.0),
}


def findings(dataset: xr.Dataset) -> list[Part]:
    """Regimes and how sure they are, the motion against linear stability, the paper's speeds, and the cost."""
    given = constants(dataset)
    rig = "the paper's rig" if paper.is_rig(dataset) else "another rig than the paper's"
    everywhere = np.ones(dataset["regime"].shape, dtype=bool)
    lines: list[Part] = [
        f"{everywhere.size} scene{'s' if everywhere.size > 1 else ''} on {rig}: "
        f"{where(dataset, everywhere, everything=True)}.",
        f"{given['members']} runs of each, from the first slip and {transients.SETTLING:g} s on for at least "
        f"{given['least']:g} s and {given['load_ups']:g} load-ups, {given['most']:g} s at most.",
        "",
        *_regimes(dataset),
        "",
        *_certainty(dataset, given),
        "",
        *_stability(dataset),
        *_paper(dataset, given),
        "",
        *_cost(dataset, given),
    ]
    return lines


def where(dataset: xr.Dataset, chosen: NDArray[np.bool_], everything: bool = False) -> str:
    """The range of each axis that the chosen points span; by default only of axes with more than one value."""
    parts = []
    for axis, name in enumerate(dataset["regime"].dims):
        others = tuple(k for k in range(chosen.ndim) if k != axis)
        values = dataset[name].values[chosen.any(axis=others)]
        if not len(values) or (len(dataset[name]) == 1 and not everything):
            continue
        factor, unit = UNITS[str(name)]
        low, high = factor * values.min(), factor * values.max()
        parts.append(f"{name} = {low:.4g}{f' to {high:.4g}' if high > low else ''}{unit}")
    return ", ".join(parts)


def _regimes(dataset: xr.Dataset) -> list[Part]:
    """A row for each regime that occurs: its size, its uncertain scenes, and medians of figures."""
    found, unsure = regimes.kinds(dataset), uncertain(dataset)
    rows = []
    for kind, name in enumerate(regimes.KINDS):
        inside = found == kind
        if not inside.any():
            continue
        figures = [
            # What is left of a vibration that dies has a strongest line too, but none that sounds.
            "-"
            if figure == "dominant_frequency" and name == "steady sliding"
            else _median(dataset, figure, inside)
            for figure in COLUMNS
        ]
        rows.append(
            [name, f"{inside.sum()}", f"{100.0 * inside.mean():.1f}", f"{(inside & unsure).sum()}", *figures]
        )
    heads = ["regime", "scenes", "%", "uncertain", *(head for head, _, _ in COLUMNS.values())]
    return [Table(heads, rows), "Of a regime's figures the medians over its scenes."]


def _median(dataset: xr.Dataset, name: str, inside: NDArray[np.bool_]) -> str:
    values = dataset[name].values[inside]
    values = values[np.isfinite(values)]
    _, digits, factor = COLUMNS[name]
    return transients.text(np.median(values) if len(values) else np.nan, digits, factor)


def _certainty(dataset: xr.Dataset, given: dict[str, Any]) -> list[str]:
    """Where the members differ, what is undecided, and which runs were cut short."""
    done = dataset["status"].values == DONE
    undecided = done & (regimes.kinds(dataset) == transients.REGIMES.index("undecided"))
    unsure = uncertain(dataset)
    # Durations are kept to six digits.
    capped = dataset["duration"].values >= (1.0 - 1e-5) * given["most"]
    return [
        f"Undecided: {undecided.sum()} of {done.sum()} ({100.0 * undecided.sum() / max(done.sum(), 1):.1f} %).",
        f"Uncertain, members differ and certainty below {CERTAIN:g}: {_counted(dataset, unsure)}.",
        f"Cut short at {given['most']:g} s: {_counted(dataset, capped)}"
        + (f"; the shortest is {_load_ups(dataset, capped):.1f} load-ups long." if capped.any() else "."),
    ]


def _load_ups(dataset: xr.Dataset, chosen: NDArray[np.bool_]) -> float:
    """The fewest load-ups in which one of the chosen scenes ends."""
    return float((dataset["duration"].values[chosen] / dataset["load_up_time"].values[chosen]).min())


def _counted(dataset: xr.Dataset, chosen: NDArray[np.bool_]) -> str:
    """How many are chosen, and where they lie."""
    place = where(dataset, chosen) if chosen.any() else ""
    return f"{chosen.sum()}" + (f", at {place}" if place else "")


def _stability(dataset: xr.Dataset) -> list[str]:
    """Where stability is lost, and how the motion compares."""
    lines = _onsets(dataset)
    verdict = dataset["verdict"].values
    told = [verdict == k for k in range(len(VERDICTS))]
    agree, subcritical, above, quiet, none, _ = told
    lines += [
        f"Motion and stability agree at {agree.sum()} of {(agree | subcritical | above | quiet).sum()} scenes.",
        f"Vibrating though stable {BELOW}: {_counted(dataset, subcritical | above)}.",
    ]
    if above.any():
        frequency = np.median(dataset["model_growth_frequency"].values[above]) / 1e3
        lines.append(
            f"Of these {above.sum()} have a growing mode above the band, near {frequency:.1f} kHz, in the model "
            f"that is run; subcritical are {_counted(dataset, subcritical)}."
        )
    lines.append(f"Sliding steadily though unstable: {_counted(dataset, quiet)}.")
    if none.any():
        lines.append(
            f"Not compared, because undecided, stuck, or too short for modes that die or grow slowly: "
            f"{_counted(dataset, none)}."
        )
    return lines


def _onsets(dataset: xr.Dataset) -> list[str]:
    """A line for each inclination, or one for all if they are many."""
    theta, mu, frequency = (dataset[name].values for name in ("theta", "onset_mu", "onset_frequency"))
    lost = np.isfinite(mu)
    if len(theta) > MOST_ONSETS:
        ends = f", at mu = {mu[lost].min():.4f} to {mu[lost].max():.4f}" if lost.any() else ""
        return [f"Steady sliding loses stability {BELOW} at {lost.sum()} of {len(theta)} inclinations{ends}."]
    told = [
        f"loses stability at mu = {mu[k]:.4f} ({frequency[k]:.0f} Hz)" if lost[k] else "stays stable"
        for k in range(len(theta))
    ]
    return [f"theta = {theta[k]:g} degrees: steady sliding {told[k]}, modes {BELOW}." for k in range(len(theta))]


def _paper(dataset: xr.Dataset, given: dict[str, Any]) -> list[Part]:
    """The regimes at the paper's speeds; nothing where the grid does not hold its operating point."""
    if not paper.is_rig(dataset) or not _holds(dataset, "theta", paper.THETA, exactly=True):
        return []
    if not (_holds(dataset, "F", paper.LOAD, exactly=True) and _holds(dataset, "mu", paper.MU)):
        return []
    rows = []
    for V, said in paper.VIBRATION.items():
        if not _holds(dataset, "V", V):
            continue
        at = dataset.sel(V=V, mu=paper.MU, theta=paper.THETA, F=paper.LOAD, method="nearest")
        kind = int(regimes.kinds(at))
        share, line = float(at["regime_share"].max()), float(at["dominant_frequency"])
        rows.append(
            [
                f"{1e3 * V:g}",
                f"{1e3 * float(at['V']):.4g}",
                f"{float(at['mu']):.4g}",
                regimes.KINDS[kind],
                transients.text(share * given["members"], 0) + f" of {given['members']}",
                transients.text(at["stick_fraction"], 3),
                transients.text(line, 0),
                said,
            ]
        )
    if not rows:
        return []
    heads = ["V mm/s", "nearest", "mu", "regime", "members", "stick", "main line Hz", "paper"]
    return ["", Table(heads, rows)]


def _holds(dataset: xr.Dataset, name: str, value: float, exactly: bool = False) -> bool:
    """Whether a value of an axis is, or lies in a cell of, the grid."""
    values = dataset[name].values
    ends = planes.edges(np.unique(values))
    return bool(np.any(np.isclose(values, value, rtol=1e-9)) if exactly else ends[0] <= value <= ends[-1])


def _cost(dataset: xr.Dataset, given: dict[str, Any]) -> list[str]:
    """What was simulated and how long that took; copies of a scene cost nothing."""
    spent = dataset["wall_time"].values
    computed = (dataset["status"].values == DONE) & (spent > 0.0)
    simulated = float(given["members"] * dataset["duration"].values[computed].sum())
    seconds = float(spent[computed].sum())
    if not simulated:
        return ["Nothing has been computed yet."]
    return [
        f"Computed: {computed.sum()} distinct, {simulated:.4g} s of motion in {seconds:.4g} s of computing: "
        f"{seconds / simulated:.4f} s per simulated second. Where a scene is proved to slide steadily "
        "for good, the rest of its run is filled in."
    ]
