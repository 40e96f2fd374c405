"""Figs. 8 to 10: forces and motion at the contact while the rig vibrates."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.integrate import cumulative_trapezoid

from fivcore import Transient, checks
from studies import figures, paper, transients
from studies.study import Setting, Study, constants, rig_of, rig_settings
from sweeps import Axis, Grid, Sweep, Variable

SEPARATION, STICK, SLIP = range(3)
# The motion is recorded at every step of the method.
RECORDED = 1e6
# Of the overview: its intervals, s, and how long after the first slip the start-up is, s.
INTERVAL = 1e-3
START_UP = 0.1
# Periods of the dominant frequency that the figure shows in time and in the phase plane.
PERIODS = 2
# A stick shorter than this share of a period does not begin one.
SHORTEST_STICK = 0.1
# Columns of the figure; of more speeds it shows so many, evenly chosen.
MOST_COLUMNS = 3

# Where the numbers of the phases stand beside the curve, points.
NUMBER_AT = {1: (0, 10), 2: (12, 0), 3: (0, -10), 4: (14, 0)}

SERIES = {
    "normal_force": Variable("N", "normal force on P1", ("elapsed",), "float32"),
    "apparent_friction": Variable("1", "tangential over normal force; 0 in separation", ("elapsed",), "float32"),
    "slip_velocity": Variable("m s-1", "velocity of P1's surface relative to P2's", ("elapsed",), "float32"),
    "slip_displacement": Variable(
        "m", "displacement of P1's surface relative to P2's since the window began", ("elapsed",), "float32"
    ),
    "state": Variable("1", "state of the contact", ("elapsed",), "int8"),
}
OVERVIEW = {
    "largest_normal_force": Variable("N", "largest normal force in the interval", ("interval",), "float32"),
    "largest_slip_speed": Variable("m s-1", "largest slip speed in the interval", ("interval",), "float32"),
}
STARTING = {
    "start_up_normal_force": Variable("N", "largest normal force in the first 0.1 s after the first slip"),
    "start_up_slip_speed": Variable("m s-1", "largest slip speed in the first 0.1 s after the first slip"),
}


def contacts(
    points: Mapping[str, Any],
    *,
    window_start: float,
    window: float,
    overview: float,
    sample_rate: float,
    **fixed: Any,
) -> dict[str, Any]:
    """The contact of each point in the window and at large, and the summary figures of its whole run."""
    times = window_times(window_start, window, sample_rate).values
    runs = []
    found: dict[str, list[Any]] = {name: [] for name in (*SERIES, *OVERVIEW, *STARTING)}
    for scene in transients.scenes(points, fixed):
        runs.append(transients.motion(scene, fixed))
        # Every step of the whole run would fill the memory: what is shown is run again.
        until = max(window_start + window, overview)
        run = transients.motion(scene, fixed, until, record=True, sample_rate=RECORDED)
        for name, values in (within(run, times) | at_large(run, overview) | starting(run)).items():
            found[name].append(values)
    return {name: np.array(values) for name, values in found.items()} | transients.summaries(runs)


def window_times(start: float, length: float, sample_rate: float) -> Axis:
    """The `elapsed` of the window."""
    count = int(length * sample_rate * (1.0 + 1e-12)) + 1
    return Axis(start + np.arange(count) / sample_rate, "s", "time since the drive started")


def within(run: Transient, times: np.ndarray) -> dict[str, Any]:
    """What the contact does at `times`: the nearest step, so that force, speed and state belong together."""
    begin = max(int(np.searchsorted(run.time, times[0])) - 1, 0)
    time, slip = run.time[begin:], run.slip_velocity[begin:]
    nearest = np.searchsorted(0.5 * (time[1:] + time[:-1]), times)
    N, T = run.normal_force[begin:][nearest], run.tangential_force[begin:][nearest]
    moved = cumulative_trapezoid(slip, time, initial=0.0)
    return {
        "normal_force": N,
        "apparent_friction": np.divide(T, N, out=np.zeros_like(N), where=N > 0.0),
        "slip_velocity": slip[nearest],
        "slip_displacement": moved[nearest] - moved[nearest[0]],
        "state": run.state[begin:][nearest],
    }


def at_large(run: Transient, overview: float) -> dict[str, Any]:
    """The largest force and speed in every interval of the overview."""
    edges = np.searchsorted(run.time, INTERVAL * np.arange(len(intervals(overview))))
    # With a very low cut-off a step is longer than an interval.
    edges = np.minimum(edges, len(run.time) - 1)
    last = max(np.searchsorted(run.time, INTERVAL * len(edges)), edges[-1] + 1)
    return {
        "largest_normal_force": np.maximum.reduceat(run.normal_force[:last], edges),
        "largest_slip_speed": np.maximum.reduceat(np.abs(run.slip_velocity[:last]), edges),
    }


def intervals(overview: float) -> Axis:
    """The intervals of the overview, by their middles."""
    count = int(overview / INTERVAL * (1.0 + 1e-12))
    return Axis(INTERVAL * (np.arange(count) + 0.5), "s", "middle of the interval, since the drive started")


def starting(run: Transient) -> dict[str, Any]:
    """The largest force and speed soon after the first slip; NaN unless all of it is known."""
    first = run.summary["first_slip_time"]
    if not first + START_UP <= run.time[-1]:
        return dict.fromkeys(STARTING, np.nan)
    soon = slice(*np.searchsorted(run.time, [first, first + START_UP]))
    return {
        "start_up_normal_force": run.normal_force[soon].max(),
        "start_up_slip_speed": np.abs(run.slip_velocity[soon]).max(),
    }


def build(axes: Mapping[str, Axis], settings: Mapping[str, float]) -> Sweep:
    """The sweep over V."""
    rig, _ = rig_of(settings)
    fixed = transients.held(settings, rig, "theta", "mu", "F")
    shown = {name: settings[name] for name in ("window_start", "window", "overview", "sample_rate")}
    grid = Grid(axes)
    transients.check(grid, fixed, shown["sample_rate"])
    most = transients.MOST_SAMPLES / RECORDED
    checks.between("window", shown["window"], 1e-5, 0.1, "s")
    checks.between("window_start", shown["window_start"], 0.0, most - shown["window"], "s")
    checks.between("overview", shown["overview"], 10.0 * INTERVAL, most, "s")
    return Sweep(
        "contact",
        contacts,
        grid,
        SERIES | OVERVIEW | STARTING | transients.SUMMARY,
        fixed | shown,
        coords={
            "elapsed": window_times(shown["window_start"], shown["window"], shown["sample_rate"]),
            "interval": intervals(shown["overview"]),
        },
        title="Forces and motion at the contact (Figs. 8 to 10)",
        derive=partial(transients.with_flags, regime=transients.REGIMES, state=transients.STATES),
    )


def report(dataset: xr.Dataset) -> str:
    """How hard the contact is loaded and how fast it slips, beside the paper's."""
    given, text = constants(dataset), transients.text
    papers = transients.is_papers(dataset, theta=paper.THETA)
    lines = [
        f"The contact, theta = {given['theta']:g} degrees, mu = {given['mu']:g}, F = {given['F']:g} N, "
        f"{given['duration']:g} s; from {transients.SETTLING:g} s after the first slip on unless said otherwise.",
        "",
        "Shares of time.",
    ]
    shares, forces, speeds = [], [], []
    for k, speed in enumerate(dataset["V"].values):
        at = dataset.isel(V=k)
        head = [f"{1e3 * speed:.4g}"]
        said = paper.CONTACT_PEAKS.get(speed, (np.nan, np.nan)) if papers else (np.nan, np.nan)
        order = transients.STATES[1:] + transients.STATES[:1]
        shares.append([*head, transients.regime_name(at), *(text(at[f"{n}_fraction"], 3) for n in order)])
        forces.append(
            [*head, text(at["mean_normal_force"], 3)]
            + [text(at[name], 1) for name in ("normal_force_999", "max_normal_force", "start_up_normal_force")]
            + [text(said[0], 0)]
        )
        speeds.append(
            head
            + [text(at[name], 1, 1e3) for name in ("slip_speed_999", "max_slip_speed", "start_up_slip_speed")]
            + [text(said[1], 0, 1e3)]
        )
    lines += transients.table(["V mm/s", "vibration", "stick", "slip", "separation"], shares)
    heads = ["99.9 %", "largest", "start-up", "paper"]
    lines += ["", "Normal force, N.", *transients.table(["V mm/s", "mean", *heads], forces)]
    lines += ["", "Slip speed, mm/s.", *transients.table(["V mm/s", *heads], speeds)]
    lines += [
        "",
        f"99.9 %: not passed for that share of the time; start-up: the largest within {START_UP:g} s of the first",
        "slip. Largest values are spikes of microseconds and grow with the length of the run"
        + ("; the paper's are of the stretch it shows." if papers else "."),
    ]
    if papers:
        lines += _phases(dataset)
    return "\n".join(lines)


