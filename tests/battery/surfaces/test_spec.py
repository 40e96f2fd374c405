"""SPEC: what it stands for beside decimal arithmetic, and one line for what is none."""

import math
import re
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from studies import spec
from sweeps import InputError
from tests.battery.surfaces.examples import surface
from tests.battery.surfaces.numerals import SAME, digits15, numerals, units_of

examples = surface("SPEC with units", times=15)
pytestmark = pytest.mark.battery

SPACES = st.sampled_from(["", " ", "  "])
OWN = st.sampled_from(sorted(SAME))


def refused(text, units=""):
    """The message, which must be one line that names the axis and shows what was written."""
    with pytest.raises(InputError) as caught:
        spec.parse(text, "mu", units)
    message = str(caught.value)
    assert message.startswith(f"mu = {text!r}: ")
    assert message.endswith(f"; the forms are {spec.FORMS}")
    assert "\n" not in message
    return message


@st.composite
def lists(draw):
    """A list of values with units: what is typed, the unit that is asked for, and the exact values."""
    own = draw(OWN)
    given = draw(st.lists(numerals(), min_size=1, max_size=5))
    form = draw(st.sampled_from(["plain", "each", "end"]))
    if form == "plain":
        return ",".join(f"{draw(SPACES)}{text}{draw(SPACES)}" for text, _ in given), own, [v for _, v in given]
    units = [draw(units_of(own)) for _ in given]
    if form == "end":
        units = [units[-1]] * len(given)
    texts = [f"{text}{draw(SPACES)}{unit}" for (text, _), (unit, _) in zip(given, units, strict=True)]
    if form == "end":
        texts[:-1] = [text for text, _ in given[:-1]]
    return ",".join(texts), own, [value * factor for (_, value), (_, factor) in zip(given, units, strict=True)]


@examples(100)
@given(lists())
@example(("50,80mm", "m", [Fraction(1, 20), Fraction(2, 25)]))
def test_a_list_is_what_decimal_arithmetic_says(case):
    """To the last of 15 digits: as one would type it in SI."""
    text, own, values = case
    assert spec.parse(text, "x", own).tolist() == [digits15(value) for value in values]
    assert spec.count(text) == len(values)


@examples(40)
@given(
    st.sampled_from(
        [("km/h", "m s-1", 5.0 / 18.0), ("min", "Hz-1", 60.0), ("rad", "degree", 180.0 / math.pi), ("t", "lb", 0)]
    ),
    numerals(),
)
def test_a_unit_without_a_short_factor_is_known_to_14_digits(unit, number):
    given, own, factor = unit
    factor = factor or 1000.0 / 0.45359237
    np.testing.assert_allclose(spec.parse(number[0] + given, "x", own), float(number[1]) * factor, rtol=2e-14)


@st.composite
def ranges(draw, positive=False):
    own = draw(OWN)
    (start, low), (stop, high) = (draw(numerals(signed=not positive)) for _ in range(2))
    count = draw(st.integers(2, 40))
    form = draw(st.sampled_from(["plain", "each", "end"]))
    one, other = draw(units_of(own)), draw(units_of(own))
    if form == "plain":
        return f"{start}:{stop}:{count}", own, low, high, count
    if form == "end":
        return f"{start}:{stop}:{count}{one[0]}", own, low * one[1], high * one[1], count
    return f"{start}{one[0]}:{stop} {other[0]}:{count}", own, low * one[1], high * other[1], count


@examples(80)
@given(ranges())
def test_a_range_has_equal_steps_and_both_ends(case):
    text, own, low, high, count = case
    found = spec.parse(text, "x", own)
    exact = [low + (high - low) * k / (count - 1) for k in range(count)]
    assert (found[0], found[-1]) == (digits15(low), digits15(high))
    np.testing.assert_allclose(
        found, [float(value) for value in exact], rtol=0.0, atol=6e-15 * float(max(abs(low), abs(high)))
    )
    assert spec.count(text) == len(found) == count


