"""Plans: they cost little, compute nothing and report; batches are cut and sized."""

import math
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.cli.execution import timed
from sweeps import Grid, Sweep
from sweeps.plan import batches
from sweeps.plan.batches import BatchSizes, Queue
from tests.helpers import waves
from tests.helpers.examples import examples
from tests.helpers.state import Log

CALLS = Log()


def counted(points):
    CALLS.append(len(points["x"]))
    return {"y": 2.0 * points["x"]}


def sweep(size, function=counted, **changes):
    side = np.arange(float(round(math.sqrt(size))))
    return Sweep("planned", function, {"x": side, "z": side}, ["y"], **changes)


def size_of_batch(left, seconds, workers=2, **limits):
    """Points of a batch after some that took `seconds` each."""
    sizes = BatchSizes(**limits)
    sizes.finished(1 << 40, seconds * (1 << 40))
    return sizes.next(left, workers)


def test_a_plan_is_frozen_and_its_repr_is_the_report(path):
    plan = waves.sweep(title="<Waves>").plan(path)
    for part in ("waves", "x 3 x y 2", "points          6", "distinct        6", "to do           6", str(path)):
        assert part in repr(plan)
    assert "\ndepends on      tests.helpers.state, tests.helpers.waves" in repr(plan)
    assert plan.covers[0].startswith("sweeps.")
    assert plan._repr_html_().startswith("<pre>sweep")
    with pytest.raises(AttributeError, match="cannot assign"):
        plan.points = 7
    assert not list(path.parent.iterdir())


def test_planning_calls_no_function_and_timed_computes_few_points(path):
    CALLS.clear()
    plan = sweep(100).plan(path)
    assert CALLS == []
    assert "estimated time  unknown: there is no earlier run" in repr(plan)
    measured = timed(plan)
    assert 0 < sum(CALLS) < 100
    assert measured.seconds > 0.0
    assert (measured.todo, measured.points) == (plan.todo, plan.points)
    CALLS.clear()
    measured.run("sync")
    assert sum(CALLS) == 100
    assert timed(sweep(100).plan(path)).seconds == 0.0
    assert math.isnan(timed(sweep(4, lambda points: 1 / 0).plan()).seconds)


@pytest.mark.parametrize(
    ("changes", "most"),
    [({}, 22.0), ({"order_by": ("z",)}, 22.0), ({"key": lambda points: points["x"] * 0.0 + points["z"]}, 85.0)],
)
def test_a_plan_of_a_million_points_and_its_queue_take_a_second_and_few_bytes_a_point(changes, most):
    one, begin = sweep(1_000_000, **changes), time.process_time()
    tracemalloc.start()
    plan = one.plan()
    queue = Queue(plan.manifest.grid, plan.due, one.order_by)
    while queue.left:
        queue.take(50_000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak / 1e6 < most
    assert time.process_time() - begin < 2.0


@given(st.lists(st.integers(1, 7), min_size=1, max_size=3), st.data())
@examples(30)
def test_a_queue_gives_every_point_once_in_order_after_those_of_three_places(shape, data):
    names = "abc"[: len(shape)]
    grid = Grid({n: data.draw(st.permutations(range(k))) for n, k in zip(names, shape, strict=True)})
    due = np.array(data.draw(st.lists(st.booleans(), min_size=grid.size, max_size=grid.size)))
    order_by = tuple(data.draw(st.lists(st.sampled_from(names), unique=True)))
    queue, taken, every = Queue(grid, due, order_by), [], np.flatnonzero(due)
    first = queue.take_spread()
    assert len(first) == min(3, len(every))
    assert {*every[:1], *every[-1:]} <= {*first.tolist()}
    while queue.left:
        taken.append(queue.take(data.draw(st.integers(1, 9))))
    others = np.concatenate([np.zeros(0, dtype=int), *taken])
    assert sorted([*first.tolist(), *others.tolist()]) == every.tolist()
    points = grid.points(others)
    rows = list(zip(*(points[name].tolist() for name in order_by), others.tolist(), strict=True))
    assert rows == sorted(rows)


def test_batches_grow_as_far_as_finished_ones_allow():
    sizes = BatchSizes(8.0)
    assert sizes.next(10**6, 2) == 1
    for seconds in (30.0, 30.0):  # two workers that compile first
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
    # No more than fits into memory.
    assert size_of_batch(10**6, 1e-3, row_bytes=batches.BATCH_BYTES / 10) == 10


@given(st.integers(1, 5000), st.floats(0.0, 10.0, exclude_min=True))
@examples(30)
def test_the_last_batches_are_small_so_that_workers_end_together(points, seconds):
    sizes, left = [], points
    while left:
        sizes.append(size_of_batch(left, seconds))
        left -= sizes[-1]
    sizes = np.array(sizes)
    assert sizes.max() == 1 or sizes.max() * seconds <= 1.0
    assert np.all(np.diff(sizes) <= 0)
    remaining = np.cumsum(sizes[::-1])[::-1]
    assert np.all((sizes <= remaining / 8 + 1) | (sizes == 1) | (sizes * seconds <= 0.25))
