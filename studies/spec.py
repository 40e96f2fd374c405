"""SPEC, the way values are written on the command line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Context, Decimal, localcontext
from itertools import accumulate, repeat
from operator import mul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps import InputError

FORMS = "0.2 | 1e-3,2e-3,5e-3 | 0:0.5:101 (start:stop:count) | log:1e-4:1e-2:30, in SI or like 2mm/s | 50:80:7mm"
# A number and what stands behind it.
QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-zµμΩ°%].*?)?\s*")
MOST_VALUES = 10_000_000
# What so many steps lose of it is far behind the 15th digit.
EXACT = Context(prec=40)
# A list of more values is no SPEC that anybody types.
MOST_LISTED = 60


def assignment(
    text: str, texts: Mapping[str, Sequence[str]], units: Callable[[str], str] = lambda _: ""
) -> tuple[str, Any]:
    """Read AXIS=SPEC; `texts` are the values of axes and settings that are of texts, `units(name)` their units."""
    name, spec = split(text)
    return name, listed(spec, texts[name]) if name in texts else parse(spec, name, units(name))


def listed(spec: str, texts: Sequence[str]) -> list[str]:
    """The texts of a list with commas, which known ones may contain themselves."""
    parts, entries = spec.split(","), list[str]()
    while parts:
        counts = (n for n in range(len(parts), 0, -1) if ",".join(parts[:n]).strip() in texts)
        count = next(counts, len(parts))
        entries.append(",".join(parts[:count]).strip())
        parts = parts[count:]
    return entries


def split(text: str, option: str = "--set", form: str = "AXIS=SPEC, for example mu=0:0.5:101") -> tuple[str, str]:
    """AXIS and SPEC, of what follows an option."""
    name, equals, spec = text.partition("=")
    if not equals or not name.strip():
        raise InputError(f"{option} {text!r}: it must be {form}")
    return name.strip(), spec.strip()


def parse(spec: str, name: str, units: str = "") -> NDArray[Any]:
    """The values that SPEC stands for, in `units`; without these no number may bear a unit.

    Raises
    ------
    ValueError
        If it is none of the forms; the message names the axis, what was written, why, and the forms.
    """
    text = spec
    try:
        spec = converted(spec, units)
        if ":" in spec:
            return _range(spec.removeprefix("log:").split(":"), spec.startswith("log:"))
        return np.array([finite(part) for part in spec.split(",")])
    except ValueError as problem:
        raise InputError(f"{name} = {text!r}: {problem}; the forms are {FORMS}") from None


def count(spec: str) -> int:
    """How many values SPEC stands for at most, without making them; 1 for what is none."""
    if ":" not in spec:
        return spec.count(",") + 1
    digits = re.match(r"\s*\d{1,18}", spec.rpartition(":")[2], re.ASCII)
    return max(int(digits[0]), 1) if digits else 1


def converted(spec: str, units: str) -> str:
    """SPEC with plain numbers in `units`, of one in which each value bears a unit, or the end that of all."""
    head = "log:" if spec.startswith("log:") else ""
    separator = ":" if ":" in spec else ","
    parts = [QUANTITY.fullmatch(part) for part in spec.removeprefix(head).split(separator)]
    own_units = [part[2] if part and part[2] else "" for part in parts]
    if not any(own_units) or not all(parts):
        return spec
    numbers = [part[1] for part in parts if part]
    # The last of a range is its count.
    values = len(own_units) - (separator == ":")
    *first, last = own_units
    if last and not any(first):
        own_units = [last] * values
    if not all(own_units[:values]) or any(own_units[values:]):
        raise InputError("each value must bear its unit, or the end that of all")
    if not units:
        raise InputError(f"nothing is known of its unit; leave {own_units[0]!r} out")
    from studies.units import convert

    texts = [
        typed(convert(float(number), unit, units))
        for number, unit in zip(numbers, own_units[:values], strict=False)
    ]
    return head + separator.join([*texts, *numbers[values:]])


def refined(spec: str, name: str, halvings: int, units: str = "") -> NDArray[Any]:
    """The values that SPEC stands for, in order, each interval between them halved so often.

    Half-way is the geometric mean in a log: range, else the arithmetic one. The values of fewer halvings are among
    those of more, bit for bit.

    Raises
    ------
    ValueError
        As `parse` does; or if there are no such values, or too many.
    """
    values = np.unique(parse(spec, name, units))
    logarithmic = spec.startswith("log:")
    refusal = f"{name} = {spec!r}: it cannot be halved {halvings} times; choose a smaller --refine"
    if (len(values) - 1) * 2**halvings >= MOST_VALUES:
        raise InputError(refusal)
    for _ in range(halvings):
        # Written so that no sum or product overflows.
        low, high = values[:-1], values[1:]
        middle = _floats(np.sqrt(low) * np.sqrt(high) if logarithmic else low + 0.5 * (high - low))
        if not np.all((low < middle) & (middle < high)):
            raise InputError(refusal)
        both = np.empty(len(values) + len(middle))
        both[::2], both[1::2] = values, middle
        values = both
    return values


def _range(parts: list[str], logarithmic: bool) -> NDArray[Any]:
    if len(parts) != 3:
        raise InputError("a range must be start:stop:count")
    start, stop = finite(parts[0]), finite(parts[1])
    if not (parts[2].isascii() and parts[2].isdigit() and 1 <= int(parts[2]) <= MOST_VALUES):
        raise InputError(f"count must be a whole number from 1 to {MOST_VALUES}, not {parts[2]!r}")
    count = int(parts[2])
    if count == 1 and start != stop:
        raise InputError("a count of 1 must have one end, not two")
    if not np.isfinite(stop - start):
        raise InputError("the ends must not be so far apart")
    if logarithmic and not (start > 0.0 and stop > 0.0):
        raise InputError("both ends of a log: range must be above 0")
    return logarithmically(start, stop, count) if logarithmic else evenly(start, stop, count)


def evenly(start: float, stop: float, count: int) -> NDArray[Any]:
    """Values from start to stop, as one would write them: 0.3 and not 0.30000000000000004.

    So a value that is asked for alone is the one that a range has, also near zero between ends of both signs.
    """
    with localcontext(EXACT):
        low, high = _decimal(start), _decimal(stop)
        return _floats(low + (high - low) * k / max(count - 1, 1) for k in range(count))


def logarithmically(start: float, stop: float, count: int) -> NDArray[Any]:
    """Values of equal ratio from start to stop, likewise."""
    with localcontext(EXACT):
        low, high = _decimal(start), _decimal(stop)
        ratio = ((high / low).ln() / max(count - 1, 1)).exp()
        return _floats(accumulate(repeat(ratio, count - 1), mul, initial=low))


def _decimal(value: float) -> Decimal:
    return Decimal(repr(float(value)))


def typed(value: float | str) -> str:
    """A number as one types it, all its digits kept; a word as it is."""
    return value if isinstance(value, str) else repr(float(value)).removesuffix(".0")


def written(values: Any, halvings: int = 0) -> str:
    """The SPEC of these numbers, bit for bit, once its intervals are halved so often; "" if it is too long."""
    values = np.asarray(values, dtype=float)
    coarse = values[:: 2**halvings]
    ends = f"{typed(coarse[0])}:{typed(coarse[-1])}:{len(coarse)}"
    texts = [",".join(map(typed, coarse))] if len(coarse) <= MOST_LISTED else []
    texts += [ends, f"log:{ends}"] if values.min() > 0.0 else [ends]
    # A few values are listed.
    order = texts if len(coarse) <= 3 else texts[::-1]
    return next((text for text in order if np.array_equal(refined(text, "", halvings), values)), "")


def _floats(values: Iterable[Decimal | float]) -> NDArray[Any]:
    """The numbers of 15 digits that are nearest."""
    return np.array([float(f"{value:.15g}") for value in values])


def finite(text: str) -> float:
    """A finite number as one types it, or a `ValueError`."""
    try:
        value = float(text) if text.isascii() and "_" not in text else float("nan")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(f"{text!r} must be a finite number")
    return value
