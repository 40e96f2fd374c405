"""The one CF netCDF file of a sweep: written under a temporary name, renamed, and opened again."""

from __future__ import annotations

import atexit
import glob
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from sweeps.assemble import Source, dataset, gather
from sweeps.batch import DONE, FAILED, Table
from sweeps.errors import StoreError, reason
from sweeps.fingerprint.provenance import source
from sweeps.finished import COMPUTED
from sweeps.layout import Layout
from sweeps.shards import NETCDF, WIDE, flush_folder, write_table
from sweeps.store import Store, sources_of
from sweeps.stream import chunk, stream

Derive = Callable[[xr.Dataset], xr.Dataset]
# A file up to this size is read at once, so that it stays free to be replaced.
READ_AT_ONCE = 50_000_000


def attach(layout: Layout, data: xr.Dataset, derive: Derive | None, before: str = "") -> xr.Dataset:
    """Add what is derived, and what the file says of itself, after what it said `before`."""
    made = source()
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {layout.name} computed by {made}"
    attributes = {
        "Conventions": "CF-1.11",
        "title": layout.title,
        "history": f"{before}\n{now}" if before else now,
        "source": made,
        "sweep": layout.name,
    }
    data = data.assign_attrs(attributes | dict(layout.attributes))
    return data if derive is None else derive(data)


def stored_only(layout: Layout, data: xr.Dataset) -> xr.Dataset:
    """Of an opened file what was computed, without what was derived from it."""
    own = [*layout.variables, "status", "error", "wall_time"]
    return data[own + [name for name in data.data_vars if data[name].dims == ("failure",)]]


def write(store: Store, layout: Layout, sources: Sequence[Source], derive: Derive | None) -> None:
    """Put a sweep's file together and replace the old one by it.

    Raises
    ------
    StoreError
        If it cannot be written; an older one is left as it was.
    """
    temporary = store.file.with_name(f".{store.file.name}.{os.getpid()}.tmp")
    problems: list[Exception] = []
    try:
        _compose(temporary, layout, sources, derive, problems, whole=True, before=_history(store, layout))
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, store.file)
        # The shards are removed next.
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


def _history(store: Store, layout: Layout) -> str:
    """What a file that is completed said of its making."""
    if layout.fresh or not store.file.is_file():
        return ""
    with suppress(OSError, RuntimeError, AttributeError), NETCDF, netCDF4.Dataset(store.file) as file:
        return str(file.history)
    return ""


def leftovers(store: Store) -> list[Path]:
    """Half a file that a killed run has left, for whoever holds the store."""
    return list(store.file.parent.glob(f".{glob.escape(store.file.name)}.*.tmp"))


def _compose(
    path: Path,
    layout: Layout,
    sources: Sequence[Source],
    derive: Derive | None,
    problems: list[Exception],
    whole: bool = False,
    before: str = "",
) -> None:
    large = layout.large()
    found = gather(layout, sources, large)
    if whole and found.damaged:
        raise StoreError(f"{', '.join(found.damaged)} in {path.parent} got damaged; plan and run again")
    if large:
        stream(layout, sources, found, large, path)
    data = dataset(layout, found)
    if large:
        with xr.open_dataset(path, engine="netcdf4") as streamed:
            try:
                data = attach(layout, data.assign(streamed[large]), derive, before).drop_vars(large).load()
            except Exception as problem:  # noqa: BLE001 - raised again when the file is written
                problems.append(problem)
                data = attach(layout, data.drop_vars(large, errors="ignore"), None, before)
    else:
        try:
            data = attach(layout, data, derive, before)
        except Exception as problem:  # noqa: BLE001 - raised again when the file is written
            problems.append(problem)
            data = attach(layout, data, None, before)
    with NETCDF:
        data.to_netcdf(
            path, mode="a" if large else "w", engine="netcdf4", format="NETCDF4", encoding=_encoding(data, layout)
        )
    if any(variable.scale for variable in layout.variables.values()) and not large:
        _keep_computations(path, layout, sources)


def _encoding(data: xr.Dataset, layout: Layout) -> dict[str, dict[str, Any]]:
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in data.variables.items():
        chosen = encoding.setdefault(str(name), {})
        # Small coordinates are read by the smallest of readers; long ones would outweigh the data.
        plain = name in data.coords and variable.size < 10_000
        text = variable.dtype.kind in "OUT"
        if (
            variable.ndim
            and not plain
            and (variable.dtype.kind in "fiu" or name in ("error", "traceback", "reproduce"))
        ):
            chosen |= {"zlib": True, "complevel": 4, "fletcher32": True}
        if name in layout.variables and layout.row_bytes(str(name)) > WIDE:
            chosen["chunksizes"] = chunk(layout, str(name))
        if text:
            # As characters: they shrink to nothing where they are empty. Texts of any length, as netCDF has them
            # too, bring down HDF5 2.2 where a file that is open is opened and closed once more.
            chosen["dtype"] = "S1"
        if name in data.coords or variable.dtype.kind in "iu":
            chosen["_FillValue"] = None
        chosen |= {key: variable.encoding[key] for key in ("dtype", "_FillValue") if key in variable.encoding}
    return encoding


def _keep_computations(path: Path, layout: Layout, sources: Sequence[Source]) -> None:
    """Keep what was computed as it was before it was scaled, for points that are added later."""
    plain = Layout(
        layout.name,
        layout.title,
        layout.grid,
        layout.coords,
        layout.variables,
        np.where(layout.original == np.arange(layout.grid.size), layout.original, -1),
        layout.key,
        {name: np.ones_like(values) for name, values in layout.factors.items()},
    )
    found = gather(plain, [each for each in sources if not each.own])
    slots = np.flatnonzero((found.status == DONE) | (found.status == FAILED))
    if not len(slots):
        return
    told = [found.failures.get(slot, ("", "")) for slot in slots.tolist()]
    texts = np.array(told, dtype=object).reshape(-1, 2)
    table = Table(
        layout.grid.points(slots),
        layout.slot_key(slots),
        {name: values[slots] for name, values in found.values.items()},
        found.status[slots],
        found.error[slots],
        texts[:, 0],
        texts[:, 1],
        found.wall_time[slots],
    )
    with NETCDF, netCDF4.Dataset(path, "a") as file:
        write_table(file.createGroup(COMPUTED), table, layout.variables, checked=True)


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
    if store.layout.is_file():
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
    """The points that are finished so far; the others are pending."""
    layout = Layout.load(store.layout)
    sources = sources_of(store, layout)
    if not layout.large():
        found = gather(layout, sources)
        if not store.layout.is_file():
            raise StoreError(f"{store.file} was finished while its shards were read")
        return attach(layout, dataset(layout, found), None)
    folder = tempfile.mkdtemp(prefix="sweeps-")
    path = Path(folder) / "unfinished.nc"
    try:
        _compose(path, layout, sources, None, [])
        if not store.layout.is_file():
            raise StoreError(f"{store.file} was finished while its shards were read")
        data = _opened(path)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    # What is read when it is used needs the file as long as anybody may use it.
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return data
