"""Stores that have something else are refused in one line and stay as they are."""

import numpy as np
import pytest
import xarray as xr

from sweeps import Axis, Grid, StoreError, Sweep, Variable, open_results
from tests.helpers.waves import GRID, LOG, NAMES, POWERS, VARIABLES, interrupted, product, sweep, wave

pytestmark = pytest.mark.usefixtures("small_pieces")


def files(folder):
    return {each: each.read_bytes() for each in folder.rglob("*") if each.is_file()}


RIG = {"length": 0.05, "widths": [0.1, 0.2]}
ROUNDED = VARIABLES | {"root": Variable("m", digits=3)}
MIXED = Grid({"x": Axis(GRID["x"], "m"), "y": Axis(GRID["y"], "mm")})
ZIPPED = Grid({name: Axis([1.0], "m") for name in "xy"}, zipped=("x", "y"))


@pytest.mark.parametrize("unfinished", [True, False])
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"constants": {"factor": 2.0, "rig": RIG}}, "factor = 1.0 there, 2.0 here"),
        ({"constants": {"factor": 1.0}}, 'rig = {"length": 0.05, "widths": [0.1, 0.2]} there, nothing here'),
        ({"grid": MIXED}, 'axes y.units = "m" there, "mm" here'),
        ({"grid": {"x": ["a"], "y": [1.0]}}, "axes x.text = false there, true here"),
        ({"grid": ZIPPED}, 'groups = [["x"], ["y"]] there, [["x", "y"]] here'),
        ({"variables": ROUNDED}, "variables root.digits = null there, 3 here"),
        ({"coords": {"power": Axis([1, 2, 4])}}, "coords power = "),
        ({"function": lambda points, factor, rig: wave(points, factor)}, "code"),
        ({"key": product}, "code"),
    ],
)
def test_another_configuration_is_refused_and_named(path, tmp_path, changes, said, unfinished):
    base = {"constants": {"factor": 1.0, "rig": RIG}}
    if unfinished:
        interrupted(sweep(**base).plan(path), 3)
    else:
        sweep(**base).plan(path).run()
    before = files(tmp_path)
    LOG.clear()
    with pytest.raises(StoreError) as caught:
        sweep(**(base | changes)).plan(path)
    assert said in str(caught.value)
    assert "start over with fresh (--fresh)" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert LOG == []
    assert files(tmp_path) == before


def test_names_and_derived_variables_may_change(path):
    old = sweep().plan(path).run()
    LOG.clear()
    axes = {"x": Axis(GRID["x"], "m", "width"), "y": Axis(GRID["y"], "m")}
    changes = {"title": "Waves", "derive": lambda data: data.assign(top=data["root"].max())}
    changes["variables"] = VARIABLES | {"root": Variable("m", "square root")}
    found = sweep(Grid(axes), **changes).plan(path).run()
    assert LOG == []
    assert (found.attrs["title"], found["x"].attrs["long_name"]) == ("Waves", "width")
    assert (found["root"].attrs["long_name"], found["top"].item()) == ("square root", old["root"].max().item())
    xr.testing.assert_equal(found[[*NAMES, "wall_time", "status"]], old[[*NAMES, "wall_time", "status"]])
    xr.testing.assert_identical(open_results(path), found)


@pytest.mark.parametrize("fresh", [False, True])
@pytest.mark.parametrize(
    ("name", "said", "read"),
    [
        ("others.nc", "has the results of others; the results of waves need another folder", ""),
        ("half.nc", "has the results of others; the results of waves need another folder", ""),
        ("text.nc", "is damaged or not netCDF", "it is damaged or not netCDF"),
        ("plain.nc", "was not made by a sweep", "it is not the result of a sweep"),
        (f"{'long' * 100}/waves.nc", "cannot be used", ""),
        (".", "is a folder", "it is not a regular file"),
    ],
)
def test_files_of_others_are_refused_and_stay(tmp_path, name, said, read, fresh):
    others = Sweep("others", wave, sweep().grid, VARIABLES, coords={"power": POWERS})
    others.plan(tmp_path / "others.nc").run()
    interrupted(others.plan(tmp_path / "half.nc"), 3)
    (tmp_path / "text.nc").write_text("no netCDF")
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(tmp_path / "plain.nc")
    before = files(tmp_path)
    with pytest.raises(StoreError, match=said):
        sweep().plan(tmp_path / name, fresh=fresh).run()
    if read:
        with pytest.raises(ValueError, match=read):
            open_results(tmp_path / name)
    assert files(tmp_path) == before


@pytest.mark.parametrize("fresh", [False, True])
def test_a_folder_in_the_place_of_the_parts_that_no_run_made_stays(path, tmp_path, fresh):
    parts = path.with_name("sweep.nc.parts")
    plan = sweep().plan(path, fresh=fresh)
    parts.mkdir()
    (parts / "notes.txt").write_text("mine")
    for attempt in (lambda: sweep().plan(path, fresh=fresh), plan.run):
        with pytest.raises(StoreError, match=r"parts has notes\.txt, which is not a run's; move it away"):
            attempt()
    assert (parts / "notes.txt").read_text() == "mine"
    parts.rename(tmp_path / "elsewhere")
    assert np.all(plan.run()["status"] == 1)
