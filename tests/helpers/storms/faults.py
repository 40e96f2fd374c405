"""What can go wrong with a run's disk, clock and workers, brought about in the process that runs."""

import itertools
import os
import shutil
import signal
import subprocess
import time
from datetime import datetime, timedelta
from pathlib import Path

import xarray as xr

from sweeps.storage import netcdf, parts, store

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
    for module in (store, netcdf):
        module.datetime = Shifted


def wait_for_workers(seconds):
    """Wait so long for workers where there are none left."""
    from sweeps.compute import cluster

    cluster.NO_WORKER_TIMEOUT = seconds
