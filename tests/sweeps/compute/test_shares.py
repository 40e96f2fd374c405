"""Shares of a plan: computed by jobs of their own, killed, repeated, merged; the result is that of a whole run."""

import numpy as np
import pytest
import xarray as xr

from sweeps import (
    Grid,
    InputError,
    LockedError,
    MissingFileError,
    PendingWarning,
    Refinement,
    StoreError,
    open_results,
    refined,
    status,
)
from sweeps.storage.store import Store
from tests.helpers import waves
from tests.helpers.backends import assert_right, simple, visible
from tests.helpers.sweep_programs import end, make, start, wait_for

pytestmark = pytest.mark.usefixtures("small_pieces")


def same(one, other):
    xr.testing.assert_equal(*(each.drop_vars("wall_time").load() for each in (one, other)))


@pytest.mark.parametrize("apart", [False, True])
def test_shares_in_one_folder_or_in_several_become_the_file_of_a_whole_run(tmp_path, apart):
    files = [tmp_path / (str(k) if apart else "all") / "powers.nc" for k in range(1, 4)]
    computed = [make(points=20).plan(file).share(k, 3).run() for k, file in enumerate(files, 1)]
    assert np.count_nonzero(computed[-1]["status"]) == (6 if apart else 20)
    assert not any(file.exists() for file in files)
    merged = make(points=20).plan(tmp_path / "all" / "powers.nc").merge(*files)
    whole = make(points=20).plan(tmp_path / "whole.nc").run()
    same(merged, whole)
    assert visible(tmp_path / "all") == ["powers.nc"]
    assert merged.attrs["fingerprint"] == whole.attrs["fingerprint"]
    assert make(points=20).plan(tmp_path / "all" / "powers.nc").whole


def test_shares_are_of_distinct_computations_whatever_is_done_already(tmp_path):
    key = {"key": lambda points: points["x"] // 2.0, "grid": Grid({"x": np.arange(20.0)})}
    sweep = simple(lambda points: {"y": points["x"] // 2.0}, **key)
    one, other = tmp_path / "a.nc", tmp_path / "b.nc"
    simple(lambda points: {"y": points["x"] // 2.0}, **key | {"grid": Grid({"x": [19.0, 3.0]})}).plan(other).run()
    for k in (1, 2, 3):
        sweep.plan(one).share(k, 3).run()
        sweep.plan(other).share(k, 3).run()
    counts = [sweep.plan(one).share(k, 3).distinct for k in (1, 2, 3)]
    assert counts == [4, 3, 3]
    same(sweep.plan(one).merge(), sweep.plan(tmp_path / "c.nc").run())
    np.testing.assert_array_equal(sweep.plan(other).merge()["y"], np.arange(20) // 2)


def test_what_is_missing_is_named_pending_and_merged_later(path):
    make(points=10).plan(path).share(1, 4).run()
    make(points=10).plan(path).share(3, 4).run()
    assert (status(path).state, status(path).done) == ("interrupted", 5)
    with pytest.warns(PendingWarning, match=r"powers: missing shares: 2, 4 of 4; 5 of 10 computations are p"):
        data = make(points=10).plan(path).merge()
    np.testing.assert_array_equal(data["status"] == 0, np.arange(10) % 2)
    for k in (2, 4):
        make(points=10).plan(path).share(k, 4).run()
    assert_right(make(points=10).plan(path).merge())
    with pytest.raises(MissingFileError, match="no share of it has computed anything yet"):
        make(points=10).plan(path.with_name("other.nc")).merge()


def test_a_share_that_is_killed_goes_on_and_a_whole_run_takes_what_shares_have_done(path, tmp_path):
    log = tmp_path / "log"
    process = start(store=path, log=log, points=40, long=0.4, share=[2, 2])
    wait_for(process, "progress 6")
    share = Store(path, (2, 2))
    for attempt in (lambda plan: plan.run(), lambda plan: plan.merge(), lambda plan: plan.share(2, 2).run()):
        with pytest.raises(LockedError, match=rf"is being written by process {process.pid} on"):
            attempt(make(points=40, log=log, long=0.4).plan(path))
    assert status(path).state == "running"
    make(points=40, log=log, long=0.4).plan(path).share(1, 2).run(workers=20)  # another share is undisturbed
    end(process)
    assert not share.is_locked()
    before = log.read_text().split()
    assert len(before) < 40
    plan = make(points=40, log=log, long=0.4).plan(path)
    assert plan.share(1, 2).todo == 0
    plan.share(2, 2).run(workers=20)
    assert_right(make(points=40, log=log, long=0.4).plan(path).run())
    assert len(log.read_text().split()) - len(before) == plan.todo <= 14
    assert visible(path.parent) == [log.name, path.name]


def test_a_share_waits_for_no_whole_run(path):
    process = start(store=path, points=20, long=0.2)
    try:
        wait_for(process, "progress 3")
        with pytest.raises(LockedError, match=rf"is being written by process {process.pid} on"):
            make(points=20, long=0.2).plan(path).share(1, 2).run()
    finally:
        end(process)


def test_a_damaged_part_of_a_share_is_computed_again_and_left_out_by_a_merger(path):
    for k in (1, 2):
        make(points=10).plan(path).share(k, 2).run()
    share = Store(path, (2, 2))
    (share.parts / share.part_names()[0]).write_bytes(b"")
    plan = make(points=10).plan(path)
    assert plan.damaged == (share.part_names()[0],)
    assert plan.share(1, 2).todo == 0 < plan.share(2, 2).todo
    plan.share(2, 2).run()
    (share.parts / share.part_names()[-1]).write_bytes(b"")
    with pytest.warns(PendingWarning, match="missing shares: 2 of 2"):
        make(points=10).plan(path).merge()


@pytest.mark.parametrize("wrong", [(0, 2), (3, 2), (1.0, 2), ("1", 2), (True, 0)])
def test_a_wrong_share_is_refused(path, wrong):
    with pytest.raises(InputError, match=r"share = .* of .*: it must be K of N, integers with 1 <= K <= N"):
        make(points=4).plan(path).share(*wrong)


def test_what_has_no_shares(path):
    with pytest.raises(InputError, match="it needs a store"):
        make(points=4).plan().share(1, 2)
    with pytest.raises(InputError, match=r"^share: a refined sweep has no shares, .*; run it whole$"):
        refined(simple(lambda p: p, Grid({"x": np.arange(5.0)})), Refinement("y", 1)).plan(path).share(1, 2)
    with pytest.raises(InputError, match=r"^share: only a whole run starts over"):
        make(points=4).plan(path, fresh=True).share(1, 2)


def test_shares_of_other_settings_are_refused_and_a_fresh_run_removes_them(path):
    make(points=4).plan(path).share(1, 2).run()
    with pytest.raises(StoreError, match=r"1-of-2\.parts has other results: pause = 0.0 there, 0.5 here"):
        make(points=4, pause=0.5).plan(path)
    waves.interrupted(make(points=8, log="/dev/null").plan(path, fresh=True), 2)
    assert Store(path).shares() == []
    assert open_results(path).sizes["x"] == 8


def test_a_share_of_a_grid_that_grows_keeps_what_it_has(path):
    for points in (6, 10):
        for k in (1, 2):
            make(points=points).plan(path).share(k, 2).run()
    assert make(points=10).plan(path).todo == 0
    assert_right(make(points=10).plan(path).merge())
