"""The file of `accuracy` as a table: a row for each method and setting, over all scenes."""

from __future__ import annotations

import pandas as pd
import xarray as xr

from studies.accuracy.errors import FIGURES, WITHIN, root_mean_square
from studies.accuracy.settings import DEFAULT, FAST, OPTIONS, PAPER

MEANS = {"alone": "cpu_per_second", "batch": "batch_cpu_per_second", "step": "step", "modes": "modes"}
MEAN_SQUARES = {"mismatch": "mismatch", "scatter": "mismatch_scatter", "undamped": "mismatch_undamped"}
LARGEST = {"first_slip": "first_slip_error", "half_way": "slip_velocity_error"}


def table(data: xr.Dataset) -> pd.DataFrame:
    """Methods and settings of which a cost is known, in the file's order.

    Returns
    -------
    DataFrame
        `method`, `setting`, `label` (the setting for a reader), `cutoff` (Hz), and as MEANS, MEAN_SQUARES and
        LARGEST say: the mean, the root mean square, or the largest over scenes, with its sign. `cost`: `batch`,
        else `alone`; `ratio`: that of `paper` by default over it. `mismatch at SCENE`. `right_scenes`, of
        `known_scenes`: where every figure is within its tolerance and scatter. By each figure's name its error,
        the largest over scenes; `..._deviation`: in standard errors, the root mean square over scenes.
    """
    within, deviation = data["within"], data["error"] / data["standard_error"]
    columns = {column: data[name].mean("scene") for column, name in MEANS.items()}
    columns |= {column: root_mean_square(data[name]) for column, name in MEAN_SQUARES.items()}
    columns |= {column: largest(data[name]) for column, name in LARGEST.items()}
    for scene in data["scene"].values:
        columns[f"mismatch at {scene}"] = data["mismatch"].sel(scene=scene, drop=True)
    for k, figure in enumerate(FIGURES):
        columns[figure.name] = largest(data["error"].isel(figure=k, drop=True))
        columns[f"{figure.name}_deviation"] = root_mean_square(deviation.isel(figure=k, drop=True))
    columns["right_scenes"] = (within == WITHIN.index("yes")).sum("scene")
    columns["known_scenes"] = (within != WITHIN.index("unknown")).sum("scene")
    frame = xr.Dataset(columns).to_dataframe(["method", "setting"]).reset_index()
    frame["label"] = [label(*each) for each in zip(frame["setting"], frame["cutoff"], strict=True)]
    frame["cost"] = frame["batch"].fillna(frame["alone"])
    frame["ratio"] = default(frame, PAPER)["alone"].sum(min_count=1) / frame["cost"]
    return frame[frame["alone"].notna()].reset_index(drop=True)


def largest(values: xr.DataArray) -> xr.DataArray:
    """Of the largest magnitude over scenes, with its sign; NaN where there is none."""
    values = values.drop_vars("scene")
    return values.isel(scene=abs(values).fillna(-1.0).argmax("scene"))


def label(setting: str, cutoff: float) -> str:
    """A setting for a reader: a cut-off in kHz, and not in units of P1's first axial frequency."""
    return f"cut-off {1e-3 * cutoff:.3g} kHz" if OPTIONS[setting].kind == "cut-off" else setting


def default(frame: pd.DataFrame, method: str = FAST) -> pd.DataFrame:
    """The row of a method by default, if there is one."""
    return frame[(frame["method"] == method) & (frame["setting"] == DEFAULT)]


def cheapest_right(frame: pd.DataFrame) -> pd.DataFrame:
    """The row of the cheapest that is right at every scene, if there is one."""
    right = (frame["known_scenes"] > 0) & (frame["right_scenes"] == frame["known_scenes"])
    return frame[right].nsmallest(1, "cost")
