"""Figs. 8 to 10: forces and motion at the contact while the rig vibrates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from scipy.integrate import cumulative_trapezoid

import fivcore
from fivcore import LimitCycle, Rig, Scene, SceneError, Transient, UnsolvedError, checks, follow_cycle, limit_cycle
from studies import paper
from studies.answering.claims import is_papers_point
from studies.declaring import labels
from studies.declaring.parameters import RUN, published
from studies.motion import regimes, run, series
from studies.motion.jobs import Job, outcomes, run_all
from studies.plotting import figures, planes
from studies.study import Claim, Parameter, Study
from sweeps import Axis, Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SEPARATION, STICK, SLIP = range(3)
FORCES = ("normal_force", "tangential_force", "slip_velocity")
# The motion is recorded at every step of the method; of one series so many samples fit into memory.
RECORDED, MOST_SAMPLES = 1e6, 5_000_000
# Of the overview: its intervals, s, and how long after the first slip the start-up lasts, s.
INTERVAL, START_UP = 1e-3, 0.1
SERIES = {
    "normal_force": Variable("N", "normal force on P1", ("elapsed",), "float32"),
    "apparent_friction": Variable("1", "tangential over normal force; 0 in separation", ("elapsed",), "float32"),
    "slip_velocity": Variable("m s-1", "velocity of P1's surface relative to P2's", ("elapsed",), "float32"),
    "slip_displacement": Variable(
        "m", "displacement of P1's surface relative to P2's since the window began", ("elapsed",), "float32"
    ),
    "state": Variable("1", "state of the contact", ("elapsed",), "int8", flags=dict(enumerate(run.STATES))),
}
OVERVIEW = {
    "largest_normal_force": Variable("N", "largest normal force in the interval", ("interval",), "float32"),
    "largest_slip_speed": Variable("m s-1", "largest slip speed in the interval", ("interval",), "float32"),
}
# A run of so many seconds finds a cycle at this d2, s; it is followed from there to that of the rig.
SEARCH, SOUGHT = 1.0, 1.5e-7
# Samples of a cycle, and of one that a motion is compared with; it is near up to this share of their deviations.
SAMPLES, COMPARED, NEAR = 1000, 64, 0.5
CYCLE_SERIES = {
    f"cycle_{name}": Variable(each.units, f"{each.long_name}, on the limit cycle", ("phase",), "float32")
    for name, each in SERIES.items()
}
CYCLE = {
    "cycle_frequency": Variable("Hz", "frequency of the limit cycle"),
    "cycle_max_normal_force": Variable("N", "largest normal force on the limit cycle"),
    "cycle_max_slip_speed": Variable("m s-1", "largest slip speed on the limit cycle"),
    "cycle_multiplier": Variable("1", "largest Floquet multiplier of the limit cycle, in magnitude"),
    "cycle_near": Variable("1", "part of the overview, from the first slip on, that is near the limit cycle"),
    "cycle_d2": Variable("s", "d2 nearest to that of the rig to which the limit cycle is followed"),
}
START = {
    "start_up_normal_force": Variable("N", "largest normal force in the first 0.1 s after the first slip"),
    "start_up_slip_speed": Variable("m s-1", "largest slip speed in the first 0.1 s after the first slip"),
}
PEAKS = ("normal_force", "slip_speed")
CLAIMS = tuple(
    Claim(name, {"V": V}, value, "3.5.4.1" if V == 5e-3 else "3.5.4.2")
    for V, peaks in paper.CONTACT_PEAKS.items()
    for names in (("normal_force_999", "slip_speed_999"), START)
    for name, value in zip(names, peaks, strict=True)
)
CLAIMS += tuple(
    Claim(f"cycle_max_{name}", {"V": 5e-3}, value, "Figs. 8, 9")
    for name, value in zip(PEAKS, paper.CONTACT_PEAKS[5e-3], strict=True)
)
# Where the number of a phase is written, points from its middle.
OFFSETS = {1: (0, 11), 2: (14, -6), 3: (0, -12), 4: (-8, 13)}
PHASES = "(1) stick, (2) slip, (3) separation, (4) slip"
# Columns of the figure; periods of the dominant frequency in it, each begun by a stick of this share of a period.
MOST_COLUMNS, PERIODS, SHORTEST_STICK = 3, 2, 0.1


def contacts(
    scenes: Sequence[Scene],
    duration: float,
    window_start: float,
    window: float,
    overview: float,
    sample_rate: float,
    most: int,
    **options: Any,
) -> dict[str, Any]:
    """The contact of each scene in the window and in the overview, and the summary of its whole run."""
    times = window_times(window_start, window, sample_rate).values
    # Every step of the whole run would fill the memory: the recorded part is run again.
    recorded: dict[str, Any] = {"record": True, "sample_rate": None}
    lengths: Any = ((duration, {}), (max(window_start + window, overview), recorded))

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        whole, part = runs
        found = within(part, times) | interval_peaks(part, overview) | start_peaks(part) | run.summary_of(whole)
        return found | cycle_values(jobs[0].scene, part, most, options["numerical_damping"], options["cutoff"])

    jobs = [[run.job(scene, length, options, **how) for length, how in lengths] for scene in scenes]
    return outcomes(jobs, values)


def window_times(start: float, length: float, sample_rate: float) -> Axis:
    """The `elapsed` of the window."""
    count = int(length * sample_rate * (1.0 + 1e-12)) + 1
    return Axis(start + np.arange(count) / sample_rate, "s", "time since the drive started")


def intervals(overview: float) -> Axis:
    """The intervals of the overview, by their middles."""
    count = int(overview / INTERVAL * (1.0 + 1e-12))
    return Axis(INTERVAL * (np.arange(count) + 0.5), "s", "middle of the interval, since the drive started")


def within(motion: Transient, times: np.ndarray) -> dict[str, Any]:
    """Series of the contact at the steps nearest to `times`, so that force, speed and state belong together."""
    whole = slice(max(int(np.searchsorted(motion.time, times[0])) - 1, 0), None)
    time, slip = motion.time[whole], motion.slip_velocity[whole]
    nearest = np.searchsorted(0.5 * (time[1:] + time[:-1]), times)
    N, T = motion.normal_force[whole][nearest], motion.tangential_force[whole][nearest]
    moved = cumulative_trapezoid(slip, time, initial=0.0)
    ratio = np.divide(T, N, out=np.zeros_like(N), where=N > 0.0)
    values = N, ratio, slip[nearest], moved[nearest] - moved[nearest[0]], motion.state[whole][nearest]
    return dict(zip(SERIES, values, strict=True))


def interval_peaks(motion: Transient, overview: float) -> dict[str, Any]:
    """The largest force and speed in every interval of the overview."""
    edges = np.searchsorted(motion.time, INTERVAL * np.arange(len(intervals(overview))))
    # With a very low cut-off a step is longer than an interval.
    edges = np.minimum(edges, len(motion.time) - 1)
    last = max(np.searchsorted(motion.time, INTERVAL * len(edges)), edges[-1] + 1)
    sizes = (motion.normal_force, np.abs(motion.slip_velocity))
    return dict(zip(OVERVIEW, (np.maximum.reduceat(size[:last], edges) for size in sizes), strict=True))


def start_peaks(motion: Transient) -> dict[str, Any]:
    """The largest force and speed soon after the first slip; NaN unless the run covers all of that time."""
    first = motion.summary["first_slip_time"]
    if not first + START_UP <= motion.time[-1]:
        return dict.fromkeys(START, np.nan)
    soon = slice(*np.searchsorted(motion.time, [first, first + START_UP]))
    peaks = motion.normal_force[soon].max(), np.abs(motion.slip_velocity[soon]).max()
    return dict(zip(START, peaks, strict=True))


def sought(scene: Scene, cutoff: float | None, most: int) -> tuple[LimitCycle | None, float]:
    """The limit cycle of a scene, if one is found, and the d2 to which it was followed.

    It is sought near a run without long sticks: of beams at d2 = SOUGHT, at which it repeats itself best.
    """
    own = getattr(scene.rig, "d2", np.nan)
    first = replace(scene, rig=replace(scene.rig, d2=SOUGHT)) if isinstance(scene.rig, Rig) else scene
    duration = SEARCH * scene.rig.time_scale
    try:
        (motion,) = run_all([Job(first, duration, {"cutoff": cutoff})])
        if isinstance(motion, SceneError) or motion.summary["regime"] not in regimes.WITHOUT_STICKS:
            return None, np.nan
        cycle = limit_cycle(first, duration=duration, cutoff=cutoff)
        if own == SOUGHT or not np.isfinite(own):
            return cycle, own
        branch = follow_cycle(cycle, "d2", own, most=most)
        nearest = int(np.abs(branch.values - own).argmin())
        if not branch.values.min() <= own <= branch.values.max():
            return None, float(branch.values[nearest])
        return limit_cycle(scene, branch.cycles[nearest]), own
    except (UnsolvedError, SceneError):
        return None, np.nan


def cycle_values(
    scene: Scene, motion: Transient, most: int, numerical_damping: str, cutoff: float | None
) -> dict[str, Any]:
    """The limit cycle of a scene, and how near to it the motion is; NaN where none is found."""
    damped = replace(scene, rig=fivcore.with_numerical_damping(scene.rig, run.METHOD, numerical_damping))
    cycle, d2 = sought(damped, cutoff, most) if most else (None, np.nan)
    values: dict[str, Any] = dict.fromkeys(CYCLE, np.nan) | {"cycle_d2": d2}
    if cycle is None:
        return values | {name: np.full(SAMPLES, np.nan) for name in CYCLE_SERIES}
    begins = np.cumsum([0.0, *(time for _, time in cycle.states)])
    stick = max(range(len(cycle.states)), key=lambda k: (cycle.states[k][0] == "stick", cycle.states[k][1]))
    time = (begins[stick] + cycle.period * np.arange(SAMPLES) / SAMPLES) % cycle.period
    N, T, slip = (np.interp(time, cycle.time, getattr(cycle, name)) for name in FORCES)
    state = cycle.state[np.searchsorted(cycle.time, time, side="right") - 1]
    ratio = np.divide(T, N, out=np.zeros_like(N), where=state != SEPARATION)
    moved = np.cumsum(slip) * cycle.period / SAMPLES
    summary = {name: cycle.summary[name.removeprefix("cycle_")] for name in list(CYCLE)[:3]}
    summary |= {"cycle_multiplier": cycle.summary["largest_multiplier"], "cycle_near": near(motion, cycle)}
    return values | summary | dict(zip(CYCLE_SERIES, (N, ratio, slip, moved - moved[0], state), strict=True))


def near(motion: Transient, cycle: LimitCycle) -> float:
    """The part of the time in which a motion is near a cycle.

    Near it is a period in which normal force and velocity of B differ from the cycle's, at the best phase, by
    less than NEAR of their deviations on it (root mean square).
    """
    step, names = cycle.period / COMPARED, ("normal_force", "velocity_B")
    times = np.arange(motion.summary["first_slip_time"], motion.time[-1], step)
    moved = np.stack([np.interp(times, motion.time, getattr(motion, name)) for name in names])
    one = np.stack([np.interp(step * np.arange(COMPARED), cycle.time, getattr(cycle, name)) for name in names])
    middle, spread = one.mean(axis=1, keepdims=True), one.std(axis=1, keepdims=True)
    one = (one - middle) / spread
    parts = np.lib.stride_tricks.sliding_window_view((moved - middle) / spread, COMPARED, axis=1)
    parts = parts[:, :: COMPARED // 8]
    # Products of each part with the cycle at all phases.
    products = np.fft.irfft(np.fft.rfft(parts) * np.fft.rfft(one).conj()[:, None], COMPARED).sum(axis=0)
    squares = (parts**2).sum(axis=(0, 2)) + (one**2).sum() - 2.0 * products.max(axis=-1)
    return float(np.mean(squares < NEAR**2 * len(names) * COMPARED))


def check(
    window: float, window_start: float, overview: float, sample_rate: float, duration: Any, **others: Any
) -> None:
    """Refuse runs that cannot be simulated or stored."""
    most = MOST_SAMPLES / RECORDED
    checks.between("window", window, 1e-5, 0.1, "s")
    checks.between("window_start", window_start, 0.0, most - window, "s")
    checks.between("overview", overview, 10.0 * INTERVAL, most, "s")
    checks.between("sample_rate", sample_rate, 1e3, 1e6, "Hz")
    checks.between("most", float(np.max(others.pop("most"))), 0.0, 1000.0, "points")
    checks.between("duration", np.min(duration), 2.0 * series.WINDOW, 1e6, "s")
    run.check(**{name: others[name] for name in ("V", "F", *RUN)})


def coords(window_start: float, window: float, overview: float, sample_rate: float) -> dict[str, Axis]:
    """The times of the window and the intervals of the overview."""
    phase = Axis(np.arange(SAMPLES) / SAMPLES, "1", "part of the period since the longest stick began")
    times = window_times(window_start, window, sample_rate)
    return {"elapsed": times, "interval": intervals(overview), "phase": phase}


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """How hard the contact is loaded and how fast it slips."""
    for k in range(dataset.sizes["V"]):
        point = dataset.isel(V=k)
        force, speed = (labels.number(float(labels.readable(point[f"{name}_999"]))) for name in PEAKS)
        speeds = labels.named("V", point["V"])
        yield f"At {speeds} the normal force reaches {force} N and the slip speed {speed} mm/s (99.9 % quantiles)."
    if int(dataset["most"]):
        yield from (cycle_text(dataset.isel(V=k)) for k in range(dataset.sizes["V"]))
    changes = dataset["switches_per_second"] / regimes.dominant_frequency(dataset)
    table = dataset.assign(state_changes_per_period=changes.assign_attrs(units="1"))
    names = ["V", "regime", "stick_fraction", "slip_fraction", "separation_fraction", "state_changes_per_period"]
    yield (
        "Fractions of time, and changes of state in a period of the dominant frequency",
        labels.frame(table, names),
    )
    yield (
        "Normal force",
        labels.frame(
            dataset, ["V", "mean_normal_force", "normal_force_999", "max_normal_force", "start_up_normal_force"]
        ),
    )
    yield "Slip speed", labels.frame(dataset, ["V", "slip_speed_999", "max_slip_speed", "start_up_slip_speed"])
    yield "Largest values are spikes of microseconds and grow with the length of the run."


def cycle_text(point: xr.Dataset) -> str:
    """A sentence about the limit cycle of a point: its frequency, peaks and stability, or why none is found."""
    value = {name: float(labels.readable(point[name])) for name in CYCLE}
    frequency, force, speed, multiplier, share, d2 = (labels.number(each) for each in value.values())
    where = labels.named("V", point["V"])
    if np.isfinite(value["cycle_frequency"]):
        kind = "stable" if value["cycle_multiplier"] < 1.0 else "unstable"
        return (
            f"The limit cycle at {where}, {frequency} Hz, reaches {force} N and {speed} mm/s. It is {kind}: its "
            f"largest multiplier is {multiplier}. The motion is near it for {share} of the time: over a period "
            f"normal force and velocity of B differ from the cycle's by less than {NEAR:g} of their deviations."
        )
    if np.isfinite(value["cycle_d2"]):
        return (
            f"No limit cycle is found at {where}: that of d2 = {SOUGHT:g} s, which a run finds, is followed to "
            f"d2 = {d2} s, and does not reach the damping here."
        )
    return f"No limit cycle is found at {where}: a run without long sticks that repeats itself is needed for it."


def draw(dataset: xr.Dataset) -> Figure:
    """A column for each speed: the whole start, two periods in time, and one in the phase plane."""
    columns = planes.subset(dataset.sizes["V"], MOST_COLUMNS)
    heights = {"height_ratios": (1.0, 1.0, 1.2, 1.0, 1.0, 1.9)}
    figure, panels = figures.panels(6, len(columns), max(9.0 * len(columns), 12.0), 25.0, gridspec_kw=heights)
    grid = np.array(panels).reshape(6, len(columns))
    for column, k in zip(grid.T, columns, strict=True):
        _draw_speed(column, dataset.isel(V=k))
    for row in grid:
        low, high = np.transpose([axes.get_ylim() for axes in row])
        # Speeds are compared, so a row has one scale.
        for axes in row:
            axes.set_ylim(low.min(), high.max())
    for axes in grid[:, 1:].flat:
        axes.set_ylabel("")
    figures.legend_below(figure, panels, 3 if len(columns) > 1 else 2)
    where = ", ".join(labels.named(name, dataset[name]) for name in ("theta", "mu", "F"))
    title = f"The contact, {where}{planes.of_all(columns, dataset.sizes['V'])}"
    figure.suptitle(f"{title}\n{regimes.damping_text(dataset)}")
    return figure


def _draw_speed(column: np.ndarray, point: xr.Dataset) -> None:
    """One column; the panels of a speed that failed stay empty."""
    force, speed, normal, friction, slip, phase = column
    kind = regimes.kind(point)
    force.set(title=f"{labels.named('V', point['V'])}: {kind}", ylabel="largest normal\nforce / N")
    speed.set(ylabel="largest slip\nspeed / (mm/s)", xlabel="time since the drive started / s")
    normal.set_ylabel("normal force\n/ N")
    friction.set_ylabel("apparent\nfriction T/N")
    slip.set(ylabel="slip velocity\n/ (mm/s)", xlabel="time / ms")
    phase.set(xlabel="slip displacement / μm", ylabel="slip velocity / (mm/s)")
    if kind == "failed":
        return
    for axes, name, scale in zip((force, speed), OVERVIEW, (1.0, 1e3), strict=True):
        axes.step(point["interval"], scale * point[name].values, where="mid", color=figures.BLUE, linewidth=0.8)
    if is_papers_point(point, mu=paper.MU, F=paper.LOAD, theta=paper.THETA):
        peaks = paper.CONTACT_PEAKS.get(float(point["V"]), ())
        for axes, scale, peak in zip((force, speed), (1.0, 1e3), peaks, strict=False):
            dashed: dict[str, Any] = {"color": figures.RED, "linestyle": "--", "linewidth": 1.0}
            axes.axhline(scale * peak, **dashed, label="paper: reached")
    first, last, one = periods(point)
    window = point.isel(elapsed=slice(first, last))
    begin = float(window["elapsed"][0])
    time = 1e3 * (window["elapsed"].values - begin)
    for axes, name, scale in zip((normal, friction, slip), SERIES, (1.0, 1.0, 1e3), strict=False):
        figures.trace(axes, time, scale * window[name].values, color=figures.BLUE, linewidth=0.9)
        _mark_states(axes, time, window["state"].values)
        axes.set_xlim(0.0, max(time[-1], 1e-6))
    for upper, lower in ((normal, slip), (friction, slip), (force, speed)):
        upper.sharex(lower)
        upper.tick_params(labelbottom=False)
    speed.set_xlim(0.0, float(point["overview"]))
    bound = np.copysign(float(point["mu"]), float(point["V"]))
    friction.axhline(bound, color=figures.BLACK, linestyle=":", linewidth=1.0, label="imposed friction μ")
    slip.set_xlabel(f"time since {begin:.5f} s / ms")
    shown = point.isel(elapsed=slice(first, one))
    if np.isfinite(float(point["cycle_frequency"])):
        # The motion as it is, and the cycle with its states.
        phase.plot(*_plane(window), color=figures.GREY, linewidth=0.7, label="phase plane: motion")
        shown = xr.Dataset({name: ("elapsed", point[f"cycle_{name}"].values) for name in SERIES})
        time = 1e3 * np.arange(PERIODS * SAMPLES) / SAMPLES / float(point["cycle_frequency"])
        for axes, name, scale in zip((normal, friction, slip), SERIES, (1.0, 1.0, 1e3), strict=False):
            y = scale * np.tile(shown[name].values, PERIODS)
            axes.plot(time, y, color=figures.RED, linewidth=0.9, label="limit cycle")
    _draw_phase(phase, shown)


def _plane(point: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Slip displacement, um, and velocity, mm/s."""
    moved = 1e6 * point["slip_displacement"].values
    return moved - moved[0], 1e3 * point["slip_velocity"].values


