"""Sweep engine: maps a function over a grid of named axes and keeps the outcome as CF netCDF.

It knows no physics. A sweep is declared, planned, executed and stored; each step reads only the one before.
"""

from sweeps.grid import Axis, Grid, Variable
from sweeps.plan import Plan
from sweeps.store import StoreError, open_results
from sweeps.sweep import Sweep

__all__ = ["Axis", "Grid", "Plan", "StoreError", "Sweep", "Variable", "open_results"]
