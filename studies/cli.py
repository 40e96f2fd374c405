"""The command line. Data goes to standard output, everything else to standard error.

Heavy packages are imported inside the commands: `fiv --help` answers at once.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NoReturn

import click

from studies.options import (
    ASK_BYTES,
    ASK_SECONDS,
    INTERRUPTED,
    SOME_FAILED,
    STORE_TAKEN,
    WRONG_INPUT,
    InputErrors,
    map_options,
    out_option,
    what_options,
    where_options,
)

if TYPE_CHECKING:
    import xarray as xr

    from studies.runner import Finished
    from sweeps import Status
    from sweeps.plan import Plan

# So many failed points are listed.
LISTED = 20


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="fiv", prog_name="fiv")
def fiv() -> None:
    """Studies of friction-induced vibration: two beams in frictional point contact.

    \b
    fiv list                     what there is
    fiv run fig5                 compute, store and draw a study
    fiv run fig5 --set theta=8   the same for another inclination
    """  # noqa: D301 - the backspace tells click to keep the lines


def command(name: str, kind: type[click.Command] | None = None) -> Callable[[Callable[..., Any]], click.Command]:
    """A command with -v and -q."""

    def decorate(function: Callable[..., Any]) -> click.Command:
        quiet = click.option("-q", "--quiet", is_flag=True, help="Only data and errors.")
        verbose = click.option("-v", "--verbose", is_flag=True, help="With the traceback of an error.")
        return fiv.command(name, kind)(quiet(verbose(function)))

    return decorate


@command("list")
@click.argument("study", required=False)
def list_studies(study: str | None, quiet: bool, verbose: bool) -> None:
    """Studies: what each asks, its size, and its time as probed now.

    With the name of one: what the paper says, and all that can be set.
    """
    from studies import registry
    from sweeps.plan import duration

    with InputErrors(verbose):
        studies = [registry.load(name) for name in ((study,) if study else registry.NAMES)]
    for one in studies:
        click.echo(f"{one.name:<10} {one.title}")
        if not quiet:
            plan = one.sweep({}).plan()
            click.echo(f"{'':<10} {one.question}")
            click.echo(f"{'':<10} {plan.points} points, about {duration(plan.seconds)} on one core")
        if study:
            click.echo(f"\n{one.statement()}")


@command("plan")
@click.argument("study")
@what_options
def show_plan(study: str, quiet: bool, verbose: bool, **what: Any) -> None:
    """Dry run: what a run would compute, store and cost. Nothing is written."""
    click.echo(repr(_planned(study, verbose, **what)))


@command("run")
@click.argument("study")
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

    What the results folder holds of it already is kept and completed. Ctrl-C finishes what is under way and keeps
    it; the same command goes on from there.
    """
    from studies import runner
    from studies.progress import progress

    with InputErrors(verbose):
        backend = runner.backend(scheduler, workers)
        runner.check_free(study, what["out"])
    planned = _planned(study, verbose, **what)

    def execute() -> Finished:
        with progress(planned.todo, quiet) as told:
            return runner.execute(planned, *backend, told, fail_fast=fail_fast)

    _carry_out(planned, execute, yes, quiet, verbose)