def periods(point: xr.Dataset) -> tuple[int, int, int]:
    """Indices of the drawn part of the window: its begin and end, two periods from a stick on; the first's end.

    Periods differ. Of those with all four phases, if there are any, the first is the one that moves P1 on most
    nearly by what P2 does in a period.
    """
    elapsed, frequency = point["elapsed"].values, float(point["dominant_frequency"])
    period = round(1.0 / (frequency * (elapsed[1] - elapsed[0]))) if np.isfinite(frequency) else len(elapsed)
    rest = len(elapsed) - PERIODS * period
    if rest <= 0:
        return 0, len(elapsed), min(period, len(elapsed))
    sticks = series.runs_of_true(point["state"].values == STICK)
    begins = np.array([a for a, b in sticks if 0 < a <= rest and b - a >= SHORTEST_STICK * period], dtype=int)
    if not len(begins):
        return 0, PERIODS * period, period
    whole = [begin for begin in begins if len(main_phases(point["state"].values[begin : begin + period])) == 4]
    begins = np.array(whole or begins, dtype=int)
    moved = np.abs(point["slip_displacement"].values[begins + period] - point["slip_displacement"].values[begins])
    first = int(begins[np.abs(moved - abs(float(point["V"])) / frequency).argmin()])
    return first, first + PERIODS * period, first + period


