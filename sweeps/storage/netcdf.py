"""The CF netCDF file of a sweep, written with checksums of HDF5 under a temporary name, then renamed."""

import json
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any

import dask
import xarray as xr

from sweeps.errors import UNREADABLE, StoreError, reason
from sweeps.grid import block_shape
from sweeps.storage.assemble import LARGE, FileSource, Table, assemble, open_netcdf
from sweeps.storage.parts import Manifest
from sweeps.storage.store import Store, replacing

Derive = Callable[[xr.Dataset], xr.Dataset]
# Bytes of a chunk: a reader of one point should not read a hundred others.
CHUNK_BYTES, MOST_CHUNK_BYTES = 1 << 18, 1 << 22


def with_metadata(manifest: Manifest, data: xr.Dataset, derive: Derive | None, before: str = "") -> xr.Dataset:
    """Add global attributes and derived variables; the history continues that of `before`."""
    own, environments = {"source": "", **manifest.attributes}, json.loads(data.attrs["environments"])
    made = "; ".join(", ".join(map(" ".join, each.items())) for each in environments if each)
    added = f"{own.pop('extends')} added" if "extends" in own else ""
    by = "; ".join(filter(None, [own["source"], made, own.pop("remark", ""), added]))
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {manifest.name} computed by {by}"
    first = {"Conventions": "CF-1.11", "title": manifest.title, "history": f"{before}\n{now}".lstrip("\n")}
    data = data.assign_attrs(first | {"source": own["source"], "sweep": manifest.name} | own)
    return data if derive is None else derive(data)


def write(store: Store, table: Table, derive: Derive | None) -> None:
    """Write the file of a sweep in place of the previous one; an error of `derive` is raised afterwards."""
    manifest, problem = table.manifest, None
    files = [source for source in table.sources if isinstance(source, FileSource)]
    data = assemble(table, lazy=True)
    before = ""
    if not manifest.fresh or "extends" in manifest.attributes:
        with suppress(*UNREADABLE), open_netcdf(store.file, decode_cf=False) as file:
            before = str(file.attrs["history"])
    try:
        whole = with_metadata(manifest, data, derive, before)
    except Exception as raised:  # noqa: BLE001 - raised again when the results are safe
        problem, whole = raised, with_metadata(manifest, data, None, before)
    try:
        # Not by a user's Dask client, and not by two threads, which can deadlock with xarray before 2026.9.
        with replacing(store.file, store.parts) as temporary, dask.config.set(scheduler="sync"):
            try:
                whole.to_netcdf(temporary, engine="netcdf4", encoding=_encoding(whole, manifest))
            finally:
                # Windows replaces no file that is open.
                for each in files:
                    each.data.close()
    except StoreError:
        raise
    except (OSError, RuntimeError) as unwritten:
        why = reason(unwritten)
        if isinstance(unwritten, PermissionError):
            why += " (if a program or a dataset has it open, close it there)"
        kept = "all points are kept, and the same run writes it again"
        raise StoreError(f"{store.file} could not be written: {why}; {kept}") from unwritten
    if problem is not None:
        raise problem


def _encoding(data: xr.Dataset, manifest: Manifest) -> dict[str, dict[str, Any]]:
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in data.variables.items():
        chosen = encoding.setdefault(str(name), {})
        own = manifest.variables.get(str(name))
        text = variable.dtype.kind in "OUTS"
        # HDF5 notices a changed bit wherever it reads one of these.
        chosen["fletcher32"] = variable.ndim > 0
        # The smallest readers do not inflate coordinates; long ones would outweigh the data.
        if variable.ndim and not (name in data.coords and (text or variable.size < 10_000)):
            large = variable.nbytes > LARGE
            # Floats of full precision hardly shrink.
            shrinks = not large or own is None or own.digits is not None or own.dtype.startswith("int")
            chosen |= {"zlib": shrinks, "shuffle": shrinks, "complevel": 1 if large else 4}
        if name in (*manifest.variables, "status", "wall_time") and not text:
            inner = manifest.shape(str(name))
            if variable.shape == (*manifest.grid.shape, *inner):  # `derive` may have replaced it
                row = manifest.row_bytes(str(name))
                if row > MOST_CHUNK_BYTES:
                    inner = (*inner[:-1], max(inner[-1] * MOST_CHUNK_BYTES // row, 1))
                chosen["chunksizes"] = (*block_shape(manifest.grid.shape, max(CHUNK_BYTES // row, 1)), *inner)
        if text:
            chosen["dtype"] = "S1"
        # What HDF5 does not find is then filled with netCDF's own value, and noticed.
        chosen["_FillValue"] = None
        chosen |= {key: variable.encoding[key] for key in ("dtype", "missing_value") if key in variable.encoding}
        if (missing := variable.encoding.get("_FillValue")) is not None:  # of a derived variable
            chosen["missing_value"] = missing
    return encoding
