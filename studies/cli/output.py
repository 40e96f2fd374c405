"""Printing: data on standard output, messages on standard error, without control characters."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from math import inf

# Controls but \n and \t, ends of lines and directions of text elsewhere, halves of surrogate pairs.
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
# The options -q and -v of the command.
FLAGS = {"quiet": False, "verbose": False}


def harmless(text: str) -> str:
    r"""The text with control characters written out, an escape as backslash x1b; line ends become newlines."""
    return OBEYED.sub(lambda found: found[0].encode("unicode_escape").decode(), text.replace("\r\n", "\n"))


def show(text: str, *, err: bool = False, end: str = "\n", raw: bool = False) -> None:
    """Print a text at once; `raw` without changes, for programs. Errors of standard error are ignored.

    If standard output cannot be written the program ends: with 0 if its reader has closed it, else with 3.
    """
    try:
        print(text if raw else harmless(text), file=sys.stderr if err else sys.stdout, end=end, flush=True)
    except OSError as problem:
        if err:
            return
        # The interpreter flushes it at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(problem, BrokenPipeError):
            sys.exit(0)
        tell(f"standard output could not be written: {problem.strerror}")
        sys.exit(3)


def tell(text: str) -> None:
    r"""Print one line on standard error; the end of a line within it is written as \n."""
    show("fiv: " + text.replace("\r\n", "\n").replace("\n", "\\n"), err=True)


def say(*lines: str) -> None:
    """Print a message on standard error, unless -q suppresses it."""
    for line in () if FLAGS["quiet"] else lines:
        show(line, err=True)


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows of texts with their columns aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def rough_duration(seconds: float) -> str:
    """A time in words, rounded for planning: "instantly", "about 8 min"."""
    if seconds < 1.0:
        return "instantly"
    units = ((90.0, 1.0, "s"), (5400.0, 60.0, "min"), (172800.0, 3600.0, "h"), (inf, 86400.0, "days"))
    return next(f"about {seconds / size:.0f} {unit}" for most, size, unit in units if seconds < most)
