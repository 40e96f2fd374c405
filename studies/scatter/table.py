"""Points as the rows of a table: a CSV file whose columns are a study's axes and settings, maybe with units."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies import units
from studies.registry import expanded, read_text
from studies.scatter.distributions import physical
from studies.spec import finite
from studies.study import Setting, Study, suggest
from sweeps import Axis, InputError

# NAME or NAME [UNIT].
HEAD = re.compile(r"\s*([^\[\]]*?)\s*(?:\[([^\[\]]*)\]\s*)?")
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
# A table is for rows that somebody chose.
MOST_ROWS = 1_000_000


@dataclass(frozen=True, eq=False)
class Table:
    """The rows of a table, in the study's units.

    Attributes
    ----------
    columns : mapping of str to ndarray, (rows,)
    places : sequence of str
        What a message calls each row: the file and the number of its line.
    """

    columns: Mapping[str, NDArray[Any]]
    places: Sequence[str]


def table(study: Study, points: str | Path | Mapping[str, Any]) -> Table:
    """The rows of a CSV file, or of columns by name.

    Raises
    ------
    InputError
        In one line: where, what stands there, and what would do.
    """
    if isinstance(points, Mapping):
        columns = {name: np.atleast_1d(np.asarray(each, dtype=object)).tolist() for name, each in points.items()}
        lengths = {name: len(each) for name, each in columns.items()}
        if len(set(lengths.values())) != 1:
            raise InputError(f"points: its columns have {lengths} entries; they must have one for each row")
        rows = [(f"points: row {k}", row) for k, row in enumerate(zip(*columns.values(), strict=True), 1)]
        return _table(study, "points", list(columns), rows)
    where = f"--points {points}"
    lines = list(_lines(expanded(points), where))
    if not lines:
        raise InputError(f"{where}: it is empty; its first line must name columns, for example {_example(study)}")
    return _table(study, where, lines[0][1], [(f"{where}: line {number}", cells) for number, cells in lines[1:]])


def columns_of(study: Study) -> dict[str, Axis | Setting]:
    """Axes and settings, which may be columns."""
    return {**study.axes, **study.settings}


def _example(study: Study) -> str:
    return ",".join([*study.axes, *study.settings][:3])


def _lines(file: Path, where: str) -> Iterator[tuple[int, list[str]]]:
    """The cells of each line that has any, with its number."""
    try:
        # A spreadsheet begins a file with a mark of its encoding.
        reader = csv.reader(StringIO(read_text(file, "utf-8-sig"), newline=""), strict=True)
        for cells in reader:
            if any(cell.strip() for cell in cells):
                yield reader.line_num, cells
    except InputError as problem:
        raise InputError(f"{where}: {problem}") from None
    except OSError as problem:
        raise InputError(f"{where}: it cannot be read: {problem.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{where}: it is not a text in UTF-8; save it as CSV in UTF-8") from None
    except csv.Error as problem:
        raise InputError(f"{where}: it is not CSV: {problem}") from None


def _table(study: Study, where: str, heads: Sequence[str], rows: Sequence[tuple[str, Sequence[Any]]]) -> Table:
    names, units_of = _heads(study, where, heads)
    if not rows:
        raise InputError(f"{where}: it has no row below its heads; each row is a point to compute")
    if len(rows) > MOST_ROWS:
        raise InputError(f"{where}: it has {len(rows)} rows; {MOST_ROWS} is the most")
    cells: dict[str, list[Any]] = {name: [] for name in names}
    for place, row in rows:
        if len(row) != len(names):
            raise InputError(
                f"{place}: it has {len(row)} cell{'s' * (len(row) != 1)}, {', '.join(map(repr, row))}; it must "
                f"have {len(names)}, one for each of {', '.join(names)}"
            )
        for name, unit, cell in zip(names, units_of, row, strict=True):
            try:
                cells[name].append(_value(study, name, unit, cell))
            except InputError as problem:
                raise InputError(f"{place}, column {name}: {problem}") from None
    columns = {name: np.array(each) for name, each in cells.items()}
    return Table(columns, [place for place, _ in rows])


def _heads(study: Study, where: str, heads: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names and units of the columns."""
    columns = columns_of(study)
    alone = HEAD.fullmatch(heads[0])
    is_one = len(heads) > 1 or (alone is not None and alone[1] in columns)
    if not is_one and (separator := next((each for each in SEPARATORS if each in heads[0].strip()), "")):
        raise InputError(
            f"{where}: line 1: {heads[0]!r}: its cells are separated by {SEPARATORS[separator]}; separate them by "
            "commas, and write numbers with a decimal point"
        )
    names, own_units = list[str](), list[str]()
    for head in heads:
        match = HEAD.fullmatch(head)
        name, unit = (match[1], match[2]) if match else (head, None)
        if name not in columns:
            near = suggest(name, list(columns)) or f"there are {', '.join(columns)}"
            raise InputError(
                f"{where}: line 1, column {head.strip()!r}: study {study.name} has no axis and no setting of that "
                f"name; {near.strip()}"
            )
        if name in names:
            raise InputError(f"{where}: line 1: the column {name} stands there twice; leave one out")
        own = columns[name].units
        if name in study.texts and unit:
            raise InputError(f"{where}: line 1, column {head.strip()!r}: it is of texts; leave [{unit}] out")
        try:
            if unit is not None:
                units.convert(1.0, unit.strip(), own)
        except InputError as problem:
            raise InputError(f"{where}: line 1, column {head.strip()!r}: {problem}") from None
        names.append(name)
        own_units.append(own if unit is None else unit.strip())
    return names, own_units


def _value(study: Study, name: str, unit: str, cell: Any) -> Any:
    """A cell in the study's unit."""
    if name in study.texts:
        text = str(cell).strip()
        if text not in study.texts[name]:
            texts = study.texts[name]
            raise InputError(f"{text!r}: {suggest(text, texts) or 'it must be one of ' + ', '.join(texts[:8])}")
        return text
    own = columns_of(study)[name].units
    shown = cell.strip() if isinstance(cell, str) else f"{cell!r}"
    try:
        value = finite(shown)
    except InputError:
        like = "; write a decimal point" if isinstance(cell, str) and re.fullmatch(r"[\d+-]+,\d+", shown) else ""
        raise InputError(f"{shown!r}: it must be a finite number{like}") from None
    value = units.convert(value, unit, own)
    low, high = physical(name)
    if not low <= value <= high:
        limits = f"{low:g} or above" if high == math.inf else f"between {low:g} and {high:g}"
        raise InputError(f"{shown}: it must be {limits}{'' if own == '1' else f' {own}'}")
    if name in study.axes and study.axes[name].values.dtype.kind == "i":
        if value != round(value):
            raise InputError(f"{shown}: it must be a whole number")
        return int(value)
    return value
