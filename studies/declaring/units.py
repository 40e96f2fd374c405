"""Conversion of units such as `mm/s`, `m s-1`, `degree` by pint."""

from __future__ import annotations

import re
from contextlib import suppress
from functools import cache
from typing import Any

from sweeps import InputError

# A name with its power, also without a sign: m s-2. Nothing else reaches pint, which would compute it.
NAME = r"[A-Za-zµμΩ°%]+(?:\s*(?:\^|\*\*)?\s*-?\d)?"
PRODUCT = re.compile(rf"{NAME}(?:\s*[*/]\s*{NAME}|\s+{NAME}|\.{NAME})*")
POWER = re.compile(r"(?<=[A-Za-zµμΩ°%])\s*(?:\^|\*\*)?\s*(-?\d)")
# What is measured, by its dimensions, and an example.
KINDS = {
    "dimensionless": ("a plain number", "0.2"),
    "degree": ("an angle", "5deg or 5"),
    "[mass]": ("a mass", "500g or 0.5"),
    "[length]": ("a length", "5mm or 5e-3"),
    "[time]": ("a time", "5ms or 5e-3"),
    "1 / [time]": ("a rate", "5kHz or 5e3"),
    "[length] / [time]": ("a speed", "5mm/s or 5e-3"),
    "[length] * [mass] / [time] ** 2": ("a force", "9N or 9"),
    "[mass] / [length] / [time] ** 2": ("a pressure", "210GPa or 210e9"),
    "[mass] / [length] ** 3": ("a density", "7.8g/cm3 or 7800"),
}


class UnitError(InputError):
    """A unit does not exist, or measures something else."""


def convert(value: float, unit: str, own: str, name: str = "the value") -> float:
    """Convert a value from `unit` to `own`, to 15 digits; a `UnitError` says what the unit measures."""
    if unit == own:
        return value
    given, needed = _unit(unit), _unit(own)
    if given.dimensionality != needed.dimensionality:
        one, other = (str(each.dimensionality) for each in (given, needed))
        wanted, example = KINDS.get("degree" if own == "degree" else other, (other, own))
        raise UnitError(f"{unit} is {KINDS.get(one, (one,))[0]}; {name} is {wanted}: {example}")
    # Degrees Celsius are no multiple of kelvins, nor decibels of anything.
    if any(type(each)(0.0, each.units).to_base_units().magnitude for each in (given, needed)):
        raise UnitError(f"{unit} and {own} have different zeros; write values in {own}")
    return float(f"{value * float(f'{given.to(needed).magnitude:.15g}'):.15g}")


@cache
def _unit(text: str) -> Any:
    """One `unit` as a quantity of pint."""
    from pint import application_registry as registry  # slow to import, and most commands convert nothing

    if text.strip() in ("", "1", "-"):
        return registry.Quantity(1.0)
    if PRODUCT.fullmatch(text.strip()):
        powers = POWER.sub(r"**\1", text.strip())
        with suppress(Exception):  # pint raises errors of many kinds for a text that is no unit
            return registry.Quantity(1.0, re.sub(r"\s*(\*\*|[*/])\s*|[\s.]+", lambda m: m[1] or "*", powers))
    raise UnitError(f"{text} is no unit; write it like mm, mm/s or kg m-3")
