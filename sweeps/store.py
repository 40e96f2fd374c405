"""Where a sweep is kept: one CF netCDF file, and beside it, until it is whole, a folder of finished shards.

STUDY.nc            the result; replaced as a whole, never written into
STUDY.parts/        while a run goes on, or after it was interrupted:
    layout.nc           what the result will look like
    000001-….nc         shards
    progress.json       how far the run is, and whose it is
.STUDY.nc.lock      held by the run
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from sweeps.assemble import KeyedSource, Pairs, ShardSource, Source, pairs
from sweeps.batch import DONE, FAILED, Table
from sweeps.errors import StoreError
from sweeps.grid import Axis, Grid
from sweeps.identity import differences
from sweeps.keys import column
from sweeps.layout import LARGE, Layout
from sweeps.shards import NETCDF, ShardFolder, read_table

# The group of a file that holds computations as they were before they were scaled to their points.
COMPUTED = "computed"
# What a file or a layout says of its sweep.
ATTRIBUTES = ("configuration", "identity", "presentation")


class Store:
    """The files of one sweep; nothing is touched before it is asked for."""

    def __init__(self, path: str | Path) -> None:
        self.file = Path(os.path.abspath(Path(path).expanduser()))
        self.parts = self.file.with_name(f"{self.file.stem}.parts")
        self.lock = self.file.with_name(f".{self.file.name}.lock")
        self.layout = self.parts / "layout.nc"
        self.progress = self.parts / "progress.json"

    @property
    def shards(self) -> ShardFolder:
        """The finished shards."""
        return ShardFolder(self.parts)

    def stamp(self) -> tuple[Any, ...]:
        """Changes whenever another run has been here."""
        marks: list[Any] = list(self.shards.names())
        for path in (self.file, self.layout):
            with suppress(OSError):
                about = path.stat()
                marks += [about.st_ino, about.st_mtime_ns, about.st_size]
        return tuple(marks)

    def check_place(self, name: str) -> None:
        """Refuse, before anything is computed, a place where the results of `name` cannot go."""
        path = self.file
        try:
            if path.is_dir():
                raise StoreError(f"{path} is a folder; the results of {name} need a file there")
            folder = path.parent
            while not folder.exists() and folder != folder.parent:
                if folder.is_symlink():
                    raise StoreError(f"{folder} is a link to nothing; choose another folder")
                folder = folder.parent
            if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
                raise StoreError(f"{folder} cannot be written to; choose another folder")
        except OSError as problem:
            raise StoreError(f"{path} cannot be used: {problem.strerror}; choose another folder") from None

    def clear(self) -> None:
        """Remove the shards."""
        # The layout goes first: without it the folder is nothing.
        self.layout.unlink(missing_ok=True)
        shutil.rmtree(self.parts, ignore_errors=True)


@dataclass(frozen=True, eq=False)
class Kept:
    """What a store holds already.

    Attributes
    ----------
    grid : Grid
    sources : list of Source
    attributes : dict of str to str
        `configuration`, `identity` and `presentation`.
    finished : bool
        Whether all there is is in the finished file.
    """

    grid: Grid
    sources: list[Source]
    attributes: dict[str, str]
    finished: bool


def kept(store: Store, name: str, identity: dict[str, Any]) -> Kept | None:
    """What can be resumed; None where there is nothing.

    Raises
    ------
    StoreError
        If what is there belongs to something else; the message says what differs.
    """
    layout = None
    if store.layout.is_file():
        # A layout that cannot be read was never finished: a run was killed at its very beginning.
        with suppress(ValueError):
            layout = Layout.load(store.layout)
    if layout is None:
        return _finished(store.file, name, identity) if store.file.exists() else None
    _same(store.parts, layout.attributes, identity)
    sources: list[Source] = []
    if store.file.exists() and not layout.fresh:
        sources += _finished(store.file, name, identity).sources
    sources += [ShardSource(store.shards, shard) for shard in store.shards.names()]
    return Kept(layout.grid, sources, dict(layout.attributes), False)


def sources_of(store: Store, layout: Layout) -> list[Source]:
    """All sources of a layout's points, for a reader who has no sweep."""
    sources: list[Source] = []
    if store.file.is_file() and not layout.fresh:
        with suppress(StoreError):
            sources += _finished(store.file, layout.name, json.loads(layout.attributes["identity"])).sources
    return sources + [ShardSource(store.shards, name) for name in store.shards.names()]


def _same(path: Path, attributes: Mapping[str, Any], identity: dict[str, Any]) -> None:
    try:
        stored = json.loads(attributes["identity"])
    except (KeyError, TypeError, ValueError):
        raise StoreError(
            f"{path} does not say what made it; start over with fresh (--fresh), or choose another folder (--out)"
        ) from None
    different = differences(stored, identity)
    if different:
        raise StoreError(
            f"{path} holds something else: {different}; start over with fresh (--fresh), or choose another "
            "folder (--out)"
        )