def _mark_states(axes: Axes, time: np.ndarray, state: np.ndarray) -> None:
    """Shade stick and separation; slip stays white."""
    looks: dict[int, dict[str, Any]] = {
        STICK: {"facecolor": "#d9d9d9", "edgecolor": "none"},
        SEPARATION: {"facecolor": "#fbe3b5", "edgecolor": "#e0b050", "hatch": "//////"},
    }
    for code, look in looks.items():
        look |= {"transform": axes.get_xaxis_transform(), "linewidth": 0.0, "zorder": 0.5}
        axes.fill_between(time, 0.0, 1.0, where=state == code, step="mid", label=run.STATES[code], **look)
    axes.fill_between([], [], facecolor="white", edgecolor=figures.GREY, linewidth=0.5, label="slip (white)")


def _draw_phase(axes: Axes, point: xr.Dataset) -> None:
    """One period in the phase plane, its main phases numbered as in the paper."""
    (moved, speed), state = _plane(point), point["state"].values
    looks = {SLIP: ("-", figures.BLUE), SEPARATION: ("--", figures.ORANGE), STICK: (".-", figures.BLACK)}
    for code, (style, colour) in looks.items():
        inside = state == code
        if code != STICK:
            # From the last sample of a stick and to the first of what follows, so that the curve has no gap.
            stuck_before = (state == STICK) & np.append(inside[1:], False)
            inside = inside | stuck_before | np.append(False, inside[:-1])
        x, y = (np.where(inside, values, np.nan) for values in (moved, speed))
        axes.plot(x, y, style, color=colour, linewidth=1.6, label=f"phase plane: {run.STATES[code]}")
    axes.plot(moved[0], speed[0], "o", color=figures.RED, markersize=5, zorder=4, label="start of the period")
    axes.margins(0.15, 0.3)
    for number, (begin, end) in main_phases(state).items():
        middle = begin + int(np.abs(speed[begin:end]).argmax()) if number == 3 else (begin + end) // 2
        place: dict[str, Any] = {"xytext": OFFSETS[number], "textcoords": "offset points"}
        axes.annotate(f"({number})", (moved[middle], speed[middle]), **place, va="center", ha="center")
    axes.plot([], [], " ", label=PHASES)


