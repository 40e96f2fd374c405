"""The results that a store has: a finished file, the parts of an unfinished run, or both.

A run resumes them (`existing`); readers open them (`open_results`).
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from sweeps.errors import ANEW, MOVE, UNREADABLE, DamagedError, InputError, MissingFileError, StoreError, message
from sweeps.fingerprint.identity import differences
from sweeps.grid import Axis, Grid
from sweeps.storage.assemble import FileSource, Source, Table, assemble, declared, open_netcdf
from sweeps.storage.netcdf import CHECKED, check_checksum, described
from sweeps.storage.parts import Manifest, PartSource
from sweeps.storage.store import Store, check_regular, signature

# A file up to this size is read at once, so that it can be replaced meanwhile.
READ_AT_ONCE = 50_000_000


class Existing(NamedTuple):
    """The results of a store, and attributes of their sweep; `manifest` is that of an unfinished run."""

    grid: Grid
    sources: list[Source]
    attributes: Mapping[str, str]
    manifest: Manifest | None = None


def existing(store: Store, name: str, fingerprint: dict[str, Any]) -> Existing | None:
    """The results that a sweep resumes; None if there are none. A `StoreError` says what differs."""
    manifest = _unfinished(store, name)
    if manifest is None:
        return _finished(store, name, fingerprint) if store.file.exists() else None
    replaces = manifest.fresh and store.file.exists()
    keep = f"; or remove {store.parts} to keep {store.file.name} as it is" if replaces else ""
    _check_same(store.parts, manifest.attributes, fingerprint, keep)
    return Existing(manifest.grid, sources_of(store, manifest, strict=True), manifest.attributes, manifest)


def check_replaceable(store: Store, name: str) -> None:
    """Refuse to start over where that would destroy the results of anything but the sweep `name`."""
    if store.file.exists():
        _attributes(store, name)
    try:
        _unfinished(store, name)
    except StoreError as problem:
        # Starting over is what a damaged manifest needs.
        if "--fresh" not in str(problem):
            raise


def sources_of(store: Store, manifest: Manifest, *, strict: bool = False, complete: bool = True) -> list[Source]:
    """The sources of a manifest's points; a finished file that is unusable is left out unless `strict`."""
    parts: list[Source] = [PartSource(store.parts / name) for name in store.part_names()]
    if not manifest.fresh and store.file.exists():
        try:
            fingerprint = json.loads(manifest.attributes["fingerprint"])
            return _finished(store, manifest.name, fingerprint, complete=complete).sources + parts
        except StoreError:
            if strict:
                raise
    return parts


def _unfinished(store: Store, name: str) -> Manifest | None:
    manifest = Manifest.load(store)
    if manifest is not None and manifest.name != name:
        whose = f"has the results of {manifest.name}"
        raise StoreError(f"{store.parts} {whose}; the results of {name} need another folder")
    return manifest


def _finished(store: Store, name: str, fingerprint: dict[str, Any], *, complete: bool = True) -> Existing:
    """A finished file; readers of its status alone do not check all of it (`complete`)."""
    path = store.file
    attributes = _attributes(store, name, complete=complete)
    _check_same(path, attributes, fingerprint)
    try:
        stored = json.loads(attributes["fingerprint"])
        with open_netcdf(path, cache=False) as data:
            axes = {axis: Axis(data[axis].values) for axis in stored["axes"]}
            shape = data["status"].shape
        grid = Grid(axes, stored["groups"])
        texts = {axis: each.values.dtype.kind == "U" for axis, each in grid.axes.items()}
        if grid.shape != shape or texts != {axis: each["text"] for axis, each in stored["axes"].items()}:
            raise InputError("its axes do not fit its points")
        environments = json.loads(attributes["environments"])
    except UNREADABLE as problem:
        raise StoreError(f"{path} is damaged: {problem}; {MOVE}") from None
    return Existing(grid, [FileSource(path, grid, environments)], attributes)


