"""Rows of a result: its points, or the entries that a further dimension has at each; chosen, sorted and limited.

The columns of a query decide what a row is. The points are the rows; a name on a further dimension (mode, member,
elapsed) makes a row of each of its entries, and the dimension's coordinate a column. A dimension has room for as
many entries as any point might have; those without a value in anything shown along it are left out, unless the
expression speaks of nan. Points stay, with values or without. Rows may be put in groups (`studies.query.groups`).
"""

from __future__ import annotations

import ast
import warnings
from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from studies.query import evaluate
from studies.query.columns import MAKING, TEXT, Column, Columns
from studies.query.groups import grouped, order_of, statistics
from studies.query.language import Expression, parse, split
from studies.query.rows import Rows, Selection, joined
from sweeps import InputError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Names = str | Sequence[str] | None


def query(
    dataset: xr.Dataset,
    where: str | None = None,
    *,
    show: Names = None,
    by: Names = None,
    sort: Names = None,
    limit: int | None = None,
) -> pd.DataFrame:
    """Rows of a result as a data frame.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of a sweep: `studies.open`, `sweeps.open_results`, or plain xarray on its file.
    where : str, optional
        An expression over axes, variables and settings, ``mu > 0.2 and theta in (5, 8) and regime == "stuck"``
        (`studies.query.language`, `studies.query.evaluate`); by default every row.
    show : str or sequence of str, optional
        Columns, "V*1000,mu,regime" or a list, by name or calculated; by default the axes and what each point, or
        each entry, has one value of. With `by` the statistics of each group: "count", and "mean:X", "std:X"
        (of a sample), "min:X", "max:X" and "median:X" of the values that are not missing; "share:X" has a column
        for each word, the share of the group's rows, and of a condition one column; by default "count".
    by : str or sequence of str, optional
        Columns; rows that agree in them are one group, and one row.
    sort : str or sequence of str, optional
        Columns to sort by, the first first, by name or calculated; with a minus in front, which is no part of the
        expression, descending. What is missing comes last. By default the order of the file. With `by` columns of
        the grouped table; by default those of `by`.
    limit : int, optional
        So many rows at most.

    Returns
    -------
    pandas.DataFrame
        Numbers as the dataset has them; codes as categories of words.

    Raises
    ------
    ValueError
        Naming the argument. A number that an axis does not have is a warning.
    """
    return frame(dataset, 3, where, show=show, by=by, sort=sort, limit=limit)


def frame(dataset: xr.Dataset, depth: int, where: str | None = None, **options: Any) -> pd.DataFrame:
    """The same; its warnings are laid to the caller so many calls above."""
    import pandas as pd

    notes: list[str] = []
    columns, parts = select(dataset, where, **options, note=notes.append)
    for text in notes:
        warnings.warn(text, stacklevel=depth)
    rows = joined([*parts] or [{column.name: _none(dataset, column) for column in columns}])
    table: dict[str, Any] = {}
    for column in columns:
        values = rows[column.name]
        if column.kind == TEXT:
            table[column.name] = pd.Series(values, dtype="str")
        elif column.words is not None:
            words = list(dict.fromkeys(column.words.values()))
            table[column.name] = pd.Categorical(column.shown(values), categories=words)
        else:
            table[column.name] = values
    return pd.DataFrame(table)


def _none(dataset: xr.Dataset, column: Column) -> Any:
    """No value, of the type that values of the column have."""
    like = dataset.variables.get(column.name, column.values)
    return np.empty(0, dtype=None if like is None else like.dtype)


class Selected(NamedTuple):
    """Columns of a query and its rows in blocks, which are read one at a time."""

    columns: Sequence[Column]
    rows: Iterator[Rows]