def check_owner(path: Path, name: str) -> dict[str, Any]:
    """The attributes of a finished file of the sweep `name`.

    Raises
    ------
    StoreError
        If it is anything else: that is never overwritten.
    """
    if not os.access(path, os.R_OK):
        raise StoreError(f"{path} cannot be read, so it may be anybody's; choose another folder")
    try:
        with NETCDF, netCDF4.Dataset(path) as file:
            told = {key: file.getncattr(key) for key in file.ncattrs()}
    except (OSError, RuntimeError):
        raise StoreError(f"{path} is damaged or not netCDF; move it away or choose another folder") from None
    owner = told.get("sweep")
    if owner != name:
        whose = f"holds the results of {owner}" if owner else "was not made by a sweep"
        raise StoreError(f"{path} {whose}; the results of {name} need another folder")
    return told


def _finished(path: Path, name: str, identity: dict[str, Any] | None) -> Kept:
    """A finished file as sources."""
    told = check_owner(path, name)
    if identity is not None:
        _same(path, told, identity)
    stored = json.loads(told["identity"])
    try:
        with NETCDF, netCDF4.Dataset(path) as file:
            axes = {axis: Axis(column(file[axis][...])) for axis in stored["axes"]}
            grid = Grid(axes, [tuple(group) for group in stored["groups"] if len(group) > 1])
            computed = COMPUTED in file.groups
            row = max(
                variable.dtype.itemsize * int(np.prod(variable.shape[len(grid.shape) :]))
                for name, variable in file.variables.items()
                if name in stored["variables"]
            )
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, IndexError):
        raise StoreError(f"{path} is damaged; move it away, or start over with fresh (--fresh)") from None
    sources: list[Source] = [FileSource(path, grid, index) for index in blocks(grid.shape, max(LARGE // row, 1))]
    if computed:
        sources.append(ComputedSource(path))
    attributes = {key: str(told[key]) for key in ATTRIBUTES if key in told}
    return Kept(grid, sources, attributes, True)


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
        every = np.arange(self.grid.size).reshape(self.grid.shape)
        return np.asarray(every[self.index]).ravel()

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
                # Texts are padded characters.
                letters = part("error")
                error = (
                    np.array([_text(row) for row in letters], dtype=object) if (status == FAILED).any() else None
                )
                values = {name: part(name) for name in wanted}
                table = Table(
                    {},
                    [],
                    values,
                    status,
                    np.full(len(flat), "", dtype=object) if error is None else error,
                    np.full(len(flat), "", dtype=object),
                    np.full(len(flat), "", dtype=object),
                    part("wall_time"),
                )
                if "failure" in file.dimensions:
                    self._failures(file, table, flat)
        except (OSError, RuntimeError, KeyError, IndexError, ValueError) as problem:
            raise StoreError(
                f"{self.path} is damaged ({problem}); move it away, or start over with fresh (--fresh)"
            ) from None
        return table

    def _failures(self, file: Any, table: Table, flat: NDArray[np.intp]) -> None:
        columns = [column(file[f"failure_{name}"][...]) for name in self.grid.axes]
        known = Layout("", "", self.grid, {}, {}, np.arange(self.grid.size)).find(columns)
        rows = {int(point): row for row, point in enumerate(flat)}
        for k, point in enumerate(known.tolist()):
            if point in rows:
                table.traceback[rows[point]] = _text(file["traceback"][k])
                table.reproduce[rows[point]] = _text(file["reproduce"][k])

    def points(self, layout: Layout, table: Table) -> Pairs:
        """Points of the layout that get something, and the row of the table for each."""
        place = layout.grid.place(self.grid)[self._flat]
        rows = np.flatnonzero((place >= 0) & ((table.status == DONE) | (table.status == FAILED)))
        place = place[rows]
        if any(variable.scale for variable in layout.variables.values()):
            return place, rows
        # Without factors a point's result is its computation's, so its copies have it too.
        original = layout.original[place]
        some, own = pairs(layout, np.where(original >= 0, original, -1))
        alone = original < 0
        return np.concatenate([some, place[alone]]), np.concatenate([rows[own], rows[alone]])


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
        with NETCDF, netCDF4.Dataset(self.path) as file:
            file.set_auto_maskandscale(False)
            return read_table(file.groups[COMPUTED], wanted)


def _text(letters: Any) -> str:
    """A padded row of characters as text."""
    if isinstance(letters, str):
        return letters
    return bytes(np.asarray(letters).tobytes()).rstrip(b"\0").decode("utf-8", "replace")
