"""Where computed points are kept: parts, a finished file, or this process's memory.

Each source tells first which points it holds, at little cost (`held`), and gives their values when they are wanted
(`read`, of all its rows). Its rows are those of points, factors included, if it is `scaled`, else of computations.
Of a damaged part both give None; a damaged file is a StoreError.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np
from numpy.typing import NDArray

from sweeps.compute.batch import BatchResult, Failure
from sweeps.compute.values import unscaled
from sweeps.errors import StoreError
from sweeps.grid import DONE, FAILED, Grid
from sweeps.storage.manifest import Manifest
from sweeps.storage.parts import PartFolder
from sweeps.storage.texts import NETCDF, as_texts

# The group of a file that holds computations as they were before they were scaled to their points.
COMPUTED = "computed"


class Held(NamedTuple):
    """Points that a source holds: the row of each, whether it failed, and whether it was computed as this point.

    `seconds` is the computing time of all of them.
    """

    points: NDArray[np.intp]
    rows: NDArray[np.intp]
    failed: NDArray[np.bool_]
    computed: NDArray[np.bool_]
    seconds: float


def of_computations(
    manifest: Manifest, points: NDArray[np.intp], failed: NDArray[np.bool_], seconds: float
) -> Held:
    """Every computation goes to its representative and to all copies of that; -1 goes nowhere."""
    stand_for = np.where(points >= 0, manifest.representatives(points), -1)
    every, rows = manifest.copies(stand_for)
    return Held(every, rows, failed[rows], every == stand_for[rows], seconds)


@dataclass(frozen=True)
class PartSource:
    """A part on disk."""

    folder: PartFolder
    name: str
    scaled = False

    def held(self, manifest: Manifest) -> Held | None:
        """The points of the manifest's grid that get something."""
        contents = self.folder.contents(self.name)
        points = None if contents is None else manifest.located(contents.manifest, contents.points)
        if contents is None or points is None:
            return None
        failed = np.zeros(len(points), dtype=bool)
        failed[contents.failed] = True
        return of_computations(manifest, points, failed, contents.seconds)

    def read(self, variables: Collection[str], reasons: bool = True) -> BatchResult | None:
        """Its rows with the values of some variables."""
        return self.folder.read(self.name, variables, reasons)


@dataclass(frozen=True, eq=False)
class ResultSource:
    """The result of a batch, in memory."""

    points: NDArray[np.intp]
    result: BatchResult
    scaled = False
    name = "memory"

    def held(self, manifest: Manifest) -> Held:
        """The points of the manifest's grid that get something."""
        failed = np.zeros(len(self.points), dtype=bool)
        failed[list(self.result.failures)] = True
        return of_computations(manifest, self.points, failed, float(self.result.wall_time.sum()))

    def read(self, variables: Collection[str], reasons: bool = True) -> BatchResult:
        """The result."""
        return self.result


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
    scaled = True

    @property
    def name(self) -> str:
        """The file."""
        return str(self.path)

    @property
    def _points(self) -> NDArray[np.intp]:
        """The block's points in the file's grid: neighbours, for a block is one of `blocks`."""
        shape = self.grid.shape
        first = [each.start for each in self.index] + [0] * (len(shape) - len(self.index))
        lengths = [each.stop - each.start for each in self.index] + list(shape[len(self.index) :])
        return int(np.ravel_multi_index(first, shape)) + np.arange(int(np.prod(lengths, dtype=np.int64)))

    def _part(self, file: Any, name: str) -> NDArray[Any]:
        values = np.asarray(file[name][(*self.index, ...)])
        return values.reshape(-1, *file[name].shape[len(self.grid.shape) :])

    def held(self, manifest: Manifest) -> Held:
        """The points of the manifest's grid that get something."""
        with _opened(self.path) as file:
            status = self._part(file, "status").ravel()
            spent = self._part(file, "wall_time").ravel()
        rows = np.flatnonzero((status == DONE) | (status == FAILED))
        points = manifest.grid.embed(self.grid)(self._points[rows])
        rows, points = rows[points >= 0], points[points >= 0]
        seconds, computed = float(np.nansum(spent[rows])), np.ones(len(rows), dtype=bool)
        if manifest.representative is not None and not any(v.scale for v in manifest.variables.values()):
            # Without factors a point's result is its computation's, so its copies have it too.
            stand_for, first = np.unique(manifest.representative[points], return_index=True)
            copies, row = manifest.copies(stand_for)
            new = ~np.isin(copies, points)
            points = np.concatenate([points, copies[new]])
            rows = np.concatenate([rows, rows[first[row[new]]]])
            computed = np.concatenate([computed, np.zeros(np.count_nonzero(new), dtype=bool)])
        return Held(points, rows, status[rows] == FAILED, computed, seconds)

    def read(self, variables: Collection[str], reasons: bool = True) -> BatchResult:
        """The block's points with the values of some variables."""
        with _opened(self.path) as file:
            values = {name: self._part(file, name) for name in variables}
            result = BatchResult(values, self._part(file, "wall_time").ravel())
            failed = (
                np.flatnonzero(self._part(file, "status").ravel() == FAILED)
                if reasons
                else np.zeros(0, dtype=np.intp)
            )
            if len(failed):
                errors = as_texts(self._part(file, "error")[failed])
                result.failures |= {row: Failure(text) for row, text in zip(failed.tolist(), errors, strict=True)}
            if len(failed) and "failure" in file.dimensions:
                columns = [file[f"failure_{name}"][...] for name in self.grid.axes]
                found = self.grid.at([as_texts(c).astype(str) if c.dtype.kind == "S" else c for c in columns])
                texts = zip(as_texts(file["traceback"][...]), as_texts(file["reproduce"][...]), strict=True)
                for row, about in zip((found - self._points[0]).tolist(), texts, strict=True):
                    if row in result.failures:
                        result.failures[row] = Failure(result.failures[row].error, *about)
        return result


