"""Rows that are chosen, sorted and limited block by block, so that no more is in memory than is needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.query.columns import TEXT, Column
from sweeps import InputError, blocks

if TYPE_CHECKING:
    import xarray as xr

Rows = dict[str, NDArray[Any]]
# Columns to sort by, and whether descending.
Order = Sequence[tuple[Column, bool]]

# So many rows are in hand at once.
AT_ONCE = 200_000
# Rows that are put in order, or in groups.
MOST_HELD = 20_000_000


@dataclass(frozen=True, eq=False)
class Selection:
    """Rows of a result; nothing is read before they are asked for.

    Attributes
    ----------
    dataset : xarray.Dataset
    columns : mapping of str to Column
        All that are read or calculated.
    dims : tuple of str
        What the rows run along.
    conditions : sequence of callable
        From a block's values, what is true of a row that is chosen; the cheapest first.
    padded : sequence of Column
        A row without a value in any of them is left out.
    """

    dataset: xr.Dataset
    columns: Mapping[str, Column]
    dims: tuple[str, ...]
    conditions: Sequence[Callable[[Mapping[str, NDArray[Any]]], Any]]
    padded: Sequence[Column]

    def rows(self, names: Sequence[str], order: Order = (), limit: int | None = None) -> Iterator[Rows]:
        """The rows, some at a time: arrays by name; codes where words are shown."""
        if order:
            yield from self._sorted(names, order, limit)
            return
        for block, places in self._chosen():
            yield block.take(names, places[:limit])
            limit = None if limit is None else max(limit - len(places), 0)
            if limit == 0:
                return

    def _chosen(self) -> Iterator[tuple[Block, NDArray[np.intp]]]:
        """Each block that has rows which are chosen, and their places in it."""
        for part in blocks(tuple(self.dataset.sizes[dim] for dim in self.dims), AT_ONCE):
            block = Block(self, part)
            chosen: Any = np.ones((), dtype=bool)
            for condition in self.conditions:
                chosen = chosen & condition(block)
                if not np.any(chosen):
                    break
            if np.any(chosen) and self.padded:
                absent = [column.missing(block[column.name]) for column in self.padded]
                chosen = chosen & ~np.logical_and.reduce(np.broadcast_arrays(*absent))
            places = np.flatnonzero(np.broadcast_to(chosen, block.shape))
            if len(places):
                yield block, places

    def _sorted(self, names: Sequence[str], order: Order, limit: int | None) -> Iterator[Rows]:
        """All rows in order; with a limit no more than that are held, and a block."""
        needed = [*names, *(column.name for column, _ in order)]
        parts: list[Rows] = []
        for block, places in self._chosen():
            parts.append(block.take(needed, places))
            if limit is not None:
                parts = [sorted_rows(joined(parts), order, limit)]
            if count_of(parts) > MOST_HELD:
                raise InputError(
                    f"sort: more than {MOST_HELD} rows are to be sorted; give a limit, or choose fewer"
                )
        if parts:
            whole = sorted_rows(joined(parts), order, limit)
            yield {name: whole[name] for name in names}


class Block(dict[str, NDArray[Any]]):
    """Values of columns in a part of the rows, each read or calculated when it is first asked for.

    They have length 1 along every dimension that their column does not have.

    Parameters
    ----------
    selection : Selection
    part : tuple of slice
        Of the first dimensions that the rows run along; all there is of the others.
    """

    def __init__(self, selection: Selection, part: tuple[slice, ...]) -> None:
        super().__init__()
        self._selection, self._part = selection, dict(zip(selection.dims, part, strict=False))
        sizes = {dim: selection.dataset.sizes[dim] for dim in selection.dims}
        cut = {dim: len(range(*each.indices(sizes[dim]))) for dim, each in self._part.items()}
        self.shape = tuple((sizes | cut).values())

    def __missing__(self, name: str) -> NDArray[Any]:
        column = self._selection.columns[name]
        self[name] = self._read(column) if column.calculate is None else np.asarray(column.calculate(self))
        return self[name]

    def _read(self, column: Column) -> NDArray[Any]:
        dims, target = column.dims, self._selection.dims
        source = self._selection.dataset.variables[column.name] if column.values is None else column.values
        try:
            # Where one block is all there is xarray's indexing, which imports dask's arrays first, is not needed.
            part: tuple[Any, ...] = (*(self._part.get(dim, slice(None)) for dim in dims), ...)
            values = np.asarray(source[part] if self._part else source)
        except (OSError, RuntimeError) as problem:
            file = self._selection.dataset.encoding.get("source", "it")
            raise InputError(f"{column.name}: it cannot be read, the file is damaged: {file}: {problem}") from None
        values = values.transpose([dims.index(dim) for dim in target if dim in dims])
        return np.expand_dims(values, [k for k, dim in enumerate(target) if dim not in dims])

    def take(self, names: Iterable[str], places: NDArray[np.intp]) -> Rows:
        """Values at some places of the block, one row each."""
        return {name: np.broadcast_to(self[name], self.shape).ravel()[places] for name in names}


def count_of(parts: Sequence[Rows]) -> int:
    """How many rows there are in all parts."""
    return sum(len(next(iter(part.values()))) for part in parts)


def joined(parts: Sequence[Rows]) -> Rows:
    """All rows of one part or more."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def sorted_rows(rows: Rows, order: Order, limit: int | None) -> Rows:
    """The first rows in order: equal ones stay as they are, missing ones come last."""
    ranks: list[NDArray[Any]] = []
    for column, descending in order:
        key = rows[column.name]
        values = np.unique(key.astype(str), return_inverse=True)[1] if column.kind == TEXT else key
        rank = np.where(column.missing(key), np.nan, values.astype(float))
        # The last of `lexsort`'s keys is its first; NaN comes last in each.
        ranks = [-rank if descending else rank, *ranks]
    places = np.lexsort(ranks)[:limit]
    return {name: values[places] for name, values in rows.items()}
