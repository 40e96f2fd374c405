"""One batch: results are checked and rounded, a failing point is stored, the others go on; scalar functions."""

import math
import re
import threading
import time
from functools import partial

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sweeps import (
    DONE,
    FAILED,
    Axis,
    Grid,
    SchedulerError,
    Sweep,
    SweepStoppedError,
    Variable,
    open_results,
    pointwise,
)
from sweeps.storage.assemble import rounded
from sweeps.task import MOST_CHARACTERS
from tests.helpers.backends import visible
from tests.helpers.examples import examples
from tests.helpers.state import Log

RAISED = Log()


def sweep(function, count=8, **changes):
    options = {"grid": Grid({"x": Axis(np.arange(float(count)), "m")}), "variables": {"y": Variable("m")}}
    return Sweep("batches", function, **(options | changes))


@given(
    st.sampled_from(["f4", "f8"]).flatmap(lambda kind: hnp.arrays(kind, st.integers(1, 20))), st.integers(1, 15)
)
@examples(60)
def test_rounding_is_idempotent_and_moves_no_value_by_more_than_half_a_digit(values, digits):
    near, finite = rounded(values.copy(), digits), np.isfinite(values)
    assert near.dtype == values.dtype
    assert rounded(near, digits).tobytes() == near.tobytes()
    np.testing.assert_array_equal(near[~finite], values[~finite])
    np.testing.assert_array_equal(np.signbit(near), np.signbit(values))
    exact = values[finite].astype(np.longdouble)
    error = np.abs(near[finite].astype(np.longdouble) - exact)
    assert np.all(error <= np.abs(exact) * np.longdouble(0.5) * np.longdouble(10.0) ** -digits)


def test_a_function_may_reuse_and_return_its_arrays():
    scratch = np.zeros(64)

    def reuse(points):
        part = np.multiply(points["x"], 2.0, out=scratch[: len(points["x"])])
        return {"y": part, "same": points["x"]}

    data = sweep(reuse, 600, variables=["y", "same"]).plan().run("sync")
    np.testing.assert_array_equal(data["y"], 2.0 * data["x"])
    np.testing.assert_array_equal(data["same"], data["x"])


def inner(points):
    if points["x"].max() > 5.0:
        raise ArithmeticError("beyond five:\nλ too high \0 \udc80 here")
    return {"y": points["x"]}


def test_a_failed_point_keeps_its_reason_its_traceback_and_a_line_that_computes_it_again(path):
    data = sweep(inner, rerun=lambda point: f"run --x {point['x']}").plan(path).run()
    assert data["status"].values.tolist() == [1] * 6 + [2] * 2
    text = "ArithmeticError: beyond five:\nλ too high \\0 \\udc80 here"
    assert data["error"].values.tolist() == [""] * 6 + [text] * 2
    assert data["failure_x"].values.tolist() == [6.0, 7.0]
    trace = str(data["traceback"].values[0])
    assert trace.endswith(text)
    assert "in inner" in trace
    assert "sweeps/" not in trace.replace("tests/sweeps/", "")
    assert data["reproduce"].values.tolist() == ["run --x 6.0", "run --x 7.0"]
    assert set(sweep(inner).plan().run()["reproduce"].values) == {""}
    with xr.open_dataset(path) as plain:
        xr.testing.assert_equal(plain.load(), data)


def fail(points):
    raise RAISED[-1]


REASONS = [
    (ValueError(), "ValueError"),
    (SystemExit(3), "SystemExit: 3"),
    (ValueError("long " * 400), f"ValueError: {'long ' * 400}"[: MOST_CHARACTERS - 3] + "..."),
]


@pytest.mark.parametrize(("problem", "reason"), REASONS)
def test_any_exception_is_a_reason(path, problem, reason):
    RAISED.append(problem)
    for store in (None, path):
        data = sweep(fail, 2).plan(store).run()
        assert data["error"].values.tolist() == [reason] * 2
        assert reason.removesuffix("...") in str(data["traceback"].values[0])


def test_a_batch_that_fails_is_halved_down_to_the_guilty_points():
    sizes = []

    def pick(points):
        sizes.append(len(points["x"]))
        if np.any(points["x"] == 37.0):
            raise ValueError("37")
        return {"y": points["x"]}

    data = sweep(pick, 600).plan().run("sync")
    np.testing.assert_array_equal(data["y"], np.where(np.arange(600) == 37, np.nan, np.arange(600)))
    assert len(sizes) < 40


