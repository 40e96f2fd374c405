"""The sweep engine on functions that have nothing to do with beams."""

import json
import threading
import time

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from sweeps import Axis, Grid, StoreError, Sweep, Variable, open_results
from sweeps.plan import batches
from sweeps.plan.batches import BatchSizes, Queue

X = Axis([0.5, 1.0, 2.0], "m", "length")
Y = Axis([3, 4], "s", "time")


def area(points, factor=1.0):
    product = factor * points["x"] * points["y"]
    return {"area": product, "powers": product[:, None] ** np.arange(1, 4)}


def sweep(function=area, **changes):
    options = {
        "grid": Grid({"x": X, "y": Y}),
        "variables": {
            "area": Variable("m s", "product"),
            "powers": Variable("1", "its powers", ("power",)),
        },
        "constants": {"factor": 2.0},
        "coords": {"power": Axis([1, 2, 3])},
    }
    return Sweep("areas", function, **(options | changes))


def test_dimensions_come_in_the_grids_order():
    data = sweep().plan().run()
    assert data["area"].dims == ("x", "y")
    assert data["powers"].dims == ("x", "y", "power")
    np.testing.assert_array_equal(data["area"], 2.0 * X.values[:, None] * Y.values)
    np.testing.assert_array_equal(data["powers"], data["area"].values[..., None] ** [1, 2, 3])
    assert np.all(data["status"] == 1)
    assert np.all(data["wall_time"] >= 0.0)


def test_zipped_axes_vary_together_along_the_first():
    grid = Grid({"x": X, "k": Axis([1, 2]), "y": Axis([10, 20, 30])}, zipped=("x", "y"))
    assert grid.dims == ("x", "k")
    assert grid.shape == (3, 2)
    function = Sweep("pairs", lambda p: {"sum": p["x"] + p["y"] + p["k"]}, grid, {"sum": Variable()})
    data = function.plan().run()
    np.testing.assert_array_equal(data["sum"], (X.values + Axis([10, 20, 30]).values)[:, None] + [1, 2])
    assert data["y"].dims == ("x",)


def test_skipped_points_are_not_computed():
    seen = []

    def once(points):
        seen.extend(points["x"].tolist())
        return {"twice": 2.0 * points["x"]}

    grid = Grid({"x": X}, skip=lambda points: points["x"] > 1.5)
    plan = Sweep("few", once, grid, {"twice": Variable()}).plan()
    assert (plan.points, plan.skipped, plan.distinct, plan.todo) == (3, 1, 2, 2)
    data = plan.run()
    assert 2.0 not in seen
    np.testing.assert_array_equal(data["twice"], [1.0, 2.0, np.nan])
    np.testing.assert_array_equal(data["status"], [1, 1, 3])


def test_points_with_one_key_are_computed_once():
    computed = []

    def record(points, factor):
        computed.append(len(points["x"]))
        return area(points, factor)

    grid = Grid({"x": Axis([1.0, 2.0, 3.0]), "y": Axis([3.0, 1.5, 1.0])})
    plan = sweep(record, grid=grid).plan()
    assert plan.distinct == 9
    computed.clear()
    keyed = sweep(record, grid=grid, key=lambda points: points["x"] * points["y"]).plan()
    assert keyed.distinct == 7
    data = keyed.run()
    assert sum(computed) == 7
    xr.testing.assert_equal(data[["area", "powers"]], plan.run()[["area", "powers"]])


@given(st.integers(1, 40), st.integers(1, 40), st.sampled_from(["threads", "sync"]), st.integers(1, 4))
@settings(max_examples=25, deadline=None)
def test_values_do_not_depend_on_how_a_sweep_runs(nx, ny, scheduler, workers):
    grid = Grid({"x": Axis(np.linspace(0.1, 1.0, nx)), "y": Axis(np.linspace(2.0, 3.0, ny))})
    data = sweep(grid=grid).plan().run(scheduler, workers)
    expected = area({"x": np.repeat(grid.axes["x"].values, ny), "y": np.tile(grid.axes["y"].values, nx)}, 2.0)
    np.testing.assert_array_equal(data["area"].values.ravel(), expected["area"])


def size_of_batch(left, seconds, workers=2, **limits):
    """How many points a batch holds once as many as one likes have taken `seconds` each."""
    sizes = BatchSizes(**limits)
    sizes.finished(1 << 40, seconds * (1 << 40))
    return sizes.next(left, workers)


@given(st.integers(1, 5000), st.floats(0.0, 10.0, exclude_min=True))
@settings(max_examples=50, deadline=None)
def test_batches_hold_every_point_once(points, seconds):
    queue, cut = Queue(Grid({"x": Axis(np.arange(points))}), np.ones(points, dtype=bool)), []
    while queue.left:
        cut.append(queue.take(size_of_batch(queue.left, seconds)))
    np.testing.assert_array_equal(np.concatenate(cut), np.arange(points))
    sizes = np.array([len(batch) for batch in cut])
    assert sizes.max() == 1 or sizes.max() * seconds <= 1.0
    # Towards the end they are no longer than what the other workers have left to do, or a quarter of a second.
    assert np.all(np.diff(sizes) <= 0)
    left = np.cumsum(sizes[::-1])[::-1]
    assert np.all((sizes <= left / 8 + 1) | (sizes == 1) | (sizes * seconds <= 0.25))


