"""The command line. Data goes to standard output, everything else to standard error.

Heavy packages are imported inside the commands: `fiv --help` answers at once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from traceback import print_exception
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from sweeps.plan import Plan

SOME_FAILED, WRONG_INPUT, STORE_TAKEN, INTERRUPTED = 1, 2, 3, 130
ASK_SECONDS, ASK_BYTES = 300.0, 1e9

set_option = click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="AXIS=SPEC",
    help="Other values for an axis or a setting: mu=0.2, mu=0.1,0.2, mu=0:0.5:101, mu=log:1e-3:1:30.",
)
out_option = click.option(
    "--out", type=click.Path(), help="Folder for results; default: FIV_RESULTS, else ./results."
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="fiv", prog_name="fiv")
def fiv() -> None:
    """Studies of friction-induced vibration: two beams in frictional point contact.

    \b
    fiv list                     what there is
    fiv run fig5                 compute, store and draw a study
    fiv run fig5 --set theta=8   the same for another inclination
    """  # noqa: D301 - the backspace tells click to keep the lines


def command(name: str) -> Callable[[Callable[..., Any]], click.Command]:
    """A command with -v and -q."""

    def decorate(function: Callable[..., Any]) -> click.Command:
        quiet = click.option("-q", "--quiet", is_flag=True, help="Only data and errors.")
        verbose = click.option("-v", "--verbose", is_flag=True, help="With the traceback of an error.")
        return fiv.command(name)(quiet(verbose(function)))

    return decorate


@command("list")
@click.argument("study", required=False)
def list_studies(study: str | None, quiet: bool, verbose: bool) -> None:
    """Studies: what each asks, its size, and its time as probed now.

    With the name of one: what the paper says, and all that can be set.
    """
    from studies import registry
    from sweeps.plan import duration

    with _input_errors(verbose):
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
@set_option
@out_option
def show_plan(study: str, assignments: tuple[str, ...], out: str | None, quiet: bool, verbose: bool) -> None:
    """Dry run: what a run would compute, store and cost. Nothing is written."""
    click.echo(repr(_planned(study, assignments, out, verbose)))


@command("run")
@click.argument("study")
@set_option
@out_option
@click.option("--scheduler", default="threads", metavar="threads|sync", help="How batches are executed.")
@click.option("--workers", type=click.IntRange(min=1), help="Threads; default: one a core.")
@click.option("--yes", is_flag=True, help="Never ask, however long it takes.")
def run(
    study: str,
    assignments: tuple[str, ...],
    out: str | None,
    scheduler: str,
    workers: int | None,
    yes: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Compute a study, store it as netCDF, draw its figure, and print its numbers beside the paper's."""
    if scheduler not in ("threads", "sync"):
        raise click.UsageError(f"--scheduler {scheduler!r}: it must be threads or sync")
    planned = _planned(study, assignments, out, verbose)
    if not quiet:
        click.echo(repr(planned), err=True)
    large = planned.seconds > ASK_SECONDS or planned.bytes > ASK_BYTES
    if large and not yes and sys.stdin.isatty():
        click.confirm("Go ahead?", abort=True, err=True)
    from studies import runner
    from studies.progress import progress

    with progress(planned.todo, quiet) as told:
        finished = runner.execute(planned, scheduler, workers, told)
    click.echo(finished.study.report(finished.dataset))
    if not quiet:
        click.echo(f"\nwritten: {finished.file}\n         {finished.figure}", err=True)
    if finished.failed:
        dataset = finished.dataset
        for place in zip(*(dataset["status"].values == 2).nonzero(), strict=True):
            at = dict(zip(dataset["status"].dims, place, strict=True))
            point = dataset.isel(at)
            where = ", ".join(f"{dim} = {point[dim].item()}" for dim in at)
            click.echo(f"failed: {where}: {point['error'].item()}", err=True)
        sys.exit(SOME_FAILED)


@command("plot")
@click.argument("target", metavar="STUDY|PATH")
@click.option("--out", type=click.Path(), help="Results folder of a STUDY; of a PATH, where the figure goes.")
def plot(target: str, out: str | None, quiet: bool, verbose: bool) -> None:
    """Draw the figure of a study again from its netCDF file."""
    from studies import registry, runner

    with _input_errors(verbose):
        dataset = runner.open_dataset(target, out)
        study = registry.load(dataset.attrs.get("sweep", ""))
        file = runner.results_file(target, out)
        if out and target not in registry.NAMES:
            file = runner.results_folder(out) / file.name
        drawn = runner.plot(study, dataset, file)
    click.echo(str(drawn))


def _planned(study: str, assignments: tuple[str, ...], out: str | None, verbose: bool) -> Plan:
    """The plan; whatever is wrong with the input shows here, before anything is written."""
    from studies import runner, spec

    with _input_errors(verbose):
        given: dict[str, Any] = {}
        for text in assignments:
            name, values = spec.assignment(text)
            if name in given:
                raise ValueError(f"--set {text!r}: {name} is set already; give all its values at once")
            given[name] = values
        return runner.plan(study, given, out)


class _input_errors:
    """Turn what the checks of input raise into a usage error of one line."""

    def __init__(self, verbose: bool) -> None:
        self.verbose = verbose

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, problem: BaseException | None, traceback: Any) -> None:
        if isinstance(problem, (ValueError, ArithmeticError, FileNotFoundError)):
            if self.verbose:
                print_exception(problem)
            raise click.UsageError(str(problem)) from None


def main() -> NoReturn:
    """Entry point: exit codes as documented, errors in one line."""
    try:
        code = fiv.main(standalone_mode=False)
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
        from sweeps import StoreError

        if not isinstance(problem, StoreError):
            raise
        click.echo(f"fiv: {problem}", err=True)
        code = STORE_TAKEN
    sys.exit(code if isinstance(code, int) else 0)
