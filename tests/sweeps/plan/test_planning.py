"""Plans: what they cost, that they compute nothing, and how batches are cut and sized."""

import math
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sweeps import Axis, Grid, Sweep, Variable
from sweeps.plan import batches
from sweeps.plan.batches import BatchSizes, Queue
from tests.helpers import waves

CALLS: list[int] = []


def counted(points):
    CALLS.append(len(points["x"]))
    return {"y": 2.0 * points["x"]}


def sweep(size, function=counted, **changes):
    side = round(math.sqrt(size))
    grid = Grid({"x": Axis(np.arange(float(side))), "z": Axis(np.arange(float(side)))})
    return Sweep("planned", function, grid, {"y": Variable()}, **changes)


def size_of_batch(left, seconds, workers=2, **limits):
    """How many points a batch holds once as many as one likes have taken `seconds` each."""
    sizes = BatchSizes(**limits)
    sizes.finished(1 << 40, seconds * (1 << 40))
    return sizes.next(left, workers)


def test_the_plan_is_frozen_and_its_repr_is_the_report(path):
    plan = waves.sweep().plan(path)
    for part in ("waves", "x 3 x y 2", "points          6", "distinct        6", "to do           6"):
        assert part in repr(plan)
    with pytest.raises(AttributeError, match="cannot assign"):
        plan.points = 7
    assert not list(path.parent.iterdir())


def test_timing_survives_a_function_that_fails():
    def broken(points):
        raise RuntimeError("no")

    plan = sweep(4, broken).plan()
    for each in (plan, plan.timed()):
        assert np.isnan(each.seconds)
        assert "unknown" in repr(each)
    assert np.all(plan.run()["status"] == 2)


def test_planning_calls_nobody(tmp_path):
    CALLS.clear()
    plan = sweep(100).plan(tmp_path / "p.nc")
    assert CALLS == []
    assert math.isnan(plan.seconds)
    assert "estimated time  unknown: no earlier run tells" in repr(plan)
    timed = plan.timed()
    assert 0 < sum(CALLS) < 100
    assert timed.seconds > 0.0
    assert (timed.todo, timed.points) == (plan.todo, plan.points)
    # What a few points have given is thrown away.
    CALLS.clear()
    timed.run("sync")
    assert sum(CALLS) == 100


def test_earlier_runs_tell_the_time(path):

    def slow(points):
        return {"y": points["x"], "wall_time": np.full(len(points["x"]), 0.5)}

    sweep(100, slow).plan(path).run("sync")
    plan = sweep(144, slow).plan(path)
    assert plan.todo == 44
    assert plan.seconds == pytest.approx(22.0)
    assert "estimated time  22 s on one core" in repr(plan)


def test_plans_take_no_time(path):
    for size, seconds in ((4, np.inf), (10_000, 0.1), (1_000_000, 1.0)):
        begin = time.process_time()
        assert sweep(size).plan(path).todo == size
        assert time.process_time() - begin < seconds


@pytest.mark.parametrize(
    ("changes", "most"),
    [({}, 20.0), ({"order_by": ("z",)}, 20.0), ({"key": lambda points: points["x"] * 0.0 + points["z"]}, 80.0)],
)
def test_a_plan_is_flags_and_no_more(changes, most):
    size = 1_000_000
    one = sweep(size, **changes)
    tracemalloc.start()
    try:
        plan = one.plan()
        queue = Queue(plan.manifest.grid, plan.due, one.order_by)
        while queue.left:
            queue.take(50_000)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak / size < most


@given(st.lists(st.integers(1, 7), min_size=1, max_size=3), st.data())
@settings(max_examples=60, deadline=None)
def test_a_queue_gives_every_point_once_and_in_order(shape, data):
    names = "abc"[: len(shape)]
    axes = {n: Axis(data.draw(st.permutations(range(k)))) for n, k in zip(names, shape, strict=True)}
    grid = Grid(axes)
    due = np.array(data.draw(st.lists(st.booleans(), min_size=grid.size, max_size=grid.size)))
    order_by = tuple(data.draw(st.lists(st.sampled_from(names), unique=True)))
    queue, taken = Queue(grid, due, order_by), []
    assert queue.left == np.count_nonzero(due)
    while queue.left:
        taken.append(queue.take(data.draw(st.integers(1, 9))))
    every = np.concatenate([np.zeros(0, dtype=int), *taken])
    assert sorted(every.tolist()) == np.flatnonzero(due).tolist()
    points = grid.points(every)
    rows = list(zip(*(points[name].tolist() for name in order_by), every.tolist(), strict=True))
    assert rows == sorted(rows)


def test_batches_grow_as_far_as_those_that_finished_allow(monkeypatch):
    sizes = BatchSizes(8.0, 1)
    assert sizes.next(10**6, 2) == 1
    # Two workers that had to compile first, then what a point costs.
    for seconds in (30.0, 30.0):
        sizes.finished(1, seconds)
        assert sizes.next(10**6, 2) == 1
    for _ in range(3):
        sizes.finished(1, 1e-3)
    found = []
    for _ in range(5):
        found.append(sizes.next(10**6, 2))
        sizes.finished(found[-1], 1e-3 * found[-1])
    assert found == [8, 64, 512, 1000, 1000]
    assert [size_of_batch(10**8, 1e-3, workers=workers) for workers in (2, 1000)] == [1000, 10_000]
    # A batch holds no more than fits into memory, and as many as are computed side by side.
    assert size_of_batch(10**6, 1e-3, row_bytes=batches.BATCH_BYTES / 10) == 10
    assert size_of_batch(10**6, 10.0, multiple=16) == 16
    assert size_of_batch(5, 10.0, multiple=16) == 5
    assert BatchSizes(multiple=16).next(10**6, 2) == 16


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


def test_the_first_batches_are_small_and_size_the_next():
    CALLS.clear()
    sweep(10_000).plan().run("sync")
    assert CALLS[0] == 1
    assert max(CALLS) > 1000
    assert sum(CALLS) == 10_000
    assert all(now <= batches.GROWTH * max(CALLS[:k]) for k, now in enumerate(CALLS) if k)
