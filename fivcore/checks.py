"""Checks of arguments; every message names the argument, its value and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from fivcore.errors import InputError


def number(name: str, value: Any, allowed: str, accept: Callable[[float], bool]) -> float:
    """Return `value` as a float, or raise `ValueError` saying what is `allowed`."""
    try:
        result = math.nan if isinstance(value, (bool, np.bool_, str, bytes)) else float(value)
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not (math.isfinite(result) and accept(result)):
        value = value.item() if isinstance(value, np.generic) else value
        raise InputError(f"{name} = {short(value)}: it must be {allowed}")
    return result


def between(name: str, value: Any, low: float, high: float, unit: str) -> float:
    """A number from `low` to `high`, both allowed."""
    return number(name, value, f"a number from {low:g} to {high:g} ({unit})", lambda x: low <= x <= high)


def count(name: str, value: Any, most: int) -> int:
    """A whole number between 1 and `most`."""
    allowed = f"a whole number from 1 to {most}"
    return int(number(name, value, allowed, lambda x: x == int(x) and 1 <= x <= most))


def theta_degrees(value: Any) -> float:
    """An inclination of P1, in degrees."""
    allowed = "a single angle between -90 and 90 degrees, both excluded"
    return number("theta", value, allowed, lambda theta: abs(theta) < 90.0)


def friction(value: Any) -> float:
    """A coefficient of friction; the bound is far beyond any and keeps the arithmetic finite."""
    return between("mu", value, 0.0, 1e6, "a coefficient of friction")


def band(value: Any) -> float:
    """The highest frequency of interest, Hz."""
    return between("fmax", value, 1e-3, 1e9, "Hz")


def array(name: str, value: Any, each: Callable[[Any], float]) -> NDArray[np.float64]:
    """Return a copy of `value` as a float array after checking it; a message names the first bad element."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        array = np.array(None)
    if array.ndim == 0:
        return np.array(each(value))
    if array.size == 0:
        return np.zeros(array.shape)
    if array.dtype.kind not in "iuf" or np.ma.is_masked(value):
        raise InputError(f"{name} = {short(value)}: it must be a number or an array of numbers")
    result = array.astype(float)
    # If any element is bad, then one that is not finite, the smallest or the largest.
    for element in (*result[~np.isfinite(result)][:1], result.min(), result.max()):
        each(float(element))
    return result


def choice(name: str, value: Any, allowed: tuple[str, ...]) -> None:
    """Raise unless `value` is one of a few words."""
    if not isinstance(value, str) or value not in allowed:
        raise InputError(f"{name} = {short(value)}: it must be one of {', '.join(allowed)}")


def instance(name: str, value: Any, kind: type) -> None:
    """Raise unless `value` is a `kind`."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOUaeiou" else "a"
        raise InputError(f"{name} = {short(value)}: it must be {article} {kind.__name__}")


def short(value: Any) -> str:
    """A value in a message: one line of at most 60 characters."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def square_matrix(name: str, value: Any, size: int | None = None) -> Any:
    """Return a real, finite matrix, (n, n), n = `size` if given: a CSC array if it was sparse, else an array."""
    try:
        # In coordinates SciPy finds an index out of range; elsewhere it would read beyond its arrays.
        matrix = sparse.csc_array(value.tocoo()) if sparse.issparse(value) else np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} = {short(value)}: it must be a matrix of numbers ({error})") from None
    shape, side = matrix.shape, size or "n"
    if matrix.dtype.kind not in "iuf" or len(shape) != 2 or not shape[0] == shape[1] == (size or shape[0]) > 0:
        raise InputError(
            f"{name} of shape {shape}, {matrix.dtype}: it must be a real matrix of shape ({side}, {side})"
        )
    entries: Any = matrix.data if sparse.issparse(matrix) else matrix
    if (wrong := entries[~np.isfinite(entries)]).size:
        raise InputError(f"{name} has an entry {wrong[0]}: all must be finite")
    return matrix.astype(float)
