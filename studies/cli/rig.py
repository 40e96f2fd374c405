"""The commands of named rigs: rig and compare. Heavy packages are imported inside them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from studies.cli.app import command, warned
from studies.cli.compute import planned_again
from studies.cli.execution import watched
from studies.cli.options import OUT
from studies.cli.output import columns, say, show
from studies.cli.progress import announce_compiling

if TYPE_CHECKING:
    import xarray as xr

    from studies.asking.rigs import NamedRig

NAME = click.argument("name", metavar="[NAME]", required=False)
SOURCE = click.argument("source", metavar="[FILE|RIG]", required=False)
SET = click.option("--set", "assignments", multiple=True, metavar="NAME=VALUE", help="A number: p1_length=60mm.")


@command("rig", "Name a rig, so that its results lie in a folder of their own.", NAME, SOURCE, SET, OUT)
def rig(name: str | None, source: str | None, assignments: tuple[str, ...], out: str | None) -> None:
    """Name a rig; or show one, or all.

    \b
    fiv rig mine --set p1_length=60mm --set theta=8
    fiv rig softer mine --set p2_young_modulus=70GPa
    fiv run fig5 --rig mine
    fiv compare mine paper

    The results folder keeps it as NAME/rig.toml, and its results beside that: results/mine/fig5/fig5.nc. Numbers
    that are not set are the paper's; a study that has a range of one, table6 of theta, keeps it. A rig comes from
    another one, from a TOML file with a table [set], or from that of a structure (fiv structure), whose modes are
    kept. A rig that has results is never changed. A name has letters, digits, _ and -.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import registry
    from studies.answering.results import RIG_FILE
    from studies.asking import rigs
    from studies.asking.request import assignment
    from sweeps import InputError

    if name is None:
        rows = [(each, rigs.title(each, out)) for each in rigs.names(out)]
        make = f"no rig has a name; begin with: fiv rig mine --set p1_length=60mm{f' --out {out}' if out else ''}"
        show(columns([("rig", "numbers"), *rows]) if rows else make)
        return
    values = dict[str, Any]()
    for text in assignments:
        number, value = assignment(text)
        if number in values:
            raise InputError(f"--set {text!r}: {number} is set already; a rig has one value of it")
        values[number] = value
    if source is None and not values:
        show("\n".join(rig_lines(rigs.named(name, out))))
        return
    with warned(say):
        one, written = rigs.define(name, source, values, out, taken=registry.names())
    show("\n".join(rig_lines(one)))
    say(f"\nwritten: {one.folder / RIG_FILE}" if written else "\nit is so already")
    more = ["--out", out] if out else []
    say(f"use it:  {' '.join(['fiv run', registry.names_for('first')[0], '--rig', one.name, *more])}")


def rig_lines(one: NamedRig) -> list[str]:
    """A rig's numbers beside the paper's, or its modes, and its results, as lines."""
    from fivcore import Structure
    from studies.asking import rigs
    from studies.cli import structure
    from studies.declaring.labels import named

    lines = [f"rig {one.name}: {', '.join(one.results) or 'no results yet'}"]
    if one.structure is not None:
        return [*lines, *structure.structure_lines(Structure.from_dict(one.structure))]
    rows = list[tuple[str, ...]]()
    for name, value in one.numbers.items():
        parameter = rigs.NUMBERS[name]
        both = (named(name, each, parameter.units) for each in (value, parameter.default))
        rows.append((name, *(text.partition(" = ")[2] for text in both)))
    return [*lines, columns([("number", one.name, "paper"), *rows]) if rows else "all numbers are the paper's"]


RIGS = tuple(click.argument(name, metavar=name.upper()) for name in ("a", "b"))


@command("compare", "Two rigs beside each other: numbers, onsets, regimes, a figure.", *RIGS, OUT)
def compare(a: str, b: str, out: str | None) -> None:
    """Two rigs beside each other: numbers that differ, onsets, unstable modes, and a figure of both.

    \b
    fiv compare mine paper

    A and B are names (fiv rig); `paper` is the paper's rig. Each rig's fig5 is computed if its folder lacks it.
    Where both have results of regimes, table6 or scenes, the regimes at their common points are compared; of the
    paper's rig those of the reference count too.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import registry, runner
    from studies.answering import results, summary
    from studies.answering.results import structure_in
    from studies.asking import rigs
    from studies.plotting import compare as drawing
    from studies.plotting import figures
    from studies.query import compare as tables
    from sweeps import InputError

    for name in (a, b):
        rigs.place(name, out)
    if a == b:
        raise InputError(f"compare {a} {b}: they are one rig; give two, such as: fiv compare {a} paper")
    announce_compiling()
    pair = {name: _sliding(name, out) for name in (a, b)}
    motions = dict[str, Any]()
    for study in registry.names_for("motions"):
        files = {name: _stored(study, rigs.named(name, out)) for name in pair}
        if all(files.values()):
            motions[study] = {name: results.open_dataset(str(file)) for name, file in files.items()}
    show(summary.text(tables.parts(pair, motions)))
    titles = {name: rigs.named(name, out).title for name in pair}
    own = {name: "" if structure_in(data) else f", {figures.place(data, 'theta')}" for name, data in pair.items()}
    note = "; ".join(f"{name}: {titles[name]}{own[name]}" for name in pair) + ". Modes below 10 kHz."
    target = results.results_folder(out) / "compare" / f"{a}-{b}.png"
    digest = " ".join(figures.data_digest(data) for data in pair.values())
    with figures.style(), runner.atomic_write(target) as temporary:
        temporary.write_bytes(figures.saved(drawing.draw(pair, note), "png", digest))
    say(f"\nwritten: {target}")


def _sliding(name: str, out: str | None) -> xr.Dataset:
    """The modes of a rig, computed if its folder lacks it; at other settings as it is stored."""
    from studies import registry, runner
    from studies.answering import results
    from studies.asking import rigs
    from sweeps import LockedError, StoreError, status

    (branches,) = registry.names_for("modes")
    file = results.file_of(branches, rigs.named(name, out).folder)
    try:
        study, planned = planned_again(branches, out, name)
    except LockedError:
        raise
    except StoreError:
        if status(file).state != "complete":
            raise
        stored = f"{branches} of {name} is compared as it is stored"
        say(f"fiv: {stored}, with other settings than a run by default has")
        return results.open_dataset(str(file))
    if not planned.todo:
        return planned.run("sync")
    say(f"computing {branches} of {name}")
    with watched(planned) as last:
        return runner.execute(study, planned, *runner.backend(None, None), last).dataset


def _stored(study: str, own: NamedRig) -> Any:
    """The file of a study's result of a rig, of the paper's also in the reference; None without one."""
    from studies.answering import results
    from sweeps import Store

    file = results.results_file(study, own.folder)
    return file if Store(file).exists() else None
