"""Stores that hold something else, or are damaged, are refused in one line and stay as they are."""

import dataclasses

import netCDF4
import numpy as np
import pytest
import xarray as xr

from sweeps import Axis, Grid, StoreError, Sweep, Variable, open_results
from tests.helpers.waves import GRID, LOG, NAMES, VARIABLES, interrupted, product, sweep, wave

pytestmark = pytest.mark.usefixtures("small_pieces")


@dataclasses.dataclass(frozen=True)
class Beam:
    length: float = 0.05


@dataclasses.dataclass(frozen=True)
class Rig:
    p1: Beam = Beam()
    p2: Beam = Beam(0.1)


def coarse(points, factor=1.0, rig=None):
    return wave(points, factor, rig)


MIXED = Grid({"x": Axis(GRID["x"], "m"), "y": Axis(GRID["y"], "mm")})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"constants": {"factor": 2.0}}, "factor = 1.0 there, 2.0 here"),
        (
            {"constants": {"factor": 1.0}},
            'rig = {"p1": {"length": 0.05}, "p2": {"length": 0.1}} there, nothing here',
        ),
        ({"constants": {"factor": 1.0, "rig": Rig(Beam(0.06))}}, "rig.p1.length = 0.05 there, 0.06 here"),
        ({"grid": MIXED}, 'axes y.units = "m" there, "mm" here'),
        ({"grid": {"x": ["a"], "y": [1.0]}}, "axes x.text = false there, true here"),
        ({"grid": {"x": [1.0]}}, 'axes y = {"units": "m", "text": false} there, nothing here'),
        (
            {"grid": Grid({name: Axis([1.0], "m") for name in "xy"}, zipped=("x", "y"))},
            'groups = [["x"], ["y"]] there, [["x", "y"]] here',
        ),
        ({"variables": VARIABLES | {"root": Variable("m", dtype="float32")}}, 'variables root.dtype = "float64"'),
        (
            {"variables": VARIABLES | {"root": Variable("m", digits=3)}},
            "variables root.digits = null there, 3 here",
        ),
        ({"variables": VARIABLES | {"root": Variable("m", dims=("power",))}}, "variables root.dims = [] there"),
        (
            {"variables": VARIABLES | {"root": Variable("m", scale="s")}, "scale": lambda p: {"s": p["x"]}},
            'variables root.scale = "" there, "s" here',
        ),
        ({"coords": {"power": Axis([1, 2, 4])}}, "coords power = "),
        ({"function": coarse}, "the code of tests."),
        ({"key": product}, "the code of tests."),
    ],
)
def test_other_configurations_are_refused_and_named(path, tmp_path, changes, said):
    base = {"constants": {"factor": 1.0, "rig": Rig()}}
    for unfinished in (True, False):
        if unfinished:
            interrupted(sweep(**base).plan(path), 2)
        else:
            sweep(**base).plan(path).run()
        before = {p.name: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
        LOG.clear()
        with pytest.raises(StoreError) as caught:
            sweep(**(base | changes)).plan(path)
        assert said in str(caught.value)
        assert "start over with fresh (--fresh)" in str(caught.value)
        assert "\n" not in str(caught.value)
        assert LOG == []
        assert {p.name: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_names_and_derived_figures_may_change(path):
    old = sweep().plan(path).run()
    LOG.clear()
    axes = {"x": Axis(GRID["x"], "m", "width"), "y": Axis(GRID["y"], "m")}
    named = VARIABLES | {"root": Variable("m", "square root")}
    changed = sweep(
        Grid(axes), variables=named, title="Waves", derive=lambda data: data.assign(top=data["root"].max())
    )
    planned = changed.plan(path)
    assert planned.todo == 0
    found = planned.run()
    assert LOG == []
    assert found.attrs["title"] == "Waves"
    assert found["x"].attrs["long_name"] == "width"
    assert found["root"].attrs["long_name"] == "square root"
    assert float(found["top"]) == float(old["root"].max())
    xr.testing.assert_equal(found[[*NAMES, "wall_time", "status"]], old[[*NAMES, "wall_time", "status"]])
    xr.testing.assert_identical(open_results(path), found)


def test_files_that_are_none_of_this_sweeps_are_refused_and_stay(path, tmp_path):
    Sweep("others", lambda p: {"y": p["x"]}, Grid({"x": Axis([1.0])}), {"y": Variable()}).plan(path).run()
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


def test_damaged_files_are_refused(path, tmp_path):
    sweep().plan(path).run()
    good = path.read_bytes()
    grown = sweep({"x": [1.0, 2.0, 3.0, 4.0], "y": [1.0, 3.0]})
    for content in (good[: len(good) // 2], good[:10], b"", b"no netCDF" * 100):
        path.write_bytes(content)
        for planned in (sweep(), grown):
            with pytest.raises(StoreError, match=r"sweep.nc is damaged"):
                planned.plan(path).run()
        with pytest.raises(ValueError, match=r"sweep.nc: it is damaged"):
            open_results(path)
        assert path.read_bytes() == content
        assert not (tmp_path / "sweep.parts").exists()
    path.write_bytes(good)
    with netCDF4.Dataset(path, "a") as file:
        file.delncattr("identity")
    before = path.read_bytes()
    with pytest.raises(StoreError, match="does not say what made it; start over with fresh"):
        sweep().plan(path)
    assert path.read_bytes() == before
    with netCDF4.Dataset(path, "a") as file:
        file.identity = "[1]"
    with pytest.raises(StoreError, match="does not say what made it; start over with fresh"):
        sweep().plan(path)
    assert np.all(sweep().plan(path, fresh=True).run()["status"] == 1)


def test_damaged_values_are_noticed(tmp_path):
    """Check sums of the chunks: wrong values are never passed on."""
    path, noise = tmp_path / "waves.nc", np.random.default_rng(1).random((5, 10_000))

    def random(count):
        variables, coords = {"y": Variable(dims=("k",))}, {"k": Axis(np.arange(10_000))}
        grid = Grid({"x": Axis(np.arange(count))})
        return Sweep("waves", lambda p: {"y": noise[p["x"]]}, grid, variables, coords=coords)

    random(4).plan(path).run()
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF  # noise does not shrink, so this is in the midst of it
    path.write_bytes(content)
    for count in (4, 5):
        with pytest.raises(StoreError, match=r"waves.nc.* damaged"):
            random(count).plan(path).run()
        assert path.read_bytes() == content


@pytest.mark.parametrize("fresh", [False, True])
def test_a_link_in_the_place_of_the_parts_is_refused_and_not_followed(path, tmp_path, fresh):
    """Whoever made it: what it leads to is not ours to remove."""
    other = tmp_path / "elsewhere" / "waves.nc"
    interrupted(sweep().plan(other), 2)
    (other.with_suffix(".parts") / "notes.txt").write_text("mine")
    before = {each: each.read_bytes() for each in other.parent.rglob("*") if each.is_file()}
    plan = sweep().plan(path, fresh=fresh)
    path.with_suffix(".parts").symlink_to(other.with_suffix(".parts"))
    for attempt in (lambda: sweep().plan(path, fresh=fresh), plan.run):
        with pytest.raises(StoreError, match=r"sweep\.parts is a link, .*; remove it, or choose another folder$"):
            attempt()
    assert {each: each.read_bytes() for each in other.parent.rglob("*") if each.is_file()} == before
    assert not path.exists()


@pytest.mark.parametrize("fresh", [False, True])
def test_a_folder_in_the_place_of_the_parts_that_no_run_has_left(path, fresh):
    """What is in it stays."""
    parts = path.with_suffix(".parts")
    sweep().plan(path).run()
    plan = sweep({"x": [1.0, 2.0, 7.0], "y": [1.0]}).plan(path, fresh=fresh)
    (parts / "data").mkdir(parents=True)
    (parts / "data" / "notes.txt").write_text("mine")
    for attempt in (lambda: sweep().plan(path, fresh=fresh), plan.run):
        with pytest.raises(StoreError, match=r"sweep\.parts holds data, which no run has left; move it away, or "):
            attempt()
    assert (parts / "data" / "notes.txt").read_text() == "mine"
    (parts / "data").rename(path.with_name("elsewhere"))
    plan.run()
    assert open_results(path).sizes["x"] == (3 if fresh else 4)
    assert not parts.exists()


def test_a_link_in_the_place_of_the_lock_is_not_followed(path, tmp_path):
    plan = sweep().plan(path)
    path.with_name(".sweep.nc.lock").symlink_to(tmp_path / "elsewhere")
    for attempt in (lambda: sweep().plan(path), plan.run):
        with pytest.raises(StoreError, match=r"\.sweep\.nc\.lock is a link, where a file of its own is needed; "):
            attempt()
    assert not (tmp_path / "elsewhere").exists()
