"""Figures of signals: in time, as spectra, over the states of the contact, and in the phase plane."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from studies.declaring import labels
from studies.motion import run, series
from studies.physics import phases
from studies.physics.phases import SEPARATION, SLIP, STICK
from studies.plotting import figures

# Looks of the states behind a signal, and of their parts of a curve in the phase plane.
SHADES: dict[int, dict[str, Any]] = {
    STICK: {"facecolor": "#d9d9d9", "edgecolor": "none"},
    SEPARATION: {"facecolor": "#fbe3b5", "edgecolor": "#e0b050", "hatch": "//////"},
}
CURVES = {SLIP: ("-", figures.BLUE), SEPARATION: ("--", figures.ORANGE), STICK: (".-", figures.BLACK)}
# How long growth or decay is shown, s; below this share of V there is but rounding.
SLOPE, NOTHING = 0.1, 1e-9
# Where the number of a phase is written, points from its middle.
OFFSETS = {1: (0, 11), 2: (14, -6), 3: (0, -12), 4: (-8, 13)}
# In the zoom of a series.
PERIODS = 10
PHASES = "(1) stick, (2) slip, (3) separation, (4) slip"


def spectrum(axes: figures.Axes, frequency: Any, power: Any, **look: Any) -> None:
    """A power spectral density, in decibels over kHz."""
    options: dict[str, Any] = {"color": figures.BLUE, "linewidth": 0.8} | look
    axes.plot(1e-3 * np.asarray(frequency), series.decibels(power), **options)


def finish_spectra(axes: figures.Axes, depth: float) -> None:
    """Labels and limits of a panel with spectra of velocities: the band, and at most so many dB."""
    low, top = axes.get_ylim()
    axes.set(xlim=(0.0, 1e-3 * run.BAND), ylim=(max(low, top - depth), top))
    axes.set(xlabel="frequency / kHz", ylabel="PSD / dB re 1 (m/s)²/Hz")


def series_panels(rows: int) -> tuple[figures.Figure, list[list[figures.Axes]]]:
    """A figure with three panels a row, of a series, a part of it, and its spectrum; without room in two lines."""
    names = [[f"{kind} {k}" for kind in ("all", "part", "spectrum")] for k in range(rows)]
    layout, height = names, 3.9
    if not figures.is_wide():
        layout, height = [each for row in names for each in (row[:1] * 2, row[1:])], 3.8
    figure, panels = figures.mosaic(layout, *[height] * len(layout), stack=False)
    return figure, [[panels[name] for name in row] for row in names]


def name_sides(panels: Sequence[Sequence[figures.Axes]]) -> None:
    """The label of the horizontal axis below the last panel of each column."""
    for axes, text in zip(panels[-1], ("time / s", "time / ms", "frequency / kHz"), strict=True):
        axes.set_xlabel(text)


def compare(panels: Sequence[Sequence[figures.Axes]], duration: float, depth: float) -> None:
    """Set one scale for the velocities and one for the spectra of all rows, and their labels."""
    for left, _, right in panels[1:]:
        for axes, first in ((left, panels[0][0]), (right, panels[0][2])):
            axes.sharex(first)
            axes.sharey(first)
    panels[0][0].set_xlim(0.0, duration)
    finish_spectra(panels[0][2], depth)
    for left, _, right in panels:
        left.set_ylabel("velocity of B / (mm/s)")
        right.set(xlabel="", ylabel=panels[0][2].get_ylabel())
    name_sides(panels)


def periods(axes: figures.Axes, time: Any, values: Any, hertz: float, **look: Any) -> None:
    """Ten periods of `hertz` of a series, at its largest motion in the second half."""
    step = time[1] - time[0]
    count = min(int(np.ceil(PERIODS / hertz / step)) if hertz > 0.0 else len(time), len(time) // 2)
    starts = np.arange(len(time) // 2, len(time) - count + 1, max(count // 2, 1))
    begin = int(max(starts, key=lambda k: np.std(values[k : k + count]), default=len(time) // 2))
    part = slice(begin, begin + count)
    axes.plot(1e3 * (time[part] - time[begin]), values[part], linewidth=0.9, **look)
    axes.set_title(f"{PERIODS} periods from {time[begin]:.4g}\N{NO-BREAK SPACE}s", loc="left")


def mark_lines(axes: figures.Axes, hertz: Iterable[float], style: str, text: str) -> None:
    """The paper's lines of a spectrum."""
    for each in hertz:
        look: dict[str, Any] = {"color": figures.RED, "linewidth": 1.0, "zorder": 1.5, "label": f"paper: {text}"}
        axes.axvline(1e-3 * each, linestyle=style, **look)


def mark_parts(axes: figures.Axes, time: Any, chosen: Any, label: str) -> None:
    """Draw a bar at the bottom along the chosen parts of a signal."""
    spans = [(time[begin], time[end - 1] - time[begin]) for begin, end in series.runs_of_true(chosen)]
    # Without snapping, which may hide what is narrower than a pixel.
    look: dict[str, Any] = {"snap": False, "color": figures.BLACK, "linewidth": 0.0, "label": label}
    axes.broken_barh(spans, (0.0, 0.045), transform=axes.get_xaxis_transform(), **look)


