"""The one CF netCDF file of a sweep: written under a temporary name, renamed, and opened again."""

from __future__ import annotations

import atexit
import json
import math
import os
import tempfile
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import NetCDF4DataStore

from sweeps.compute.batch import Failure
from sweeps.errors import UNREADABLE, InputError, MissingFileError, StoreError, reason, said
from sweeps.fingerprint.provenance import environments_of, listed, source
from sweeps.grid import DONE, FAILED
from sweeps.storage.checked import check_declared, check_heaps, check_seal, seal
from sweeps.storage.existing import sources_of
from sweeps.storage.manifest import BESIDES, LARGE, Manifest
from sweeps.storage.merge import Gathered, dataset, fill, gather
from sweeps.storage.replacing import replacing
from sweeps.storage.sources import COMPUTED, NETCDF, DamagedError, Source
from sweeps.storage.store import Store, mark

Derive = Callable[[xr.Dataset], xr.Dataset]
# A file up to this size is checked as a whole whenever it is opened, which takes 0.2 s at most. Of a larger one
# HDF5 checks what is read; whoever completes it checks all of it.
CHECKED = 1 << 28
# A file up to this size is read at once, so that it stays free to be replaced.
READ_AT_ONCE = 50_000_000
# Of a chunk: a reader who wants one point should not read a hundred others.
CHUNK_BYTES = 1 << 18
MOST_CHUNK_BYTES = 1 << 22
# A large variable of rows up to this size is put together in memory, alone; of others each row is written as it is
# read.
NARROW = 16
# What was written last and may be written into again, of all large variables; netCDF would keep 64 MB of each.
CACHE_BYTES = 1 << 25


def attach(manifest: Manifest, data: xr.Dataset, derive: Derive | None, before: str = "") -> xr.Dataset:
    """Add what is derived, and what the file says of itself, after what it said `before`."""
    made = source()
    own = dict(manifest.attributes)
    about = "; ".join(filter(None, [made, listed(environments_of(data.attrs)), own.pop("remark", "")]))
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {manifest.name} computed by {about}"
    described = {
        "Conventions": "CF-1.11",
        "title": manifest.title,
        "history": f"{before}\n{now}" if before else now,
        "source": made,
        "sweep": manifest.name,
    }
    data = data.assign_attrs(described | own)
    return data if derive is None else derive(data)


def stored_only(manifest: Manifest, data: xr.Dataset) -> xr.Dataset:
    """Of an opened file what was computed, without what was derived from it."""
    own = [*manifest.variables, *(name for name in BESIDES if name in data)]
    return data[own + [name for name in data.data_vars if data[name].dims == ("failure",)]]


def write(store: Store, manifest: Manifest, sources: Sequence[Source], derive: Derive | None) -> None:
    """Put a sweep's file together and replace the old one by it.

    Raises
    ------
    StoreError
        If it cannot be written; an older one is left as it was.
    """
    try:
        with replacing(store.file, aside=store.parts) as temporary:
            underived = _compose(temporary, manifest, sources, derive, _history(store, manifest))
            seal(temporary)
    except StoreError:
        raise
    except (OSError, RuntimeError) as problem:
        kept = "all points are kept, and the same run writes it again"
        raise StoreError(f"{store.file} could not be written: {reason(problem)}; {kept}") from problem
    if underived is not None:
        raise underived


def _history(store: Store, manifest: Manifest) -> str:
    """What a file that is completed said of its making."""
    if manifest.fresh or not store.file.is_file():
        return ""
    with suppress(*UNREADABLE), NETCDF, netCDF4.Dataset(store.file) as file:
        return str(file.history)
    return ""


