"""Values are fitted to their type, rounded, and scaled to a point."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def rounded(values: NDArray[Any], digits: int | None) -> NDArray[Any]:
    """Floats to so many significant decimal digits: the last bits of the mantissa become zero.

    To nearest, ties to even: idempotent, and the same everywhere. The relative error is at most
    10^-digits / 2, so that no value moves by more than half a unit of the last digit kept. What has no such
    neighbour stays as it is: what would become infinite, and what is so small that it has fewer bits.
    """
    if digits is None:
        return values
    bits, word = (23, np.dtype(np.uint32)) if values.dtype == np.float32 else (52, np.dtype(np.uint64))
    # Half a unit of the last bit is at most 10^-digits / 2.
    drop = bits - int(np.ceil(digits * np.log2(10.0)))
    if drop <= 0:
        return values
    raw: Any = values.view(word)
    shift, half, mask = (word.type(n) for n in (drop, (1 << (drop - 1)) - 1, (1 << drop) - 1))
    kept = (raw + half + ((raw >> shift) & word.type(1))) & ~mask
    near: NDArray[Any] = kept.view(values.dtype)
    normal = np.isfinite(values) & np.isfinite(near) & (np.abs(values) >= np.finfo(values.dtype).tiny)
    return np.where(normal, near, values)


def scaled(values: NDArray[Any], factor: NDArray[np.float64], digits: int | None) -> NDArray[Any]:
    """Results of computations as those of points: times the factor of each, and rounded again."""
    product = (values * factor.reshape(-1, *(1,) * (values.ndim - 1))).astype(values.dtype)
    return rounded(product, digits)


def residual(values: NDArray[Any], factor: NDArray[np.float64], digits: int | None) -> NDArray[Any]:
    """The bits that a product, divided by its factor, lacks of the value: mostly zeros."""
    lacking: NDArray[Any] = _bits(values) ^ _bits(_divided(scaled(values, factor, digits), factor, digits))
    return lacking


def unscaled(
    products: NDArray[Any], factor: NDArray[np.float64], digits: int | None, residuals: NDArray[Any]
) -> NDArray[Any]:
    """The very values of which `scaled` made the products, by their residuals."""
    values: NDArray[Any] = (_bits(_divided(products, factor, digits)) ^ residuals).view(products.dtype)
    return values


def _divided(products: NDArray[Any], factor: NDArray[np.float64], digits: int | None) -> NDArray[Any]:
    with np.errstate(all="ignore"):
        return scaled(products, 1.0 / factor, digits)


def _bits(values: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(values).view(f"u{values.dtype.itemsize}")


def fits(values: NDArray[Any], dtype: np.dtype[Any]) -> bool:
    """Whether a type loses nothing of the values but digits of a float."""
    if dtype.kind == "f":
        if values.dtype.kind != "f" or values.dtype.itemsize <= dtype.itemsize:
            return values.dtype.kind in "biuf"
        most = np.finfo(dtype).max
        return not np.any(np.isfinite(values) & (np.abs(values) > most))
    if values.dtype.kind not in "biuf":
        return False
    # The least whole number means that there is none; beyond 2^53 a reader's float would lose digits.
    limit = min(np.iinfo(dtype).max, 2**53)
    return bool(np.all((np.abs(values.astype(float)) <= limit) & (values == np.rint(values))))
