"""One CF netCDF file a sweep: put together, written under a temporary name, renamed, opened again."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sweeps.execute import STATUS_MEANINGS, Outcome
from sweeps.provenance import source

if TYPE_CHECKING:
    from sweeps.grid import Variable
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
        name: _variable(v, (*grid.dims, *v.dims), shaped(outcome.values[name]))
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
    """Refuse, before anything is computed, a place where the results of `name` cannot or must not go."""
    try:
        if path.is_dir():
            raise StoreError(f"{path} is a folder; the results of {name} need a file there")
        if path.exists():
            _check_owner(path, name)
        folder = path.parent
        while not folder.exists() and folder != folder.parent:
            if folder.is_symlink():
                raise StoreError(f"{folder} is a link to nothing; choose another folder")
            folder = folder.parent
        if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
            raise StoreError(f"{folder} cannot be written to; choose another folder")
    except OSError as problem:
        raise StoreError(f"{path} cannot be used: {problem.strerror}; choose another folder") from None


def _check_owner(path: Path, name: str) -> None:
    if not os.access(path, os.R_OK):
        raise StoreError(f"{path} cannot be read, so it may be anybody's; choose another folder")
    try:
        with xr.open_dataset(path, engine="netcdf4") as present:
            owner = present.attrs.get("sweep")
    except (OSError, ValueError):
        raise StoreError(f"{path} is damaged or not netCDF; move it away or choose another folder") from None
    if owner != name:
        whose = f"holds the results of {owner}" if owner else "was not made by a sweep"
        raise StoreError(f"{path} {whose}; the results of {name} need another folder")


def write(dataset: xr.Dataset, path: Path) -> None:
    """Write `dataset` to `path` so that a reader sees the old file or the new one, never a part.

    Raises
    ------
    StoreError
        If the file cannot be written; an older one is left as it was.
    """
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in dataset.variables.items():
        chosen = encoding.setdefault(str(name), {})
        # Small coordinates are read by the smallest of readers; long ones would outweigh the data.
        plain = name in dataset.coords and variable.size < 10_000
        if variable.dtype.kind in "fiu" and variable.ndim and not plain:
            chosen |= {"zlib": True, "complevel": 4, "fletcher32": True}
        if name in dataset.coords or variable.dtype.kind in "iu":
            chosen["_FillValue"] = None
        chosen |= {key: variable.encoding[key] for key in ("dtype", "_FillValue") if key in variable.encoding}
    temporary = Path(os.path.abspath(path.with_name(f".{path.name}.{os.getpid()}.tmp")))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        dataset.to_netcdf(temporary, engine="netcdf4", format="NETCDF4", encoding=encoding)
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, path)
    except (OSError, RuntimeError) as problem:
        # The netCDF library reports a full disk as a RuntimeError.
        reason = getattr(problem, "strerror", None) or problem
        raise StoreError(f"{path} could not be written: {reason}") from problem
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def open_results(path: str | Path) -> xr.Dataset:
    """Open a sweep's netCDF file, read into memory so that the file stays free to be replaced.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it is not the result of a sweep.
    """
    file = Path(os.path.abspath(Path(path).expanduser()))
    if not file.is_file():
        raise FileNotFoundError(f"{path}: there is no such file")
    if not os.access(file, os.R_OK):
        raise ValueError(f"{path}: it cannot be read")
    try:
        with xr.open_dataset(file, engine="netcdf4") as dataset:
            dataset.load()
    except (OSError, ValueError):
        raise ValueError(f"{path}: it is damaged or not netCDF") from None
    try:
        json.loads(dataset.attrs["configuration"])["constants"]
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"{path}: it is not the result of a sweep") from None
    return dataset


def _variable(described: Variable, dims: tuple[str, ...], values: np.ndarray) -> xr.Variable:
    """A variable as it will look when it is read again: missing whole numbers are NaN."""
    encoding: dict[str, Any] = {}
    if values.dtype.kind == "i":
        encoding = {"dtype": described.dtype, "_FillValue": np.array(described.missing, described.dtype)[()]}
        values = np.where(values == described.missing, np.nan, values.astype(float))
    return xr.Variable(dims, values, _attributes(described), encoding)


def _attributes(described: Any) -> dict[str, str]:
    attributes = {"units": described.units, "long_name": described.long_name}
    values = getattr(described, "values", None)  # of an axis
    if values is not None and values.dtype.kind == "U":
        # A text has no units.
        del attributes["units"]
    return {name: text for name, text in attributes.items() if text}
