"""Comparison of two rigs from their results: numbers, onsets, unstable modes, regimes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Structure
from studies import paper
from studies.answering.results import settings, structure_in
from studies.declaring import labels
from studies.declaring.parameters import RIG, SCENE
from sweeps import DONE

# Results of two rigs by the rigs' names; of steady sliding (study fig5) if nothing else is said.
Pair = Mapping[str, xr.Dataset]
LAID = ("mu", "frequency")
CROSSINGS = {"onset": "Flutter onsets", "recovery": "Recoveries"}


def parts(pair: Pair, motions: Mapping[str, Pair]) -> Iterator[Any]:
    """Sentences, and tables with their captions; `motions` are results of both rigs with regimes, by study."""
    yield first(pair)
    yield "Numbers that differ", numbers(pair)
    for kind, caption in CROSSINGS.items():
        if any(data.sizes[kind] for data in pair.values()):
            yield caption, crossings(pair, kind)
    mu = common_friction(pair)
    if len(table := growing(pair, mu)):
        yield f"Unstable modes at mu = {mu:g}", table
    else:
        yield f"Neither has an unstable mode at mu = {mu:g}."
    for study, each in motions.items():
        yield from regimes(study, each)


def first(pair: Pair) -> str:
    """The onset of each rig, in a sentence."""
    texts = list[str]()
    for name, data in pair.items():
        last = float(data["mu"][-1])
        text = f"stable up to mu = {last:g}"
        if data.sizes["onset"]:
            text = "from mu = {:.4f} on, at {:.0f} Hz".format(*(float(data[f"onset_{k}"][0]) for k in LAID))
        if np.isfinite(jams := float(data["divergence_mu"])):
            text += f" (jams from {jams:.4f})"
        texts.append(f"{name} {text}")
    return f"Flutter of steady sliding: {'; '.join(texts)}."


def numbers(pair: Pair) -> pd.DataFrame:
    """The numbers in which the rigs differ; a structure counts as a whole."""
    rows = list[tuple[str, ...]]()
    if structures := {name: content for name, data in pair.items() if (content := structure_in(data))}:
        texts = {name: repr(Structure.from_dict(each)) for name, each in structures.items()}
        if len(set(texts.values())) > 1 or len(texts) < len(pair):
            rows = [("structure", *(texts.get(name, "two beams") for name in pair))]
    values = [settings(data) for data in pair.values()]
    for name, parameter in ({"theta": SCENE["theta"]} | RIG).items() if not structures else ():
        own = [each.get(name, parameter.default) for each in values]
        if own[0] != own[1]:
            rows.append((name, *(labels.named(name, v, parameter.units).partition(" = ")[2] for v in own)))
    return pd.DataFrame(rows, columns=["number", *pair])


def crossings(pair: Pair, kind: str) -> pd.DataFrame:
    """Onsets or recoveries of each rig, ascending in mu; the n-th row has the n-th of both."""
    columns = {
        f"{name} {head}": pd.Series(data[f"{kind}_{which}"].values, dtype=float)
        for name, data in pair.items()
        for which, head in zip(LAID, ("μ", "Hz"), strict=True)
    }
    return pd.DataFrame(columns)


def common_friction(pair: Pair) -> float:
    """The paper's friction, or the largest friction below it at which both were computed."""
    return min(paper.MU, *(float(data["mu"][-1]) for data in pair.values()))


def growing(pair: Pair, mu: float) -> pd.DataFrame:
    """Frequency and growth rate of the unstable modes at the value of the grid nearest to a friction."""
    rows = list[tuple[str, float, float]]()
    for name, data in pair.items():
        at = data.sel(mu=mu, method="nearest")
        rates = at["growth_rate"].values
        rows += [(name, at["frequency"].values[k], rates[k]) for k in np.flatnonzero(rates > 0.0)]
    return pd.DataFrame(rows, columns=["rig", "frequency Hz", "growth rate 1/s"])


def regimes(study: str, pair: Pair) -> Iterator[Any]:
    """The number of common points with equal regimes, and the regimes that differ."""
    found = [data[["regime", "status"]] for data in pair.values()]
    if all(data.sizes.get("theta") == 1 for data in found):
        found = [data.isel(theta=0, drop=True) for data in found]  # a number of each rig
    places = [{name: data[name].item() for name in ("V", "mu", "F") if not data[name].ndim} for data in found]
    nothing = f"{study}: the two have no points in common."
    if found[0]["status"].dims != found[1]["status"].dims or places[0] != places[1]:
        yield nothing
        return
    words = [
        data.assign(word=data["regime"].copy(data=np.asarray(labels.words(data["regime"])))) for data in found
    ]
    aligned = xr.align(*words, join="inner")
    done = (aligned[0]["status"] == DONE).values & (aligned[1]["status"] == DONE).values
    if not done.any():
        yield nothing
        return
    ours, theirs = pair
    left, right = (pd.Series(each["word"].values[done]) for each in aligned)
    yield f"{study}: the same regime at {np.mean(left == right):.0%} of {done.sum()} common points."
    table = pd.crosstab(left, right)
    table.columns = [f"{theirs}: {word}" for word in table.columns]
    yield f"Points of {study} by the regime of both", table.rename_axis(ours).reset_index()
