"""Units in the heads of a table."""

import pytest

from studies.units import convert
from sweeps import InputError


@pytest.mark.parametrize(
    ("value", "given", "own", "found"),
    [
        (1.95, "mm", "m", 1.95e-3),
        (2.0, "mm/s", "m s-1", 2e-3),
        (2.0, "mm s-1", "m s-1", 2e-3),
        (2.0, "mm * s^-1", "m s-1", 2e-3),
        (185.0, "GPa", "Pa", 185e9),
        (3.0, "N mm-2", "Pa", 3e6),
        (7.9, "g/cm3", "kg m-3", 7900.0),
        (0.5, "µm", "m", 5e-7),
        (20.0, "%", "1", 0.2),
        (0.2, "1", "1", 0.2),
        (180.0, "rad", "degree", 10313.2403123548),
        (5.0, "°", "degree", 5.0),
        (2.0, "kHz", "s-1", 2000.0),
    ],
)
def test_a_value_in_another_unit(value, given, own, found):
    assert convert(value, given, own) == found


@pytest.mark.parametrize(
    ("given", "own", "message"),
    [
        ("kg", "m", r"\[kg\] measures \[mass\], but \[m\] \[length\]"),
        ("m", "1", r"\[m\] measures \[length\], but \[1\] dimensionless"),
        ("degC", "K", r"\[degC\] has a zero of its own; write the column in \[K\]"),
        ("furlongz", "m", r"\[furlongz\] is no unit; write it like mm, mm/s or kg m-3"),
        ("__import__('os')", "m", "is no unit"),
        ("9**9**9", "m", "is no unit"),
        ("m**9**9**9", "m", "is no unit|measures"),
    ],
)
def test_what_is_no_such_unit(given, own, message):
    with pytest.raises(InputError, match=message):
        convert(1.0, given, own)
