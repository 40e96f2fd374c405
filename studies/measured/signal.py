"""What can be said of one signal, by the observer that looks at the velocity of B of a run.

The contact is unknown here. In place of a run's long sticks stand quiet spells: the root mean square over PERIODS
periods of the main frequency, of the signal less its mean over a period of the band's lower end, stays below QUIET
of its 99 % quantile for at least LEAST periods. Slip begins before a vibration has grown and ends before its ringing
has decayed, so they are not the sticks. For spectra, what vibrates reaches MARGIN samples into them, or tapers would
cut off where it begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fivcore import checks
from fivcore.transient.observe import (
    WINDOW,
    Correlation,
    Observer,
    degrees_of_freedom,
    observed,
    peak_of,
    standard_errors,
)
from studies.measured.files import Signal
from studies.motion import series
from studies.plotting import figures
from studies.units import UnitError, convert
from sweeps import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[Any]

PERIODS, QUIET, LEAST, MARGIN = 4.0, 0.2, 20.0, WINDOW // 4
# Least samples in a period of the band's upper end: those of a run at 10 kHz.
SAMPLES = 5.0
# Largest number of spectral lines, how far they stand out and lie below the main one, dB.
LINES, PROMINENCE, DEPTH = 8, 10.0, 60.0


def statistics(signal: Signal, band: tuple[float, float], start: float = 0.0) -> dict[str, Any]:
    """Figures of a signal from `start`, s, on; see `studies.measure`."""
    given = float(signal.rate or 0.0)
    checks.between("start", start, 0.0, len(signal.values) / given, "s within the signal")
    every = max(int(given / (SAMPLES * band[1])), 1)
    values, rate = signal.values[int(np.ceil(start * given)) :], given / every
    if every > 1:
        values = scipy.signal.resample_poly(values, 1, every, padtype="line")
    if len(values) < WINDOW:
        text = f"{signal.name} has {len(values)} samples at {rate:g} Hz from start = {start:g} s on"
        raise InputError(f"{text}; it must have {WINDOW}: record {WINDOW / rate:.3g} s or more")
    if not 0.0 < band[0] < min(band[1], 0.5 * rate):
        raise InputError(f"band = {band[0]:g}, {band[1]:g}: it must lie between 0 and half the rate, {rate / 2:g} Hz")
    quiet = quiet_spells(values, rate, band)
    inner = quiet + np.array([MARGIN, -MARGIN]) / rate
    observer, duration = observed(values, rate, inner[inner[:, 0] < inner[:, 1]], band), len(values) / rate
    # Those that begin and end within the signal.
    spells = quiet[(quiet[:, 0] > 0.0) & (quiet[:, 1] < duration)]
    lengths, cycle = spells[:, 1] - spells[:, 0], duration / (len(spells) + 1) if len(spells) else 0.0
    errors = standard_errors(observer, degrees_of_freedom(duration, cycle), lengths)
    dominant, rms = observer.moving.peak(), "signal_rms"
    with suppress(InputError):
        velocity(signal)
        rms = "velocity_rms"
    frequencies, levels = lines(observer, band)
    return {
        "channel": signal.name,
        "unit": signal.unit,
        "rate": given,
        "analysed_rate": rate,
        "duration": duration,
        "band": band,
        "dominant_frequency": dominant,
        "periodicity": observer.periodicity(dominant),
        rms: observer.rms,
        f"{rms}_se": errors["velocity_rms"],
        "line_frequencies": frequencies,
        "line_levels": levels,
        "quiet_fraction": float(np.diff(quiet).sum()) / duration,
        "quiet_starts": start + spells[:, 0],
        "quiet_times": lengths,
        "mean_quiet_time": float(lengths.mean()) if len(lengths) else float("nan"),
        "mean_quiet_time_se": errors["mean_stick_time"],
        "quiet_frequency": observer.stuck.peak(),
    }


def quiet_spells(values: Array, rate: float, band: tuple[float, float]) -> Array:
    """Begin and end of each quiet spell, (k, 2), s; none without a main frequency."""
    whole = Correlation(rate, band)
    whole.add(values)
    if np.isnan(main := whole.peak()):
        return np.empty((0, 2))
    moving = values - scipy.ndimage.uniform_filter1d(values, max(round(rate / band[0]), 1))
    power = scipy.ndimage.uniform_filter1d(moving**2, max(round(PERIODS * rate / main), 1))
    spells = np.array(series.runs_of_true(power < QUIET**2 * np.quantile(power, 0.99))).reshape(-1, 2) / rate
    return np.asarray(spells[spells[:, 1] - spells[:, 0] >= LEAST / main])


def lines(observer: Observer, band: tuple[float, float]) -> tuple[Array, Array]:
    """Frequencies of the spectral lines outside quiet spells, Hz, the strongest first, and levels below it, dB."""
    frequency, power = observer.moving.frequency, observer.moving.power
    level = figures.decibels(power / max(power.max(), 1e-300))
    tops, _ = scipy.signal.find_peaks(level, prominence=PROMINENCE)
    tops = tops[(frequency[tops] >= band[0]) & (frequency[tops] <= band[1])]
    tops = tops[np.argsort(-level[tops], kind="stable")][:LINES]
    tops = tops[level[tops] >= level[tops[:1]].max(initial=-np.inf) - DEPTH]
    found = [peak_of(frequency, power, (frequency[k], frequency[k])) for k in tops]
    return np.array(found), level[tops] - level[tops[:1]]


def velocity(signal: Signal) -> Signal:
    """The signal in m/s, to draw it beside runs; an `InputError` if it is no velocity."""
    try:
        return replace(signal, values=convert(1.0, signal.unit, "m s-1", "what is drawn") * signal.values)
    except UnitError as problem:
        raise InputError(f"unit = {signal.unit}: {problem}; nothing is integrated") from None


def draw(panels: Sequence[Axes], signal: Signal) -> None:
    """A measured `velocity` in the last row of panels, mm/s, and its spectrum in all of the right column."""
    rate = float(signal.rate or 0.0)
    panels[-2].set_title(f"measured: {signal.name}", loc="left")
    panels[-2].set_ylabel("velocity / (mm/s)")
    figures.trace(panels[-2], np.arange(len(signal.values)) / rate, 1e3 * signal.values, color=figures.ORANGE)
    power = figures.decibels(series.spectrum(signal.values, np.ones(len(signal.values), dtype=bool), rate))
    for right in panels[1::2]:
        right.plot(series.frequencies(rate).values / 1e3, power, color=figures.ORANGE, linewidth=0.8, label="measured")
