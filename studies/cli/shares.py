"""The command `merge` for shares of a run. Heavy packages are imported inside it."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from studies.cli.app import command, warned
from studies.cli.compute import planned_again
from studies.cli.execution import report
from studies.cli.options import OUT, RIGS, STUDY
from studies.cli.output import show

DIRS = click.argument("folders", nargs=-1, metavar="[DIR ...]", type=click.Path())


@command("merge", "Assemble the shares of a run into one result.", STUDY, DIRS, RIGS, OUT)
def merge(study: str, folders: tuple[str, ...], rig: str | None, out: str | None) -> None:
    """Assemble what jobs with `fiv run STUDY --share K/N` have computed, in one results folder or in several.

    \b
    fiv run fig5 --share 1/2 --out shares
    fiv run fig5 --share 2/2 --out shares
    fiv merge fig5 --out shares

    DIR are further results folders, in which other jobs have computed their shares. Missing shares are named; what
    they would have computed is pending until they have run and all is merged again.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import registry, runner
    from studies.answering import results
    from studies.asking import rigs
    from sweeps import PENDING, MissingFileError, Store

    name = Path(study).stem if (is_file := results.is_path(study)) else registry.resolve(study).name
    places = [results.results_folder(each) for each in (rigs.place(rig, out), *folders)]
    files = [place / (results.MAPS if is_file else name) / f"{name}.nc" for place in places]
    if (source := next((file for file in files if Store(file).exists()), None)) is None:
        where = ", ".join(map(str, places))
        raise MissingFileError(
            f"{study}: no share of it in {where}; compute one with: fiv run {study} --share 1/4"
        )
    one, planned = planned_again(source, out, rig)
    with results.damage_as_error(planned.store), warned(lambda line: show(line, err=True)):
        dataset = planned.merge(*files[1:])
    if (dataset["status"] == PENDING).any():
        sys.exit(1)
    assert planned.store is not None
    report(one, runner.RunResult(one, dataset, planned.store, runner.plot(one, dataset, planned.store)))
