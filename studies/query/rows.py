"""Rows that are chosen, sorted and limited block by block, so that no more is in memory than is needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.query.columns import TEXT, Column
from sweeps import InputError, blocks

if TYPE_CHECKING:
    import xarray as xr

Rows = dict[str, NDArray[Any]]
# Columns to sort by, and whether descending.
Order = tuple[tuple[Column, bool], ...]

# So many rows are in hand at once; columns of at most so many values are read once.
AT_ONCE, KEPT = 200_000, 100_000
# Rows that are put in order.
MOST_SORTED = 20_000_000


class Source:
    """Values of columns, read block by block.

    Parameters
    ----------
    dataset : xarray.Dataset
    columns : mapping of str to Column
    dims : tuple of str
        What the rows run along.
    """

    def __init__(self, dataset: xr.Dataset, columns: Mapping[str, Column], dims: tuple[str, ...]) -> None:
        self.dataset, self.columns, self.dims = dataset, columns, dims
        self.shape = tuple(dataset.sizes[dim] for dim in dims)
        self.size = prod(self.shape)
        self._known: dict[str, NDArray[Any]] = {}
        self._last: tuple[Any, Rows] = (None, {})

    def extent(self, block: tuple[slice, ...]) -> tuple[int, ...]:
        """Shape of a block."""
        rest = self.shape[len(block) :]
        return (*(len(range(*part.indices(n))) for part, n in zip(block, self.shape, strict=False)), *rest)

    def arrays(self, names: Iterable[str], block: tuple[slice, ...]) -> Rows:
        """Values in a block, with length 1 along every dimension that a column does not have."""
        if self._last[0] != block:
            self._last = (block, {})
        values = self._last[1]
        for name in names:
            if name not in values:
                values[name] = self._values(self.columns[name], block)
        return values

    def take(self, names: Sequence[str], block: tuple[slice, ...], places: NDArray[np.intp]) -> Rows:
        """Values at some places of a block."""
        arrays = self.arrays(names, block)
        # Without dimensions there is one row.
        index = np.unravel_index(places, self.extent(block)) if self.dims else ()
        rows: Rows = {}
        for name in names:
            values = arrays[name]
            place = [0 if n == 1 else at for at, n in zip(index, values.shape, strict=True)]
            # With the dots it stays an array.
            rows[name] = values[(*place, ...)]
            if rows[name].shape != places.shape:
                rows[name] = np.full(places.shape, rows[name], dtype=values.dtype)
        return rows

    def _values(self, column: Column, block: tuple[slice, ...]) -> NDArray[Any]:
        if column.calculate is None:
            return self._array(column, dict(zip(self.dims, block, strict=False)))
        values = np.asarray(column.calculate(self.arrays([each.name for each in column.inputs], block)))
        return values if values.ndim else values.reshape([1] * len(self.dims))

    def _array(self, column: Column, block: Mapping[str, slice]) -> NDArray[Any]:
        index = {dim: part for dim, part in block.items() if dim in column.dims}
        dims, own = column.dims, column.values
        if own is None:
            variable = self.dataset.variables[column.name]
            try:
                if variable.size <= KEPT and column.name not in self._known:
                    self._known[column.name] = np.asarray(variable.values)
                own = self._known.get(column.name)
                if own is None:
                    own, index = np.asarray(variable.isel(index).values), {}
            except (OSError, RuntimeError) as problem:
                raise InputError(f"{column.name}: it cannot be read, the file is damaged: {problem}") from None
        part: tuple[Any, ...] = (*(index.get(dim, slice(None)) for dim in dims), ...)
        values: NDArray[Any] = own[part]
        ordered = [dim for dim in self.dims if dim in dims]
        values = values.transpose([dims.index(dim) for dim in ordered])
        lengths = iter(values.shape)
        shaped: NDArray[Any] = values.reshape([next(lengths) if dim in dims else 1 for dim in self.dims])
        return shaped


@dataclass(frozen=True, eq=False)
class Selection:
    """A query of a result that was understood; nothing is read before its rows are.

    Attributes
    ----------
    columns : tuple of Column
        What is shown.
    source : Source
    conditions : tuple
        Names and, from their values, what is true of a row that is chosen; the cheapest first.
    padded : tuple of Column
        A row without a value in any of them is left out.
    order : Order
    limit : int, optional
        So many rows at most.
    """

    columns: tuple[Column, ...]
    source: Source
    conditions: tuple[tuple[tuple[str, ...], Callable[[Rows], Any]], ...]
    padded: tuple[Column, ...]
    order: Order
    limit: int | None

    def rows(self) -> Iterator[Rows]:
        """The rows, some at a time: arrays by name; codes where words are shown."""
        names = [column.name for column in self.columns]
        if self.order:
            yield from self._sorted(names)
            return
        left = self.limit
        for block, places, _ in self._chosen():
            taken = places if left is None else places[:left]
            if len(taken):
                yield self.source.take(names, block, taken)
            left = None if left is None else left - len(taken)
            if left == 0:
                return

    def _chosen(self) -> Iterator[tuple[tuple[slice, ...], NDArray[np.intp], int]]:
        """Each block with the places in it of the rows that are chosen, and how many rows come before it."""
        before = 0
        for block in blocks(self.source.shape, AT_ONCE) if self.limit != 0 and self.source.size else ():
            shape = self.source.extent(block)
            chosen: Any = np.ones((), dtype=bool)
            for names, decide in self.conditions:
                chosen = chosen & decide(self.source.arrays(names, block))
                if not np.any(chosen):
                    break
            if np.any(chosen) and self.padded:
                values = self.source.arrays([column.name for column in self.padded], block)
                absent = [column.missing(values[column.name]) for column in self.padded]
                chosen = chosen & ~np.logical_and.reduce(np.broadcast_arrays(*absent))
            yield block, np.flatnonzero(np.broadcast_to(chosen, shape)), before
            before += prod(shape)

    def _sorted(self, names: Sequence[str]) -> Iterator[Rows]:
        """The same in order: first what decides it, then the columns of the rows that are left."""
        places = np.empty(0, dtype=np.intp)
        keys: list[NDArray[Any]] = []
        for block, chosen, before in self._chosen():
            if len(chosen):
                new = self.source.take([column.name for column, _ in self.order], block, chosen)
                more = [new[column.name] for column, _ in self.order]
                keys = [np.concatenate(pair) for pair in zip(keys, more, strict=True)] if keys else more
                places = np.concatenate([places, chosen + before])
            if self.limit is not None and len(places) > 2 * self.limit + AT_ONCE:
                best = np.sort(ordered(self.order, keys)[: self.limit])
                places, keys = places[best], [key[best] for key in keys]
            if len(places) > MOST_SORTED:
                raise InputError(
                    f"sort: more than {MOST_SORTED} rows are to be sorted; give a limit, or choose fewer"
                )
        places = places[ordered(self.order, keys)[: self.limit]] if keys else places
        whole: Rows = {}
        ranks = np.argsort(places, kind="stable")
        before, done = 0, 0
        for block in blocks(self.source.shape, AT_ONCE) if len(places) else ():
            after = before + prod(self.source.extent(block))
            until = int(np.searchsorted(places, after, sorter=ranks))
            if until > done:
                part = self.source.take(names, block, places[ranks[done:until]] - before)
                for name, values in part.items():
                    whole.setdefault(name, np.empty(len(places), dtype=values.dtype))[ranks[done:until]] = values
            before, done = after, until
        for start in range(0, len(places), AT_ONCE):
            yield {name: values[start : start + AT_ONCE] for name, values in whole.items()}


def ordered(order: Order, keys: Sequence[NDArray[Any]]) -> NDArray[np.intp]:
    """Places of rows in the order of their keys, an array a column: equal ones stay, missing ones come last."""
    ranks: list[NDArray[Any]] = []
    for (column, descending), key in zip(order, keys, strict=True):
        absent = column.missing(key)
        rank = np.unique(key.astype(str), return_inverse=True)[1] if column.kind == TEXT else key.astype(float)
        # The last of `lexsort`'s keys is its first.
        ranks = [np.where(absent, 0.0, -rank if descending else rank), absent, *ranks]
    return np.lexsort(ranks)
