"""Any text that one can type: a range is that of decimal arithmetic, everything else is answered or refused."""

from contextlib import suppress
from decimal import Decimal
from pathlib import Path

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from studies.declaring import spec
from studies.query.query import select
from sweeps import InputError
from tests.helpers.examples import examples
from tests.query.trial import trial

POSITIVE = st.decimals("0.001", "1e4", places=3).map(lambda value: value.normalize() + 0)
# A parameter's unit, one that people type, and its factor.
UNITS = [("m s-1", "mm/s", "1e-3"), ("m s-1", "cm s^-1", "1e-2"), ("m", "µm", "1e-6"), ("m", "", "1")]
UNITS += [("Pa", "GPa", "1e9"), ("Pa", "N/mm^2", "1e6"), ("kg m-3", "g/cm3", "1e3"), ("1", "%", "1e-2")]


def fifteen(value):
    """The nearest number with 15 digits."""
    return float(f"{value:.15g}")


@examples(50)
@given(start=POSITIVE, stop=POSITIVE, count=st.integers(2, 40), unit=st.sampled_from(UNITS), log=st.booleans())
def test_a_range_has_the_values_that_one_would_type(start, stop, count, unit, log):
    assume(start != stop)
    own, name, factor = unit
    found = spec.parse(f"{'log:' * log}{start}:{stop}:{count}{name}", "x", own)
    low, high = (Decimal(repr(fifteen(end * Decimal(factor)))) for end in (start, stop))
    assert (found[0], found[-1], len(found)) == (fifteen(low), fifteen(high), count)
    if log:
        np.testing.assert_allclose(found, np.geomspace(float(low), float(high), count), rtol=1e-12)
    else:
        assert found.tolist() == [fifteen(low + (high - low) * k / (count - 1)) for k in range(count)]
    assert spec.parse(",".join(map(spec.typed, found)), "x").tolist() == found.tolist()


@examples(50)
@given(text=st.text("0123456789.,:+-eElogmkµ%/ _xn", max_size=12))
def test_any_spec_is_values_or_one_line(text):
    try:
        found = spec.parse(text, "x", "m")
    except InputError as problem:
        found, said = np.zeros(0), str(problem)
        assert said.startswith(f"x = {text!r}: ") and "\n" not in said  # noqa: PT018
    assert np.all(np.isfinite(found))
    assert len(found) <= spec.count(text)


WORDS = "a kind nan == 1e9 ** and not in lambda if f'{a}'"
PIECES = [*"()[]<=-'\",.1#:\\\n ", *(f"{word} " for word in WORDS.split())]
CALLS = ["__import__('os').mkdir('made')", "open('made', 'w')", "eval('1')", "a.__class__"]


@examples(200)
@given(st.text(max_size=30) | st.lists(st.sampled_from(PIECES + CALLS), max_size=10).map("".join))
def test_any_expression_is_answered_or_refused_and_nothing_is_executed(text):
    with suppress(InputError):
        assert len(select(trial(), text, "a,b")) <= 20
    assert not Path("made").exists()
