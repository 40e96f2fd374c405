"""The way of a study through the house: declared, planned, computed, stored, drawn."""

from __future__ import annotations

import os
import re
import shlex
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import sweeps
from studies import registry
from studies.comparison import compared
from studies.config import read_values, request
from studies.plausible import UnusualWarning, unusual
from studies.results import FOLDER, command, file_of, open_dataset, reference_folder, results_folder
from studies.spec import typed
from sweeps import InputError, check_backend

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from studies.study import Study
    from sweeps import Progress

# What a figure may be written as.
FORMATS = ("png", "svg", "pdf")


@dataclass(frozen=True, eq=False)
class Finished:
    """Result, file and figure of a finished run."""

    study: Study
    dataset: xr.Dataset
    file: Path
    figure: Path

    @property
    def figures(self) -> list[Path]:
        """The study's figure, and that of its recorded series where there are any."""
        series = series_file(self.figure)
        return [self.figure, *([series] if "elapsed" in self.dataset.dims and series.exists() else [])]

    def beside_reference(self) -> str:
        """How far it is from the reference, in a line; "" where there is none."""
        name = self.study.name
        reference = file_of(name, reference_folder(self.file.parent.parent))
        return compared(name, self.dataset, open_dataset(reference)) if reference.exists() else ""

    @property
    def failed(self) -> int:
        """Points that failed."""
        return int((self.dataset["status"] == sweeps.FAILED).sum())


def plan(
    study: str | Study,
    given: Mapping[str, Any],
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    retry_failed: bool = False,
    record: Sequence[str] = (),
    sample_rate: float | None = None,
    reference: bool = False,
    strict: bool = False,
    **points: Any,
) -> sweeps.Plan:
    """The plan of a study (`registry.resolve`), with its file in the results folder.

    Values that a rig like this hardly has are a warning, or, if it is `strict`, an `InputError`; so are points
    computed in several environments.
    `points` says where its points are if they are no grid: scatter, samples, seed, sampling; or points
    (`studies.scatter.study.scattered`).

    An `InputError` refuses a sweep that is not called as its study, and the folder of the reference unless that is
    to be made.
    """
    # With distributions comes all of SciPy's statistics, and most commands compute nothing.
    from studies.scatter.study import scattered

    if results_folder(out).name == FOLDER and not reference:
        raise InputError(f"{results_folder(out)}: runs only read the reference; choose another folder (--out)")
    one = registry.resolve(study)
    given = read_values(one, given)
    one = scattered(one, given, **points)
    sweep = one.sweep(given, record=record, sample_rate=sample_rate)
    if sweep.name != one.name:
        raise InputError(
            f"build: the sweep is called {sweep.name!r}; it must be called as the study, {one.name!r}"
        )
    values = {name: setting.value for name, setting in one.settings.items()} | dict(given)
    values |= {name: axis.values for name, axis in sweep.grid.axes.items()}
    lines = unusual(values, {name: one.units(name) for name in values}, {*given, *one.request.get("scatter", ())})
    # A study of somebody's file, or at scattered points, has no command for one of them.
    named = one.name in registry.MODULES
    sweep = replace(
        sweep,
        request=request(one, given, tuple(record), sample_rate),
        remark=remark(lines, strict=strict),
        rerun=partial(rerun, one.name, given) if named else None,
    )
    return sweep.plan(file_of(one.name, out), fresh=fresh, retry_failed=retry_failed, strict=strict)


def rerun(study: str, given: Mapping[str, Any], point: Mapping[str, Any]) -> str:
    """The command that computes one point of a study, with the values `given`, again."""
    values = {name: value for name, value in given.items() if np.ndim(value) == 0} | dict(point)
    settings = [f"{name}={typed(value)}" for name, value in values.items()]
    options = [word for each in settings for word in ("--set", each)]
    return shlex.join(["fiv", "run", study, *options, "--scheduler", "sync", "--out", "again"])


def remark(lines: Sequence[str], *, strict: bool) -> str:
    """Warn about unusual values and return a text for the file's history; if `strict`, raise an `InputError`."""
    if lines and strict:
        raise InputError(f"{lines[0]}; leave --strict out to compute it all the same")
    for line in lines:
        warnings.warn(line, UnusualWarning, stacklevel=3)
    return "; ".join(lines)


def run(
    study: str | Study,
    values: Mapping[str, Any],
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    **points: Any,
) -> Finished:
    """Plan and execute a study, by its name, the file that defines it, or as it is."""
    return execute(plan(study, values, out, fresh=fresh, **points), *backend(None, None))


