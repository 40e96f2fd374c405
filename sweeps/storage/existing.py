"""Stored results of a sweep, finished or not: runs resume them (`existing`), readers open them."""

import json
import operator
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from sweeps import errors
from sweeps.errors import UNREADABLE, DamagedError, InputError, MissingFileError, StoreError, message
from sweeps.fingerprint.identity import differences, restricted
from sweeps.grid import Axis, Grid, axis_values
from sweeps.storage.assemble import FileSource, Source, Table, assemble, open_netcdf, present, restore_types
from sweeps.storage.netcdf import with_metadata
from sweeps.storage.parts import Manifest, PartSource
from sweeps.storage.store import Store, check_trailer, signature

# The attribute of a file that names the variables of which not all stored points have a value.
PENDING_NAMES = "pending"
# A file up to this size is read at once, so that it can be replaced meanwhile.
READ_AT_ONCE = 50_000_000


class Existing(NamedTuple):
    """The results of a store, and attributes of their sweep; `manifest` is that of an unfinished run."""

    grid: Grid
    sources: list[Source]
    attributes: Mapping[str, str]
    manifest: Manifest | None = None


def existing(
    store: Store, name: str, fingerprint: dict[str, Any], *, code: bool = True, file: bool = True
) -> Existing | None:
    """The results that a sweep resumes; None if there are none. A `StoreError` says what differs.

    Without `code`, results of other code are taken as well; without `file` those of an unfinished run alone.
    """
    if not (manifests := _manifests(store)):
        return _finished(store, name, fingerprint, code=code) if file and store.file.exists() else None
    for place, each in manifests:
        _check_name(place.parts, each.name, name)
        replaces = each.fresh and store.file.exists()
        keep = f"; or remove {place.parts} to keep {store.file.name} as it is" if replaces else ""
        _check_same(place.parts, each.attributes, fingerprint, keep, code=code)
    manifest = _combined(manifests)
    grid = reduce(Grid.union, [each.grid for _, each in manifests])
    return Existing(grid, sources_of(store, manifest, strict=True), manifest.attributes, manifest)


def extended(
    store: Store, name: str, fingerprint: Mapping[str, Any], *, pending: bool = False
) -> tuple[Existing, list[str]] | None:
    """The finished file of the sweep that lacks variables, and their names; None if more than code differs.

    With `pending`, variables also count as lacking if the file has not all their values.
    """
    with suppress(*UNREADABLE), open_netcdf(store.file, cache=False) as data:
        stored = json.loads(data.attrs["fingerprint"])
        same = pending and not differences(stored, restricted(fingerprint, stored))
        incomplete = data.attrs.get(PENDING_NAMES, "").split(", ") if same else []
        lacking = [
            each for each in fingerprint["variables"] if each not in stored["variables"] or each in incomplete
        ]
        if lacking and not differences(stored, restricted(fingerprint, stored), code=False):
            return _finished(store, name, stored), lacking
    return None


def unfinished(store: Store) -> Manifest | None:
    """The manifest of a run, or of shares, whose file is not finished; None if there is none."""
    return _combined(found) if (found := _manifests(store)) else None


def _manifests(store: Store) -> list[tuple[Store, Manifest]]:
    """The manifests of a run and of the shares beside its file."""
    loaded = [(each, Manifest.load(each)) for each in (store, *store.shares())]
    return [(each, manifest) for each, manifest in loaded if manifest is not None]


def _combined(manifests: Sequence[tuple[Store, Manifest]]) -> Manifest:
    """The first manifest, extended by the grids of all."""
    earlier = reduce(operator.or_, [each.grids for _, each in manifests])
    return replace(manifests[0][1], earlier=earlier)


def check_replaceable(store: Store, name: str) -> None:
    """Refuse to start over if that would destroy results of another sweep than `name`."""
    if store.file.exists():
        with open_netcdf(store.file, cache=False) as data:
            _check_name(store.file, data.attrs.get("sweep"), name)
    try:
        _check_name(store.parts, getattr(Manifest.load(store), "name", name), name)
    except StoreError as problem:
        # When a run starts over, a damaged manifest does not matter.
        if errors.HINT_START_OVER not in str(problem):
            raise


def sources_of(store: Store, manifest: Manifest, *, strict: bool = False) -> list[Source]:
    """The sources of a manifest's points; a finished file that is unusable is left out unless `strict`."""
    places = (store, *store.shares())
    parts: list[Source] = [PartSource(each.parts, name) for each in places for name in each.part_names()]
    if not manifest.fresh and store.file.exists():
        try:
            fingerprint = json.loads(manifest.attributes["fingerprint"])
            return _finished(store, manifest.name, fingerprint).sources + parts
        except StoreError:
            if strict:
                raise
    return parts


def _check_name(place: Path, owner: str | None, name: str) -> None:
    """Raise a StoreError for results of another sweep than `name`, which are never overwritten."""
    if owner != name:
        whose = f"has the results of {owner}" if owner else "was not made by a sweep"
        raise StoreError(f"{place} {whose}; the results of {name} need another path")


