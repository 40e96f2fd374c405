"""Predefined studies of the paper, from Python: `studies.run("fig5")`, `studies.open("fig5")`.

What they return has the accessor `.fiv` (`studies.query.accessor`): rows, figure and scenes of the result.

Nothing heavy is imported before it is used: the command line starts from here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr

    from studies.study import Study

__all__ = ["open", "run"]


def run(
    study: str | Study,
    *,
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
        As `fiv list` shows it; or one's own (`studies.study.Study`).
    out : str or Path, optional
        The results folder; by default FIV_RESULTS, else `results` under the current folder.
    fresh : bool
        Start over where the results folder holds the study with other settings. Otherwise what is there is kept
        and completed.
    scatter : mapping of str to str, optional
        Axes and settings to draw from distributions: ``{"mu": "normal:0.2:0.02"}``. The result is called as the
        study with `-scatter` behind it.
    samples, seed : int, optional
        Of what is drawn; by default 1024 and 0.
    sampling : str, optional
        "sobol" (the default), "latin" or "random".
    points : path or mapping, optional
        Rows to compute instead of a grid: a CSV file, or columns by name. The result is called as the study with
        `-points` behind it.
    **axes
        New values of an axis (a number or a list) or of a setting (a number) of the study.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    ValueError
        For an unknown study or axis, or a value out of range; nothing is written then.
    sweeps.StoreError
        If the results folder cannot be used, or holds the study with other settings.
    """
    from studies import runner
    from studies.query import accessor  # noqa: F401 - with the accessor .fiv

    where = {"scatter": scatter, "samples": samples, "seed": seed, "sampling": sampling, "points": points}
    return runner.run(study, axes, out, fresh=fresh, **where).dataset


def open(name: str, out: str | Path | None = None) -> xr.Dataset:  # shadows the built-in only as studies.open
    """Open the kept results of a study: by its name, in the results folder `out`, or by the path of its file.

    Where nothing of one's own is there, the reference is opened, with a warning.
    """
    from warnings import warn

    from studies import results
    from studies.query import accessor  # noqa: F401 - with the accessor .fiv

    dataset = results.open_dataset(name, out)
    if notice := results.notice(name, out):
        warn(notice, stacklevel=2)
    return dataset
