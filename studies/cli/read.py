"""The commands that read results: list, status, query, plot, report; and completion.

Heavy packages are imported inside the commands, so that `fiv --help` answers at once.
"""

from __future__ import annotations

from typing import Any

import click

from studies.cli import completion
from studies.cli.app import command, fiv, is_set, say
from studies.cli.execution import status_text
from studies.cli.options import OUT, QUERY, TARGET
from studies.cli.output import Rows, show

TARGETS = click.argument("targets", nargs=-1, metavar="[STUDY|PATH]...", shell_complete=completion.study)


@command(
    "list",
    "Studies: what each asks, its size and its time.",
    click.argument("study", required=False, shell_complete=completion.study),
)
def list_studies(study: str | None) -> None:
    """Studies: what each asks, its size, and the time that its reference took.

    With the name of one: what the paper says, and all that can be set.

    \b
    fiv list
    fiv list fig5
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import registry

    catalogue = registry.catalogue()
    for name in [study] if study else registry.names():
        entry = catalogue.get(name, {})
        one = registry.resolve(name) if study or not entry else None
        if one:
            entry = {"title": one.title, "question": one.question, "points": one.sweep({}).grid.size} | entry
        show(f"{one.name if one else name:<10} {entry['title']}")
        if not is_set("quiet"):
            time = f", about {entry['time']} on one core" if "time" in entry else ""
            show(f"{'':<10} {entry['question']}\n{'':<10} {entry['points']} points{time}")
        if one and study:
            show(f"\n{one.statement()}")


@command(
    "status",
    "How far a study is, also while it runs.",
    TARGET,
    click.option("--json", "as_json", is_flag=True, help="As JSON."),
    click.option(
        "--toml", "as_toml", is_flag=True, help="Its configuration, as fiv run --config FILE.toml reads it."
    ),
    OUT,
)
def show_status(target: str, as_json: bool, as_toml: bool, out: str | None) -> None:
    """How far a study is: running, interrupted or complete; from any shell, while it runs.

    \b
    fiv status regimes
    fiv status elsewhere/scenes/scenes.nc --json
    fiv status scenes --toml > scenes.toml && fiv run scenes --config scenes.toml --out again
    """  # noqa: D301 - the backspace tells click to keep the lines
    from dataclasses import asdict
    from json import dumps
    from math import isnan

    from studies import config, results
    from sweeps import status

    file = results.results_file(target, out)
    announce_reference(target, out)
    with results.reading(file):
        if as_toml:
            show(config.toml(config.of_result(results.open_dataset(target, out), str(file))))
            return
        now = status(file)
    values = asdict(now)
    if isnan(values["run"].get("left", 0.0)):
        values["run"]["left"] = None  # JSON has no NaN
    show(dumps(values) if as_json else status_text(now))


@command("query", "Rows of a result as a table, CSV or JSON.", TARGET, *QUERY, kind=completion.SignedCommand)
def query_rows(target: str, out: str | None, columns: str | None, form: str, units: bool, **which: Any) -> None:
    """Rows of a result, whole or still running: chosen, sorted, and printed as a table, CSV or JSON.

    \b
    fiv query regimes --where 'mu > 0.2 and regime == "intermittent"' --sort -velocity_rms --limit 5
    fiv query regimes --where 'regime in ("periodic", "irregular")' --show 'V*1000, mu, regime' --units
    fiv query regimes --by mu --show count,mean:stick_fraction,share:regime
    fiv query fig5 --where 'growth_rate > 0 and mu == 0.2' --show mu,frequency,growth_rate
    fiv query scenes --where 'status == "failed"' --show V,theta,mu,F,error

    EXPR is of comparisons (== != < <= > >= in, also 0.1 < mu < 0.2), and, or, not, + - * / **, brackets, numbers,
    'texts' and names: axes, variables, and the settings of the study. Words such as those of regime and status may
    have spaces or underscores. No comparison is true of a missing value; x == nan finds it, x != nan all others.

    Equality of an axis with a number finds the axis's nearest value, if it is within a thousandth of that value's
    distance from its nearest neighbour, and of an axis with one value within a millionth of it. So theta ==
    5.0000001 finds 5. Where no value is so near, no row matches and a message has the nearest value.

    The points of the sweep are the rows. A variable that has many entries at each point (of modes, runs, in
    time) makes a row of each entry where it is named; entries without a value are left out, unless EXPR has
    nan in it. Without --show the columns are the axes and all that has one value for each row; with it they are
    those, and the axes along which the entries differ.

    With --by the rows that agree in its columns are one group and one row. --show then has count, and mean:X,
    std:X (of a sample), min:X, max:X and median:X of the values that are not missing; share:X is the share of the
    group's rows that have each word, or for which a condition is true. --sort and --limit act on the groups.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import results
    from studies.query.output import print_rows
    from studies.query.query import select

    def note(text: str) -> None:
        say(f"fiv: {text}")

    announce_reference(target, out)
    with results.reading(results.results_file(target, out)):
        chosen = select(results.open_dataset(target, out), show=columns, note=note, **which)
        print_rows(chosen, form, columns is None, units, note, Rows(form))


