"""Figs. 8 to 10: forces and motion at the contact while the rig vibrates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from scipy.integrate import cumulative_trapezoid

from fivcore import Transient, checks
from studies import paper
from studies.claims import Claim, beside
from studies.motion import recording, regimes, transients
from studies.motion.jobs import BATCH_MULTIPLE, Job, outcomes
from studies.plotting import figures, planes
from studies.rig import rig_settings
from studies.study import Setting, Study, constants
from studies.tables import Column, Part, Table
from sweeps import Axis, Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SEPARATION, STICK, SLIP = range(3)
# The motion is recorded at every step of the method.
RECORDED = 1e6
# Of the overview: its intervals, s, and how long after the first slip the start-up is, s.
INTERVAL = 1e-3
START_UP = 0.1

SERIES = {
    "normal_force": Variable("N", "normal force on P1", ("elapsed",), "float32"),
    "apparent_friction": Variable("1", "tangential over normal force; 0 in separation", ("elapsed",), "float32"),
    "slip_velocity": Variable("m s-1", "velocity of P1's surface relative to P2's", ("elapsed",), "float32"),
    "slip_displacement": Variable(
        "m", "displacement of P1's surface relative to P2's since the window began", ("elapsed",), "float32"
    ),
    "state": Variable("1", "state of the contact", ("elapsed",), "int8", flags=dict(enumerate(transients.STATES))),
}
OVERVIEW = {
    "largest_normal_force": Variable("N", "largest normal force in the interval", ("interval",), "float32"),
    "largest_slip_speed": Variable("m s-1", "largest slip speed in the interval", ("interval",), "float32"),
}
START = {
    "start_up_normal_force": Variable("N", "largest normal force in the first 0.1 s after the first slip"),
    "start_up_slip_speed": Variable("m s-1", "largest slip speed in the first 0.1 s after the first slip"),
}
VARIABLES = SERIES | OVERVIEW | START | transients.SUMMARY
CLAIMS = tuple(
    Claim(name, {"V": V}, value, "3.5.4.1" if V == 5e-3 else "3.5.4.2")
    for V, peaks in paper.CONTACT_PEAKS.items()
    for names in (("normal_force_999", "slip_speed_999"), START)
    for name, value in zip(names, peaks, strict=True)
)
# Columns of the figure; of more speeds it shows so many, evenly chosen.
MOST_COLUMNS = 3
# Periods of the dominant frequency that it shows; a period begins with a stick of at least this share of one.
PERIODS = 2
SHORTEST_STICK = 0.1
# What the curve of the phase plane spans across and up, and where beside it a number may stand, points.
PHASE_PANEL = np.array([170.0, 90.0])
AROUND = 14.0 * np.array([(np.cos(angle), np.sin(angle)) for angle in np.arange(8) * np.pi / 4])


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
    # Every step of the whole run would fill the memory: what is shown is run again.
    until = max(window_start + window, overview)
    shown = {"duration": until, "record": True, "sample_rate": RECORDED}

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        whole, run = runs
        return within(run, times) | interval_peaks(run, overview) | start_peaks(run) | transients.figures_of(whole)

    every = transients.scenes(points, fixed)
    jobs = [[transients.job(scene, fixed), transients.job(scene, fixed, **shown)] for scene in every]
    return outcomes(jobs, values)


def window_times(start: float, length: float, sample_rate: float) -> Axis:
    """The `elapsed` of the window."""
    count = int(length * sample_rate * (1.0 + 1e-12)) + 1
    return Axis(start + np.arange(count) / sample_rate, "s", "time since the drive started")


def intervals(overview: float) -> Axis:
    """The intervals of the overview, by their middles."""
    count = int(overview / INTERVAL * (1.0 + 1e-12))
    return Axis(INTERVAL * (np.arange(count) + 0.5), "s", "middle of the interval, since the drive started")


def within(run: Transient, times: np.ndarray) -> dict[str, Any]:
    """Series of the contact at the steps nearest to `times`, so that force, speed and state belong together."""
    whole = slice(max(int(np.searchsorted(run.time, times[0])) - 1, 0), None)
    time, slip = run.time[whole], run.slip_velocity[whole]
    nearest = np.searchsorted(0.5 * (time[1:] + time[:-1]), times)
    N, T = run.normal_force[whole][nearest], run.tangential_force[whole][nearest]
    moved = cumulative_trapezoid(slip, time, initial=0.0)
    ratio = np.divide(T, N, out=np.zeros_like(N), where=N > 0.0)
    values = N, ratio, slip[nearest], moved[nearest] - moved[nearest[0]], run.state[whole][nearest]
    return dict(zip(SERIES, values, strict=True))


def interval_peaks(run: Transient, overview: float) -> dict[str, Any]:
    """The largest force and speed in every interval of the overview."""
    edges = np.searchsorted(run.time, INTERVAL * np.arange(len(intervals(overview))))
    # With a very low cut-off a step is longer than an interval.
    edges = np.minimum(edges, len(run.time) - 1)
    last = max(np.searchsorted(run.time, INTERVAL * len(edges)), edges[-1] + 1)
    peaks = (np.maximum.reduceat(each[:last], edges) for each in (run.normal_force, np.abs(run.slip_velocity)))
    return dict(zip(OVERVIEW, peaks, strict=True))


def start_peaks(run: Transient) -> dict[str, Any]:
    """The largest force and speed soon after the first slip; NaN unless all of it is known."""
    first = run.summary["first_slip_time"]
    if not first + START_UP <= run.time[-1]:
        return dict.fromkeys(START, np.nan)
    soon = slice(*np.searchsorted(run.time, [first, first + START_UP]))
    return dict(zip(START, (run.normal_force[soon].max(), np.abs(run.slip_velocity[soon]).max()), strict=True))


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse, before anything is planned, runs that cannot be simulated or stored."""
    transients.check(axes, fixed)
    most = transients.MOST_SAMPLES / RECORDED
    checks.between("window", fixed["window"], 1e-5, 0.1, "s")
    checks.between("window_start", fixed["window_start"], 0.0, most - fixed["window"], "s")
    checks.between("overview", fixed["overview"], 10.0 * INTERVAL, most, "s")


