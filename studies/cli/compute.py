"""The commands that compute: plan, run, map and check. Heavy packages are imported inside them."""

from __future__ import annotations

import re
import shlex
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from studies.cli.app import Command, command, warned
from studies.cli.execution import estimated, execute, timed, typed_command, with_axes
from studies.cli.measure import DRAWN, SIGNAL, beside
from studies.cli.options import HOW, MAP, POINTS, STUDY
from studies.cli.output import columns, say, show
from studies.cli.progress import announce_compiling

if TYPE_CHECKING:
    from studies.asking.request import Request
    from studies.study import Study
    from sweeps import Plan

# Letters of the name of a folder that is offered; options that change nothing in a result.
LONGEST, SHOWING = 60, ("--fresh", "--yes", "-q", "--quiet", "-v", "--verbose", "--retry-failed", "--fail-fast")
TIME = click.option("--time", "measured", is_flag=True, help="Compute a few points, to estimate the time of all.")


@command("plan", "Dry run: what a run would compute and cost.", STUDY, *POINTS, TIME)
def plan(study: str, measured: bool, **points: Any) -> None:
    """Dry run: what a run would compute, store and cost. Writes nothing, and without --time computes nothing.

    \b
    fiv plan scenes --set V=log:1e-3:1e-2:10 --record velocity_B
    """  # noqa: D301 - the backspace tells click to keep the lines
    one, planned, _, lines = _planned(study, points, False)
    show(with_axes(one, planned, repr(timed(planned)) if measured else estimated(one, planned)[1]))
    say(*lines)


@command("run", "Compute a study, store it, draw it, print its numbers.", STUDY, *POINTS, *HOW, DRAWN, *SIGNAL)
def run(study: str, fail_fast: bool, yes: bool, share: str | None, **points: Any) -> None:
    """Compute a study, store it as netCDF, draw its figure, and print its numbers beside the paper's.

    \b
    fiv run fig5
    fiv run fig5 --set theta=8 --set p1_length=60mm --out elsewhere
    fiv run fig5 --rig mine                       a rig with a name (fiv rig)
    fiv run scenes --set V=1,2mm/s --record velocity_B --sample-rate 50e3
    fiv run robust --scatter p1_thickness=uniform:1.4:1.6mm --samples 256
    fiv run fig5 --points rigs.csv --out rigs
    fiv run other/fig5/fig5.nc                    the same as that result

    Points that the results folder holds are not computed again. Ctrl-C finishes the points under way and stores
    them; the same command then computes the missing points.
    """  # noqa: D301 - the backspace tells click to keep the lines
    announce_compiling()
    file, signal = points.pop("measured"), {name: points.pop(name) for name in ("unit", "rate", "channel")}
    with _offering(points["assignments"], points["rig"], points["out"]):
        one, planned, request, lines = _planned(study, points, True)
    one = beside(one, file, **signal)
    execute(one, _shared(planned, share), (request.scheduler, request.workers), fail_fast, yes, lines)


@contextmanager
def _offering(assignments: Sequence[str], rig: str | None, out: str | None) -> Iterator[None]:
    """Add to the error of a refused results folder a command that keeps both results.

    It uses a named rig or another folder, which is named after the requested values.
    """
    from studies.asking import rigs
    from studies.declaring.parameters import RIG
    from sweeps import LockedError, StoreError

    try:
        yield
    except LockedError:
        raise
    except StoreError as problem:
        if "has other" not in str(problem):
            raise
        own = [text for text in assignments if text.partition("=")[0].strip() in RIG]
        if rigs.is_name(rig) and rig is not None:
            raise
        if (own or rig) and not any({*":,"} & {*text} for text in own):
            own += [text for text in assignments if text.startswith("theta=") and not {*":,"} & {*text}]
            file = [] if rig is None else [rig]
            called = rigs.free("-".join([*(Path(each).stem for each in file), *own]).replace("=", "-"), out)
            place = ["--out", out] if out else []
            sets = [word for text in own for word in ("--set", text)]
            make = shlex.join(["fiv", "rig", called, *file, *sets, *place])
            raise StoreError(f"{problem}; keep both: {make} && {_with_rig(called, own)}") from None
        name = re.sub(r"[^\w.,+-]", "_", "-".join(text.replace("=", "-", 1) for text in assignments))[:LONGEST]
        if not (out or rig or assignments):
            raise StoreError(f"{problem}; keep both: {typed_command('--fresh')} --rig {rigs.PAPER}") from None
        if out or not name:
            raise
        raise StoreError(f"{problem}; for example: {typed_command('--fresh')} --out {name}") from None