def _compose(
    path: Path, manifest: Manifest, sources: Sequence[Source], derive: Derive | None = None, before: str = ""
) -> Exception | None:
    """Write the file: large variables first, one after another, then everything else with what is derived.

    What was computed is kept even where nothing can be derived from it; why not is returned.
    """
    large, problem = manifest.large(), None
    found = gather(manifest, sources, [each for each in (*manifest.variables, "wall_time") if each not in large])
    found.values |= _stand_ins(manifest, large, found)
    data = dataset(manifest, found)
    with ExitStack() as stack:
        if large:
            _write_large(path, manifest, sources, data[large], found)
            with NETCDF:
                lazy = stack.enter_context(xr.open_dataset(path, engine="netcdf4", cache=False, lock=NETCDF))
            data = data.assign(lazy[large])
        try:
            data = attach(manifest, data, derive, before)
        except Exception as raised:  # noqa: BLE001 - raised again when the file is written
            problem, data = raised, attach(manifest, data, None, before)
        attributes_of = {name: data[name].attrs for name in large if name in data}
        data = data.drop_vars(large, errors="ignore").load()
    with NETCDF:
        if large:
            _describe(path, attributes_of)
        encoding = _encoding(data, manifest)
        data.to_netcdf(path, mode="a" if large else "w", engine="netcdf4", encoding=encoding)
    if any(variable.scale for variable in manifest.variables.values()):
        _keep_computations(path, manifest, sources)
    return problem


def _stand_ins(manifest: Manifest, large: Sequence[str], found: Gathered) -> dict[str, Any]:
    """Arrays of the type and shape of large variables."""
    widest = max([1, *(len(text.encode()) for text in found.errors.values())])
    arrays = {}
    for name in large:
        kind = f"S{widest}" if name == "error" else manifest.described(name).dtype
        arrays[name] = _stand_in((manifest.grid.size, *manifest.shape(name)), kind)
    return arrays


def _stand_in(shape: tuple[int, ...], kind: str) -> Any:
    """Zeros; where there are many they take no memory, and are not written."""
    if math.prod(shape) * np.dtype(kind).itemsize <= LARGE:
        return np.zeros(shape, kind)
    # Imported here: it takes a second, and few files need it.
    from dask.array import zeros

    return zeros(shape, dtype=kind, chunks=-1)


def _write_large(
    path: Path, manifest: Manifest, sources: Sequence[Source], data: xr.Dataset, found: Gathered
) -> None:
    """Write the large variables, which stand-ins describe, into a new file."""
    if "error" in data:
        data["error"].attrs["_Encoding"] = "utf-8"
    with _created(path, data, _encoding(data, manifest, data.data_vars)) as file:
        if "error" in data:
            # What is not written is empty.
            for point, text in found.errors.items():
                letters = np.array([text.encode()], dtype=data["error"].dtype).view("S1")
                file["error"][tuple(np.unravel_index(point, manifest.grid.shape))] = letters
        _fill({name: file[name] for name in map(str, data.data_vars) if name != "error"}, manifest, sources)


@contextmanager
def _created(
    path: Path, data: xr.Dataset, encoding: Mapping[str, Any], group: str | None = None
) -> Iterator[netCDF4.Dataset]:
    """A new file, or a new group of one, with everything of a dataset but the values of its stand-ins."""
    with NETCDF:
        store = NetCDF4DataStore.open(  # type: ignore[no-untyped-call]
            path, mode="a" if group else "w", group=group, lock=NETCDF
        )
        with closing(store):
            data.dump_to_store(store, encoding=encoding)
            store.ds.set_auto_maskandscale(False)
            store.ds.set_auto_chartostring(False)
            yield store.ds


def _describe(path: Path, attributes_of: Mapping[str, Mapping[str, Any]]) -> None:
    """Give large variables the attributes that `derive` has given them."""
    with netCDF4.Dataset(path, "a") as file:
        for name, described in attributes_of.items():
            for old in set(file[name].ncattrs()) - set(described) - {"_FillValue", "_Encoding", "coordinates"}:
                file[name].delncattr(old)
            file[name].setncatts(described)


