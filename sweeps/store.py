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
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from sweeps.assemble import ShardSource, Source
from sweeps.errors import StoreError
from sweeps.fingerprint.identity import differences
from sweeps.finished import COMPUTED, ComputedSource, FileSource, blocks
from sweeps.grid import Axis, Grid
from sweeps.keys import column
from sweeps.layout import LARGE, Layout
from sweeps.shards import NETCDF, ShardFolder

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
    fresh : bool
        Whether the finished file beside the shards is to be replaced rather than completed.
    """

    grid: Grid
    sources: list[Source]
    attributes: dict[str, str]
    finished: bool
    fresh: bool = False


def kept(store: Store, name: str, identity: dict[str, Any]) -> Kept | None:
    """What can be resumed; None where there is nothing.

    Raises
    ------
    StoreError
        If what is there belongs to something else; the message says what differs.
    """
    layout = _unfinished(store, name)
    if layout is None:
        return _finished(store.file, name, identity) if store.file.exists() else None
    try:
        _same(store.parts, layout.attributes, identity)
    except StoreError as problem:
        if layout.fresh and store.file.exists():
            raise StoreError(f"{problem}; or remove {store.parts} to keep {store.file.name} as it is") from None
        raise
    sources: list[Source] = []
    if store.file.exists() and not layout.fresh:
        sources += _finished(store.file, name, identity).sources
    sources += [ShardSource(store.shards, shard) for shard in store.shards.names()]
    return Kept(layout.grid, sources, dict(layout.attributes), False, layout.fresh)


def _unfinished(store: Store, name: str) -> Layout | None:
    """The layout of a run that was not finished; None where there is none."""
    # A layout that cannot be read was never finished: a run was killed at its very beginning.
    with suppress(ValueError):
        layout = Layout.load(store.layout)
        if layout.name != name:
            raise StoreError(
                f"{store.parts} holds the results of {layout.name}; the results of {name} need another folder"
            )
        return layout
    return None


def check_replaceable(store: Store, name: str) -> None:
    """Refuse to start over where that would destroy the results of anything but the sweep `name`.

    Raises
    ------
    StoreError
        If there is something else.
    """
    if store.file.exists():
        check_owner(store.file, name)
    _unfinished(store, name)


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
        different = differences(stored, identity)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise StoreError(
            f"{path} does not say what made it; start over with fresh (--fresh), or choose another folder (--out)"
        ) from None
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
