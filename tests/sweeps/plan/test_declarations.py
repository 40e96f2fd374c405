"""Axes and grids: values, unions, positions; what cannot be declared is refused in one line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sweeps import Axis, Grid, InputError, Refinement, Variable, pointwise, refined
from tests.helpers.examples import examples
from tests.helpers.waves import GRID, sweep

X, Y = (Axis(values) for values in GRID.values())


def planned(**options):
    return lambda: sweep(**options).plan()


def scaled(scale):
    return planned(variables={"area": Variable(scale="s")}, scale=scale)


def refine(levels=1, grid=None, variable="root", tolerance=None, thresholds=()):
    axis = np.linspace(0.0, 1.0, 17)
    rule = Refinement(variable, levels, tolerance, thresholds)
    return lambda: refined(sweep(grid or {"x": axis, "y": axis}), rule)


BAD = [
    (lambda: Axis([[1.0]]), "values of shape"),
    (lambda: Axis([1.0, float("nan")]), "values contain nan"),
    (lambda: Axis([object()]), "must be numbers or strings"),
    (lambda: Grid({}), "at least one axis"),
    (lambda: Grid({"x": X, "y": Y}, zipped=("x", "y")), "differ in length"),
    (lambda: Grid({"x": X}, zipped=("x", "z")), "zipped names 'z'"),
    (lambda: Grid({"x": X, "y": X}, zipped=[("x", "y"), ("y", "x")]), "zipped names 'x': .* in one group"),
    (lambda: Grid({"x": [1.0, 1.0]}), r"x takes the value \(1.0,\) twice"),
    (lambda: Grid({"x": [0.3, 0.1 + 0.2]}), r"takes the value \(0.3,\) twice"),
    (lambda: Grid({"status": X}), "the name 'status'"),
    (planned(grid=Grid({"x": range(5000), "y": range(5000)})), "points are more than the 2e"),
    (planned(grid=Grid({"x": X, "y": Y}, skip=lambda p: [True])), "skip returned the shape"),
    (lambda: Variable(dtype="float16"), "dtype = 'float16': it must be one of float64"),
    (lambda: Variable(dims=("m", "m")), "no dimension may occur twice"),
    (lambda: Variable(dtype="int8", scale="s"), "digits and scale are for floats"),
    *((lambda digits=digits: Variable(digits=digits), f"digits = {digits}: ") for digits in (0, 16, 3.0, True)),
    *((lambda f=f: Variable(dtype="int8", flags=f), "flags = ") for f in ({}, {0: ""}, {0.5: "b"}, {-128: "c"})),
    (lambda: Variable(flags={0: "nought"}), "with an integer dtype"),
    (lambda: sweep(variables={}), "at least one"),
    (lambda: Variable(dtype="complex128"), "dtype = 'complex128': it must be one of float64"),
    (lambda: sweep(variables={"a": Variable(dims="mode")}), "'mode'; coords must have it"),
    (lambda: sweep(variables={"area": 3}), "it must be of type Variable"),
    (lambda: sweep(variables={"area": Variable(scale="s")}), "has the scale 's'; the sweep needs scale"),
    (lambda: sweep(coords={"power": Axis([1]), "x": Axis([1])}), "'x' names two things"),
    (lambda: sweep(constants={"factor": object()}), "cannot be written as JSON"),
    (lambda: sweep(function=None), "function = None: it must be a function"),
    (lambda: pointwise(3), "pointwise: function = 3: it must be a function"),
    (lambda: sweep(rerun="again"), "rerun = 'again': it must be a function"),
    (lambda: sweep(order_by="z"), "order_by names 'z': it must be one of x, y"),
    (lambda: sweep(code="no_such_package").plan("x.nc"), "code = 'no_such_package': there is no such package"),
    (planned(key=lambda points: [1, 2]), r"shape \(2,\) and type int64 for 6 points"),
    (planned(key=lambda points: points["x"] * np.nan), "key returned NaN"),
    (scaled(lambda p: {}), "scale returned no s"),
    (scaled(lambda p: None), "scale returned NoneType; it must be a dict"),
    (scaled(lambda p: {"s": p["x"], "t": ["a"] * 6}), "'t' as an array .* type <U1"),
    (scaled(lambda p: {"s": p["x"] * np.inf}), "'s' with a factor that is 0 or not finite"),
    (refine(-1), "levels = -1: it must be"),
    (refine(5), "x has 17 values; with levels = 5 it must have one more than a multiple of 32"),
    (refine(variable="wide"), "variable = 'wide': it must be one of root, count"),
    (refine(tolerance=0.0), "tolerance = 0.0: it must be above 0"),
    (refine(thresholds=(1.0, 0.0)), "thresholds = .*: they must ascend"),
    (refine(grid=Grid({"x": X, "kind": ["a", "b"]})), "kind .* between which nothing is interpolated"),
]


@pytest.mark.parametrize(("make", "message"), BAD)
def test_a_bad_declaration_is_named_in_one_line(make, message):
    with pytest.raises(ValueError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


@given(st.floats(allow_nan=False, allow_infinity=False))
@examples(100)
def test_an_axis_rounds_floats_to_fifteen_digits_as_text_does(value):
    assert Axis([value]).values[0] == float(f"{value:.15g}")


def test_the_same_value_is_the_same_point_however_it_was_computed():
    assert Axis(np.linspace(0.0, 0.5, 6)).values.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    grid = Grid({"x": np.linspace(0.0, 0.5, 6)})
    assert grid.locate({"x": Axis([0.1 + 0.2]).values}).tolist() == [3]
    with pytest.raises(InputError, match=r"Grid: x has no value 0\.7"):
        grid.locate({"x": np.array([0.1, 0.7])})


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64, np.longdouble])
def test_floats_of_any_width_are_the_same_points(kind):
    decimals = [0.1, -0.2, 0.333, 1.0, 2048.0, 0.0]
    assert Axis(kind(decimals)).values.tolist() == decimals
    assert Axis(kind(decimals)).values.dtype == float
    assert Grid({"x": decimals}).locate({"x": kind([1.0, 0.333])}).tolist() == [3, 2]


@pytest.mark.parametrize("values", [[1, 2], ["a", "µ"], [True, False], np.int8([1, 2]), range(3), 5.0])
def test_an_axis_copies_and_freezes_its_values_and_keeps_their_type(values):
    axis = Axis(values)
    assert axis.values.dtype == np.atleast_1d(np.asarray(values)).dtype
    assert axis.values.tolist() == np.atleast_1d(np.asarray(values)).tolist()
    assert not axis.values.flags.writeable


def test_zipped_axes_run_along_the_dimension_of_the_first():
    grid = Grid({"a": [1, 2, 3], "k": ["p", "q"], "b": [0.1, 0.2, 0.3]}, zipped=("a", "b"))
    assert (grid.dims, grid.shape, grid.size, grid.dim_of("b")) == (("a", "k"), (3, 2), 6, "a")
    points = grid.points(np.array([0, 3, 5]))
    assert [values.tolist() for values in points.values()] == [[1, 2, 3], ["p", "q", "q"], [0.1, 0.2, 0.3]]
    assert grid.locate(points).tolist() == [0, 3, 5]
    # Only whole rows must differ.
    assert Grid({"a": [1, 1], "b": [1, 2]}, zipped=("a", "b")).shape == (2,)


VALUES = st.lists(st.integers(0, 9), min_size=1, max_size=6, unique=True)


@given(VALUES, VALUES, st.booleans(), st.sampled_from([1, -1, 0]))
@examples(50)
def test_a_union_has_all_values_sorted_if_both_are_and_align_finds_them(one, other, zipped, order):
    if order:
        one, other = (sorted(each, reverse=order < 0) for each in (one, other))

    def made(values):
        axes = {"x": np.array(values) / 10.0} | ({"w": np.array(values) % 3} if zipped else {})
        return Grid(axes | {"k": ["p", "q"]}, zipped=("x", "w") if zipped else ())

    union = made(one).union(made(other))
    values = np.round(10 * union.axes["x"].values).astype(int).tolist()
    assert set(values) == {*one, *other}
    descends = order < 0 and len(one) + len(other) > 2
    assert not order or values == sorted(values, reverse=descends)
    for values in (one, other):
        grid, alignment = made(values), union.align(made(values))
        every = alignment(np.arange(grid.size))
        for name, column in grid.points().items():
            np.testing.assert_array_equal(union.points(every)[name], column)
        np.testing.assert_array_equal(alignment(), every)
    if union.size > made(one).size:
        with pytest.raises(InputError, match=r"Grid: x.* has no value"):
            made(one).align(union)
