"""Rows in groups: how many each has, and statistics of columns over them, by pandas."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from studies.query import rows as reading
from studies.query.columns import NUMBER, WORDS, Column, hint
from studies.query.evaluate import TRUTH
from studies.query.rows import Order, Rows
from sweeps import InputError

NUMERIC = ("mean", "std", "min", "max", "median")


@dataclass(frozen=True, eq=False)
class Statistic:
    """A column of a grouped table.

    Attributes
    ----------
    column : Column
        As it is shown.
    function : str
        "count", "share" or one of NUMERIC.
    of : Column, optional
        Whose values are taken; none for "count".
    code : int, optional
        Of a word the share of whose rows it is.
    """

    column: Column
    function: str
    of: Column | None = None
    code: int | None = None


def statistics(entry: str, find: Callable[[str], Column]) -> list[Statistic]:
    """Parse an entry of `show`: "count", or a function and a column, like "mean:V*1000" or "share:regime".

    Raises
    ------
    ValueError
        If it has another form, or the column has no such statistic.
    """
    if entry == "count":
        return [Statistic(Column("count", NUMBER, whole=True), "count")]
    function, _, text = (part.strip() for part in entry.partition(":"))
    if function not in (*NUMERIC, "share") or not text:
        functions = ", ".join(NUMERIC)
        raise InputError(
            f"show = {entry!r}: with by it must be count, or {functions} or share of a column, like mean:V"
        )
    of, name = find(text), f"{function}:{text}"
    if function != "share" and of.kind == NUMBER:
        whole = of.whole and function in ("min", "max")
        return [Statistic(Column(name, NUMBER, units=of.units, whole=whole), function, of)]
    if function == "share" and of.kind == TRUTH:
        return [Statistic(Column(name, NUMBER), function, of)]
    if function == "share" and of.words is not None:
        columns = {code: Column(f"{name}={word}", NUMBER) for code, word in of.words.items()}
        return [Statistic(column, function, of, code) for code, column in columns.items()]
    if function == "share":
        why = "share is of words or of what is true, like share:regime or share:V > 1e-3"
    elif of.kind == WORDS:
        why = f"{text} is a word, and its codes have no {function}; use share:{text}"
    elif of.kind == TRUTH:
        why = f"it is true or false; use share:{text}"
    else:
        why = f"{text} is a text, which has no {function}"
    raise InputError(f"show = {entry!r}: {why}")


def grouped(
    parts: Iterable[Rows], keys: Sequence[Column], measures: Sequence[Statistic], order: Order, limit: int | None
) -> Iterator[Rows]:
    """Groups of rows that agree in the keys, one row each, all at once if there are any.

    What is missing makes a group too. Without an order the keys are ascending.
    """
    import pandas as pd

    held: list[Rows] = []
    for part in parts:
        held.append(part)
        if reading.count_of(held) > reading.MOST_HELD:
            raise InputError(f"by: more than {reading.MOST_HELD} rows are to be grouped; choose fewer with where")
    if not held:
        return
    values = reading.joined(held)
    # Numbered, because a key and a statistic may be of one column.
    numbered = {k: values[key.name] for k, key in enumerate(keys)}
    for k, each in enumerate(measures, len(keys)):
        if each.of is not None:
            own = values[each.of.name]
            if each.code is not None:
                own = own == each.code
            numbered[k] = own if each.function in ("min", "max") else own.astype(float)
    groups = pd.DataFrame(numbered).groupby([*range(len(keys))], dropna=False)
    sizes = groups.size()
    index = sizes.index.to_frame()
    table = {key.name: np.asarray(index[k], dtype=values[key.name].dtype) for k, key in enumerate(keys)}
    for k, each in enumerate(measures, len(keys)):
        function = "mean" if each.function == "share" else each.function
        table[each.column.name] = np.asarray(sizes if each.of is None else groups[k].agg(function))
    yield reading.sorted_rows(table, order, limit) if order else {k: v[:limit] for k, v in table.items()}


def order_of(names: Sequence[str], columns: Sequence[Column]) -> Order:
    """Parse the columns by which a grouped table is sorted.

    Raises
    ------
    ValueError
        If the table has no column of a name.
    """
    by_name = {column.name: column for column in columns}
    for name in names:
        if name.removeprefix("-") not in by_name:
            near = hint(name.removeprefix("-"), [*by_name])
            raise InputError(f"sort = {name!r}: the grouped table has no such column; {near}")
    return tuple((by_name[name.removeprefix("-")], name.startswith("-")) for name in names)
