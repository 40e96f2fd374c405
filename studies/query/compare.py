"""Comparison of two rigs from their results: numbers, onsets, unstable modes, regimes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sweeps
from fivcore import Structure
from studies import paper, registry, runner
from studies.answering import results
from studies.answering.results import settings, structure_in
from studies.asking import rigs
from studies.asking.request import Request
from studies.asking.rigs import NamedRig
from studies.declaring import labels
from studies.study import Study
from sweeps import DONE, InputError, LockedError, StoreError

# Results of two rigs by the rigs' names; of steady sliding (study fig5) if nothing else is said.
Pair = Mapping[str, xr.Dataset]
# Two rigs, their fig5, and by study the results of both that know the regime of a motion.
Compared = tuple[Mapping[str, NamedRig], Pair, Mapping[str, Pair]]
LAID = ("mu", "frequency")
CROSSINGS = {"onset": "Flutter onsets", "recovery": "Recoveries"}


def compared(
    a: str | NamedRig,
    b: str | NamedRig,
    out: str | Path | None,
    execute: Callable[[Study, sweeps.Plan], xr.Dataset],
    tell: Callable[[str], None],
) -> Compared:
    """Two rigs by their names and their results; `execute` computes what is missing, `tell` is given notes."""
    own = {rig.name: rig for rig in (rigs.kept(a, out), rigs.kept(b, out))}
    if len(own) < 2:
        (name,) = own
        raise InputError(f"compare {name} {name}: they are one rig; give two, such as: fiv compare {name} paper")
    pair, motions = {name: sliding(rig, execute, tell) for name, rig in own.items()}, dict[str, Pair]()
    for study in registry.names_for("motions"):
        # Of the paper's rig those of the reference, too.
        files = {name: results.results_file(study, rig.folder) for name, rig in own.items()}
        if all(sweeps.Store(file).exists() for file in files.values()):
            motions[study] = {name: results.open_dataset(file) for name, file in files.items()}
    return own, pair, motions


def sliding(
    rig: NamedRig, execute: Callable[[Study, sweeps.Plan], xr.Dataset], tell: Callable[[str], None]
) -> xr.Dataset:
    """The result of study fig5 of a rig, computed if its folder lacks it; at other settings as it is stored."""
    study = registry.resolve(registry.names_for("modes")[0])
    file = results.file_of(study.name, rig.folder)
    try:
        planned = runner.plan(study, rigs.applied(rig, Request(), study), rig.folder)
    except LockedError:
        raise
    except StoreError:
        if sweeps.status(file).state != "complete":
            raise
        note = "is compared as it is stored, with other settings than those of a run by default"
        tell(f"{study.name} of {rig.name} {note}")
        return results.open_dataset(file)
    return execute(study, planned) if planned.todo else planned.run("sync")


def joined(pair: Pair) -> xr.Dataset:
    """Both in one dataset along `rig`, padded where the two differ in modes, onsets or numbers."""
    scalars = {name for data in pair.values() for name, coord in data.coords.items() if not coord.ndim}
    whole = [data.assign_coords(dict.fromkeys(scalars - {*data.coords}, np.nan)) for data in pair.values()]
    how: Any = {"join": "outer", "combine_attrs": "drop_conflicts", "coords": "different", "compat": "equals"}
    return xr.concat(whole, xr.DataArray(np.array([*pair]), dims="rig", name="rig"), data_vars="all", **how)


def drawn(own: Mapping[str, NamedRig], pair: Pair, out: str | Path | None) -> Path:
    """Draw both in one figure below the results folder; its path."""
    from studies.plotting import compare, figures

    at = {name: "" if structure_in(data) else f", {figures.place(data, 'theta')}" for name, data in pair.items()}
    note = "; ".join(f"{name}: {rig.title}{at[name]}" for name, rig in own.items()) + ". Modes below 10 kHz."
    target = results.results_folder(out) / "compare" / f"{'-'.join(own)}.png"
    digest = " ".join(figures.data_digest(data) for data in pair.values())
    with figures.style(), runner.atomic_write(target) as temporary:
        temporary.write_bytes(figures.saved(compare.draw(pair, note), "png", digest))
    return target


def parts(own: Mapping[str, NamedRig], pair: Pair, motions: Mapping[str, Pair]) -> Iterator[Any]:
    """Sentences, and tables with their captions."""
    yield first(pair)
    yield "Numbers that differ", numbers(own, pair)
    for kind, caption in CROSSINGS.items():
        if any(data.sizes[kind] for data in pair.values()):
            yield caption, crossings(pair, kind)
    mu = friction(own, pair)
    where = " and ".join(dict.fromkeys(f"mu = {each:g}" for each in mu.values()))
    if len(table := growing(pair, mu)):
        yield f"Unstable modes at {where}", table
    else:
        yield f"Neither has an unstable mode at {where}."
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


def numbers(own: Mapping[str, NamedRig], pair: Pair) -> pd.DataFrame:
    """The numbers in which the rigs differ; a structure counts as a whole."""
    rows = list[tuple[str, ...]]()
    if structures := {name: content for name, data in pair.items() if (content := structure_in(data))}:
        texts = {name: repr(Structure.from_dict(each)) for name, each in structures.items()}
        if len(set(texts.values())) > 1 or len(texts) < len(pair):
            rows = [("structure", *(texts.get(name, "two beams") for name in pair))]
    values = [{**own[name].numbers, **settings(data)} for name, data in pair.items()]
    for name in [name for name in rigs.NUMBERS if not structures or name in rigs.OPERATION]:
        both = [each.get(name, rigs.NUMBERS[name].default) for each in values]
        if both[0] != both[1]:
            rows.append(
                (name, *(labels.named(name, v, rigs.NUMBERS[name].units).partition(" = ")[2] for v in both))
            )
    return pd.DataFrame(rows, columns=["number", *pair])


def crossings(pair: Pair, kind: str) -> pd.DataFrame:
    """Onsets or recoveries of each rig, ascending in mu; the n-th row has the n-th of both."""
    columns = {
        f"{name} {head}": pd.Series(data[f"{kind}_{which}"].values, dtype=float)
        for name, data in pair.items()
        for which, head in zip(LAID, ("μ", "Hz"), strict=True)
    }
    return pd.DataFrame(columns)


def friction(own: Mapping[str, NamedRig], pair: Pair) -> dict[str, float]:
    """The friction of each; the paper's for one without, at most the largest at which both were computed."""
    most = min(float(data["mu"][-1]) for data in pair.values())
    return {name: min(rig.numbers.get("mu", paper.MU), most) for name, rig in own.items()}


def growing(pair: Pair, mu: Mapping[str, float]) -> pd.DataFrame:
    """Frequency and growth rate of the modes that grow at the value of the grid nearest to a rig's friction."""
    rows = list[tuple[str, float, float]]()
    for name, data in pair.items():
        at = data.sel(mu=mu[name], method="nearest")
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
