"""The two objects of the API: a sweep, which plans, and its plan, which runs."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from sweeps.compute.run import execute
from sweeps.errors import PendingWarning
from sweeps.fingerprint.identity import plain
from sweeps.grid import Declaration
from sweeps.plan.adoption import Adopt
from sweeps.plan.planning import PlanData, make_plan
from sweeps.plan.shares import merged, share_of
from sweeps.status import Progress


@dataclass(frozen=True, eq=False)
class Sweep(Declaration):
    """A function of points, mapped over a grid.

    Parameters
    ----------
    name : str
    function : callable
        `function(points, **constants)` takes a batch, a dict of 1-D arrays with one entry for each point, and
        returns a dict of arrays with the batch first, or the array of a single variable; also `error`, an
        exception or None for each point, and `wall_time` (s). The result of a point must not depend on its batch.
        `sweeps.pointwise` adapts a function of numbers.
    grid : Grid, mapping or pandas.DataFrame
        The points; a mapping of names to an Axis or a list is a grid, a DataFrame has a point in each row.
    variables : mapping of str to Variable, or sequence of str
    constants : mapping
        Keyword arguments of the function: numbers, strings, arrays, DataFrames, dataclasses, and containers.
    key : callable, optional
        `key(points)` returns equal rows for points that share one computation.
    coords : mapping of str to (Axis or array_like)
        Coordinates of the dimensions that variables have besides the grid's.
    code : sequence of (str or Path)
        Packages, modules and files on which the results depend, besides the function's own module.
    title, remark : str
        The file's title, and text for its history.
    derive : callable, optional
        `derive(dataset)` returns the finished dataset with variables that follow from all points.
    scale : callable, optional
        `scale(points)` returns factors by name; a variable that names one in its `scale` is multiplied by it at
        each point, so that one computation serves points that differ in size only.
    order_by : sequence of str, optional
        Axes whose change is costly: a batch has neighbours along the others first.
    request : mapping
        The request from which the constants follow, as JSON represents it; part of the file's configuration.
    rerun : callable, optional
        `rerun(point)` returns a command that computes a failed point, a dict, again. Default: calls the function.
    refinement : Refinement, optional
        The rule that chooses the points to compute; set by `sweeps.refined`.
    functions : mapping of str to callable
        Variables that have a function of their own, which is called like `function` and returns that variable.
        Where a file of earlier results lacks such a variable, it alone is computed for the stored points.
    """

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
        adopt: int | Adopt | None = None,
    ) -> "Plan":
        """Make all decisions before the first expensive call, without calling the function.

        Parameters
        ----------
        store : path, optional
            The netCDF file to write; without it the result stays in memory.
        fresh, retry_failed : bool
            Start over, whatever the store has of this sweep; compute failed points again.
        strict : bool
            Refuse to mix environments: versions of Python, libraries and BLAS, or kinds of processor. By default
            a mixture is a `MixedWarning`, and the file's attribute `environments` lists them.
        adopt : int or Adopt, optional
            After a change of code, keep the stored results if so many stored computations, repeated when the plan
            runs, agree: in all bits, or within four standard errors where a variable `x` has its standard error
            `x_se` beside it. The history of the file says so. If they do not agree, nothing changes.

        Raises
        ------
        StoreError, InputError
            If the store cannot be used or belongs to something else; the message says what differs. If strict, if
            environments differ.
        """
        fields = make_plan(self, store, fresh=fresh, retry_failed=retry_failed, strict=strict, adopt=adopt)
        return Plan(**fields)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Plan(PlanData):
    """The decisions of `Sweep.plan`; its repr reports them.

    Attributes
    ----------
    points, skipped, distinct, cached, failed, todo : int
        Points of the grid, those that `skip` leaves out, different computations of the others, those that are
        stored, stored ones that failed, those to do.
    seconds, most_seconds, bytes : float
        Estimated time on one core, the same if a refined sweep requests every point, and size of the file.
    covers : tuple of str
        Modules, packages and files on which the results depend.
    """

    def share(self, number: int, count: int) -> "Plan":
        """Plan one of `count` shares of the computations, for a separate job; `number` is from 1.

        Shares may run at the same time. Each writes parts of its own, and a stopped one may run again. A share is
        the same in any folder, whatever is stored there already. `merge` makes one file of them.
        """
        return share_of(self, number, count)

    def merge(self, *files: str | Path) -> xr.Dataset:
        """Write the results of shares, beside the store or other files, and return them; compute nothing.

        A `PendingWarning` names missing shares; their points are pending, and may be merged later.
        """
        plan, missing = merged(self, files)
        data, _ = execute(plan, "sync", None, None, fail_fast=False)
        if missing:
            warnings.warn(f"{self.sweep.name}: {missing}", PendingWarning, stacklevel=2)
        return data

    def run(
        self,
        scheduler: Any = "threads",
        workers: int | None = None,
        progress: Progress | bool | None = None,
        *,
        fail_fast: bool = False,
    ) -> xr.Dataset:
        """Compute the points to do, write the netCDF file if there is a store, and return the dataset.

        Parameters
        ----------
        scheduler : str, Dask client or cluster, concurrent.futures.Executor or callable
            "threads"; "sync": one batch after the other; "processes": as many on this machine as `workers`;
            the address of a Dask scheduler, tcp://host:port; or any executor: of threads, of processes, loky's,
            that of mpi4py.futures. Of a function that makes executors a new one is taken if its workers die, and
            the point that kills them fails; an executor itself is not shut down.
        workers : int, optional
            Threads or processes; default: one for each core. Others have their own number.
        progress : bool or callable, optional
            True: a line on standard error; else `progress(snapshot)` with a `Snapshot` when batches begin and end.
        fail_fast : bool
            Stop at the first point that fails.

        Returns
        -------
        xarray.Dataset
            The requested points, dimensions in the grid's order; of a large file, large variables are read when
            they are used. `error` has the reasons of failed points.

        Warns
        -----
        FailedPointsWarning
            If points failed: how many, and why the first did.

        Raises
        ------
        StoreError, SchedulerError, InputError
            If the file cannot be written, or another run holds it; if there is no such scheduler; if the plan is
            strict and workers have another environment.
        ClusterLostError, SweepStoppedError
            If the scheduler, all its workers or an executor's die; if the first points, from several places of the
            grid, all fail alike, or, with `fail_fast`, any fails. Finished batches stay in the store.
        KeyboardInterrupt
            After the first interrupt, when the batches that have begun are stored. After the second at once: as
            AbandonedError if threads still compute, for which a normal exit would wait.
        """
        data, after = execute(self, scheduler, workers, progress, fail_fast)
        # The same plan may run again: then it finds everything.
        vars(self).update(vars(after))
        return data
