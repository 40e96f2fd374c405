"""Sweep engine: maps a function over a grid of named axes and keeps the outcome as CF netCDF.

It knows no physics. A sweep is declared, planned, executed and stored; each step reads only the one before.
"""

from sweeps.errors import LockedError, SchedulerError, StoreError, SweepStoppedError
from sweeps.final import open_results
from sweeps.grid import Axis, Grid, Variable
from sweeps.monitor import Snapshot
from sweeps.plan import Plan
from sweeps.sweep import Sweep

__all__ = [
    "Axis",
    "Grid",
    "LockedError",
    "Plan",
    "SchedulerError",
    "Snapshot",
    "StoreError",
    "Sweep",
    "SweepStoppedError",
    "Variable",
    "open_results",
]
