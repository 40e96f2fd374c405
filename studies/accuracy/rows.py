"""The file of `accuracy` as a table: a row for each method and setting, over all scenes."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from studies.accuracy.errors import DIMS, UNKNOWN, YES, root_mean_square
from studies.accuracy.settings import DEFAULT, FAST, OPTIONS, PAPER

MEANS = {"alone": "cpu_per_second", "batch": "batch_cpu_per_second", "step": "step", "modes": "modes"}
MEAN_SQUARES = {"mismatch": "mismatch", "scatter": "mismatch_scatter", "undamped": "mismatch_undamped"}
MEAN_SQUARES["half_way"] = "slip_velocity_error"


def table(data: xr.Dataset) -> pd.DataFrame:
    """Methods and settings of which a cost is known, in the file's order.

    Returns
    -------
    DataFrame
        `method`, `setting`, `label` (the setting for a reader), `cutoff` (Hz), `step` (s), `modes`; `alone`,
        `batch`: processor time per simulated second of a run alone and of each of an ensemble's; `cost`: `batch`,
        else `alone`; `ratio`: that of `paper` by default over it. `mismatch`, `scatter`, `undamped`: errors of the
        figures in units of their tolerances, what chance alone would make of it, errors against the scheme without
        numerical damping; `half_way`: error of the velocity in the first burst. `right_scenes`, of `known_scenes`:
        where every figure is within its tolerance and scatter; `right`: both as text. Besides every error, the
        largest over scenes with its sign, and every deviation, root mean square over scenes.
    """
    missing = xr.full_like(data["cpu_per_second"], np.nan)
    within = data.get("within", xr.full_like(missing, UNKNOWN))
    columns = {name: largest(data[name]) for name in data if data[name].dims == DIMS and data[name].dtype == float}
    columns |= {name: root_mean_square(data[name]) for name in columns if str(name).endswith("_deviation")}
    columns |= {column: data[name].mean("scene") for column, name in MEANS.items()}
    columns |= {column: root_mean_square(data.get(name, missing)) for column, name in MEAN_SQUARES.items()}
    columns |= {"worst": data.get("worst_mismatch", missing).max("scene")}
    columns |= {"right_scenes": (within == YES).sum("scene"), "known_scenes": (within != UNKNOWN).sum("scene")}
    frame = xr.Dataset(columns).to_dataframe(["method", "setting"]).reset_index()
    frame["label"] = [label(*each) for each in zip(frame["setting"], frame["cutoff"], strict=True)]
    frame["cost"] = frame["batch"].fillna(frame["alone"])
    frame["ratio"] = default(frame, PAPER)["alone"].sum(min_count=1) / frame["cost"]
    pairs = zip(frame["right_scenes"], frame["known_scenes"], strict=True)
    frame["right"] = [f"{right}/{known}" if known else "-" for right, known in pairs]
    return frame[frame["alone"].notna()].reset_index(drop=True)


def largest(values: xr.DataArray) -> xr.DataArray:
    """Of the largest magnitude over scenes, with its sign; NaN where there is none."""
    values = values.drop_vars("scene")
    return values.isel(scene=abs(values).fillna(-1.0).argmax("scene"))


def label(setting: str, cutoff: float) -> str:
    """A setting for a reader: a cut-off in kHz, and not in units of P1's first axial frequency."""
    option = OPTIONS[setting]
    units = f"{option.value:.3g}" if option.kind == "cut-off" else ""
    return setting.replace(units, f"{1e-3 * cutoff:.3g} kHz", 1) if units else setting


def default(frame: pd.DataFrame, method: str = FAST) -> pd.DataFrame:
    """The row of a method by default, if there is one."""
    return frame[(frame["method"] == method) & (frame["setting"] == DEFAULT)]


def front(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows that no other is both cheaper and nearer than, the cheapest first."""
    known = frame.dropna(subset=["cost", "mismatch"]).sort_values("cost", kind="stable")
    return known[known["mismatch"] < known["mismatch"].cummin().shift(fill_value=np.inf)]


def cheapest_right(frame: pd.DataFrame) -> pd.DataFrame:
    """The row of the cheapest that is right at every scene, if there is one."""
    right = (frame["known_scenes"] > 0) & (frame["right_scenes"] == frame["known_scenes"])
    return frame[right].nsmallest(1, "cost")
