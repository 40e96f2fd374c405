"""SPEC, TOML and tables beside decimal arithmetic: any number that one can type, in any of the units."""

import json
import os
from decimal import Decimal

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from studies import registry, request, spec
from studies.request import Request
from sweeps import InputError

TIMES = int(os.environ.get("FIV_EXAMPLES", "1"))
examples = settings(max_examples=50 * TIMES, derandomize=TIMES == 1, database=None, deadline=None)

SIGNED = st.decimals("-1e4", "1e4", places=3).map(lambda value: value.normalize() + 0)
POSITIVE = st.decimals("0.001", "1e4", places=3).map(lambda value: value.normalize() + 0)
# A parameter's unit, one that people type, and its factor.
UNITS = [("m s-1", "mm/s", "1e-3"), ("m s-1", "cm s^-1", "1e-2"), ("m", "µm", "1e-6"), ("m", "", "1")]
UNITS += [("Pa", "GPa", "1e9"), ("Pa", "N/mm^2", "1e6"), ("kg m-3", "g/cm3", "1e3"), ("1", "%", "1e-2")]
UNIT = st.sampled_from([(own, unit, Decimal(factor)) for own, unit, factor in UNITS])


def fifteen(value):
    """The nearest number with 15 digits."""
    return float(f"{value:.15g}")


@examples
@given(numbers=st.lists(SIGNED, min_size=1, max_size=5), unit=UNIT, each=st.booleans())
def test_a_list_is_its_numbers_times_the_unit(numbers, unit, each):
    own, name, factor = unit
    text = ",".join(f"{number}{name if each else ''}" for number in numbers) + ("" if each else f" {name}")
    assert spec.parse(text, "x", own).tolist() == [fifteen(number * factor) for number in numbers]
    assert spec.count(text) == len(numbers)


@examples
@given(start=POSITIVE, stop=POSITIVE, count=st.integers(2, 40), unit=UNIT, log=st.booleans())
def test_a_range_has_the_values_that_one_would_type(start, stop, count, unit, log):
    own, name, factor = unit
    found = spec.parse(f"{'log:' * log}{start}:{stop}:{count}{name}", "x", own)
    low, high = (Decimal(repr(fifteen(end * factor))) for end in (start, stop))
    assert (found[0], found[-1], len(found)) == (fifteen(low), fifteen(high), count)
    if log:
        np.testing.assert_allclose(found, np.geomspace(float(low), float(high), count), rtol=1e-12)
    else:
        assert found.tolist() == [fifteen(low + (high - low) * k / (count - 1)) for k in range(count)]
    assert spec.parse(",".join(map(spec.typed, found)), "x").tolist() == found.tolist()


@examples
@given(text=st.text("0123456789.,:+-eElogmkµ%/ _xn", max_size=12))
def test_any_text_is_values_or_one_line(text):
    try:
        found = spec.parse(text, "x", "m")
    except InputError as problem:
        found, said = np.zeros(0), str(problem)
        assert said.startswith(f"x = {text!r}: ") and "\n" not in said  # noqa: PT018
    assert np.all(np.isfinite(found))
    assert len(found) <= spec.count(text)


@examples
@given(mu=st.lists(POSITIVE, min_size=1, max_size=3), length=POSITIVE, samples=st.integers(1, 64))
def test_a_file_a_table_and_options_say_the_same(tmp_path_factory, mu, length, samples):
    study, folder = registry.load("fig5"), tmp_path_factory.getbasetemp()
    texts = {"mu": ",".join(map(str, mu)), "p1_length": f"{length}mm", "theta": "normal:5:1"}
    content = [f"{name} = {json.dumps(text)}" for name, text in texts.items()]
    (folder / "run.toml").write_text("\n".join([f"samples = {samples}", "[set]", *content]))
    typed, read = Request(values=texts, samples=samples), request.read(folder / "run.toml")
    assert typed.values == read.values
    assert typed.points_of(study) == read.points_of(study)
    (folder / "rows.csv").write_text("\n".join(["mu,p1_length [mm]", *(f"{value},{length}" for value in mu)]))
    rows, values = request.rows(study, folder / "rows.csv"), typed.values_of(study)
    assert (rows["mu"], set(rows["p1_length"])) == (values["mu"].tolist(), {values["p1_length"][0]})
