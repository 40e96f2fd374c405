"""The contact in a run: samples at given times, peaks of intervals, periods and their four phases."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from fivcore import Transient, checks
from studies.declaring.parameters import Parameter
from studies.motion import run
from studies.motion.series import runs_of_true
from sweeps import Axis, Variable

Array = NDArray[Any]

SEPARATION, STICK, SLIP = range(3)
# Of the overview: its intervals, s, and how long after the first slip the start-up lasts, s.
INTERVAL, START_UP = 1e-3, 0.1
# The motion is recorded at every step of the method; of one series so many samples fit into memory.
RECORDED, MOST_SAMPLES = 1e6, 5_000_000
# Samples of a limit cycle.
SAMPLES = 1000
# Periods of the dominant frequency that are shown; each begins with a stick of at least this share of a period.
PERIODS, SHORTEST_STICK = 2, 0.1
SETTINGS = {
    "window_start": Parameter(0.5, "s", "beginning of the window drawn in time", common=True),
    "window": Parameter(2e-3, "s", "length of the window", common=True),
    "overview": Parameter(0.5, "s", "length of the overview from the start", common=True),
    "sample_rate": Parameter(500e3, "Hz", "sampling rate of the series in the window", common=True),
}


def _series(units: str, text: str, dim: str = "elapsed") -> Variable:
    return Variable(units, text, (dim,), "float32")


SERIES = {
    "normal_force": _series("N", "normal force on P1"),
    "apparent_friction": _series("1", "tangential over normal force; 0 in separation"),
    "slip_velocity": _series("m s-1", "velocity of P1's surface relative to P2's"),
    "slip_displacement": _series("m", "displacement of P1's surface relative to P2's since the window began"),
    "state": Variable("1", "state of the contact", ("elapsed",), "int8", flags=dict(enumerate(run.STATES))),
}
OVERVIEW = {
    "largest_normal_force": _series("N", "largest normal force in the interval", "interval"),
    "largest_slip_speed": _series("m s-1", "largest slip speed in the interval", "interval"),
}
START = {
    "start_up_normal_force": Variable("N", "largest normal force in the first 0.1 s after the first slip"),
    "start_up_slip_speed": Variable("m s-1", "largest slip speed in the first 0.1 s after the first slip"),
}


def check(window: float, window_start: float, overview: float, sample_rate: float) -> None:
    """Refuse parameters with which nothing can be recorded."""
    most = MOST_SAMPLES / RECORDED
    checks.between("window", window, 1e-5, 0.1, "s")
    checks.between("window_start", window_start, 0.0, most - window, "s")
    checks.between("overview", overview, 10.0 * INTERVAL, most, "s")
    checks.between("sample_rate", sample_rate, 1e3, 1e6, "Hz")


def coords(window_start: float, window: float, overview: float, sample_rate: float) -> dict[str, Axis]:
    """The times of the window, the intervals of the overview by their middles, and the phases of a cycle."""
    samples, intervals = (int(length * (1.0 + 1e-12)) for length in (window * sample_rate, overview / INTERVAL))
    times, middles = window_start + np.arange(samples + 1) / sample_rate, INTERVAL * (np.arange(intervals) + 0.5)
    return {
        "elapsed": Axis(times, "s", "time since the drive started"),
        "interval": Axis(middles, "s", "middle of the interval, since the drive started"),
        "phase": Axis(np.arange(SAMPLES) / SAMPLES, "1", "part of the period since the longest stick began"),
    }


def within(motion: Transient, times: Array) -> dict[str, Any]:
    """SERIES at the steps nearest to `times`, so that force, speed and state belong together."""
    whole = slice(max(int(np.searchsorted(motion.time, times[0])) - 1, 0), None)
    time, slip = motion.time[whole], motion.slip_velocity[whole]
    nearest = np.searchsorted(0.5 * (time[1:] + time[:-1]), times)
    N, T = motion.normal_force[whole][nearest], motion.tangential_force[whole][nearest]
    moved = cumulative_trapezoid(slip, time, initial=0.0)
    ratio = np.divide(T, N, out=np.zeros_like(N), where=N > 0.0)
    values = N, ratio, slip[nearest], moved[nearest] - moved[nearest[0]], motion.state[whole][nearest]
    return dict(zip(SERIES, values, strict=True))


def interval_peaks(motion: Transient, overview: float) -> dict[str, Any]:
    """The largest force and speed in each interval of the overview."""
    edges = np.searchsorted(motion.time, INTERVAL * np.arange(int(overview / INTERVAL * (1.0 + 1e-12))))
    # With a very low cut-off a step is longer than an interval.
    edges = np.minimum(edges, len(motion.time) - 1)
    last = max(np.searchsorted(motion.time, INTERVAL * len(edges)), edges[-1] + 1)
    sizes = (motion.normal_force, np.abs(motion.slip_velocity))
    return dict(zip(OVERVIEW, (np.maximum.reduceat(size[:last], edges) for size in sizes), strict=True))


def start_peaks(motion: Transient) -> dict[str, Any]:
    """The largest force and speed soon after the first slip; NaN unless the run covers that time."""
    first = motion.summary["first_slip_time"]
    if not first + START_UP <= motion.time[-1]:
        return dict.fromkeys(START, np.nan)
    soon = slice(*np.searchsorted(motion.time, [first, first + START_UP]))
    peaks = (np.abs(of[soon]).max() for of in (motion.normal_force, motion.slip_velocity))
    return dict(zip(START, peaks, strict=True))


def periods(point: xr.Dataset) -> tuple[int, int, int]:
    """Indices in the window: begin and end of the two periods shown, from a stick on, and end of the first.

    Periods differ. Of those with all four phases, if there are any, the first is the one in which the displacement
    of P1 is closest to that of P2.
    """
    elapsed, frequency, state = point["elapsed"].values, float(point["dominant_frequency"]), point["state"].values
    period = round(1.0 / (frequency * (elapsed[1] - elapsed[0]))) if np.isfinite(frequency) else len(elapsed)
    rest = len(elapsed) - PERIODS * period
    if rest <= 0:
        return 0, len(elapsed), min(period, len(elapsed))
    begins = [a for a, b in runs_of_true(state == STICK) if 0 < a <= rest and b - a >= SHORTEST_STICK * period]
    if not begins:
        return 0, PERIODS * period, period
    starts = np.array([a for a in begins if len(main_phases(state[a : a + period])) == 4] or begins)
    displacement = point["slip_displacement"].values
    moved = np.abs(displacement[starts + period] - displacement[starts])
    first = int(starts[np.abs(moved - abs(float(point["V"])) / frequency).argmin()])
    return first, first + PERIODS * period, first + period


def main_phases(state: Array) -> dict[int, tuple[int, int]]:
    """The paper's four phases of a period (stick, slip, separation, slip): the longest run of each."""

    def longest(code: int, begin: int, end: int) -> tuple[int, int] | None:
        runs = [(a + begin, b + begin) for a, b in runs_of_true(state[begin:end] == code)]
        return max(runs, key=lambda part: part[1] - part[0]) if runs else None

    phases = {1: longest(STICK, 0, len(state)), 3: longest(SEPARATION, 0, len(state))}
    if (separation := phases[3]) is not None:
        phases |= {2: longest(SLIP, 0, separation[0]), 4: longest(SLIP, separation[1], len(state))}
    return {number: part for number, part in sorted(phases.items()) if part is not None}
