"""Where results are: folders, files, and how they are opened."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import sweeps
from studies import registry
from sweeps import InputError

if TYPE_CHECKING:
    import xarray as xr

    from studies.study import Study


def results_folder(out: str | Path | None = None) -> Path:
    """Where results go: `out`, else FIV_RESULTS, else `results` under the current folder."""
    return Path(out or os.environ.get("FIV_RESULTS") or "results").expanduser()


def is_path(text: str) -> bool:
    """Whether a STUDY or PATH names the file of a result, and not a study."""
    return not registry.is_file(text) and (text.endswith(".nc") or os.sep in text)


def file_of(study: str, out: str | Path | None = None) -> Path:
    """The netCDF file of a study, by its name."""
    return results_folder(out) / study / f"{study}.nc"


def results_file(name: str | Path, out: str | Path | None = None) -> Path:
    """The netCDF file that a STUDY or a PATH names; a study of one's own, or a map, is found by its name too."""
    text, folder = os.fspath(name), results_folder(out)
    if is_path(text):
        return Path(text).expanduser()
    if registry.is_file(text):
        return file_of(registry.resolve(text).name, out)
    if text in registry.names():
        return file_of(text, out)
    for found in (folder / kind / f"{text}.nc" for kind in (text, *registry.UNLISTED)):
        if found.exists() or found.with_suffix(".parts").exists():
            return found
    return file_of(registry.load(text).name, out)  # raises, unless this process was given it


def open_dataset(name: str | Path, out: str | Path | None = None) -> xr.Dataset:
    """The kept results of a study, by name, by its FILE.py, or by their own path; whole or as far as they are."""
    text, file = os.fspath(name), results_file(name, out)
    if is_path(text):
        return sweeps.open_results(file)
    try:
        dataset = sweeps.open_results(file)
    except FileNotFoundError:
        raise FileNotFoundError(
            f"{file}: there is no such file; make it with: {command('run', text, out)}"
        ) from None
    owner = dataset.attrs.get("sweep")
    if owner not in (file.stem, *registry.UNLISTED):
        raise InputError(f"{file}: it holds the results of {owner}, not of {file.stem}")
    return dataset


def command(verb: str, study: str, out: str | Path | None = None) -> str:
    """A command of `fiv` as one types it, into the same results folder."""
    return shlex.join(["fiv", verb, study, *(["--out", os.fspath(out)] if out else [])])


def study_of(dataset: xr.Dataset, whose: str = "dataset") -> Study:
    """The study that a dataset is the result of.

    Raises
    ------
    InputError
        If no name that is known stands for it.
    """
    name = str(dataset.attrs.get("sweep", ""))
    try:
        return registry.load(name)
    except InputError:
        raise InputError(
            f"{whose}: {name!r} is a study of a file of one's own, or none; name the file: fiv plot FILE.py"
        ) from None