def coords(
    *, window_start: float, window: float, overview: float, sample_rate: float, **_: Any
) -> dict[str, Axis]:
    """The times of the window and the intervals of the overview."""
    return {"elapsed": window_times(window_start, window, sample_rate), "interval": intervals(overview)}


def findings(dataset: xr.Dataset) -> list[Part]:
    """How hard the contact is loaded and how fast it slips, beside the paper's."""
    fixed = constants(dataset)
    speed: dict[str, Column] = {"V mm/s": ("V", ".4g", 1e3)}
    changes: Column = (lambda at: at["switches_per_second"] / regimes.dominant_frequency(at), ".0f")
    peaks: dict[str, Column] = {"mean N": ("mean_normal_force", ".3f")}
    for unit, factor, names in (
        ("N", 1.0, ("normal_force_999", "max_normal_force", "start_up_normal_force")),
        ("mm/s", 1e3, ("slip_speed_999", "max_slip_speed", "start_up_slip_speed")),
    ):
        for head, name in zip(("99.9 %", "largest", "start-up"), names, strict=True):
            peaks[f"{head} {unit}"] = (name, ".1f", factor)
    return [
        f"The contact, theta = {fixed['theta']:g} degrees, mu = {fixed['mu']:g}, F = {fixed['F']:g} N, "
        f"{fixed['duration']:g} s, {transients.damping(fixed)}; "
        f"from {transients.SETTLING:g} s after the first slip on unless stated otherwise.",
        "",
        "Shares of time, and changes of state in a period of the dominant frequency "
        "(stick, slip, separation, slip: 4).",
        Table.of(dataset, "V", speed | {"vibration": regimes.kind, **regimes.SHARES, "changes": changes}),
        "",
        "Normal force and slip speed: 99.9 %, not passed for that share of the time; start-up, the largest within "
        f"{START_UP:g} s of the first slip. Largest values are spikes of microseconds and grow with the length of "
        "the run.",
        Table.of(dataset, "V", speed | peaks),
        *beside(dataset, CLAIMS),
    ]


