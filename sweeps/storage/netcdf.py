"""The one CF netCDF file of a sweep: written under a temporary name, renamed, and opened again."""

from __future__ import annotations

import atexit
import glob
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sweeps.compute.values import residual
from sweeps.errors import StoreError, reason
from sweeps.fingerprint.provenance import source
from sweeps.grid import DONE, FAILED
from sweeps.storage.existing import sources_of
from sweeps.storage.manifest import Manifest
from sweeps.storage.merge import (
    ERROR_ATTRIBUTES,
    STATUS,
    WALL_TIME,
    DamagedError,
    Gathered,
    attributes,
    dataset,
    fitting,
    gather,
    inner_shape,
    stream,
    surveyed,
)
from sweeps.storage.parts import flush_folder
from sweeps.storage.sources import COMPUTED, Source
from sweeps.storage.store import Store
from sweeps.storage.texts import NETCDF, write_texts

Derive = Callable[[xr.Dataset], xr.Dataset]
# A file up to this size is read at once, so that it stays free to be replaced.
READ_AT_ONCE = 50_000_000
# Of a chunk: a reader who wants one point should not read a hundred others.
CHUNK_BYTES = 1 << 18
MOST_CHUNK_BYTES = 1 << 22
# Bytes of a row from which on its chunks are those of a large variable.
WIDE = 1 << 16
# A large variable with shorter rows is put together in memory, alone; of others each row is written as it is read.
NARROW = 16
# What was written last and may be written into again, of all large variables; netCDF would keep 64 MB of each.
CACHE_BYTES = 1 << 25


def attach(manifest: Manifest, data: xr.Dataset, derive: Derive | None, before: str = "") -> xr.Dataset:
    """Add what is derived, and what the file says of itself, after what it said `before`."""
    made = source()
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {manifest.name} computed by {made}"
    described = {
        "Conventions": "CF-1.11",
        "title": manifest.title,
        "history": f"{before}\n{now}" if before else now,
        "source": made,
        "sweep": manifest.name,
    }
    data = data.assign_attrs(described | dict(manifest.attributes))
    return data if derive is None else derive(data)


def stored_only(manifest: Manifest, data: xr.Dataset) -> xr.Dataset:
    """Of an opened file what was computed, without what was derived from it."""
    own = [*manifest.variables, "status", "error", "wall_time"]
    return data[own + [name for name in data.data_vars if data[name].dims == ("failure",)]]


def write(store: Store, manifest: Manifest, sources: Sequence[Source], derive: Derive | None) -> None:
    """Put a sweep's file together and replace the old one by it.

    Raises
    ------
    StoreError
        If it cannot be written; an older one is left as it was.
    """
    temporary = store.file.with_name(f".{store.file.name}.{os.getpid()}.tmp")
    problems: list[Exception] = []
    try:
        _compose(temporary, manifest, sources, derive, problems, _history(store, manifest))
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, store.file)
        # The parts are removed next.
        flush_folder(store.file.parent)
    except (OSError, RuntimeError) as problem:
        if isinstance(problem, StoreError):
            raise
        kept = "all points are kept, and the same run writes it again"
        raise StoreError(f"{store.file} could not be written: {reason(problem)}; {kept}") from problem
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
    if problems:
        # What was computed is kept even where nothing can be derived from it.
        raise problems[0]


def _history(store: Store, manifest: Manifest) -> str:
    """What a file that is completed said of its making."""
    if manifest.fresh or not store.file.is_file():
        return ""
    with suppress(OSError, RuntimeError, AttributeError), NETCDF, netCDF4.Dataset(store.file) as file:
        return str(file.history)
    return ""


def leftovers(store: Store) -> list[Path]:
    """Half a file that a killed run has left, for whoever holds the store."""
    return list(store.file.parent.glob(f".{glob.escape(store.file.name)}.*.tmp"))