def _phases(dataset: xr.Dataset) -> list[str]:
    """How many changes of state a period has, where the paper has four."""
    lines = []
    for k, speed in enumerate(dataset["V"].values):
        at = dataset.isel(V=k)
        changes = float(at["switches_per_second"] / at["dominant_frequency"])
        if np.isfinite(changes):
            lines.append(
                f"{1e3 * speed:.4g} mm/s: {changes:.0f} changes of state in a period of the main line; the paper "
                "shows four phases (stick, slip, separation, slip)."
            )
    return lines


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
    name = transients.regime_name(at)
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
    papers = transients.is_papers(at, theta=paper.THETA)
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
        axes.plot(time, scale * at[variable].values[first:last], color=figures.BLUE, linewidth=0.9)
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


STUDY = Study(
    name="contact",
    title="Figs. 8 to 10: the contact while the rig vibrates",
    question="How do force, slip and contact state go through a period of vibration, and how far beyond the "
    "imposed load and speed do they go?",
    paper="Section 3.5.4 and Figs. 8 to 10: a period has four phases, stick, slip, separation and slip; at 5 mm/s "
    "the normal force reaches 25 N and the slip speed 30 mm/s, at 2 mm/s 50 N and 120 mm/s, where vibration and "
    "sticking phases alternate.",
    axes={"V": Axis(np.array([2e-3, 5e-3]), "m s-1", "velocity of P2's clamp")},
    settings=transients.run_settings(2.5)
    | {
        "window_start": Setting(0.5, "s", "beginning of the window shown closely"),
        "window": Setting(2e-3, "s", "length of the window"),
        "overview": Setting(0.5, "s", "length of the overview from the start"),
        "sample_rate": Setting(500e3, "Hz", "of the series in the window"),
    }
    | rig_settings(),
    build=build,
    draw=draw,
    report=report,
)