def _with_rig(name: str, own: Sequence[str]) -> str:
    """The command of this process, with a named rig in place of its numbers or of its file."""
    words, left = list[str](), iter(shlex.split(typed_command("--fresh")))
    for word in left:
        option, equals, value = word.partition("=")
        if option in ("--set", "--rig"):
            value = value if equals else next(left)
            if option == "--set" and value not in own:
                words += ["--set", value]
        else:
            words.append(word)
    return shlex.join([*words, "--rig", name])


def _values(standard_error: float | None, options: dict[str, Sequence[str]]) -> dict[str, Any]:
    """Values of parameters from options with NAME=SPEC."""
    from studies.asking.request import assignment
    from sweeps import InputError

    values: dict[str, Any] = {} if standard_error is None else {"standard_error": standard_error}
    for option, text in [(option, text) for option, texts in options.items() for text in texts]:
        name, value = assignment(text, option)
        if name in values:
            raise InputError(f"{option} {text!r}: {name} is set already; give all its values at once")
        if option == "--scatter" and ":" not in value:
            raise InputError(f"{option} {text!r}: it must be NAME=DIST, for example mu=normal:0.2:0.02")
        values[name] = value
    return values


def _planned(study: str, options: dict[str, Any], writing: bool) -> tuple[Study, Plan, Request, list[str]]:
    """Study, plan, request and warnings. Options override a file, and a file overrides a result given as STUDY."""
    from fivcore import Structure
    from studies import registry, runner
    from studies.answering import results
    from studies.asking import request, rigs
    from sweeps import InputError, Store, StoreError, check_free

    assigned = {"--set": options.pop("assignments"), "--scatter": options.pop("scatter")}
    values = _values(options.pop("standard_error"), assigned)
    config, rig, record, out = (options.pop(name) for name in ("config", "rig", "record", "out"))
    how = {name: options.pop(name) for name in ("fresh", "adopt", "retry_failed", "strict")}
    names = () if record is None else tuple(name.strip() for name in record.split(","))
    wanted = request.Request(
        values=values, record=names, command=typed_command(*SHOWING) if writing else "", **options
    )
    own, out = rigs.found(rig, out)
    if config is not None:
        wanted = wanted.over(request.read(config, "--config"))
    name, file, source = study, None, None
    if study not in registry.names() and Store(stored := results.results_file(study, out)).exists():
        study = str(stored)
    if results.is_path(study):
        inside = own is None or results.results_file(study).resolve().is_relative_to(own.folder.resolve())
        if own is not None and own.name and not inside:
            advice = f"give the name of a study, such as fiv run {registry.names_for('first')[0]} --rig {own.name}"
            raise InputError(f"{study}: it has its own rig; leave out --rig, or {advice}")
        with results.damage_as_error(results.results_file(study)):
            source = request.of_result(results.open_dataset(study), study)
        name = source.study
        if Path(study).parent.name == results.MAPS:
            file = results.results_folder(out) / results.MAPS / Path(study).name
    one = registry.resolve(name)
    if own is not None:
        wanted = replace(wanted, rig=own.name) if source and own.name else rigs.applied(own, wanted, one)
    if source is not None:
        if wanted.structure and not source.structure:
            advice = f"give a STUDY with --rig, such as fiv run {source.study} --rig {rig or config}"
            raise InputError(f"{study}: it is a result of the paper's beams; {advice}")
        wanted = wanted.over(source)
    if wanted.study not in ("", one.name, study):
        raise InputError(f"{config or rig}: study = {wanted.study!r}: STUDY is {one.name}; leave one out")
    if writing:
        check_free(file or results.file_of(one.name, out))
    lines = [f"rig             {Structure.from_dict(wanted.structure)!r}"] if wanted.structure else []
    lines = [f"rig             {own.name}: {own.title}"] if own is not None and own.name else lines
    try:
        with warned(lines.append):
            planned = runner.plan(one, wanted, out, file=file, **how)
    except StoreError:
        say(*lines)  # an unusual value may be why the folder has other results
        raise
    return one, planned, wanted, lines


