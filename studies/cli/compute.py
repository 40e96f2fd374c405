"""The commands that compute: plan, run and map.

Heavy packages are imported inside the commands: `fiv --help` answers at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from studies.cli import completion
from studies.cli.app import command
from studies.cli.errors import InputErrors
from studies.cli.execution import carry_out
from studies.cli.options import MapCommand, map_options, what_options, where_options

if TYPE_CHECKING:
    from studies.config import Config
    from studies.runner import Finished
    from sweeps import Plan


@command("plan", "Dry run: what a run would compute and cost.")
@click.argument("study", shell_complete=completion.study)
@what_options
@click.option("--time", "timed", is_flag=True, help="Compute a few points now, to tell how long all would take.")
def show_plan(study: str, timed: bool, quiet: bool, verbose: bool, **what: Any) -> None:
    """Dry run: what a run would compute, store and cost. Nothing is written, and without --time nothing computed.

    \b
    fiv plan fig5 --set mu=0:0.5:2001
    fiv plan scenes --set V=log:1e-3:1e-2:10 --record velocity_B
    """  # noqa: D301 - the backspace tells click to keep the lines
    planned, _ = _planned(study, verbose, **what)
    click.echo(repr(planned.timed() if timed else planned))


@command("run", "Compute a study, store it, draw it, tell its numbers.")
@click.argument("study", shell_complete=completion.study)
@what_options
@where_options
def run(
    study: str,
    scheduler: str | None,
    workers: int | None,
    fail_fast: bool,
    yes: bool,
    quiet: bool,
    verbose: bool,
    **what: Any,
) -> None:
    """Compute a study, store it as netCDF, draw its figure, and print its numbers beside the paper's.

    \b
    fiv run fig5
    fiv run fig5 --set theta=8 --set p1_length=0.06 --out elsewhere
    fiv run scenes --set V=1e-3,2e-3 --record velocity_B,normal_force --sample-rate 50e3 --out series

    What the results folder holds of it already is kept and completed. Ctrl-C finishes what is under way and keeps
    it; the same command goes on from there.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import runner
    from studies.cli.progress import progress

    planned, config = _planned(study, verbose, scheduler=scheduler, workers=workers, writing=True, **what)
    with InputErrors(verbose):
        backend = runner.backend(config.scheduler, config.workers)

    def execute() -> Finished:
        with progress(planned.todo, quiet) as told:
            return runner.execute(planned, *backend, told, fail_fast=fail_fast)

    carry_out(planned, execute, yes, quiet, verbose)


@command("map", "One quantity over any two axes, stored and drawn.", MapCommand)
@map_options
@where_options
def draw_map(
    x: str,
    y: str,
    fixed: tuple[str, ...],
    quantity: str,
    halvings: int,
    tolerance: float | None,
    out: str | None,
    fresh: bool,
    retry_failed: bool,
    scheduler: str | None,
    workers: int | None,
    fail_fast: bool,
    yes: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Map one quantity over any two axes of the rig or its operation; store it as netCDF and draw it.

    \b
    fiv map --x theta=-10:20:9 --y mu=0:0.5:9 --quantity growth_rate --refine 3
    fiv map --x V=log:2e-4:1e-2:9 --y mu=0.01:0.4:9 --quantity regime --refine 3 --fix theta=8

    With --refine the SPECs give a coarse lattice; the map has 2^N times as many intervals, and is computed where
    it changes.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import runner
    from studies.cli.progress import progress
    from studies.maps import maps
    from sweeps import check_free

    with InputErrors(verbose):
        backend = runner.backend(scheduler, workers)
        plane = maps.plane_of(x, y, halvings)
        held = maps.fixed_of(fixed)
        sweep = maps.sweep_of(plane, quantity, held, halvings, tolerance)
        file = maps.file_of(plane, quantity, out, held)
        check_free(file)
        planned = sweep.plan(file, fresh=fresh, retry_failed=retry_failed)

    def execute() -> Finished:
        with progress(planned.todo, quiet) as told:
            return runner.execute(planned, *backend, told, fail_fast=fail_fast)

    carry_out(planned, execute, yes, quiet, verbose)


def _planned(
    study: str,
    verbose: bool,
    assignments: tuple[str, ...],
    config_file: str | None,
    out: str | None,
    record: str | None,
    sample_rate: float | None,
    fresh: bool,
    retry_failed: bool,
    scheduler: str | None = None,
    workers: int | None = None,
    writing: bool = False,
) -> tuple[Plan, Config]:
    """The plan and what it was asked for; whatever is wrong with the input shows here, before anything is written.

    Options come before the file of the configuration, and that before what a result was asked for.
    """
    from studies import config, registry, results, runner, spec
    from sweeps import InputError

    with InputErrors(verbose):
        names = () if record is None else tuple(name.strip() for name in record.split(","))
        asked = config.Config("", {}, {}, names, sample_rate, scheduler, workers)
        if config_file is not None:
            asked = asked.over(config.read(config_file))
        name = study
        if results.is_path(study):
            file = results.results_file(study)
            made = config.of_result(results.open_dataset(study), str(file))
            asked, name = asked.over(made), made.study
        one = registry.resolve(name)
        if asked.study not in ("", one.name, study):
            raise InputError(
                f"--config {config_file}: study = {asked.study!r}: STUDY is {one.name}; leave one out"
            )
        given = asked.given(one)
        options: dict[str, Any] = {}
        for text in assignments:
            axis, values = spec.assignment(text, one.texts)
            if axis in options:
                raise InputError(f"--set {text!r}: {axis} is set already; give all its values at once")
            options[axis] = values
        if writing:
            runner.check_free(one.name, out)
        plan = runner.plan(
            one,
            given | options,
            out,
            fresh=fresh,
            retry_failed=retry_failed,
            record=asked.record,
            sample_rate=asked.sample_rate,
        )
        return plan, asked
