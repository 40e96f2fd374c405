"""The way of a study through the house: declared, planned, computed, stored, drawn."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import sweeps
from studies import registry
from sweeps import check_backend

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from studies.study import Study
    from sweeps import Progress


# What a figure may be written as.
FORMATS = ("png", "svg", "pdf")


@dataclass(frozen=True, eq=False)
class Finished:
    """What a run leaves behind."""

    study: Study
    dataset: xr.Dataset
    file: Path
    figure: Path

    @property
    def failed(self) -> int:
        """Points that failed."""
        return int((self.dataset["status"] == 2).sum())


def results_folder(out: str | Path | None = None) -> Path:
    """Where results go: `out`, else FIV_RESULTS, else `results` under the current folder."""
    return Path(out or os.environ.get("FIV_RESULTS") or "results").expanduser()


def plan(
    study: str | Study,
    given: Mapping[str, Any],
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    retry_failed: bool = False,
    record: Sequence[str] = (),
    sample_rate: float | None = None,
) -> sweeps.Plan:
    """The plan of a study, by its name or one's own, with its file in the results folder.

    Raises
    ------
    ValueError
        For a study of one's own that has another's name, or whose sweep is not called as it is.
    """
    own = _own(study)
    one = own or registry.load(cast(str, study))
    if own is not None and one.name in (*registry.NAMES, *registry.UNLISTED):
        raise ValueError(f"name = {one.name!r}: a predefined study is called so; choose another")
    sweep = one.sweep(given, record=record, sample_rate=sample_rate)
    if sweep.name != one.name:
        raise ValueError(
            f"build: the sweep is called {sweep.name!r}; it must be called as the study, {one.name!r}"
        )
    file = results_folder(out) / one.name / f"{one.name}.nc"
    return sweep.plan(file, fresh=fresh, retry_failed=retry_failed)


def run(
    study: str | Study, given: Mapping[str, Any], out: str | Path | None = None, *, fresh: bool = False
) -> Finished:
    """Plan and execute a study, by its name or one's own."""
    return execute(plan(study, given, out, fresh=fresh), *backend(None, None), study=_own(study))


def _own(study: str | Study) -> Study | None:
    """A study that is given as such, and not by its name."""
    from studies.study import Study

    return study if isinstance(study, Study) else None


def check_free(name: str, out: str | Path | None = None) -> None:
    """Refuse, before anything is planned, a study that another run is writing."""
    registry.load(name)
    sweeps.check_free(results_file(name, out))


def backend(scheduler: str | None, workers: int | None) -> tuple[str, int | None]:
    """What `Plan.run` needs: as asked; else a cluster that Dask is configured for; else threads.

    Workers without a scheduler are processes on this machine.

    Raises
    ------
    ValueError
        If they do not go together.
    """
    if scheduler is None:
        import dask

        address = dask.config.get("scheduler-address", None)
        if address is not None and "://" not in str(address):
            raise ValueError(f"DASK_SCHEDULER_ADDRESS = {address!r}: it must be an address like tcp://host:8786")
        scheduler = "processes" if workers is not None else (address or "threads")
    if "://" in scheduler and workers is not None:
        raise ValueError(f"--workers {workers}: the cluster at {scheduler} has workers of its own; leave it out")
    check_backend(scheduler, workers)
    return scheduler, workers


def execute(
    planned: sweeps.Plan,
    scheduler: str = "threads",
    workers: int | None = None,
    progress: Progress | None = None,
    *,
    fail_fast: bool = False,
    study: Study | None = None,
) -> Finished:
    """Run a study's plan, then draw what its file holds, which may be more than was asked for now.

    A predefined study is known by its plan; one's own is given.
    """
    study = registry.load(planned.sweep.name) if study is None else study
    assert planned.store is not None
    dataset = planned.run(scheduler, workers, progress, fail_fast=fail_fast)
    whole = dataset if planned.points == planned.manifest.grid.size else sweeps.open_results(planned.store)
    return Finished(study, dataset, planned.store, plot(study, whole, planned.store))