def test_a_function_may_return_errors_and_times_of_its_points():
    calls = []

    def judge(points):
        calls.extend(points["x"])
        errors = [ValueError(f"{x:g} is wrong") if x % 3 == 2 else None for x in points["x"]]
        return {"y": points["x"], "error": errors, "wall_time": points["x"] / 10.0}

    data = sweep(judge).plan().run()
    assert len(calls) == 8  # nothing is halved
    assert data["error"].values[[2, 5]].tolist() == ["ValueError: 2 is wrong", "ValueError: 5 is wrong"]
    assert data["traceback"].values[0] == "(raised by the sweep engine)\nValueError: 2 is wrong"
    np.testing.assert_array_equal(data["wall_time"], np.arange(8.0) / 10.0)
    np.testing.assert_array_equal(np.isnan(data["y"]), data["status"] == 2)


RETURNS = [
    (lambda x: {"y": np.ones((2, 3))}, "returned 'y' of shape (2, 3); it must be (2,)"),
    (lambda x: {"y": x, "error": [None]}, "returned 1 of 'error'; it must be one a point, 2"),
    (lambda x: {"y": x, "error": ["text"] * len(x)}, "returned the error 'text'; it must be an exception or None"),
    (lambda x: {"y": x, "wall_time": 1.0}, "returned 'wall_time' of shape (); it must be (2,)"),
    (lambda x: {}, "returned no 'y'"),
    (lambda x: {"y": 100.7 * x}, "of type float64, which does not fit int8"),
    (lambda x: {"y": np.full(len(x), -128)}, "does not fit int8"),
    (lambda x: {"y": x * 1e300}, "of type float64, which does not fit float32"),
    (lambda x: {"y": x * 1j}, "of type complex128, which does not fit float64"),
    (lambda x: {"y": x.astype(str)}, "which does not fit float64"),
    (lambda x: {"y": x}, "which does not fit bool"),
]


@pytest.mark.parametrize(("returned", "message"), RETURNS)
def test_a_wrong_return_is_named_and_nothing_is_cast(returned, message):
    variables = {"y": Variable(dtype=message.partition("fit ")[2] or "float64")}
    task = sweep(lambda p: returned(p["x"] + 0.5), 2, variables=variables).plan().task
    with pytest.raises((TypeError, ValueError, KeyError), match=re.escape(message)):
        task._call({"x": np.arange(2.0)})


def test_of_many_failures_all_reasons_and_a_thousand_tracebacks_are_stored(path):
    def fail(points):
        return {"y": points["x"], "error": [ValueError(f"{x:g}") for x in points["x"]]}

    data = sweep(fail, 1500).plan(path).run()
    assert data["error"].values.tolist() == [f"ValueError: {x}" for x in range(1500)]
    np.testing.assert_array_equal(data["failure_x"], np.arange(1000.0))
    xr.testing.assert_equal(open_results(path), data)


# The first batch is of points from three places.


@pytest.mark.parametrize("scheduler", ["threads", "sync", "inside"])
def test_a_run_whose_first_points_fail_alike_stops_at_once_and_leaves_nothing(path, scheduler, request):
    where = request.getfixturevalue(scheduler) if scheduler == "inside" else scheduler

    def wrong(points):
        return {"y": not_defined}  # noqa: F821 - the error of this test

    begin = time.monotonic()
    with pytest.raises(SweepStoppedError, match=r"the first points all failed alike: x = 0.0: NameError:"):
        sweep(wrong, 100_000).plan(path).run(where)
    assert time.monotonic() - begin < 10.0
    assert visible(path.parent) == []


def unless_told(points):
    if RAISED:
        raise RAISED[-1]
    return {"y": points["x"]}


def test_a_run_that_stops_keeps_earlier_results(path):
    RAISED.clear()
    few, many = (sweep(unless_told, grid={"x": values}) for values in ([0.5], [0.5, *np.arange(1.0, 20.0)]))
    few.plan(path).run()
    RAISED.append(ZeroDivisionError())
    with pytest.raises(SweepStoppedError, match="ZeroDivisionError"):
        many.plan(path).run("sync")
    RAISED.clear()
    plan = many.plan(path)
    assert plan.cached - plan.failed == 1


def partly(points, count):
    errors = [ValueError("alike") if x < count else None for x in points["x"]]
    return {"y": points["x"], "error": errors}


