"""Sweep engine: maps a function over a grid of named axes and stores the results as CF netCDF.

A sweep is declared, planned, executed and stored. The engine knows no physics.
"""

# ruff: noqa: F401, I001 - these are the names for users
from sweeps.compute.executors import check_backend
from sweeps.errors import AbandonedError, ClusterLostError, FailedPointsWarning, InputError, LockedError
from sweeps.errors import MissingFileError, MixedWarning, PendingWarning, SchedulerError, StoreError
from sweeps.errors import SweepStoppedError
from sweeps.fingerprint.code import digests
from sweeps.fingerprint.identity import json_equal, plain
from sweeps.fingerprint.modules import load_script
from sweeps.fingerprint.provenance import source
from sweeps.grid import DONE, FAILED, INTERPOLATED, INTERPOLATED_FLAG, PENDING, SKIPPED, STATUS_FLAGS
from sweeps.grid import Axis, Grid, Refinement, Variable, blocks, check_counts, check_size
from sweeps.plan.adoption import Adopt
from sweeps.plan.planning import duration, size
from sweeps.refine.refine import refined
from sweeps.sample import Sample, quantiles, unit_draws
from sweeps.status import Progress, Snapshot, Status, check_free, status
from sweeps.storage.existing import open_results
from sweeps.storage.store import Store
from sweeps.sweep import Plan, Sweep
from sweeps.task import pointwise
