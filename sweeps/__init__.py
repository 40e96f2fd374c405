"""Sweep engine: maps a function over a grid of named axes and keeps the outcome as CF netCDF.

It knows no physics. A sweep is declared, planned, executed and stored; each step reads only the one before.
"""

from sweeps.compute.run import check_backend
from sweeps.errors import (
    AbandonedError,
    ClusterLostError,
    InputError,
    LockedError,
    MissingFileError,
    MixedWarning,
    SchedulerError,
    StoreError,
    SweepStoppedError,
)
from sweeps.fingerprint.identity import json_equal, plain
from sweeps.fingerprint.scripts import load_script
from sweeps.grid import (
    DONE,
    FAILED,
    INTERPOLATED,
    INTERPOLATED_FLAG,
    PENDING,
    SKIPPED,
    STATUS_FLAGS,
    Axis,
    Grid,
    Variable,
    check_counts,
)
from sweeps.plan.plan import duration
from sweeps.plan.planning import check_size
from sweeps.refine.lattice import Refinement
from sweeps.refine.refine import refined
from sweeps.sample import Sample, quantiles, unit_draws
from sweeps.storage.netcdf import open_results
from sweeps.storage.sources import blocks
from sweeps.sweep import Plan, Sweep
from sweeps.watch.monitor import Progress, Snapshot
from sweeps.watch.status import Status, check_free, status

__all__ = [
    "DONE",
    "FAILED",
    "INTERPOLATED",
    "INTERPOLATED_FLAG",
    "PENDING",
    "SKIPPED",
    "STATUS_FLAGS",
    "AbandonedError",
    "Axis",
    "ClusterLostError",
    "Grid",
    "InputError",
    "LockedError",
    "MissingFileError",
    "MixedWarning",
    "Plan",
    "Progress",
    "Refinement",
    "Sample",
    "SchedulerError",
    "Snapshot",
    "Status",
    "StoreError",
    "Sweep",
    "SweepStoppedError",
    "Variable",
    "blocks",
    "check_backend",
    "check_counts",
    "check_free",
    "check_size",
    "duration",
    "json_equal",
    "load_script",
    "open_results",
    "plain",
    "quantiles",
    "refined",
    "status",
    "unit_draws",
]