def open_dataset(name: str | Path, out: str | Path | None = None) -> xr.Dataset:
    """The kept results of a study, by name or by path, whole or as far as they are."""
    file = results_file(name, out)
    if str(name) in registry.NAMES:
        try:
            dataset = sweeps.open_results(file)
        except FileNotFoundError:
            raise FileNotFoundError(f"{file}: there is no such file; make it with: fiv run {name}") from None
        if dataset.attrs.get("sweep") != name:
            raise ValueError(f"{file}: it holds the results of {dataset.attrs.get('sweep')}, not of {name}")
        return dataset
    return sweeps.open_results(file)


def results_file(name: str | Path, out: str | Path | None = None) -> Path:
    """The netCDF file that a STUDY or a PATH names; a study of one's own, or a map, is found by its name too."""
    text, folder = os.fspath(name), results_folder(out)
    if text in registry.NAMES:
        return folder / text / f"{text}.nc"
    if not (text.endswith(".nc") or os.sep in text):
        for found in (folder / kind / f"{text}.nc" for kind in (text, *registry.UNLISTED)):
            if found.exists() or found.with_suffix(".parts").exists():
                return found
        registry.load(text)  # raises, with a suggestion
    return Path(text).expanduser()


def study_of(dataset: xr.Dataset, whose: str = "dataset") -> Study:
    """The study that a dataset is the result of.

    Raises
    ------
    ValueError
        If it is none of fiv's own.
    """
    name = str(dataset.attrs.get("sweep", ""))
    try:
        return registry.load(name)
    except ValueError:
        raise ValueError(
            f"{whose}: {name!r} is no study of fiv, which can query it; what it shows is drawn where it is defined"
        ) from None


def drawn(study: Study, dataset: xr.Dataset, whose: str = "dataset") -> Figure:
    """The study's figure.

    Raises
    ------
    ValueError
        If the dataset lacks something that the figure shows.
    """
    from studies.plotting import figures

    with figures.style():
        try:
            return study.draw(dataset)
        except KeyError as missing:
            # xarray lists everything that there is.
            name = re.sub(r"^No variable named '?([^']*)'?\..*$", r"\1", str(missing.args[0]), flags=re.DOTALL)
            raise ValueError(
                f"{whose}: it lacks {name}, which the figure shows; make it whole with: fiv run {study.name}"
            ) from None


def format_of(path: str | Path, form: str | None = None) -> str:
    """What a figure is written as: as asked, else what its path ends with, else png.

    Raises
    ------
    ValueError
        If that is none of `FORMATS`.
    """
    chosen = form or Path(path).suffix.removeprefix(".") or FORMATS[0]
    if chosen not in FORMATS:
        raise ValueError(f"format = {chosen!r}: it must be one of {', '.join(FORMATS)}")
    return chosen


def plot(study: Study, dataset: xr.Dataset, beside: Path, form: str = "png", whose: str | None = None) -> Path:
    """Draw the study's figure beside its netCDF file, in one of `FORMATS`.

    `whose` is what a message calls the dataset; by default it is that file's.

    Raises
    ------
    ValueError
        If the file lacks something that the figure shows.
    StoreError
        If the figure cannot be written.
    """
    target = beside.with_suffix(f".{form}")
    whole = image(study, dataset, form, whose or str(beside))
    with written(target) as temporary:
        temporary.write_bytes(whole)
    return target


def image(study: Study, dataset: xr.Dataset, form: str = "png", whose: str = "dataset") -> bytes:
    """The study's figure as a file, which names the data that it shows (`studies.plotting.figures.data_digest`).

    Raises
    ------
    ValueError
        If the dataset lacks something that the figure shows.
    """
    # Drawing is slow to import, and most commands do not draw.
    from studies.plotting import figures

    with figures.style():
        return figures.saved(drawn(study, dataset, whose), form, figures.data_digest(dataset))


@contextmanager
def written(target: Path) -> Iterator[Path]:
    """A temporary file beside `target`, which takes its place when all has gone well.

    Raises
    ------
    StoreError
        If it cannot be written.
    """
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
