"""The commands that read results: list, status, query, plot and report. Heavy packages are imported inside."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

import click

from studies.cli.app import command
from studies.cli.options import OUT, QUERY, TARGET, catalogue, target
from studies.cli.output import FLAGS, about, columns, say, show, tell

if TYPE_CHECKING:
    from pathlib import Path

    from sweeps import Status


@command("list", "Studies: what each asks, its size and its time.", target("study", "[STUDY]", required=False))
def list_studies(study: str | None) -> None:
    """Studies: what each asks, its size, and the time that its reference took on one core.

    With the name of one: what the paper says, and all its parameters.

    \b
    fiv list
    fiv list fig5
    """  # noqa: D301 - the backspace tells click to keep the lines
    known, rows, description = catalogue(), list[tuple[str, str]](), ""
    for name in [study] if study else known:
        entry = known.get(name, {})
        if study or not entry:
            from studies import registry

            one = registry.resolve(name)
            name, description = one.name, f"\n\n{one.describe()}" if study else ""
            entry = {"title": one.title, "question": one.question, "points": one.sweep({}).grid.size} | entry
        time = f", {about(entry['seconds'])}" if "seconds" in entry else ""
        details = [("", entry["question"]), ("", f"{entry['points']} points{time}")]
        rows += [(name, entry["title"]), *([] if FLAGS["quiet"] else details)]
    show(columns(rows) + description)


ANY = target("target", "[STUDY|PATH]", required=False)
AS_JSON = click.option("--json", "as_json", is_flag=True, help="As JSON.")


@command("status", "Your results; or how far one is.", ANY, AS_JSON, OUT)
def show_status(target: str | None, as_json: bool, out: str | None) -> None:
    """A table of the results folder; or how far one result is, from any shell, while it runs.

    \b
    fiv status
    fiv status elsewhere/scenes/scenes.nc --json
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import results
    from sweeps import status

    if target is not None:
        with results.reading(file := _file(target, out)):
            now = status(file)
        run = {k: None if value != value else value for k, value in now.run.items()}  # JSON has no NaN
        show(json.dumps(vars(now) | {"run": run}) if as_json else _status_text(now))
        return
    rows = [_row(file) for file in results.stored(out)]
    table = columns([tuple(rows[0]), *(tuple(row.values()) for row in rows)]) if rows else ""
    begin = f"{results.results_folder(out)} has no result; begin with: {results.command('run', 'fig5', out)}"
    show(json.dumps(rows) if as_json else table or begin)


def _row(file: Path) -> dict[str, str]:
    """A result in the table of the results folder."""
    from datetime import datetime

    from studies.results import MAPS
    from sweeps import status

    times = [path.stat().st_mtime for path in (file, file.with_name(f"{file.name}.parts")) if path.exists()]
    row = {"name": file.stem, "kind": "map" if file.parent.name == MAPS else "study", "points": "-"}
    try:
        now = status(file)
        done, state = now.points - now.pending, now.state
        row["points"] = f"{now.points}" if not now.pending else f"{done} of {now.points}"
    except (ValueError, OSError, RuntimeError):
        state = "unreadable"
    return row | {"state": state, "date": f"{datetime.fromtimestamp(max(times)):%d %b %Y, %H:%M}"}


def _status_text(status: Status) -> str:
    """A status as lines."""
    from sweeps import duration

    rows = {name: str(value) for name, value in vars(status).items() if name != "run"}
    if status.state == "incomplete":
        rows["pending"] += ", which no run has requested"
    run = status.run
    if "pid" in run:
        rows["run by"] = f"process {run['pid']} on {run['host']}, begun {run.get('started', 'just now')}"
    if "todo" in run:
        rows["this run"] = f"{run['done']} of {run['todo']} computations"
        rows["this run"] += f", {run['rate']:.3g} a second" if run["rate"] else ""
        if run["left"] == run["left"]:
            rows["time left"] = duration(run["left"])
        rows["now"] = "; ".join(run["now"])
    return columns([*rows.items()])


