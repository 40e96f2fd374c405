"""The way of a study through the house: declared, planned, computed, stored, drawn."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sweeps
from studies import registry

if TYPE_CHECKING:
    import xarray as xr

    from studies.study import Study
    from sweeps.plan import Progress


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
    return Path(out or os.environ.get("FIV_RESULTS") or "results")


def plan(name: str, given: Mapping[str, Any], out: str | Path | None = None) -> sweeps.Plan:
    """The plan of a study, with its file in the results folder."""
    return registry.load(name).sweep(given).plan(results_folder(out) / name / f"{name}.nc")


def run(name: str, given: Mapping[str, Any], out: str | Path | None = None) -> Finished:
    """Plan and execute a study."""
    return execute(plan(name, given, out))


def execute(
    planned: sweeps.Plan,
    scheduler: str = "threads",
    workers: int | None = None,
    progress: Progress | None = None,
) -> Finished:
    """Run a study's plan, then draw what it stored."""
    study = registry.load(planned.sweep.name)
    assert planned.store is not None
    dataset = planned.run(scheduler, workers, progress)
    return Finished(study, dataset, planned.store, plot(study, dataset, planned.store))


def open_dataset(name: str, out: str | Path | None = None) -> xr.Dataset:
    """The kept results of a study, by name or by path."""
    return sweeps.open_results(results_file(name, out))


def results_file(name: str, out: str | Path | None = None) -> Path:
    """The netCDF file that a STUDY or a PATH names."""
    if name in registry.NAMES:
        return results_folder(out) / name / f"{name}.nc"
    if name.endswith(".nc") or os.sep in name:
        return Path(name)
    registry.load(name)
    raise AssertionError("load raises for a name that is no study")


def plot(study: Study, dataset: xr.Dataset, beside: Path) -> Path:
    """Draw the study's figure to a PNG beside its netCDF file."""
    figure = study.draw(dataset)
    target = beside.with_suffix(".png")
    temporary = beside.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        figure.savefig(temporary, format="png", dpi=200)
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return target