@examples(80)
@given(st.integers(-1000, 1000), st.integers(1, 1000), st.integers(2, 60), st.integers(0, 6))
@example(-1, 1, 4, 1)
def test_a_range_has_the_values_that_one_would_type(first, step, count, places):
    """Where its values are short decimals, they are these bit for bit, zero too."""
    values = [Decimal(first + k * step).scaleb(-places) for k in range(count)]
    found = spec.parse(f"{values[0]}:{values[-1]}:{count}", "x")
    assert found.tolist() == [float(value) for value in values]


@examples(80)
@given(ranges(positive=True))
@example((".1023e-2:708.0e6:36", "1", Fraction(1023, 1000000), Fraction(708000000), 36))
def test_a_logarithmic_range_has_equal_ratios_and_both_ends(case):
    text, own, low, high, count = case
    assume(low > 0 and high > 0)
    found = spec.parse(f"log:{text}", "x", own)
    with localcontext() as context:
        context.prec = 40
        a, b = (Decimal(v.numerator) / Decimal(v.denominator) for v in (low, high))
        exact = [float((a.ln() + (b.ln() - a.ln()) * k / (count - 1)).exp()) for k in range(count)]
    assert (found[0], found[-1]) == (digits15(low), digits15(high))
    np.testing.assert_allclose(found, exact, rtol=6e-15)


@examples(40)
@given(ranges(), st.integers(0, 4))
def test_halving_is_a_range_of_more_values(case, halvings):
    text, own, low, high, count = case
    atol = 1e-12 * float(max(abs(low), abs(high)))
    # Closer values have no others between them.
    assume(abs(high - low) > 1e-9 * max(abs(low), abs(high)))
    found = spec.refined(text, "x", halvings, own)
    more = (count - 1) * 2**halvings + 1
    exact = np.sort([float(low + (high - low) * k / (more - 1)) for k in range(more)])
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=atol)
    assert spec.written(found) == "" or np.array_equal(spec.parse(spec.written(found), "x"), found)


NUMBER = r"\s*[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?\s*"
LIST, RANGE = re.compile(f"{NUMBER}(?:,{NUMBER})*"), re.compile(f"(log:)?({NUMBER}):({NUMBER}):([0-9]+)")


def is_spec(text: str) -> bool:
    """Whether a text is a SPEC without units, by the words of the README."""
    if LIST.fullmatch(text):
        return all(math.isfinite(float(part)) for part in text.split(","))
    parts = RANGE.fullmatch(text)
    if not parts:
        return False
    start, stop, count = float(parts[2]), float(parts[3]), int(parts[4])
    ends = math.isfinite(stop - start) and (not parts[1] or min(start, stop) > 0.0)
    return ends and (1 < count <= 10_000_000 or (count == 1 and start == stop))


LETTERS = st.sampled_from(list("0123456789.,:+-eE logx_ \t\n٣"))


@st.composite
def mutated(draw):
    """A SPEC without units in which some letters were deleted, inserted or changed."""
    values = draw(st.lists(numerals().map(lambda one: one[0]), min_size=1, max_size=3))
    text = draw(st.sampled_from([",".join(values), f"{values[0]}:{values[-1]}:7", f"log:{values[0]}:1e2:3"]))
    for _ in range(draw(st.integers(1, 3))):
        place = draw(st.integers(0, len(text)))
        cut = draw(st.integers(0, 1))
        text = text[:place] + draw(st.one_of(st.just(""), LETTERS)) + text[place + cut :]
    return text


@examples(150)
@given(mutated())
@example("1_0")
@example("٣")
@example("0:1:٣")
def test_a_damaged_spec_is_another_or_one_line(text):
    parts = text.removeprefix("log:").split(":")
    assume(len(parts[-1].strip()) < 4)  # as many values take a while
    if is_spec(text):
        assert np.all(np.isfinite(spec.parse(text, "mu")))
    else:
        refused(text)


@examples(60)
@given(OWN, OWN, numerals(), st.data())
def test_a_unit_of_something_else_is_refused(own, other, number, data):
    kinds = {"Hz": "s-1", "1": "degree"}
    assume(kinds.get(own, own) != kinds.get(other, other))
    unit, _ = data.draw(units_of(other))
    assert f"[{unit}] measures" in refused(f"{number[0]}{unit}", own)
    assert "nothing is known of its unit" in refused(f"{number[0]}{unit}")