@command("query", "Rows of a result as a table, CSV or JSON.", TARGET, *QUERY)
def query(target: str, out: str | None, form: str, units: bool, **which: Any) -> None:
    """Rows of a result, whole or still running: chosen, sorted, and printed as a table, CSV or JSON.

    \b
    fiv query regimes --where 'mu > 0.2 and regime == "intermittent"' --sort -velocity_rms --limit 5
    fiv query regimes --by mu --show count,mean:stick_fraction,share:regime
    fiv query scenes --where 'status == "failed"' --show V,theta,mu,F,error

    EXPR is of comparisons (also 0.1 < mu < 0.2, and in), and, or, not, + - * / **, brackets, numbers, 'words' and
    names: axes, variables and fixed parameters, in SI, theta in degrees. No comparison is true of a missing value;
    x == nan finds it. Equality finds the nearest value of an axis, within a thousandth of its spacing.

    The points are the rows, or the entries of a variable that is named and has many at a point (modes, times).
    With --by rows that agree in its columns are one. --show then has count, and mean:X, std:X, min:X, max:X,
    median:X of the values that are not missing; share:X is the share of rows with each word, or of a condition.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import results
    from studies.query import query as rows

    file = _file(target, out)
    with results.reading(file):
        frame = rows.select(results.open_dataset(file), note=lambda line: say(f"fiv: {line}"), **which)
        text = rows.text(frame, form, units)
    show(text, end="", raw=form != "table" and not sys.stdout.isatty())


FORMS = click.Choice(["png", "svg", "pdf"])
PLACE = click.option("--out", type=click.Path(), help="Results folder of a STUDY; of a PATH, place of the figure.")
FORM = click.option("--format", "form", type=FORMS, default="png", show_default=True, help="svg, pdf: for print.")


@command("plot", "Draw the figure of a result again.", TARGET, PLACE, FORM)
def plot(target: str, out: str | None, form: str) -> None:
    """Draw the figure of a result again.

    \b
    fiv plot fig5 --format svg
    fiv plot elsewhere/fig5/fig5.nc --out figures
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import results, runner

    file = beside = _file(target, out)
    if results.is_path(target):
        beside = results.results_folder(out) / file.name if out else file
    elif results.is_reference(file):
        beside = results.file_of(file.stem, out)
    with results.reading(file):
        dataset = results.open_dataset(file)
        figures = runner.plot(runner.study_of(dataset, str(file)), dataset, beside, form)
    show("\n".join(map(str, figures)))


TARGETS = target("targets", "[STUDY|PATH]...", nargs=-1)
PAGE = click.option(
    "--file", type=click.Path(dir_okay=False), help="The page; default: report.html in that folder."
)


WATCH = click.option("--watch", is_flag=True, help="Serve the page to this machine while results change.")


@command("report", "One HTML page of every result.", TARGETS, OUT, PAGE, WATCH)
def report(targets: tuple[str, ...], out: str | None, file: str | None, watch: bool) -> None:
    """One HTML page of every result: figures, numbers beside the paper's, costs, points, maps to point at.

    \b
    fiv report                              every study and map of the results folder
    fiv report regimes stability            these alone
    fiv report --watch                      the same, in a browser on this machine, while runs go on; until Ctrl-C

    The page needs no network and no other file.
    """  # noqa: D301 - the backspace tells click to keep the lines
    if watch:
        from studies.report.watch import watch as serve

        serve(targets, out, file, tell, show)
    from studies.report import page

    show(str(page.write(targets, out, file, tell)))


def _file(target: str, out: str | None) -> Path:
    """The file of the result that STUDY|PATH names, with a note where it is the reference's."""
    from studies import registry, results
    from studies.parameters import suggest
    from sweeps import MissingFileError, Store

    name = registry.resolve(target).name if results.is_script(target) else target
    file = results.results_file(name, out)
    if not results.is_path(target) and not Store(file).exists():
        names = [path.stem for path in results.stored(out)]
        has = f"{results.results_folder(out).resolve()} has {', '.join(names) or 'no result'}"
        if name in registry.names() or results.is_script(target):
            raise MissingFileError(
                f"no result {name!r}; {has}; compute it with: {results.command('run', target, out)}"
            )
        raise MissingFileError(f"no result {name!r}; {suggest(name, [*names, *registry.names()])}{has}")
    if notice := results.notice(name, out):
        say(f"fiv: {notice}")
    return file
