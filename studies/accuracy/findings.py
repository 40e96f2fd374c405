"""Tables of costs and errors, and what is cheapest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from studies.accuracy.errors import (
    ERRORS_ALLOWED,
    FIGURES,
    FIRST_SLIP,
    SHARES,
    STANDARD_ERROR,
    WITHIN,
    root_mean_square,
)
from studies.accuracy.rigs import drawn_scene
from studies.accuracy.settings import DEFAULT, DRAWN, FAST, GIVEN, OWN, PAPER, PUBLISHED, SCHEME, SEED
from studies.study import constants
from studies.tables import Column, Part, Table, apart, number
from sweeps import FAILED

# Of scenes, in the order of the columns.
GROUPS = {"paper's rig": True, "random rigs": False}
MEANS = {"cost": "cpu_per_second", "time": "time_to_standard_error", "step": "step", "modes": "modes"}


def _right(group: str) -> Column:
    return lambda row: right(row, group)


COLUMNS: dict[str, Column] = {
    "method": lambda row: str(row["method"].item()),
    "setting": lambda row: str(row["setting"].item()),
    "step us": ("step", ".3f", 1e6),
    "modes": ("modes", ".0f"),
    "CPU s / s": ("cost", ".3g"),
    "CPU s to SE": ("time", ".3g"),
    "paper / it": ("ratio", ".4g"),
}
for _group in GROUPS:
    COLUMNS |= {
        f"error {_group}": (f"mismatch {_group}", ".2f"),
        "scatter " + _group.split()[0]: (f"scatter {_group}", ".2f"),
        "share " + _group.split()[0]: (f"share {_group}", ".1f", 100.0),
        "right " + _group.split()[0]: _right(_group),
    }
EXPLAINED = (
    "CPU s / s: CPU time of the thread per simulated second, with nothing else of the run beside it, mean over",
    "scenes (SciPy: of a short run, most of it before the first slip, so that it is a lower bound).",
    f"CPU s to SE: CPU time until every share of time has a standard error of {STANDARD_ERROR:g}; that of one",
    "simulated second is the motion's, one for all methods. paper / it: ratio of costs at common scenes.",
    "error: errors in units of their tolerances, root mean square over figures and scenes; scatter: by chance",
    "alone; share: of the shares of time the largest error, points; right: at how many scenes.",
)


def findings(data: xr.Dataset) -> list[Part]:
    """Scenes, references, costs and errors, and what is cheapest."""
    frame = table(data)
    failed = int((data["status"] == FAILED).sum())
    parts: list[Sequence[Part]] = [
        _scenes(data),
        _references(data),
        [*EXPLAINED, _rows(frame)] if len(frame) else [],
        ["fast by default, and the cheapest that is right at every scene:", _rows(chosen)]
        if len(chosen := pd.concat([default(frame), cheapest_right(frame)]))
        else [],
        [f"{failed} points failed and count for nothing."] if failed else [],
    ]
    return apart(parts)


def _rows(frame: pd.DataFrame) -> Table:
    return Table.of(frame.reset_index(drop=True).to_xarray(), "index", COLUMNS, 2)


def _scenes(data: xr.Dataset) -> list[Part]:
    fixed, rows = constants(data), []
    for name in data["scene"].values.tolist():
        if name in OWN:
            V, *others = OWN[name]
            shape = ["as given"] * 3
        else:
            scene = drawn_scene(SEED, DRAWN[name])
            V, others, p1, p2 = scene.V, [scene.theta, scene.mu, scene.F], scene.rig.p1, scene.rig.p2
            shape = [f"{1e3 * p1.length:.0f} x {1e3 * p1.thickness:.1f}"]
            shape += [f"{1e3 * length:.0f}" for length in (p2.length, scene.rig.contact_position)]
        second = number(data["one_second_error"].sel(scene=name), ".4f")
        rows.append([name, *map("{:.3g}".format, [1e3 * V, *others]), *shape, second])
    heads = ["scene", "V mm/s", "theta", "mu", "F N", "P1 mm", "P2 mm", "at mm", "SE of 1 s"]
    return [
        f"Rigs are drawn at random by the seed {SEED}. Runs last {fixed['duration']:g} s; a scene has",
        f"{fixed['members']} of fast, {fixed['members_expensive']} of paper and exact.",
        Table(heads, rows, 1),
    ]


def _references(data: xr.Dataset) -> list[Part]:
    tolerances = ", ".join(f"{each.long_name} {100.0 * each.tolerance:g} %" for each in FIGURES)
    frame = table(data)
    return [
        f"Two references. fast with {PUBLISHED} is compared with the published scheme: paper on all",
        "modes by default. Everything else, the published scheme too, is compared with the model as given:",
        "fast, converged, at three times the cut-off in half of that model's step; paper without numerical",
        "damping in half its step says whether that is so.",
        f"Right: off by at most {tolerances}",
        f"(shares of time: points) and {ERRORS_ALLOWED:g} standard errors; first slip {100.0 * FIRST_SLIP:g} %.",
        *(f"Without {', '.join(a)}, there is none." for a in (SCHEME, GIVEN) if default(frame, *a).empty),
    ]


def table(data: xr.Dataset) -> pd.DataFrame:
    """Methods and settings of which a cost is known, in the file's order.

    Over scenes `cost`, `time`, `step` and `modes` are means; `ratio` is the cost of `paper` by default over it,
    the geometric mean over scenes that both have. By group of scenes: root mean square of `mismatch` and
    `scatter`, the largest error of a `share`, and the number of `right` and of `compared` scenes.
    """
    columns: dict[str, Any] = {column: data[name].mean("scene") for column, name in MEANS.items()}
    cost = data["cpu_per_second"]
    reference = cost.reindex({"method": [PAPER], "setting": [DEFAULT]}).isel(method=0, setting=0, drop=True)
    logarithm = xr.apply_ufunc(np.log, reference / cost)
    columns["ratio"] = xr.apply_ufunc(np.exp, logarithm.mean("scene"))
    own = np.isin(data["scene"].values, list(OWN))
    shares = abs(data["figure_error"].sel(figure=list(SHARES))).max("figure")
    for group, of_own in GROUPS.items():
        at: dict[str, Any] = {"scene": own == of_own}
        columns[f"mismatch {group}"] = root_mean_square(data["mismatch"].isel(at))
        columns[f"scatter {group}"] = root_mean_square(data["mismatch_scatter"].isel(at))
        # Of no scene there is no largest.
        columns[f"share {group}"] = shares.where(xr.DataArray(at["scene"], dims="scene")).max("scene")
        within = data["within"].isel(at)
        columns[f"right {group}"] = (within == WITHIN.index("yes")).sum("scene")
        columns[f"compared {group}"] = (within != WITHIN.index("unknown")).sum("scene")
    frame = xr.Dataset(columns).drop_vars("figure", errors="ignore").to_dataframe(["method", "setting"])
    return frame[frame["cost"].notna()].reset_index()


def right(row: Any, group: str) -> str:
    """At how many of how many scenes of a group a row of `table` is right."""
    compared = int(row[f"compared {group}"])
    return f"{int(row[f'right {group}'])}/{compared}" if compared else "-"


def default(frame: pd.DataFrame, method: str = FAST, setting: str = DEFAULT) -> pd.DataFrame:
    """The row of a method, by default or with a setting, if there is one."""
    return frame[(frame["method"] == method) & (frame["setting"] == setting)]


def cheapest_right(frame: pd.DataFrame) -> pd.DataFrame:
    """The row of the cheapest that is right at every scene that `fast` by default has, if there is one."""
    everywhere = pd.Series(len(frame) > 0, frame.index)
    for group in GROUPS:
        most = frame[f"compared {group}"].max()
        everywhere &= (frame[f"right {group}"] == most) & (frame[f"compared {group}"] == most)
    compared = sum(frame[f"compared {group}"] for group in GROUPS)
    return frame[everywhere & (compared > 0)].nsmallest(1, "cost")
