"""Shared parts of the studies of motion in time: runs in batches, series at even times, and spectra."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import signal

from fivcore import Rig, Scene, Transient, Until, checks
from fivcore.transient.statistics import SETTLING as SETTLING_TIME
from studies import paper
from studies.motion.jobs import Job, check_jobs
from studies.rig import rig_of
from studies.study import Setting
from sweeps import Axis, Variable

Array = NDArray[Any]

METHOD = "fast"
# The paper's spectra end here, Hz.
BAND = 10e3
# Windows of a spectrum, s; half of one is the shortest run that has one.
WINDOW = 25e-3
# The motion is recorded so much faster than kept: B rings far above the band, which must not fold into it.
OVERSAMPLING = 8
# Of one series: a mistyped setting must not fill the memory.
MOST_SAMPLES = 5_000_000
# A long stick lasts at least this share of the first one (`fivcore.simulate`, min_stick).
LONG_STICK = 0.2
# Statistics start this long after the first slip, s.
SETTLING = SETTLING_TIME

# With the published scheme's numerical damping, as the paper's figures are, or the model as given.
PUBLISHED, NONE = DAMPINGS = ("published", "none")

SCENE = ("V", "theta", "mu", "F")
STATES = ("separation", "stick", "slip")
REGIMES = ("undecided", "stuck", "steady sliding", "intermittent", "periodic", "irregular")

SUMMARY = {
    "regime": Variable("1", "regime of the motion", (), "int8", flags=dict(enumerate(REGIMES))),
    "stick_fraction": Variable("1", "share of the time in stick"),
    "slip_fraction": Variable("1", "share of the time in slip"),
    "separation_fraction": Variable("1", "share of the time in separation"),
    "dominant_frequency": Variable("Hz", "dominant frequency of the velocity of B outside long sticks"),
    "stuck_frequency": Variable("Hz", "dominant frequency of the velocity of B within long sticks"),
    "coherence": Variable("1", "autocorrelation of the velocity of B after 20 periods"),
    "velocity_rms": Variable("m s-1", "root mean square of the velocity of B about its mean"),
    "mean_normal_force": Variable("N", "mean normal force"),
    "max_normal_force": Variable("N", "largest normal force"),
    "normal_force_999": Variable("N", "99.9 % quantile of the normal force"),
    "max_slip_speed": Variable("m s-1", "largest slip speed"),
    "slip_speed_999": Variable("m s-1", "99.9 % quantile of the slip speed"),
    "switches_per_second": Variable("s-1", "changes of contact state per second"),
    "first_slip_time": Variable("s", "time of the first slip"),
    "first_separation_time": Variable("s", "time of the first separation"),
    "long_sticks": Variable("1", "number of long sticks after the first slip", (), "int32"),
    "mean_stick_time": Variable("s", "mean duration of the long sticks"),
    "energy_residual": Variable("1", "energy unaccounted for, over that turned over or at hand"),
}
# Statistics of a run that have a standard error, X_se.
ESTIMATED = (
    *(f"{state}_fraction" for state in STATES),
    "velocity_rms", "mean_normal_force", "normal_force_999", "slip_speed_999", "switches_per_second",
    "mean_stick_time",
)  # fmt: skip
SUMMARY |= {
    f"{name}_se": replace(SUMMARY[name], long_name=f"standard error: {SUMMARY[name].long_name}")
    for name in ESTIMATED
}


def run_settings(duration: float, numerical_damping: str = NONE) -> dict[str, Setting]:
    """Settings of a run besides its rig, with the paper's operating point."""
    damping = "published: the published scheme's own damping is added; none: the model as given"
    return {
        "mu": Setting(paper.MU, "1", "coefficient of friction"),
        "F": Setting(paper.LOAD, "N", "load on A"),
        "duration": Setting(duration, "s", "simulated time"),
        "ramp": Setting(1e-3, "s", "time in which P2's clamp reaches its velocity"),
        "cutoff": Setting(0.0, "Hz", "modes above are left to the termination; 0: the method's own"),
        "leap": Setting(1.0, "1", "leap over the quiet part of long sticks; 0: take every step"),
        "numerical_damping": Setting(numerical_damping, "1", damping, DAMPINGS),
    }


def damping(fixed: Mapping[str, Any]) -> str:
    """The numerical damping of a result in words; files without the setting are older than the choice."""
    texts = {PUBLISHED: "with the published scheme's numerical damping", NONE: "without numerical damping"}
    return texts.get(fixed.get("numerical_damping", ""), "numerical damping of an older version")


