"""The two objects a user holds: a sweep, which can be planned, and its plan, which can be run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import xarray as xr

from sweeps.compute.run import execute
from sweeps.fingerprint.identity import plain
from sweeps.plan.declaration import Declaration
from sweeps.plan.plan import PlanData
from sweeps.plan.planning import make_plan
from sweeps.plan.timing import timed
from sweeps.watch.monitor import Progress


@dataclass(frozen=True, eq=False)
class Sweep(Declaration):  # noqa: D101 - the docstring of its fields
    __doc__ = Declaration.__doc__

    def __post_init__(self) -> None:
        super().__post_init__()
        plain(self.constants)

    def plan(
        self,
        store: str | Path | None = None,
        *,
        fresh: bool = False,
        retry_failed: bool = False,
        strict: bool = False,
    ) -> Plan:
        """Decide everything before the first expensive call; the function is not called.

        Parameters
        ----------
        store : path, optional
            The netCDF file to write; without it the result stays in memory.
        fresh : bool
            Start over, whatever the store holds of this sweep.
        retry_failed : bool
            Compute again what failed.
        strict : bool
            Refuse to compute points in another environment than those at hand, or in several: with other versions
            of Python, NumPy, SciPy, Numba or BLAS, or on another kind of processor. By default that is a
            `MixedWarning`, and the variable `computed_by` of the result says which is whose.

        Raises
        ------
        StoreError
            If the store cannot be used or belongs to something else; the message says what differs.
        """
        return Plan(**vars(make_plan(self, store, fresh, retry_failed, strict)))


@dataclass(frozen=True, eq=False, repr=False)
class Plan(PlanData):  # noqa: D101 - the docstring of its fields
    __doc__ = PlanData.__doc__

    def timed(self) -> Plan:
        """The same plan with the estimated time as a few points tell it, computed now; NaN if all of them fail."""
        return replace(self, seconds=timed(self))

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
            "threads": threads of this process; "sync": one batch after the other; "processes": a Dask cluster of
            processes on this machine; or the address of a Dask scheduler, tcp://host:port.
        workers : int, optional
            Threads or processes; default: one a core. Not for an address.
        progress : callable, optional
            `progress(snapshot)` with a `Snapshot` when batches begin and end.
        fail_fast : bool
            Stop at the first point that fails.

        Returns
        -------
        xarray.Dataset
            The points requested, dimensions in the grid's order; of a large file, large variables are read when
            they are used. Points that failed keep their error text in `error`.

        Raises
        ------
        StoreError
            If the file cannot be written, or another run holds it.
        SchedulerError
            If there is no such scheduler.
        InputError
            If it would mix environments and the plan is strict.
        ClusterLostError
            If it went, or all its workers, while they computed; what was finished is kept in the file's folder.
        SweepStoppedError
            With `fail_fast`, if a point failed.
        KeyboardInterrupt
            After the first interrupt, when what was under way is finished and kept. After the second at once: as
            AbandonedError if threads still compute, for which a normal exit would wait.
        """
        return execute(self, scheduler, workers, progress, fail_fast)
