"""Rows of a result as text: a table to read, CSV and JSON to go on with; some rows at a time.

The command `query` prints them.
"""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, islice
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from studies.cli.output import harmless
from studies.query.columns import NUMBER, Column
from studies.query.query import Selected
from studies.query.rows import Rows

# The widths of a table's columns are those of its first rows; rows are written so many at a time.
MEASURED, AT_ONCE = 5000, 20_000
# What a table shows of a number and of a text, and where there is nothing.
DIGITS, LETTERS, NOTHING = 6, 60, "-"
GAP = "  "


class Out(Protocol):
    """A file, as far as rows need one."""

    def write(self, text: str, /) -> object:
        """Print a text."""

    def isatty(self) -> bool:
        """Whether it is a terminal."""


Write = Callable[[Sequence[Column], Iterable[Rows], Out], int]


def write_csv(columns: Sequence[Column], rows: Iterable[Rows], file: Out) -> int:
    """CSV by RFC 4180, in full precision; an empty field where there is no value. Returns how many rows."""
    writer = csv.writer(file)
    writer.writerow([column.name for column in columns])
    count = 0
    for records in _records(columns, rows, ""):
        writer.writerows(records)
        count += len(records)
    return count


def write_json(columns: Sequence[Column], rows: Iterable[Rows], file: Out) -> int:
    """A list of objects; null where there is no value, or one that JSON does not have. Returns how many rows."""
    names = [column.name for column in columns]
    count = 0
    for records in _records(columns, rows, None, infinite=False):
        lines = (json.dumps(dict(zip(names, record, strict=True))) for record in records)
        file.write(("[\n" if count == 0 else ",\n") + ",\n".join(lines))
        count += len(records)
    file.write("\n]\n" if count else "[]\n")
    return count


def write_table(
    columns: Sequence[Column],
    rows: Iterable[Rows],
    file: Out,
    width: float = np.inf,
    note: Callable[[str], None] = lambda text: None,
) -> int:
    """Aligned columns under their names and units, as many as fit in a width, one at least. Returns how many rows.

    `note` is called with the names of those that are left out.
    """
    units = tuple(harmless(column.units) for column in columns)
    names = tuple(harmless(column.name) for column in columns)
    heads = [names, *([units] if any(units) else [])]
    cells = (tuple(map(_cell, record)) for records in _records(columns, rows, None) for record in records)
    first = [*heads, *islice(cells, MEASURED)]
    widths = [max(map(len, column)) for column in zip(*first, strict=True)]
    ends = np.cumsum(widths) + len(GAP) * np.arange(len(columns))
    fit = max(int(np.searchsorted(ends, width, side="right")), 1)
    if fit < len(columns):
        left_out = ", ".join(names[fit:])
        note(f"too wide for this terminal and left out: {left_out}; choose with --show")
    count = 0
    for row in chain(first, cells):
        aligned = (
            cell.rjust(room) if column.kind == NUMBER else cell.ljust(room)
            for column, cell, room in zip(columns[:fit], row, widths, strict=False)
        )
        file.write(GAP.join(aligned).rstrip() + "\n")
        count += 1
    return count - len(heads)


WRITERS: dict[str, Write] = {"table": write_table, "csv": write_csv, "json": write_json}


def print_rows(
    chosen: Selected, form: str, narrow: bool, units: bool, note: Callable[[str], None], file: Out
) -> None:
    """Print a selection.

    Parameters
    ----------
    chosen : Selected
    form : str
        One of WRITERS.
    narrow : bool
        Whether columns that do not fit on a terminal are left out, with a note.
    units : bool
        Whether heads carry units: "V [m s-1]"; JSON is then an object of "units", by name, and "rows".
    note : callable
        Called with what a reader should know besides.
    file : file
        Where to.
    """
    columns, rows = chosen
    if units and form != "json":
        columns, rows = _with_units(columns, rows)
    write = WRITERS[form]
    if narrow and form == "table" and file.isatty():
        write = partial(write_table, width=shutil.get_terminal_size().columns, note=note)
    if units and form == "json":
        units_of = {column.name: column.units for column in columns if column.units}
        file.write(f'{{"units": {json.dumps(units_of)},\n"rows": ')
    count = write(columns, rows, file)
    file.write("}\n" if units and form == "json" else "")
    if not count:
        note("no row")


def _with_units(columns: Sequence[Column], rows: Iterator[Rows]) -> tuple[Sequence[Column], Iterator[Rows]]:
    """Columns whose names carry their units, and their rows."""
    heads = {column.name: f"{column.name} [{column.units}]" if column.units else column.name for column in columns}
    renamed = ({heads[name]: values for name, values in part.items()} for part in rows)
    return tuple(replace(column, name=heads[column.name], units="") for column in columns), renamed


def _records(
    columns: Sequence[Column], rows: Iterable[Rows], nothing: Any, infinite: bool = True
) -> Iterator[list[tuple[Any, ...]]]:
    """The rows as Python's own values, in parts of a size that is quick to write."""
    for part in rows:
        for start in range(0, len(part[columns[0].name]), AT_ONCE):
            values = (part[column.name][start : start + AT_ONCE] for column in columns)
            plain = (_plain(*each, nothing, infinite) for each in zip(columns, values, strict=True))
            yield list(zip(*plain, strict=True))


def _cell(value: Any) -> str:
    """A value for a reader; texts in one line, and without what a terminal would obey."""
    if value is None:
        return NOTHING
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}"
    text = harmless(" ".join(str(value).split()))
    return text if len(text) <= LETTERS else f"{text[: LETTERS - 3]}..."


def _plain(column: Column, values: NDArray[Any], nothing: Any, infinite: bool) -> list[Any]:
    """Values as Python's own: whole numbers, floats, texts; `nothing` where there is none, or no finite one."""
    if column.kind != NUMBER:
        return [text if text == text else nothing for text in column.shown(values).tolist()]
    present = ~column.missing(values) if infinite else np.isfinite(values)
    if column.whole:
        numbers = np.where(present, values, 0).astype(np.int64).tolist()
    elif values.dtype == np.float32:
        # With the digits that single precision has: 0.1, not 0.10000000149.
        numbers = [float(str(value)) for value in values]
    else:
        numbers = values.tolist()
    return [each if there else nothing for each, there in zip(numbers, present.tolist(), strict=True)]
