"""Measured signals: readers of their files, and statistics as of the velocity of B in a run.

Files are CSV, WAV, universal files (data set 58) and MATLAB; nothing in them is executed.

The state of the contact is not measured. Quiet spells take the place of long sticks: in them the root mean square
over PERIODS periods of the main frequency, of the signal less its mean over a period of the band's lower end,
stays below QUIET of its 99 % quantile for at least LEAST periods. Slip begins before a vibration has grown and
ends before its ringing has decayed, so quiet spells and sticks differ. Spectra of the vibration include MARGIN
samples of the neighbouring spells, since tapers would otherwise cut off its beginning.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import io, ndimage
from scipy import signal as filters

from fivcore import InputError, observe, structure_files
from studies.answering.results import expanded
from studies.declaring import spec
from studies.declaring.units import UnitError, convert
from studies.motion import series

if TYPE_CHECKING:
    pass

Array = NDArray[Any]

# Names of times and of a sampling rate; a head like "v_B [mm/s]"; numbers with decimal commas between blanks.
TIME, RATE = (re.compile(text, re.I) for text in ("t|times?|elapsed|zeit|temps", "fs|rate|sample_?rate"))
HEAD, COMMAS = re.compile(r"(.*?) *(?:[\[(]([^\[(]*)[\])])?"), re.compile(r"\S*\d,\d\S*(\s+\S*\d,\d\S*)+")
# A signal is clipped where so many times more values are the extreme one than the next: of a rounded sine 2.4.
CLIPPED = 4
PERIODS, QUIET, LEAST, MARGIN = 4.0, 0.2, 20.0, observe.WINDOW // 4
# Least samples in a period of the band's upper end: those of a run at 10 kHz.
SAMPLES = 5.0
# Largest number of spectral lines, how far they stand out, and lie below the main one, dB.
LINES, PROMINENCE, DEPTH = 8, 10.0, 60.0


@dataclass(frozen=True, eq=False)
class Signal:
    """One channel: its values (n,) in `unit`, and its rate, Hz, or the times of its values, s."""

    name: str
    values: Array
    unit: str = ""
    rate: float = 0.0
    times: Array | None = None


def read(path: str | Path, unit: str | None, rate: float | str | None, channel: int | str | None) -> Signal:
    """Read one channel of a file with its unit and rate; an `InputError` says what is wrong or missing."""
    if (reader := READERS.get((file := expanded(path)).suffix.lower())) is None:
        raise InputError(f"{path}: its name must end in one of {', '.join(READERS)}")
    with structure_files.reading(path):
        every: dict[int, Signal] = dict(enumerate(reader(file), 1))
    chosen = [one for k, one in every.items() if channel is None or str(channel) in (one.name, str(k))]
    if len(chosen) != 1:
        has = ", ".join(f"{k} ({one.name})" for k, one in every.items()) or "no signal"
        wrong = "channel missing" if channel is None else f"channel = {channel}"
        raise InputError(f"{wrong}: {path} has {has}; give one of these, by number or name")
    (signal,), factor = chosen, 1.0
    if (found := spec.QUANTITY.fullmatch(unit or "")) and found[2]:
        factor, unit = float(found[1]), found[2]
    if not (unit := unit or signal.unit):
        raise InputError(f"unit missing: {path} names none; give mm/s, or 50mm/s if 1 in the file is 50 mm/s")
    if re.search(r"\bdB", unit, re.I):
        raise InputError(f"unit = {unit}: a level has no phase; record the signal itself, in a unit like mm/s")
    hertz = spec.one(rate, "rate", "Hz") if isinstance(rate, str) else rate
    if hertz is not None and not 0.0 < hertz < np.inf:
        raise InputError(f"rate = {rate}: it must be above 0 Hz, such as 50kHz")
    if not (hertz := hertz or signal.rate) and signal.times is None:
        raise InputError(f"rate missing: {path} has no rate and no times; give it in Hz, such as 50kHz")
    with structure_files.reading(f"{path}, channel {signal.name}"):
        values = factor * _checked(np.asarray(signal.values, dtype=float))
        return replace(signal, values=values, unit=unit, rate=hertz or _rate_of(np.asarray(signal.times)))


def _checked(values: Array) -> Array:
    """Check that values have no gaps, are not constant, and are not clipped."""
    if len(lost := np.flatnonzero(~np.isfinite(values))):
        text = f"{len(lost)} of {len(values)} samples are missing, first number {lost[0] + 1}"
        raise InputError(f"{text}; cut out a part without gaps")
    if len(values) < 2:
        raise InputError(f"it has less than two samples; it must have {observe.WINDOW} or more")
    if np.ptp(values) <= 1e-12 * np.abs(values).max(initial=0.0):
        raise InputError(f"it is constant, {values[0]:g}; choose a channel that moves")
    for extreme in (values.max(), values.min()):
        at, distance = values == extreme, np.abs(values - extreme)
        following = np.count_nonzero(distance == distance[~at].min())
        if (at[1:] & at[:-1]).any() and at.sum() > CLIPPED * following:
            text = f"{at.sum()} of {len(at)} values are {extreme:g}, also in a row"
            raise InputError(f"it is clipped: {text}; record it with a larger range")
    return values


def _rate_of(times: Array) -> float:
    """The rate of evenly spaced times, s, which may be rounded to half a step."""
    steps, step = np.diff(times), (times[-1] - times[0]) / (len(times) - 1)
    usual, away = abs(np.median(steps)), np.abs(np.diff(times - step * np.arange(len(times))).cumsum())
    odd = ~(np.abs(steps - usual) <= 0.5001 * usual)
    if (odd := odd if odd.any() else away > step).any():
        k = int(np.argmax(odd))
        text = f"its times are not even: {times[k]:.9g} s is followed by {times[k + 1]:.9g} s"
        raise InputError(f"{text}; cut out a part without gaps, or give its rate")
    return float(1.0 / step)


def _table(columns: list[Signal], rate: float = 0.0) -> list[Signal]:
    """The channels of a table: its columns with their times or rate."""
    times = next((each for each in columns if TIME.fullmatch(each.name)), None)
    seconds = None if times is None else convert(1.0, times.unit or "s", "s") * times.values
    return [replace(each, rate=rate, times=seconds) for each in columns if each is not times]


def _text(file: Path) -> list[Signal]:
    """Columns of numbers, and their names above; separators are tabs, semicolons, commas or blanks."""
    lines = [line.strip(" ") for line in file.read_text("utf-8-sig", errors="replace").rstrip().splitlines()]
    last = lines[-1] if lines else ""
    between = next((mark for mark in "\t;," if mark in last and not COMMAS.fullmatch(last)), r"\s+")
    decimal = "," if between != "," and "," in last else "."
    number = re.compile(f"{spec.NUMBER}|nan|".replace(r"\.", re.escape(decimal)), re.I)

    def fields(line: str) -> list[str]:
        return [part.strip(' "') for part in re.split(between, line)]

    rows = (k for k, line in enumerate(lines) if line and all(map(number.fullmatch, fields(line))))
    if (first := next(rows, None)) is None:
        raise InputError("it has no line of numbers")
    how: Any = {"sep": between, "decimal": decimal, "header": None, "skip_blank_lines": False}
    table = pd.read_csv(StringIO("\n".join(lines[first:])), dtype=float, **how).to_numpy().T
    if not first or len(names := fields(lines[first - 1])) != len(table):
        names, steps = [str(k) for k in range(1, len(table) + 1)], np.diff(table[0])
        if len(table) > 1 and steps.size and steps.min() > 0.0 and np.ptp(steps) < steps.mean():
            names[0] = "t"
    heads = [HEAD.fullmatch(name) for name in names]
    return _table([Signal(h[1], v, h[2] or "") for h, v in zip(heads, table, strict=True) if h])


def _wav(file: Path) -> Iterator[Signal]:
    """Channels in units of the full scale, which is 1 for floats and the largest magnitude for integers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", io.wavfile.WavFileWarning)  # chunks of notes
        rate, values = io.wavfile.read(file)
    kind, size = values.dtype.kind, values.dtype.itemsize
    # 24 bits are the upper ones of 32; 8 bits alone have no sign.
    zero, scale = 128.0 * (kind == "u"), 1.0 if kind == "f" else 2.0 ** (8 * size - 1)
    for k, column in enumerate(values.reshape(len(values), -1).T, 1):
        yield Signal(str(k), (column - zero) / scale, "full scale", float(rate))


