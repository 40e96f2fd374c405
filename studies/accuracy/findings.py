"""Tables of costs and errors, what is cheapest, and how stability converges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from studies.accuracy.errors import ERRORS_ALLOWED, FIGURES, FIRST_SLIP, WITHIN, root_mean_square
from studies.accuracy.settings import DEFAULT, FAST, OPTIONS, PAPER, SCENES
from studies.study import constants
from studies.tables import Column, Part, Table, apart
from sweeps import FAILED

MEANS = {"alone": "cpu_per_second", "batch": "batch_cpu_per_second", "step": "step", "modes": "modes"}
MEAN_SQUARES = {"mismatch": "mismatch", "scatter": "mismatch_scatter", "undamped": "mismatch_undamped"}
LARGEST = {"first_slip": "first_slip_error", "half_way": "slip_velocity_error"}


def _right(row: xr.Dataset) -> str:
    return f"{int(row['right_scenes'])}/{int(row['known_scenes'])}" if row["known_scenes"] else "-"


# Columns of `table`.
NAMES: dict[str, Column] = {
    "method": lambda row: str(row["method"].item()),
    "setting": lambda row: str(row["label"].item()),
}
COSTS: dict[str, Column] = {
    "step us": ("step", ".3f", 1e6),
    "modes": ("modes", ".0f"),
    "alone": ("alone", ".3g"),
    "in batch": ("batch", ".3g"),
    "paper / it": ("ratio", ".4g"),
    **{name: (name, ".2f") for name in ("mismatch", "scatter", "undamped")},
    "right": _right,
}
ERRORS: dict[str, Column] = {
    **{each.long_name: (each.name, ".1f", 100.0) for each in FIGURES},
    "first slip": ("first_slip", ".3f", 100.0),
    "v_B half-way": ("half_way", ".3f", 100.0),
}
OF_COSTS = (
    "Cost: processor time of the thread, s per simulated second, with nothing else of the run beside it, mean",
    "over scenes. Mismatch: errors in units of their tolerances, root mean square over figures and scenes;",
    "scatter: by chance alone; undamped: with paper with beta2 = 0.5, which has no numerical damping;",
    "right: at how many scenes.",
)
OF_ERRORS = (
    "Errors in per cent (shares of time: points), the largest over scenes; standard errors are in the file.",
    "Half-way: from the start to half-way between first slip and first separation; fast and solve_ivp against",
    "exact on the same reduced model, paper against itself with a quarter of the step and undamped.",
)
OF_STABILITY = (
    "Sliding stability: relative error of the lowest onset's mu, the largest over scenes; of a cut-off against",
    "all modes, by termination; of a mesh, which keeps all modes, against the finest.",
)


def findings(data: xr.Dataset) -> list[Part]:
    """Costs, every error, what is cheapest, and sliding stability."""
    frame = table(data)
    chosen = pd.concat([default(frame), cheapest_right(frame)])
    erring = frame.dropna(how="all", subset=[*(each.name for each in FIGURES), "first_slip", "half_way"])
    failed = int((data["status"] == FAILED).sum())
    parts: list[Sequence[Part]] = [
        _scenes(data),
        _part(frame, COSTS, *OF_COSTS),
        _part(erring, ERRORS, *OF_ERRORS),
        _part(chosen, COSTS, "fast by default, and the cheapest that is right at every scene:"),
        [] if len(default(frame, PAPER)) else ["Without paper by default no figures can be compared."],
        _stability(data),
        [f"{failed} points failed and count for nothing."] if failed else [],
    ]
    return apart(parts)


def _part(frame: pd.DataFrame, columns: dict[str, Column], *heading: str) -> list[Part]:
    """The rows of a frame below a heading, if there are any."""
    rows = frame.reset_index(drop=True).to_xarray()
    return [*heading, Table.of(rows, "index", NAMES | columns, 2)] if len(frame) else []


def _scenes(data: xr.Dataset) -> list[Part]:
    given = constants(data)
    rows = [[name, *map("{:g}".format, SCENES[name])] for name in data["scene"].values]
    known = [each for each in FIGURES if np.isfinite(each.tolerance)]
    tolerances = ", ".join(f"{each.long_name} {100.0 * each.tolerance:g} %" for each in known)
    return [
        Table(["scene", "V, m/s", "theta, degrees", "mu", "F, N"], rows, 1),
        "Shares of time and other figures of fast and exact: with the published scheme's numerical damping.",
        f"Reference: paper on all modes, step and beta2 the paper's, {given['reference_members']} runs of "
        f"{given['duration']:g} s a scene; fast: {given['members']} runs.",
        f"Right: off by at most {tolerances}",
        f"(shares of time: points) and {ERRORS_ALLOWED:g} standard errors; first slip {100.0 * FIRST_SLIP:g} %.",
    ]


def _stability(data: xr.Dataset) -> list[Part]:
    """How the onset of sliding's flutter converges."""
    known = largest(data["onset_error"]).to_dataset("termination").dropna("setting", how="all")
    columns: dict[str, Column] = {"setting": lambda row: label(row["setting"].item(), float(row["cutoff"]))}
    columns |= {kind: (kind, ".1e") for kind in data["termination"].values.tolist()}
    return [*OF_STABILITY, Table.of(known, "setting", columns, 1)] if known.sizes["setting"] else []


def table(data: xr.Dataset) -> pd.DataFrame:
    """Methods and settings of which a cost is known, in the file's order.

    Over scenes, as MEANS, MEAN_SQUARES and LARGEST say, the mean, the root mean square, or the largest with its
    sign; `cost` is that in batch, else alone, `ratio` that of `paper` by default over it. Of each figure, by its
    name, the largest error.
    """
    within = data["within"]
    columns = {column: data[name].mean("scene") for column, name in MEANS.items()}
    columns |= {column: root_mean_square(data[name]) for column, name in MEAN_SQUARES.items()}
    columns |= {column: largest(data[name]) for column, name in LARGEST.items()}
    for scene in data["scene"].values:
        columns[f"mismatch at {scene}"] = data["mismatch"].sel(scene=scene, drop=True)
    for k, figure in enumerate(FIGURES):
        columns[figure.name] = largest(data["figure_error"].isel(figure=k, drop=True))
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
