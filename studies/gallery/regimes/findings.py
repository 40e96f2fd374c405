"""A plane of regimes in numbers: scenes in each, how certain they are, and what the paper and stability say."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies import paper
from studies.claims import Claim, beside
from studies.gallery.regimes.compare_linear import BELOW, CERTAIN, VERDICTS, uncertain
from studies.motion import ensembles, regimes, transients
from studies.plotting import planes
from studies.study import constants
from studies.tables import Part, Table, number
from sweeps import DONE

CLAIMS = tuple(Claim("regime", {"V": V}, kind, "2, 3.5.3") for V, kind in paper.VIBRATION.items())
# What the table shows of a regime besides its size: variable, how it is written, factor.
MEDIANS: dict[str, tuple[str, str, float]] = {
    "stick": ("stick_fraction", ".3f", 1.0),
    "RMS mm/s": ("velocity_rms", ".2f", 1e3),
    "dominant Hz": ("dominant_frequency", ".0f", 1.0),
    "99.9 % of N": ("normal_force_999", ".1f", 1.0),
}
# The verdicts as a reader says them.
MEANINGS = {
    "agree": "motion and stability agree",
    "subcritical": f"vibrating though stable {BELOW} and above",
    "unstable above the band": f"vibrating, stable {BELOW}, unstable above in the model that is run",
    "quiet though unstable": "sliding steadily though unstable",
    "no verdict": "not compared: undecided, stuck, or too short for modes that die or grow slowly",
}


def findings(dataset: xr.Dataset) -> list[Part]:
    """Regimes and how sure they are, the motion against linear stability, and the paper's speeds."""
    fixed = constants(dataset)
    rig = "the paper's rig" if paper.is_rig(dataset) else "another rig than the paper's"
    everywhere = np.ones(dataset["regime"].shape, dtype=bool)
    return [
        f"{everywhere.size} scene{'s' if everywhere.size > 1 else ''} on {rig}: "
        f"{where(dataset, everywhere, everything=True)}.",
        f"Runs of each: {fixed['members']}, {transients.damping(fixed)}, from the first slip and "
        f"{transients.SETTLING:g} s on {ensembles.duration_text(fixed)}.",
        "",
        _of_regimes(dataset),
        "Of a regime's figures the medians over its scenes.",
        "",
        _of_scenes(dataset, fixed["most"]),
        "",
        _onsets(dataset),
        *beside(dataset, CLAIMS, cells=True),
    ]


def where(dataset: xr.Dataset, chosen: NDArray[np.bool_], everything: bool = False) -> str:
    """The range of each axis that the chosen points span; by default only of axes with more than one value."""
    parts = []
    for axis, name in enumerate(map(str, dataset["regime"].dims)):
        others = tuple(k for k in range(chosen.ndim) if k != axis)
        values = dataset[name].values[chosen.any(axis=others)]
        if len(values) and (everything or len(dataset[name]) > 1):
            _, unit, factor = planes.SYMBOLS[name]
            ends = dict.fromkeys(f"{factor * end:.4g}" for end in (values.min(), values.max()))
            parts.append(f"{name} = {' to '.join(ends)} {unit}".rstrip())
    return ", ".join(parts)


def _of_regimes(dataset: xr.Dataset) -> Table:
    """A row for each regime that occurs: its size, its uncertain scenes, and medians of figures."""
    kinds, unsure = regimes.kinds(dataset), uncertain(dataset)
    figures = dataset.assign(dominant_frequency=regimes.dominant_frequency(dataset))
    rows = []
    for code in np.unique(kinds):
        inside = kinds == code
        own = figures.where(xr.DataArray(inside, dims=dataset["regime"].dims))
        medians = [number(own[name].median(), form, factor) for name, form, factor in MEDIANS.values()]
        share = f"{100.0 * inside.mean():.1f}"
        rows.append([regimes.KINDS[code], f"{inside.sum()}", share, f"{(inside & unsure).sum()}", *medians])
    return Table(["regime", "scenes", "%", "uncertain", *MEDIANS], rows)


def _of_scenes(dataset: xr.Dataset, most: float) -> Table:
    """How motion and stability compare, and which scenes are less than sure; how many, and where they lie."""
    verdict, done = dataset["verdict"].values, dataset["status"].values == DONE
    cases = {text: verdict == VERDICTS.index(name) for name, text in MEANINGS.items()} | {
        "undecided": done & regimes.is_of(regimes.kinds(dataset), "undecided"),
        f"uncertain: repeat runs differ and certainty below {CERTAIN:g}": uncertain(dataset),
        # Durations are kept to six digits.
        f"cut short at {most:g} s": dataset["duration"].values >= (1.0 - 1e-5) * most,
    }
    rows = [
        [text, f"{chosen.sum()}", where(dataset, chosen) if chosen.any() else ""] for text, chosen in cases.items()
    ]
    return Table([f"of {done.sum()} computed scenes", "count", "where"], rows, words=1)


def _onsets(dataset: xr.Dataset) -> str:
    """Where steady sliding loses its stability."""
    mu, frequency = dataset["onset_mu"], dataset["onset_frequency"]
    lost = int(mu.count())
    if not lost:
        return f"Steady sliding stays stable, modes {BELOW}."
    ends, hertz = (
        " to ".join(dict.fromkeys(f"{float(end):{form}}" for end in (each.min(), each.max())))
        for each, form in ((mu, ".4f"), (frequency, ".0f"))
    )
    return (
        f"Steady sliding loses stability at {lost} of {mu.size} inclinations, at mu = {ends} ({hertz} Hz), "
        f"modes {BELOW}."
    )