class _MapCommand(click.Command):
    """Its help ends with what there is to choose from, which takes a moment to load."""

    def format_epilog(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        from studies.quantities import AXES, QUANTITIES, RUN

        for head, names in (("Quantities", QUANTITIES), ("Axes", AXES), ("Settings of runs", RUN)):
            with formatter.section(head):
                formatter.write_text(", ".join(names))


@command("map", _MapCommand)
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
    from studies import maps, runner
    from studies.progress import progress
    from sweeps import check_free
    from sweeps.refine import passes

    with InputErrors(verbose):
        backend = runner.backend(scheduler, workers)
        plane = maps.plane_of(x, y, halvings)
        sweep = maps.sweep_of(plane, quantity, maps.fixed_of(fixed), halvings, tolerance)
        file = maps.file_of(plane, quantity, out)
        check_free(file)
        plans = passes(sweep, file, fresh=fresh, retry_failed=retry_failed)
        planned = next(plans)

    def execute() -> Finished:
        return maps.execute(planned, plans, backend, lambda todo: progress(todo, quiet), fail_fast)

    _carry_out(planned, execute, yes, quiet, verbose)


@command("status")
@click.argument("target", metavar="STUDY|PATH")
@click.option("--json", "as_json", is_flag=True, help="As JSON.")
@out_option
def show_status(target: str, as_json: bool, out: str | None, quiet: bool, verbose: bool) -> None:
    """How far a study is: running, interrupted or complete; from any shell, while it runs."""
    from dataclasses import asdict
    from json import dumps
    from math import isnan

    from studies import runner
    from sweeps import status

    with InputErrors(verbose):
        found = status(runner.results_file(target, out))
    told = asdict(found)
    if isnan(told["run"].get("left", 0.0)):
        told["run"]["left"] = None  # JSON has no NaN
    click.echo(dumps(told) if as_json else _status_text(found))


@command("plot")
@click.argument("target", metavar="STUDY|PATH")
@click.option("--out", type=click.Path(), help="Results folder of a STUDY; of a PATH, where the figure goes.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["png", "svg", "pdf"]),
    default="png",
    show_default=True,
    help="Of the figure; svg and pdf are drawn in lines, for print.",
)
def plot(target: str, out: str | None, form: str, quiet: bool, verbose: bool) -> None:
    """Draw the figure of a study again from its netCDF file."""
    from studies import registry, runner

    with InputErrors(verbose):
        dataset = runner.open_dataset(target, out)
        study = registry.load(dataset.attrs.get("sweep", ""))
        file = runner.results_file(target, out)
        if out and target not in registry.NAMES:
            file = runner.results_folder(out) / file.name
        drawn = runner.plot(study, dataset, file, form)
    click.echo(str(drawn))


def _carry_out(planned: Plan, execute: Callable[[], Finished], yes: bool, quiet: bool, verbose: bool) -> None:
    """Show a plan, ask where it takes long, execute it, and tell what came of it."""
    from sweeps import AbandonedError, SchedulerError

    if not quiet:
        click.echo(repr(planned), err=True)
    # Where no probe tells how long it takes, it may take long.
    large = not planned.most_seconds <= ASK_SECONDS or (planned.todo and planned.bytes > ASK_BYTES)
    if large and not yes and sys.stdin.isatty() and not click.confirm("Go ahead?", err=True):
        click.echo("fiv: nothing was done", err=True)
        sys.exit(INTERRUPTED)
    try:
        finished = execute()
    except SchedulerError as problem:
        raise click.UsageError(str(problem)) from None
    except KeyboardInterrupt as interrupt:
        # One more changes nothing.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _leave_interrupted(planned, isinstance(interrupt, AbandonedError))
    click.echo(finished.study.report(finished.dataset))
    if not quiet:
        click.echo(f"\nwritten: {finished.file}\n         {finished.figure}", err=True)
    if finished.failed:
        _list_failures(finished.dataset, verbose)
        sys.exit(SOME_FAILED)


def _planned(
    study: str,
    verbose: bool,
    assignments: tuple[str, ...],
    out: str | None,
    record: str | None,
    sample_rate: float | None,
    fresh: bool,
    retry_failed: bool,
) -> Plan:
    """The plan; whatever is wrong with the input shows here, before anything is written."""
    from studies import runner, spec

    with InputErrors(verbose):
        given: dict[str, Any] = {}
        for text in assignments:
            name, values = spec.assignment(text)
            if name in given:
                raise ValueError(f"--set {text!r}: {name} is set already; give all its values at once")
            given[name] = values
        names = () if record is None else tuple(name.strip() for name in record.split(","))
        return runner.plan(
            study, given, out, fresh=fresh, retry_failed=retry_failed, record=names, sample_rate=sample_rate
        )


def _leave_interrupted(planned: Plan, abandoned: bool) -> NoReturn:
    """Say what is kept, and go; not waiting for threads that still compute."""
    from sweeps import status

    kept = ""
    with suppress(Exception):
        # Whatever the store is like now, an interrupted run ends as one.
        found = status(str(planned.store))
        count = f"{found.done + found.failed} of {found.points} points"
        kept = f"; {count} are kept, and the same command goes on from there"
    click.echo(f"fiv: interrupted{kept}", err=True)
    if abandoned:
        sys.stdout.flush()
        os._exit(INTERRUPTED)
    sys.exit(INTERRUPTED)


def _list_failures(dataset: xr.Dataset, verbose: bool) -> None:
    """Failed points, each with its reason, and how to see them again."""
    places = list(zip(*(dataset["status"].values == 2).nonzero(), strict=True))
    for place in places[:LISTED]:
        at = dict(zip(dataset["status"].dims, place, strict=True))
        point = dataset.isel(at)
        where = ", ".join(f"{dim} = {point[dim].item()}" for dim in at)
        click.echo(f"failed: {where}: {point['error'].item()}", err=True)
    if len(places) > LISTED:
        click.echo(f"failed: and {len(places) - LISTED} more", err=True)
    if "reproduce" in dataset and dataset.sizes["failure"]:
        if verbose:
            click.echo(dataset["traceback"].values[0], err=True)
        click.echo(f"again, in Python: {dataset['reproduce'].values[0]}", err=True)


def _status_text(found: Status) -> str:
    """A status as lines."""
    from sweeps.plan import duration

    rows = [("file", found.file), ("state", found.state), ("points", str(found.points))]
    rows += [(name, str(getattr(found, name))) for name in ("done", "failed", "pending", "skipped")]
    if found.pending and found.state == "complete":
        rows[-2] = (
            "pending",
            f"{found.pending}, which no run has {'computed' if found.interpolated else 'asked for'}",
        )
    if found.interpolated:
        rows.append(("interpolated", f"{found.interpolated}"))
    told = found.run
    if "pid" in told:
        rows.append(
            ("run by", f"process {told['pid']} on {told['host']}, begun {told.get('started', 'just now')}")
        )
    if "todo" in told:
        rows.append(("this run", f"{told['done']} of {told['todo']} computations, {told['rate']:.3g} a second"))
        if told["left"] == told["left"]:
            rows.append(("time left", duration(told["left"])))
        rows += [("now", what) for what in told["now"]]
    return "\n".join(f"{name:<15} {text}" for name, text in rows)


def main() -> NoReturn:
    """Entry point: exit codes as documented, errors in one line."""
    try:
        code = fiv.main(prog_name="fiv", standalone_mode=False)
    except click.exceptions.Exit as stop:
        code = stop.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("fiv: interrupted", err=True)
        code = INTERRUPTED
    except click.ClickException as problem:
        click.echo(f"fiv: {problem.format_message()}", err=True)
        code = WRONG_INPUT
    except Exception as problem:
        # Imported here: most runs need no sweeps to fail.
        from sweeps import StoreError, SweepStoppedError

        if not isinstance(problem, (StoreError, SweepStoppedError)):
            raise
        click.echo(f"fiv: {problem}", err=True)
        code = STORE_TAKEN if isinstance(problem, StoreError) else SOME_FAILED
    sys.exit(code if isinstance(code, int) else 0)