@dataclass(frozen=True, eq=False)
class ComputedSource:
    """Computations of a finished file as they were before they were scaled: what its points lack to be that.

    Attributes
    ----------
    path : Path
    grid : Grid
        The file's.
    part : slice
        Which of the computations.
    """

    path: Path
    grid: Grid
    part: slice
    scaled = False

    @property
    def name(self) -> str:
        """The file."""
        return str(self.path)

    def held(self, manifest: Manifest) -> Held:
        """The points of the manifest's grid that get something."""
        with _opened(self.path) as file:
            group = file.groups[COMPUTED]
            points = manifest.grid.embed(self.grid)(group["computation"][self.part])
            failed, spent = group["status"][self.part] == FAILED, float(group["wall_time"][self.part].sum())
        return of_computations(manifest, points, failed, spent)

    def read(self, variables: Collection[str], reasons: bool = True) -> BatchResult:
        """Some of them with the values of some variables."""
        with _opened(self.path) as file:
            group = file.groups[COMPUTED]
            points = group["computation"][self.part]
            values = {name: self._values(file, group, name, points) for name in variables}
            result = BatchResult(values, group["wall_time"][self.part])
            if reasons and "error" in group.variables:
                texts = [as_texts(group[name][self.part]) for name in ("error", "traceback", "reproduce")]
                for row in np.flatnonzero(group["status"][self.part] == FAILED).tolist():
                    result.failures[row] = Failure(*(each[row] for each in texts))
        return result

    def _values(self, file: Any, group: Any, name: str, points: NDArray[np.intp]) -> NDArray[Any]:
        """A variable at the points themselves, as it was before it was scaled."""
        shape, rows = self.grid.shape, []
        for begin, end in runs(points, shape[-1]):
            *outer, last = np.unravel_index(points[begin], shape)
            rows.append(np.asarray(file[name][(*outer, slice(last, last + end - begin))]))
        values = np.concatenate(rows)
        if f"residual_{name}" not in group.variables:
            return values
        residuals = group[f"residual_{name}"]
        factor = group[f"factor_{name}"][self.part]
        return unscaled(values, factor, int(residuals.digits) or None, residuals[self.part])


Source = PartSource | ResultSource | FileSource | ComputedSource


def runs(points: NDArray[np.intp], length: int) -> Iterator[tuple[int, int]]:
    """Where neighbours along a last dimension of this length begin and end among ascending points."""
    breaks = np.flatnonzero((np.diff(points) != 1) | (points[1:] % length == 0)) + 1
    yield from pairwise([0, *breaks.tolist(), len(points)])


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A netCDF file as it is stored; what is wrong with it is a StoreError."""
    try:
        with NETCDF, netCDF4.Dataset(path) as file:
            file.set_auto_maskandscale(False)
            file.set_auto_chartostring(False)
            yield file
    except (OSError, RuntimeError, LookupError, ValueError) as problem:
        raise StoreError(
            f"{path} is damaged ({problem}); move it away, or start over with fresh (--fresh)"
        ) from None
