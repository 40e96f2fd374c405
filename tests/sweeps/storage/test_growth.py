"""Grids that grow: what is asked besides is added to what is there, and nothing of that changes."""

import json
import tempfile
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from sweeps import Axis, Grid, open_results
from sweeps.plan import batches
from sweeps.storage.sources import FileSource
from tests.helpers.waves import BROKEN, LOG, NAMES, VARIABLES, interrupted, product, sweep, wave

pytestmark = pytest.mark.usefixtures("small_pieces")


@given(st.data())
@settings(max_examples=20, deadline=None)
def test_bits_do_not_depend_on_how_a_sweep_runs(data):
    """One function, any grid: whatever the threads, batches, order, store, pieces and key."""
    shape = data.draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
    grid = {"x": np.arange(1.0, shape[0] + 1) / 4, "y": np.arange(1.0, shape[1] + 1) / 4}
    together = data.draw(st.sampled_from([(), "x", ("y",), ("y", "x")]))
    key = data.draw(st.sampled_from([None, product]))
    run = data.draw(st.sampled_from([("sync", None), *(("threads", n) for n in (1, 2, 3, 4))]))
    sizes = {
        "BATCH_SECONDS": data.draw(st.sampled_from([1.0, 1e-5, 1e-9])),
        "BATCH_BYTES": data.draw(st.sampled_from([1.0, 200.0, 12e6])),
        "SHORTEST": data.draw(st.sampled_from([0.05, 1e-9])),
        "GROWTH": data.draw(st.sampled_from([2, 8, 1000])),
    }
    pieces = data.draw(st.lists(st.integers(1, shape[0]), max_size=2))
    with tempfile.TemporaryDirectory() as folder, mock.patch.multiple(batches, **sizes):
        store = Path(folder) / "waves.nc" if pieces or data.draw(st.booleans()) else None
        for count in pieces:
            part = grid | {"x": data.draw(st.permutations(grid["x"].tolist()))[:count]}
            sweep(part, order_by=together, key=key).plan(store).run(*run)
        found = sweep(grid, order_by=together, key=key).plan(store).run(*run)
    for name, values in wave(sweep(grid).grid.points()).items():
        expected = values.astype(VARIABLES[name].dtype).reshape(found[name].shape)
        assert found[name].values.tobytes() == expected.astype(found[name].dtype).tobytes()
    assert np.all(found["status"] == 1)


