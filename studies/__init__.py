"""Predefined studies of the paper, from Python: `studies.run("fig5")`, `studies.open("fig5")`.

What they return has the accessor `.fiv` (`studies.query.accessor`): rows, figure and scenes of the result.

Nothing heavy is imported before it is used: the command line starts from here.
"""

from __future__ import annotations

# Not typing's, which takes a while to import: the command line cannot answer to Ctrl-C before it begins itself.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path
    from typing import Any

    import xarray as xr

    from studies.study import Study
    from sweeps import Plan, Progress

__all__ = ["map", "open", "run"]


def run(
    study: str | Study,
    *,
    record: Sequence[str] = (),
    sample_rate: float | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: bool | Progress = False,
    out: str | Path | None = None,
    fresh: bool = False,
    scatter: Mapping[str, str] | None = None,
    samples: int | None = None,
    seed: int | None = None,
    sampling: str | None = None,
    points: str | Path | Mapping[str, Any] | None = None,
    **axes: Any,
) -> xr.Dataset:
    """Run a study, keep its netCDF file and figure in the results folder, and return its dataset.

    Parameters
    ----------
    study : str or Study
        A name that `fiv list` shows, or a `studies.study.Study`.
    record : sequence of str
        Time series to keep, such as "velocity_B" and "normal_force".
    sample_rate : float, optional
        Sampling rate of recorded series, Hz.
    scheduler : str, optional
        "threads", "sync", or a Dask scheduler's address; by default what Dask is configured for, else threads.
    workers : int, optional
        Processes on this machine; with "threads", threads.
    progress : bool or callable
        True shows a bar, in a terminal or a notebook; a callable gets a `sweeps.Snapshot` now and then.
    out : str or Path, optional
        The results folder; by default FIV_RESULTS, else `results` under the current folder.
    fresh : bool
        Start over where the results folder holds the study with other settings. Otherwise what is there is kept
        and completed.
    scatter : mapping of str to str, optional
        Axes and settings to draw from distributions: ``{"mu": "normal:0.2:0.02"}``. The result is called as the
        study with `-scatter` behind it.
    samples, seed : int, optional
        Number and seed of the draws; by default 1024 and 0.
    sampling : str, optional
        "sobol" (the default), "latin" or "random".
    points : path or mapping, optional
        Rows to compute instead of a grid: a CSV file, or columns by name. The result is called as the study with
        `-points` behind it.
    **axes
        New values of an axis (a number or a list) or of a setting (a number) of the study; or as texts, as the
        command line has them: ``V="2mm/s"``, ``mu="0:0.5:101"``.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    ValueError
        If a study or an axis is unknown, or a value is out of range; nothing is written then.
    sweeps.StoreError
        If the results folder cannot be used, or holds the study with other settings.
    """
    from studies import runner
    from studies.query import accessor  # noqa: F401 - with the accessor .fiv

    where: dict[str, Any] = {"scatter": scatter, "samples": samples, "seed": seed, "sampling": sampling}
    where["points"] = points
    series: dict[str, Any] = {"record": record, "sample_rate": sample_rate}
    return _executed(runner.plan(study, axes, out, fresh=fresh, **series, **where), scheduler, workers, progress)


def map(  # shadows the built-in only as studies.map
    x: str,
    y: str | None = None,
    quantity: str = "growth_rate",
    *,
    fix: Mapping[str, Any] | None = None,
    refine: int = 0,
    tolerance: float | None = None,
    scatter: Mapping[str, str] | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: bool | Progress = False,
    out: str | Path | None = None,
    fresh: bool = False,
) -> xr.Dataset:
    """Map one quantity over two axes, or along one, keep the netCDF file and figure, and return the dataset.

    Parameters
    ----------
    x, y : str
        AXIS=SPEC as on the command line: ``x="theta=-10:20:61"``, ``y="p1_thickness=1.5mm:3mm:40"``.
    quantity : str
        A name that `fiv map --help` lists.
    fix : mapping, optional
        Other axes and settings, numbers or texts with units: ``{"theta": 8, "p1_length": "60mm"}``.
    refine : int
        How often intervals are halved where the quantity changes.
    tolerance : float, optional
        Largest estimated error of interpolation in a refined map, as a share of the range of the values.
    scatter : mapping of str to str, optional
        For ``quantity="probability_unstable"``: ``{"p1_length": "normal:50:0.1mm"}``.
    scheduler, workers, progress, out, fresh
        The same as in `run`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    ValueError, sweeps.StoreError
        The same as in `run`.
    """
    from dataclasses import replace

    from studies import runner
    from studies.maps import maps
    from studies.query import accessor  # noqa: F401 - with the accessor .fiv

    constants = maps.fixed_of([f"{name}={value}" for name, value in (fix or {}).items()])
    plane = maps.plane_of(x, y or maps.line_along(x, quantity, constants), refine)
    sweep = maps.sweep_of(plane, quantity, constants, refine, tolerance, scatter)
    sweep = replace(sweep, remark=runner.remark(maps.unusual_in(plane, quantity, constants), strict=False))
    planned = sweep.plan(maps.file_of(plane, quantity, out, constants, scatter), fresh=fresh)
    return _executed(planned, scheduler, workers, progress)


def _executed(planned: Plan, scheduler: str | None, workers: int | None, progress: bool | Progress) -> xr.Dataset:
    """Execute a plan and return the dataset of its file."""
    from contextlib import nullcontext

    from studies import runner
    from studies.cli.progress import bar

    shown = bar(planned.todo) if progress is True else nullcontext(progress or None)
    with shown as callback:
        return runner.execute(planned, *runner.backend(scheduler, workers), callback).dataset


def open(name: str, out: str | Path | None = None) -> xr.Dataset:  # shadows the built-in only as studies.open
    """Open the kept results of a study: by its name, in the results folder `out`, or by the path of its file.

    If the folder lacks it, the reference is opened, with a warning.
    """
    from warnings import warn

    from studies import results
    from studies.query import accessor  # noqa: F401 - with the accessor .fiv

    dataset = results.open_dataset(name, out)
    if notice := results.notice(name, out):
        warn(notice, stacklevel=2)
    return dataset
