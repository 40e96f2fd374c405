"""Folders and files of results, how they are opened, and their fixed parameters."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import sweeps
from fivcore import Rig, Structure
from studies.declaring.own import parameters, varied
from studies.declaring.parameters import RIG
from sweeps import InputError, MissingFileError

if TYPE_CHECKING:
    import xarray as xr

# The repository's own outcomes, maps and fits, in the results folder.
REFERENCE, MAPS, FITS = "reference", "map", "fit"
# In the folder of a named rig (`studies.asking.rigs`).
RIG_FILE = "rig.toml"
# Dimensions of points that vary together: draws, and rows of a table.
PATHS = ("sample", "row")


def results_folder(out: str | Path | None = None) -> Path:
    """The results folder: `out`, else FIV_RESULTS, else `results` under the current folder."""
    return expanded(out or os.environ.get("FIV_RESULTS") or "results")


def existing(out: str | Path | None, study: str = "") -> str | Path | None:
    """Return a results folder to read; raise an `InputError` if it is named and does not exist.

    The message gives the command that computes the result of a `study` there.
    """
    if out and not results_folder(out).is_dir():
        compute = f"; compute it with: {command('run', study, out)}" if study else ""
        raise MissingFileError(f"no results in {out}: the folder does not exist{compute}")
    return out


def expanded(path: str | Path) -> Path:
    """A path with the home folder in place of `~`, or an `InputError` if there is none.

    Raises
    ------
    OSError
        If the path cannot be examined; from Python 3.14 on `exists` would report that it does not exist.
    """
    try:
        expanded = Path(path).expanduser()
    except RuntimeError:
        raise InputError(f"{path}: {Path(path).parts[0]} has no home folder; write the whole path") from None
    with suppress(FileNotFoundError, NotADirectoryError, ValueError):
        os.lstat(expanded)
    return expanded


def is_script(text: str) -> bool:
    """Whether STUDY is the path of a Python file."""
    return text.endswith(".py")


def is_path(text: str) -> bool:
    """Whether a STUDY or PATH names the file of a result, and not a study."""
    return not is_script(text) and (text.endswith(".nc") or os.sep in text)


def file_of(study: str, out: str | Path | None = None) -> Path:
    """The netCDF file of a study, by its name."""
    return results_folder(out) / study / f"{study}.nc"


def file_of_fit(name: str, out: str | Path | None = None) -> Path:
    """The netCDF file of a fit, by its name."""
    return file_of(name, results_folder(out) / FITS)


def reference_folder(out: str | Path | None = None) -> Path:
    """The repository's own outcomes: below the results folder, else below `results` of the current folder.

    They are of the paper's rig: below the folder of another there are none.
    """
    folder = results_folder(out) / REFERENCE
    return folder if folder.is_dir() or rig_in(folder.parent) else Path("results") / REFERENCE


def rig_in(folder: Path) -> str:
    """The name of the rig whose results lie in a folder; "" if it is none of a named rig."""
    return folder.resolve().name if (folder / RIG_FILE).is_file() else ""


def is_own(folder: Path) -> bool:
    """Whether a folder is the repository's reference, which runs do not write."""
    return folder.name == REFERENCE and (folder / "rig.svg").exists()


def is_reference(file: Path) -> bool:
    """Whether a file is one of the repository's own outcomes."""
    return is_own(file.parent.parent)


def results_file(name: str | Path, out: str | Path | None = None) -> Path:
    """The netCDF file of a study, map or fit by name or path; that of the reference if the folder lacks it."""
    text = os.fspath(name)
    if is_path(text):
        return expanded(text)
    own = results_folder(out) / MAPS / f"{text}.nc", file_of_fit(text, out)
    places = [file_of(text, out), *own, file_of(text, reference_folder(out))]
    return next((file for file in places if sweeps.Store(file).exists()), places[0])


def stored(out: str | Path | None = None) -> list[Path]:
    """All results of a folder, without the reference: studies and fits by name, then maps."""
    folder = results_folder(out)
    found = [path for place in ("*", f"{FITS}/*") for path in folder.glob(f"{place}/*.nc*")]
    parts = {p.with_name(f"{p.name.partition('.nc.')[0]}.nc") for p in found if p.name.endswith("parts")}
    files = {*(path for path in found if path.suffix == ".nc"), *parts}
    return sorted(
        (file for file in files if not file.name.startswith(".")), key=lambda f: (f.parent.name == MAPS, f)
    )


def open_dataset(name: str | Path, out: str | Path | None = None) -> xr.Dataset:
    """The stored results of a study or a map, by name or by path, of an unfinished run the points so far.

    Raises
    ------
    MissingFileError
        If the folder and the reference lack them; the message lists what the folder has.
    """
    text, file = os.fspath(name), results_file(name, out)
    try:
        dataset = sweeps.open_results(file)
    except FileNotFoundError:
        if is_path(text):
            raise
        names = ", ".join(path.stem for path in stored(out))
        there = f"which has results of {names}" if names else "which is empty"
        raise MissingFileError(
            f"no result {text!r} in {results_folder(out)}, {there}; compute it with studies.run"
        ) from None
    owner = dataset.attrs.get("sweep")
    if not (is_path(text) or owner in (file.stem, f"{FITS}_{file.stem}") or file.parent.name == MAPS):
        raise InputError(f"{file}: it holds the results of {owner}, not of {file.stem}")
    return settled(dataset)


