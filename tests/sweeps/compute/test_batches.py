"""What becomes of a batch: digits that are kept, points that fail, and what the file says of them."""

import json
import pickle
import re
import time

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sweeps import Axis, Grid, Sweep, Variable, open_results
from sweeps.compute.batch import MOST_LETTERS, Task
from sweeps.compute.values import rounded
from tests.helpers import waves

CALLS: list[int] = []
RAISED: list[Exception] = []


def sweep(function, count=8, **changes):
    options = {"grid": Grid({"x": Axis(np.arange(float(count)), "m")}), "variables": {"y": Variable("m")}}
    return Sweep("batches", function, **(options | changes))


def test_dimensions_come_in_the_grids_order():
    data = waves.sweep().plan().run()
    assert data["root"].dims == ("x", "y")
    assert data["row"].dims == ("x", "y", "power")
    np.testing.assert_array_equal(data["power"], waves.POWERS.values)
    x, y = np.meshgrid(waves.GRID["x"], waves.GRID["y"], indexing="ij")
    np.testing.assert_array_equal(
        data["root"].values.ravel(), waves.wave({"x": x.ravel(), "y": y.ravel()})["root"]
    )
    assert np.all(data["status"] == 1)
    assert np.all(data["wall_time"] >= 0.0)


def numbers(kind):
    width = 32 if kind == "float32" else 64
    return hnp.arrays(kind, st.integers(1, 20), elements=st.floats(width=width))


@given(st.sampled_from(["float32", "float64"]).flatmap(numbers), st.integers(1, 15))
@settings(max_examples=300, deadline=None)
def test_rounding_keeps_its_promise(values, digits):
    near = rounded(values.copy(), digits)
    assert near.dtype == values.dtype
    assert rounded(near, digits).tobytes() == near.tobytes()
    assert np.array_equal(np.isnan(near), np.isnan(values))
    finite = np.isfinite(values)
    assert np.array_equal(near[~finite], values[~finite], equal_nan=True)
    assert np.all(np.isfinite(near[finite]))
    assert np.array_equal(np.signbit(near), np.signbit(values))
    with np.errstate(over="ignore"):
        error = np.abs(near[finite].astype(np.longdouble) - values[finite].astype(np.longdouble))
    assert np.all(error <= np.abs(values[finite].astype(np.longdouble)) * np.longdouble(0.5) * 10.0**-digits)


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_rounding_at_the_edges(kind):
    about = np.finfo(kind)
    edges = np.array(
        [about.max, -about.max, about.tiny, about.smallest_subnormal, 0.0, -0.0, np.inf, -np.inf], kind
    )
    assert rounded(edges, 1).tobytes() == edges.tobytes()
    # A NaN with every bit set does not become a number.
    full = np.full(1, -1, f"i{about.bits // 8}").view(kind)
    assert np.isnan(rounded(full, 2))[0]
    assert rounded(np.array([1.23456789], kind), None)[0] == np.array(1.23456789, kind)
    # Bits beyond what is asked are zero: that is what shrinks.
    bits = rounded(np.array([np.pi], kind), 3).view(f"u{about.bits // 8}")[0]
    assert bits % (1 << (about.nmant - 10)) == 0


def test_a_function_may_use_its_arrays_again():
    """What was returned belongs to the table, whatever the function does with it later."""
    scratch = np.zeros(64)

    def reuse(points):
        part = scratch[: len(points["x"])]
        np.multiply(points["x"], 2.0, out=part)
        return {"y": part, "same": points["x"], "fixed": np.broadcast_to(3.0, len(part)), "error": errors(points)}

    def errors(points):
        return [ValueError("no") if x == 3.0 else None for x in points["x"]]

    variables = {name: Variable() for name in ("y", "same", "fixed")}
    found = sweep(reuse, 600, variables=variables).plan().run("sync")
    x = np.arange(600.0)
    for name, expected in (("y", 2.0 * x), ("same", x), ("fixed", np.full(600, 3.0))):
        np.testing.assert_array_equal(found[name], np.where(x == 3.0, np.nan, expected))
    assert found["x"].values[3] == 3.0


def inner(x):
    if x.max() > 5.0:
        raise ArithmeticError("beyond five:\nλ too high \0 \udc80 here")
    return x


def test_a_failure_is_kept_with_its_place_and_a_way_to_see_it_again(path):
    found = sweep(lambda points: {"y": inner(points["x"])}).plan(path).run()
    with xr.open_dataset(path) as data:
        assert data["status"].values.tolist() == [1] * 6 + [2] * 2
        text = "ArithmeticError: beyond five:\nλ too high \\0 \\udc80 here"
        assert data["error"].values[:6].tolist() == [""] * 6
        assert data["error"].values[7] == text
        assert data["traceback"].dims == ("failure",)
        assert data["failure_x"].values.tolist() == [6.0, 7.0]
        assert data["failure_x"].attrs["units"] == "m"
        trace = data["traceback"].values[0]
        assert trace.splitlines()[-1] == text.splitlines()[-1]
        assert "in inner" in trace
        assert "batch.py" not in trace
        line = "from numpy import array; function({'x': array([7.0])})  # function: "
        assert data["reproduce"].values[1].startswith(line)
        xr.testing.assert_equal(data.load(), found)