def test_threads_are_really_used(monkeypatch):
    barrier, met = threading.Barrier(2, timeout=20.0), []

    def meet(points):
        barrier.wait()
        met.append(len(points["x"]))
        return {"one": np.ones(len(points["x"]))}

    # 34 batches of a point each; two workers can only finish these if they work at the same time.
    monkeypatch.setattr(batches, "BATCH_BYTES", 1.0)
    plan = Sweep("meeting", meet, Grid({"x": Axis(np.arange(34.0))}), {"one": Variable()}).plan()
    assert met == []
    assert np.all(plan.run(workers=2)["status"] == 1)
    assert met == [1] * 34


def test_a_failing_point_is_kept_apart_with_its_reason():
    def picky(points):
        if np.any(points["x"] == 1.0):
            raise ValueError("one is not allowed")
        return {"twice": 2.0 * points["x"]}

    data = Sweep("picky", picky, Grid({"x": Axis(np.arange(5.0))}), {"twice": Variable()}).plan().run()
    np.testing.assert_array_equal(data["status"], [1, 2, 1, 1, 1])
    np.testing.assert_array_equal(data["twice"], [0.0, np.nan, 4.0, 6.0, 8.0])
    assert data["error"].values.tolist() == ["", "ValueError: one is not allowed", "", "", ""]


def test_a_wrong_shape_or_a_missing_variable_is_a_reason():
    data = sweep(lambda points, factor: {"area": points["x"]}).plan().run()
    assert "returned no 'powers'" in data["error"].values[0, 0]
    data = sweep(lambda points, factor: {"area": points["x"], "powers": points["x"]}).plan().run()
    assert "returned 'powers' of shape (1,); it must be (1, 3)" in data["error"].values[0, 0]


@pytest.mark.parametrize(
    ("dtype", "returned", "said"),
    [
        ("int8", lambda x: 100.7 * x, "of type float64, which does not fit int8"),
        ("int8", lambda x: 1000 * x, "does not fit int8"),
        ("int8", lambda x: np.full(len(x), -128), "does not fit int8"),
        ("int64", lambda x: np.full(len(x), 2**60), "does not fit int64"),
        ("int32", lambda x: x * np.nan, "does not fit int32"),
        ("float64", lambda x: x * 1j, "of type complex128, which does not fit float64"),
        ("float64", lambda x: x.astype(str), "which does not fit float64"),
    ],
)
def test_nothing_is_cast_in_silence(dtype, returned, said):
    function = Sweep("cast", lambda p: {"y": returned(p["x"])}, Grid({"x": X}), {"y": Variable(dtype=dtype)})
    data = function.plan().run()
    assert np.all(data["status"] == 2)
    assert said in data["error"].values[0]


def test_whole_numbers_and_their_gaps_survive_the_file(tmp_path):
    def double(points):
        if np.any(points["x"] == 1.0):
            raise ValueError("no")
        return {"twice": np.where(points["x"] < 1.0, -1, 2.0 * points["x"]).astype(int)}

    path = tmp_path / "whole.nc"
    variable = Variable("1", "number", dtype="int16")
    data = Sweep("whole", double, Grid({"x": X}), {"twice": variable}).plan(path).run()
    np.testing.assert_array_equal(data["twice"], [-1.0, np.nan, 4.0])
    xr.testing.assert_equal(open_results(path), data)
    with xr.open_dataset(path, mask_and_scale=False) as raw:
        assert raw["twice"].dtype == np.int16
        assert raw["twice"].attrs["_FillValue"] == -32768
        assert raw["twice"].values.tolist() == [-1, -32768, 4]


def test_what_was_computed_is_kept_if_nothing_can_be_derived(tmp_path):
    def broken(data):
        raise ArithmeticError("no")

    path = tmp_path / "areas.nc"
    with pytest.raises(ArithmeticError, match="no"):
        sweep(derive=broken).plan(path).run()
    assert np.all(open_results(path)["status"] == 1)


def test_a_grid_of_which_everything_is_skipped():
    data = sweep(grid=Grid({"x": X, "y": Y}, skip=lambda p: p["x"] > 0), key=lambda p: p["x"]).plan().run()
    assert np.all(data["status"] == 3)
    assert np.all(np.isnan(data["area"]))


def slowly(points, factor=1.0):
    time.sleep(0.1)
    return area(points, factor)


def test_progress_hears_of_every_point():
    told = []
    sweep(slowly).plan().run(progress=told.append)
    assert [(each.todo, each.failed) for each in told] == [(6, 0)] * len(told)
    assert [each.done for each in told] == sorted(each.done for each in told)
    assert told[-1].done == 6
    assert any(each.now for each in told)
    assert not told[-1].now


