"""How Figs. 8 to 10 are drawn: maxima, two periods in time, and one in the phase plane."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies import paper
from studies.motion import regimes, transients
from studies.plotting import figures
from studies.study import constants

SEPARATION, STICK, SLIP = range(3)
# Periods of the dominant frequency that the figure shows in time and in the phase plane.
PERIODS = 2
# A stick shorter than this share of a period does not begin one.
SHORTEST_STICK = 0.1
# Columns of the figure; of more speeds it shows so many, evenly chosen.
MOST_COLUMNS = 3
# Where the numbers of the phases stand beside the curve, points.
NUMBER_AT = {1: (0, 10), 2: (12, 0), 3: (0, -10), 4: (14, 0)}


def draw(dataset: xr.Dataset) -> Figure:
    """A column for each speed: the whole start, two periods in time, and one in the phase plane."""
    given = constants(dataset)
    columns = transients.some(dataset.sizes["V"], MOST_COLUMNS)
    figure, panels = figures.panels(
        6,
        len(columns),
        max(9.0 * len(columns), 12.0),
        25.0,
        gridspec_kw={"height_ratios": (1.0, 1.0, 1.2, 1.0, 1.0, 1.9)},
    )
    grid = np.array(panels).reshape(6, len(columns))
    for column, k in zip(grid.T, columns, strict=True):
        _draw_speed(column, dataset.isel(V=k), given)
    for row in grid:
        low, high = np.transpose([axes.get_ylim() for axes in row])
        for axes in row[1:]:
            axes.set_ylabel("")
        # Speeds are compared, so a row has one scale.
        for axes in row:
            axes.set_ylim(low.min(), high.max())
    figures.legend_below(figure, panels, 4)
    figure.suptitle(
        f"The contact, θ = {given['theta']:g}°, μ = {given['mu']:g}, F = {given['F']:g} N"
        + transients.of_all(columns, dataset.sizes["V"])
    )
    return figure


def _draw_speed(column: np.ndarray, at: xr.Dataset, given: Mapping[str, Any]) -> None:
    """One column."""
    force, speed, normal, friction, slip, phase = column
    name = regimes.kind(at)
    force.set_title(f"V = {1e3 * float(at['V']):.4g} mm/s: {name}")
    force.set_ylabel("largest normal\nforce / N")
    speed.set_ylabel("largest slip\nspeed / (mm/s)")
    speed.set_xlabel("time since the drive started / s")
    normal.set_ylabel("normal force\n/ N")
    friction.set_ylabel("apparent\nfriction T/N")
    slip.set_ylabel("slip velocity\n/ (mm/s)")
    phase.set_xlabel("slip displacement / μm")
    phase.set_ylabel("slip velocity / (mm/s)")
    if name == "failed":
        slip.set_xlabel("time / ms")
        return
    middle = at["interval"].values
    force.step(middle, at["largest_normal_force"].values, where="mid", color=figures.BLUE, linewidth=0.8)
    speed.step(middle, 1e3 * at["largest_slip_speed"].values, where="mid", color=figures.BLUE, linewidth=0.8)
    papers = paper.is_point(at, mu=paper.MU, F=paper.LOAD, theta=paper.THETA)
    said = paper.CONTACT_PEAKS.get(float(at["V"])) if papers else None
    for axes, scale, value in ((force, 1.0, 0), (speed, 1e3, 1)):
        if said:
            axes.axhline(
                scale * said[value], color=figures.RED, linestyle="--", linewidth=1.0, label="paper: reached"
            )
    first, last, one = shown(at)
    elapsed = at["elapsed"].values
    time = 1e3 * (elapsed[first:last] - elapsed[first])
    state = at["state"].values[first:last]
    for axes, variable, scale in (
        (normal, "normal_force", 1.0),
        (friction, "apparent_friction", 1.0),
        (slip, "slip_velocity", 1e3),
    ):
        figures.trace(axes, time, scale * at[variable].values[first:last], color=figures.BLUE, linewidth=0.9)
        _mark_states(axes, time, state)
        axes.set_xlim(0.0, time[-1])
        axes.sharex(slip) if axes is not slip else None
    for axes in (normal, friction):
        axes.tick_params(labelbottom=False)
    force.sharex(speed)
    force.tick_params(labelbottom=False)
    speed.set_xlim(0.0, given["overview"])
    sign = 1.0 if float(at["V"]) > 0.0 else -1.0
    friction.axhline(
        sign * given["mu"], color=figures.BLACK, linestyle=":", linewidth=1.0, label="imposed friction μ"
    )
    slip.set_xlabel(f"time since {elapsed[first]:.5f} s / ms")
    _draw_phase(phase, at.isel(elapsed=slice(first, one)))


def shown(at: xr.Dataset) -> tuple[int, int, int]:
    """What of the window is drawn: two periods from the beginning of a stick; the end of the first.

    Periods differ, so the first is the one that moves P1 on most nearly by what P2 does in a period.
    """
    elapsed, frequency = at["elapsed"].values, float(at["dominant_frequency"])
    period = round(1.0 / (frequency * (elapsed[1] - elapsed[0]))) if np.isfinite(frequency) else len(elapsed)
    room = len(elapsed) - PERIODS * period
    if room <= 0:
        return 0, len(elapsed), min(period, len(elapsed))
    sticks = transients.stretches(at["state"].values == STICK)
    begins = np.array([a for a, b in sticks if 0 < a <= room and b - a >= SHORTEST_STICK * period], dtype=int)
    if not len(begins):
        return 0, PERIODS * period, period
    moved = np.abs(at["slip_displacement"].values[begins + period] - at["slip_displacement"].values[begins])
    first = int(begins[np.abs(moved - abs(float(at["V"])) / frequency).argmin()])
    return first, first + PERIODS * period, first + period


def _mark_states(axes: Axes, time: np.ndarray, state: np.ndarray) -> None:
    """Shade what is not slip."""
    for code, face, edge, hatch in ((STICK, "#d9d9d9", "none", ""), (SEPARATION, "#fbe3b5", "#e0b050", "//////")):
        axes.fill_between(
            time,
            0.0,
            1.0,
            where=state == code,
            step="mid",
            transform=axes.get_xaxis_transform(),
            linewidth=0.0,
            zorder=0.5,
            facecolor=face,
            edgecolor=edge,
            hatch=hatch,
            label=transients.STATES[code],
        )


def _draw_phase(axes: Axes, at: xr.Dataset) -> None:
    """One period in the phase plane, its main phases numbered as in the paper."""
    moved, speed = 1e6 * at["slip_displacement"].values, 1e3 * at["slip_velocity"].values
    moved = moved - moved[0]
    state = at["state"].values
    axes.plot(moved, speed, color=figures.GREY, linewidth=0.6, zorder=1.5)
    for code, style, colour, label in (
        (SLIP, "-", figures.BLUE, "phase plane: slip"),
        (SEPARATION, "--", figures.ORANGE, "phase plane: separation"),
        (STICK, ".", figures.BLACK, "phase plane: stick"),
    ):
        there = state == code
        axes.plot(
            np.where(there, moved, np.nan),
            np.where(there, speed, np.nan),
            style,
            color=colour,
            linewidth=1.6,
            label=label,
        )
    for number, (begin, end) in main_phases(state).items():
        middle = begin + int(np.abs(speed[begin:end]).argmax()) if number == 3 else (begin + end) // 2
        axes.annotate(
            f"({number})",
            (moved[middle], speed[middle]),
            NUMBER_AT[number],
            textcoords="offset points",
            ha="center",
            va="center",
        )
    axes.plot(moved[0], speed[0], "o", color=figures.RED, markersize=5, zorder=4, label="start of the period")
    axes.margins(0.08, 0.2)


def main_phases(state: np.ndarray) -> dict[int, tuple[int, int]]:
    """The paper's four phases of a period: stick, slip, separation, slip; the longest run of each in its place."""

    def longest(code: int, begin: int, end: int) -> tuple[int, int] | None:
        runs = [(a + begin, b + begin) for a, b in transients.stretches(state[begin:end] == code)]
        return max(runs, key=lambda run: run[1] - run[0]) if runs else None

    stick, apart = longest(STICK, 0, len(state)), longest(SEPARATION, 0, len(state))
    found = {1: stick, 3: apart}
    if apart is not None:
        found[2], found[4] = longest(SLIP, 0, apart[0]), longest(SLIP, apart[1], len(state))
    return {number: run for number, run in sorted(found.items()) if run is not None}