def explain(points):
    raise ValueError(f"{'long ' * 400}{points['x'][0]:g}")


def test_long_reasons_are_cut_and_whole_in_the_traceback(path):
    found = sweep(explain, 2).plan(path).run()
    assert len(found["error"].values[1]) == MOST_LETTERS
    assert found["error"].values[1].endswith("...")
    assert found["traceback"].values[1].endswith("long 1")
    with pytest.raises(ValueError, match=r"long 1$"):
        exec(found["reproduce"].values[1], {})


class OddError(Exception):
    def __str__(self):
        raise RuntimeError("no text")


@pytest.mark.parametrize(
    ("problem", "said"),
    [
        (ValueError(), "ValueError"),
        (OddError(), "OddError: (its message cannot be read)"),
        (KeyError("a b"), "KeyError: 'a b'"),
        (MemoryError("all of it"), "MemoryError: all of it"),
    ],
)
def test_any_exception_is_a_reason(path, problem, said):
    def fail(points):
        raise RAISED[-1]

    RAISED.append(problem)
    for store in (None, path):
        assert sweep(fail, 2).plan(store).run()["error"].values.tolist() == [said] * 2


def test_a_batch_that_fails_is_halved_until_only_what_fails_is_left():
    sizes = []

    def pick(points):
        sizes.append(len(points["x"]))
        if np.any(points["x"] == 37.0):
            raise ValueError("37")
        return {"y": points["x"]}

    found = sweep(pick, 600).plan().run("sync")
    assert np.flatnonzero(found["status"] == 2).tolist() == [37]
    np.testing.assert_array_equal(np.isnan(found["y"]), np.arange(600) == 37)
    assert sum(sizes) < 600 + 2 * 600 + 20
    assert len(sizes) < 40


def test_a_function_may_return_what_failed_and_the_time():
    def judge(points):
        CALLS.append(len(points["x"]))
        wrong = points["x"] % 3 == 2
        errors = [
            ValueError(f"{x:g} is wrong") if bad else None for x, bad in zip(points["x"], wrong, strict=True)
        ]
        return {"y": points["x"], "error": errors, "wall_time": points["x"] / 10.0}

    CALLS.clear()
    found = sweep(judge).plan().run()
    assert sum(CALLS) == 8  # nothing is halved
    assert found["status"].values.tolist() == [1, 1, 2, 1, 1, 2, 1, 1]
    assert found["error"].values[[2, 5]].tolist() == ["ValueError: 2 is wrong", "ValueError: 5 is wrong"]
    assert found["traceback"].values[0] == "(raised by the sweep engine)\nValueError: 2 is wrong"
    np.testing.assert_array_equal(found["wall_time"], np.arange(8.0) / 10.0)
    assert np.isnan(found["y"].values[[2, 5]]).all()

    def nap(points):
        time.sleep(0.01)
        return {"y": points["x"], "error": None, "wall_time": None}

    begin = time.perf_counter()
    found = sweep(nap, 200).plan().run("sync")
    assert np.all(found["status"] == 1)
    assert np.all(found["wall_time"] > 0.0)
    # A batch's time is shared by its points.
    assert found["wall_time"].sum() < time.perf_counter() - begin


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"y": [1.0]}, "returned 'y' of shape (1,); it must be (2,)"),
        ({"y": np.ones((2, 3))}, "returned 'y' of shape (2, 3); it must be (2,)"),
        ({"part": [1.0, 2.0]}, "returned 'part' of shape (2,); it must be (2, 3)"),
        ({"error": [None]}, "returned 1 of 'error'; it must be one a point, 2"),
        ({"error": ["text", None]}, "returned the error 'text'; it must be an exception or None"),
        ({"error": [KeyboardInterrupt(), None]}, "it must be an exception or None"),
        ({"wall_time": [1.0]}, "returned 1 of 'wall_time'; it must be one a point, 2"),
        ({"wall_time": 1.0}, r"returned 'wall_time' of shape (); it must be (2,)"),
        ({"wall_time": [[1.0], [1.0]]}, r"returned 'wall_time' of shape (2, 1); it must be (2,)"),
        (None, "returned NoneType; it must be a dict"),
    ],
)
def test_a_wrong_return_is_named(given, said):
    def function(points):
        return given if given is None else {"y": points["x"], "part": np.zeros((2, 3))} | given

    task = Task("batches", function, {}, {"y": Variable(), "part": Variable()}, {"y": (), "part": (3,)})
    with pytest.raises((TypeError, ValueError), match=re.escape(said)) as caught:
        task._call({"x": np.arange(2.0)})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("dtype", "returned", "said"),
    [
        ("int8", lambda x: 100.7 * x, "of type float64, which does not fit int8"),
        ("int8", lambda x: 1000 * x, "does not fit int8"),
        ("int8", lambda x: np.full(len(x), -128), "does not fit int8"),
        ("int64", lambda x: np.full(len(x), 2**60), "does not fit int64"),
        ("int32", lambda x: x * np.nan, "does not fit int32"),
        ("float32", lambda x: x * 1e300, "of type float64, which does not fit float32"),
        ("float64", lambda x: x * 1j, "of type complex128, which does not fit float64"),
        ("float64", lambda x: x.astype(str), "which does not fit float64"),
    ],
)
def test_nothing_is_cast_in_silence(dtype, returned, said):
    found = sweep(lambda p: {"y": returned(p["x"] + 0.5)}, 2, variables={"y": Variable(dtype=dtype)}).plan().run()
    assert np.all(found["status"] == 2)
    assert said in found["error"].values[0]
    found = sweep(lambda p: {}, 2).plan().run()
    assert "returned no 'y'" in found["error"].values[0]


