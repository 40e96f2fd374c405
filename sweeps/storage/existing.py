"""A finished file as a source: its points, and the computations behind them, to be taken up again."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from sweeps.compute.batch import DONE, FAILED, Table
from sweeps.errors import StoreError
from sweeps.grid import Grid
from sweeps.storage.manifest import Layout
from sweeps.storage.merge import KeyedSource, Pairs, pairs
from sweeps.storage.parts import NETCDF, as_texts, read_table

# The group of a file that holds computations as they were before they were scaled to their points.
COMPUTED = "computed"


def blocks(shape: tuple[int, ...], most: int) -> list[tuple[slice, ...]]:
    """Cut an array of this shape, in C order, into blocks of at most so many entries, or one."""
    inner = 1
    for depth in reversed(range(len(shape))):
        if inner * shape[depth] > most:
            break
        inner *= shape[depth]
    else:
        return [()]
    step = max(most // inner, 1)
    cuts = [slice(k, min(k + step, shape[depth])) for k in range(0, shape[depth], step)]
    outer = (tuple(slice(k, k + 1) for k in index) for index in np.ndindex(shape[:depth]))
    return [(*index, cut) for index in outer for cut in cuts]


@dataclass(frozen=True, eq=False)
class FileSource:
    """The points of a finished file, or those of one block of it.

    Attributes
    ----------
    path : Path
    grid : Grid
        The file's.
    index : tuple of slice
        The block, along the first dimensions; () for the whole.
    """

    path: Path
    grid: Grid
    index: tuple[slice, ...] = ()

    @property
    def own(self) -> bool:
        """Its rows are points, each with its own factors."""
        return True

    @property
    def name(self) -> str:
        """The file."""
        return str(self.path)

    @property
    def _flat(self) -> NDArray[np.intp]:
        return self.grid.place(self.grid, self.index)

    def read(self, wanted: Collection[str]) -> Table:
        """The block's points.

        Raises
        ------
        StoreError
            If the file is damaged.
        """
        flat = self._flat
        try:
            with NETCDF, netCDF4.Dataset(self.path) as file:
                file.set_auto_maskandscale(False)
                file.set_auto_chartostring(False)

                def part(name: str) -> NDArray[Any]:
                    values = np.asarray(file[name][(*self.index, ...)])
                    return values.reshape(len(flat), *file[name].shape[len(self.grid.shape) :])

                status = part("status")
                values = {name: part(name) for name in wanted}
                none = np.full((3, len(flat)), "", dtype=object)
                table = Table({}, [], values, status, none[0], none[1], none[2], part("wall_time"))
                failed = np.flatnonzero(status == FAILED)
                if len(failed):
                    # Texts are padded characters.
                    table.error[failed] = as_texts(part("error")[failed])
                if len(failed) and "failure" in file.dimensions:
                    self._failures(file, table, flat)
        except (OSError, RuntimeError, KeyError, IndexError, ValueError) as problem:
            raise _damaged(self.path, problem) from None
        return table

    def _failures(self, file: Any, table: Table, flat: NDArray[np.intp]) -> None:
        told = [file[f"failure_{name}"][...] for name in self.grid.axes]
        columns = [as_texts(each).astype(str) if each.dtype.kind == "S" else each for each in told]
        known = Layout("", "", self.grid, {}, {}, np.arange(self.grid.size)).at(columns)
        traceback, reproduce = as_texts(file["traceback"][...]), as_texts(file["reproduce"][...])
        rows = np.searchsorted(flat, known)
        for k in np.flatnonzero(np.isin(known, flat)):
            table.traceback[rows[k]], table.reproduce[rows[k]] = traceback[k], reproduce[k]

    def points(self, layout: Layout, table: Table) -> Pairs:
        """Points of the layout that get something."""
        place = layout.grid.place(self.grid, self.index)
        rows = np.flatnonzero((place >= 0) & ((table.status == DONE) | (table.status == FAILED)))
        place = place[rows]
        itself = np.ones(len(rows), dtype=bool)
        if layout.key is None or any(variable.scale for variable in layout.variables.values()):
            return place, rows, itself
        # Without factors a point's result is its computation's, so its copies have it too.
        original, first = np.unique(layout.original[place], return_index=True)
        copies, row, _ = pairs(layout, original)
        here = np.zeros(layout.grid.size, dtype=bool)
        here[place] = True
        new = ~here[copies]
        return (
            np.concatenate([place, copies[new]]),
            np.concatenate([rows, rows[first[row[new]]]]),
            np.concatenate([itself, np.zeros(np.count_nonzero(new), dtype=bool)]),
        )


@dataclass(frozen=True)
class ComputedSource(KeyedSource):
    """The computations of a finished file, before they were scaled."""

    path: Path

    @property
    def name(self) -> str:
        """The file."""
        return str(self.path)

    def read(self, wanted: Collection[str]) -> Table | None:
        """All of them."""
        try:
            with NETCDF, netCDF4.Dataset(self.path) as file:
                file.set_auto_maskandscale(False)
                return read_table(file.groups[COMPUTED], wanted)
        except (OSError, RuntimeError, KeyError, IndexError, ValueError) as problem:
            raise _damaged(self.path, problem) from None


def _damaged(path: Path, problem: Exception) -> StoreError:
    return StoreError(f"{path} is damaged ({problem}); move it away, or start over with fresh (--fresh)")