def _shared(planned: Plan, share: str | None) -> Plan:
    """One share of a plan, as `--share K/N` requests it."""
    from sweeps import InputError

    if share is None:
        return planned
    numbers = re.fullmatch(r"(\d+)/(\d+)", share)
    if not numbers or not 1 <= int(numbers[1]) <= int(numbers[2]):
        raise InputError(f"--share {share!r}: it must be K/N with K from 1 to N, for example 3/16")
    return planned.share(int(numbers[1]), int(numbers[2]))


def planned_again(file: Path | str, out: str | None, rig: str | None = None) -> tuple[Study, Plan]:
    """The study of a result, finished or not, or one by its name, and its plan in a results folder."""
    options: dict[str, Any] = dict.fromkeys(("standard_error", "config", "record")) | {"rig": rig}
    options |= dict.fromkeys(("fresh", "adopt", "retry_failed", "strict"), False)
    return _planned(str(file), {**options, "assignments": (), "scatter": (), "out": out}, True)[:2]


class MapCommand(Command):
    """The command `map`, whose help ends with names that are slow to import."""

    def format_epilog(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the quantities and parameters, with their units."""
        from studies import registry

        for head, kind in (("Quantities", "outputs"), ("Parameters", "parameters")):
            units = {k: v.units for study in registry.maps().values() for k, v in getattr(study, kind).items()}
            texts = [name if unit == "1" else f"{name} [{unit}]" for name, unit in units.items()]
            with formatter.section(head):
                formatter.write_text(", ".join(texts))


@command("map", "Quantities over two parameters, or along one, stored and drawn.", *MAP, *HOW, kind=MapCommand)
def draw_map(quantities: tuple[str, ...], fail_fast: bool, yes: bool, share: str | None, **options: Any) -> None:
    """Map quantities over any two parameters, or along one; store all that is computed, and draw them.

    \b
    fiv map --x theta=-10:20:9 --y mu=0:0.5:9 --quantity growth_rate --refine 3
    fiv map --x V=log:2e-4:1e-2:9 --y mu=0:0.4:9 --quantity regime --fix theta=8
    fiv map --x theta=0:20:61 --quantity probability_unstable \\
        --scatter p1_length=normal:50:0.1mm

    With --refine the SPECs give a coarse lattice, whose intervals are halved where the map changes.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies import runner

    announce_compiling()
    assigned = {"--fix": options.pop("fixed"), "--scatter": options.pop("scatter")}
    names, fix, lines = ",".join(quantities), _values(options.pop("standard_error"), assigned), list[str]()
    how = options.pop("scheduler"), options.pop("workers")
    with warned(lines.append):
        one, planned = runner.plan_map(quantities=names, fix=fix, command=typed_command(*SHOWING), **options)
    execute(one, _shared(planned, share), how, fail_fast, yes, lines)


@command("check", "Whether the installation computes, stores and draws as it should.")
def check() -> None:
    """Checks of what the installation computes, stores and draws: a minute at first, most of it to compile."""
    from studies.cli import installation

    show(installation.machine())
    announce_compiling()
    with tempfile.TemporaryDirectory() as folder:
        rows = list(installation.checks(Path(folder)))
    show(columns([(*texts, "ok" if passed else "FAILED") for *texts, passed in rows]))
    failed = sum(not passed for *_, passed in rows)
    show(f"{failed} of {len(rows)} failed; install into an empty environment" if failed else "all is well")
    sys.exit(1 if failed else 0)
