"""The commands that read results: list, status, query, plot and report. Heavy packages are imported inside."""

from __future__ import annotations

import glob
import json
import sys
import time
from textwrap import indent
from typing import TYPE_CHECKING, Any

import click

from studies.cli.app import command
from studies.cli.options import MOVING, OUT, QUERY, RIGS, TARGET, catalogue, result_names, rig_names, target
from studies.cli.output import FLAGS, columns, rough_duration, say, show, tell

if TYPE_CHECKING:
    from pathlib import Path

    from studies.study import Study
    from sweeps import Status


ONE = target("study", "[STUDY]", required=False)
SCREEN = 100  # rows of a table that need no note


@command("list", "Your results, and the studies with their questions, sizes and times.", ONE, OUT)
def list_studies(study: str | None, out: str | None) -> None:
    """Your results, then the studies with question, size, and time of the reference on one core.

    With the name of one: what the paper says, and all its parameters.

    \b
    fiv list
    fiv list fig5
    """  # noqa: D301 - the backspace tells click to keep the lines
    known, rows, description = catalogue(), list[tuple[str, str]](), ""
    if not study and not FLAGS["quiet"] and (own := _grouped(out)):
        from studies.answering.results import reference_folder, results_folder

        note = "; query, plot and report show their reference" if reference_folder(out).is_dir() else ""
        heads = f"Your results in {results_folder(out)}:", f"Studies{note}:"
        show(f"{heads[0]}\n{own}\n\n{heads[1]}")
    for name in [study] if study else known:
        entry = known.get(name, {})
        if study or not entry:
            one, points = _study(name, out, entry.get("points"))
            name, description = one.name, f"\n\n{one.describe()}" if study else ""
            stated = dict[str, Any](title=one.title, question=one.question, structure=one.takes_structure)
            entry = {**stated, "points": points, **entry}
        lasts = f", {rough_duration(entry['seconds'])}" if "seconds" in entry else ""
        question = [("", entry["question"])] * (entry["question"] != entry["title"])
        takes = "; takes an own structure (--rig)" if entry.get("structure") else ""
        details = [*question, ("", f"{entry['points']} points{lasts}{takes}")]
        rows += [(name, entry["title"]), *([] if FLAGS["quiet"] else details)]
    show(columns(rows) + description)


def _study(name: str, out: str | None, known: int | None) -> tuple[Study, int]:
    """A study, by its name or from a result in the folder, and its number of points."""
    from studies import registry, runner
    from studies.answering import results
    from studies.asking.sweep import sweep_of
    from sweeps import Store

    file = results.results_file(name, out)
    if name in registry.names() or results.is_script(name) or not Store(file).exists():
        return (one := registry.resolve(name)), known or sweep_of(one).grid.size
    dataset = results.open_dataset(file)
    return runner.study_of(dataset, name), dataset["status"].size


ANY = target("target", "[STUDY|PATH]", required=False)
AS_JSON = click.option("--json", "as_json", is_flag=True, help="As JSON.")