def _keep_computations(path: Path, manifest: Manifest, sources: Sequence[Source]) -> None:
    """Keep what was computed as it was before it was scaled, for points that are added later.

    Of the scaled variables the file has products already: only what these lack is kept.
    """
    computations = manifest.computations()
    found = gather(computations, sources, ["wall_time"])
    slots = np.flatnonzero((found.status == DONE) | (found.status == FAILED))
    if not len(slots):
        return
    columns: dict[str, Any] = {"status": found.status[slots], "wall_time": found.values["wall_time"][slots]}
    if found.errors:
        reasons = [found.failures.get(slot, Failure(found.errors.get(slot, ""))) for slot in slots.tolist()]
        columns |= zip(Failure._fields, np.array(reasons, dtype=object).T, strict=True)
    kept = xr.Dataset({name: ("computation", each) for name, each in columns.items()}, {"computation": slots})
    encoding, scaled = {}, []
    for name, variable in manifest.variables.items():
        if variable.scale:
            bits, inner = f"u{np.dtype(variable.dtype).itemsize}", manifest.shape(name)
            lacking = _stand_in((len(slots), *inner), bits)
            kept[f"factor_{name}"] = "computation", manifest.factors[variable.scale][slots]
            kept[f"residual_{name}"] = ("computation", *variable.dims), lacking, {"digits": variable.digits or 0}
            chunksizes = chunk((len(slots),), inner, manifest.row_bytes(name))
            encoding[f"residual_{name}"] = _packing(True) | {"chunksizes": chunksizes}
            scaled.append(name)
    with _created(path, kept, _encoding(kept, manifest) | encoding, COMPUTED) as group:
        _fill({name: group[f"residual_{name}"] for name in scaled}, computations, sources, slots)


