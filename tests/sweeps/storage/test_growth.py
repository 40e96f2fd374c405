"""What is stored is not computed again: growth, retried failures; what somebody else has stored is refused."""

from zlib import crc32

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sweeps import Axis, Grid, InputError, StoreError, Sweep, Variable, open_results, status
from sweeps.storage.store import TRAILER
from tests.helpers.waves import BROKEN, GRID, LOG, NAMES, POWERS, VARIABLES, interrupted, sweep, wave

pytestmark = pytest.mark.usefixtures("small_pieces")


GROWTH = {
    "at both ends": ([1.0, 2.0], [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0]),
    "descending": ([3.0, 2.0], [4.0, 3.0, 1.0], [4.0, 3.0, 2.0, 1.0]),
    "nothing new, another order": ([1.0, 2.0, 3.0], [3.0, 1.0], [1.0, 2.0, 3.0]),
    "unsorted": ([2.0, 1.0, 3.0], [3.0, 0.0, 2.0], [2.0, 1.0, 3.0, 0.0]),
    "texts": (["b", "a"], ["a", "long", "µ", ""], ["b", "a", "long", "µ", ""]),
    "integers, then fractions": ([1, 2], [1.5, 2.0], [1.0, 1.5, 2.0]),
    "flags": ([True], [False, True], [False, True]),
    "single precision, then double": (np.float32([0.1, 0.3]), [0.1, 0.2], [0.1, 0.2, 0.3]),
    "rounding errors": ([0.1, 0.3], [0.1 + 0.2, 0.7], [0.1, 0.3, 0.7]),
}


CASES = [(case, False) for case in GROWTH] + [("descending", True), ("texts", True), ("rounding errors", True)]


@pytest.mark.parametrize(("case", "unfinished"), CASES)
def test_axes_grow_and_what_is_there_is_used(path, case, unfinished):
    """Also of a run that was interrupted, and in another order."""
    before, requested, union = GROWTH[case]

    def along(values):
        return sweep({"x": values, "y": [1.0, 4.0, 6.0, 7.0]})

    if unfinished:
        interrupted(along(before).plan(path), 3)
    else:
        along(before).plan(path).run()
    first, there = open_results(path).load(), set(LOG)
    LOG.clear()
    found = along(requested).plan(path).run("sync")
    assert len(LOG) == len(set(LOG))
    assert not set(LOG) & there
    along(union).plan(path).run()
    whole, names = open_results(path), [*NAMES, "wall_time"]
    assert whole["x"].values.tolist() == np.asarray(union).tolist()
    assert unfinished or len(whole.attrs["history"].splitlines()) > (len(union) > len(before))
    xr.testing.assert_equal(whole[NAMES], along(union).plan().run()[NAMES])
    places = [whole["x"].values.tolist().index(x) for x in first["x"].values.tolist()]
    xr.testing.assert_equal(whole.isel(x=places)[names].where(first["status"] == 1, first[names]), first[names])
    places = [whole["x"].values.tolist().index(x) for x in found["x"].values.tolist()]
    xr.testing.assert_equal(found[names], whole.isel(x=places)[names])


def test_rows_of_a_table_grow_in_any_precision(path):
    """As before, and the rows are found that are there."""
    for kind, times in ((float, [0.1, 0.2, 0.3]), (np.float32, [0.1, 0.2]), (np.longdouble, [0.1, 0.2, 0.3, 0.7])):
        LOG.clear()
        table = pd.DataFrame({"x": np.array(times, kind), "y": np.ones(len(times), np.float16)})
        table.index.name = "case"
        data = sweep(Grid.of(table)).plan(path).run("sync")
        assert data["x"].values.tolist() == times
        np.testing.assert_allclose(data["root"], np.sqrt((np.arange(len(times)) + 1.0) * (data["x"] + 1.0) * 2.0))
        assert len(LOG) == {float: 3, np.float32: 0, np.longdouble: 1}[kind]