@command("status", "Your results; or how far one is.", ANY, AS_JSON, RIGS, OUT)
def show_status(target: str | None, as_json: bool, rig: str | None, out: str | None) -> None:
    """A table of the results folder; or how far one result is, from any shell, while it runs.

    \b
    fiv status
    fiv status elsewhere/scenes/scenes.nc --json
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import registry
    from studies.answering import results
    from sweeps import status

    out = _place(rig, out, target)
    if target is not None:
        with results.damage_as_error(file := _file(target, out)):
            now = status(file)
        run = {k: None if value != value else value for k, value in now.run.items()}  # JSON has no NaN
        show(json.dumps(vars(now) | {"run": run}) if as_json else _status_text(now))
        return
    rows = _rows(out)
    rows += [
        {"rig": name, **row} for name in rig_names(out) for row in _rows(str(results.results_folder(out) / name))
    ]
    command = results.command("run", registry.names_for("first")[0], out)
    begin = f"{results.results_folder(out)} has no results; begin with: {command}"
    show(json.dumps(rows) if as_json else _grouped(out) or begin)


def _table(rows: list[dict[str, str]]) -> str:
    return columns([tuple(rows[0]), *(tuple(row.values()) for row in rows)]) if rows else ""


def _grouped(out: str | None) -> str:
    """The results of the folder, then those of each rig below its name and numbers; "" if there are none."""
    parts = [_table(_rows(out))] if result_names(out) else []
    for name in rig_names(out):
        from studies.answering.results import results_folder
        from studies.asking import rigs

        table = _table(_rows(str(results_folder(out) / name))) or "no results yet"
        parts.append(f"rig {name}: {rigs.title(name, out)}\n{indent(table, '  ')}")
    return "\n\n".join(part for part in parts if part)


def _rows(out: str | None) -> list[dict[str, str]]:
    """The results of the folder, the newest first."""
    from studies.answering import results

    every = results.stored(out)
    names = [glob.escape(file.name) for file in every]
    ours = [(name, f"{name}.*parts", f"{name}.*parts/*") for name in names]
    there = [
        [path for each in own for path in file.parent.glob(each)] for file, own in zip(every, ours, strict=True)
    ]
    ages = [max(path.stat().st_mtime for path in paths) for paths in there]
    sizes = [sum(path.stat().st_size for path in paths if path.is_file()) for paths in there]
    rows = sorted(zip(ages, every, sizes, strict=True), reverse=True)
    return [_row(file, size, date) for date, file, size in rows]


def _row(file: Path, size: float, date: float) -> dict[str, str]:
    """The row of a result in the table of the results folder; an unfinished one counts computations."""
    from datetime import datetime

    import sweeps
    from studies.answering.results import FITS, MAPS

    kind = "map" if file.parent.name == MAPS else "study" if file.stem in catalogue() else "own study"
    kind = "fit" if file.parent.parent.name == FITS else kind
    try:
        now = sweeps.status(file)
        done, state = now.done + now.failed + now.interpolated, now.state
        points = f"{done} of {done + now.pending}" if now.pending else f"{now.points}"
        state += f", {now.failed} failed" if now.failed else ""
    except (ValueError, OSError, RuntimeError):
        points, state = "-", "unreadable"
    age = rough_duration(max(1.0, time.time() - date)).removeprefix("about ")
    row = {"name": file.stem, "kind": kind, "points": points, "state": state, "size": sweeps.size(size)}
    return row | {"date": f"{datetime.fromtimestamp(date):%d %b %Y, %H:%M}", "age": age}


def _status_text(status: Status) -> str:
    """A status as lines."""
    from sweeps import duration

    rows = {name: str(value) for name, value in vars(status).items() if name != "run"}
    if (distinct := status.done + status.failed + status.pending + status.interpolated) < status.points:
        rows["points"] += f", {distinct} of them distinct and not skipped"
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
def query(target: str, rig: str | None, out: str | None, form: str, units: bool, **which: Any) -> None:
    """Rows of a result, whole or still running: chosen, sorted, and printed as a table, CSV or JSON.

    \b
    fiv query regimes --where 'mu > 0.2 and regime == "stuck"' --sort -V --limit 5
    fiv query regimes --by mu --show count,mean:stick_fraction,share:regime
    fiv query scenes --where 'status == "failed"' --show V,theta,mu,F,error

    EXPR is of comparisons (also 0.1 < mu < 0.2, and in), and, or, not, + - * / **, brackets, numbers, 'words' and
    names: axes, variables and fixed parameters, in SI, theta in degrees. Missing values never match; find them by
    x == nan. == on an axis tolerates rounding.

    There is one row for each computed point. If you name a variable with several values at a point (modes, times),
    there is one row for each value. --by merges rows with equal values in its columns; --show then takes count,
    and mean:X, std:X, min:X, max:X, median:X of the values that are not missing. share:X is the fraction of rows
    with each word, or for which a condition is true.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies.answering import results
    from studies.motion import mixed
    from studies.query import query as rows

    file = _file(target, _place(rig, out, target))
    with results.damage_as_error(file):
        dataset = results.open_dataset(file)
        frame = rows.select(dataset, note=lambda line: say(f"fiv: {line}"), **which)
        text = rows.text(frame, form, units)
        lines = [] if {"motion", "member"} & {*frame} else [*mixed.told(dataset, 0)]
    show(text, end="", raw=form != "table" and not sys.stdout.isatty())
    for line in lines:
        say(f"fiv: {line}")
    if form == "table" and len(frame) > SCREEN and which["limit"] is None:
        say(f"fiv: {len(frame)} rows; --limit N prints fewer, --where chooses")


FORMS = click.Choice(["png", "svg", "pdf"])
PLACE = click.option("--out", type=click.Path(), help="Results folder of a STUDY; of a PATH, place of the figure.")
FORM = click.option("--format", "form", type=FORMS, default="png", show_default=True, help="svg, pdf: for print.")


