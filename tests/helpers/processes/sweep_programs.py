"""A sweep in a process of its own, for tests that kill it, interrupt it or starve it.

python -m tests.helpers.processes.sweep_programs '{"store": "a.nc", "scheduler": "threads", "points": 60}'
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

import numpy as np
import xarray as xr

from sweeps import (
    PENDING,
    AbandonedError,
    Axis,
    ClusterLostError,
    Grid,
    InputError,
    StoreError,
    Sweep,
    Variable,
    open_results,
)
from sweeps.plan import batches
from sweeps.storage.store import Store
from tests import HOME

COMPARED = ["square", "powers", "status", "error"]


def cut():
    """Let every batch be of one point, however short it is."""
    batches.BATCH_BYTES = 1.0


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


def values(data):
    """What two runs of `make` have in common."""
    return data[COMPARED].drop_attrs()


def finished_points(store):
    """The points that need not be computed again."""
    try:
        data = open_results(store.file)
    except FileNotFoundError:
        return set()
    return set(data["x"].values[data["status"].values != PENDING].tolist())


@cache
def undisturbed(points):
    """Values of a run of `make` in which nothing happens."""
    return values(make(points=points).plan().run("sync"))


def check(path, points=60):
    """The file is what an undisturbed run makes, with nothing beside it but the empty file of the lock."""
    xr.testing.assert_identical(values(open_results(path)), undisturbed(points))
    assert sorted(p.name for p in path.parent.iterdir()) == [f".{path.name}.lock", path.name]


def flip(path, bit):
    """Change one bit of a file."""
    content = bytearray(path.read_bytes())
    content[bit // 8] ^= 1 << bit % 8
    path.write_bytes(content)


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
    """This program as the leader of a process group: a copy of this process, unless it needs others."""
    if told.get("scheduler", "threads") in ("threads", "sync"):
        return Copy(told)
    return program("processes.sweep_programs", told)


def program(module, told, home=HOME):
    """A module of helpers as the leader of a process group; `home` may have helpers of its own."""
    path = os.pathsep.join([str(HOME), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, "-m", f"tests.helpers.{module}", json.dumps(told, default=str)],
        cwd=home,
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
    print("ready", flush=True)
    wanted = {key: told[key] for key in ("points", "log", "pause", "long") if key in told}
    store = Store(told["store"])
    try:
        plan = make(**wanted).plan(store.file, strict=told.get("strict", False))
        plan.run(
            told.get("scheduler", "threads"),
            2,
            lambda snapshot: print(f"progress {snapshot.done} {snapshot.stopping} {snapshot.now}", flush=True),
        )
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    except AbandonedError:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        print("AbandonedError", flush=True)
        if "linger" in told:
            print(f"before {sorted(os.listdir(store.parts))}", flush=True)
            time.sleep(told["linger"])
            print(f"after {sorted(os.listdir(store.parts))}", flush=True)
        os._exit(130)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        print("KeyboardInterrupt", flush=True)
        return 130
    except (StoreError, ClusterLostError, InputError) as problem:
        print(f"{type(problem).__name__}: {problem}", flush=True)
        return 2 if isinstance(problem, InputError) else 3
    print("done", flush=True)
    return 0


if __name__ == "__main__":
    # By its name, for the code of `__main__` is not that of this module.
    from tests.helpers.processes import sweep_programs

    sys.exit(sweep_programs.main(json.loads(sys.argv[1])))
