"""What can go wrong with a run's disk, clock and workers, brought about in the process that runs."""

import itertools
import os
import shutil
import subprocess
import time
from datetime import datetime, timedelta
from pathlib import Path

import xarray as xr

from sweeps.storage import netcdf
from sweeps.watch import monitor

WRITING = [(os, "replace"), (os, "fsync"), (Path, "write_bytes"), (xr.Dataset, "to_netcdf")]
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


def refuse_steps(first, last, code):
    """Let steps that write fail, from one to another."""

    def refuse(number, moment):
        if moment == "before" and first <= number <= last:
            raise OSError(code, os.strerror(code))

    at_each_step(refuse, WRITING)


def mount(folder, kilobytes, how=""):
    """A disk of that size at a folder; a `CalledProcessError` for who may not."""
    subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"{how}size={kilobytes}k", "none", folder], check=True, capture_output=True
    )


def shift_clock(seconds):
    """Set the clock of this process."""
    right = time.time

    class Shifted(datetime):
        @classmethod
        def now(cls, zone=None):
            return datetime.now(zone) + timedelta(seconds=seconds)

    time.time = lambda: right() + seconds
    for module in (monitor, netcdf):
        module.datetime = Shifted


def wait_for_workers(seconds):
    """Wait so long for workers where there are none left."""
    from sweeps.compute import cluster

    cluster.BEREFT = seconds
