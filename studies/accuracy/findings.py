"""Tables of costs and errors, what is cheapest, and how stability converges."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
import xarray as xr

from studies.accuracy.errors import DIMS, ERRORS_ALLOWED, FIGURES, FIRST_SLIP
from studies.accuracy.rows import cheapest_right, default, label, largest, table
from studies.accuracy.settings import SCENES
from studies.study import constants
from studies.tables import Column, Part, Table, apart, number
from sweeps import FAILED


def _error(name: str) -> Callable[[xr.Dataset], str]:
    """Column of an error in per cent, in brackets its deviation."""

    def cell(row: xr.Dataset) -> str:
        near = float(row[f"{name}_deviation"])
        return number(row[name], ".1f", 100.0) + ("" if np.isnan(near) else f" ({near:.1f})")

    return cell


def _right(row: xr.Dataset) -> str:
    return f"{int(row['right_scenes'])}/{int(row['known_scenes'])}" if row["known_scenes"] else "-"


# Columns of `rows.table`.
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
    **{each.long_name: _error(each.name) for each in FIGURES},
    "first slip": ("first_slip", ".3f", 100.0),
    "v_B half-way": ("half_way", ".3f", 100.0),
}
OF_COSTS = (
    "Cost (s per simulated second) and mismatch: errors in units of their tolerances, root mean square over",
    "figures and scenes; scatter: what chance alone would make of it; undamped: mismatch",
    "against paper with beta2 = 0.5, which has no numerical damping; right: at how many scenes.",
)
OF_ERRORS = (
    "Errors in per cent (shares of time: points), the largest over scenes; in brackets the same in standard",
    "errors, root mean square over scenes. Half-way: from the start to half-way between first slip and first",
    "separation; fast and solve_ivp against exact on the same reduced model, paper against itself with a quarter",
    "of the step and without numerical damping.",
)
OF_STABILITY = (
    "Sliding stability: error of the lowest onset's mu and of the largest growth rate below 10 kHz, relative,",
    "the largest over scenes; of a cut-off against all modes, by termination; of a mesh against the finest.",
)


def findings(dataset: xr.Dataset) -> list[Part]:
    """Costs, every error, what is cheapest, and sliding stability."""
    data = dataset.transpose(*DIMS, ...)
    frame = table(data)
    chosen = pd.concat([default(frame), cheapest_right(frame)])
    erring = frame.dropna(how="all", subset=[*(each.name for each in FIGURES), "first_slip", "half_way"])
    stopped = data["gave_up_time"].to_series().dropna().items()
    failed = int((data["status"] == FAILED).sum())
    parts: list[Sequence[Part]] = [
        _scenes(data),
        _part(frame, COSTS, *OF_COSTS),
        _part(erring, ERRORS, *OF_ERRORS),
        [f"{', '.join(at)}: gave up at {1e3 * t:.3f} ms, where events do not end." for at, t in stopped],
        _part(chosen, COSTS, "fast by default, and the cheapest that is right at every scene:"),
        [] if frame["mismatch"].notna().any() else ["Without paper by default no figures can be compared."],
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
        f"Reference: paper on all modes, step and beta2 the paper's, {given['reference_members']} runs of "
        f"{given['duration']:g} s a scene; fast: {given['members']} runs.",
        f"Right: off by at most {tolerances}",
        f"(shares of time: points) and {ERRORS_ALLOWED:g} standard errors of the difference; first slip by at "
        f"most {100.0 * FIRST_SLIP:g} %.",
        "Cost: the thread's own processor time per simulated second, with nothing else of the run beside it, mean",
        "over scenes; wall time is in the file.",
    ]


def _stability(data: xr.Dataset) -> list[Part]:
    """How onset and growth of sliding's flutter converge."""
    errors = {f"{what}, {kind}": data[f"{what}_error"].sel(termination=kind, drop=True)
              for what in ("onset", "growth") for kind in data["termination"].values}  # fmt: skip
    known = xr.Dataset({head: largest(each) for head, each in errors.items()}).dropna("setting", how="all")
    columns: dict[str, Column] = {"setting": lambda row: label(row["setting"].item(), float(row["cutoff"]))}
    columns |= {head: (head, ".1e") for head in errors}
    return [*OF_STABILITY, Table.of(known, "setting", columns, 1)] if known.sizes["setting"] else []