def _finished(store: Store, name: str, fingerprint: dict[str, Any], *, code: bool = True) -> Existing:
    """The results in a finished file."""
    path = store.file
    with open_netcdf(store.file, cache=False) as data:
        _check_name(path, data.attrs.get("sweep"), name)
        _check_same(path, data.attrs, fingerprint, code=code)
        try:
            stored = json.loads(data.attrs["fingerprint"])
            grid = Grid({axis: Axis(data[axis].values) for axis in stored["axes"]}, stored["groups"])
            texts = {axis: each.values.dtype.kind == "U" for axis, each in grid.axes.items()}
            expected = {axis: each["text"] for axis, each in stored["axes"].items()}
            if grid.shape != data["status"].shape or texts != expected:
                raise InputError("its axes do not fit its points")
            environments = json.loads(data.attrs["environments"])
        except UNREADABLE as problem:
            raise StoreError(f"{path} is damaged: {problem}; {errors.HINT_MOVE}") from None
    return Existing(grid, [FileSource(path, grid, environments)], data.attrs)


def _check_same(
    place: Path, attributes: Mapping[str, Any], fingerprint: dict[str, Any], keep: str = "", *, code: bool = True
) -> None:
    try:
        stored = json.loads(attributes["fingerprint"])
        different = differences(stored, fingerprint, code=code)
        adopt = "" if differences(stored, fingerprint, code=False) else f"{errors.HINT_ADOPT}, "
    except UNREADABLE:
        raise StoreError(f"{place} does not say what made it; {errors.HINT_EITHER}{keep}") from None
    if different:
        raise StoreError(f"{place} has other results: {different}; {adopt}{errors.HINT_EITHER}{keep}")


def open_results(path: str | Path) -> xr.Dataset:
    """Open a sweep's netCDF file, or the finished points of a running or interrupted one.

    A file of moderate size is read into memory; of a larger one, large variables are read when they are used. Of
    an unfinished run these are Dask arrays over its parts. A FileNotFoundError or ValueError if there is no such
    file, or it is not the result of a sweep.
    """
    return restore_types(opened(path))


def opened(path: str | Path, *, load: bool = True) -> xr.Dataset:
    """Like `open_results`, with variables in the form of the file; without `load` only the status is read."""
    store = Store(path)
    if store.is_unfinished():
        try:
            return _opened_parts(store)
        except (StoreError, InputError) as problem:
            # Unless the run has finished meanwhile.
            if store.is_unfinished() and not store.file.exists():
                raise InputError(str(problem)) from None
    if not store.file.exists():
        raise MissingFileError(f"{path}: there is no such file")
    try:
        data = open_netcdf(store.file)
    except StoreError as problem:
        raise InputError(str(problem).replace(str(store.file), str(path))) from None
    try:
        configuration = json.loads(str(data.attrs.get("configuration", "{}")))
        for key, kind in (("name", str), ("axes", dict), ("constants", dict)):
            if not isinstance(configuration[key], kind):
                raise InputError(f"its configuration has no {key}")
        for name in (*configuration["axes"], "status"):
            if name not in data.variables:
                raise InputError(f"it has no variable {name}")
    except UNREADABLE as problem:
        data.close()
        raise InputError(f"{path}: it is not the result of a sweep: {message(problem)}") from None
    return _loaded(data, store.file, [*configuration["axes"]] if load else [])


def _loaded(data: xr.Dataset, path: Path, axes: Sequence[str]) -> xr.Dataset:
    """A file with its variables in memory, of a large file the small ones; without `axes` the status only."""
    at_once = bool(axes) and data.nbytes <= READ_AT_ONCE
    try:
        if at_once:
            check_trailer(path)
        for name in data.variables if axes else ["status"]:
            if at_once or not axes or data[name].nbytes * 10 <= READ_AT_ONCE:
                present(data[name].load().variable)
    except StoreError as problem:
        raise InputError(str(problem)) from None
    except UNREADABLE:
        raise InputError(f"{path} {errors.DAMAGED}") from None
    finally:
        if at_once or not axes:
            data.close()
    # Earlier versions stored an axis in single precision.
    names = [name for axis in axes for name in (axis, f"failure_{axis}") if name in data]
    single = [name for name in names if data[name].dtype == np.float32]
    return data.assign({n: (data[n].dims, axis_values(data[n].values), data[n].attrs) for n in single})


def _opened_parts(store: Store) -> xr.Dataset:
    """The finished points of an unfinished run; other points, and those of damaged parts, are pending."""
    before = signature(store.file)
    manifest = unfinished(store)
    if manifest is None:
        raise StoreError(f"{store.file} was finished while its parts were read")
    table, data = Table(manifest, sources_of(store, manifest)), None
    while data is None:
        try:
            data = with_metadata(manifest, assemble(table, lazy=True), None)
        except DamagedError as problem:
            table = Table(manifest, table.without(problem.part))
    # A new file may be there while the parts still are, with its points at other places than the old one.
    if not store.is_unfinished() or signature(store.file) != before:
        raise StoreError(f"{store.file} was finished while its parts were read")
    return data
