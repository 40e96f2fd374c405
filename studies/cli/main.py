"""Entry point of the command line: exit codes and error messages of one line."""

from __future__ import annotations

import os
import re
import sys

try:
    from contextlib import suppress
    from io import TextIOWrapper
    from traceback import format_exception
    from typing import NoReturn

    import click
    from click.shell_completion import shell_complete

    from studies.cli import compute, fit, measure, read, rig, shares, structure  # noqa: F401 - they add their commands
    from studies.cli.app import fiv
    from studies.cli.options import catalogue
    from studies.cli.output import FLAGS, show, tell
except KeyboardInterrupt:
    # In the first tenth of a second, before anything else can say so.
    os.write(2, b"fiv: interrupted\n")
    sys.exit(130)

# Exit codes of errors of our packages, by their names: those packages are slow to import.
CODES = {"InputError": 2, "UnsolvedError": 2, "StoreError": 3, "ClusterLostError": 3, "SweepStoppedError": 1}
INTERNAL = 70
# Arguments with which a message begins, and that are options here.
OPTIONS = r"(x|y|fix|scatter|quantity|channel|unit|rate)(?= [\w,]+:)|"
OPTIONS += r"(points|samples|seed|workers|tolerance|channel|unit|rate)(?: =)"


def main() -> NoReturn:
    """Entry point."""
    _open_streams()
    FLAGS.update(quiet=False, verbose=False)
    try:
        if instruction := os.environ.get("_FIV_COMPLETE"):
            sys.exit(shell_complete(fiv, {}, "fiv", "_FIV_COMPLETE", instruction))
        for text in (*sys.argv[1:], os.environ.get("FIV_RESULTS", "")):
            if text.encode(errors="replace").decode() != text:
                raise click.UsageError(f"{text}: it is no text in this system's encoding; rename it")
        with fiv.make_context("fiv", sys.argv[1:]) as context:
            fiv.invoke(context)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except (click.Abort, KeyboardInterrupt, EOFError):
        tell("interrupted")
        sys.exit(130)
    except Exception as problem:  # noqa: BLE001 - each has its exit code
        sys.exit(_code_of(problem))
    sys.exit(0)


def _open_streams() -> None:
    """Let standard streams accept any text, and open closed ones, whose numbers a file would otherwise get."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r+", encoding="utf-8"))  # noqa: SIM115 - until the end
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def unfit() -> str:
    """Installed libraries whose versions fiv does not support, in a line; "" if there are none."""
    from importlib.metadata import PackageNotFoundError, requires, version

    lines, needed = list[str](), list[str]()
    with suppress(PackageNotFoundError):  # a folder of sources on the path
        needed = [each for each in requires("fiv") or () if "extra ==" not in each]
    for each in needed:
        name, limits = re.split(r"(?=[^\w.-])", each, maxsplit=1)
        try:
            here = version(name)
        except PackageNotFoundError:
            lines.append(f"{name} is missing")
            continue
        for sign, limit in re.findall(r"(>=|<)\s*([\w.]+)", limits):
            found, bound = ([int(number) for number in re.findall(r"\d+", text)] for text in (here, limit))
            if sign == ">=" and found < bound:
                lines.append(f"{name} {here} is too old: fiv needs {limit} or newer")
            elif sign == "<" and found >= bound:
                lines.append(f"{name} {here} is too new: fiv needs one below {limit}")
    return f"{'; '.join(lines)}; install into another environment" if lines else ""


def in_options(text: str) -> str:
    """A message in which the names of Python arguments are replaced by options."""
    text = re.sub(r"\b(fresh|strict|retry_failed|fail_fast)=True\b", lambda m: f"--{m[1].replace('_', '-')}", text)
    text = text.replace("as rig=...", "as --rig NAME").replace("leave strict out", "leave --strict out")
    text = re.sub(r"\brig='?([\w-]+)'?", r"--rig \1", text)
    text = re.sub(r"\b(out|adopt)=(?:\.{3}|(?=[\w'\"]))", r"--\1 ", text).replace("--out )", "--out)")
    text = text.replace("with studies.run", "with fiv run").replace("another path", "another folder (--out)")
    text = re.sub(r"^x or y(?= ')", "--x or --y", text)
    return re.sub(f"^(?:{OPTIONS})", lambda m: f"--{m[1] or m[2]}", text)


def _code_of(problem: Exception) -> int:
    """Print an error in one line, or with its traceback if it is a bug of fiv; return its exit code."""
    names = {kind.__name__ for kind in type(problem).__mro__ if kind.__module__.startswith(("fivcore", "sweeps"))}
    code, text = next((CODES[name] for name in CODES if name in names), INTERNAL), str(problem)
    if isinstance(problem, click.ClickException):
        code, text = 2, problem.format_message()
        if name := text.partition("No such command '")[2].partition("'")[0]:
            study = name in catalogue() or name.endswith((".py", ".nc"))
            text = f"{name} is no command; write: fiv run {name}" if study else f"{text} All of them: fiv --help"
            if name == "help" and sys.argv[2:]:
                text += f"; the options of one: fiv {sys.argv[2]} --help"
        if text == "Missing argument 'STUDY'.":
            text = "STUDY is missing: give a study that fiv list names, or your own file"
        if "extra argument" in text and "=" in text:
            text += "; a value needs --set before it, or --fix for a map"
    elif isinstance(problem, MemoryError):
        code, text = 2, f"out of memory: {str(problem) or 'nothing more could be allocated'}; take fewer values"
    elif isinstance(problem, RecursionError):
        code, text = 2, "something is nested too deeply; -v shows where"
    elif isinstance(problem, OSError) and code == INTERNAL and problem.filename is not None:
        code, text = 3, f"{problem.filename}: {problem.strerror}"
    elif code == INTERNAL and (wrong := unfit()):
        code, text = 2, wrong
    elif code != INTERNAL:
        text = in_options(text)
    else:
        text = f"internal error: {type(problem).__name__}; please report it with the lines above"
    if code == INTERNAL or (FLAGS["verbose"] and not isinstance(problem, click.ClickException)):
        show("".join(format_exception(problem)).rstrip("\n"), err=True)
    tell(text)
    return code
