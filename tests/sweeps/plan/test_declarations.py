"""What cannot be declared or asked for is refused in one line that says what would do."""

import numpy as np
import pytest

from sweeps import Axis, Grid, Refinement, Variable, refined
from tests.helpers.waves import GRID, sweep

X, Y = (Axis(values) for values in GRID.values())


def scaled(scale):
    return sweep(variables={"area": Variable(scale="s")}, scale=scale)


def refine(levels=1, grid=None, variable="root", tolerance=None, thresholds=()):
    axis = Axis(np.linspace(0.0, 1.0, 17))
    asked = sweep(grid or Grid({"x": axis, "y": axis}))
    return refined(asked, Refinement(variable, levels, tolerance, thresholds))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Axis([]), "values of shape"),
        (lambda: Axis([1.0, float("nan")]), "values contain nan"),
        (lambda: Axis([object()]), "must be numbers or texts"),
        (lambda: Variable(dtype="complex128"), "dtype = 'complex128'"),
        (lambda: Grid({}), "at least one axis"),
        (lambda: Grid({"x": [1, 2]}), r"axes\['x'\] = \[1, 2\]: it must be of type Axis"),
        (lambda: Grid({"x": X, "y": Y}, zipped=("x", "y")), "differ in length"),
        (lambda: Grid({"x": X}, zipped=("x", "z")), "zipped names 'z'"),
        (lambda: Grid({"x": Axis([1.0, 1.0])}), "takes the value"),
        (lambda: sweep(variables={}), "at least one"),
        (lambda: sweep(variables={"x": Variable()}), "'x' names two things"),
        (lambda: sweep(variables={"a": Variable(dims=("mode",))}), "coords must hold it"),
        (lambda: sweep(constants={"factor": object()}), "cannot be written as JSON"),
        (lambda: Variable(dtype="float16"), "dtype = 'float16': it must be one of float64"),
        (lambda: Variable(dims=("m", "m")), "each may stand once"),
        (lambda: Grid({"status": X}), "the name 'status'"),
        (lambda: Grid({"a/b": X}), "the name 'a/b': it must be of letters"),
        (lambda: sweep(coords={"power": [1, 2, 3]}), "it must be of type Axis"),
        (lambda: sweep(variables={"area": 3}), "it must be of type Variable"),
        (lambda: sweep(coords={"power": Axis([1]), "x": Axis([1])}), "'x' names two things"),
        (lambda: sweep(key=lambda points: 3).plan(), "one row of numbers or texts"),
        (lambda: sweep(key=lambda points: points["x"] * np.nan).plan(), "key gave NaN"),
        (lambda: sweep().plan().run("cluster"), "scheduler = 'cluster'"),
        (lambda: sweep().plan().run(workers=0), "workers = 0"),
        (lambda: sweep().plan().run(workers=True), "workers = True"),
        (lambda: sweep().plan().run(workers="two"), "workers = 'two'"),
        (lambda: sweep(key=lambda points: [1, 2]).plan(), r"shape \(2,\) and type int64 for 6 points"),
        (lambda: sweep(grid=Grid({"x": X, "y": Y}, skip=lambda p: [True])).plan(), "skip returned the shape"),
        (lambda: sweep(order_by="z"), "order_by names 'z': it must be one of x, y"),
        (lambda: sweep(order_by=("x", 3)), "order_by names 3"),
        (lambda: sweep(function=None), "function = None: it must be a function"),
        (lambda: sweep(key="x"), "key = 'x': it must be a function"),
        (lambda: sweep(scale={"s": 2.0}), "scale = {'s': 2.0}: it must be a function"),
        (lambda: sweep(variables={"area": Variable(scale="s")}), "has the scale 's'; the sweep needs scale"),
        (lambda: scaled(lambda p: {}).plan(), "scale gives no s"),
        (lambda: scaled(lambda p: None).plan(), "scale gave NoneType; it must give a dict"),
        (
            lambda: scaled(lambda p: {"s": 2.0}).plan(),
            r"'s' as an array of shape \(\) and type float64 for 6 points",
        ),
        (lambda: scaled(lambda p: {"s": p["x"] > 9, "t": ["a"] * 6}).plan(), "'t' as an array .* type <U1"),
        (lambda: scaled(lambda p: {"s": p["x"] / 0.0}).plan(), "'s' with a factor that is not finite"),
        (lambda: Variable(dtype="int8", scale="s"), "digits and scale are for floats"),
        (lambda: Variable(dtype="int8", digits=3), "digits and scale are for floats"),
        (lambda: Variable(digits=0), "digits = 0: it must be a whole number from 1 to 15"),
        (lambda: Variable(digits=16), "digits = 16"),
        (lambda: Variable(digits=3.0), "digits = 3.0"),
        (lambda: Variable(digits=True), "digits = True"),
        *(
            (lambda wrong=wrong: Variable(dtype="int8", flags=wrong), "Variable: flags = ")
            for wrong in ({}, {0: ""}, {0.5: "half"}, {-128: "least"})
        ),
        (lambda: Variable(flags={0: "nought"}), "with a dtype of those"),
        (lambda: sweep(variables={"failure_x": Variable()}), "the name 'failure_x'"),
        (lambda: sweep(variables={"computed": Variable()}), "the name 'computed'"),
        (lambda: Grid({"x": Axis(["fast", "exact", "fast"])}), r"takes the value .*fast.* twice"),
        (lambda: Axis([None, "fast"]), "they must be numbers or texts"),
        (lambda: refine(-1), "levels = -1: it must be a whole number, 0 or above"),
        (lambda: refine(5), "x has 17 values; with levels = 5 it must have one more than a multiple of 32"),
        (lambda: refine(variable="wide"), "variable = 'wide': it must be one of root, count"),
        (lambda: refine(tolerance=0.0), "tolerance = 0.0: it must be above 0"),
        (lambda: refine(thresholds=(1.0, 0.0)), r"thresholds = .*: they must ascend"),
        (
            lambda: refine(grid=Grid({"x": X, "kind": Axis(["a", "b"])})),
            "kind is of texts, between which nothing is interpolated",
        ),
    ],
)
def test_bad_declarations_are_named(make, message):
    with pytest.raises(ValueError, match=message) as caught, np.errstate(divide="ignore"):
        make()
    assert "\n" not in str(caught.value)
