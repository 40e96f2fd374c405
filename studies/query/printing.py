"""How the command `query` prints rows: to standard output, until it ends or nobody reads any more."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from itertools import chain

from studies.query.columns import Column
from studies.query.output import WRITERS, fitting
from studies.query.rows import Rows, Selection


def print_rows(chosen: Selection, form: str, narrow: bool, note: Callable[[str], None]) -> None:
    """Print what is chosen.

    Parameters
    ----------
    chosen : Selection
    form : str
        One of `studies.query.output.WRITERS`.
    narrow : bool
        Whether columns that do not fit on a terminal are left out; they are told.
    note : callable
        Told what a reader should know besides.
    """
    columns, rows = chosen.columns, chosen.rows()
    if narrow and form == "table" and sys.stdout.isatty():
        columns, rows = _narrowed(columns, rows, note)
    try:
        count = WRITERS[form](columns, rows, sys.stdout)
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read has enough. What is still in the buffer goes nowhere, or Python would complain at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return
    if not count:
        note("no row")


def _narrowed(
    columns: tuple[Column, ...], rows: Iterator[Rows], note: Callable[[str], None]
) -> tuple[tuple[Column, ...], Iterator[Rows]]:
    """The columns that fit, and the rows from the first on."""
    first = list(next(rows, {}) for _ in range(1))
    known = [each for each in first if each]
    kept = fitting(columns, known, shutil.get_terminal_size().columns)
    left = [column.name for column in columns[len(kept) :]]
    if left:
        note(f"too wide for this terminal and left out: {', '.join(left)}; choose with --show")
    return tuple(kept), chain(known, rows)
