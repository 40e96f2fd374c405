"""What a number must be before physics sees it; every message names it, its value and what would do."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray


def number(name: str, value: Any, allowed: str, accept: Callable[[float], bool]) -> float:
    """Return `value` as a float, or raise `ValueError` saying what is `allowed`."""
    try:
        result = math.nan if isinstance(value, (bool, str, bytes)) else float(value)
    except (TypeError, ValueError):
        result = math.nan
    if not (math.isfinite(result) and accept(result)):
        value = value.item() if isinstance(value, np.generic) else value
        raise ValueError(f"{name} = {value!r}: it must be {allowed}")
    return result


def positive(name: str, value: Any, unit: str) -> float:
    """A finite number above zero."""
    return number(name, value, f"a finite number above 0 ({unit})", lambda x: x > 0)


def non_negative(name: str, value: Any, unit: str) -> float:
    """A finite number, zero or above."""
    return number(name, value, f"a finite number, 0 or above ({unit})", lambda x: x >= 0)


def count(name: str, value: Any, most: int) -> int:
    """A whole number between 1 and `most`."""
    allowed = f"a whole number from 1 to {most}"
    return int(number(name, value, allowed, lambda x: x == int(x) and 1 <= x <= most))


def theta_degrees(value: Any) -> float:
    """An inclination of P1, in degrees."""
    return number("theta", value, "an angle between -90 and 90 degrees, both excluded", _steep_enough)


def friction(value: Any) -> float:
    """A coefficient of friction."""
    return non_negative("mu", value, "a coefficient of friction")


def array(name: str, value: Any, each: Callable[[Any], float]) -> NDArray[np.float64]:
    """Return `value` as a float array after checking it; the message names the first bad element."""
    try:
        result = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} = {value!r}: it must be a number or an array of numbers") from None
    if result.ndim == 0:
        each(value)
    elif result.size:
        # A bad element is either not finite or at an end of the range, so three looks do.
        finite = np.isfinite(result)
        for suspect in (result[~finite][:1], result.min(keepdims=True), result.max(keepdims=True)):
            for element in suspect.ravel():
                each(float(element))
    return result


def _steep_enough(theta: float) -> bool:
    return abs(theta) < 90.0
