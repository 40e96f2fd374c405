"""The sweep engine on functions that have nothing to do with beams."""

import numpy as np
import pytest
import xarray as xr

from sweeps import Axis, Grid, StoreError, Sweep, Variable, open_results
from tests.helpers.waves import GRID, POWERS, sweep, wave

X = Axis([0.5, 1.0, 2.0], "m", "length")


def one(function, grid=None, variable=None, name="one", **changes):
    """A sweep of a single variable y along x."""
    return Sweep(name, function, grid or Grid({"x": X}), {"y": variable or Variable()}, **changes)


def test_dimensions_come_in_the_grids_order():
    data = sweep().plan().run()
    assert data["root"].dims == ("x", "y")
    assert data["row"].dims == ("x", "y", "power")
    np.testing.assert_array_equal(data["power"], POWERS.values)
    x, y = np.meshgrid(GRID["x"], GRID["y"], indexing="ij")
    np.testing.assert_array_equal(data["root"].values.ravel(), wave({"x": x.ravel(), "y": y.ravel()})["root"])
    assert np.all(data["status"] == 1)
    assert np.all(data["wall_time"] >= 0.0)


def test_zipped_axes_vary_together_along_the_first():
    grid = Grid({"x": X, "k": Axis([1, 2]), "y": Axis([10, 20, 30])}, zipped=("x", "y"))
    assert grid.dims == ("x", "k")
    assert grid.shape == (3, 2)
    data = Sweep("pairs", lambda p: {"sum": p["x"] + p["y"] + p["k"]}, grid, {"sum": Variable()}).plan().run()
    np.testing.assert_array_equal(data["sum"], np.add(X.values, [10, 20, 30])[:, None] + [1, 2])
    assert data["y"].dims == ("x",)


def test_skipped_points_are_not_computed():
    seen = []

    def once(points):
        seen.extend(points["x"].tolist())
        return {"y": 2.0 * points["x"]}

    plan = one(once, Grid({"x": X}, skip=lambda points: points["x"] > 1.5)).plan()
    assert (plan.points, plan.skipped, plan.distinct, plan.todo) == (3, 1, 2, 2)
    data = plan.run()
    assert 2.0 not in seen
    np.testing.assert_array_equal(data["y"], [1.0, 2.0, np.nan])
    np.testing.assert_array_equal(data["status"], [1, 1, 3])


def test_whole_numbers_and_their_gaps_survive_the_file(path):
    def double(points):
        if np.any(points["x"] == 1.0):
            raise ValueError("no")
        return {"y": np.where(points["x"] < 1.0, -1, 2.0 * points["x"]).astype(int)}

    data = one(double, variable=Variable("1", "number", dtype="int16")).plan(path).run()
    np.testing.assert_array_equal(data["y"], [-1.0, np.nan, 4.0])
    xr.testing.assert_equal(open_results(path), data)
    with xr.open_dataset(path, mask_and_scale=False) as raw:
        assert raw["y"].dtype == np.int16
        assert raw["y"].attrs["_FillValue"] == -32768
        assert raw["y"].values.tolist() == [-1, -32768, 4]


def test_what_was_computed_is_kept_if_nothing_can_be_derived(tmp_path):
    def broken(data):
        raise ArithmeticError("no")

    with pytest.raises(ArithmeticError, match="no"):
        sweep(derive=broken).plan(tmp_path / "waves.nc").run()
    assert np.all(open_results(tmp_path / "waves.nc")["status"] == 1)


def test_the_plan_is_frozen_and_its_repr_is_the_report(tmp_path):
    plan = sweep().plan(tmp_path / "waves.nc")
    for part in ("waves", "x 3 x y 2", "points          6", "distinct        6", "to do           6"):
        assert part in repr(plan)
    with pytest.raises(AttributeError, match="cannot assign"):
        plan.points = 7
    assert not list(tmp_path.iterdir())


def test_timing_survives_a_function_that_fails():
    def broken(points):
        raise RuntimeError("no")

    plan = one(broken).plan()
    for each in (plan, plan.timed()):
        assert np.isnan(each.seconds)
        assert "unknown" in repr(each)
    assert np.all(plan.run()["status"] == 2)


def test_files_that_are_none_of_this_sweeps_are_refused_and_stay(path, tmp_path):
    one(lambda p: {"y": p["x"]}, name="others").plan(path).run()
    before = path.read_bytes()
    (tmp_path / "text.nc").write_text("no netCDF")
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(tmp_path / "plain.nc")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name, said in {
        "sweep.nc": "holds the results of others; the results of waves need another folder",
        "text.nc": "is damaged or not netCDF",
        "plain.nc": "was not made by a sweep",
        "link/waves.nc": "is a link to nothing",
        f"{'long' * 100}/waves.nc": "cannot be used",
        ".": "is a folder",
    }.items():
        with pytest.raises(StoreError, match=said):
            sweep().plan(tmp_path / name).run()
    assert path.read_bytes() == before
    for name, problem, said in (
        ("none.nc", FileNotFoundError, "there is no such file"),
        ("text.nc", ValueError, "it is damaged or not netCDF"),
        ("plain.nc", ValueError, "it is not the result of a sweep"),
    ):
        with pytest.raises(problem, match=said):
            open_results(tmp_path / name)