def select(
    dataset: xr.Dataset,
    where: str | None = None,
    *,
    show: Names = None,
    by: Names = None,
    sort: Names = None,
    limit: int | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> Selected:
    """Understand a query; arguments and errors are those of `query`, and `note` is called with its warnings."""
    whole = isinstance(limit, (int, np.integer)) and not isinstance(limit, bool)
    if limit is not None and not (whole and limit >= 0):
        raise InputError(f"limit = {limit!r}: it must be a whole number, 0 or above")
    every = Columns(dataset, note)
    expression = None if where is None else parse(where)
    named = [] if expression is None else [every.find(name, "where") for name in expression.names()]
    if by is not None:
        keys = [every.find(name, "by") for name in _listed(by, "by")]
        measures = [
            each
            for entry in _listed(show, "show") or ["count"]
            if entry not in [key.name for key in keys]
            for each in statistics(entry, lambda text: evaluate.column(every, text, "show"))
        ]
        columns = _once([*keys, *(each.of for each in measures if each.of is not None)])
        together = _read([*columns, *named])
        dims = _dims(every, together, points=all(each.axis for each in together if every.beside(each)))
        shown = [*keys, *(each.column for each in measures)]
        ranks = order_of(_listed(sort, "sort"), shown)
        parts = _selection(every, expression, dims, columns, named).rows([each.name for each in columns])
        return Selected(shown, grouped(parts, keys, measures, ranks, limit))
    order = [
        (_number(every, name.removeprefix("-").strip(), "sort"), name[0] == "-") for name in _listed(sort, "sort")
    ]
    named += [column for column, _ in order]
    if show is None:
        _dims(every, _read(named), points=False)
        dims, shown = _by_default(every, named)
    else:
        shown = [_number(every, text, "show") for text in _listed(show, "show")]
        dims = _dims(every, _read([*shown, *named]), points=False)
    shown = _with_coordinates(every, dims, shown)
    selection = _selection(every, expression, dims, shown, named)
    return Selected(shown, selection.rows([column.name for column in shown], order, limit))


def _selection(
    every: Columns,
    expression: Expression | None,
    dims: tuple[str, ...],
    shown: Sequence[Column],
    named: Sequence[Column],
) -> Selection:
    """The rows along some dimensions for which an expression is true, without those that are padding."""
    columns = {column.name: column for column in [*shown, *named, *_read([*shown, *named])]}
    padded = [column for column in _read(shown) if every.beside(column) and not column.axis]
    if expression is None:
        return Selection(every.dataset, columns, dims, [], padded)
    tree = expression.tree
    parts = tree.values if isinstance(tree, ast.BoolOp) and isinstance(tree.op, ast.And) else [tree]
    conditions = []
    for part in parts:
        read = [columns[name] for name in expression.names(part) if columns[name].values is None]
        cost = sum(every.dataset.variables[column.name].size for column in read)
        conditions.append((cost, evaluate.condition(expression, columns, every.note, part)))
    cheapest = [condition for _, condition in sorted(conditions, key=itemgetter(0))]
    return Selection(every.dataset, columns, dims, cheapest, [] if expression.speaks_of_missing() else padded)


def _number(every: Columns, text: str, argument: str) -> Column:
    """A column to be shown or to sort by: one of a name, or one of numbers."""
    column = evaluate.column(every, text, argument)
    if column.kind == evaluate.TRUTH:
        raise InputError(f"{argument} = {text!r}: it is true or false; where = {text!r} chooses such rows")
    return column


def _listed(names: Names, argument: str) -> list[str]:
    """The entries of a text or a list, each once."""
    if names is None:
        return []
    entries = split(names) if isinstance(names, str) else [name.strip() for name in names]
    if not entries or not all(entries):
        raise InputError(
            f"{argument} = {names!r}: it must be one name or more, with commas between them, like V,mu"
        )
    return list(dict.fromkeys(entries))


def _read(columns: Sequence[Column]) -> list[Column]:
    """The columns that are read for some: themselves, or what they are calculated from."""
    return [each for column in columns for each in ([column] if column.calculate is None else column.inputs)]


def _dims(every: Columns, columns: Sequence[Column], points: bool) -> tuple[str, ...]:
    """Dimensions of the rows: those of the columns, and all of the points where these are the rows.

    Raises
    ------
    ValueError
        If they run along further dimensions that have nothing to do with each other.
    """
    along = {dim for column in columns for dim in column.dims}
    widest: tuple[str, ...] = ()
    for column in columns:
        own = tuple(dim for dim in column.dims if dim not in every.point_dims)
        if not set(own) <= set(widest):
            if not set(widest) <= set(own):
                raise _apart(columns, own, widest)
            widest = own
    return (*(dim for dim in every.point_dims if points or dim in along), *widest)


def _apart(columns: Sequence[Column], *dims: tuple[str, ...]) -> InputError:
    """Error for columns that run along different dimensions and so have no rows in common."""
    parts = []
    for own in dims:
        along = sorted((column for column in columns if set(own) <= set(column.dims)), key=lambda each: each.axis)
        parts.append(f"{along[0].name} runs along {', '.join(own)}")
    return InputError(f"{' and '.join(parts)}: they have no rows in common; query them one after the other")


def _by_default(every: Columns, named: Sequence[Column]) -> tuple[tuple[str, ...], list[Column]]:
    """Dimensions of the rows and the columns shown by default, where a condition has `named` some."""
    # Those that have a place in a table.
    names = [str(name) for name, each in every.dataset.variables.items() if each.dtype.kind in "OUiufb"]
    variables = [every.find(name, "show") for name in names]
    # A standard error is shown where it is asked for.
    errors = [f"{name}_se" for name in names]
    aside = (*every.axes, *every.dataset.sizes, *MAKING, *errors)
    results = [column for column in variables if column.name not in aside]
    points = set(every.point_dims)
    entries = [column for column in named if every.beside(column)]
    status = [column for column in variables if column.name == "status"]
    dims = _dims(every, named, points=all(column.axis for column in entries))
    if entries:
        chosen = [column for column in results if every.beside(column) and set(column.dims) <= set(dims)]
    else:
        chosen = [column for column in results if set(column.dims) == points]
    if not entries and not chosen:
        # Where a point has no number of its own, the entries that it has many of are the rows.
        wider = [column for column in results if set(column.dims) > points]
        return _by_default(every, [*named, *wider[:1]]) if wider else (dims, _axes(every, dims, results) + status)
    # Coordinates of further dimensions get their own place.
    named = [column for column in named if column.dims and not (column.axis and column in entries)]
    return dims, _once([*_axes(every, dims, results), *chosen, *named, *([] if entries else status)])


def _axes(every: Columns, dims: tuple[str, ...], results: Sequence[Column]) -> list[Column]:
    """The axes that rows run along, and the names that their values have."""
    every_axis = (every.find(name, "show") for name in every.axes)
    axes = [column for column in every_axis if set(column.dims) <= set(dims)]
    named = {f"{column.name}_name" for column in axes}
    return axes + [column for column in results if column.name in named]


def _once(columns: Sequence[Column]) -> list[Column]:
    return list({column.name: column for column in columns}.values())


def _with_coordinates(every: Columns, dims: tuple[str, ...], shown: Sequence[Column]) -> list[Column]:
    """The columns, with the coordinate of each further dimension before the first that runs along it."""
    columns = list(shown)
    for dim in dims:
        if dim not in every.point_dims and dim not in [column.name for column in columns]:
            place = next((k for k, column in enumerate(columns) if dim in column.dims), len(columns))
            columns.insert(place, every.find(dim, "show"))
    return columns