def _compose(
    path: Path,
    manifest: Manifest,
    sources: Sequence[Source],
    derive: Derive | None,
    problems: list[Exception],
    before: str = "",
) -> None:
    """Write the file: large variables first, one after another, then everything else with what is derived."""
    every, large = [*manifest.variables, "wall_time"], manifest.large()
    found = gather(manifest, sources, [name for name in every if name not in large])
    # Where one number a point is large, so is its state.
    states = "wall_time" not in large
    if large:
        _write_large(path, manifest, sources, found, large, states)
    large += [] if states else ["status", "error"]
    data = dataset(manifest, found, states)

    def described(data: xr.Dataset) -> xr.Dataset:
        try:
            return attach(manifest, data, derive, before)
        except Exception as problem:  # noqa: BLE001 - raised again when the file is written
            problems.append(problem)
            return attach(manifest, data, None, before)

    if large:
        with xr.open_dataset(path, engine="netcdf4", cache=False) as streamed:
            derived = described(data.assign(streamed[large]))
            attributes_of = {name: derived[name].attrs for name in large if name in derived}
            data = derived.drop_vars(large, errors="ignore").load()
        _describe(path, attributes_of)
    else:
        data = described(data)
    with NETCDF:
        options: dict[str, Any] = {"engine": "netcdf4", "format": "NETCDF4"}
        data.to_netcdf(path, mode="a" if large else "w", encoding=_encoding(data, manifest), **options)
    if any(variable.scale for variable in manifest.variables.values()):
        _keep_computations(path, manifest, [each for each in sources if not each.scaled])


def _row_bytes(manifest: Manifest, name: str) -> int:
    return manifest.row_bytes(name) if name in manifest.variables else 8


