"""Units as a table's head or a result writes them: `mm/s`, `m s-1`, `degree`; pint knows what they are."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from sweeps import InputError

# A name with its power, which may stand without a sign: m s-2. Nothing else reaches pint, which would compute it.
NAME = r"[A-Za-zµμΩ°%]+(?:\s*(?:\^|\*\*)?\s*-?\d)?"
PRODUCT = re.compile(rf"{NAME}(?:\s*[*/]\s*{NAME}|\s+{NAME}|\.{NAME})*")
POWER = re.compile(r"(?<=[A-Za-zµμΩ°%])\s*(?:\^|\*\*)?\s*(-?\d)")
# What has no unit.
PURE = ("", "1", "-")


def convert(value: float, unit: str, own: str) -> float:
    """A value in the unit `unit` as one in the unit `own`, as one would write it; as it is where these are one.

    Raises
    ------
    InputError
        If there is no such unit, or it measures something else.
    """
    return value if unit == own else float(f"{value * factor(unit, own):.15g}")


def factor(unit: str, own: str) -> float:
    """How many of the unit `own` one of `unit` is, to 15 digits."""
    one, other = _unit(unit), _unit(own)
    # A temperature in degrees Celsius is no multiple of one in kelvin; neither is a level in decibels.
    if _registry().Quantity(0.0, one.units).to_base_units().magnitude != 0.0:
        raise InputError(f"[{unit}] has a zero of its own; write the column in [{own}]")
    if one.dimensionality != other.dimensionality:
        raise InputError(f"[{unit}] measures {one.dimensionality}, but [{own}] {other.dimensionality}")
    return float(f"{one.to(other).magnitude:.15g}")


@cache
def _registry() -> Any:
    # Slow to import, and most commands convert nothing.
    from pint import UnitRegistry

    return UnitRegistry()


@cache
def _unit(text: str) -> Any:
    """One of a unit."""
    if text.strip() in PURE:
        return _registry().Quantity(1.0)
    unknown = InputError(f"[{text}] is no unit; write it like mm, mm/s or kg m-3")
    if not PRODUCT.fullmatch(text.strip()):
        raise unknown
    powers = POWER.sub(r"**\1", text.strip())
    # A pint that cannot be imported is no unknown unit.
    known = _registry()
    try:
        found = known.Quantity(1.0, re.sub(r"\s*(\*\*|[*/])\s*|[\s.]+", lambda m: m[1] or "*", powers))
    except Exception:  # noqa: BLE001 - pint raises of many kinds for a text that it does not understand
        raise unknown from None
    return found
