"""Tables of costs and errors, what is cheapest, and how stability converges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from studies.accuracy.errors import BOUNDED, DIMS, ERRORS_ALLOWED, FIGURES, FIRST_SLIP
from studies.accuracy.rows import cheapest_right, default, front, label, largest, table
from studies.accuracy.settings import OPTIONS, SCENES
from studies.study import constants
from studies.tables import Part, Table, apart
from sweeps import FAILED

# Columns of tables: head, column of `rows.table`, factor, form.
COSTS = (
    ("step us", "step", 1e6, ".3f"),
    ("modes", "modes", 1.0, ".0f"),
    ("alone", "alone", 1.0, ".3g"),
    ("in batch", "batch", 1.0, ".3g"),
    ("paper / it", "ratio", 1.0, ""),
    *((name, name, 1.0, ".2f") for name in ("mismatch", "scatter", "worst")),
    ("right", "right", 1.0, ""),
    ("undamped", "undamped", 1.0, ".2f"),
)
ERRORS = (
    *((each.long_name, f"{each.name}_error", 100.0, "+.1f") for each in FIGURES),
    ("KS", "stick_time_ks", 100.0, "+.1f"),
    ("W1", "stick_time_wasserstein", 100.0, "+.1f"),
    ("spectrum", "spectrum_error", 100.0, "+.1f"),
)
BURST = (
    ("v_B half-way", "slip_velocity_error", 100.0, ".3f"),
    ("N half-way", "slip_force_error", 100.0, ".3f"),
    ("v_B to the end", "burst_velocity_error", 100.0, ".3f"),
    ("delay", "burst_delay_error", 100.0, ".3f"),
    ("first slip*", "first_slip_error", 100.0, ".3f"),
    ("delay*", "first_delay_error", 100.0, ".3f"),
)
OF_COSTS = (
    "Cost (s per simulated second) and mismatch: errors in units of their tolerances, root mean square over",
    "figures and scenes; scatter: what chance alone would make of it; worst: the largest; undamped: mismatch",
    "against paper with beta2 = 0.5, which has no numerical damping.",
)
OF_ERRORS = (
    "Errors in per cent (shares of time: points), the largest over scenes; in brackets the same in standard",
    "errors, root mean square over scenes. KS, W1: two-sample distances of the long sticks (Kolmogorov and",
    "Smirnov's; Wasserstein's over the mean); spectrum: in third-octave bands, what lies elsewhere.",
)
OF_BURST = (
    "The first burst, per cent, the largest over scenes. Half-way: from the start to half-way between first",
    "slip and first separation; delay: the time between them. fast and solve_ivp against exact on the same",
    "reduced model; paper against itself with a quarter of the step and without numerical damping.",
    "*: against paper as it is.",
)
OF_STABILITY = (
    "Sliding stability: error of the lowest onset's mu and of the largest growth rate below 10 kHz, relative,",
    "the largest over scenes; of a cut-off against all modes, by termination; of a mesh against the finest.",
)


def findings(dataset: xr.Dataset) -> list[Part]:
    """Costs, every error, the first burst, what is cheapest, and sliding stability."""
    data = dataset.transpose(*DIMS, ...)
    frame = table(data)
    chosen = pd.concat([default(frame), cheapest_right(frame)])
    stopped = data["gave_up_time"].to_series().dropna().items()
    failed = int((data["status"] == FAILED).sum())
    alone = not frame["mismatch"].notna().any()
    parts: list[Sequence[Part]] = [
        _scenes(data),
        _part(frame, COSTS, *OF_COSTS),
        _part(frame, ERRORS, *OF_ERRORS),
        _part(frame, BURST, *OF_BURST),
        [f"{', '.join(at)}: gave up at {1e3 * t:.3f} ms, where events do not end." for at, t in stopped],
        _part(front(frame), COSTS, "What no other is both cheaper and nearer than, from the cheapest on:"),
        _part(chosen, COSTS, "fast by default, and the cheapest that is right at every scene:"),
        ["Without paper by default there is nothing to compare figures with."] if alone else [],
        _stability(data) if "onset_error" in data else [],
        [f"{failed} points failed and count for nothing."] if failed else [],
    ]
    return apart(parts)


def _part(frame: pd.DataFrame, columns: Sequence[tuple[str, str, float, str]], *heading: str) -> list[Part]:
    """A line for each method and setting that has any of these columns; deviations in brackets behind errors."""
    rows = []
    for _, row in frame.iterrows():
        cells = []
        for _, name, factor, form in columns:
            value, near = row.get(name, np.nan), row.get(name.replace("_error", "_deviation"), np.nan)
            cell = value if name == "right" else _text(factor * value, form or (".0f" if value >= 10.0 else ".2g"))
            cells.append(cell + (f" ({near:.1f})" if "_error" in name and not np.isnan(near) else ""))
        if set(cells) != {"-"}:
            rows.append([row["method"], row["label"], *cells])
    heads = ["method", "setting", *(head for head, *_ in columns)]
    return [*heading, Table(heads, rows, 2)] if rows else []


def _text(value: float, form: str) -> str:
    return "-" if np.isnan(value) else format(value, form)


def _scenes(data: xr.Dataset) -> list[Part]:
    given = constants(data)
    rows = [[name, *map("{:g}".format, SCENES[name])] for name in data["scene"].values]
    tolerances = ", ".join(f"{each.long_name} {100.0 * each.tolerance:g} %" for each in BOUNDED)
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
    rows = []
    for setting, cutoff in zip(data["setting"].values.tolist(), data["cutoff"].values, strict=True):
        errors = [largest(data[f"{what}_error"].sel(setting=setting)) for what in ("onset", "growth")]
        # Of a mesh all modes are kept, and all terminations are the same.
        if OPTIONS[setting].kind != "cut-off":
            errors = [each.where(each["termination"] == each["termination"][0]) for each in errors]
        cells = [_text(float(value), ".1e") for each in errors for value in each]
        if set(cells) != {"-"}:
            rows.append([label(setting, cutoff), *cells])
    heads = [f"{what}, {kind}" for what in ("onset", "growth") for kind in data["termination"].values]
    return [*OF_STABILITY, Table(["setting", *heads], rows, 1)] if rows else []