def earlier(path):
    """Make the file what earlier versions wrote: an axis in single precision, and a checksum at its end."""
    with xr.open_dataset(path, mask_and_scale=False) as data:
        data.load()
    data["failure_x"] = data["failure_x"].astype("f4")
    data.assign_coords(x=data["x"].astype("f4")).to_netcdf(path)
    path.write_bytes((content := path.read_bytes()) + TRAILER + b"%08x" % crc32(content))


def test_a_file_of_an_earlier_version_opens_and_grows_without_loss(path):
    grids = [{"x": values, "y": [1.0]} for values in ([0.1, 0.2, 0.3], [0.1, 0.2, 0.3, 0.5])]
    BROKEN["points"] = {(0.2, 1.0)}
    first = sweep(grids[0]).plan(path).run("sync").load()
    earlier(path)
    assert open_results(path)["x"].values.tolist() == [0.1, 0.2, 0.3]
    xr.testing.assert_equal(sweep(grids[0]).plan(path).run(), first)
    good = path.read_bytes()
    for byte in (good.index(b"history"), len(good) - 12, len(good) - 1):
        path.write_bytes(good[:byte] + bytes([good[byte] ^ 1]) + good[byte + 1 :])
        for attempt in (lambda: open_results(path), lambda: sweep(grids[1]).plan(path).run("sync")):
            with pytest.raises((InputError, StoreError), match=r"sweep.nc.* damaged"):
                attempt()
    path.write_bytes(good)
    LOG.clear()
    grown = sweep(grids[1]).plan(path).run("sync")
    assert LOG == [(0.5, 1.0)]
    xr.testing.assert_equal(grown.isel(x=slice(3))[[*NAMES, "error"]], first[[*NAMES, "error"]])
    assert grown["traceback"].values.tolist() == first["traceback"].values.tolist()
    assert TRAILER not in path.read_bytes()


def test_runs_along_a_diagonal_leave_an_incomplete_file(path):
    for value in (1.0, 2.0, 3.0):
        sweep({"x": [value], "y": [value]}).plan(path).run()
    found, whole = status(path), open_results(path)
    assert (found.state, found.points, found.done, found.pending) == ("incomplete", 9, 3, 6)
    assert whole["status"].values.tolist() == np.eye(3).tolist()
    assert np.array_equal(np.isnan(whole["root"]), whole["status"] == 0)
    LOG.clear()
    sweep({"x": [1.0, 2.0, 3.0], "y": [1.0, 2.0, 3.0]}).plan(path).run()
    assert len(LOG) == 6
    assert status(path).state == "complete"


def test_other_points_may_be_skipped_later(path):
    def skipping(limit):
        grid = Grid({name: Axis(values, "m") for name, values in GRID.items()}, skip=lambda p: p["x"] > limit)
        LOG.clear()
        return sweep(grid).plan(path).run()["status"].values.tolist(), {x for x, _ in LOG}

    assert skipping(1.5) == ([[1, 1], [3, 3], [3, 3]], {1.0})
    assert skipping(2.5) == ([[1, 1], [1, 1], [3, 3]], {2.0})
    assert skipping(0.5) == ([[1, 1], [1, 1], [3, 3]], set())  # a result that is there stays
    BROKEN["points"] = {(3.0, 1.0)}
    assert skipping(9.0) == ([[1, 1], [1, 1], [2, 1]], {3.0})
    assert skipping(2.5) == ([[1, 1], [1, 1], [3, 1]], set())


def test_failures_are_kept_until_they_are_retried(path):
    BROKEN["points"] = {(1.0, 1.0), (2.0, 3.0)}
    first = sweep().plan(path).run()
    plan = sweep().plan(path)
    assert (plan.todo, plan.failed, first.sizes["failure"]) == (0, 2, 2)
    xr.testing.assert_identical(plan.run(), first)
    LOG.clear()
    BROKEN["points"] = {(2.0, 3.0)}  # one persists
    found = sweep().plan(path, retry_failed=True).run()
    assert set(LOG) == {(1.0, 1.0), (2.0, 3.0)}
    assert found["status"].values.tolist() == [[1, 1], [1, 2], [1, 1]]
    assert (found["failure_x"].item(), found["failure_y"].item()) == (2.0, 3.0)
    assert (found["error"].values[0, 0], found["root"].values[0, 0]) == ("", 2.0)
    BROKEN["points"] = set()
    assert "traceback" not in sweep().plan(path, retry_failed=True).run()