def _universal(file: Path) -> Iterator[Signal]:
    """Time responses, function type 1 of data sets 58, ASCII or binary."""
    content, kinds = structure_files.universal_file(file)
    for one in (content.read_sets(int(place)) for place in np.flatnonzero(kinds == 58)):
        if one["func_type"] in (0, 1) and not np.iscomplexobj(one["data"]):
            name, unit = (one[key].strip().replace("NONE", "") for key in ("id1", "ordinate_axis_units_lab"))
            rate = 1.0 / one["abscissa_inc"] if one["abscissa_spacing"] == 1 else 0.0
            yield Signal(name or f"node {one['rsp_node']}, {one['rsp_dir']}", one["data"], unit, rate, one["x"])


def _matlab(file: Path) -> list[Signal]:
    """Vectors, and the columns of matrices; a number fs, rate or sample_rate is the rate."""
    found = {k: np.asarray(v) for k, v in io.loadmat(file).items() if np.ndim(v) == 2 and v.dtype.kind in "iuf"}
    rates = [float(v.item()) for k, v in found.items() if v.size == 1 and RATE.fullmatch(k)]
    tables = {k: v if v.shape[0] >= v.shape[1] else v.T for k, v in found.items() if v.size > 1}
    return _table([Signal(k, column) for k, table in tables.items() for column in table.T], *rates[:1])


