"""Where computed points are kept: parts, a finished file, or this process's memory.

Each source tells first which points it holds, at little cost (`held`), and gives their values when they are wanted
(`read`, of all its rows): results of computations, before they are multiplied by the factors of a point.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np
from numpy.typing import NDArray

from sweeps.compute.batch import BatchResult, Failure
from sweeps.compute.values import unscaled
from sweeps.errors import UNREADABLE, InputError, StoreError, said
from sweeps.fingerprint.provenance import environments_of
from sweeps.grid import DONE, FAILED, Grid
from sweeps.storage.checked import check_declared
from sweeps.storage.manifest import Manifest
from sweeps.storage.parts import PartFolder


class _Lock(type(threading.RLock())):  # type: ignore[misc]
    """A reentrant lock that may be part of what is pickled: elsewhere it stands for the lock of that process."""

    def __reduce__(self) -> str:
        return "NETCDF"


# The netCDF library is not made for several threads at once; xarray is told to use the same lock.
NETCDF = _Lock()
# Of all points, where there is one environment.
FIRST = np.int16(0)
# The group of a file that holds computations as they were before they were scaled to their points.
COMPUTED = "computed"


class DamagedError(StoreError):
    """A part got damaged after it was planned with; `part` is its name."""

    def __init__(self, part: str) -> None:
        super().__init__(f"{part} got damaged; plan and run again")
        self.part = part


class Held(NamedTuple):
    """Points that a source holds: the row of each, whether it failed, and whether it was computed as this point.

    `seconds` is the computing time of all of them, `by` the number of each point's environment in `environments`.
    """

    points: NDArray[np.intp]
    rows: NDArray[np.intp]
    failed: NDArray[np.bool_]
    computed: NDArray[np.bool_]
    seconds: float
    by: NDArray[np.int16]
    environments: list[dict[str, str]]


def _of_computations(
    manifest: Manifest,
    points: NDArray[np.intp],
    failed: Any,
    seconds: float,
    environments: list[dict[str, str]],
    by: NDArray[np.int16] | None = None,
) -> Held:
    """Every computation goes to its representative and to all copies of that; -1 goes nowhere."""
    stand_for = np.where(points >= 0, manifest.representatives(points), -1)
    every, rows = manifest.copies(stand_for)
    flags = np.zeros(len(points), dtype=bool)
    flags[failed] = True
    own = np.broadcast_to(FIRST, rows.shape) if by is None else by[rows]
    return Held(every, rows, flags[rows], every == stand_for[rows], seconds, own, environments)


@dataclass(frozen=True)
class PartSource:
    """A part on disk; if it is damaged or gone, a DamagedError."""

    folder: PartFolder
    name: str

    def held(self, manifest: Manifest) -> Held:
        """The points of the manifest's grid that get something."""
        contents = self.folder.contents(self.name)
        if contents is not None:
            # What is not of its grid is one of these.
            with suppress(LookupError, TypeError, ValueError):
                points = manifest.located(contents.manifest, contents.points)
                if points is not None:
                    about = contents.failed, contents.seconds, [contents.environment]
                    return _of_computations(manifest, points, *about)
        raise DamagedError(self.name)

    def read(self, variables: Collection[str], reasons: bool = True) -> BatchResult:
        """Its rows with the values of some variables."""
        result = self.folder.read(self.name, variables, reasons)
        if result is None:
            raise DamagedError(self.name)
        return result


@dataclass(frozen=True, eq=False)
class ResultSource:
    """The result of a batch, in memory."""

    points: NDArray[np.intp]
    result: BatchResult
    name = "memory"

    def held(self, manifest: Manifest) -> Held:
        """The points of the manifest's grid that get something."""
        seconds = float(self.result.wall_time.sum())
        environments = [self.result.environment]
        return _of_computations(manifest, self.points, list(self.result.failures), seconds, environments)

    def read(self, variables: Collection[str], reasons: bool = True) -> BatchResult:
        """The result."""
        return self.result


