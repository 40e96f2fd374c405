"""The command line. Data goes to standard output, everything else to standard error.

Heavy packages are imported inside the commands: `fiv --help` answers at once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NoReturn

import click

from studies.carrying_out import carry_out, status_text
from studies.options import (
    INTERRUPTED,
    SOME_FAILED,
    STORE_TAKEN,
    WRONG_INPUT,
    InputErrors,
    MapCommand,
    map_options,
    out_option,
    query_options,
    what_options,
    where_options,
)

if TYPE_CHECKING:
    from studies.runner import Finished
    from sweeps.plan import Plan


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

    carry_out(planned, execute, yes, quiet, verbose)


@command("map", MapCommand)
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

    carry_out(planned, execute, yes, quiet, verbose)


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
    click.echo(dumps(told) if as_json else status_text(found))


@command("query")
@click.argument("target", metavar="STUDY|PATH")
@query_options
def query_rows(
    target: str,
    where: str | None,
    show: str | None,
    sort: str | None,
    limit: int | None,
    form: str,
    out: str | None,
    quiet: bool,
    verbose: bool,
) -> None:
    """Rows of a result, whole or still running: chosen, sorted, and printed as a table, CSV or JSON.

    \b
    fiv query regimes --where 'mu > 0.2 and regime == "intermittent"' --sort -velocity_rms --limit 5
    fiv query fig5 --where 'growth_rate > 0 and mu == 0.2' --show mu,frequency,growth_rate
    fiv query results/map/growth_rate-theta-mu.nc --where '5 <= theta <= 8' --format csv > map.csv

    EXPR is of comparisons (== != < <= > >=, also 0.1 < mu < 0.2), and, or, not, + - * / **, brackets, numbers,
    'texts' and names: axes, variables, and the settings of the study. Words such as those of regime and status may
    have spaces or underscores. No comparison is true of a missing value; x == nan finds it, x != nan all others.

    Equality of an axis with a number finds the axis's nearest value, if it is within a thousandth of that value's
    distance from its nearest neighbour, and of an axis with one value within a millionth of it. So theta ==
    5.0000001 finds 5. Where no value is so near, no row matches and the nearest value is told.

    The points of the sweep are the rows. A variable that has many entries at each point (of modes, members, in
    time) makes a row of each entry where it is asked for; entries without a value are left out, unless EXPR has
    nan in it. Without --show the columns are the axes and all that has one value for each row; with it they are
    those, and whatever tells the entries apart.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import runner
    from studies.printing import print_rows
    from studies.query import select

    def note(text: str) -> None:
        if not quiet:
            click.echo(f"fiv: {text}", err=True)

    with InputErrors(verbose):
        dataset = runner.open_dataset(target, out)
        chosen = select(dataset, where, show=show, sort=sort, limit=limit, note=note)
        print_rows(chosen, form, show is None, note)


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


@command("report")
@click.argument("targets", nargs=-1, metavar="[STUDY|PATH]...")
@out_option
@click.option(
    "--file", type=click.Path(dir_okay=False), help="The page; default: report.html in the results folder."
)
def write_report(targets: tuple[str, ...], out: str | None, file: str | None, quiet: bool, verbose: bool) -> None:
    """One HTML page of every result.

    For each its figure, its numbers beside the paper's, its cost and its points, and of a plane a map to point at.

    \b
    fiv report                              every study and map of the results folder
    fiv report regimes stability            these alone
    fiv report --file shared/results.html   under another name

    The page needs no network and no other file.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import report

    with InputErrors(verbose):
        page = report.write(targets, out, file, lambda line: click.echo(f"fiv: {line}", err=True))
    click.echo(str(page))


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
