"""Files of measured signals: CSV, WAV, universal files (data set 58), MATLAB. Nothing in them is executed."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.structure_files import reading, universal_file
from studies import spec
from studies.results import expanded
from studies.units import convert
from sweeps import InputError

Array = NDArray[Any]

# Names of times and of a sampling rate; a head like "v_B [mm/s]"; decimal commas between blanks.
TIME, RATE = (re.compile(text, re.I) for text in ("t|times?|elapsed|zeit|temps", "fs|rate|sample_?rate"))
HEAD = re.compile(r"\s*(.*?)\s*(?:[\[(](.*)[\])])?\s*")
COMMAS = re.compile(r"\s*\S*\d,\d\S*(\s+\S*\d,\d\S*)+")
# A signal is clipped where so many times more values are the extreme one than the next: of a rounded sine 2.4.
CLIPPED = 4


@dataclass(frozen=True, eq=False)
class Signal:
    """One channel: its values (n,) in `unit`, and its rate, Hz, or the times of its values, s."""

    name: str
    values: Array
    unit: str = ""
    rate: float | None = None
    times: Array | None = None


def read(path: str | Path, unit: str | None, rate: float | str | None, channel: int | str | None) -> Signal:
    """Read one channel of a file with its unit and rate; an `InputError` says what is wrong or missing."""
    if (reader := READERS.get((file := expanded(path)).suffix.lower())) is None:
        raise InputError(f"{path}: its name must end in one of {', '.join(READERS)}")
    with reading(path):
        every = dict(enumerate(reader(file), 1))
    chosen = [one for k, one in every.items() if channel is None or str(channel) in (one.name, str(k))]
    if len(chosen) != 1:
        has = ", ".join(str(k) if one.name == str(k) else f"{k} ({one.name})" for k, one in every.items())
        raise InputError(f"channel = {channel}: {path} has {has or 'no signal'}; give one of these")
    (signal,), factor = chosen, 1.0
    if found := spec.QUANTITY.fullmatch(unit or ""):
        factor, unit = float(found[1]), found[2]
    if re.search(r"\bdB", unit := unit or signal.unit, re.I) or not unit:
        wrong = "a level has no phase; record the signal itself, in a linear unit" if unit else "the file has none"
        raise InputError(f"unit = {unit or None}: {wrong}: mm/s, or 50mm/s for what 1 in the file is")
    rate = spec.one(rate, "rate", "Hz") if isinstance(rate, str) else rate or signal.rate
    if rate is None and signal.times is None:
        raise InputError(f"rate = None: {path} has no rate and no column of times; give it, such as 50kHz")
    with reading(f"{path}, channel {signal.name}"):
        values = factor * _checked(np.asarray(signal.values, dtype=float))
        rate = _rate_of(signal.times) if rate is None and signal.times is not None else rate
    if not (rate and 0.0 < rate < np.inf):
        raise InputError(f"rate = {rate}: it must be above 0 Hz; for example 50kHz")
    return replace(signal, values=values, unit=unit, rate=rate)


def _checked(values: Array) -> Array:
    """Values without gaps, that change, and are not clipped."""
    if len(lost := np.flatnonzero(~np.isfinite(values))):
        raise InputError(f"it has {len(lost)} gaps, the first at sample {lost[0] + 1}; cut out a part without")
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
    """The rate of even times, s, which may be rounded to half a step."""
    steps, step = np.diff(times), (times[-1] - times[0]) / (len(times) - 1)
    usual, even = abs(np.median(steps)), np.abs(times - times[0] - step * np.arange(len(times))) <= step
    odd = ~((np.abs(steps - usual) <= 0.5001 * usual) & even[1:])
    if odd.any():
        k = int(np.argmax(odd))
        text = f"{times[k]:.9g} s is followed by {times[k + 1]:.9g} s"
        raise InputError(f"its times are not even: {text}; cut out a part without gaps, or give its rate")
    return float(1.0 / step)


def _channels(columns: list[Signal], rate: float | None = None) -> list[Signal]:
    """The columns of a table with their times or rate."""
    times = next((each for each in columns if TIME.fullmatch(each.name)), None)
    seconds = None if times is None else convert(1.0, times.unit or "s", "s") * times.values
    return [replace(each, rate=rate, times=seconds) for each in columns if each is not times]


def _text(file: Path) -> list[Signal]:
    """Columns of numbers, and their names above; separators are tabs, semicolons, commas or blanks."""
    import pandas as pd

    lines = [line.strip(" ") for line in file.read_text("utf-8-sig", errors="replace").rstrip().splitlines()]
    last = lines[-1] if lines else ""
    between = next((mark for mark in "\t;," if mark in last and not COMMAS.fullmatch(last)), r"\s+")
    decimal = "," if between != "," and "," in last else "."
    fields = [[part.strip(' "') for part in re.split(between, line)] for line in lines]
    number = re.compile(rf"{spec.NUMBER}|nan|".replace(r"\.", re.escape(decimal)), re.I)
    rows = (k for k, row in enumerate(fields) if any(row) and all(map(number.fullmatch, row)))
    if (first := next(rows, None)) is None:
        raise InputError("it has no line of numbers")
    named = first > 0 and len(fields[first - 1]) == len(fields[first])
    heads = [HEAD.fullmatch(text) for text in fields[first - 1]] if named else []
    how: dict[str, Any] = {"sep": between, "decimal": decimal, "header": None, "skip_blank_lines": False}
    table = pd.read_csv(StringIO("\n".join(lines[first:])), dtype=float, **how).to_numpy().T
    names = [(head[1], head[2] or "") for head in heads if head] or [(str(k + 1), "") for k in range(len(table))]
    steps = np.diff(table[0])
    if not named and len(table) > 1 and np.all(steps > 0.0) and np.ptp(steps) < steps.mean():
        names[0] = ("t", "s")
    return _channels([Signal(name, values, unit) for (name, unit), values in zip(names, table, strict=True)])


def _wav(file: Path) -> Iterator[Signal]:
    """Channels in units of the full scale: 1 for floats, the largest magnitude for whole numbers."""
    from scipy.io import wavfile

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks of notes
        rate, values = wavfile.read(file)
    zero, kind = (128.0 if values.dtype.kind == "u" else 0.0), values.dtype
    # 24 bits are the upper ones of 32.
    scale = 1.0 if kind.kind == "f" else 2.0 ** (8 * kind.itemsize - 1)
    for k, column in enumerate(values.reshape(len(values), -1).T, 1):
        yield Signal(str(k), (column - zero) / scale, "full scale", float(rate))


def _universal(file: Path) -> Iterator[Signal]:
    """Time responses, function type 1 of data sets 58, ASCII or binary."""
    content, kinds = universal_file(file)
    for one in (content.read_sets(int(place)) for place in np.flatnonzero(kinds == 58)):
        if one["func_type"] in (0, 1) and not np.iscomplexobj(one["data"]):
            name, unit = (one[key].strip().replace("NONE", "") for key in ("id1", "ordinate_axis_units_lab"))
            even = one["abscissa_spacing"] == 1
            rate, times = (1.0 / one["abscissa_inc"], None) if even else (None, one["x"])
            yield Signal(name or f"node {one['rsp_node']}, {one['rsp_dir']}", one["data"], unit, rate, times)


def _matlab(file: Path) -> list[Signal]:
    """Vectors, and the columns of matrices; a number fs, rate or sample_rate is the rate."""
    from scipy.io import loadmat

    found = {k: np.asarray(v) for k, v in loadmat(file).items() if np.ndim(v) == 2 and v.dtype.kind in "iuf"}
    rate = next((float(v.item()) for k, v in found.items() if v.size == 1 and RATE.fullmatch(k)), None)
    tables = {k: v if v.shape[0] >= v.shape[1] else v.T for k, v in found.items() if v.size > 1}
    both = [(name, table.shape[1] > 1, k, each) for name, table in tables.items() for k, each in enumerate(table.T, 1)]
    return _channels([Signal(f"{name} {k}" if many else name, each) for name, many, k, each in both], rate)


READERS: dict[str, Any] = dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".asc"), _text)
READERS |= dict.fromkeys((".uff", ".unv"), _universal) | {".wav": _wav, ".mat": _matlab}