LOOK = (
    click.option("--width", metavar="LENGTH", help="Width of a column of a journal: 88mm; default: 180mm."),
    click.option(
        "--title/--no-title",
        default=True,
        help="Leave out the title and the settings below the figure; both are printed.",
    ),
    click.option("--font", metavar="FONT", help="A family of fonts, or a .ttf file."),
    click.option(
        "--style", "sheet", metavar="STYLE", help="A style sheet of Matplotlib, after your matplotlibrc."
    ),
)
DRAWN = "Draw the figure of a result again, or show it moving."


@command("plot", DRAWN, TARGET, RIGS, PLACE, FORM, *LOOK, *MOVING)
def plot(
    target: str, rig: str | None, out: str | None, form: str, film: str | None, vtu: bool, **look: Any
) -> None:
    """Draw the figure of a result again; or what moves in it, as a film or as a series for ParaView.

    \b
    fiv plot fig5 --format svg
    fiv plot elsewhere/fig5/fig5.nc --out figures
    fiv plot fig5 --format pdf --width 88mm --no-title --font "DejaVu Serif"
    fiv plot fig6 --animate          a GIF of the unstable mode
    fiv plot fig6 --vtu              fig6.pvd, which ParaView opens and plays

    Your matplotlibrc counts. Fonts are embedded, and text stays text.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import runner
    from studies.answering import results, summary

    out = out if results.is_path(target) and rig is None else _place(rig, out, target)
    file = beside = _file(target, out)
    if results.is_path(target):
        beside = results.results_folder(out) / file.name if out else file
    elif results.is_reference(file):
        beside = results.file_of(file.stem, out)
    with results.damage_as_error(file):
        dataset = results.open_dataset(file)
        study = runner.study_of(dataset, str(file))
        if film or vtu:
            if not (moving := runner.moving_of(study, dataset)):
                raise click.UsageError(runner.nothing_moves(study))
            figures = runner.animate(moving, beside, film, vtu)
        else:
            figures = runner.plot(study, dataset, beside, form, **look)
    show("\n".join(map(str, figures)))
    if not look["title"]:
        say(f"fiv: for the caption: {study.title}; {summary.was_set(study, dataset)}")


TARGETS = target("targets", "[STUDY|PATH]...", nargs=-1)
PAGE = click.option(
    "--file", type=click.Path(dir_okay=False), help="The page; default: report.html in that folder."
)


WATCH = click.option("--watch", is_flag=True, help="Serve the page to this machine while results change.")


@command("report", "One HTML page of every result.", TARGETS, RIGS, OUT, PAGE, WATCH)
def report(targets: tuple[str, ...], rig: str | None, out: str | None, file: str | None, watch: bool) -> None:
    """One HTML page of every result: figures, numbers beside the paper's, costs, points, maps to point at.

    \b
    fiv report                       all studies, maps and rigs of a folder
    fiv report --rig mine            those of one rig
    fiv report regimes stability     these alone
    fiv report --watch               served on this machine while runs go on

    The page needs no network and no other file.
    """  # noqa: D301 - the backspace tells click to keep the lines
    out = out if rig is None else _place(rig, out)
    if watch:
        from studies.report.watch import watch as serve

        serve(targets, out, file, tell, show)
    from studies.report import page

    show(str(page.write(targets, out, file, tell)))


def _place(rig: str | None, out: str | None, target: str | None = None) -> str | None:
    """The results folder to read, or that of a rig; one that is named must exist."""
    from studies.answering.results import existing, is_script
    from studies.asking import rigs

    study = target if target and (target in catalogue() or is_script(target)) and not rig else ""
    folder = rigs.place(rig, existing(out, study))
    return None if folder is None else str(folder)


def _file(target: str, out: str | None) -> Path:
    """The file of the result that STUDY|PATH names, with a note if it is the reference's."""
    from studies import registry
    from studies.answering import results
    from studies.declaring.parameters import suggest
    from sweeps import MissingFileError, Store

    name = registry.resolve(target).name if results.is_script(target) else target
    file = results.results_file(name, out)
    if not results.is_path(target) and not Store(file).exists():
        names = [path.stem for path in results.stored(out)]
        folder = results.results_folder(out).resolve()
        found = f"{folder} has results of {', '.join(names)}" if names else f"{folder} is empty"
        found = found if folder.is_dir() else f"the folder {folder} does not exist; name another one with --out"
        if name in registry.names() or results.is_script(target):
            raise MissingFileError(
                f"no result {name!r}; {found}; compute it with: {results.command('run', target, out)}"
            )
        raise MissingFileError(f"no result {name!r}; {suggest(name, [*names, *registry.names()])}{found}")
    if notice := results.notice(name, out):
        say(f"fiv: {notice}")
    return file
