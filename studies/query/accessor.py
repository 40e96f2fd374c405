"""The accessor `.fiv` of xarray's datasets: rows, figure and scenes of a result.

It is there once `studies.run` or `studies.open` was called, or after ``import studies.query.accessor``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from fivcore import Scene


@xr.register_dataset_accessor("fiv")  # type: ignore[no-untyped-call]
class Accessor:
    """Rows, figure and scenes of a result.

    Parameters
    ----------
    dataset : xarray.Dataset
        As `studies.open`, `sweeps.open_results` or ``xarray.open_dataset`` give it, or a part of one.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def query(self, where: str | None = None, **options: Any) -> pd.DataFrame:
        """Rows as a data frame, like ``fiv query``; options as `studies.query.query.query` has them."""
        from studies.query.query import frame

        return frame(self._dataset, 3, where, **options)

    def plot(self, path: str | Path | None = None, format: str | None = None) -> Figure | Path:
        """Draw the study's figure.

        Parameters
        ----------
        path : path, optional
            The file to write; without it none is.
        format : {"png", "svg", "pdf"}, optional
            By default what the path ends with, else png.

        Returns
        -------
        matplotlib.figure.Figure or Path
            The figure, which a notebook shows; with a path, what was written.

        Raises
        ------
        ValueError
            If the result is of no study, or lacks something that the figure shows; for another format.
        sweeps.StoreError
            If the figure cannot be written.
        """
        from studies import results, runner

        study = results.study_of(self._dataset)
        if path is None:
            return runner.drawn(study, self._dataset)
        form = runner.format_of(path, format)
        return runner.plot(study, self._dataset, Path(path), form, "dataset")

    def scene(self, point: Mapping[str, float] | None = None, /, **named: float) -> Scene:
        """The scene behind a point, ready for `fivcore.simulate`; see `studies.query.scene_at.scene`.

        ``data.fiv.scene(mu=0.2)`` and ``data.fiv.scene({"mu": 0.2})`` are the same.
        """
        from studies.query.scene_at import scene

        return scene(self._dataset, **(dict(point or {}) | named))

    def run_options(self, point: Mapping[str, float] | None = None, /, **named: float) -> dict[str, Any]:
        """How that scene was run: ``simulate(data.fiv.scene(V=2e-3), **data.fiv.run_options(V=2e-3))``.

        See `studies.query.scene_at.run_options`.
        """
        from studies.query.scene_at import run_options

        return run_options(self._dataset, **(dict(point or {}) | named))