def test_a_failing_corner_different_errors_or_a_single_batch_do_not_stop_a_run():
    for options in ({"count": 1000, "constants": {"count": 20}}, {"count": 3, "constants": {"count": 3}}):
        data = sweep(function=partly, **options).plan().run()
        assert np.count_nonzero(data["status"] == 2) == options["constants"]["count"]
    assert np.all(sweep(lambda p: {}[p["x"][0]], 100).plan().run()["status"] == 2)


def decay(t, rate, scale=1.0):
    return scale * math.exp(-rate * t)


def circle(radius, name):
    if radius < 0.0:
        raise ValueError(f"{name} has no radius")
    return {"area": math.pi * radius**2, "corners": [radius, -radius], "is_large": radius > 1.5}


T, RATES = [0.0, 0.5, 1.0], [1.0, 3.0]


def test_a_function_of_numbers_over_lists_returns_numbers(path):
    data = Sweep("decay", pointwise(decay), {"t": T, "rate": RATES}, ["x"], {"scale": 2.0}).plan(path).run()
    assert data["x"].dims == ("t", "rate")
    np.testing.assert_array_equal(data["x"], [[decay(t, rate, 2.0) for rate in RATES] for t in T])
    assert np.all(data["wall_time"] > 0.0)


def test_a_function_of_numbers_may_return_a_dict_and_raise(path):
    variables = {"area": Variable("m2"), "corners": Variable(dims="side"), "is_large": Variable(dtype="bool")}
    points = {"radius": [-1.0, 1.0, 2.0], "name": ["a"]}
    sweep = Sweep("circles", pointwise(circle), points, variables, coords={"side": [1, 2]})
    data = sweep.plan(path).run().isel(name=0)
    assert data["status"].values.tolist() == [FAILED, DONE, DONE]
    assert data["error"].values.tolist() == ["ValueError: a has no radius", "", ""]
    np.testing.assert_array_equal(data["area"], [np.nan, math.pi, 4.0 * math.pi])
    np.testing.assert_array_equal(data["corners"], [[np.nan] * 2, [1.0, -1.0], [2.0, -2.0]])


def test_one_array_without_a_name_is_the_one_variable():
    data = Sweep("sum", lambda points: points["a"] + points["b"], {"a": [1, 2], "b": [3.0]}, "y").plan().run()
    assert data["y"].values.tolist() == [[4.0], [5.0]]


@pytest.mark.parametrize("index", [None, pd.Index([7, 9, 8], name="case")])
def test_the_rows_of_a_dataframe_are_points(path, index):
    frame = pd.DataFrame({"t": [0.0, 1.0, 1.0], "rate": [1.0, 1.0, 2.0]}, index=index)
    data = Sweep("decay", pointwise(decay if index is None else partial(with_case)), frame, ["x"]).plan(path).run()
    assert data["x"].dims == ("row" if index is None else "case",)
    np.testing.assert_array_equal(data["x"], np.exp(-frame["rate"] * frame["t"]))
    assert data["rate"].values.tolist() == [1.0, 1.0, 2.0]


def with_case(case, t, rate):
    return decay(t, rate) + 0.0 * case


def test_bool_results_survive_the_store(path):
    def function(points):
        x = points["x"]
        if np.any(x == 3.0):
            raise ValueError("three")
        return {"z": np.exp(x), "is_even": x % 2 == 0}

    variables = {"z": Variable("m", "growth", digits=12), "is_even": Variable(dtype="bool")}
    x = [1.0, 2.0, 3.0]
    data = Sweep("kinds", function, {"x": x}, variables).plan(path).run()
    xr.testing.assert_identical(open_results(path), data)
    np.testing.assert_allclose(data["z"][:2], np.exp(x[:2]), rtol=1e-12)
    assert np.isnan(data["z"].values[2])
    assert (data["z"].attrs["units"], data["z"].attrs["long_name"]) == ("m", "growth")
    assert data["is_even"].values[:2].tolist() == [False, True]
    with xr.open_dataset(path) as file:
        assert file["is_even"].attrs["flag_meanings"] == "false true"
    grown = Sweep("kinds", function, {"x": [*x, 4.0]}, variables).plan(path)
    assert grown.todo == 1
    np.testing.assert_array_equal(grown.run()["z"][:2], data["z"][:2])


def test_a_function_that_other_processes_cannot_get_is_refused():
    lock = threading.Lock()
    with pytest.raises(SchedulerError, match="the function of sweep locked cannot be sent to other processes: "):
        Sweep("locked", lambda points: points["x"] + lock.locked(), {"x": T}, ["y"]).plan().run("processes", 1)
