"""Axes and grids: values, points, unions and positions."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sweeps import Axis, Grid
from sweeps.grid import first_equal


@given(st.floats(allow_nan=False, allow_infinity=False))
@settings(max_examples=300, deadline=None)
def test_an_axis_rounds_floats_to_fifteen_digits_as_text_does(value):
    assert Axis([value]).values[0] == float(f"{value:.15g}")


def test_the_same_value_is_the_same_point_however_it_was_computed():
    assert Axis(np.linspace(0.0, 0.5, 6)).values.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    assert Grid({"x": np.linspace(0.0, 0.5, 6)}).locate({"x": Axis([0.1 + 0.2]).values}).tolist() == [3]


@pytest.mark.parametrize("values", [[1, 2], ["a", "µ"], [True, False], np.float32([0.1, 0.2]), range(3), 5.0])
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


def test_the_rows_of_a_dataframe_are_points():
    frame = pd.DataFrame({"a": [1.0, 1.0], "kind": ["x", "y"]}, index=pd.Index([7, 9], name="case"))
    grid = Grid.of(frame)
    assert grid.groups == (("case", "a", "kind"),)
    assert grid.axes["case"].values.tolist() == [7, 9]
    assert Grid.of(frame.reset_index(drop=True)).dims == ("row",)
    assert Grid.of(grid) is grid


VALUES = st.lists(st.integers(0, 9), min_size=1, max_size=6, unique=True)


@given(VALUES, VALUES, st.booleans(), st.sampled_from([1, -1, 0]))
@settings(max_examples=100, deadline=None)
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
        np.testing.assert_array_equal(np.arange(union.size).reshape(union.shape)[alignment.index].ravel(), every)
    back = made(one).align(union)(np.arange(union.size))
    assert np.count_nonzero(back >= 0) == made(one).size


def test_a_mask_is_false_where_points_are_skipped():
    grid = Grid({"x": [1, 2, 3], "y": [1, 2]}, skip=lambda points: points["x"] * points["y"] > 3)
    assert grid.mask().tolist() == [True, True, True, False, True, False]


@given(st.lists(st.tuples(st.integers(0, 2), st.sampled_from("ab")), min_size=1, max_size=9))
@settings(max_examples=50, deadline=None)
def test_first_equal_is_the_first_of_equal_rows(rows):
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    assert first_equal(columns).tolist() == [rows.index(row) for row in rows]