READERS: dict[str, Any] = dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".asc"), _text)
READERS |= dict.fromkeys((".uff", ".unv"), _universal) | {".wav": _wav, ".mat": _matlab}


def statistics(signal: Signal, band: tuple[float, float]) -> dict[str, Any]:
    """Statistics of a signal; see `studies.measure`."""
    every = max(int(signal.rate / (SAMPLES * band[1])), 1)
    values, rate = signal.values, signal.rate / every
    values = filters.resample_poly(values, 1, every, padtype="line") if every > 1 else values
    if len(values) < observe.WINDOW:
        text = f"{signal.name} has {len(values)} samples at {rate:g} Hz"
        raise InputError(f"{text}; it must have {observe.WINDOW}: record {observe.WINDOW / rate:.3g} s or more")
    if not 0.0 < band[0] < min(band[1], 0.5 * rate):
        raise InputError(f"band = {band}: it must lie between 0 and half the rate, {rate / 2:g} Hz")
    quiet = quiet_spells(values, rate, band)
    # Half a sample before, so that rounding of the rate moves no sample across an edge.
    inner = quiet + (np.array([MARGIN, -MARGIN]) - 0.5) / rate
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
        **{"mean_quiet_time_se": errors["mean_stick_time"], "quiet_frequency": observer.stuck.peak()},
        **{"quiet_starts": spells[:, 0], "quiet_times": lengths},
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
    level = series.decibels(power / max(power.max(), 1e-300))
    tops, _ = filters.find_peaks(level, prominence=PROMINENCE)
    tops = tops[np.argsort(-level[tops], kind="stable")][:LINES]
    tops = tops[level[tops] >= level[tops].max(initial=-np.inf) - DEPTH]
    found = [observer.moving.peak((frequency[k], frequency[k])) for k in tops]
    return np.array(found), level[tops] - level[tops[:1]]


def velocity(signal: Signal) -> Signal:
    """The signal in m/s, the unit of runs; an `InputError` if it is not a velocity."""
    try:
        return replace(signal, values=convert(1.0, signal.unit, "m s-1", "what is drawn") * signal.values)
    except UnitError as problem:
        raise InputError(f"unit = {signal.unit}: {problem}; nothing is integrated") from None
