"""What is stored is not computed again: runs that go on, grids that grow, failures that are retried, copies."""

import numpy as np
import pytest
import xarray as xr

from sweeps import Axis, Grid, StoreError, Sweep, Variable, open_results, status
from sweeps.storage.assemble import FileSource
from tests.helpers.waves import BROKEN, GRID, LOG, NAMES, interrupted, sweep

pytestmark = pytest.mark.usefixtures("small_pieces")


def test_an_interrupted_run_goes_on_and_a_complete_file_is_not_touched(path):
    interrupted(sweep().plan(path), 3)
    done, partly = set(LOG), open_results(path)
    LOG.clear()
    np.testing.assert_array_equal(np.isnan(partly["root"]), partly["status"] == 0)
    found = sweep().plan(path).run()
    assert set(LOG) == {(x, y) for x in GRID["x"] for y in GRID["y"]} - done
    xr.testing.assert_equal(found[NAMES], sweep().plan().run()[NAMES])
    before = path.read_bytes(), path.stat().st_mtime_ns
    xr.testing.assert_identical(sweep().plan(path).run(), found)
    assert (path.read_bytes(), path.stat().st_mtime_ns) == before
    assert sorted(each.name for each in path.parent.iterdir()) == [".sweep.nc.lock", "sweep.nc"]


GROWTH = {
    "at both ends": ([1.0, 2.0], [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0]),
    "in between": ([1.0, 3.0], [2.0], [1.0, 2.0, 3.0]),
    "descending": ([3.0, 2.0], [4.0, 3.0, 1.0], [4.0, 3.0, 2.0, 1.0]),
    "nothing new, another order": ([1.0, 2.0, 3.0], [3.0, 1.0], [1.0, 2.0, 3.0]),
    "unsorted": ([2.0, 1.0, 3.0], [3.0, 0.0, 2.0], [2.0, 1.0, 3.0, 0.0]),
    "texts": (["b", "a"], ["a", "long", "µ", ""], ["b", "a", "long", "µ", ""]),
    "integers, then fractions": ([1, 2], [1.5, 2.0], [1.0, 1.5, 2.0]),
    "fractions, then integers": ([0.5, 1.0], [1, 2], [0.5, 1.0, 2.0]),
    "flags": ([True], [False, True], [False, True]),
    "single precision": (np.float32([0.1, 0.3]), np.float32([0.1, 0.2]), np.float32([0.1, 0.2, 0.3])),
    "rounding errors": ([0.1, 0.3], [0.1 + 0.2, 0.7], [0.1, 0.3, 0.7]),
}


@pytest.mark.parametrize("unfinished", [False, True])
@pytest.mark.parametrize("case", GROWTH)
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
    xr.testing.assert_equal(found[NAMES], along(requested).plan().run()[NAMES])
    along(union).plan(path).run()
    whole = open_results(path)
    assert whole["x"].values.tolist() == np.asarray(union).tolist()
    xr.testing.assert_equal(whole[NAMES], along(union).plan().run()[NAMES])
    places = [whole["x"].values.tolist().index(x) for x in first["x"].values.tolist()]
    same = whole.isel(x=places)[[*NAMES, "wall_time"]].where(first["status"] == 1)
    xr.testing.assert_equal(same, first[[*NAMES, "wall_time"]])


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


def test_zipped_axes_grow_together(path):
    def pairs(x, y):
        return sweep(Grid({"x": Axis(x), "k": Axis([1, 2]), "y": Axis(y)}, zipped=("x", "y")))

    pairs([1.0, 2.0], [5.0, 5.0]).plan(path).run()
    LOG.clear()
    found = pairs([1.0, 2.0, 2.0], [5.0, 6.0, 5.0]).plan(path).run("sync")
    assert LOG == [(2.0, 1, 6.0), (2.0, 2, 6.0)]
    whole = open_results(path)
    assert list(zip(whole["x"].values, whole["y"].values, strict=True)) == [(1.0, 5.0), (2.0, 5.0), (2.0, 6.0)]
    xr.testing.assert_equal(found[NAMES], pairs([1.0, 2.0, 2.0], [5.0, 6.0, 5.0]).plan().run()[NAMES])


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


def loaded(points):
    LOG.extend(points["V"].tolist())
    return {"force": np.sin(points["V"] / points["F"])}


def loads(values, digits=None):
    """A sweep whose results are proportional to the load F at equal V / F."""
    return Sweep(
        "loads",
        loaded,
        {"V": Axis([1.0, 2.0, 4.0], "m/s"), "F": Axis(values, "N")},
        {"force": Variable("N", digits=digits, scale="load")},
        key=lambda points: points["V"] / points["F"],
        scale=lambda points: {"load": points["F"]},
    )


@pytest.mark.parametrize("digits", [None, 4])
@pytest.mark.parametrize("unfinished", [False, True])
def test_copies_of_what_is_there_are_added_without_computing(path, digits, unfinished):
    """In a finished file their values may differ by one rounding; those of its own points stay as they are."""
    first = loads([1.0, 2.0], digits).plan(path).run()
    if unfinished:
        interrupted(loads([1.0, 2.0, 64.0, 128.0], digits).plan(path), 3)
    LOG.clear()
    plan = loads([1.0, 2.0, 3.0, 6.0, 4.0], digits).plan(path)
    assert (plan.distinct, plan.todo) == (9, 5)  # V / F = 1/4, and 1/3, 2/3, 4/3, 1/6 of 3 and 6 N
    found = plan.run()
    assert len(LOG) == 5
    alone = loads([1.0, 2.0, 3.0, 6.0, 4.0], digits).plan().run()
    np.testing.assert_allclose(found["force"], alone["force"], rtol=1e-15 if digits is None else 10.0**-digits)
    xr.testing.assert_equal(found["force"].sel(F=[1.0, 2.0]), first["force"])


def test_a_reader_whose_file_is_replaced_meanwhile_sees_the_new_one(path, tmp_path, monkeypatch):
    """Its points have other places there, and the parts of the run that replaced it are not removed yet."""
    every = sweep({"x": np.arange(1.0, 7.0), "y": [1.0]})
    sweep({"x": [1.0, 3.0], "y": [1.0]}).plan(path).run("sync")
    whole = every.plan(tmp_path / "whole.nc").run("sync")
    interrupted(every.plan(path), 3)
    read = FileSource.read

    def late(self, *given):
        monkeypatch.setattr(FileSource, "read", read)
        (tmp_path / "whole.nc").rename(path)
        return read(self, *given)

    monkeypatch.setattr(FileSource, "read", late)
    assert open_results(path)[NAMES].equals(whole[NAMES])