@pytest.mark.parametrize("large", [10_000, 1 << 40])
def test_of_many_failures_the_first_thousand_are_told_in_full(path, monkeypatch, large):
    """Also where texts are too many for memory."""
    for name in ("manifest.LARGE", "netcdf.LARGE", "netcdf.READ_AT_ONCE"):
        monkeypatch.setattr(f"sweeps.storage.{name}", large)

    def fail(points):
        return {"y": points["x"], "error": [ValueError(f"{x:g}") for x in points["x"]]}

    found = sweep(fail, 3500).plan(path).run()
    assert np.all(found["status"] == 2)
    assert found["error"].values.tolist() == [f"ValueError: {x}" for x in range(3500)]
    np.testing.assert_array_equal(found["failure_x"], np.arange(1000.0))
    xr.testing.assert_equal(open_results(path), found)
    grown = sweep(fail, 3600).plan(path).run()
    np.testing.assert_array_equal(grown["failure_x"], np.arange(1000.0))
    assert grown["traceback"].values.tolist() == found["traceback"].values.tolist()


def test_the_file_reads_as_cf_and_without_us(tmp_path):
    path = tmp_path / "deep" / "batches.nc"
    axes = {"x": Axis([1.0, 2.0], "m", "length"), "kind": Axis(["a", "µm", ""])}
    axes |= {"n": Axis([3, 4]), "w": Axis([5.0, 6.0], "s")}

    def compute(points, factor):
        if points["kind"][0] == "":
            raise ValueError("no kind")
        return {"y": np.pi * points["x"], "count": points["n"], "part": points["x"][:, None] * [1.0, 2.0]}

    variables = {"y": Variable("m", "length", digits=4), "count": Variable(dtype="int32")}
    variables |= {"part": Variable("m", dims=("side",), dtype="float32")}
    coords, constants = {"side": Axis(["left", "right"])}, {"factor": 2.0}
    options = {"variables": variables, "coords": coords, "constants": constants, "title": "A title"}
    found = sweep(compute, grid=Grid(axes, zipped=("n", "w")), **options).plan(path).run()
    xr.testing.assert_equal(open_results(path), found)
    assert [p.name for p in path.parent.iterdir()] == ["batches.nc"]
    with xr.open_dataset(path) as data:
        xr.testing.assert_equal(data.load(), found)
        assert data["x"].attrs == {"units": "m", "long_name": "length"}
        assert data["y"].attrs["comment"] == "kept to 4 significant digits"
        np.testing.assert_array_equal(data["y"][:, 0, 0], rounded(np.pi * np.array([1.0, 2.0]), 4))
        values = {name: axis.values.tolist() for name, axis in axes.items()}
        told = {"name": "batches", "axes": values, "constants": constants}
        assert json.loads(data.attrs["configuration"]) == told
        assert (data["kind"].values.tolist(), data["side"].values.tolist()) == (["a", "µm", ""], ["left", "right"])
        assert set(data.coords) == {"x", "kind", "n", "w", "side"}
    with netCDF4.Dataset(path) as file:
        # What CF asks for besides is checked with every kind of file.
        assert file.title == "A title"
        assert file["status"].flag_values.tolist() == [0, 1, 2, 3]
        assert file["status"].flag_meanings == "pending done failed skipped"
        assert (file["y"].units, file["y"].coordinates, file["wall_time"].units) == ("m", "w", "s")
        assert np.isnan(file["y"]._FillValue)
        assert file["count"]._FillValue == np.iinfo("int32").min
        assert (file["error"][0, 2, 1], file["error"][0, 0, 0]) == ("ValueError: no kind", "")
        assert file["y"][0, 2, 0] is np.ma.masked
        # A file with texts of any length cannot be opened twice at once.
        assert all(variable.dtype is not str for variable in file.variables.values())


def test_nothing_is_pickled(path, monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("pickled")

    for name in ("dump", "dumps", "load", "loads", "Pickler", "Unpickler"):
        monkeypatch.setattr(pickle, name, refuse)
    sweep(lambda p: {"y": p["x"]}).plan(path).run("sync")
    assert np.all(sweep(lambda p: {"y": p["x"]}, 9).plan(path, fresh=True).run("sync")["status"] == 1)