def notice(name: str | Path, out: str | Path | None = None) -> str:
    """A note that the reference replaces a missing result; "" if the result is not missing."""
    text = os.fspath(name)
    if is_path(text) or not is_reference(file := results_file(text, out)):
        return ""
    return f"{results_folder(out) / file.stem} has no result; this is the reference, {file}"


@contextmanager
def damage_as_error(file: Path | None) -> Iterator[None]:
    """Turn the error of a damaged large file, which netCDF finds when values are read, into an `InputError`."""
    try:
        yield
    except RuntimeError as problem:
        if not str(problem).startswith("NetCDF: "):
            raise
        raise InputError(f"{file}: it is damaged: {problem}") from None


def command(verb: str, study: str, out: str | Path | None = None) -> str:
    """A command of `fiv` for the same results folder, or for the rig whose folder it is."""
    rig = []
    if out and (name := rig_in(folder := results_folder(out))):
        rig, out = ["--rig", name], None if folder.parent == results_folder() else folder.parent
    return shlex.join(["fiv", verb, study, *rig, *(["--out", os.fspath(out)] if out else [])])


def configuration(dataset: xr.Dataset) -> dict[str, Any]:
    """Name, axes, constants and request of a result, from its file; {} if it is not the result of a sweep."""
    values: dict[str, Any] = json.loads(dataset.attrs.get("configuration", "{}"))
    return values


def settings(dataset: xr.Dataset) -> dict[str, Any]:
    """Values of the fixed parameters of a result."""
    return {name: value for name, (value, *_) in _fixed(dataset).items()}


def _fixed(dataset: xr.Dataset) -> dict[str, Any]:
    """Value, units and long name of each fixed parameter."""
    fixed: dict[str, Any] = configuration(dataset).get("request", {}).get("fixed", {})
    return fixed


def is_fit(dataset: xr.Dataset) -> bool:
    """Whether a result is that of a fit (`studies.fitting`)."""
    return set(configuration(dataset).get("constants", {})) >= {"unknown", "targets"}


def structure_in(dataset: xr.Dataset) -> dict[str, Any]:
    """The structure of a result, as `fivcore.Structure.to_dict`, with its `name`; {} of a result of beams."""
    structure: dict[str, Any] = configuration(dataset).get("constants", {}).get("structure") or {}
    return structure


def own_numbers(dataset: xr.Dataset) -> list[str]:
    """Names of the numbers of its structure that are coordinates of a result."""
    structure = structure_in(dataset)
    return [n for n in parameters(Structure.from_dict(structure)) if n in dataset.coords] if structure else []


def rig_of(dataset: xr.Dataset) -> Any:
    """The rig or structure of a result; an `InputError` names a number that varies or is missing."""
    if structure := structure_in(dataset):
        numbers = {name: dataset[name] for name in own_numbers(dataset)}
        for name in (name for name, value in numbers.items() if value.ndim):
            raise InputError(f"{name}: it varies, so the result has no single structure")
        return varied(Structure.from_dict(structure), {name: value.item() for name, value in numbers.items()})
    for name in RIG:
        if name not in dataset.coords or dataset[name].ndim:
            what = "varies" if name in dataset.coords else "is not in the file"
            raise InputError(f"{name}: it {what}, so the result has no single rig")
    return Rig.of(**{name: dataset[name].item() for name in RIG})


def settled(dataset: xr.Dataset, about: Mapping[str, tuple[Any, str, str]] | None = None) -> xr.Dataset:
    """Add fixed parameters as scalar coordinates: value, units and long name; None, "auto", is NaN.

    By default those of the file's request, for a result that is not finished.
    """
    scalars = {
        name: ((), np.nan if value is None else value, {"units": units, "long_name": text})
        for name, (value, units, text) in (_fixed(dataset) if about is None else about).items()
        if name not in dataset.variables and name not in dataset.dims
    }
    return dataset.assign_coords(scalars)


def is_usual(dataset: xr.Dataset, dims: tuple[str, ...]) -> bool:
    """Whether the points of a result have these dimensions; without any (a map), one or two parameters."""
    found = tuple(map(str, dataset["status"].dims))
    # A structure has no numbers of the beams.
    dims = tuple(dim for dim in dims if dim not in RIG) if structure_in(dataset) else dims
    return found == dims if dims else len(found) <= 2 and found[0] not in PATHS


def with_variables(dataset: xr.Dataset, added: Mapping[str, tuple[Any, Any, str, str]]) -> xr.Dataset:
    """Add derived variables by their names: dimensions, values, units and long name; own dimensions are axes."""
    named = {n: (dims, values, {"units": u, "long_name": text}) for n, (dims, values, u, text) in added.items()}
    return dataset.assign_coords({n: v for n, v in named.items() if n == v[0]}).assign(
        {n: v for n, v in named.items() if n != v[0]}
    )