def main_phases(state: np.ndarray) -> dict[int, tuple[int, int]]:
    """The paper's four phases of a period: stick, slip, separation, slip; the longest run of each in its place."""

    def longest(code: int, begin: int, end: int) -> tuple[int, int] | None:
        runs = [(a + begin, b + begin) for a, b in series.runs_of_true(state[begin:end] == code)]
        return max(runs, key=lambda part: part[1] - part[0]) if runs else None

    phases = {1: longest(STICK, 0, len(state)), 3: longest(SEPARATION, 0, len(state))}
    if (separation := phases[3]) is not None:
        phases |= {2: longest(SLIP, 0, separation[0]), 4: longest(SLIP, separation[1], len(state))}
    return {number: part for number, part in sorted(phases.items()) if part is not None}


STUDY = Study(
    name="contact",
    title="Figs. 8 to 10: the contact while the rig vibrates",
    question="How do force, slip and contact state go through a period of vibration, and how far beyond the "
    "imposed load and speed do they go, with the published scheme's numerical damping?",
    paper="Section 3.5.4 and Figs. 8 to 10: a period has four phases, stick, slip, separation and slip; at 5 mm/s "
    "the normal force reaches 25 N and the slip speed 30 mm/s, at 2 mm/s 50 N and 120 mm/s, where vibration and "
    "sticking phases alternate.",
    parameters={
        "V": Parameter(np.array([2e-3, 5e-3]), "m s-1", "speed of the drive"),
        "duration": Parameter(2.5, "s", "simulated time", common=True),
        "window_start": Parameter(0.5, "s", "beginning of the window drawn in time", common=True),
        "window": Parameter(2e-3, "s", "length of the window", common=True),
        "overview": Parameter(0.5, "s", "length of the overview from the start", common=True),
        "sample_rate": Parameter(500e3, "Hz", "sampling rate of the series in the window", common=True),
        "most": Parameter(
            30, "1", "most points over which a limit cycle is followed; 0: none is sought", common=True
        ),
    }
    | published(RUN),
    outputs=SERIES | OVERVIEW | START | CYCLE_SERIES | CYCLE | run.SUMMARY,
    function=contacts, coords=coords, check=check, summary=summarise, figure=draw, claims=CLAIMS, chaotic=True,
)  # fmt: skip
