"""The one way out of the program: what it says and prints holds nothing that a terminal would obey.

Texts may be those of files, of other machines, and of whatever a library raises. Nothing heavy is imported.
"""

from __future__ import annotations

import io
import logging
import os
import re
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from traceback import extract_tb
from typing import Any

import click

# Controls but \n and \t, what ends a line or turns its direction round elsewhere, and halves of surrogate pairs.
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
# A hook's default argument: when the interpreter ends, the names of modules are gone before the hooks are.
_ENDS = sys.is_finalizing


def harmless(text: str) -> str:
    r"""The text with \x1b in place of an escape, and so on; \r\n, the end of a line, becomes \n."""
    return OBEYED.sub(_escaped, text.replace("\r\n", "\n"))


def _escaped(found: re.Match[str]) -> str:
    # JSON and TOML, which escape the others themselves, know this one of DEL.
    code = ord(found[0])
    return f"\\x{code:02x}" if code < 0x7F else f"\\u{code:04x}"


def show(text: str, err: bool = False, mark: str = "") -> None:
    """Print a text and the end of its line, to standard output or to standard error; at once.

    What standard error does not take is lost: there is nobody to tell. `mark` is a word of ours behind the text,
    in colour on a terminal.
    """
    stream = sys.stderr if err else sys.stdout
    mark = mark if mark and stream.isatty() else click.unstyle(mark)
    with suppress(OSError) if err else nullcontext():
        print(harmless(text) + mark, file=stream, flush=True)


def tell(text: str) -> None:
    r"""Print one line about what is done, to standard error; the end of a line within it is written as \n."""
    show("fiv: " + text.replace("\r\n", "\n").replace("\n", "\\n"), err=True)


class Rows:
    """Standard output as a file for rows: a pipe or a file gets data as they are, a terminal what is harmless.

    Attributes
    ----------
    as_they_are : bool
        Whether they are for programs: a table is for readers, wherever it goes.
    """

    def __init__(self, form: str) -> None:
        self.as_they_are = form != "table" and not sys.stdout.isatty()

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return sys.stdout.isatty()

    def write(self, text: str) -> int:
        """Print a text."""
        return sys.stdout.write(text if self.as_they_are else harmless(text))


@contextmanager
def streams() -> Iterator[None]:
    """`report_here`, with hooks and warnings as they were at the end."""
    hooks = threading.excepthook, sys.unraisablehook
    try:
        with warnings.catch_warnings():
            report_here()
            yield
    finally:
        threading.excepthook, sys.unraisablehook = hooks


def report_here() -> None:
    """Make standard streams take any text; all that Python itself reports there goes the same way as all else.

    That is warnings, what libraries log, and what is raised in threads and destructors, where nobody catches it.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            # It was closed: a file that is opened now would get its number, and what is said would go there.
            number = os.open(os.devnull, os.O_WRONLY if name == "stderr" else os.O_RDONLY)
            setattr(sys, name, open(number, "r" if name == "stdin" else "w"))  # noqa: SIM115 - until the end
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(_Harmless())
    threading.excepthook, sys.unraisablehook = _show_of_thread, _show_unraisable
    warnings.showwarning = _show_warning


def dask_setup(worker: Any) -> None:
    """Let a process of `--workers N`, which preloads this module, report as this one does: Dask calls it there.

    To the end of the process: there is no context, whose own end would come when the names it needs are gone.
    """
    report_here()


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: Any = None,
    line: Any = None,
    ends: Callable[[], bool] = _ENDS,
) -> None:
    if not ends():
        show(warnings.formatwarning(message, category, filename, lineno).rstrip("\n"), err=True)


def _show_of_thread(raised: threading.ExceptHookArgs, ends: Callable[[], bool] = _ENDS) -> None:
    if not ends() and raised.exc_type is not SystemExit:
        thread = "a thread that has ended" if raised.thread is None else f"thread {raised.thread.name}"
        _show_raised(thread, raised)


def _show_unraisable(raised: sys.UnraisableHookArgs, ends: Callable[[], bool] = _ENDS) -> None:
    # What fails while modules are taken down tells of that alone.
    if ends():
        return
    name = getattr(raised.object, "__qualname__", type(raised.object).__qualname__)
    _show_raised(f"{raised.err_msg or 'ignored in'} {name}", raised)


def _show_raised(where: str, raised: threading.ExceptHookArgs | sys.UnraisableHookArgs) -> None:
    """Say in one line what was raised, and the place of it."""
    at = "".join(f" ({each.filename}, line {each.lineno})" for each in extract_tb(raised.exc_traceback)[-1:])
    text = f"{where}: {raised.exc_type.__name__}: {raised.exc_value}{at}"
    tell(" ".join(harmless(text).split()))


class _Harmless(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return harmless(super().format(record))