def shared(settings: Mapping[str, float], rig: Rig, *names: str) -> dict[str, Any]:
    """Constants of every scene of a sweep: the rig, the options of the run, and the settings called `names`."""
    chosen = ("duration", "ramp", "cutoff", "leap", "numerical_damping", *names)
    return {"rig": rig, "method": METHOD} | {name: settings[name] for name in chosen}


def constants(*names: str) -> Callable[[Mapping[str, float]], dict[str, Any]]:
    """`Study.constants` of scenes with one rig: what they have in common, and the settings called `names`."""

    def of(settings: Mapping[str, float]) -> dict[str, Any]:
        rig, _ = rig_of({"theta": paper.THETA, **settings})
        return shared(settings, rig, *names)

    return of


def scenes(points: Mapping[str, Any], fixed: Mapping[str, Any]) -> list[Scene]:
    """One scene for each point; what is no axis is fixed."""
    count = len(next(iter(points.values())))
    every = {name: points[name] if name in points else np.full(count, fixed[name]) for name in SCENE}
    return [Scene(**{name: float(every[name][k]) for name in SCENE}, rig=fixed["rig"]) for k in range(count)]


def job(scene: Scene, fixed: Mapping[str, Any], duration: float | Until | None = None, **recording: Any) -> Job:
    """The run of one scene that the sweep's constants ask for."""
    options = {
        "method": fixed["method"],
        "ramp": fixed["ramp"],
        "cutoff": fixed["cutoff"] or None,
        "settle": fixed.get("settle"),
        "leap": bool(fixed.get("leap", True)),
        "numerical_damping": fixed["numerical_damping"],
    }
    return Job(scene, fixed["duration"] if duration is None else duration, options | recording)


def check(axes: Mapping[str, Axis], fixed: Mapping[str, Any]) -> None:
    """Refuse, before anything is planned, what a study with one axis cannot run.

    A scene whose contact has no unique solution is not refused: its point fails by itself.
    """
    sample_rate = checks.between("sample_rate", fixed["sample_rate"], 1e3, 1e6, "Hz")
    most = MOST_SAMPLES / sample_rate
    checks.between("duration", fixed["duration"], 2.0 * WINDOW, most, f"s, at sample_rate = {sample_rate:g} Hz")
    checks.between("cutoff", fixed["cutoff"], 0.0, 1e12, "Hz")
    every = scenes({name: axis.values for name, axis in axes.items()}, fixed)
    check_jobs([job(every[0], fixed, 1e-6)])


def series_coords(*, duration: float, sample_rate: float, **_: Any) -> dict[str, Axis]:
    """The axes of series kept from the start of the drive, and of their spectra."""
    return {"elapsed": even_times(duration, sample_rate), "frequency": frequencies(sample_rate)}


def extremes(axes: Mapping[str, Axis], rig: Rig, **fixed: float) -> list[Scene]:
    """The scenes of a grid with the least and with the greatest V / F, which the solver must resolve.

    A value of an axis that makes no scene raises `ValueError`.
    """
    every = {name: axes[name].values for name in SCENE if name in axes}
    first = fixed | {name: float(values[0]) for name, values in every.items()}
    for name, values in every.items():
        for value in values:
            Scene(**{**first, name: float(value)}, rig=rig)
    speeds, loads = np.abs(every["V"]), every["F"]
    ends = ((speeds.min(), loads.max()), (speeds.max(), loads.min()))
    return [Scene(**{**first, "V": float(V), "F": float(F)}, rig=rig) for V, F in ends]


def figures_of(run: Transient) -> dict[str, Any]:
    """The summary figures of a run; `SUMMARY` describes those of every study."""
    left_out = ("stick_times", "stick_starts", "censored_sticks", "settled_early", "simulated_time")
    return {name: value for name, value in run.summary.items() if name not in left_out} | {
        "regime": REGIMES.index(run.summary["regime"]),
        "long_sticks": len(run.summary["stick_times"]),
    }


def even_times(duration: float, sample_rate: float) -> Axis:
    """The `elapsed` of series kept from the start of the drive."""
    count = int(duration * sample_rate * (1.0 + 1e-12))
    return Axis(np.arange(count) / sample_rate, "s", "time since the drive started")


def frequencies(sample_rate: float) -> Axis:
    """Frequencies of a spectrum: twice as fine as its windows resolve, up to the end of the band."""
    full = np.fft.rfftfreq(2 * _length(sample_rate), 1.0 / sample_rate)
    return Axis(full[full <= BAND], "Hz", "frequency")


