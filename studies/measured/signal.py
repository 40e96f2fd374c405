"""Statistics of one measured signal, by the observer that looks at the velocity of B of a run.

The contact is unknown here. In place of a run's long sticks stand quiet spells: the root mean square over PERIODS
periods of the main frequency, of the signal less its mean over a period of the band's lower end, stays below QUIET
of its 99 % quantile for at least LEAST periods. Slip begins before a vibration has grown and ends before its
ringing has decayed, so they are not the sticks. For spectra, what vibrates reaches MARGIN samples into them, or
tapers would cut off where it begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy import signal as filters

from fivcore import checks
from fivcore.transient import observe
from studies.measured.files import Signal
from studies.motion import series
from studies.plotting import figures
from studies.units import UnitError, convert
from sweeps import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[Any]

PERIODS, QUIET, LEAST, MARGIN = 4.0, 0.2, 20.0, observe.WINDOW // 4
# Least samples in a period of the band's upper end: those of a run at 10 kHz.
SAMPLES = 5.0
# Largest number of spectral lines, how far they stand out, and lie below the main one, dB.
LINES, PROMINENCE, DEPTH = 8, 10.0, 60.0


def statistics(signal: Signal, band: tuple[float, float], start: float) -> dict[str, Any]:
    """Figures of a signal from `start`, s, on; see `studies.measure`."""
    checks.between("start", start, 0.0, len(signal.values) / signal.rate, "s, within the signal")
    every = max(int(signal.rate / (SAMPLES * band[1])), 1)
    values, rate = signal.values[int(np.ceil(start * signal.rate)) :], signal.rate / every
    values = filters.resample_poly(values, 1, every, padtype="line") if every > 1 else values
    if len(values) < observe.WINDOW:
        text = f"{signal.name} has {len(values)} samples at {rate:g} Hz from start = {start:g} s on"
        raise InputError(f"{text}; it must have {observe.WINDOW}: record {observe.WINDOW / rate:.3g} s or more")
    if not 0.0 < band[0] < min(band[1], 0.5 * rate):
        raise InputError(f"band = {band}: it must lie between 0 and half the rate, {rate / 2:g} Hz")
    quiet = quiet_spells(values, rate, band)
    inner = quiet + np.array([MARGIN, -MARGIN]) / rate
    observer = observe.observed(values, rate, inner[inner[:, 0] < inner[:, 1]], band)
    duration, dominant = len(values) / rate, observer.moving.peak()
    # Those that begin and end within the signal.
    spells = quiet[(quiet[:, 0] > 0.0) & (quiet[:, 1] < duration)]
    lengths, cycle = spells[:, 1] - spells[:, 0], duration / (len(spells) + 1) if len(spells) else 0.0
    errors = observe.standard_errors(observer, observe.degrees_of_freedom(duration, cycle), lengths)
    frequencies, levels = lines(observer)
    rms = "signal_rms"
    with suppress(InputError):
        velocity(signal)
        rms = "velocity_rms"
    return {
        **{"channel": signal.name, "unit": signal.unit, "rate": signal.rate, "analysed_rate": rate},
        **{"duration": duration, "dominant_frequency": dominant, "periodicity": observer.periodicity(dominant)},
        **{rms: observer.rms, f"{rms}_se": errors["velocity_rms"]},
        "quiet_fraction": float(np.diff(quiet).sum()) / duration,
        "mean_quiet_time": float(lengths.mean()) if len(lengths) else float("nan"),
        "mean_quiet_time_se": errors["mean_stick_time"],
        "quiet_frequency": observer.stuck.peak(),
        **{"quiet_starts": start + spells[:, 0], "quiet_times": lengths},
        **{"line_frequencies": frequencies, "line_levels": levels},
    }


def quiet_spells(values: Array, rate: float, band: tuple[float, float]) -> Array:
    """Begin and end of each quiet spell, (k, 2), s; none without a main frequency."""
    period = 1.0 / observe.Correlation([values], rate, band).peak()
    moving = values - ndimage.uniform_filter1d(values, max(round(rate / band[0]), 1))
    power = ndimage.uniform_filter1d(moving**2, round(PERIODS * rate * period) if period > 0.0 else 1)
    spells = np.array(series.runs_of_true(power < QUIET**2 * np.quantile(power, 0.99))).reshape(-1, 2) / rate
    return np.asarray(spells[spells[:, 1] - spells[:, 0] >= LEAST * period])


def lines(observer: observe.Observer) -> tuple[Array, Array]:
    """Frequencies of the spectral lines outside quiet spells, Hz, the strongest first, and levels below it, dB."""
    frequency, power = observer.moving.frequency, observer.moving.power
    level = figures.decibels(power / max(power.max(), 1e-300))
    tops, _ = filters.find_peaks(level, prominence=PROMINENCE)
    tops = tops[np.argsort(-level[tops], kind="stable")][:LINES]
    tops = tops[level[tops] >= level[tops].max(initial=-np.inf) - DEPTH]
    found = [observer.moving.peak((frequency[k], frequency[k])) for k in tops]
    return np.array(found), level[tops] - level[tops[:1]]


def velocity(signal: Signal) -> Signal:
    """The signal in m/s, as runs are drawn; an `InputError` if it is no velocity."""
    try:
        return replace(signal, values=convert(1.0, signal.unit, "m s-1", "what is drawn") * signal.values)
    except UnitError as problem:
        raise InputError(f"unit = {signal.unit}: {problem}; nothing is integrated") from None


def draw(panels: Sequence[Axes], signal: Signal) -> None:
    """A measured `velocity` in the last row of panels, mm/s, and its spectrum in all of the right column."""
    time, frequency = np.arange(len(signal.values)) / signal.rate, series.frequencies(signal.rate).values / 1e3
    power = figures.decibels(series.spectrum(signal.values, np.ones(len(time), dtype=bool), signal.rate))
    panels[-2].set_title(f"measured: {signal.name}", loc="left")
    panels[-2].set_ylabel("velocity / (mm/s)")
    figures.trace(panels[-2], time, 1e3 * signal.values, color=figures.ORANGE)
    for right in panels[1::2]:
        right.plot(frequency, power, color=figures.ORANGE, linewidth=0.8, label="measured")
