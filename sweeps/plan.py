"""A frozen plan: what will be done, and the only thing that executes it."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sweeps.sweep import Sweep

# A batch long enough to hide its own cost, short enough to spread and to show progress.
BATCH_SECONDS = 1.0
LEAST_BATCHES = 16

Progress = Callable[[int, int], None]


def make_batches(todo: NDArray[np.intp], seconds: float) -> tuple[NDArray[np.intp], ...]:
    """Cut the work into runs of neighbouring points, which share what they can share."""
    if not len(todo):
        return ()
    fitting = BATCH_SECONDS / seconds if seconds > 0.0 else math.inf
    size = max(1, int(min(fitting, math.ceil(len(todo) / LEAST_BATCHES))))
    return tuple(todo[i : i + size] for i in range(0, len(todo), size))


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """What a sweep will cost and do. Its repr is the report; `run` consumes it.

    Attributes
    ----------
    points, skipped, distinct, cached, todo : int
        Points of the grid, those needing nothing, different computations, those at hand, those to do.
    batches : tuple of ndarray
        Indices of the points to compute, one array a batch.
    original : ndarray, (points,)
        The point computed in each point's stead; -1 where skipped.
    bytes : int
        Size of the result, uncompressed.
    seconds : float
        Time to expect on one core; NaN if the probes failed.
    """

    sweep: Sweep
    store: Path | None
    points: int
    skipped: int
    distinct: int
    cached: int
    todo: int
    batches: tuple[NDArray[np.intp], ...]
    original: NDArray[np.intp]
    bytes: int
    seconds: float

    def __repr__(self) -> str:
        time = "unknown: a probed point failed" if math.isnan(self.seconds) else duration(self.seconds)
        shape = " x ".join(f"{d} {n}" for d, n in zip(self.sweep.grid.dims, self.sweep.grid.shape, strict=True))
        rows = [
            ("sweep", self.sweep.name),
            ("grid", shape),
            ("points", f"{self.points}"),
            ("skipped", f"{self.skipped}"),
            ("distinct", f"{self.distinct}"),
            ("cached", f"{self.cached}"),
            ("to do", f"{self.todo} in {len(self.batches)} batches"),
            ("size", _size(self.bytes)),
            ("time to expect", f"{time} on one core" if self.seconds > 0 else time),
        ]
        if self.store is not None:
            rows.append(("file", str(self.store)))
        return "\n".join(f"{name:<15} {text}" for name, text in rows)

    def run(
        self, scheduler: str = "threads", workers: int | None = None, progress: Progress | None = None
    ) -> xr.Dataset:
        """Compute what is to be done, write the netCDF file if there is a store, return the dataset.

        Parameters
        ----------
        scheduler : {"threads", "sync"}
            Dask's threads in this process, or one point after the other.
        workers : int, optional
            Threads; default: one a core.
        progress : callable, optional
            `progress(done, failed)` after every batch, in points, from any thread.

        Returns
        -------
        xarray.Dataset
            Dimensions in the grid's order. Points that failed keep their error text in `error`.
        """
        from sweeps.execute import execute
        from sweeps.store import assemble, check_store, write

        if scheduler not in ("threads", "sync"):
            raise ValueError(f"scheduler = {scheduler!r}: it must be 'threads' or 'sync'")
        whole = isinstance(workers, (int, np.integer)) and not isinstance(workers, bool)
        if workers is not None and not (whole and workers >= 1):
            raise ValueError(f"workers = {workers!r}: it must be a whole number, 1 or above")
        if self.store is not None:
            check_store(self.store, self.sweep.name)
        outcome = execute(self, scheduler, workers or os.cpu_count() or 1, progress)
        dataset = assemble(self, outcome)
        try:
            if self.sweep.derive is not None:
                dataset = self.sweep.derive(dataset)
        finally:
            # What was computed is kept even where nothing can be derived from it.
            if self.store is not None:
                write(dataset, self.store)
        return dataset


def duration(seconds: float) -> str:
    """Seconds for a reader."""
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"


def _size(size: int) -> str:
    amount = float(size)
    for unit in ("B", "kB", "MB"):
        if amount < 999.5:
            return f"{amount:.3g} {unit}"
        amount /= 1000.0
    return f"{amount:.3g} GB"