def test_failures_keep_reason_and_traceback_through_interruptions_and_growth(path):
    """With texts of any length and alphabet as axis and key."""

    def texts(*kinds):
        return sweep({"kind": list(kinds), "y": [1.0, 2.0]}, key=lambda points: points["kind"])

    BROKEN["points"] = {("µm", 1.0)}
    interrupted(texts("b", "µm", "", "z").plan(path), 3)
    first = texts("b", "µm", "", "z").plan(path).run()
    assert len(set(LOG)) == 4
    assert first["status"].values.tolist() == [[1, 1], [2, 2], [1, 1], [1, 1]]
    assert first["failure_kind"].values.tolist() == ["µm"]
    assert "ValueError: no result" in first["error"].values[1, 0]
    assert "in wave" in first["traceback"].item()
    LOG.clear()
    grown = texts("", "b", "long and longer", "µm").plan(path).run()
    assert LOG == [("long and longer", 1.0)]
    for name in ("failure_kind", "traceback", "reproduce"):
        assert grown[name].values.tolist() == first[name].values.tolist()
    assert grown["error"].values[3].tolist() == first["error"].values[1].tolist()
    xr.testing.assert_equal(grown["root"].isel(kind=[1, 3, 0]), first["root"].isel(kind=slice(3)))


def test_starting_over_mixes_nothing(path):
    sweep().plan(path).run()
    doubled = sweep(constants={"factor": 2.0})
    before = path.read_bytes()
    interrupted(doubled.plan(path, fresh=True), 3)
    assert path.read_bytes() == before
    assert np.count_nonzero(open_results(path)["status"] == 1) == 3
    with pytest.raises(StoreError, match=r"factor = 2.0 there, nothing here"):
        sweep().plan(path)
    LOG.clear()
    found = doubled.plan(path).run()
    assert len(LOG) == 3
    xr.testing.assert_equal(found[NAMES], doubled.plan().run()[NAMES])
    # Points of the same configuration are computed again, too; a failure does not get the result of the old file.
    BROKEN["points"] = {(1.0, 1.0)}
    interrupted(doubled.plan(path, fresh=True), 3)
    found = doubled.plan(path).run()
    assert found["status"].values.tolist() == [[2, 1], [1, 1], [1, 1]]


def files(folder):
    return {each: each.read_bytes() for each in folder.rglob("*") if each.is_file()}


def test_names_and_derived_variables_may_change(path):
    old = sweep().plan(path).run()
    LOG.clear()
    axes = {"x": Axis(GRID["x"], "m", "width"), "y": Axis(GRID["y"], "m")}
    changes = {"title": "Waves", "derive": lambda data: data.assign(top=data["root"].max())}
    changes |= {"remark": "again", "request": {"a": 1}}
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
        ("others.nc", "has the results of others; the results of waves need another path", ""),
        ("half.nc", "has the results of others; the results of waves need another path", ""),
        ("text.nc", "is damaged or not netCDF", "is damaged or not netCDF"),
        ("plain.nc", "was not made by a sweep", "it is not the result of a sweep"),
        (f"{'long' * 100}/waves.nc", "cannot be used", ""),
        (".", "is a folder", "is not a regular file"),
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


@pytest.mark.parametrize("put", [lambda parts: parts.write_text("mine"), lambda parts: parts.symlink_to("none")])
def test_what_is_no_folder_in_the_place_of_the_parts_is_refused_before_anything_is_computed(path, put):
    put(path.with_name(f"{path.name}.parts"))
    with pytest.raises(StoreError, match=r"parts is in the way, for it is no folder; remove it, or"):
        sweep().plan(path)
    assert not LOG