@command(
    "plot",
    "Draw the figure of a study or map again.",
    TARGET,
    click.option("--out", type=click.Path(), help="Results folder of a STUDY; of a PATH, where the figure goes."),
    click.option(
        "--format",
        "form",
        type=click.Choice(["png", "svg", "pdf"]),
        default="png",
        show_default=True,
        help="Format of the figure; svg and pdf are vector graphics, for print.",
    ),
)
def plot(target: str, out: str | None, form: str) -> None:
    """Draw the figure of a study again from its netCDF file.

    \b
    fiv plot fig5 --format svg
    fiv plot results/map/growth_rate-theta-mu.nc
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import results, runner

    announce_reference(target, out)
    dataset, kept = results.open_dataset(target, out), results.results_file(target, out)
    study, file = results.study_of(dataset, str(kept)), kept
    if out and results.is_path(target):
        file = results.results_folder(out) / file.name
    elif not results.is_path(target) and results.is_reference(file):
        file = results.file_of(study.name, out)
    with results.reading(kept):
        drawn = runner.plot(study, dataset, file, form)
    show(str(drawn))


@command(
    "report",
    "One HTML page of every result.",
    TARGETS,
    OUT,
    click.option(
        "--file", type=click.Path(dir_okay=False), help="The page; default: report.html in the results folder."
    ),
)
def write_report(targets: tuple[str, ...], out: str | None, file: str | None) -> None:
    """One HTML page of every result.

    For each its figure, its numbers beside the paper's, its cost and its points, and of a plane a map to point at.

    \b
    fiv report                              every study and map of the results folder
    fiv report regimes stability            these alone
    fiv report --file shared/results.html   under another name

    The page needs no network and no other file.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import registry
    from studies.report import page

    for target in targets or registry.names():
        announce_reference(target, out)
    show(str(page.write(targets, out, file, lambda line: show(f"fiv: {line}", err=True))))


def announce_reference(target: str, out: str | None) -> None:
    """Print a note where the reference replaces a result that the folder lacks."""
    from studies import results

    if notice := results.notice(target, out):
        say(f"fiv: {notice}")


@command(
    "completion",
    "Print the script that completes names in a shell.",
    click.argument("shell", metavar="|".join(completion.SHELLS), type=click.Choice(completion.SHELLS)),
)
def complete(shell: str) -> None:
    """Print the script by which a shell completes names of studies, axes, quantities and columns.

    \b
    eval "$(fiv completion bash)"             in ~/.bashrc
    eval "$(fiv completion zsh)"              in ~/.zshrc
    fiv completion fish | source              in ~/.config/fish/config.fish
    """  # noqa: D301 - the backspace tells click to keep the lines
    show(completion.script(fiv, shell))