def _attributes(store: Store, name: str, *, complete: bool = False) -> dict[str, Any]:
    """The attributes of a finished file of the sweep `name`; anything else is never overwritten."""
    path = store.file
    if not os.access(path, os.R_OK):
        raise StoreError(f"{path} cannot be read, so it may be anybody's; choose another folder")
    try:
        check_regular(path)
        if complete and path.stat().st_size <= CHECKED:
            check_checksum(path)
        with open_netcdf(path, decode_cf=False) as file:
            attributes = dict(file.attrs)
    except StoreError:
        raise
    except UNREADABLE:
        raise StoreError(f"{path} is damaged or not netCDF; {MOVE}") from None
    owner = attributes.get("sweep")
    if owner != name:
        whose = f"has the results of {owner}" if owner else "was not made by a sweep"
        raise StoreError(f"{path} {whose}; the results of {name} need another folder")
    return attributes


def _check_same(place: Path, attributes: Mapping[str, Any], fingerprint: dict[str, Any], keep: str = "") -> None:
    try:
        different = differences(json.loads(attributes["fingerprint"]), fingerprint)
    except UNREADABLE:
        raise StoreError(f"{place} does not say what made it; {ANEW}{keep}") from None
    if different:
        raise StoreError(f"{place} has other results: {different}; {ANEW}{keep}")


def open_results(path: str | Path) -> xr.Dataset:
    """Open a sweep's netCDF file, or the finished points of a run that goes on or was interrupted.

    A file of moderate size is read into memory; of a larger one, large variables are read when they are used. Of
    an unfinished run these are Dask arrays over its parts.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it is not the result of a sweep.
    """
    return declared(opened(path))


def opened(path: str | Path) -> xr.Dataset:
    """The same with the variables as the file represents them."""
    store = Store(path)
    if store.manifest.is_file():
        try:
            return _opened_parts(store)
        except StoreError as problem:
            # Unless the run has finished meanwhile.
            if store.manifest.is_file() and not store.file.exists():
                raise InputError(str(problem)) from None
    if not store.file.exists():
        raise MissingFileError(f"{path}: there is no such file")
    if not store.file.is_file():
        raise InputError(f"{path}: it is not a regular file")
    if not os.access(store.file, os.R_OK):
        raise InputError(f"{path}: it cannot be read")
    try:
        data = _read(store.file)
    except StoreError as problem:
        raise InputError(str(problem)) from None
    except UNREADABLE:
        raise InputError(f"{path}: it is damaged or not netCDF") from None
    try:
        check_result(data.attrs, data.variables)
    except UNREADABLE as problem:
        raise InputError(f"{path}: it is not the result of a sweep: {message(problem)}") from None
    return data


def check_result(attributes: Mapping[Any, Any], variables: Mapping[Any, Any]) -> None:
    """Raise a ValueError or KeyError unless a file has what readers of a sweep's results need."""
    if not isinstance(attributes.get("configuration"), str):
        raise InputError("it has no configuration")
    configuration = json.loads(attributes["configuration"])
    for name, kind in (("name", str), ("axes", dict), ("constants", dict)):
        if not isinstance(configuration[name], kind):
            raise InputError(f"its configuration has no {name}")
    for name in (*configuration["axes"], "status"):
        if name not in variables:
            raise InputError(f"it has no variable {name}")


def _read(path: Path) -> xr.Dataset:
    if path.stat().st_size <= CHECKED:
        check_checksum(path)
    data = open_netcdf(path)
    if data.nbytes <= READ_AT_ONCE:
        with data:
            return data.load()
    for name in data.variables:
        if data[name].nbytes * 10 <= READ_AT_ONCE:
            data[name].load()
    return data


def _opened_parts(store: Store) -> xr.Dataset:
    """The points that are finished so far; the others, and those of damaged parts, are pending."""
    before = signature(store.file)
    manifest = Manifest.load(store)
    if manifest is None:
        raise StoreError(f"{store.file} was finished while its parts were read")
    table, data = Table(manifest, sources_of(store, manifest)), None
    while data is None:
        try:
            data = described(manifest, assemble(table, lazy=True), None)
        except DamagedError as problem:
            table = Table(manifest, [each for each in table.used() if each.name != problem.part])
    # A new file may be there while the parts still are, with its points at other places than the old one.
    if not store.manifest.is_file() or signature(store.file) != before:
        raise StoreError(f"{store.file} was finished while its parts were read")
    return data
