"""A point in one line of Python."""

import ast
import dataclasses
import functools
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sweeps.compute.reproduce import one_liner
from tests.helpers.identity_parts import Caller, Inner, Outer, echo, maker


def failing(points, rig=None, limit=1.0):
    raise ValueError(f"{points['V'].tolist()} with {rig} is above {limit}")


def evaluated(line, **names):
    """The value of a line's last expression, after the rest of it."""
    assert len(line.splitlines()) == 1
    tree = ast.parse(line)
    tree.body[-1] = ast.Assign([ast.Name("result", ast.Store())], tree.body[-1].value)
    exec(compile(ast.fix_missing_locations(tree), "line", "exec"), names)
    return names["result"]


def same(one, other):
    """Equality to the type and the sign of zero; one NaN is as good as another."""
    if type(one) is not type(other):
        return False
    if isinstance(one, (np.ndarray, np.generic)):
        return one.dtype == other.dtype and one.shape == other.shape and same(one.tolist(), other.tolist())
    if isinstance(one, dict):
        return same(list(one.items()), list(other.items()))
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    if dataclasses.is_dataclass(one) and not isinstance(one, type):
        return same([*vars(one).items()], [*vars(other).items()])
    return repr(one) == repr(other)


def test_a_line_reads_as_promised():
    line = one_liner(failing, {"V": np.float64(0.002)}, {"rig": Outer(Inner(2.5)), "limit": 0.5})
    assert line == (
        "from numpy import array; from tests.helpers.identity_parts import Inner; "
        "from tests.helpers.identity_parts import Outer; "
        "from tests.sweeps.compute.test_reproduce import failing; "
        "failing({'V': array([0.002])}, rig=Outer(inner=Inner(size=2.5)), limit=0.5)"
    )
    assert "rig=Outer(), limit=float('nan')" in one_liner(failing, {}, {"rig": Outer(), "limit": math.nan})


NUMBERS = st.one_of(st.booleans(), st.integers(), st.floats())
DTYPES = st.sampled_from(["f8", "f4", "f2", "i8", "i4", "i1", "u8", "u2", "?", "U5", "U1", ">f8"])
ARRAYS = hnp.arrays(DTYPES, hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3))
SCALARS = hnp.arrays(DTYPES.filter(lambda d: d[0] != ">"), 1).map(lambda a: a[0])
CONSTANTS = st.recursive(
    st.one_of(st.none(), NUMBERS, st.text(), ARRAYS, SCALARS),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.lists(inner, max_size=3).map(tuple),
        st.dictionaries(st.text(max_size=3), inner, max_size=3),
        st.builds(Outer, st.builds(Inner, st.floats(), st.text()), inner, needed=inner),
    ),
    max_leaves=6,
)


@given(
    st.dictionaries(st.text(max_size=3), SCALARS, min_size=1, max_size=3),
    st.dictionaries(st.sampled_from(["a", "b", "array", "echo"]), CONSTANTS, max_size=3),
)
@settings(max_examples=60, deadline=None)
def test_a_line_gives_back_every_value(point, constants):
    given, places, named = evaluated(one_liner(echo, point, constants))
    assert same(given, {name: np.asarray([value]) for name, value in point.items()})
    assert places == ()
    assert same(dict(sorted(named.items())), dict(sorted(constants.items())))


def test_what_a_partial_gives_stands_in_the_line():
    function = functools.partial(functools.partial(echo, b=1, c=2), b=3)
    line = one_liner(function, {"x": np.float64(1.0)}, {"c": 4, "d": 5})
    assert evaluated(line)[2] == {"b": 3, "c": 4, "d": 5}
    given, (points,), _ = evaluated(one_liner(functools.partial(echo, "first"), {"x": np.int64(1)}, {}))
    assert (given, points["x"].dtype) == ("first", np.int64)


@functools.lru_cache
def cached(points):
    return points


def array(points, held):
    return points, held


def test_wrapped_functions_methods_and_taken_names():
    assert one_liner(cached, {}, {}) == "from tests.sweeps.compute.test_reproduce import cached; cached({})"
    assert one_liner(functools.wraps(echo)(lambda points: 1), {}, {}).endswith("; echo({})")
    assert evaluated(one_liner(Caller.of_class, {"x": np.float64(1.0)}, {})) is Caller
    points, held = evaluated(one_liner(array, {"x": np.float64(1.0)}, {"held": np.arange(2)}))
    np.testing.assert_array_equal(points["x"], [1.0])
    np.testing.assert_array_equal(held, [0, 1])


def test_a_function_that_cannot_be_imported_is_named_in_a_remark():
    line = one_liner(lambda points, factor: factor * points["x"], {"x": np.float64(1.0)}, {"factor": 2.0})
    assert line.startswith("from numpy import array; function({'x': array([1.0])}, factor=2.0)  # function: ")
    assert line.endswith(".<locals>.<lambda> of tests.sweeps.compute.test_reproduce")
    assert evaluated(line, function=echo)[2] == {"factor": 2.0}
    for other in (maker(1), Caller(1), Caller(1).method, functools.partial(maker(1), k=2)):
        assert one_liner(other, {}, {}).startswith("function(")


def test_what_cannot_be_written_is_told_and_does_not_raise():
    class Odd:
        def __repr__(self):
            return "odd\nin two lines " + 100 * "-"

    class Worse:
        def __repr__(self):
            raise RuntimeError

    line = one_liner(echo, {"x": np.float64(1.0)}, {"odd": Odd(), "worse": [Worse()], "fine": 1})
    assert len(line.splitlines()) == 1
    assert "odd=odd, worse=[worse], fine=1)  # odd: odd in two lines ---" in line
    assert evaluated(line, odd=1, worse=2)[2] == {"odd": 1, "worse": [2], "fine": 1}