def draw(dataset: xr.Dataset) -> Figure:
    """A column for each speed: the whole start, two periods in time, and one in the phase plane."""
    fixed = constants(dataset)
    columns = transients.some(dataset.sizes["V"], MOST_COLUMNS)
    heights = {"height_ratios": (1.0, 1.0, 1.2, 1.0, 1.0, 1.9)}
    figure, panels = figures.panels(6, len(columns), max(9.0 * len(columns), 12.0), 25.0, gridspec_kw=heights)
    grid = np.array(panels).reshape(6, len(columns))
    for column, k in zip(grid.T, columns, strict=True):
        _draw_speed(column, dataset.isel(V=k), fixed)
    for row in grid:
        low, high = np.transpose([axes.get_ylim() for axes in row])
        # Speeds are compared, so a row has one scale.
        for axes in row:
            axes.set_ylim(low.min(), high.max())
    for axes in grid[:, 1:].flat:
        axes.set_ylabel("")
    figures.legend_below(figure, panels, 4)
    where = ", ".join(planes.named(name, fixed[name]) for name in ("theta", "mu", "F"))
    title = f"The contact, {where}{transients.of_all(columns, dataset.sizes['V'])}"
    figure.suptitle(f"{title}\n{transients.damping(fixed)}")
    return figure


def _draw_speed(column: np.ndarray, at: xr.Dataset, fixed: Mapping[str, Any]) -> None:
    """One column; the panels of a speed that failed stay empty."""
    force, speed, normal, friction, slip, phase = column
    kind = regimes.kind(at)
    force.set(title=f"{planes.named('V', at['V'])}: {kind}", ylabel="largest normal\nforce / N")
    speed.set(ylabel="largest slip\nspeed / (mm/s)", xlabel="time since the drive started / s")
    normal.set_ylabel("normal force\n/ N")
    friction.set_ylabel("apparent\nfriction T/N")
    slip.set(ylabel="slip velocity\n/ (mm/s)", xlabel="time / ms")
    phase.set(xlabel="slip displacement / μm", ylabel="slip velocity / (mm/s)")
    if kind == "failed":
        return
    for axes, name, scale in zip((force, speed), OVERVIEW, (1.0, 1e3), strict=True):
        axes.step(at["interval"], scale * at[name].values, where="mid", color=figures.BLUE, linewidth=0.8)
    if paper.is_point(at, mu=paper.MU, F=paper.LOAD, theta=paper.THETA):
        peaks = paper.CONTACT_PEAKS.get(float(at["V"]), ())
        for axes, scale, peak in zip((force, speed), (1.0, 1e3), peaks, strict=False):
            dashed: dict[str, Any] = {"color": figures.RED, "linestyle": "--", "linewidth": 1.0}
            axes.axhline(scale * peak, **dashed, label="paper: reached")
    first, last, one = shown(at)
    window = at.isel(elapsed=slice(first, last))
    begin = float(window["elapsed"][0])
    time = 1e3 * (window["elapsed"].values - begin)
    for axes, name, scale in zip((normal, friction, slip), SERIES, (1.0, 1.0, 1e3), strict=False):
        figures.trace(axes, time, scale * window[name].values, color=figures.BLUE, linewidth=0.9)
        _mark_states(axes, time, window["state"].values)
        axes.set_xlim(0.0, time[-1])
    for upper, lower in ((normal, slip), (friction, slip), (force, speed)):
        upper.sharex(lower)
        upper.tick_params(labelbottom=False)
    speed.set_xlim(0.0, fixed["overview"])
    bound = np.copysign(fixed["mu"], float(at["V"]))
    friction.axhline(bound, color=figures.BLACK, linestyle=":", linewidth=1.0, label="imposed friction μ")
    slip.set_xlabel(f"time since {begin:.5f} s / ms")
    _draw_phase(phase, at.isel(elapsed=slice(first, one)))


