"""Distributions as one writes them beside SciPy's and mpmath's own."""

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy import integrate, stats

from studies.scatter import distributions
from sweeps import InputError
from tests.battery.surfaces.examples import surface
from tests.battery.surfaces.numerals import SAME, digits15, numerals, units_of

examples = surface("distributions", times=70)
pytestmark = pytest.mark.battery

# Numbers of a rig or a scene with their units, and what each can be.
NAMES = {
    "V": ("m s-1", -math.inf, math.inf),
    "theta": ("degree", -90.0, 90.0),
    "mu": ("1", 0.0, math.inf),
    "F": ("N", 0.0, math.inf),
    "p1_length": ("m", 0.0, math.inf),
    "p2_young_modulus": ("Pa", 0.0, math.inf),
    "point_b": ("1", 0.0, 1.0),
    "head_mass": ("kg", 0.0, math.inf),
}
SHARES = np.array([0.001, 0.1, 0.37, 0.5, 0.9, 0.999])


def refused(text, name):
    with pytest.raises(InputError) as caught:
        distributions.parse(text, name)
    message = str(caught.value)
    assert message.startswith(f"{name} = {text!r}: ")
    assert message.endswith(f"; the forms are {distributions.FORMS}")
    assert "\n" not in message
    return message


@st.composite
def written(draw):
    """A distribution: text, name, kind, and its numbers in SI."""
    name = draw(st.sampled_from(sorted(NAMES)))
    kind = draw(st.sampled_from(["normal", "uniform", "lognormal", "triangular"]))
    count = 3 if kind == "triangular" else 2
    given = [draw(numerals(-3, 3)) for _ in range(count)]
    sized = 1 if kind == "lognormal" else count
    values = [value for _, value in given]
    texts = [text for text, _ in given]
    if kind == "lognormal":
        assume(values[1] < 50)  # quantiles beyond are no numbers
    form = draw(st.sampled_from(["plain", "each", "end"]))
    own = NAMES[name][0]
    if form != "plain":
        units = [draw(units_of(own)) for _ in range(sized)]
        if form == "end":
            units = [units[-1]] * sized
        values[:sized] = [v * factor for v, (_, factor) in zip(values[:sized], units, strict=True)]
        texts[:sized] = [
            text + (unit if form == "each" or k == sized - 1 else "")
            for k, (text, (unit, _)) in enumerate(zip(texts[:sized], units, strict=True))
        ]
    return ":".join([kind, *texts]), name, kind, [digits15(Fraction(v)) for v in values]


def whole(kind, numbers):
    """SciPy's distribution before it is cut; None where there is none."""
    a, b, *_ = numbers
    if kind == "normal":
        return stats.norm(loc=a, scale=b) if b > 0.0 else None
    if kind == "uniform":
        return stats.uniform(loc=a, scale=b - a) if a < b else None
    if kind == "lognormal":
        return stats.lognorm(s=b, loc=0.0, scale=a) if a > 0.0 and b > 0.0 else None
    high = numbers[2]
    return stats.triang(c=(b - a) / (high - a), loc=a, scale=high - a) if a <= b <= high and a < high else None


def below(kind, numbers, x):
    """The distribution function at x, in 40 digits."""
    with mpmath.workdps(40):
        a, b, *rest = map(mpmath.mpf, numbers)
        x = mpmath.mpf(x)
        if kind == "normal":
            return mpmath.ncdf((x - a) / b)
        if kind == "lognormal":
            return mpmath.ncdf(mpmath.log(x / a) / b) if x > 0 else mpmath.mpf(0)
        if kind == "uniform":
            return min(max((x - a) / (b - a), mpmath.mpf(0)), mpmath.mpf(1))
        (c,) = rest
        if x <= a:
            return mpmath.mpf(0)
        if x >= c:
            return mpmath.mpf(1)
        return (x - a) ** 2 / ((c - a) * (b - a)) if x <= b and b > a else 1 - (c - x) ** 2 / ((c - a) * (c - b))


