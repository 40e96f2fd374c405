"""Faults of a run's disk, brought about in the process that runs."""

import itertools
import os
import shutil
import signal
from pathlib import Path

import xarray as xr

from sweeps.storage import netcdf, parts

WRITING = [(os, "replace"), (os, "fsync"), (parts, "pack"), (xr.Dataset, "to_netcdf"), (netcdf, "append_checksum")]
STEPS = [*WRITING, (Path, "unlink"), (Path, "mkdir"), (shutil, "rmtree")]


def at_each_step(act, steps=STEPS):
    """From now on call `act(number, moment)` "before" and "after" each step on the disk."""
    numbers = itertools.count(1)

    def counted(original):
        def step(*arguments, **options):
            number = next(numbers)
            act(number, "before")
            given = original(*arguments, **options)
            act(number, "after")
            return given

        return step

    for owner, name in steps:
        setattr(owner, name, counted(getattr(owner, name)))


def killed_at(number, run, when="before"):
    """Run in a copy of this process that kills itself at the so-manyth step on the disk; whether it did."""

    def kill(step, moment):
        if (step, moment) == (number, when):
            os.kill(os.getpid(), signal.SIGKILL)

    child = os.fork()
    if child == 0:
        try:
            at_each_step(kill)
            run()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])
