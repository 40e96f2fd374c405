"""Batches: the order of the points to compute, and batch sizes from the time of finished batches."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.grid import Grid

# A batch is long enough to hide its own cost, short enough to spread and show progress, small enough for memory.
BATCH_SECONDS = 1.0
BATCH_BYTES = 12e6
# s a worker: hundreds of workers finish so few batches a second that the run is busy for a fifth of the time.
WORKER_SECONDS = 0.01
# A batch is at most this share of the remaining points of each worker, but of this time, s: workers end together.
LAST_SHARE, SHORTEST = 0.25, 0.1
# A batch is at most so many times as large as a finished one, since costs differ from point to point.
GROWTH = 8
# Number of the last batches that decide; the least time of a batch, since clocks may show none, s.
REMEMBERED, TINY = 9, 1e-12
# The first batch takes points from so many places of the grid.
FIRST_PLACES = 3


class BatchSizes:
    """Chooses batch sizes from the time of finished batches and the memory for a point's results."""

    def __init__(self, row_bytes: float = 0.0) -> None:
        self._room = max(1.0, BATCH_BYTES / row_bytes) if row_bytes > 0.0 else math.inf
        self._largest = 0
        self._seconds: deque[float] = deque(maxlen=REMEMBERED)

    def finished(self, rows: int, seconds: float) -> None:
        """Record the wall time of a finished batch."""
        self._largest = max(self._largest, rows)
        self._seconds.append(seconds / rows)

    def next(self, left: int, workers: int) -> int:
        """Size of the next batch, for `left` remaining points and a number of workers."""
        if not self._seconds:
            return min(1, left)
        # The median, since the first batch of each worker may include compilation.
        seconds = max(median(self._seconds), TINY)
        longest = max(BATCH_SECONDS, WORKER_SECONDS * workers) / seconds
        share = max(SHORTEST / seconds, math.ceil(LAST_SHARE * left / workers))
        return int(min(left, max(1, min(longest, share, self._room, GROWTH * self._largest))))


class Queue:
    """The points to compute, `left` of them not yet taken: in the grid's order, or sorted by `order_by`."""

    def __init__(self, grid: Grid, due: NDArray[np.bool_], order_by: Sequence[str] = ()) -> None:
        self._due = due.copy()
        self.left = int(np.count_nonzero(due))
        self._blocks = _in_order(grid, self._due, order_by)
        self._ready = np.zeros(0, dtype=np.intp)

    def take(self, count: int) -> NDArray[np.intp]:
        """Take the next `count` points, or all that are left."""
        while len(self._ready) < min(count, self.left):
            self._ready = np.concatenate([self._ready, next(self._blocks)])
        taken, self._ready = np.split(self._ready, [count])
        self.left -= len(taken)
        return taken

    def take_spread(self) -> NDArray[np.intp]:
        """Take one point from each of FIRST_PLACES places, before all others."""
        if self.left <= FIRST_PLACES:
            return self.take(self.left)
        points = np.flatnonzero(self._due)
        taken = np.unique(points[np.linspace(0, self.left - 1, FIRST_PLACES).astype(int)])
        self._due[taken] = False
        self.left -= len(taken)
        return taken


def _in_order(grid: Grid, due: NDArray[np.bool_], order_by: Sequence[str]) -> Iterator[NDArray[np.intp]]:
    """The points to compute, block by block: dimensions with axes of `order_by` change last, by their values."""
    keys: dict[str, list[NDArray[Any]]] = {}
    for name in order_by:
        keys.setdefault(grid.dim_of(name), []).insert(0, grid.axes[name].values)
    sorting = {dim: np.lexsort(values) for dim, values in keys.items()}
    dims = list(dict.fromkeys([*sorting, *grid.dims]))
    lengths = dict(zip(grid.dims, grid.shape, strict=True))
    for index in grid.blocks():
        along = dict(zip(dims, np.unravel_index(index, [lengths[dim] for dim in dims]), strict=True))
        along |= {dim: order[along[dim]] for dim, order in sorting.items()}
        points = np.ravel_multi_index([along[dim] for dim in grid.dims], grid.shape)
        yield points[due[points]]
