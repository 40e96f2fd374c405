"""The commands that show what there is: list, status, query, plot, report, and what a shell completes.

Heavy packages are imported inside the commands: `fiv --help` answers at once.
"""

from __future__ import annotations

import click

from studies.cli import completion
from studies.cli.app import command, fiv
from studies.cli.execution import status_text
from studies.cli.options import InputErrors, out_option, query_options


@command("list", "Studies: what each asks, its size and its time.")
@click.argument("study", required=False, shell_complete=completion.STUDY)
def list_studies(study: str | None, quiet: bool, verbose: bool) -> None:
    """Studies: what each asks, its size, and its time as probed now.

    With the name of one: what the paper says, and all that can be set.

    \b
    fiv list
    fiv list fig5
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import registry
    from sweeps import duration

    with InputErrors(verbose):
        studies = [registry.load(name) for name in ((study,) if study else registry.NAMES)]
        sweeps = [one.sweep({}) for one in studies]
    for one, sweep in zip(studies, sweeps, strict=True):
        click.echo(f"{one.name:<10} {one.title}")
        if not quiet:
            plan = sweep.plan().timed()
            click.echo(f"{'':<10} {one.question}")
            click.echo(f"{'':<10} {plan.points} points, about {duration(plan.seconds)} on one core")
        if study:
            click.echo(f"\n{one.statement()}")


@command("status", "How far a study is, also while it runs.")
@click.argument("target", metavar="STUDY|PATH", shell_complete=completion.studies_or_paths)
@click.option("--json", "as_json", is_flag=True, help="As JSON.")
@out_option
def show_status(target: str, as_json: bool, out: str | None, quiet: bool, verbose: bool) -> None:
    """How far a study is: running, interrupted or complete; from any shell, while it runs.

    \b
    fiv status regimes
    fiv status elsewhere/scenes/scenes.nc --json
    """  # noqa: D301 - the backspace tells click to keep the lines
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


@command("query", "Rows of a result as a table, CSV or JSON.")
@click.argument("target", metavar="STUDY|PATH", shell_complete=completion.studies_or_paths)
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
    fiv query scenes --where 'status == "failed"' --show V,theta,mu,F,error

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
    from studies.query.printing import print_rows
    from studies.query.query import select

    def note(text: str) -> None:
        if not quiet:
            click.echo(f"fiv: {text}", err=True)

    with InputErrors(verbose):
        dataset = runner.open_dataset(target, out)
        chosen = select(dataset, where, show=show, sort=sort, limit=limit, note=note)
        print_rows(chosen, form, show is None, note)


@command("plot", "Draw the figure of a study or map again.")
@click.argument("target", metavar="STUDY|PATH", shell_complete=completion.studies_or_paths)
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
    """Draw the figure of a study again from its netCDF file.

    \b
    fiv plot fig5 --format svg
    fiv plot results/map/growth_rate-theta-mu.nc
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import runner

    with InputErrors(verbose):
        dataset = runner.open_dataset(target, out)
        file = runner.results_file(target, out)
        study = runner.study_of(dataset, str(file))
        if out and (target.endswith(".nc") or "/" in target):
            file = runner.results_folder(out) / file.name
        drawn = runner.plot(study, dataset, file, form)
    click.echo(str(drawn))


@command("report", "One HTML page of every result.")
@click.argument("targets", nargs=-1, metavar="[STUDY|PATH]...", shell_complete=completion.studies_or_paths)
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
    from studies.report import page as report

    with InputErrors(verbose):
        page = report.write(targets, out, file, lambda line: click.echo(f"fiv: {line}", err=True))
    click.echo(str(page))


@command("completion", "Print what a shell needs to complete names.")
@click.argument("shell", metavar="|".join(completion.SHELLS), type=click.Choice(completion.SHELLS))
def complete(shell: str, quiet: bool, verbose: bool) -> None:
    """Print what a shell needs to complete names of studies, axes, quantities and columns.

    \b
    eval "$(fiv completion bash)"             in ~/.bashrc
    eval "$(fiv completion zsh)"              in ~/.zshrc
    fiv completion fish | source              in ~/.config/fish/config.fish
    """  # noqa: D301 - the backspace tells click to keep the lines
    click.echo(completion.script(fiv, shell))
