"""What cannot be declared or requested is refused in one line that says what would do."""

import numpy as np
import pytest

from sweeps import Axis, Grid, Refinement, Variable, pointwise, refined
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
    (lambda: Axis([]), "values of shape"),
    (lambda: Axis([[1.0]]), "values of shape"),
    (lambda: Axis([1.0, float("nan")]), "values contain nan"),
    (lambda: Axis([object()]), "must be numbers or strings"),
    (lambda: Axis([1j]), "must be numbers or strings"),
    (lambda: Grid({}), "at least one axis"),
    (lambda: Grid({"x": X, "y": Y}, zipped=("x", "y")), "differ in length"),
    (lambda: Grid({"x": X}, zipped=("x", "z")), "zipped names 'z'"),
    (lambda: Grid({"x": X, "y": X}, zipped=[("x", "y"), ("y", "x")]), "zipped names 'x': .* in one group"),
    (lambda: Grid({"x": [1.0, 1.0]}), r"x takes the value \(1.0,\) twice"),
    (lambda: Grid({"x": ["fast", "exact", "fast"]}), "takes the value .*fast.* twice"),
    (lambda: Grid({"x": [0.3, 0.1 + 0.2]}), r"takes the value \(0.3,\) twice"),
    (lambda: Grid({"status": X}), "the name 'status'"),
    (lambda: Grid({"a/b": X}), "the name 'a/b': it must be of letters"),
    (
        planned(grid=Grid({"x": range(5000), "y": range(5000)})),
        r"2\.5e\+07 points are more than the 2e\+07 of",
    ),
    (planned(grid=Grid({"x": X, "y": Y}, skip=lambda p: [True])), "skip returned the shape"),
    (lambda: Variable(dtype="float16"), "dtype = 'float16': it must be one of float64"),
    (lambda: Variable(dims=("m", "m")), "no dimension may occur twice"),
    (lambda: Variable(dtype="int8", scale="s"), "digits and scale are for floats"),
    (lambda: Variable(dtype="bool", digits=3), "digits and scale are for floats"),
    *((lambda digits=digits: Variable(digits=digits), f"digits = {digits}: ") for digits in (0, 16, 3.0, True)),
    *(
        (lambda flags=flags: Variable(dtype="int8", flags=flags), "flags = ")
        for flags in ({}, {0: ""}, {0.5: "half"}, {-128: "least"})
    ),
    (lambda: Variable(flags={0: "nought"}), "with an integer dtype"),
    (lambda: sweep(variables={}), "at least one"),
    (lambda: sweep(variables={"x": Variable()}), "'x' names two things"),
    (
        lambda: sweep(variables={"z": Variable(dtype="complex128"), "z_real": Variable()}),
        "'z_real' names two things",
    ),
    (lambda: sweep(variables={"a": Variable(dims="mode")}), "'mode'; coords must have it"),
    (lambda: sweep(variables={"area": 3}), "it must be of type Variable"),
    (lambda: sweep(variables={"area": Variable(scale="s")}), "has the scale 's'; the sweep needs scale"),
    (lambda: sweep(coords={"power": Axis([1]), "x": Axis([1])}), "'x' names two things"),
    (lambda: sweep(constants={"factor": object()}), "cannot be written as JSON"),
    (lambda: sweep(function=None), "function = None: it must be a function"),
    (lambda: pointwise(3), "pointwise: function = 3: it must be a function"),
    (lambda: sweep(key="x"), "key = 'x': it must be a function"),
    (lambda: sweep(rerun="again"), "rerun = 'again': it must be a function"),
    (lambda: sweep(order_by="z"), "order_by names 'z': it must be one of x, y"),
    (lambda: sweep(order_by=("x", 3)), "order_by names 3"),
    (lambda: sweep(batch_multiple=0), "batch_multiple = 0: it must be an integer, 1 or above"),
    (lambda: sweep(code="no_such_package").plan("x.nc"), "code = 'no_such_package': there is no such package"),
    (planned(key=lambda points: 3), "one row of numbers or strings"),
    (planned(key=lambda points: [1, 2]), r"shape \(2,\) and type int64 for 6 points"),
    (planned(key=lambda points: points["x"] * np.nan), "key returned NaN"),
    (scaled(lambda p: {}), "scale returned no s"),
    (scaled(lambda p: None), "scale returned NoneType; it must be a dict"),
    (scaled(lambda p: {"s": 2.0}), r"'s' as an array of shape \(\) and type float64 for 6 points"),
    (scaled(lambda p: {"s": p["x"], "t": ["a"] * 6}), "'t' as an array .* type <U1"),
    (scaled(lambda p: {"s": p["x"] * np.inf}), "'s' with a factor that is 0 or not finite"),
    (scaled(lambda p: {"s": p["x"] * 0.0}), "'s' with a factor that is 0 or not finite"),
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