@examples(100)
@given(written())
@example(("uniform:-1:1", "mu", "uniform", [-1.0, 1.0]))
@example(("lognormal:1:0.5", "point_b", "lognormal", [1.0, 0.5]))
@example(("triangular:50:80:90deg", "theta", "triangular", [50.0, 80.0, 90.0]))
def test_a_distribution_is_scipys_cut_to_what_is_physical(case):
    text, name, kind, numbers = case
    expected = whole(kind, numbers)
    if expected is None:
        refused(text, name)
        return
    _, low, high = NAMES[name]
    beneath = below(kind, numbers, low) if low > -math.inf else mpmath.mpf(0)
    until = below(kind, numbers, high) if high < math.inf else mpmath.mpf(1)
    left = float(until - beneath)
    assume(abs(left - distributions.LEAST_LEFT) > 1e-9)
    if left < distributions.LEAST_LEFT:
        assert "% of it is beyond what" in refused(text, name)
        return
    found = distributions.parse(text, name)
    assert found.cut == pytest.approx(float(1 - until + beneath), rel=1e-9, abs=1e-15)
    assert bool(found.cut_note(name)) == (found.cut >= 1e-6)
    spread = abs(numbers[-1]) + abs(numbers[0])
    shares = float(beneath) + SHARES * left
    np.testing.assert_allclose(found.ppf(SHARES), expected.ppf(shares), rtol=1e-9, atol=1e-9 * spread)
    if left > 1.0 - 1e-15:
        np.testing.assert_allclose(found.ppf(SHARES), expected.ppf(SHARES), rtol=1e-12)
    inside = found.ppf(SHARES)
    parts = [float((below(kind, numbers, x) - beneath) / (until - beneath)) for x in inside]
    np.testing.assert_allclose(found.cdf(inside), parts, atol=1e-9)
    quantiles = found.ppf(np.linspace(0.0, 1.0, 101))
    assert np.all(np.diff(quantiles) >= 0.0)
    assert np.all((quantiles >= low) & (quantiles <= high))
    # Its text says it again.
    again = distributions.parse(found.text, name)
    assert again.described == found.described
    assert np.array_equal(again.ppf(SHARES), found.ppf(SHARES))


@examples(8)
@given(st.floats(-0.2, 1.2), st.floats(0.1, 2.0))
def test_a_cut_normal_distribution_has_the_mean_of_its_density(mean, deviation):
    found = distributions.parse(f"normal:{mean!r}:{deviation!r}", "point_b")
    density = stats.norm(mean, deviation).pdf
    expected = integrate.quad(lambda x: x * density(x), 0.0, 1.0)[0] / integrate.quad(density, 0.0, 1.0)[0]
    assert integrate.quad(found.ppf, 0.0, 1.0, limit=200)[0] == pytest.approx(expected, rel=1e-6)


@examples(40)
@given(written(), st.data())
def test_a_damaged_distribution_is_one_line(case, data):
    text, name, kind, _ = case
    head, *rest = text.split(":")
    damage = data.draw(st.sampled_from(["kind", "fewer", "more", "no number", "unit"]))
    if damage == "kind":
        refused(":".join([head[:-1], *rest]), name)
    elif damage == "fewer":
        assert "numbers, not" in refused(":".join([head, *rest[:-1]]), name)
    elif damage == "more":
        assert "numbers, not" in refused(text + ":1", name)
    elif damage == "no number":
        place = data.draw(st.integers(0, len(rest) - 1))
        rest[place] = data.draw(st.sampled_from(["", "x", "nan", "inf", "1_0", "--1"]))
        refused(":".join([head, *rest]), name)
    else:
        others = [own for own in SAME if own != NAMES[name][0] and {own, NAMES[name][0]} != {"1", "degree"}]
        unit, _ = data.draw(units_of(data.draw(st.sampled_from(others))))
        numbers = ["1", "2", "3"][: len(rest)]
        first = 1 if kind == "lognormal" else len(rest)
        texts = [n + unit if k < first else n for k, n in enumerate(numbers)]
        assert f"[{unit}] measures" in refused(":".join([head, *texts]), name)
