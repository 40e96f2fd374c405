"""SPEC: values as they are written on the command line, and the finer ones between them."""

import numpy as np
import pytest

from studies import spec


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.2", [0.2]),
        ("1e-3,2e-3,5e-3", [1e-3, 2e-3, 5e-3]),
        ("0:0.5:3", [0.0, 0.25, 0.5]),
        ("0:0.3:4", [0.0, 0.1, 0.2, 0.3]),
        ("log:1e-4:1e-2:3", [1e-4, 1e-3, 1e-2]),
        ("-5:5:2", [-5.0, 5.0]),
        ("3:3:1", [3.0]),
    ],
)
def test_specs_are_read(text, values):
    np.testing.assert_allclose(spec.parse(text, "mu"), values, rtol=1e-14)


WHOLE = "count must be a whole number from 1 to 10000000, not "


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "'' must be a finite number"),
        ("a", "'a' must be a finite number"),
        ("1,,2", "'' must be a finite number"),
        ("0:1", "a range must be start:stop:count"),
        ("0:1:0", WHOLE + "'0'"),
        ("0:1:1", "a count of 1 must have one end, not two"),
        ("0:1:2.5", WHOLE + "'2.5'"),
        ("1:2:1e3", WHOLE + "'1e3'"),
        ("0:1:99999999", WHOLE + "'99999999'"),
        ("0:inf:3", "'inf' must be a finite number"),
        ("nan", "'nan' must be a finite number"),
        ("log:0:1:3", "both ends of a log: range must be above 0"),
        ("log:1:0:3", "both ends of a log: range must be above 0"),
        ("log:1", "a range must be start:stop:count"),
        ("0:1:2:3", "a range must be start:stop:count"),
        ("0.1,x", "'x' must be a finite number"),
        ("1_0", "'1_0' must be a finite number"),
        ("-1e308:1e308:3", "the ends must not be so far apart"),
    ],
)
def test_a_malformed_spec_is_told_why(text, why):
    with pytest.raises(ValueError, match=r"mu = '.*': .*; the forms are 0.2 \|") as caught:
        spec.parse(text, "mu")
    assert why in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "0:0.5:101 (start:stop:count)" in str(caught.value)


def test_values_of_a_range_are_those_that_one_would_write():
    assert spec.parse("0:0.5:6", "mu").tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    assert spec.parse("log:1e-4:1:5", "V").tolist() == [1e-4, 1e-3, 1e-2, 0.1, 1.0]


@pytest.mark.parametrize("text", ["mu", "=0.2", " =0.2"])
def test_an_assignment_has_a_name_and_a_value(text):
    assert spec.split(" mu = 0.2 ") == ("mu", "0.2")
    with pytest.raises(ValueError, match=r"--fix .*: it must be AXIS=SPEC"):
        spec.split(text, "--fix")


@pytest.mark.parametrize(
    ("text", "halvings", "values"),
    [
        ("0,2,1", 0, [0.0, 1.0, 2.0]),
        ("0,2,1", 1, [0.0, 0.5, 1.0, 1.5, 2.0]),
        ("-1,3", 2, [-1.0, 0.0, 1.0, 2.0, 3.0]),
        ("log:1e-4:1:2", 2, [1e-4, 1e-3, 1e-2, 0.1, 1.0]),
    ],
)
def test_halves_lie_in_the_middle_of_a_range_or_of_its_logarithm(text, halvings, values):
    assert spec.refined(text, "mu", halvings).tolist() == values


@pytest.mark.parametrize("text", ["0:0.5:9", "log:2e-4:1e-2:7"])
def test_values_of_fewer_halvings_are_among_those_of_more(text):
    for fewer in range(4):
        np.testing.assert_array_equal(spec.refined(text, "V", fewer), spec.refined(text, "V", fewer + 1)[::2])


@pytest.mark.parametrize(("text", "halvings"), [("0:1:3", 30), ("1,1.0000000000000002", 1), ("log:1:2:3", 60)])
def test_what_cannot_be_halved_so_often_is_told(text, halvings):
    with pytest.raises(
        ValueError, match=f"^V = '{text}': it cannot be halved {halvings} times; choose a smaller --refine"
    ):
        spec.refined(text, "V", halvings)


@pytest.mark.parametrize(
    ("text", "units", "plain"),
    [
        ("2mm/s", "m s-1", "0.002"),
        ("50:80:7mm", "m", "0.05:0.08:7"),
        ("1.5mm:3mm:40", "m", "1.5e-3:3e-3:40"),
        ("0.15cm:3mm:40", "m", "1.5e-3:3e-3:40"),
        ("1,2,5 mm/s", "m s-1", "0.001,0.002,0.005"),
        ("log:0.1mm/s:10mm/s:3", "m s-1", "log:1e-4:1e-2:3"),
        ("210GPa", "Pa", "210e9"),
        ("7.85 g/cm^3", "kg m-3", "7850"),
        ("20%", "1", "0.2"),
        ("-5deg", "degree", "-5"),
    ],
)
def test_values_may_bear_a_unit(text, units, plain):
    """Bit for bit those that one would write without it."""
    np.testing.assert_array_equal(spec.parse(text, "x", units), spec.parse(plain, "x", units))
    np.testing.assert_array_equal(spec.refined(text, "x", 1, units), spec.refined(plain, "x", 1))


@pytest.mark.parametrize(
    ("text", "units", "why"),
    [
        ("2mm", "m s-1", "[mm] measures [length], but [m s-1] [length] / [time]"),
        ("1mm:2:4", "m", "each value must bear its unit, or the end that of all"),
        ("1mm,2", "m", "each value must bear its unit, or the end that of all"),
        ("1mm:2mm:4mm", "m", "each value must bear its unit, or the end that of all"),
        ("3x", "m", "[x] is no unit"),
        ("2mm", "", "nothing is known of its unit; leave 'mm' out"),
        ("1e400m", "m", "must be a finite number"),
    ],
)
def test_a_unit_that_does_not_fit_is_told(text, units, why):
    with pytest.raises(ValueError, match=r"^x = '.*': .*; the forms are 0.2 \|") as caught:
        spec.parse(text, "x", units)
    assert why in str(caught.value)
