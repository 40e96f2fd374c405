"""Numbers as people type them, with units, and what they are in SI by decimal arithmetic."""

from decimal import Decimal, localcontext
from fractions import Fraction

from hypothesis import strategies as st

# Of each unit that a number of the project has: others, and how many of it they are, exactly.
MULTIPLES = {
    "m": {"m": 1, "mm": "1e-3", "cm": "1e-2", "µm": "1e-6", "km": 1000, "nm": "1e-9"},
    "m s-1": {"m/s": 1, "mm/s": "1e-3", "mm s-1": "1e-3", "cm*s^-1": "1e-2"},
    "Pa": {"Pa": 1, "GPa": "1e9", "MPa": "1e6", "N/mm^2": "1e6", "kN m-2": 1000},
    "kg m-3": {"kg/m3": 1, "g/cm^3": 1000, "g cm-3": 1000, "kg/dm**3": 1000},
    "kg": {"kg": 1, "g": "1e-3", "mg": "1e-6"},
    "N": {"N": 1, "kN": 1000, "mN": "1e-3"},
    "s": {"s": 1, "ms": "1e-3", "µs": "1e-6", "min": 60},
    "Hz": {"Hz": 1, "kHz": 1000},
    "1": {"%": "1e-2"},
    "degree": {"deg": 1, "°": 1, "degree": 1},
}
SAME = {own: {unit: Fraction(factor) for unit, factor in units.items()} for own, units in MULTIPLES.items()}


@st.composite
def numerals(draw, low=-6, high=6, signed=True):
    """A number of at most nine digits as somebody types it, and its exact value."""
    digits = str(draw(st.integers(0, 10 ** draw(st.integers(1, 9)) - 1)))
    point = draw(st.integers(0, len(digits)))
    form = draw(st.sampled_from(["whole", "point", "power"]))
    mantissa = digits if form == "whole" else f"{digits[:point]}.{digits[point:]}"
    power = f"{draw(st.sampled_from('eE'))}{draw(st.integers(low, high))}" if form == "power" else ""
    text = draw(st.sampled_from(["", "-", "+"] if signed else ["", "+"])) + mantissa + power
    return text, Fraction(Decimal(text))


def units_of(own: str):
    """A unit that measures the same, and how many of `own` it is."""
    return st.sampled_from(sorted(SAME[own].items()))


def digits15(value: Fraction) -> float:
    """The number of 15 significant digits nearest to a value."""
    with localcontext() as context:
        context.prec = 15
        return float(Decimal(value.numerator) / Decimal(value.denominator))