@dataclass(frozen=True, eq=False)
class FileSource:
    """Some rows of a finished file; if it is damaged, a StoreError.

    Without factors its rows are the points, and `block` runs along their first dimensions. With factors they are
    the computations (`computed`), of which it keeps what the scaled values of the points lack.
    """

    path: Path
    grid: Grid
    block: tuple[slice, ...] = ()
    computed: bool = False

    @property
    def name(self) -> str:
        """The file."""
        return str(self.path)

    def held(self, manifest: Manifest) -> Held:
        """The points of the manifest's grid that get something."""
        with opened(self.path) as file:
            status, spent = (self._rows(file, name) for name in ("status", "wall_time"))
            rows = np.flatnonzero((status == DONE) | (status == FAILED))
            own = self._points(file)
            points = manifest.grid.embed(self.grid)(own[rows])
            environments = environments_of(vars(file))
            by = np.broadcast_to(FIRST, own.shape)
            if len(environments) != 1:
                by = np.asarray(file["computed_by"][...]).reshape(-1)[own]
                if not np.isin(by[rows], range(len(environments))).all():
                    raise InputError("computed_by has numbers of environments that are not listed")
        if self.computed:
            return _of_computations(manifest, points, status == FAILED, float(spent.sum()), environments, by)
        rows, points = rows[points >= 0], points[points >= 0]
        # Copies have cost nothing.
        computed, seconds = spent[rows] > 0.0, float(np.nansum(spent[rows]))
        if manifest.representative is not None:
            stand_for, first = np.unique(manifest.representative[points], return_index=True)
            copies, row = manifest.copies(stand_for)
            new = ~np.isin(copies, points)
            points = np.concatenate([points, copies[new]])
            rows = np.concatenate([rows, rows[first[row[new]]]])
            computed = np.concatenate([computed, np.zeros(np.count_nonzero(new), dtype=bool)])
        return Held(points, rows, status[rows] == FAILED, computed, seconds, by[rows], environments)

    def read(self, variables: Collection[str], reasons: bool = True) -> BatchResult:
        """Its rows with the values of some variables."""
        with opened(self.path) as file:
            values = {name: self._values(file, name) for name in variables}
            failures = self._failures(file) if reasons else {}
            return BatchResult(values, self._rows(file, "wall_time"), failures)

    def _rows(self, file: Any, name: str) -> NDArray[Any]:
        variable = file[COMPUTED][name] if self.computed else file[name]
        dims = 1 if self.computed else len(self.grid.shape)
        return np.asarray(variable[(*self.block, ...)]).reshape(-1, *variable.shape[dims:])

    def _points(self, file: Any) -> NDArray[np.intp]:
        """The points of the file's grid in which the rows are."""
        if self.computed:
            return self._rows(file, "computation")
        lengths = [each.stop - each.start for each in self.block]
        begin = [each.start for each in self.block] + [0] * (len(self.grid.shape) - len(self.block))
        count = math.prod(lengths) * math.prod(self.grid.shape[len(self.block) :])
        return int(np.ravel_multi_index(begin, self.grid.shape)) + np.arange(count)

    def _values(self, file: Any, name: str) -> NDArray[Any]:
        """A variable as it was before it was scaled."""
        if not self.computed:
            return self._rows(file, name)
        shape, points, rows = self.grid.shape, self._points(file), []
        for begin, end in runs(points, shape[-1]):
            *outer, last = np.unravel_index(points[begin], shape)
            rows.append(np.asarray(file[name][(*outer, slice(last, last + end - begin))]))
        values = np.concatenate(rows)
        if f"residual_{name}" not in file[COMPUTED].variables:
            return values
        factor, lacking = (self._rows(file, f"{what}_{name}") for what in ("factor", "residual"))
        return unscaled(values, factor, int(file[COMPUTED][f"residual_{name}"].digits) or None, lacking)

    def _failures(self, file: Any) -> dict[int, Failure]:
        rows = np.flatnonzero(self._rows(file, "status") == FAILED)
        if not len(rows):
            return {}
        if self.computed:
            columns = [as_texts(self._rows(file, name)[rows]).tolist() for name in Failure._fields]
            return {row: Failure(*texts) for row, *texts in zip(rows.tolist(), *columns, strict=True)}
        errors = as_texts(self._rows(file, "error")[rows])
        failures = {row: Failure(text) for row, text in zip(rows.tolist(), errors.tolist(), strict=True)}
        if "failure" in file.dimensions:
            points = self.grid.at([plain(file[f"failure_{name}"]) for name in self.grid.axes])
            columns = [as_texts(np.asarray(file[name][...])).tolist() for name in ("traceback", "reproduce")]
            texts = zip(*columns, strict=True)
            for row, about in zip((points - self._points(file)[0]).tolist(), texts, strict=True):
                if row in failures:
                    failures[row] = Failure(failures[row].error, *about)
        return failures


Source = PartSource | ResultSource | FileSource


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


def runs(points: NDArray[np.intp], length: int) -> Iterator[tuple[int, int]]:
    """Where neighbours along a last dimension of this length begin and end among ascending points."""
    breaks = np.flatnonzero((np.diff(points) != 1) | (points[1:] % length == 0)) + 1
    yield from pairwise([0, *breaks.tolist(), len(points)])


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A netCDF file with everything as it is stored; if it is damaged, a StoreError."""
    try:
        with NETCDF, netCDF4.Dataset(path) as file:
            check_declared(file)
            file.set_auto_maskandscale(False)
            file.set_auto_chartostring(False)
            yield file
    except StoreError:
        raise
    except UNREADABLE as problem:
        text = f"{path} is damaged ({said(problem)}); move it away, or start over with fresh (--fresh)"
        raise StoreError(text) from None


def plain(variable: Any) -> NDArray[Any]:
    """The values of a variable, texts as such."""
    values = np.asarray(variable[...])
    return as_texts(values) if values.dtype.kind == "S" else values


def as_texts(letters: NDArray[np.bytes_]) -> NDArray[np.str_]:
    """Rows of padded characters as texts."""
    if letters.dtype.kind != "S":
        raise InputError(f"it has {letters.dtype} where texts must be")
    texts = np.ascontiguousarray(letters).view(f"S{letters.shape[-1]}")[..., 0]
    return np.char.decode(texts, "utf-8", "replace")
