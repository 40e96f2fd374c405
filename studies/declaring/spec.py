"""SPEC, the syntax of values on the command line, and the lookup of a number on an axis."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from decimal import Context, Decimal, localcontext
from itertools import accumulate, repeat
from operator import mul
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from studies.declaring.units import UnitError, convert
from sweeps import InputError

FORMS = "0.2 | 1e-3,2e-3,5e-3 | 0:0.5:101 (start:stop:count) | log:1e-4:1e-2:30, in SI or like 2mm/s | 50:80:7mm"
NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
QUANTITY = re.compile(rf"{NUMBER}([A-Za-zµμΩ°%].*?)?\s*", re.ASCII)  # a number and its unit
MOST_VALUES = 10_000_000
# From this ratio of its ends on an axis is logarithmic.
WIDE = 20.0
# How far a number may be from the axis's value nearest to it: this share of that value's distance from its own
# nearest neighbour; on an axis with one value, this share of the value.
OF_SPACING, OF_VALUE = 1e-3, 1e-6
EXACT = Context(prec=40)  # so many digits that no step of a range changes the 15th


def parse(spec: str, name: str, units: str = "") -> NDArray[Any]:
    """The values of SPEC in `units`; an `InputError` names the parameter, SPEC, the reason, and the forms."""
    try:
        if ";" in spec:
            raise InputError("commas separate values, and a point is the decimal sign: 0.5,0.6")
        plain = converted(spec, units, name)
        if ":" in plain:
            return _range(plain.removeprefix("log:").split(":"), logarithmic=plain.startswith("log:"))
        return np.array([finite(part) for part in plain.split(",")])
    except InputError as problem:
        forms = "" if isinstance(problem, UnitError) else f"; the forms are {FORMS}"
        decimal = re.search(r"\d+,\d+", spec) if ":" in spec else None
        hint = f"; a point is the decimal sign: {decimal[0].replace(',', '.')}" if decimal else ""
        # The order of the dimensions of a newton depends on what was converted before.
        text = str(problem).replace("[mass] * [length] / [time] ** 2: N", "a force: 9N or 9")
        raise InputError(f"{name} = {spec!r}: {text}{hint}{forms}") from None


def check_commas(spec: str, name: str, units: str, usual: float, largest: float = np.inf) -> None:
    """Refuse a list that seems to be numbers with decimal commas, 0,25 or 60,5mm, and offer both ways to write it.

    So are two whole numbers without a space if the second begins with 0, is not the larger one, or is above the
    `largest` plausible value; and 0,5 where 0.5 is closer to the `usual` value than 5. A longer list is if its
    numbers do not ascend and its pairs do.
    """
    match = re.fullmatch(r"(-?\d+(?:,\d+)+)([A-Za-zµμΩ°%].*)?", spec.strip(), re.ASCII)
    parts = match[1].split(",") if match else []
    if not match or len(parts) % 2:
        return
    numbers, unit = [float(part) for part in parts], match[2] or ""
    pairs = [f"{whole}.{tenths}" for whole, tenths in zip(parts[::2], parts[1::2], strict=True)]
    ascend, factor = np.all(np.diff(numbers) > 0), convert(1.0, unit, units, name) if unit else 1.0
    led = parts[0] == "-0" or any(len(part) > 1 and part[0] == "0" for part in parts[1::2])
    if len(parts) == 2:
        low, high = (abs(factor * each) for each in (float(pairs[0]), numbers[1]))
        closer = numbers[0] == 0.0 < min(low, usual) and abs(np.log(low / usual)) < np.log(high / usual)
        seems = not ascend or closer or low <= largest < high
    else:
        seems = not ascend and bool(np.all(np.diff([float(pair) for pair in pairs]) > 0))
    if led or seems:
        values = [f"{number:g}" for number in np.unique(numbers)]
        listed = f"; or, for {len(values)} values, '{name}={', '.join(values)}{unit}' with a space"
        raise InputError(
            f"{name} = {spec!r}: a comma separates values, a point is the decimal sign; write"
            f" {name}={','.join(pairs)}{unit}{listed * (len(values) > 1)}"
        )


def one(spec: str, name: str, units: str = "") -> float:
    """The single value of SPEC."""
    values = parse(spec, name, units)
    if len(values) > 1:
        decimal = spec.replace(",", ".") if re.fullmatch(r"[-+]?\d+,\d+\D*", spec.strip()) else ""
        hint = f"; a point is the decimal sign: {decimal}" if decimal else ""
        raise InputError(f"{name} = {spec!r}: it must be one value{hint}")
    return float(values[0])


def listed(spec: str, words: Sequence[str]) -> list[str]:
    """The words of a list with commas; `words` are known ones that may contain commas."""
    parts, entries = spec.split(","), list[str]()
    while parts:
        sizes = (n for n in range(len(parts), 0, -1) if ",".join(parts[:n]).strip() in words)
        size = next(sizes, len(parts))
        entries.append(",".join(parts[:size]).strip())
        parts = parts[size:]
    return entries


def count(spec: str) -> int:
    """The largest number of values that SPEC can have, without creating them; 1 for a text that is no SPEC."""
    if ":" not in spec:
        return spec.count(",") + 1
    digits = re.match(r"\s*\d{1,18}", spec.rpartition(":")[2], re.ASCII)
    return max(int(digits[0]), 1) if digits else 1


def converted(spec: str, units: str, name: str = "it") -> str:
    """SPEC as plain numbers in `units`; each value bears a unit, or the last one bears the unit of all."""
    head = "log:" if spec.startswith("log:") else ""
    separator = ":" if ":" in spec else ","
    parts = [QUANTITY.fullmatch(part) for part in spec.removeprefix(head).split(separator)]
    numbers, bears = ([part[k] or "" for part in parts if part] for k in (1, 2))
    if not any(bears) or not all(parts):
        return spec
    values = len(bears) - (separator == ":")  # the last of a range is its count
    if bears[-1] and not any(bears[:-1]):
        # Who types an exponent thinks in SI.
        bare = next((number for number in numbers[: len(numbers) - 1] if "e" in number.lower()), "")
        if bare and convert(1.0, bears[-1], units, name) != 1.0:
            own = "" if units == "1" else f" {units}"
            raise InputError(
                f"{bare} beside {spec.split(separator)[-1].strip()}: write {bare}{bears[-1]}, or {bare}{own}"
            )
        bears = [bears[-1]] * values
    if not all(bears[:values]) or any(bears[values:]):
        count = " (the count has none)" * (separator == ":")
        raise InputError(f"write a unit at each value{count}, or once at the end for all")
    pairs = zip(map(finite, numbers[:values]), bears, strict=False)
    texts = [typed(convert(number, unit, units, name)) for number, unit in pairs]
    return head + separator.join([*texts, *numbers[values:]])


def refined(spec: str, name: str, levels: int, units: str = "") -> NDArray[Any]:
    """The values of SPEC in order, with intervals halved `levels` times, geometrically for a log: range.

    The values for fewer levels are among those for more, bit for bit.
    """
    values = np.unique(parse(spec, name, units))
    refusal = f"{name} = {spec!r}: it cannot be halved {levels} times; choose a smaller refine"
    if (len(values) - 1) * 2**levels >= MOST_VALUES:
        raise InputError(refusal)
    for _ in range(levels):
        # Written so that no sum or product overflows.
        low, high = values[:-1], values[1:]
        middle = _floats(np.sqrt(low) * np.sqrt(high) if spec.startswith("log:") else low + 0.5 * (high - low))
        if not np.all((low < middle) & (middle < high)):
            raise InputError(refusal)
        both = np.empty(len(values) + len(middle))
        both[::2], both[1::2] = values, middle
        values = both
    return values


def _range(parts: list[str], *, logarithmic: bool) -> NDArray[Any]:
    if len(parts) != 3:
        raise InputError("a range must be start:stop:count")
    start, stop, number = finite(parts[0]), finite(parts[1]), parts[2]
    if not (number.isascii() and number.isdigit() and 1 <= int(number) <= MOST_VALUES):
        refusal = f"count must be a whole number from 1 to {MOST_VALUES}, not {number!r}"
        raise InputError(refusal + _of_step(start, stop, number))
    if (int(number) == 1) != (start == stop):
        raise InputError("two equal ends have a count of 1, two others a larger one")
    if not np.isfinite(stop - start):
        raise InputError("the ends must not be so far apart")
    if logarithmic and not (start > 0.0 and stop > 0.0):
        raise InputError("both ends of a log: range must be above 0")
    return (logarithmically if logarithmic else evenly)(start, stop, int(number))


def _of_step(start: float, stop: float, text: str) -> str:
    """The range that is meant where its step stands in place of the count; "" if there is none."""
    with suppress(InputError, ZeroDivisionError, OverflowError):
        steps = (stop - start) / finite(text)
        if 1.0 <= steps < MOST_VALUES and abs(steps - round(steps)) < 1e-6 * steps:
            return f"; for a step of {text} write {typed(start)}:{typed(stop)}:{round(steps) + 1}"
    return ""


def evenly(start: float, stop: float, count: int) -> NDArray[Any]:
    """Evenly spaced values with short decimals: 0.3 and not 0.30000000000000004."""
    with localcontext(EXACT):
        low, high = Decimal(repr(float(start))), Decimal(repr(float(stop)))
        return _floats(low + (high - low) * k / max(count - 1, 1) for k in range(count))


def logarithmically(start: float, stop: float, count: int) -> NDArray[Any]:
    """Values of equal ratio, with short decimals as in `evenly`."""
    with localcontext(EXACT):
        low, high = Decimal(repr(float(start))), Decimal(repr(float(stop)))
        ratio = ((high / low).ln() / max(count - 1, 1)).exp()
        return _floats(accumulate(repeat(ratio, count - 1), mul, initial=low))


def _floats(values: Iterable[Decimal | float]) -> NDArray[Any]:
    """The nearest numbers with 15 digits."""
    return np.array([float(f"{value:.15g}") for value in values])


def has_unit(text: str) -> bool:
    """Whether there is a unit in SPEC."""
    return bool(re.search(r"[A-Zabcdf-zµ°%]", text.removeprefix("log:")))


def typed(value: float | str) -> str:
    """A number as text that reads back exactly, without a trailing .0; words are unchanged."""
    return str(value) if isinstance(value, (str, int)) else repr(float(value)).removesuffix(".0")


def joined(values: Iterable[float | str]) -> str:
    """Values as a list that reads back, and that cannot be mistaken for a decimal comma."""
    texts = [typed(value) for value in values]
    return (", " if all(text.isdigit() for text in texts) else ",").join(texts)


def finite(text: str) -> float:
    """The finite number that a text spells, or an `InputError`."""
    if not (re.fullmatch(NUMBER, text, re.ASCII) and np.isfinite(float(text))):
        raise InputError(f"{text!r} must be a finite number")
    return float(text)


def nearest(values: ArrayLike, number: float) -> tuple[Any, bool]:
    """The value of an axis nearest to a number, and whether it is close enough to count as equal.

    0.1 + 0.2 finds 0.3, and a value in six digits is found again, on even axes and on logarithmic ones.
    """
    ordered = np.unique(np.asarray(values))
    away = np.abs(ordered.astype(float) - number)
    place = int(np.argmin(away))
    gaps = np.diff(ordered[max(place - 1, 0) : place + 2].astype(float))
    allowed = OF_SPACING * gaps.min() if len(gaps) else OF_VALUE * abs(float(ordered[place]))
    return ordered[place], bool(away[place] <= allowed)


def is_logarithmic(values: Any) -> bool:
    """Whether ascending values suit a logarithmic axis: their range is wide, and their steps grow."""
    wide = values[0] > 0.0 and values[-1] >= WIDE * values[0]
    return bool(wide and (len(values) == 2 or values[-1] - values[-2] >= 2.0 * (values[1] - values[0])))


def edges(values: NDArray[Any]) -> NDArray[Any]:
    """Ends of the cell of each ascending value, midway to its neighbours; in logarithms on a logarithmic axis."""
    if len(values) == 1:
        reach = 0.5 * abs(float(values[0])) or 0.5
        return np.array([values[0] - reach, values[0] + reach])
    if is_logarithmic(values):
        return np.asarray(np.exp(_half_way(np.log(values))))
    return _half_way(values)


def _half_way(values: NDArray[Any]) -> NDArray[Any]:
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])