def backend(scheduler: str | None, workers: int | None) -> tuple[str, int | None]:
    """Back end and workers for `Plan.run`: as requested; else Dask's configured cluster; else threads.

    Workers without a scheduler are processes on this machine. Other combinations raise an `InputError`.
    """
    if scheduler is None:
        import dask

        address = dask.config.get("scheduler-address", None)
        if address is not None and "://" not in str(address):
            raise InputError(f"DASK_SCHEDULER_ADDRESS = {address!r}: it must be an address like tcp://host:8786")
        scheduler = "processes" if workers is not None else (address or "threads")
    if "://" in scheduler and workers is not None:
        raise InputError(f"--workers {workers}: the cluster at {scheduler} has workers of its own; leave it out")
    check_backend(scheduler, workers)
    return scheduler, workers


def execute(
    planned: sweeps.Plan,
    scheduler: str = "threads",
    workers: int | None = None,
    progress: Progress | None = None,
    *,
    fail_fast: bool = False,
) -> Finished:
    """Run a study's plan, then draw what its file holds, which may be more than was asked for now."""
    study = registry.load(planned.sweep.name)
    assert planned.store is not None
    dataset = planned.run(scheduler, workers, progress, fail_fast=fail_fast)
    whole = dataset if planned.points == planned.manifest.grid.size else sweeps.open_results(planned.store)
    return Finished(study, dataset, planned.store, plot(study, whole, planned.store))


def drawn(study: Study, dataset: xr.Dataset, whose: str = "dataset") -> Figure:
    """The study's figure, or an `InputError` if the dataset, which is of the file `whose`, lacks what it shows."""
    from studies.plotting import figures

    with figures.style():
        try:
            return study.draw(dataset)
        except KeyError as missing:
            # xarray lists everything that there is.
            name = re.sub(r"^No variable named '?([^']*)'?\..*$", r"\1", str(missing.args[0]), flags=re.DOTALL)
            file = Path(whose)
            usual = file_of(study.name).resolve() == file.resolve() or file.parent.name != study.name
            again = command("run", study.name, None if usual else file.parent.parent)
            raise InputError(
                f"{whose}: it lacks {name}, which the figure shows; make it whole with: {again}"
            ) from None


def format_of(path: str | Path, form: str | None = None) -> str:
    """Format of a figure, one of `FORMATS`: as requested, else the path's suffix, else png."""
    chosen = form or Path(path).suffix.removeprefix(".") or FORMATS[0]
    if chosen not in FORMATS:
        raise InputError(f"format = {chosen!r}: it must be one of {', '.join(FORMATS)}")
    return chosen


def plot(study: Study, dataset: xr.Dataset, beside: Path, form: str = "png", whose: str | None = None) -> Path:
    """Draw the study's figure beside its netCDF file, in one of `FORMATS`, and the series that it does not show.

    `whose` is what a message calls the dataset; by default it is that file's.
    """
    target = beside.with_suffix(f".{form}")
    whole = image(study, dataset, form, whose or str(beside))
    with written(target) as temporary:
        temporary.write_bytes(whole)
    if (series := series_of(study, dataset, form)) is not None:
        with written(series_file(target)) as temporary:
            temporary.write_bytes(series)
    return target


def series_file(figure: Path) -> Path:
    """Where recorded series are drawn, beside the study's figure."""
    return figure.with_name(f"{figure.stem}-series{figure.suffix}")


def series_of(study: Study, dataset: xr.Dataset, form: str = "png") -> bytes | None:
    """The recorded series that the study's own figure does not show, as a file; None where there is none."""
    if "elapsed" not in dataset.dims:
        return None
    from studies.motion import series_figure
    from studies.plotting import figures

    names = series_figure.names(study, dataset)
    if not names:
        return None
    with figures.style():
        return figures.saved(series_figure.draw(dataset, names), form, figures.data_digest(dataset))


def image(study: Study, dataset: xr.Dataset, form: str = "png", whose: str = "dataset") -> bytes:
    """The study's figure (`drawn`) as a file that names its data (`studies.plotting.figures.data_digest`)."""
    # Drawing is slow to import, and most commands do not draw.
    from studies.plotting import figures

    with figures.style():
        return figures.saved(drawn(study, dataset, whose), form, figures.data_digest(dataset))


@contextmanager
def written(target: Path) -> Iterator[Path]:
    """A temporary file beside `target`, which takes its place when all has gone well, or a `StoreError`."""
    if target.exists() and not target.is_file():
        raise sweeps.StoreError(f"{target} could not be written: it is no file; choose another name")
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, target)
    except OSError as problem:
        raise sweeps.StoreError(f"{target} could not be written: {problem.strerror}") from problem
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