def growth(axes: figures.Axes, point: xr.Dataset, colour: str) -> None:
    """Deviation of the velocity from its mean since the first slip, beside the slope of linear stability."""
    first, elapsed = float(point["first_slip_time"]), point["elapsed"].values
    since, velocity = (elapsed >= first) & (elapsed < first + SLOPE), point["velocity_B"].values.astype(float)
    time, distance = elapsed[since] - first, np.abs(velocity[since] - velocity[-len(elapsed) // 4 :].mean())
    edges: Any = np.unique(np.searchsorted(time, np.arange(0.0, time[-1], SLOPE / 200))) if len(time) else ()
    if not len(edges):
        return
    rate, nothing = float(point["mode_growth_rate"]), NOTHING * abs(float(point["V"]))
    time, largest = time[edges], np.maximum.reduceat(distance, edges)
    axes.plot(time, np.where(largest > nothing, largest, np.nan), color=colour)
    last = min(int(np.searchsorted(time, 0.2 * SLOPE)), len(time) - 1)
    ends = np.array([time[last], 0.8 * SLOPE])
    if rate > 0.0:
        # Growth is linear until it comes near its saturation.
        last = int(np.argmax(largest >= 0.5 * np.median(largest)))
        ends = np.array([time[last] - 3.0 / rate, time[last]])
    slope = 2.0 * largest[last] * np.exp(rate * (ends - time[last]))
    axes.plot(ends, slope, color=figures.RED, linestyle="--", zorder=3.0)


def shade_states(axes: figures.Axes, time: Any, state: Any) -> None:
    """Shade stick and separation; slip stays white."""
    for code, look in SHADES.items():
        options = look | {"transform": axes.get_xaxis_transform(), "linewidth": 0.0, "zorder": 0.5}
        axes.fill_between(time, 0.0, 1.0, where=state == code, step="mid", label=run.STATES[code], **options)
    axes.fill_between([], [], facecolor="white", edgecolor=figures.GREY, linewidth=0.5, label="slip (white)")


def draw_periods(times: Sequence[figures.Axes], plane: figures.Axes, point: xr.Dataset) -> None:
    """Two periods in time over the states of the contact, and one in the phase plane, with the limit cycle."""
    first, last, one = phases.periods(point)
    window, shown = point.isel(elapsed=slice(first, last)), point.isel(elapsed=slice(first, one))
    time, names = 1e3 * (window["elapsed"] - window["elapsed"][0]).values, [*phases.SERIES][: len(times)]
    for axes, name in zip(times, names, strict=True):
        figures.trace(axes, time, labels.readable(window[name]).values, color=figures.BLUE, linewidth=0.9)
        shade_states(axes, time, window["state"].values)
        axes.set_xlim(0.0, max(time[-1], 1e-6))
    for axes in times[:-1]:
        axes.sharex(times[-1])
        axes.tick_params(labelbottom=False)
    bound = np.copysign(float(point["mu"]), float(point["V"]))
    times[1].axhline(bound, color=figures.BLACK, linestyle=":", linewidth=1.0, label="imposed friction μ")
    times[-1].set_xlabel(f"time since {float(window['elapsed'][0]):.5f} s / ms")
    if np.isfinite(hertz := float(point["cycle_frequency"])):
        # The motion as it is, and the cycle with its states.
        plane.plot(*plane_of(window), color=figures.GREY, linewidth=0.7, label="phase plane: motion")
        shown = xr.Dataset({name: point[f"cycle_{name}"] for name in phases.SERIES})
        time = 1e3 * np.arange(phases.PERIODS * shown.sizes["phase"]) / shown.sizes["phase"] / hertz
        for axes, name in zip(times, names, strict=True):
            y = np.tile(labels.readable(shown[name]).values, phases.PERIODS)
            axes.plot(time, y, color=figures.RED, linewidth=0.9, label="limit cycle")
    phase_plane(plane, *plane_of(shown), shown["state"].values)


def plane_of(point: xr.Dataset) -> tuple[Any, Any]:
    """Slip displacement, um, and velocity, mm/s."""
    moved = 1e6 * point["slip_displacement"].values
    return moved - moved[0], 1e3 * point["slip_velocity"].values


def phase_plane(axes: figures.Axes, moved: Any, speed: Any, state: Any) -> None:
    """A period in the phase plane by its states, with its main phases numbered as in the paper."""
    for code, (style, colour) in CURVES.items():
        inside = state == code
        if code != STICK:
            # From the last sample of a stick and to the first of what follows, so that the curve has no gap.
            inside = inside | (state == STICK) & np.append(inside[1:], False) | np.append(False, inside[:-1])
        x, y = (np.where(inside, values, np.nan) for values in (moved, speed))
        axes.plot(x, y, style, color=colour, linewidth=1.6, label=f"phase plane: {run.STATES[code]}")
    axes.plot(moved[0], speed[0], "o", color=figures.RED, markersize=5, zorder=4, label="start of the period")
    axes.margins(0.15, 0.4)
    for number, (begin, end) in phases.main_phases(state).items():
        middle = begin + int(np.abs(speed[begin:end]).argmax()) if number == 3 else (begin + end) // 2
        place: dict[str, Any] = {"xytext": OFFSETS[number], "textcoords": "offset points"}
        axes.annotate(f"({number})", (moved[middle], speed[middle]), **place, va="center", ha="center")
    axes.plot([], [], " ", label=PHASES)
