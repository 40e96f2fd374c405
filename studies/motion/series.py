"""Series of the motion at even times, their spectra, and series that are recorded on request.

A recorded series holds samples, not averages: at each time the value on the line between two steps of the solver.
Frequencies above half the sampling rate fold into those below; spikes of microseconds may fall between samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fivcore import LONG_STICK, Scene, Transient, checks, loading_time
from studies.motion import run as runs
from studies.motion.jobs import Job, outcomes
from sweeps import Axis, Variable

Array = NDArray[Any]

# Windows of a spectrum, s; half of one is the shortest run that has one.
WINDOW = 25e-3
# The motion is recorded so much faster than kept: B rings far above the band, which must not fold into it.
OVERSAMPLING = 8
# Of one series of one scene.
MOST_SAMPLES = 1_000_000
# Of recorded series: sampling rate, Hz, and duration of the run where none is set, s.
SAMPLE_RATE, DURATION = 50e3, 1.0

SERIES = {
    "velocity_B": Variable("m s-1", "velocity of B along x, sampled", ("elapsed",), "float32", 4),
    "normal_force": Variable("N", "normal force on P1, sampled", ("elapsed",), "float32", 4),
    "tangential_force": Variable("N", "force along x on P1, sampled", ("elapsed",), "float32", 4),
    "slip_velocity": Variable(
        "m s-1", "velocity of P1's surface relative to P2's, sampled", ("elapsed",), "float32", 4
    ),
    "state": Variable(
        "1", "state of the contact, sampled", ("elapsed",), "int8", flags=dict(enumerate(runs.STATES))
    ),
}
# Of each of several contacts.
SERIES |= {
    f"contact_{name}": replace(each, long_name=f"{each.long_name}, of each contact", dims=("elapsed", "contact"))
    for name, each in SERIES.items()
    if name != "velocity_B"
}
# What multiplies the series of a normalised scene.
FACTORS = {
    name: "load" if name.endswith("normal_force") else "along" for name in SERIES if not name.endswith("state")
}


def even_times(duration: float, sample_rate: float) -> Axis:
    """The times of series kept from the start of the drive, `elapsed`."""
    checks.between("duration", duration, 1e-6, 1e6, "s")
    most = MOST_SAMPLES / duration
    checks.between("sample_rate", sample_rate, 1.0 / duration, most * (1.0 + 1e-9), f"Hz over {duration:g} s")
    count = int(duration * sample_rate * (1.0 + 1e-12))
    return Axis(np.arange(count) / sample_rate, "s", "time since the drive started")


def coords(*, duration: float, sample_rate: float) -> dict[str, Axis]:
    """The axes of series kept from the start of the drive, and of their spectra."""
    checks.between("sample_rate", sample_rate, 1e3, 1e6, "Hz")
    checks.between("duration", duration, 2.0 * WINDOW, 1e6, "s")
    return {"elapsed": even_times(duration, sample_rate), "frequency": frequencies(sample_rate)}


def kept(run: Transient, record: Sequence[str]) -> dict[str, Any]:
    """The recorded series of a run, in the form in which they are stored."""
    return {
        name: getattr(run, name) if name.endswith("state") else getattr(run, name).astype(np.float32)
        for name in record
    }


def sampling(record: Sequence[str], times: Array | None) -> dict[str, Any]:
    """Options with which `simulate` records series at these times; none if nothing is recorded."""
    names = tuple({name.removeprefix("contact_"): None for name in record})
    return {"record": names, "sample_times": times} if names else {"record": False}


def histories(
    scenes: Sequence[Scene],
    values: Callable[[Transient, Array, Array], dict[str, Any]],
    needed: Sequence[str],
    record: Sequence[str],
    *,
    duration: float,
    sample_rate: float,
    run: Mapping[str, Any],
) -> dict[str, Any]:
    """Velocity of B at even times, the summary and what a study adds, for each scene.

    `values(run, velocity, times)` returns what the study adds, from the series `needed` at every step; those to
    `record` besides come from a second run.
    """
    times = even_times(duration, sample_rate).values
    fine = {"record": tuple(needed), "sample_rate": OVERSAMPLING * sample_rate}
    recordings = [fine, *([sampling(record, times)] if record else [])]

    def point(jobs: Sequence[Job], results: Sequence[Transient]) -> dict[str, Any]:
        even = velocity(results[0], times, sample_rate)
        added = values(results[0], even, times) | kept(results[-1], record)
        return {"velocity_B": even, **added, **runs.summary_of(results[0])}

    return outcomes([[runs.job(scene, duration, run, **each) for each in recordings] for scene in scenes], point)


def frequencies(sample_rate: float) -> Axis:
    """Frequencies of a spectrum: twice as fine as its windows resolve, up to the end of the band."""
    full = np.fft.rfftfreq(2 * _length(sample_rate), 1.0 / sample_rate)
    return Axis(full[full <= runs.BAND], "Hz", "frequency")


def velocity(run: Transient, times: Array, sample_rate: float) -> Array:
    """Velocity of B at even `times`, m/s, without frequencies above half their rate."""
    fine = np.arange(len(times) * OVERSAMPLING) / (sample_rate * OVERSAMPLING)
    even = np.interp(fine, run.time, run.velocity_B)
    return np.asarray(scipy.signal.resample_poly(even, 1, OVERSAMPLING, padtype="line"))


def long_sticks(run: Transient, times: Array) -> NDArray[np.bool_]:
    """Mark the `times` within a long stick begun after the first slip; an unfinished one counts."""
    inside = np.zeros(len(times), dtype=bool)
    first, least = run.summary["first_slip_time"], LONG_STICK * loading_time(run.scene)
    for begin, end in runs_of_true(run.state == runs.STATES.index("stick")):
        start, stop = run.time[begin], run.time[end - 1]
        if start > first and stop - start >= least:
            inside[np.searchsorted(times, start) : np.searchsorted(times, stop)] = True
    return inside


def after_settling(run: Transient, times: Array) -> NDArray[np.bool_]:
    """Mark the `times` that statistics use."""
    first = run.summary["first_slip_time"]
    return np.asarray(times >= (0.0 if np.isnan(first) else first + runs.SETTLING))


def spectrum(series: Array, chosen: NDArray[np.bool_], sample_rate: float) -> Array:
    """Power spectral density of the selected parts of a series, at `frequencies(sample_rate)`.

    The method is Welch's, one-sided, with half overlapping Hann windows. A part shorter than a window counts if it
    has at least an eighth of its length, since a burst between two long sticks can be that short. NaN if no part
    is long enough.
    """
    length = _length(sample_rate)
    total, weight = np.zeros(length + 1), 0.0
    for begin, end in runs_of_true(chosen):
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


def decibels(power: Any) -> Array:
    """A power spectral density in decibels, with a floor far below any motion."""
    return np.asarray(10.0 * np.log10(np.maximum(np.asarray(power, dtype=float), 1e-30)))


def runs_of_true(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of each run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def peak_near(frequency: Array, power: Array, target: float, within: float) -> float:
    """Frequency of the strongest peak within a relative distance of `target`, Hz; NaN if no peak stands out."""
    near = np.flatnonzero(np.abs(frequency - target) <= within * target)  # none for a target that is NaN
    near = near[(near > 0) & (near < len(power) - 1)]
    if not len(near) or not np.all(np.isfinite(power[near])):
        return float("nan")
    top = int(near[np.argmax(power[near])])
    before, middle, after = np.log(np.maximum(power[top - 1 : top + 2].astype(float), 1e-300))
    bend = before - 2.0 * middle + after
    # Half as much again as is usual there: less is the scatter of the estimate.
    around = power[np.abs(frequency - target) <= max(within, 0.08) * target]
    if middle < max(before, after) or bend >= 0.0 or power[top] <= 1.5 * np.median(around):
        return float("nan")
    # The top of the parabola through the logarithms.
    return float(frequency[top] + 0.5 * (before - after) / bend * frequency[1])


def _length(sample_rate: float) -> int:
    return round(WINDOW * sample_rate)
