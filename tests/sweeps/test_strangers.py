"""What somebody who does not know this package tries first: functions of numbers, lists, DataFrames, closures."""

import math
import threading
from functools import partial

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sweeps import (
    DONE,
    FAILED,
    InputError,
    SchedulerError,
    StoreError,
    Sweep,
    SweepStoppedError,
    Variable,
    open_results,
    pointwise,
)


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
    with pytest.raises(ValueError, match="a has no radius"):
        exec(str(data["reproduce"].values[0]), {})


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


def test_complex_and_bool_results_survive_the_store(path):
    def function(points):
        x = points["x"]
        if np.any(x == 3.0):
            raise ValueError("three")
        return {"z": np.exp(1j * x), "real": x, "is_even": x % 2 == 0}

    variables = {"z": Variable("m", "phasor", dtype="complex128", digits=12)}
    variables |= {"real": Variable(dtype="complex128"), "is_even": Variable(dtype="bool")}
    x = [1.0, 2.0, 3.0]
    data = Sweep("kinds", function, {"x": x}, variables).plan(path).run()
    xr.testing.assert_identical(open_results(path), data)
    assert data["z"].dtype == complex
    np.testing.assert_allclose(data["z"][:2], np.exp(1j * np.array(x[:2])), rtol=1e-12)
    assert np.isnan(data["z"].values[2])
    assert (data["z"].attrs["units"], data["z"].attrs["long_name"]) == ("m", "phasor")
    assert data["real"].values[:2].tolist() == [1.0, 2.0]
    assert data["is_even"].values[:2].tolist() == [False, True]
    with xr.open_dataset(path) as file:
        assert {"z_real", "z_imag"} <= {*file}
        assert file["is_even"].attrs["flag_meanings"] == "false true"
    grown = Sweep("kinds", function, {"x": [*x, 4.0]}, variables).plan(path)
    assert grown.todo == 1
    np.testing.assert_array_equal(grown.run()["z"][:2], data["z"][:2])


def test_a_dataframe_may_be_a_constant_but_not_closed_over(path):
    table = pd.DataFrame({"k": [1.0, 2.0]})

    def look_up(points, table):
        return {"y": table["k"].to_numpy()[points["row"]]}

    def sweep(table):
        return Sweep("table", look_up, {"row": [0, 1]}, ["y"], {"table": table})

    assert sweep(table).plan(path).run()["y"].values.tolist() == [1.0, 2.0]
    assert sweep(table.copy()).plan(path).todo == 0
    with pytest.raises(StoreError, match=r"table\.k = \[1\.0, 2\.0\] there, \[1\.0, 4\.0\] here"):
        sweep(pd.DataFrame({"k": [1.0, 4.0]})).plan(path)


def test_a_closure_over_what_cannot_be_compared_is_advised(path):
    file = open(__file__)  # noqa: SIM115 - what cannot be compared
    sweep = Sweep("closed", lambda points: points["x"] + file.fileno(), {"x": [1.0]}, ["y"])
    with file, pytest.raises(InputError, match=r"file = .*which cannot be compared with a stored value; pass it"):
        sweep.plan(path)
    assert Sweep("number", lambda points, n=3: points["x"] + n, {"x": [1.0]}, ["y"]).plan(path).run()["y"] == 4.0


def test_a_function_that_other_processes_cannot_get_is_refused():
    lock = threading.Lock()
    with pytest.raises(SchedulerError, match="the function of sweep locked cannot be sent to other processes: "):
        Sweep("locked", lambda points: points["x"] + lock.locked(), {"x": T}, ["y"]).plan().run("processes", 1)


def test_a_function_that_needs_pointwise_stops_at_once_with_its_error():
    def scalar(t, rate):
        return {"x": math.exp(-rate * t)}

    with pytest.raises(SweepStoppedError, match=r"the first points all failed alike: t = 0.0.*TypeError:"):
        Sweep("scalar", scalar, {"t": np.linspace(0.0, 1.0, 3000), "rate": [1.0, 2.0]}, ["x"]).plan().run()