def _write_large(
    path: Path, manifest: Manifest, sources: Sequence[Source], found: Gathered, large: Sequence[str], states: bool
) -> None:
    """Write the large variables into a new file."""
    with NETCDF:
        file = netCDF4.Dataset(path, "w")
    try:
        with NETCDF:
            made = {name: _create_large(file, manifest, name) for name in large}
            for variable in made.values():
                variable.set_var_chunk_cache(max(CACHE_BYTES // len(large), MOST_CHUNK_BYTES))
        if not states:
            status = _create_large(file, manifest, "status")
            status[...] = found.status.reshape(manifest.grid.shape)
            _write_errors(file, manifest, found)
        for name in [name for name in large if _row_bytes(manifest, name) <= NARROW]:
            variable = made.pop(name)
            values = gather(manifest, sources, [name], reasons=False).values[name]
            with NETCDF:
                variable[...] = values.reshape(variable.shape)
        if made:
            stream(manifest, sources, made)
    finally:
        with NETCDF:
            file.close()


def _write_errors(file: Any, manifest: Manifest, found: Gathered) -> None:
    """Write why points failed as characters; what is not written is empty."""
    texts = {point: fitting(manifest, text).encode() for point, text in found.errors.items()}
    width = max(map(len, texts.values()), default=1)
    grid, dim = manifest.grid, f"string{width}"
    file.createDimension(dim, width)
    lengths = [*chunk(grid.shape, (), width), width]
    made = file.createVariable("error", "S1", (*grid.dims, dim), zlib=True, complevel=1, chunksizes=lengths)
    made.setncatts({**ERROR_ATTRIBUTES, "_Encoding": "utf-8"})
    for point in sorted(texts):
        letters = np.array([texts[point]], dtype=f"S{width}").view("S1")
        made[tuple(np.unravel_index(point, grid.shape))] = letters


def _describe(path: Path, attributes_of: Mapping[str, Mapping[str, Any]]) -> None:
    """Give large variables the attributes that `derive` has given them."""
    with NETCDF, netCDF4.Dataset(path, "a") as file:
        for name, described in attributes_of.items():
            for old in set(file[name].ncattrs()) - set(described) - {"_FillValue", "_Encoding", "coordinates"}:
                file[name].delncattr(old)
            file[name].setncatts(described)


def chunk(points: tuple[int, ...], inner: tuple[int, ...], row: int) -> list[int]:
    """Lengths of the pieces in which a variable is stored: a reader of one point reads few others.

    Parameters
    ----------
    points, inner : tuple of int
        Shape of the grid, and of the variable at one point.
    row : int
        Bytes of one point.
    """
    left, lengths = max(CHUNK_BYTES // row, 1), list[int]()
    for length in reversed(points):
        lengths.insert(0, min(left, length))
        left = max(left // length, 1)
    if row > MOST_CHUNK_BYTES:
        return [*lengths, *inner[:-1], max(inner[-1] * MOST_CHUNK_BYTES // row, 1)]
    return [*lengths, *inner]


def _create(
    file: Any,
    name: str,
    kind: str,
    points: Mapping[str, int],
    dims: Sequence[str],
    inner: tuple[int, ...],
    shrinks: bool,
    missing: Any = False,
) -> Any:
    """A variable of an open file or group, the points' dimensions first; its values are written as they are."""
    for dim, length in {**points, **dict(zip(dims, inner, strict=True))}.items():
        if dim not in file.dimensions:
            file.createDimension(dim, length)
    row = int(np.dtype(kind).itemsize * np.prod(inner, dtype=np.int64))
    made = file.createVariable(
        name,
        kind,
        (*points, *dims),
        fill_value=missing,
        chunksizes=chunk(tuple(points.values()), inner, row),
        zlib=shrinks,
        complevel=1,
        shuffle=shrinks,
        fletcher32=True,
    )
    made.set_auto_maskandscale(False)
    return made


def _create_large(file: Any, manifest: Manifest, name: str) -> Any:
    """A large variable, or a state or a time of every point."""
    described = manifest.variables.get(name, WALL_TIME if name == "wall_time" else STATUS)
    points = dict(zip(manifest.grid.dims, manifest.grid.shape, strict=True))
    shrinks = described.digits is not None or np.dtype(described.dtype).kind == "i" or name == "wall_time"
    missing = False if name == "status" else np.array(described.missing, described.dtype)[()]
    inner = inner_shape(manifest, name)
    made = _create(file, name, described.dtype, points, described.dims, inner, shrinks, missing)
    aside = [axis for axis in manifest.grid.axes if axis not in manifest.grid.dims]
    made.setncatts(attributes(described, name) | ({"coordinates": " ".join(aside)} if aside else {}))
    return made


def _encoding(data: xr.Dataset, manifest: Manifest) -> dict[str, dict[str, Any]]:
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in data.variables.items():
        chosen = encoding.setdefault(str(name), {})
        # Small coordinates are read by the smallest of readers; long ones would outweigh the data.
        plain = name in data.coords and variable.size < 10_000
        text = variable.dtype.kind in "OUT"
        shrinks = variable.dtype.kind in "fiu" or name in ("error", "traceback", "reproduce")
        if variable.ndim and not plain and shrinks:
            chosen |= {"zlib": True, "complevel": 4, "fletcher32": True}
        if name in manifest.variables and manifest.row_bytes(str(name)) > WIDE:
            inner = manifest.shape(str(name))
            chosen["chunksizes"] = chunk(manifest.grid.shape, inner, manifest.row_bytes(str(name)))
        if text:
            chosen["dtype"] = "S1"
        if name in data.coords or variable.dtype.kind in "iu":
            chosen["_FillValue"] = None
        chosen |= {key: variable.encoding[key] for key in ("dtype", "_FillValue") if key in variable.encoding}
    return encoding


def _keep_computations(path: Path, manifest: Manifest, sources: Sequence[Source]) -> None:
    """Keep what was computed as it was before it was scaled, for points that are added later.

    Of the scaled variables the file has products already: only what these lack is kept.
    """
    plain, large = manifest.unscaled(), manifest.large()
    scaled = [name for name, variable in manifest.variables.items() if variable.scale]
    found = gather(plain, sources, [*(name for name in scaled if name not in large), "wall_time"])
    slots = np.flatnonzero((found.status == DONE) | (found.status == FAILED))
    if not len(slots):
        return

    def lacking(name: str, values: NDArray[Any], points: NDArray[np.intp]) -> NDArray[Any]:
        factor = manifest.factors[manifest.variables[name].scale][points]
        return residual(values, factor, manifest.variables[name].digits)

    with NETCDF, netCDF4.Dataset(path, "a") as file:
        group = file.createGroup(COMPUTED)
        group.createDimension("computation", len(slots))
        columns: dict[str, NDArray[Any]] = {"computation": slots, "status": found.status[slots]}
        columns["wall_time"] = found.values.pop("wall_time")[slots]
        columns |= {f"factor_{name}": manifest.factors[manifest.variables[name].scale][slots] for name in scaled}
        for name, values in columns.items():
            group.createVariable(name, values.dtype, ("computation",), zlib=True, complevel=1)[...] = values
        if found.errors:
            reasons = [(found.errors.get(s, ""), *found.failures.get(s, ("", ""))) for s in slots.tolist()]
            for name, texts in zip(("error", "traceback", "reproduce"), zip(*reasons, strict=True), strict=True):
                write_texts(group, name, np.array(texts, dtype=object), "computation")
        made = {}
        for name in scaled:
            described = manifest.variables[name]
            kind, axes = f"u{np.dtype(described.dtype).itemsize}", {"computation": len(slots)}
            made[name] = _create(group, f"residual_{name}", kind, axes, described.dims, manifest.shape(name), True)
            made[name].digits = described.digits or 0
            made[name].set_var_chunk_cache(max(CACHE_BYTES // len(scaled), MOST_CHUNK_BYTES))
        for name, values in found.values.items():
            made.pop(name)[...] = lacking(name, values[slots], slots)
        if made:
            stream(plain, sources, made, slots, lacking)


def open_results(path: str | Path) -> xr.Dataset:
    """Open a sweep's netCDF file, or what is finished of one that is still running or was interrupted.

    A file of moderate size is read into memory, so that it stays free to be replaced; of a larger one, large
    variables are read when they are used.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it is not the result of a sweep.
    """
    store = Store(path)
    if store.manifest.is_file():
        with suppress(ValueError, StoreError):
            return _unfinished(store)
    if not store.file.is_file():
        raise FileNotFoundError(f"{path}: there is no such file")
    if not os.access(store.file, os.R_OK):
        raise ValueError(f"{path}: it cannot be read")
    try:
        data = _opened(store.file)
    except (OSError, ValueError, RuntimeError):
        raise ValueError(f"{path}: it is damaged or not netCDF") from None
    try:
        json.loads(data.attrs["configuration"])["constants"]
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"{path}: it is not the result of a sweep") from None
    return data


def _opened(path: Path) -> xr.Dataset:
    with NETCDF:
        data = xr.open_dataset(path, engine="netcdf4")
        if data.nbytes <= READ_AT_ONCE:
            with data:
                return data.load()
        for name in data.variables:
            if data[name].nbytes * 10 <= READ_AT_ONCE:
                data[name].load()
    return data


def _unfinished(store: Store) -> xr.Dataset:
    """The points that are finished so far; the others are pending, and so are those of damaged parts."""
    manifest = Manifest.load(store.manifest)
    sources = sources_of(store, manifest)
    damaged = surveyed(manifest, sources).damaged
    sources = [source for source in sources if source.name not in damaged]
    while True:
        try:
            data = _so_far(manifest, sources)
            break
        except DamagedError as problem:
            sources = [source for source in sources if source.name != problem.part]
    if not store.manifest.is_file():
        raise StoreError(f"{store.file} was finished while its parts were read")
    return data


def _so_far(manifest: Manifest, sources: Sequence[Source]) -> xr.Dataset:
    if not manifest.large():
        found = gather(manifest, sources, [*manifest.variables, "wall_time"])
        return attach(manifest, dataset(manifest, found), None)
    folder = tempfile.mkdtemp(prefix="sweeps-")
    path = Path(folder) / "unfinished.nc"
    try:
        _compose(path, manifest, sources, None, [])
        data = _opened(path)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    # What is read when it is used needs the file as long as anybody may use it.
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return data