def shown(at: xr.Dataset) -> tuple[int, int, int]:
    """Places of the drawn part of the window: its begin and end, two periods from a stick on; the first's end.

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
    """Shade what is not slip, which stays white."""
    looks: dict[int, dict[str, Any]] = {
        STICK: {"facecolor": "#d9d9d9", "edgecolor": "none"},
        SEPARATION: {"facecolor": "#fbe3b5", "edgecolor": "#e0b050", "hatch": "//////"},
    }
    for code, look in looks.items():
        look |= {"transform": axes.get_xaxis_transform(), "linewidth": 0.0, "zorder": 0.5}
        axes.fill_between(time, 0.0, 1.0, where=state == code, step="mid", label=transients.STATES[code], **look)
    axes.fill_between([], [], facecolor="white", edgecolor=figures.GREY, linewidth=0.5, label="slip (white)")


def _draw_phase(axes: Axes, at: xr.Dataset) -> None:
    """One period in the phase plane, its main phases numbered as in the paper."""
    moved, speed = 1e6 * at["slip_displacement"].values, 1e3 * at["slip_velocity"].values
    moved, state = moved - moved[0], at["state"].values
    looks = {SLIP: ("-", figures.BLUE), SEPARATION: ("--", figures.ORANGE), STICK: (".-", figures.BLACK)}
    for code, (style, colour) in looks.items():
        within = state == code
        if code != STICK:
            # From the last sample of a stick and to the first of what follows, so that the curve has no gap.
            stuck_before = (state == STICK) & np.append(within[1:], False)
            within = within | stuck_before | np.append(False, within[:-1])
        x, y = (np.where(within, each, np.nan) for each in (moved, speed))
        axes.plot(x, y, style, color=colour, linewidth=1.6, label=f"phase plane: {transients.STATES[code]}")
    axes.plot(moved[0], speed[0], "o", color=figures.RED, markersize=5, zorder=4, label="start of the period")
    axes.margins(0.12, 0.25)
    taken = PHASE_PANEL * np.stack([moved / (np.ptp(moved) or 1.0), speed / (np.ptp(speed) or 1.0)], axis=1)
    for number, (begin, end) in main_phases(state).items():
        middle = begin + int(np.abs(speed[begin:end]).argmax()) if number == 3 else (begin + end) // 2
        # Where the curve and the other numbers are farthest.
        far = [np.hypot(*(taken - taken[middle] - beside).T).min() for beside in AROUND]
        beside = AROUND[int(np.argmax(far))]
        taken = np.append(taken, [taken[middle] + beside], axis=0)
        place: dict[str, Any] = {"xytext": beside, "textcoords": "offset points", "va": "center", "ha": "center"}
        axes.annotate(f"({number})", (moved[middle], speed[middle]), **place)


def main_phases(state: np.ndarray) -> dict[int, tuple[int, int]]:
    """The paper's four phases of a period: stick, slip, separation, slip; the longest run of each in its place."""

    def longest(code: int, begin: int, end: int) -> tuple[int, int] | None:
        runs = [(a + begin, b + begin) for a, b in transients.stretches(state[begin:end] == code)]
        return max(runs, key=lambda run: run[1] - run[0]) if runs else None

    phases = {1: longest(STICK, 0, len(state)), 3: longest(SEPARATION, 0, len(state))}
    if (apart := phases[3]) is not None:
        phases |= {2: longest(SLIP, 0, apart[0]), 4: longest(SLIP, apart[1], len(state))}
    return {number: run for number, run in sorted(phases.items()) if run is not None}


STUDY = Study(
    name="contact",
    title="Figs. 8 to 10: the contact while the rig vibrates",
    question="How do force, slip and contact state go through a period of vibration, and how far beyond the "
    "imposed load and speed do they go, with the published scheme's numerical damping?",
    paper="Section 3.5.4 and Figs. 8 to 10: a period has four phases, stick, slip, separation and slip; at 5 mm/s "
    "the normal force reaches 25 N and the slip speed 30 mm/s, at 2 mm/s 50 N and 120 mm/s, where vibration and "
    "sticking phases alternate.",
    axes={"V": Axis(np.array([2e-3, 5e-3]), "m s-1", "velocity of P2's clamp")},
    settings=transients.run_settings(2.5, transients.PUBLISHED)
    | {
        "window_start": Setting(0.5, "s", "beginning of the window shown closely"),
        "window": Setting(2e-3, "s", "length of the window"),
        "overview": Setting(0.5, "s", "length of the overview from the start"),
        "sample_rate": Setting(500e3, "Hz", "of the series in the window"),
    }
    | rig_settings(),
    function=contacts,
    variables=VARIABLES,
    constants=transients.constants("theta", "mu", "F", "window_start", "window", "overview", "sample_rate"),
    coords=coords,
    check=check,
    options={"batch_multiple": BATCH_MULTIPLE},
    draw=draw,
    findings=findings,
    record=recording.in_a_window,
)