def velocity(run: Transient, times: Array, sample_rate: float) -> Array:
    """Velocity of B at even `times`, m/s, without what lies above half their rate."""
    fine = np.arange(len(times) * OVERSAMPLING) / (sample_rate * OVERSAMPLING)
    even = np.interp(fine, run.time, run.velocity_B)
    return np.asarray(signal.resample_poly(even, 1, OVERSAMPLING, padtype="line"))


def long_sticks(run: Transient, times: Array) -> NDArray[np.bool_]:
    """Which of `times` lie within a long stick begun after the first slip; a running one counts."""
    inside = np.zeros(len(times), dtype=bool)
    first = run.summary["first_slip_time"]
    for begin, end in stretches(run.state == STATES.index("stick")):
        start, stop = run.time[begin], run.time[end - 1]
        if start > first and stop - start >= LONG_STICK * first:
            inside[np.searchsorted(times, start) : np.searchsorted(times, stop)] = True
    return inside


def settled(run: Transient, times: Array) -> NDArray[np.bool_]:
    """Which of `times` count for statistics."""
    first = run.summary["first_slip_time"]
    return np.asarray(times >= (0.0 if np.isnan(first) else first + SETTLING))


def spectrum(series: Array, chosen: NDArray[np.bool_], sample_rate: float) -> Array:
    """Power spectral density of a series in its chosen stretches, at `frequencies(sample_rate)`.

    Welch's, one-sided: Hann windows, half overlapping. A stretch shorter than a window counts with what it has if
    that is an eighth of a window or more; a burst between two long sticks is that short. NaN if there is none.
    """
    length = _length(sample_rate)
    total, weight = np.zeros(length + 1), 0.0
    for begin, end in stretches(chosen):
        size = min(end - begin, length)
        if size < length // 8:
            continue
        hann = np.hanning(size)
        windows = np.lib.stride_tricks.sliding_window_view(series[begin:end], size)[:: max(size // 2, 1)]
        centred = windows - windows.mean(axis=1, keepdims=True)
        total += np.sum(np.abs(np.fft.rfft(centred * hann, 2 * length, axis=1)) ** 2, axis=0)
        weight += len(windows) * float(np.sum(hann**2))
    count = len(frequencies(sample_rate))
    return 2.0 * total[:count] / (weight * sample_rate) if weight else np.full(count, np.nan)


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of every run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def line_near(frequency: Array, power: Array, target: float, within: float = 0.08) -> float:
    """Frequency of the strongest peak within that share of `target`, Hz; NaN if none stands out."""
    near = np.flatnonzero(np.abs(frequency - target) <= within * target)  # none for a target that is NaN
    near = near[(near > 0) & (near < len(power) - 1)]
    if not len(near) or not np.all(np.isfinite(power[near])):
        return float("nan")
    top = int(near[np.argmax(power[near])])
    before, at, after = np.log(np.maximum(power[top - 1 : top + 2].astype(float), 1e-300))
    bend = before - 2.0 * at + after
    # Half as much again as is usual there: less is the scatter of the estimate.
    if at < max(before, after) or bend >= 0.0 or power[top] <= 1.5 * np.median(power[near]):
        return float("nan")
    # The top of the parabola through the logarithms.
    return float(frequency[top] + 0.5 * (before - after) / bend * frequency[1])


def with_flags(dataset: xr.Dataset, **meanings: Sequence[str]) -> xr.Dataset:
    """Say what the whole numbers of derived variables stand for; a computed one has them as its `flags`."""
    for name, words in meanings.items():
        attributes = dataset[name].attrs
        attributes.pop("units", None)
        attributes["flag_values"] = np.arange(len(words), dtype=np.int8)
        attributes["flag_meanings"] = " ".join(word.replace(" ", "_") for word in words)
    return dataset


def some(count: int, most: int) -> list[int]:
    """Which of `count` points a figure shows: all, or `most` of them evenly."""
    return [int(k) for k in np.unique(np.linspace(0, count - 1, min(count, most)).round())]


def of_all(shown: Sequence[int], count: int) -> str:
    """The addition to a title where not all points are shown."""
    return f" ({len(shown)} of {count})" if len(shown) < count else ""


def text(value: Any, digits: int, scale: float = 1.0) -> str:
    """A number for a reader; a dash where there is none."""
    return "-" if np.isnan(value) else f"{scale * float(value):.{digits}f}"


def _length(sample_rate: float) -> int:
    return round(WINDOW * sample_rate)
