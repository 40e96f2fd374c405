"""Stored results: what is at hand is not computed again, what is interrupted goes on, what failed is kept."""

import numpy as np
import pytest
import xarray as xr

from sweeps import StoreError, Sweep, open_results
from tests.helpers.waves import BROKEN, GRID, LOG, NAMES, POWERS, VARIABLES, interrupted, sweep, wave

pytestmark = pytest.mark.usefixtures("small_pieces")


def test_an_interrupted_run_goes_on_and_what_is_complete_is_not_touched(path):
    interrupted(sweep().plan(path), 3)
    assert not path.exists()
    done = set(LOG)
    LOG.clear()
    partly = open_results(path)
    assert np.count_nonzero(partly["status"] == 1) == np.count_nonzero(partly["status"] == 0) == 3
    np.testing.assert_array_equal(np.isnan(partly["root"]), partly["status"] == 0)
    planned = sweep().plan(path)
    assert (planned.todo, planned.cached) == (3, 3)
    found = planned.run()
    assert len(LOG) == 3
    assert not done & set(LOG)
    xr.testing.assert_equal(found[NAMES], sweep().plan().run()[NAMES])
    np.testing.assert_array_equal(partly["root"].where(partly["status"] == 1, 0), found["root"] * partly["status"])
    LOG.clear()
    before, marks = path.read_bytes(), path.stat()
    planned = sweep().plan(path)
    assert (planned.todo, planned.cached) == (0, 6)
    xr.testing.assert_identical(planned.run(), found)
    assert LOG == []
    assert path.read_bytes() == before
    assert path.stat().st_mtime_ns == marks.st_mtime_ns
    assert list(path.parent.iterdir()) == [path]


def test_failures_are_kept_until_they_are_retried(path):
    BROKEN["points"] = {(1.0, 1.0), (2.0, 3.0)}
    first = sweep().plan(path).run()
    assert np.count_nonzero(first["status"] == 2) == first.sizes["failure"] == 2
    LOG.clear()
    planned = sweep().plan(path)
    assert (planned.todo, planned.failed) == (0, 2)
    assert "2 of them failed" in repr(planned)
    xr.testing.assert_identical(planned.run(), first)
    assert LOG == []
    # One persists, the other does not.
    BROKEN["points"] = {(2.0, 3.0)}
    retried = sweep().plan(path, retry_failed=True)
    assert (retried.todo, retried.failed) == (2, 0)
    found = retried.run()
    assert set(LOG) == {(1.0, 1.0), (2.0, 3.0)}
    assert found["failure_x"].values.tolist() == [2.0]
    assert found["failure_y"].values.tolist() == [3.0]
    assert found["status"].values.tolist() == [[1, 1], [1, 2], [1, 1]]
    assert found["error"].values[0, 0] == ""
    assert found["root"].values[0, 0] == 2.0
    BROKEN["points"] = set()
    found = sweep().plan(path, retry_failed=True).run()
    assert np.all(found["status"] == 1)
    assert "failure" not in found.dims
    assert "traceback" not in found


def test_an_unfinished_store_shows_what_is_finished(path):
    first = sweep().plan(path).run()
    before = path.read_bytes()
    interrupted(sweep({"x": [1.0, 2.0, 3.0, 4.0, 5.0], "y": [1.0, 3.0]}).plan(path), 2)
    assert path.read_bytes() == before
    partly = open_results(path)
    assert partly["x"].values.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    xr.testing.assert_equal(partly[NAMES].isel(x=slice(3)), first[NAMES])
    assert np.count_nonzero(partly["status"] == 1) == 8
    assert np.count_nonzero(partly["status"] == 0) == 2
    # Whoever asks for something else in between loses nothing.
    found = sweep({"x": [0.5], "y": [1.0]}).plan(path).run()
    assert float(found["root"][0, 0]) == np.sqrt(3.0)
    whole = open_results(path)
    assert np.count_nonzero(whole["status"] == 1) == 9
    xr.testing.assert_equal(whole[NAMES].sel(x=first["x"]), first[NAMES])


def test_starting_over_mixes_nothing(path):
    sweep().plan(path).run()
    doubled = sweep(constants={"factor": 2.0})
    before = path.read_bytes()
    interrupted(doubled.plan(path, fresh=True), 2)
    assert path.read_bytes() == before
    assert np.count_nonzero(open_results(path)["status"] == 1) == 2
    # Interrupted once more, as a run that goes on.
    interrupted(doubled.plan(path), 2)
    partly = open_results(path)
    assert np.count_nonzero(partly["status"] == 1) == 4
    with pytest.raises(StoreError, match=r"factor = 2.0 there, nothing here"):
        sweep().plan(path)
    LOG.clear()
    found = doubled.plan(path).run()
    assert len(LOG) == 2
    xr.testing.assert_equal(found[NAMES], doubled.plan().run()[NAMES])
    # The same configuration, too, is computed anew, and what failed at that is not what was there before.
    BROKEN["points"] = {(1.0, 1.0)}
    LOG.clear()
    interrupted(doubled.plan(path, fresh=True), 3)
    interrupted(doubled.plan(path), 1)
    found = doubled.plan(path).run()
    assert set(LOG) == {(x, y) for x in GRID["x"] for y in GRID["y"]}
    assert found["status"].values.tolist() == [[2, 1], [1, 1], [1, 1]]


def test_what_others_left_behind_is_not_taken_up(path):
    """Shards whose layout is gone or unreadable, and those of a sweep of another name."""
    interrupted(sweep().plan(path), 4)
    layout = path.with_name("sweep.parts") / "manifest"
    other = Sweep("others", wave, sweep().grid, VARIABLES, coords={"power": POWERS})
    for fresh in (False, True):
        with pytest.raises(StoreError, match="holds the results of waves; the results of others need another"):
            other.plan(path, fresh=fresh)
    layout.write_bytes(layout.read_bytes()[:100])
    BROKEN["points"] = {(x, y) for x in GRID["x"] for y in GRID["y"]}
    found = sweep().plan(path).run()
    assert np.all(found["status"] == 2)


def test_texts_as_axes_and_keys(path):
    """Of any length and alphabet, empty too; they fail, are interrupted, resumed and grown like numbers."""

    def texts(*kinds):
        return sweep({"kind": list(kinds), "y": [1.0, 2.0]}, key=lambda points: points["kind"])

    BROKEN["points"] = {("µm", 1.0)}
    interrupted(texts("b", "µm", "").plan(path), 2)
    first = texts("b", "µm", "").plan(path).run()
    assert len(LOG) == 3
    assert first["status"].values.tolist() == [[1, 1], [2, 2], [1, 1]]
    assert first["failure_kind"].values.tolist() == ["µm"]
    LOG.clear()
    grown = texts("", "b", "long and longer", "µm").plan(path).run()
    assert LOG == [("long and longer", 1.0)]
    assert grown["failure_kind"].values.tolist() == ["µm"]
    assert grown["traceback"].values.tolist() == first["traceback"].values.tolist()
    assert grown["error"].values[3].tolist() == first["error"].values[1].tolist()
    xr.testing.assert_equal(grown["root"].isel(kind=[1, 3, 0]), first["root"])
