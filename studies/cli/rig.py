"""The commands of named rigs: rig and compare. Heavy packages are imported inside them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from studies.cli.app import command, warned
from studies.cli.execution import watched
from studies.cli.options import OUT
from studies.cli.output import columns, say, show
from studies.cli.progress import announce_compiling

if TYPE_CHECKING:
    import xarray as xr

    from studies.asking.rigs import NamedRig
    from studies.study import Study
    from sweeps import Plan

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

    lines, rows = [f"rig {one.name}: {', '.join(one.results) or 'no results yet'}"], list[tuple[str, ...]]()
    for name, value in one.numbers.items():
        parameter = rigs.NUMBERS[name]
        both = (named(name, each, parameter.units) for each in (value, parameter.default))
        rows.append((name, *(text.partition(" = ")[2] for text in both)))
    if rows:
        lines.append(columns([("number", one.name, "paper"), *rows]))
    if one.structure is not None:
        lines += structure.structure_lines(Structure.from_dict(one.structure))
    return [*lines] if rows or one.structure is not None else [*lines, "all numbers are the paper's"]


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
    from studies import runner
    from studies.answering import summary
    from studies.query import compare as comparing

    def computed(study: Study, planned: Plan) -> xr.Dataset:
        say(f"computing {study.name} of {planned.store.parents[1].name if planned.store else ''}")
        with watched(planned) as last:
            return runner.execute(study, planned, *runner.backend(None, None), last).dataset

    announce_compiling()
    own, pair, motions = comparing.compared(a, b, out, computed, lambda line: say(f"fiv: {line}"))
    show(summary.text(comparing.parts(own, pair, motions)))
    say(f"\nwritten: {comparing.drawn(own, pair, out)}")
