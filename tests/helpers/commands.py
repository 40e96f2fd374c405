"""The command as whole processes, and what it leaves behind."""

import os
import subprocess
import sys
import time
from pathlib import Path

from sweeps import Store

FIV = str(Path(sys.executable).with_name("fiv"))


def fiv(folder, *arguments, command=(FIV,)):
    environment = {k: v for k, v in os.environ.items() if k != "FIV_RESULTS"}
    return subprocess.run([*command, *arguments], cwd=folder, capture_output=True, text=True, env=environment)


def written(folder) -> list[str]:
    files = [p for p in Path(folder).rglob("*") if p.is_file() and p.suffix != ".lock"]
    return sorted(str(p.relative_to(folder)) for p in files)


# The command with batches that take their time, and after the first six wait until there is a file `go`; what they
# compute, and so the store, is the study's own.
SLOW = """
import itertools, os, sys, time
from studies.cli.main import main
from sweeps.task import Task
compute, calls = Task.compute, itertools.count()
def slowly(self, points):
    late = next(calls) > 5
    while late and not os.path.exists('go'):
        time.sleep(0.02)
    time.sleep(0.4 * len(points['mu']))
    return compute(self, points)
Task.compute = slowly
sys.argv = ['fiv', *sys.argv[1:]]
main()
"""


def begun(folder, *arguments):
    """A slow run of `fig5`, once it has finished its first batches."""
    command = [sys.executable, "-c", SLOW, *arguments]
    running = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 60.0
    store = Store(folder / "results" / "fig5" / "fig5.nc")
    while len(store.part_names()) < 4:
        assert running.poll() is None
        assert time.monotonic() < until
        time.sleep(0.02)
    return running
