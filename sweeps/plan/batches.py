"""Cutting what is due into batches: in which order, and how many points each.

The first batches are small; those that have finished tell how long the next may be.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray

from sweeps.grid import Grid

# A batch long enough to hide its own cost, short enough to spread and to show progress, small enough to hold.
BATCH_SECONDS = 1.0
BATCH_BYTES = 12e6
# So many workers hand in so few batches a second that whoever hands these out is busy for a fifth of the time.
WORKER_SECONDS = 0.01
# A batch is at most this share of what is left for each worker, down to so long, s: workers end at the same time.
LAST_SHARE, SHORTEST = 0.25, 0.1
# A batch is at most so many times as long as one that has finished, for costs differ from point to point.
GROWTH = 8
# So many of the last batches tell what the next will cost; a clock may find none, s.
REMEMBERED, TINY = 9, 1e-12


class BatchSizes:
    """Sizes batches by what those that have finished took.

    Parameters
    ----------
    row_bytes : float
        What a point leaves in memory.
    multiple : int
        How many are computed side by side at little more than the cost of one.
    """

    def __init__(self, row_bytes: float = 0.0, multiple: int = 1) -> None:
        self._room = max(1.0, BATCH_BYTES / row_bytes) if row_bytes > 0.0 else math.inf
        self._least = min(float(multiple), self._room)
        self._largest = 0
        self._seconds: deque[float] = deque(maxlen=REMEMBERED)

    def finished(self, rows: int, seconds: float) -> None:
        """A batch of so many points took so long."""
        self._largest = max(self._largest, rows)
        self._seconds.append(seconds / rows)

    def next(self, left: int, workers: int) -> int:
        """How many points the next batch holds, where so many are left to so many workers."""
        if not self._seconds:
            return int(min(self._least, left))
        # The median, for the first batch of each worker may have to wait until the function is compiled.
        seconds = max(median(self._seconds), TINY)
        longest = max(BATCH_SECONDS, WORKER_SECONDS * workers) / seconds
        share = max(SHORTEST / seconds, math.ceil(LAST_SHARE * left / workers))
        return int(min(left, max(self._least, min(longest, share, self._room, GROWTH * self._largest))))


class Queue:
    """Takes points that are due, in the grid's order or sorted by axes whose change is costly.

    Parameters
    ----------
    grid : Grid
    due : ndarray of bool, (points,)
    order_by : sequence of str

    Attributes
    ----------
    left : int
        Points that have not been taken.
    """

    def __init__(self, grid: Grid, due: NDArray[np.bool_], order_by: Sequence[str] = ()) -> None:
        self.left = int(np.count_nonzero(due))
        self._blocks = _in_order(grid, due, order_by)
        self._ready = np.zeros(0, dtype=np.intp)

    def take(self, count: int) -> NDArray[np.intp]:
        """The next so many points, or as many as there are."""
        while len(self._ready) < min(count, self.left):
            self._ready = np.concatenate([self._ready, next(self._blocks)])
        taken, self._ready = np.split(self._ready, [count])
        self.left -= len(taken)
        return taken


def _in_order(grid: Grid, due: NDArray[np.bool_], order_by: Sequence[str]) -> Iterator[NDArray[np.intp]]:
    """The points that are due, block by block: dimensions with axes of `order_by` change last, by their values."""
    sorting = {
        dim: np.lexsort([grid.axes[name].values for name in reversed(order_by) if grid.dim_of(name) == dim])
        for dim in dict.fromkeys(map(grid.dim_of, order_by))
    }
    dims = list(dict.fromkeys([*sorting, *grid.dims]))
    lengths = dict(zip(grid.dims, grid.shape, strict=True))
    for index in grid.blocks():
        along = dict(zip(dims, np.unravel_index(index, [lengths[dim] for dim in dims]), strict=True))
        along |= {dim: order[along[dim]] for dim, order in sorting.items()}
        points = np.ravel_multi_index([along[dim] for dim in grid.dims], grid.shape)
        yield points[due[points]]
