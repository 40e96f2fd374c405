"""What is said of costs and errors: tables, what is cheapest, and how things converge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from studies.accuracy import settings as asked
from studies.accuracy.errors import DIMS, ERRORS_ALLOWED, FIGURES, FIRST_SLIP
from studies.accuracy.rows import Row, cheapest_right, find, front, largest, mean, root_mean_square, rows
from studies.motion import transients
from studies.study import constants
from studies.tables import Part, Table, apart
from sweeps import FAILED

# Errors besides those of the figures: variable, head, factor, and whether a deviation stands beside it.
OTHERS = (
    ("stick_time_ks", "KS", 100.0, False),
    ("stick_time_wasserstein", "W1", 100.0, False),
    ("spectrum_error", "spectrum", 100.0, True),
)
# Errors up to the first separation, in per cent: variable and head.
BURST = (
    ("slip_velocity_error", "v_B half-way"),
    ("slip_force_error", "N half-way"),
    ("burst_velocity_error", "v_B to the end"),
    ("burst_delay_error", "delay"),
    ("first_slip_error", "first slip*"),
    ("first_delay_error", "delay*"),
)


def findings(dataset: xr.Dataset) -> list[Part]:
    """Costs, every error, the first burst, what is cheapest, and sliding stability."""
    every = rows(dataset)
    parts: list[Sequence[Part]] = [
        _head(dataset),
        _costs(every, dataset),
        _errors(every, dataset),
        _bursts(every, dataset),
    ]
    parts += [_choice(every), _stability(dataset)]
    failed = int((dataset["status"] == FAILED).sum())
    parts += [[f"{failed} points failed and count for nothing."]] if failed else []
    return apart(parts)


def _head(dataset: xr.Dataset) -> list[str]:
    given = constants(dataset)
    scenes = [
        f"  {name}: V = {1e3 * V:g} mm/s, theta = {theta:g} degrees, mu = {mu:g}, F = {F:g} N"
        for name, V, theta, mu, F in (asked.SCENES[int(k)] for k in dataset["scene"].values)
    ]
    asked_for = ", ".join(f"{each.long_name} {100.0 * each.tolerance:g} %" for each in FIGURES if each.asked)
    return [
        "Scenes:",
        *scenes,
        f"Reference: paper on all modes, step and beta2 the paper's, {given['reference_members']} runs of "
        f"{given['duration']:g} s a scene; fast: {given['members']} runs.",
        f"Right: off by at most {asked_for}",
        f"(shares of time: points) and {ERRORS_ALLOWED:g} standard errors of the difference; first slip by at "
        f"most {100.0 * FIRST_SLIP:g} %.",
        "Cost: the thread's own processor time per simulated second, mean over scenes; wall time is in the file.",
    ]


def _costs(every: Sequence[Row], dataset: xr.Dataset) -> list[Part]:
    """A line for each method and setting."""
    reference = find(every, asked.PAPER)
    heads = ["method", "setting", "step us", "modes", "alone", "in batch", "paper / it"]
    heads += ["mismatch", "scatter", "worst", "right", "undamped"]
    cells = []
    for row in every:
        at = _at(dataset, row)
        ratio = reference.alone / row.cost if reference else np.nan
        cells.append(
            [
                asked.METHODS[row.method],
                row.name,
                transients.text(mean(at["step"].values), 3, 1e6),
                transients.text(mean(at["modes"].values), 0),
                _seconds(row.alone),
                _seconds(row.together),
                _ratio(ratio),
                *(transients.text(each, 2) for each in (row.mismatch, row.scatter, row.worst)),
                f"{row.right}/{row.scenes}" if row.scenes else "-",
                transients.text(row.undamped, 2),
            ]
        )
    return [
        "Cost (s per simulated second) and mismatch: errors in units of their tolerances, root mean square over",
        "figures and scenes; scatter: what chance alone would make of it; worst: the largest; undamped: mismatch",
        "against paper with beta2 = 0.5, which has no numerical damping.",
        Table(heads, cells, 2),
    ]


def _errors(every: Sequence[Row], dataset: xr.Dataset) -> list[Part]:
    """Of each figure the largest error over scenes, and in brackets the deviations' root mean square."""
    heads = ["method", "setting", *(each.long_name for each in FIGURES), *(head for _, head, _, _ in OTHERS)]
    cells = []
    for row in every:
        at = _at(dataset, row)
        parts = [_error(at, f"{each.name}_error", f"{each.name}_deviation") for each in FIGURES]
        parts += [_error(at, name, "spectrum_deviation" if both else "") for name, _, _, both in OTHERS]
        if any(part != "-" for part in parts):
            cells.append([asked.METHODS[row.method], row.name, *parts])
    if not cells:
        return []
    return [
        "Errors in per cent (shares of time: points), the largest over scenes; in brackets the same in standard",
        "errors, root mean square over scenes. KS, W1: two-sample distances of the long sticks (Kolmogorov and",
        "Smirnov's; Wasserstein's over the mean); spectrum: in third-octave bands, what lies elsewhere.",
        Table(heads, cells, 2),
    ]


