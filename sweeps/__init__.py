"""Sweep engine: maps a function over a grid of named axes and keeps the outcome as CF netCDF.

It knows no physics. A sweep is declared, planned, executed and stored; each step reads only the one before.
"""

from sweeps.errors import AbandonedError, LockedError, SchedulerError, StoreError, SweepStoppedError
from sweeps.grid import Axis, Grid, Variable
from sweeps.plan.plan import Plan
from sweeps.refine.refine import Refinement, refine, refined
from sweeps.storage.netcdf import open_results
from sweeps.sweep import Sweep
from sweeps.watch.monitor import Snapshot
from sweeps.watch.status import Status, check_free, status

__all__ = [
    "AbandonedError",
    "Axis",
    "Grid",
    "LockedError",
    "Plan",
    "Refinement",
    "SchedulerError",
    "Snapshot",
    "Status",
    "StoreError",
    "Sweep",
    "SweepStoppedError",
    "Variable",
    "check_free",
    "open_results",
    "refine",
    "refined",
    "status",
]
