"""One CF netCDF file a sweep: put together, written under a temporary name, renamed, opened again."""

from __future__ import annotations

import json
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sweeps.execute import STATUS_MEANINGS, Outcome
from sweeps.provenance import source

if TYPE_CHECKING:
    from sweeps.plan import Plan


class StoreError(RuntimeError):
    """The place where results are to be kept cannot be used; the message says why."""


def assemble(plan: Plan, outcome: Outcome) -> xr.Dataset:
    """The dataset of a whole sweep, with the attributes CF asks for."""
    sweep = plan.sweep
    grid = sweep.grid
    coords: dict[str, Any] = {
        name: ((grid.dim_of(name),), axis.values, _attributes(axis)) for name, axis in grid.axes.items()
    }
    coords |= {name: ((name,), axis.values, _attributes(axis)) for name, axis in sweep.coords.items()}

    def shaped(array: np.ndarray) -> np.ndarray:
        return array.reshape(*grid.shape, *array.shape[1:])

    data: dict[str, Any] = {
        name: ((*grid.dims, *v.dims), shaped(outcome.values[name]), _attributes(v))
        for name, v in sweep.variables.items()
    }
    codes = np.arange(len(STATUS_MEANINGS.split()), dtype=np.int8)
    flags = {"flag_values": codes, "flag_meanings": STATUS_MEANINGS, "long_name": "status of the point"}
    data["status"] = (grid.dims, shaped(outcome.status), flags)
    data["error"] = (grid.dims, shaped(outcome.error), {"long_name": "why the point failed"})
    time = {"units": "s", "long_name": "computing time of the point"}
    data["wall_time"] = (grid.dims, shaped(outcome.wall_time), time)
    made = source()
    attributes = {
        "Conventions": "CF-1.11",
        "title": sweep.title or sweep.name,
        "history": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {sweep.name} computed by {made}",
        "source": made,
        "sweep": sweep.name,
        "configuration": sweep.configuration(),
    }
    return xr.Dataset(data, coords, attributes)


def check_store(path: Path, name: str) -> None:
    """Refuse, before anything is computed, a file that this sweep must not replace."""
    if path.is_dir():
        raise StoreError(f"{path} is a folder; the results of {name} need a file there")
    if path.exists():
        try:
            with xr.open_dataset(path) as present:
                owner = present.attrs.get("sweep")
        except (OSError, ValueError):
            owner = None
        if owner != name:
            belongs = f"belongs to the sweep {owner}" if owner else "is not a result of a sweep"
            raise StoreError(f"{path} {belongs}, not to {name}; choose another folder")
    folder = path.parent
    while not folder.exists():
        folder = folder.parent
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise StoreError(f"{folder} cannot be written to; choose another folder")


def write(dataset: xr.Dataset, path: Path) -> None:
    """Write `dataset` to `path` so that a reader sees the old file or the new one, never a part."""
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in dataset.variables.items():
        if variable.dtype.kind in "fiu" and name not in dataset.coords and variable.ndim:
            encoding[str(name)] = {"zlib": True, "complevel": 4, "fletcher32": True}
        if name in dataset.coords or variable.dtype.kind in "iu":
            encoding.setdefault(str(name), {})["_FillValue"] = None
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        dataset.to_netcdf(temporary, engine="netcdf4", format="NETCDF4", encoding=encoding)
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def open_results(path: str | Path) -> xr.Dataset:
    """Open a sweep's netCDF file, read into memory so that the file stays free to be replaced.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it is not the result of a sweep.
    """
    file = Path(path)
    if not file.is_file():
        raise FileNotFoundError(f"{file}: there is no such file")
    try:
        with xr.open_dataset(file) as dataset:
            dataset.load()
    except (OSError, ValueError) as problem:
        raise ValueError(f"{file} is not a readable netCDF file: {problem}") from None
    if "configuration" not in dataset.attrs:
        raise ValueError(f"{file} is not the result of a sweep: it has no configuration attribute")
    json.loads(dataset.attrs["configuration"])
    return dataset


def _attributes(described: Any) -> dict[str, str]:
    attributes = {"units": described.units, "long_name": described.long_name}
    values = getattr(described, "values", None)
    if values is not None and values.dtype.kind == "U":
        # A text has no units.
        del attributes["units"]
    return {name: text for name, text in attributes.items() if text}
