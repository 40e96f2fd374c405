"""A sweep in a process of its own, for tests that kill it, interrupt it or starve it.

python -m tests.helpers.sweep_programs '{"store": "a.nc", "scheduler": "threads", "points": 60, "pause": 0.02}'
"""

import json
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import xarray as xr

from sweeps import (
    AbandonedError,
    Axis,
    Grid,
    LockedError,
    SchedulerError,
    StoreError,
    Sweep,
    SweepStoppedError,
    Variable,
    open_results,
)
from sweeps.compute import cluster
from sweeps.plan import batches
from sweeps.plan.batches import BatchSizes
from sweeps.storage.store import Store
from tests import HOME

MEGABYTE = 1 << 20
COMPARED = ["square", "powers", "status", "error"]
# Options of a cluster that says nothing and shows nothing.
QUIET = {"silence_logs": 50, "dashboard_address": None, "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"}}


def cut():
    """Let every batch be of one point, however short it is."""
    batches.BATCH_BYTES = 1.0


def size_of_batch(left, seconds, workers=2, **limits):
    """How many points a batch holds once as many as one likes have taken `seconds` each."""
    sizes = BatchSizes(**limits)
    sizes.finished(1 << 40, seconds * (1 << 40))
    return sizes.next(left, workers)


def simple(function, points=24, **options):
    """A sweep of any function that gives y and n."""
    variables = {"y": Variable(), "n": Variable()}
    return Sweep("simple", function, Grid({"x": Axis(np.arange(float(points)))}), variables, **options)


def powers(points, log, pause, long, parent, deadly):
    """Squares and cubes, told to a log as they are begun.

    Seven fails, a deadly point ends its worker, and those from four on, which are not probed, may be long.
    """
    x = points["x"]
    if os.getpid() != parent and np.any(x == deadly):
        os._exit(9)
    if log:
        file = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(file, "".join(f"{value:g}\n" for value in x).encode())
        os.close(file)
    time.sleep(pause * len(x) + long * np.count_nonzero(x >= 4.0))
    if np.any(x == 7.0):
        raise ValueError("seven is not allowed")
    return {"square": x**2, "powers": x[:, None] ** np.arange(3.0)}


def rows(points):
    """A megabyte for each point, which the file shrinks fast and a part does not."""
    return {"row": points["x"][:, None] + np.arange(MEGABYTE // 8) % 2}


def make(function=powers, points=60, log="", pause=0.0, long=0.0, parent=0, deadly=-1.0):
    """The sweep of `powers`."""
    return Sweep(
        "powers",
        function,
        Grid({"x": Axis(np.arange(float(points)), "m")}),
        {"square": Variable("m2"), "powers": Variable("1", dims=("power",))},
        constants={"log": str(log), "pause": pause, "long": long, "parent": parent, "deadly": deadly},
        coords={"power": Axis([0, 1, 2])},
    )


def make_rows(points):
    """The sweep of `rows`."""
    grid, inner = Grid({"x": Axis(np.arange(float(points)))}), Axis(np.arange(MEGABYTE // 8))
    return Sweep("rows", rows, grid, {"row": Variable(dims=("column",))}, coords={"column": inner})


def values(data):
    """What two runs of `make` have in common."""
    return data[COMPARED].drop_attrs()


def finished_points(store):
    """What is in the parts, and need not be computed again."""
    held = [store.folder.contents(name) for name in store.folder.names()]
    # The points of `make` are the numbers from nought on.
    return {float(x) for contents in held if contents is not None for x in contents.points}


@cache
def undisturbed(points):
    """Values of a run of `make` in which nothing happens."""
    return values(make(points=points).plan().run("sync"))


def check(path, points=60):
    """The file is what an undisturbed run makes, and alone."""
    xr.testing.assert_identical(values(open_results(path)), undisturbed(points))
    assert sorted(p.name for p in path.parent.iterdir()) == [path.name]


def end(process):
    """Kill a program with all that it has started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


class Copy(multiprocessing.get_context("fork").Process):
    """`main` in a copy of this process that leads a group, to be used like a `subprocess.Popen`."""

    def __init__(self, told):
        super().__init__()
        self.told, self.pipes = told, (os.pipe(), os.pipe())
        self.start()
        for _, write in self.pipes:
            os.close(write)
        self.stdout, self.stderr = (open(read) for read, _ in self.pipes)  # noqa: SIM115 - until the process ends

    def run(self):
        os.setsid()
        for place, (_, write) in enumerate(self.pipes, 1):
            os.dup2(write, place)
        sys.stdout, sys.stderr = (open(place, "w", closefd=False) for place in (1, 2))  # noqa: SIM115 - as above
        sys.exit(main(self.told))

    def poll(self):
        return self.exitcode

    def wait(self, timeout):
        self.join(timeout)
        return self.exitcode

    def communicate(self):
        texts = self.stdout.read(), self.stderr.read()
        self.join()
        return texts


def start(**told):
    """This program as the leader of a process group.

    A copy of this process has imported everything; clusters, and who measures memory, want a new one.
    """
    if told.get("scheduler", "threads") in ("sync", "threads") and "rows" not in told:
        return Copy(told)
    path = os.pathsep.join([str(HOME), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, "-m", "tests.helpers.sweep_programs", json.dumps(told, default=str)],
        cwd=HOME,
        env=os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_for(process, word):
    """Read the program's lines up to the one that begins with a word."""
    for line in process.stdout:
        if line.startswith(word):
            return line
    raise AssertionError(f"ended before {word!r}: {process.stderr.read()}")


def main(told):
    """Plan and run; one line for each thing that happens."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    cut()
    if "file_size" in told:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (told["file_size"], resource.RLIM_INFINITY))
    cluster.PATIENCE = told.get("patience", cluster.PATIENCE)
    print("ready", flush=True)
    wanted = {key: told[key] for key in ("points", "log", "pause", "long") if key in told}
    sweep = make_rows(told["points"]) if told.get("rows") else make(parent=told.get("parent", 0), **wanted)
    store = Store(told.get("store", "none.nc"))
    try:
        plan = sweep.plan(told.get("store"))
        print("planned", flush=True)
        time.sleep(told.get("wait", 0.0))
        plan.run(
            told.get("scheduler", "threads"),
            told.get("workers", 2),
            lambda snapshot: print(f"progress {snapshot.done} {snapshot.stopping} {snapshot.now}", flush=True),
            fail_fast=told.get("fail_fast", False),
        )
    except AbandonedError:
        print("AbandonedError", flush=True)
        if "linger" in told:
            print(f"before {sorted(os.listdir(store.parts))}", flush=True)
            time.sleep(told["linger"])
            print(f"after {sorted(os.listdir(store.parts))}", flush=True)
        os._exit(130)
    except KeyboardInterrupt:
        print("KeyboardInterrupt", flush=True)
        return 130
    except (LockedError, StoreError, SchedulerError, SweepStoppedError) as problem:
        print(f"{type(problem).__name__}: {problem}", flush=True)
        return 3
    # Of this process alone: what `getrusage` tells it has from its parent.
    status = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    print(f"peak {int(status['VmHWM'].split()[0]) // 1024}", flush=True)
    print("done", flush=True)
    return 0


if __name__ == "__main__":
    # By its name, for the code of `__main__` is not that of this module.
    from tests.helpers import sweep_programs

    sys.exit(sweep_programs.main(json.loads(sys.argv[1])))
