"""Rows of a result: its points, or the entries that a further dimension has at each; chosen, sorted and limited.

What is asked for decides what a row is. The points are the rows; a name on a further dimension (mode, member,
elapsed) makes a row of each of its entries, and the dimension's coordinate a column. A dimension has room for as
many entries as any point might have; those without a value in anything shown along it are left out, unless the
expression speaks of nan. Points stay, with values or without.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.query import language as expression
from studies.query import tree
from studies.query.columns import MAKING, TEXT, Column, Columns
from studies.query.conditions import condition
from studies.query.rows import Rows, Selection, Source

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def query(
    dataset: xr.Dataset,
    where: str | None = None,
    *,
    show: str | Sequence[str] | None = None,
    sort: str | Sequence[str] | None = None,
    limit: int | None = None,
) -> pd.DataFrame:
    """Rows of a result as a data frame.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of a sweep: `studies.open`, `sweeps.open_results`, or plain xarray on its file.
    where : str, optional
        An expression over axes, variables and settings, like ``mu > 0.2 and theta == 5 and regime == "stuck"``
        (`studies.query.language`, `studies.query.conditions`); by default every row.
    show : str or sequence of str, optional
        Columns, "V,mu,regime" or a list; by default the axes and what each point, or each entry, has one value of.
    sort : str or sequence of str, optional
        Columns to sort by, the first first; with a minus in front descending. What is missing comes last. By
        default the order of the file.
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
    return frame(dataset, where, show, sort, limit, 3)


def frame(dataset: xr.Dataset, where: Any, show: Any, sort: Any, limit: Any, depth: int) -> pd.DataFrame:
    """The same; what it warns of is laid to the caller so many calls above."""
    import pandas as pd

    notes: list[str] = []
    chosen = select(dataset, where, show=show, sort=sort, limit=limit, note=notes.append)
    for text in notes:
        warnings.warn(text, stacklevel=depth)
    found = list(chosen.rows())
    whole = {
        column.name: np.concatenate([rows[column.name] for rows in found]) if found else _none(dataset, column)
        for column in chosen.columns
    }
    for column in chosen.columns:
        if column.kind == TEXT:
            whole[column.name] = pd.Series(whole[column.name], dtype="str")
        elif column.words is not None:
            words = dict.fromkeys(column.words.values())
            shown = pd.Series(column.shown(whole[column.name]), dtype=object).replace("", None)
            whole[column.name] = pd.Categorical(shown, categories=list(words))
    return pd.DataFrame(whole)


def _none(dataset: xr.Dataset, column: Column) -> Any:
    """No value, of the type that values of the column have."""
    like = dataset.variables.get(column.name, column.values)
    return np.empty(0, dtype=None if like is None else like.dtype)


