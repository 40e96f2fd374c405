"""Where results are: folders, files, and how they are opened."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import sweeps
from studies import registry
from sweeps import InputError, MissingFileError

if TYPE_CHECKING:
    import xarray as xr

    from studies.study import Study


# The repository's own outcomes, in the results folder.
FOLDER = "reference"


def results_folder(out: str | Path | None = None) -> Path:
    """Where results go: `out`, else FIV_RESULTS, else `results` under the current folder."""
    return registry.expanded(out or os.environ.get("FIV_RESULTS") or "results")


def is_path(text: str) -> bool:
    """Whether a STUDY or PATH names the file of a result, and not a study."""
    return not registry.is_file(text) and (text.endswith(".nc") or os.sep in text)


def file_of(study: str, out: str | Path | None = None) -> Path:
    """The netCDF file of a study, by its name."""
    return results_folder(out) / study / f"{study}.nc"


def reference_folder(out: str | Path | None = None) -> Path:
    """The repository's own outcomes: below the results folder, else below `results` of the current folder."""
    own = results_folder(out) / FOLDER
    return own if own.is_dir() else Path("results") / FOLDER


def is_reference(file: Path) -> bool:
    """Whether a file is one of the repository's own outcomes."""
    return file.parent.parent.name == FOLDER


def notice(name: str | Path, out: str | Path | None = None) -> str:
    """A note that the reference replaces a result that the folder lacks; "" where it does not."""
    text = os.fspath(name)
    if is_path(text) or not is_reference(file := results_file(text, out)):
        return ""
    return f"{results_folder(out) / file.stem} has no result; this is the reference, {file}"


def is_there(file: Path) -> bool:
    """Whether there is a result, finished or not."""
    return sweeps.Store(file).exists()


def results_file(name: str | Path, out: str | Path | None = None) -> Path:
    """The netCDF file that a STUDY or a PATH names; a study of one's own, or a map, is found by its name too.

    Where nothing of one's own is there, it is that of the reference, if there is one.
    """
    text = os.fspath(name)
    if is_path(text):
        return registry.expanded(text)
    if registry.is_file(text):
        return file_of(registry.resolve(text).name, out)
    places = [results_folder(out) / kind / f"{text}.nc" for kind in (text, *registry.UNLISTED)]
    if text in registry.names():
        places = [places[0], file_of(text, reference_folder(out))]
    # Of what is nowhere: where a run would leave it, if there is such a study.
    return next(filter(is_there, places), None) or file_of(registry.load(text).name, out)


def open_dataset(name: str | Path, out: str | Path | None = None) -> xr.Dataset:
    """The kept results of a study, by name, by its FILE.py, or by their own path; whole or as far as they are."""
    text, file = os.fspath(name), results_file(name, out)
    if is_path(text):
        return sweeps.open_results(file)
    try:
        dataset = sweeps.open_results(file)
    except FileNotFoundError:
        base, suffix = registry.parted(text)
        how = f" {registry.SUFFIXES[suffix]}" if suffix else ""
        raise MissingFileError(
            f"{file}: there is no such file; make it with: {command('run', base, out)}{how}"
        ) from None
    owner = dataset.attrs.get("sweep")
    if owner not in (file.stem, *registry.UNLISTED):
        raise InputError(f"{file}: it holds the results of {owner}, not of {file.stem}")
    return dataset


@contextmanager
def reading(file: Path | None) -> Iterator[None]:
    """Turn the damage of a large file, which netCDF finds when its values are used, into an `InputError`."""
    try:
        yield
    except RuntimeError as problem:
        if not str(problem).startswith("NetCDF: "):
            raise
        raise InputError(f"{file}: it is damaged: {problem}") from None


def command(verb: str, study: str, out: str | Path | None = None) -> str:
    """A command of `fiv` as one types it, into the same results folder."""
    return shlex.join(["fiv", verb, study, *(["--out", os.fspath(out)] if out else [])])


def study_of(dataset: xr.Dataset, whose: str = "dataset") -> Study:
    """The study that a dataset is the result of, or an `InputError` if no study has its name."""
    name = str(dataset.attrs.get("sweep", ""))
    try:
        return registry.load(name)
    except InputError:
        base, suffix = registry.parted(name)
        if suffix:
            shown: Study = import_module("studies.scatter.study").nameless(base, suffix)
            return shown
        raise InputError(
            f"{whose}: {name!r} is a study of a file of one's own, or none; name the file: fiv plot FILE.py"
        ) from None
