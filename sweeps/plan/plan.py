"""A frozen plan: what will be done, and the only thing that executes it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sweeps.compute.batch import Table, Work
    from sweeps.storage.manifest import Layout
    from sweeps.storage.merge import Source
    from sweeps.sweep import Sweep
    from sweeps.watch.monitor import Progress


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """What a sweep will cost and do. Its repr is the report; `run` consumes it.

    Attributes
    ----------
    sweep : Sweep
    store : Path or None
        The netCDF file.
    points, skipped, wanted, distinct, cached, todo : int
        Points of the grid, those needing nothing, those asked for, different computations, those at hand, those to
        do. Of a refined sweep those asked for are the ones that what is known so far makes worth computing.
    failed : int
        Those at hand that failed and are not tried again.
    batches : tuple of ndarray
        The computations to do, one array a batch, by their places in `layout`; those probed are not among them.
    original : ndarray
        For each point of the file the one computed in its stead; -1 where skipped.
    bytes, batch_bytes : int
        Expected size of the file, and of what a batch holds in memory.
    seconds : float
        Time to expect on one core; NaN if the probes failed.
    layout : Layout
        The file that will be.
    work : Work
        What is done to every batch.
    probes : tuple of Table
        What was computed in order to know the time; it is not computed again.
    asked : ndarray
        Places in the file of the points asked for.
    sources : tuple of Source
        Where what is at hand is kept.
    stamp : tuple
        The state of the store when this was planned.
    whole : bool
        Whether the file is already all that is asked.
    damaged : tuple of str
        Shards that cannot be used; what was in them is to do.
    """

    sweep: Sweep
    store: Path | None
    points: int
    skipped: int
    wanted: int
    distinct: int
    cached: int
    failed: int
    todo: int
    batches: tuple[NDArray[np.intp], ...]
    original: NDArray[np.intp]
    bytes: int
    batch_bytes: int
    seconds: float
    layout: Layout
    work: Work
    probes: tuple[Table, ...]
    asked: NDArray[np.intp]
    sources: tuple[Source, ...]
    stamp: tuple[Any, ...]
    whole: bool
    damaged: tuple[str, ...]

    @property
    def most_seconds(self) -> float:
        """Time to expect on one core; of a refined sweep if every point were asked for in the end."""
        if self.sweep.refinement is None or not self.todo:
            return self.seconds
        return self.seconds / self.todo * (self.points - self.skipped - self.cached)

    def __repr__(self) -> str:
        time = "unknown: no point tells" if math.isnan(self.seconds) else duration(self.seconds)
        shape = " x ".join(f"{d} {n}" for d, n in zip(self.sweep.grid.dims, self.sweep.grid.shape, strict=True))
        probed = sum(len(table) for table in self.probes)
        todo = f"{self.todo} in {len(self.batches)} batches"
        rows = [
            ("sweep", self.sweep.name),
            ("grid", shape),
            ("points", f"{self.points}"),
            ("skipped", f"{self.skipped}"),
            ("refined", self._chosen()),
            ("distinct", f"{self.distinct}"),
            ("cached", f"{self.cached}" + (f", {self.failed} of them failed" if self.failed else "")),
            ("to do", todo + (f", {probed} done as probes" if probed else "")),
            ("file size", size(self.bytes)),
            ("a batch", f"{size(self.batch_bytes)} in memory"),
            ("time to expect", f"{time} on one core" if self.seconds > 0 else time),
        ]
        if self.most_seconds > self.seconds:
            rows.append(("at most", f"{duration(self.most_seconds)} for all points"))
        if self.store is not None:
            rows.append(("file", str(self.store)))
        rows += [("damaged", f"{name}: its points are computed again") for name in self.damaged]
        return "\n".join(f"{name:<15} {text}" for name, text in rows if text)

    def _chosen(self) -> str:
        """How far a refined sweep has got; nothing of any other."""
        if self.sweep.refinement is None:
            return ""
        told = f"to {self.wanted} points ({100.0 * self.wanted / self.points:.3g} %)"
        return f"{told} so far; what they show may ask for more" if self.todo else told

    def run(
        self,
        scheduler: str = "threads",
        workers: int | None = None,
        progress: Progress | None = None,
        *,
        fail_fast: bool = False,
    ) -> xr.Dataset:
        """Compute what is to be done, write the netCDF file if there is a store, return the dataset.

        Parameters
        ----------
        scheduler : str
            "threads": Dask's threads in this process; "sync": one batch after the other; "processes": a
            Dask cluster of processes on this machine; or the address of a Dask scheduler, tcp://host:port.
        workers : int, optional
            Threads or processes; default: one a core. Not for an address.
        progress : callable, optional
            `progress(snapshot)` with a `sweeps.monitor.Snapshot` when batches begin and end, from any thread.
        fail_fast : bool
            Stop at the first point that fails.

        Returns
        -------
        xarray.Dataset
            The points asked for, dimensions in the grid's order; of a large file, large variables are read when
            they are used. Points that failed keep their error text in `error`.

        Raises
        ------
        StoreError
            If the file cannot be written, or another run holds it.
        SchedulerError
            If there is no such scheduler.
        SweepStoppedError
            With `fail_fast`, if a point failed.
        KeyboardInterrupt
            After the first interrupt, when what was under way is finished and kept. After the second at once: as
            AbandonedError if threads still compute, for which a normal exit would wait.
        """
        from sweeps.compute.run import execute

        return execute(self, scheduler, workers, progress, fail_fast)


def duration(seconds: float) -> str:
    """Seconds for a reader."""
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"


def size(count: float) -> str:
    """Bytes for a reader."""
    for unit in ("B", "kB", "MB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} GB"