def _fill(
    made: Mapping[Any, Any], manifest: Manifest, sources: Sequence[Source], slots: NDArray[np.intp] | None = None
) -> None:
    """Fill variables of an open file: in memory what it can hold at once, the rest as it is read."""
    large = manifest.large()
    wide = {name: each for name, each in made.items() if name in large and manifest.row_bytes(name) > NARROW}
    alone = [[name] for name in made if name in large and name not in wide]
    for names in filter(None, [[name for name in made if name not in large], *alone]):
        arrays = {name: made[name][...].reshape(-1, *manifest.shape(name)) for name in names}
        for name, values in fill(manifest, sources, arrays, slots).values.items():
            made[name][...] = values.reshape(made[name].shape)
    for variable in wide.values():
        variable.set_var_chunk_cache(max(CACHE_BYTES // len(wide), MOST_CHUNK_BYTES))
    if wide:
        fill(manifest, sources, wide, slots)


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


def _packing(shrinks: bool) -> dict[str, Any]:
    """How a large variable is kept."""
    return {"zlib": shrinks, "complevel": 1, "shuffle": shrinks, "fletcher32": True}


def _encoding(data: xr.Dataset, manifest: Manifest, large: Collection[Any] = ()) -> dict[str, dict[str, Any]]:
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in data.variables.items():
        chosen = encoding.setdefault(str(name), {})
        own = manifest.variables.get(str(name))
        text = variable.dtype.kind in "OUTS"
        # Small coordinates are read by the smallest of readers; long ones would outweigh the data.
        plain = name in data.coords and (text or variable.size < 10_000)
        if name in large:
            # Full-precision floats hardly shrink.
            chosen |= _packing(own is None or own.digits is not None or np.dtype(own.dtype).kind == "i")
        elif variable.ndim and not plain:
            chosen |= {"zlib": True, "complevel": 4, "fletcher32": True}
        elif variable.ndim and manifest.large():
            chosen["fletcher32"] = True
        points = manifest.grid.shape
        if name in large and text:
            chosen["chunksizes"] = chunk(points, (variable.dtype.itemsize,), variable.dtype.itemsize)
        elif name in (*manifest.variables, *BESIDES) and not text:
            inner = manifest.shape(str(name))
            # What is derived may have another shape.
            if variable.shape == (*points, *inner):
                chosen["chunksizes"] = chunk(points, inner, manifest.row_bytes(str(name)))
        if text:
            chosen["dtype"] = "S1"
        if name in data.coords or variable.dtype.kind in "iu":
            chosen["_FillValue"] = None
        chosen |= {key: variable.encoding[key] for key in ("dtype", "_FillValue") if key in variable.encoding}
    return encoding


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
        try:
            return _unfinished(store)
        except UNREADABLE as problem:
            # Unless the run has finished meanwhile.
            if store.manifest.is_file() and not store.file.exists():
                raise InputError(f"{store.manifest}: it is damaged: {said(problem)}") from None
    if not store.file.exists():
        raise MissingFileError(f"{path}: there is no such file")
    if not store.file.is_file():
        raise InputError(f"{path}: it is not a regular file")
    if not os.access(store.file, os.R_OK):
        raise InputError(f"{path}: it cannot be read")
    try:
        data = _opened(store.file)
    except InputError as problem:
        raise InputError(f"{path}: it is damaged: {problem}") from None
    except UNREADABLE:
        raise InputError(f"{path}: it is damaged or not netCDF") from None
    try:
        json.loads(data.attrs["configuration"])["constants"]
    except UNREADABLE:
        raise InputError(f"{path}: it is not the result of a sweep") from None
    try:
        _check_described(data)
    except UNREADABLE as problem:
        raise InputError(f"{path}: it is damaged: {said(problem)}") from None
    return data


def _check_described(data: xr.Dataset) -> None:
    """Raise one of UNREADABLE where a result does not say of itself what whoever reads it needs."""
    configuration, points = json.loads(data.attrs["configuration"]), data["status"].dims
    if [type(configuration[name]) for name in ("name", "axes", "constants")] != [str, dict, dict]:
        raise InputError("its configuration is of another shape")
    for name in configuration["axes"]:
        # Where it is lacking, `data[name]` counts.
        axis = data.variables[name]
        if not set(axis.dims) <= set(points):
            raise InputError(f"{name} runs along {', '.join(map(str, axis.dims))}")
        if not axis.size:
            raise InputError(f"{name} has no value")
        if axis.dtype.kind not in "biufOU" or (axis.dtype.kind == "f" and not np.isfinite(axis.values).all()):
            raise InputError(f"{name} has values that are neither numbers nor texts")
    for name, variable in data.variables.items():
        if len(set(variable.dims)) < variable.ndim or (name in data.dims and variable.dims != (name,)):
            raise InputError(f"{name} runs along {', '.join(map(str, variable.dims))}")
    for name, variable in data.variables.items():
        if "flag_values" in variable.attrs:
            words = variable.attrs["flag_meanings"].split()
            if len(words) != np.size(variable.attrs["flag_values"]):
                raise InputError(f"{name} has {len(words)} words")


def _opened(path: Path) -> xr.Dataset:
    if path.stat().st_size <= CHECKED:
        check_seal(path)
    check_heaps(path)
    with NETCDF:
        with netCDF4.Dataset(path) as file:
            check_declared(file)
        # No sweep has dates, and what looks like one may be none.
        # What runs twice along a dimension is refused later, and not in so many lines.
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Duplicate dimension names")
            data = xr.open_dataset(path, engine="netcdf4", lock=NETCDF, decode_times=False)
        if data.nbytes <= READ_AT_ONCE:
            with data:
                return data.load()
        for name in data.variables:
            if data[name].nbytes * 10 <= READ_AT_ONCE:
                data[name].load()
    return data


def _unfinished(store: Store) -> xr.Dataset:
    """The points that are finished so far; the others are pending, and so are those of damaged parts."""
    manifest, before = Manifest.load(store.manifest), mark(store.file)
    sources = sources_of(store, manifest)
    while True:
        try:
            data = _so_far(manifest, sources)
            break
        except DamagedError as problem:
            sources = [source for source in sources if source.name != problem.part]
    # The new file may be there when the parts still are, and have its points at other places than the old one.
    if not store.manifest.is_file() or mark(store.file) != before:
        raise StoreError(f"{store.file} was finished while its parts were read")
    _check_described(data)
    return data


def _so_far(manifest: Manifest, sources: Sequence[Source]) -> xr.Dataset:
    if not manifest.large():
        found = gather(manifest, sources, [*manifest.variables, "wall_time"])
        return attach(manifest, dataset(manifest, found), None)
    with ExitStack() as stack:
        path = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="sweeps-"))) / "unfinished.nc"
        _compose(path, manifest, sources)
        data = _opened(path)
        # What is read when it is used needs the file as long as anybody may use it.
        atexit.register(stack.pop_all().close)
    return data