GROWTH = {
    "at both ends": ([1.0, 2.0], [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0]),
    "in between": ([1.0, 3.0], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
    "apart": ([1.0, 3.0], [2.0], [1.0, 2.0, 3.0]),
    "descending": ([3.0, 2.0], [4.0, 3.0, 1.0], [4.0, 3.0, 2.0, 1.0]),
    "nothing new, another order": ([1.0, 2.0, 3.0], [3.0, 1.0], [1.0, 2.0, 3.0]),
    "unsorted": ([2.0, 1.0, 3.0], [3.0, 0.0, 2.0], [2.0, 1.0, 3.0, 0.0]),
    "texts": (["b", "a"], ["a", "long", "µ"], ["b", "a", "long", "µ"]),
    "an empty text": (["a", "b"], ["", "b"], ["", "a", "b"]),
    "whole numbers": ([1, 3], [2, 3], [1, 2, 3]),
    "whole numbers, then fractions": ([1, 2], [1.5, 2.0], [1.0, 1.5, 2.0]),
    "fractions, then whole numbers": ([0.5, 1.0], [1, 2], [0.5, 1.0, 2.0]),
    "flags": ([True], [False, True], [False, True]),
    "single precision": (np.float32([0.1, 0.3]), np.float32([0.1, 0.2]), np.float32([0.1, 0.2, 0.3])),
}


@pytest.mark.parametrize("case", GROWTH)
def test_axes_grow(path, case):
    before, asked, union = GROWTH[case]
    old = sweep({"x": before, "y": [1.0, 4.0]}).plan(path).run()
    LOG.clear()
    found = sweep({"x": asked, "y": [1.0, 4.0]}).plan(path).run()
    new = np.setdiff1d(np.asarray(asked), np.asarray(before))
    assert {x for x, _ in LOG} == set(new.tolist())
    assert len(LOG) == 2 * len(new)
    assert found["x"].values.tolist() == np.asarray(asked).tolist()
    xr.testing.assert_equal(found[NAMES], sweep({"x": asked, "y": [1.0, 4.0]}).plan().run()[NAMES])
    whole = open_results(path)
    assert whole["x"].values.tolist() == np.asarray(union).tolist()
    xr.testing.assert_equal(whole[NAMES], sweep({"x": union, "y": [1.0, 4.0]}).plan().run()[NAMES])
    places = [union.index(x) for x in before] if isinstance(union, list) else np.searchsorted(union, before)
    xr.testing.assert_equal(whole.isel(x=places)[[*NAMES, "wall_time"]], old[[*NAMES, "wall_time"]])
    LOG.clear()
    assert sweep({"x": union, "y": [4.0, 1.0]}).plan(path).run()["x"].values.tolist() == list(union)
    assert LOG == []


def test_two_axes_that_grow_leave_holes(path):
    sweep({"x": [1.0, 2.0], "y": [1.0, 2.0]}).plan(path).run()
    LOG.clear()
    found = sweep({"x": [2.0, 3.0], "y": [2.0, 3.0]}).plan(path).run()
    assert len(LOG) == 3
    assert np.all(found["status"] == 1)
    whole = open_results(path)
    assert whole["status"].values.tolist() == [[1, 1, 0], [1, 1, 1], [0, 1, 1]]
    assert np.isnan(whole["root"].values[0, 2])
    LOG.clear()
    whole = sweep({"x": [1.0, 2.0, 3.0], "y": [1.0, 2.0, 3.0]}).plan(path).run()
    assert set(LOG) == {(1.0, 3.0), (3.0, 1.0)}
    assert np.all(whole["status"] == 1)
    assert json.loads(whole.attrs["configuration"])["axes"] == {"x": [1.0, 2.0, 3.0], "y": [1.0, 2.0, 3.0]}


def test_zipped_axes_grow_together(path):
    def pairs(x, y):
        return sweep(Grid({"x": Axis(x), "k": Axis([1, 2]), "y": Axis(y)}, zipped=("x", "y")))

    first = pairs([1.0, 2.0], [5.0, 5.0]).plan(path).run()
    assert (first["root"].dims, first["y"].dims) == (("x", "k"), ("x",))
    np.testing.assert_array_equal(first["count"], np.outer([12, 18], [2, 3]))
    LOG.clear()
    found = pairs([1.0, 2.0, 2.0], [5.0, 6.0, 5.0]).plan(path).run()
    assert sorted(LOG) == [(2.0, 1, 6.0), (2.0, 2, 6.0)]  # threads have no order
    assert found["y"].values.tolist() == [5.0, 6.0, 5.0]
    whole = open_results(path)
    assert list(zip(whole["x"].values, whole["y"].values, strict=True)) == [(1.0, 5.0), (2.0, 5.0), (2.0, 6.0)]
    xr.testing.assert_equal(found[NAMES], pairs([1.0, 2.0, 2.0], [5.0, 6.0, 5.0]).plan().run()[NAMES])


def skipping(limit):
    axes = {"x": Axis([1.0, 2.0, 3.0], "m"), "y": Axis([1.0, 3.0], "m")}
    return sweep(Grid(axes, skip=lambda points: points["x"] > limit))


def test_what_is_skipped_may_change(path):
    plan = skipping(1.5).plan(path)
    assert (plan.points, plan.skipped, plan.distinct, plan.todo) == (6, 4, 2, 2)
    assert plan.run()["status"].values.tolist() == [[1, 1], [3, 3], [3, 3]]
    LOG.clear()
    assert skipping(2.5).plan(path).run()["status"].values.tolist() == [[1, 1], [1, 1], [3, 3]]
    assert {x for x, _ in LOG} == {2.0}
    # What is at hand stays, though it would be skipped now.
    LOG.clear()
    assert skipping(0.5).plan(path).run()["status"].values.tolist() == [[1, 1], [1, 1], [3, 3]]
    assert LOG == []
    BROKEN["points"] = {(3.0, 1.0)}
    assert skipping(9.0).plan(path).run()["status"].values.tolist() == [[1, 1], [1, 1], [2, 1]]
    assert skipping(2.5).plan(path).run()["status"].values.tolist() == [[1, 1], [1, 1], [3, 1]]


def test_a_reader_whose_file_is_replaced_meanwhile_sees_the_new_one(path, tmp_path, monkeypatch):
    """Its points lie elsewhere there, and the parts of the run that replaced it are not removed yet."""
    few, all_of_them = {"x": [1.0, 3.0]}, {"x": [1.0, 2.0, 3.0, 4.0]}
    sweep(few).plan(path).run("sync")
    whole = sweep(all_of_them).plan(tmp_path / "whole.nc").run("sync")
    interrupted(sweep(all_of_them).plan(path), 1)
    read = FileSource.read

    def late(self, *arguments):
        (tmp_path / "whole.nc").rename(path)
        monkeypatch.setattr(FileSource, "read", read)
        return read(self, *arguments)

    monkeypatch.setattr(FileSource, "read", late)
    assert open_results(path)[NAMES].equals(whole[NAMES])
