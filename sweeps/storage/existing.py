"""What a store holds already: a finished file, the parts of a run that was not finished, or both."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from sweeps.errors import StoreError
from sweeps.fingerprint.identity import differences
from sweeps.grid import Axis, Grid
from sweeps.storage.manifest import LARGE, Manifest
from sweeps.storage.sources import COMPUTED, ComputedSource, FileSource, PartSource, Source, blocks
from sweeps.storage.store import Store
from sweeps.storage.texts import NETCDF

# What a file or a manifest says of its sweep.
ATTRIBUTES = ("configuration", "identity", "presentation", "libraries")


@dataclass(frozen=True, eq=False)
class Existing:
    """What a store holds already.

    Attributes
    ----------
    grid : Grid
    sources : list of Source
    attributes : dict of str to str
        `configuration`, `identity` and `presentation`.
    manifest : Manifest or None
        Of a run that was not finished; None where all there is is in the finished file.
    """

    grid: Grid
    sources: list[Source]
    attributes: dict[str, str]
    manifest: Manifest | None = None


def existing(store: Store, name: str, identity: dict[str, Any]) -> Existing | None:
    """What can be resumed; None where there is nothing.

    Raises
    ------
    StoreError
        If what is there belongs to something else; the message says what differs.
    """
    manifest = _unfinished(store, name)
    if manifest is None:
        return _finished(store.file, name, identity) if store.file.exists() else None
    try:
        _same(store.parts, manifest.attributes, identity)
    except StoreError as problem:
        if manifest.fresh and store.file.exists():
            raise StoreError(f"{problem}; or remove {store.parts} to keep {store.file.name} as it is") from None
        raise
    sources: list[Source] = []
    if store.file.exists() and not manifest.fresh:
        sources += _finished(store.file, name, identity).sources
    return Existing(manifest.grid, sources + _parts(store), dict(manifest.attributes), manifest)


def _parts(store: Store) -> list[Source]:
    folder = store.folder
    return [PartSource(folder, name) for name in folder.names()]


def _unfinished(store: Store, name: str) -> Manifest | None:
    """The manifest of a run that was not finished; None where there is none."""
    # A manifest that cannot be read was never finished: a run was killed at its very beginning.
    with suppress(ValueError):
        manifest = Manifest.load(store.manifest)
        if manifest.name != name:
            raise StoreError(
                f"{store.parts} holds the results of {manifest.name}; the results of {name} need another folder"
            )
        return manifest
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


def sources_of(store: Store, manifest: Manifest) -> list[Source]:
    """All sources of a manifest's points, for a reader who has no sweep."""
    sources: list[Source] = []
    if store.file.is_file() and not manifest.fresh:
        with suppress(StoreError):
            sources += _finished(store.file, manifest.name, json.loads(manifest.attributes["identity"])).sources
    return sources + _parts(store)


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
            found = {key: file.getncattr(key) for key in file.ncattrs()}
    except (OSError, RuntimeError):
        raise StoreError(f"{path} is damaged or not netCDF; move it away or choose another folder") from None
    owner = found.get("sweep")
    if owner != name:
        whose = f"holds the results of {owner}" if owner else "was not made by a sweep"
        raise StoreError(f"{path} {whose}; the results of {name} need another folder")
    return found


def _axis(variable: Any) -> Axis:
    values = np.asarray(variable[...])
    return Axis(values.astype(str) if values.dtype.kind == "O" else values)


def _finished(path: Path, name: str, identity: dict[str, Any] | None) -> Existing:
    """A finished file as sources."""
    found = check_owner(path, name)
    if identity is not None:
        _same(path, found, identity)
    stored = json.loads(found["identity"])
    try:
        with NETCDF, netCDF4.Dataset(path) as file:
            axes = {axis: _axis(file[axis]) for axis in stored["axes"]}
            grid = Grid(axes, [tuple(group) for group in stored["groups"] if len(group) > 1])
            kept = file.groups[COMPUTED].dimensions if COMPUTED in file.groups else {}
            computations = len(kept.get("computation", ()))
            row = max(
                variable.dtype.itemsize * int(np.prod(variable.shape[len(grid.shape) :]))
                for name, variable in file.variables.items()
                if name in stored["variables"]
            )
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, IndexError):
        raise StoreError(f"{path} is damaged; move it away, or start over with fresh (--fresh)") from None
    most = max(LARGE // row, 1)
    sources: list[Source] = [FileSource(path, grid, index) for index in blocks(grid.shape, most)]
    parts = [slice(k, k + most) for k in range(0, computations, most)]
    sources += [ComputedSource(path, grid, part) for part in parts]
    attributes = {key: str(found[key]) for key in ATTRIBUTES if key in found}
    return Existing(grid, sources, attributes)
