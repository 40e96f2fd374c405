"""Units as a table's head or a result writes them: `mm/s`, `m s-1`, `degree`; pint knows what they are."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from sweeps import InputError

# UDUNITS, and so CF, writes powers without a sign for them: m s-2.
POWER = re.compile(r"(?<=[A-Za-zµμ])\^?(-?\d+)")
# What has no unit.
PURE = ("", "1", "-")


def convert(value: float, given: str, own: str) -> float:
    """A value in the unit `given` as one in the unit `own`, as one would write it; as it is where these are one.

    Raises
    ------
    InputError
        If there is no such unit, or it measures something else.
    """
    return value if given == own else float(f"{value * factor(given, own):.15g}")


def factor(given: str, own: str) -> float:
    """How many of the unit `own` one of the unit `given` is, to 15 digits."""
    one, other = _unit(given), _unit(own)
    # A temperature in degrees Celsius is no multiple of one in kelvin; neither is a level in decibels.
    if _registry().Quantity(0.0, one.units).to_base_units().magnitude != 0.0:
        raise InputError(f"[{given}] has a zero of its own; write the column in [{own}]")
    if one.dimensionality != other.dimensionality:
        raise InputError(f"[{given}] measures {one.dimensionality}, but [{own}] {other.dimensionality}")
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
    products = re.sub(r"\s+(?![*/])(?<![*/] )", "*", text.strip())
    if not re.fullmatch(r"[A-Za-zµμΩ°%][\w µμΩ°%*/^().-]*", text.strip()):
        raise InputError(f"[{text}] is no unit; write it like mm, mm/s or kg m-3")
    try:
        found = _registry().Quantity(1.0, POWER.sub(r"**\1", products))
    except Exception:  # noqa: BLE001 - pint raises of many kinds for a text that it does not understand
        raise InputError(f"[{text}] is no unit; write it like mm, mm/s or kg m-3") from None
    return found