def _error(at: xr.Dataset, name: str, deviation: str) -> str:
    if name not in at:
        return "-"
    error = largest(at[name].values)
    if np.isnan(error):
        return "-"
    near = root_mean_square(at[deviation].values) if deviation else np.nan
    return f"{100.0 * error:+.1f}" + ("" if np.isnan(near) else f" ({near:.1f})")


def _bursts(every: Sequence[Row], dataset: xr.Dataset) -> list[Part]:
    """Errors up to the first separation, the largest over scenes."""
    cells = []
    for row in every:
        at = _at(dataset, row)
        values = [largest(at[name].values) if name in at else np.nan for name, _ in BURST]
        if np.isfinite(values).any():
            shown = (transients.text(each, 3, 100.0) for each in values)
            cells.append([asked.METHODS[row.method], row.name, *shown])
    lines: list[Part] = [
        "The first burst, per cent, the largest over scenes. Half-way: from the start to half-way between first",
        "slip and first separation; delay: the time between them. fast and solve_ivp against exact on the same",
        "reduced model; paper against itself with a quarter of the step and without numerical damping.",
        "*: against paper as it is.",
        Table(["method", "setting", *(head for _, head in BURST)], cells, 2),
    ]
    stopped = dataset["gave_up_time"].transpose(*DIMS).values
    for j, k, n in np.argwhere(np.isfinite(stopped)):
        named = (("method", j), ("setting", k), ("scene", n))
        where = ", ".join(str(dataset[f"{name}_name"].values[at]) for name, at in named)
        moment = 1e3 * stopped[j, k, n]
        lines.append(f"{where}: gave up at {moment:.3f} ms, where events follow each other without end.")
    return lines


def _choice(every: Sequence[Row]) -> list[str]:
    """The front, the default, and what is the cheapest that is right."""
    if not any(np.isfinite(row.mismatch) for row in every):
        return ["Without paper by default there is nothing to hold figures against."]
    lines = [
        "What no other is both cheaper and nearer than, from the cheapest on (cost in batch, mismatch, right):"
    ]
    for row in front(every):
        right = f"{row.right}/{row.scenes}"
        lines.append(f"  {_called(row)}: {_seconds(row.cost)} s per s, {row.mismatch:.2f}, {right}")
    own, best = find(every, asked.FAST), cheapest_right(every)
    if own is not None and np.isfinite(own.mismatch):
        lines.append(
            f"fast by default: {_seconds(own.cost)} s per s, mismatch {own.mismatch:.2f} (scatter alone "
            f"{own.scatter:.2f}), right at {own.right} of {own.scenes} scenes."
        )
    if best is None:
        return [*lines, "No setting is right at every scene."]
    lines.append(f"The cheapest that is right at every scene: {_called(best)}, {_seconds(best.cost)} s per s")
    if own is not None:
        lines[-1] += f", {own.cost / best.cost:.2f} times cheaper than fast by default"
    lines[-1] += "."
    return lines


def _stability(dataset: xr.Dataset) -> list[Part]:
    """How onset and growth of sliding's flutter converge."""
    if "onset_error" not in dataset:
        return []
    cells = []
    for k, setting in enumerate(dataset["setting"].values):
        option = asked.OPTIONS[int(setting)]
        parts = [
            dataset[f"{what}_error"].isel(setting=k).transpose("termination", "scene").values for what in STABLE
        ]
        if np.isfinite(parts).any():
            # Of a mesh all modes are kept, and no termination is the same as another.
            shown = [
                _largest_of(part[j]) if option.kind == "cut-off" or j == 0 else "-"
                for part in parts
                for j in range(len(part))
            ]
            cells.append([str(dataset["setting_name"].values[k]), *shown])
    if not cells:
        return []
    names = [f"{what}, {kind}" for what in STABLE for kind in dataset["termination"].values]
    return [
        "Sliding stability: error of the lowest onset's mu and of the largest growth rate below 10 kHz, relative,",
        "the largest over scenes; of a cut-off against all modes, by termination; of a mesh against the finest.",
        Table(["setting", *names], cells, 1),
    ]


STABLE = ("onset", "growth")


def _largest_of(values: Any) -> str:
    error = largest(values)
    return "-" if np.isnan(error) else f"{error:.1e}"


def _at(dataset: xr.Dataset, row: Row) -> xr.Dataset:
    return dataset.sel({"method": row.method, "setting": row.setting})


def _called(row: Row) -> str:
    return f"{asked.METHODS[row.method]}, {row.name}"


def _seconds(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.3g}"


def _ratio(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"
