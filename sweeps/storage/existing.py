"""What a store holds already: a finished file, the parts of a run that was not finished, or both."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4

from sweeps.errors import UNREADABLE, InputError, StoreError
from sweeps.fingerprint.identity import differences
from sweeps.grid import Axis, Grid
from sweeps.storage.checked import check_heaps, check_regular, check_seal, shapes_of
from sweeps.storage.manifest import LARGE, Manifest
from sweeps.storage.sources import (
    COMPUTED,
    NETCDF,
    FileSource,
    PartSource,
    Source,
    blocks,
    opened,
    plain,
)
from sweeps.storage.store import Store


class Existing(NamedTuple):
    """What a store holds already.

    `attributes` is what it says of its sweep: `configuration`, `identity` and `presentation`.
    `manifest` is that of a run that was not finished; None: everything is in the finished file.
    """

    grid: Grid
    sources: list[Source]
    attributes: Mapping[str, str]
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
        return (
            _of_axes(_finished(store.file, name, identity), store.file, identity) if store.file.exists() else None
        )
    try:
        _check_same(store.parts, manifest.attributes, identity)
    except StoreError as problem:
        if manifest.fresh and store.file.exists():
            raise StoreError(f"{problem}; or remove {store.parts} to keep {store.file.name} as it is") from None
        raise
    found = Existing(manifest.grid, sources_of(store, manifest, strict=True), manifest.attributes, manifest)
    return _of_axes(found, store.parts, identity)


def _of_axes(found: Existing, path: Path, identity: dict[str, Any]) -> Existing:
    """What is there, unless its axes are others than it says: texts in the place of numbers."""
    own = {name: axis.values.dtype.kind == "U" for name, axis in found.grid.axes.items()}
    if own != {name: each["text"] for name, each in identity["axes"].items()}:
        raise StoreError(f"{path} is damaged: its axes are of other types; move it away or choose another folder")
    return found


def check_replaceable(store: Store, name: str) -> None:
    """Refuse to start over where that would destroy the results of anything but the sweep `name`.

    Raises
    ------
    StoreError
        If there is something else.
    """
    if store.file.exists():
        _owned(store.file, name)
    _unfinished(store, name)


def sources_of(store: Store, manifest: Manifest, strict: bool = False) -> list[Source]:
    """All sources of a manifest's points; without a file that is unusable, unless that is an error (`strict`)."""
    folder = store.folder
    parts: list[Source] = [PartSource(folder, name) for name in folder.names()]
    if not manifest.fresh and store.file.exists():
        try:
            identity = json.loads(manifest.attributes["identity"])
            return _finished(store.file, manifest.name, identity).sources + parts
        except StoreError:
            if strict:
                raise
    return parts


def _unfinished(store: Store, name: str) -> Manifest | None:
    """The manifest of a run that was not finished; None where there is none."""
    try:
        manifest = Manifest.load(store.manifest)
    except ValueError:
        # A manifest that cannot be read was never finished: a run was killed at its very beginning.
        return None
    if manifest.name != name:
        raise StoreError(
            f"{store.parts} holds the results of {manifest.name}; the results of {name} need another folder"
        )
    return manifest


def _finished(path: Path, name: str, identity: dict[str, Any]) -> Existing:
    """A finished file, in blocks that memory can hold."""
    try:
        check_seal(path)
        check_heaps(path)
    except InputError as problem:
        raise StoreError(f"{path} is damaged: {problem}; move it away or choose another folder") from None
    except OSError:
        pass  # `_owned` says why it cannot be read
    attributes = _owned(path, name)
    _check_same(path, attributes, identity)
    stored = json.loads(attributes["identity"])
    with opened(path) as file:
        grid = Grid({axis: Axis(plain(file[axis])) for axis in stored["axes"]}, stored["groups"])
        inner = shapes_of(stored) | {"status": (), "wall_time": ()}
        present = [name for name in inner if name in file.variables]
        for name in present:
            if file[name].shape != (*grid.shape, *inner[name]):
                raise InputError(f"{name} has the shape {file[name].shape}, its points {grid.shape}")
        row = max(file[name].dtype.itemsize * math.prod(inner[name]) for name in present)
        computations = len(file[COMPUTED].dimensions["computation"]) if COMPUTED in file.groups else 0
    computed = computations > 0
    cuts = blocks((computations,) if computed else grid.shape, max(LARGE // row, 1))
    return Existing(grid, [FileSource(path, grid, cut, computed) for cut in cuts], attributes)


def _owned(path: Path, name: str) -> dict[str, Any]:
    """The attributes of a finished file of the sweep `name`; anything else is never overwritten."""
    if not os.access(path, os.R_OK):
        raise StoreError(f"{path} cannot be read, so it may be anybody's; choose another folder")
    try:
        check_regular(path)
        with NETCDF, netCDF4.Dataset(path) as file:
            attributes = {name: file.getncattr(name) for name in file.ncattrs()}
    except UNREADABLE:
        raise StoreError(f"{path} is damaged or not netCDF; move it away or choose another folder") from None
    owner = attributes.get("sweep")
    if owner != name:
        whose = f"holds the results of {owner}" if owner else "was not made by a sweep"
        raise StoreError(f"{path} {whose}; the results of {name} need another folder")
    return attributes


def _check_same(path: Path, attributes: Mapping[str, Any], identity: dict[str, Any]) -> None:
    otherwise = "start over with fresh (--fresh), or choose another folder (--out)"
    try:
        different = differences(json.loads(attributes["identity"]), identity)
    except UNREADABLE:
        raise StoreError(f"{path} does not say what made it; {otherwise}") from None
    if different:
        raise StoreError(f"{path} holds something else: {different}; {otherwise}")