def select(
    dataset: xr.Dataset,
    where: str | None = None,
    *,
    show: str | Sequence[str] | None = None,
    sort: str | Sequence[str] | None = None,
    limit: int | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> Selection:
    """Understand what is asked; arguments and errors are those of `query`, and `note` is told what it warns of."""
    whole = isinstance(limit, (int, np.integer)) and not isinstance(limit, bool)
    if limit is not None and not (whole and limit >= 0):
        raise ValueError(f"limit = {limit!r}: it must be a whole number, 0 or above")
    every = Columns(dataset)
    node = None if where is None else expression.parse(where)
    asked = [] if node is None else [every.find(name, "where") for name in dict.fromkeys(tree.names(node))]
    order = [(every.find(name.removeprefix("-"), "sort"), name.startswith("-")) for name in _listed(sort, "sort")]
    named = asked + [column for column, _ in order]
    if show is None:
        dims, shown = _by_default(every, named)
    else:
        shown = [every.find(name, "show") for name in _listed(show, "show")]
        dims = _dims(every, [*shown, *named], points=False)
    shown = _with_coordinates(every, dims, shown)
    columns = {column.name: column for column in (*shown, *named)}
    further = set(dims) - set(every.point_dims)
    padded = [column for column in shown if further & set(column.dims) and not column.axis]
    if node is not None and tree.speaks_of_missing(node):
        padded = []
    return Selection(
        tuple(shown),
        Source(dataset, columns, dims),
        tuple(_conditions(node, columns, dataset, note)),
        tuple(padded),
        tuple(order),
        None if limit is None else int(limit),
    )


def _listed(names: str | Sequence[str] | None, argument: str) -> list[str]:
    """Names in a text or a list, each once."""
    if names is None:
        return []
    found = [name.strip() for name in (names.split(",") if isinstance(names, str) else names)]
    if not found or not all(found):
        raise ValueError(
            f"{argument} = {names!r}: it must be one name or more, with commas between them, like V,mu"
        )
    return list(dict.fromkeys(found))


def _dims(every: Columns, columns: Sequence[Column], points: bool) -> tuple[str, ...]:
    """What the rows run along: what the columns do, and all of the points where these are the rows.

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


def _apart(columns: Sequence[Column], *dims: tuple[str, ...]) -> ValueError:
    """What cannot stand in one row."""
    told = []
    for own in dims:
        along = sorted((column for column in columns if set(own) <= set(column.dims)), key=lambda each: each.axis)
        told.append(f"{along[0].name} runs along {', '.join(own)}")
    return ValueError(f"{' and '.join(told)}: they have no rows in common; ask for them one after the other")


def _by_default(every: Columns, named: Sequence[Column]) -> tuple[tuple[str, ...], list[Column]]:
    """What the rows run along, and the columns shown, where none are asked for but some are `named`."""
    variables = [
        every.find(str(name), "show") for name in every.dataset.variables if _fits(every.dataset, str(name))
    ]
    results = [column for column in variables if column.name not in (*every.axes, *every.dataset.sizes, *MAKING)]
    points = set(every.point_dims)
    entries = [column for column in named if not set(column.dims) <= points]
    status = [column for column in variables if column.name == "status"]
    dims = _dims(every, named, points=all(column.axis for column in entries))
    chosen = [column for column in results if set(column.dims) <= set(dims) and (set(column.dims) - points)]
    if not entries:
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
    axes = [
        column for column in (every.find(name, "show") for name in every.axes) if set(column.dims) <= set(dims)
    ]
    named = {f"{column.name}_name" for column in axes}
    return axes + [column for column in results if column.name in named]


def _fits(dataset: xr.Dataset, name: str) -> bool:
    """Whether a variable has a place in a table."""
    return dataset.variables[name].dtype.kind in "OUiufb"


def _once(columns: Sequence[Column]) -> list[Column]:
    return list({column.name: column for column in columns}.values())


def _with_coordinates(every: Columns, dims: tuple[str, ...], shown: Sequence[Column]) -> list[Column]:
    """The columns, with the coordinate of each further dimension before the first that runs along it."""
    found = list(shown)
    for dim in dims:
        if dim not in every.point_dims and dim not in [column.name for column in found]:
            place = next((k for k, column in enumerate(found) if dim in column.dims), len(found))
            found.insert(place, every.find(dim, "show"))
    return found


def _conditions(
    node: tree.Node | None, columns: Mapping[str, Column], dataset: xr.Dataset, note: Callable[[str], None]
) -> Iterator[tuple[tuple[str, ...], Callable[[Rows], Any]]]:
    """What an expression asks, in parts that all must be true, those first that read least."""
    if node is None:
        return
    parts = tree.parts(node) if isinstance(node, tree.Logic) and node.word == "and" else (node,)
    decided = [(tuple(dict.fromkeys(tree.names(part))), condition(part, columns, note)) for part in parts]

    def cost(each: tuple[tuple[str, ...], Any]) -> int:
        return sum(dataset.variables[name].size for name in each[0] if columns[name].values is None)

    yield from sorted(decided, key=cost)