def test_the_plan_is_frozen_and_its_repr_is_the_report(tmp_path):
    plan = sweep(slowly).plan(tmp_path / "areas.nc")
    text = repr(plan)
    expected = "to do           6"
    for part in ("areas", "x 3 x y 2", "points          6", "distinct        6", expected):
        assert part in text
    with pytest.raises(AttributeError):
        plan.points = 7
    assert not list(tmp_path.iterdir())


def test_timing_survives_a_function_that_fails():
    def broken(points):
        raise RuntimeError("no")

    plan = Sweep("broken", broken, Grid({"x": X}), {"y": Variable()}).plan()
    for each in (plan, plan.timed()):
        assert np.isnan(each.seconds)
        assert "unknown" in repr(each)
    assert np.all(plan.run()["status"] == 2)


def test_the_file_says_what_it_is(tmp_path):
    path = tmp_path / "deep" / "areas.nc"
    written = sweep(title="Areas").plan(path).run()
    with xr.open_dataset(path) as data:
        xr.testing.assert_equal(data.load(), written)
        assert data.attrs["Conventions"] == "CF-1.11"
        assert data.attrs["title"] == "Areas"
        assert data.attrs["source"].startswith("fiv ")
        assert json.loads(data.attrs["configuration"]) == {
            "name": "areas",
            "axes": {"x": [0.5, 1.0, 2.0], "y": [3, 4]},
            "constants": {"factor": 2.0},
        }
        assert data["x"].attrs == {"units": "m", "long_name": "length"}
        assert data["area"].attrs["units"] == "m s"
        assert data["status"].attrs["flag_meanings"].split() == ["pending", "done", "failed", "skipped"]
        assert data["status"].dtype == data["status"].attrs["flag_values"].dtype == np.int8
        for name in data.coords:
            assert "_FillValue" not in data[name].encoding
    xr.testing.assert_equal(open_results(path), written)
    assert [p.name for p in path.parent.iterdir()] == ["areas.nc"]


def test_derived_variables_are_stored_with_the_rest(tmp_path):
    def total(data):
        return data.assign(total=((), float(data["area"].sum()), {"units": "m s"}))

    path = tmp_path / "areas.nc"
    sweep(derive=total).plan(path).run()
    assert float(open_results(path)["total"]) == 2.0 * 3.5 * 7.0


def test_a_file_of_another_sweep_is_not_touched(tmp_path):
    path = tmp_path / "areas.nc"
    Sweep("others", lambda p: {"y": p["x"]}, Grid({"x": X}), {"y": Variable()}).plan(path).run()
    before = path.read_bytes()
    with pytest.raises(StoreError, match="holds the results of others; the results of areas need another folder"):
        sweep().plan(path).run()
    path.with_name("text.nc").write_text("no netCDF")
    with pytest.raises(StoreError, match="is damaged or not netCDF"):
        sweep().plan(path.with_name("text.nc")).run()
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(tmp_path / "plain.nc")
    with pytest.raises(StoreError, match="was not made by a sweep"):
        sweep().plan(tmp_path / "plain.nc").run()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(StoreError, match="is a link to nothing"):
        sweep().plan(tmp_path / "link" / "areas.nc").run()
    with pytest.raises(StoreError, match="cannot be used"):
        sweep().plan(tmp_path / ("long" * 100) / "areas.nc").run()
    with pytest.raises(StoreError, match="is a folder"):
        sweep().plan(tmp_path).run()
    assert path.read_bytes() == before


def test_an_interrupted_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "areas.nc"
    sweep().plan(path).run()
    before = path.read_bytes()
    grown = sweep(grid=Grid({"x": Axis([0.5, 1.0, 2.0, 3.0], "m", "length"), "y": Y}))

    for problem in (OSError(28, "No space left on device"), RuntimeError("NetCDF: HDF error")):

        def full(self, name, problem=problem, **options):
            name.write_bytes(b"half")
            raise problem

        monkeypatch.setattr(xr.Dataset, "to_netcdf", full)
        with pytest.raises(StoreError, match=r"could not be written: (No space|NetCDF)"):
            grown.plan(path).run()
        assert path.read_bytes() == before
        assert sorted(p.name for p in tmp_path.iterdir()) == ["areas.nc", "areas.parts"]
    monkeypatch.undo()
    # Nothing is lost: the same run only writes what has been computed.
    again = grown.plan(path)
    assert again.todo == 0
    np.testing.assert_array_equal(again.run()["area"], grown.plan().run()["area"])


def test_opening_says_what_is_wrong(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no such file"):
        open_results(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("no netCDF")
    with pytest.raises(ValueError, match="it is damaged or not netCDF"):
        open_results(tmp_path / "text.nc")
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(tmp_path / "plain.nc")
    with pytest.raises(ValueError, match="it is not the result of a sweep"):
        open_results(tmp_path / "plain.nc")
