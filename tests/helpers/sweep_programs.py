"""A sweep in a process of its own, for tests that kill it, interrupt it or starve it.

python -m tests.helpers.sweep_programs '{"store": "a.nc", "scheduler": "threads", "points": 60}'
"""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np

from sweeps import PENDING, Axis, Grid, Sweep, Variable, open_results
from sweeps.plan import batches
from tests import HOME


def powers(points, log, pause, long, parent, deadly):
    """Squares and cubes, logged at their start.

    The point seven fails, a deadly point ends its worker, and points from four on, which are not probed, may take
    long.
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


def make(points=60, log="", pause=0.0, long=0.0, parent=0, deadly=-1.0):
    """The sweep of `powers`."""
    return Sweep(
        "powers",
        powers,
        Grid({"x": Axis(np.arange(float(points)), "m")}),
        {"square": Variable("m2"), "powers": Variable("1", dims=("power",))},
        constants={"log": str(log), "pause": pause, "long": long, "parent": parent, "deadly": deadly},
        coords={"power": Axis([0, 1, 2])},
    )


def finished_points(store):
    """The points that need no further computation."""
    try:
        data = open_results(store.file)
    except FileNotFoundError:
        return set()
    return set(data["x"].values[data["status"].values != PENDING].tolist())


def end(process):
    """Kill a program with all its child processes."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL) if os.name == "posix" else process.kill()
    process.communicate()


def start(**told):
    """Start this program as the leader of a process group."""
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
    """Plan and run; print a line for each event."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    batches.BATCH_BYTES = 1.0  # a batch is one point, however short it is
    wanted = {key: told[key] for key in ("points", "log", "pause", "long") if key in told}
    try:
        plan = make(**wanted).plan(told["store"])
        (plan.share(*told["share"]) if "share" in told else plan).run(
            told.get("scheduler", "threads"),
            2,
            lambda snapshot: print(f"progress {snapshot.done} {snapshot.stopping} {snapshot.now}", flush=True),
        )
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        print("KeyboardInterrupt", flush=True)
        return 130
    return 0


if __name__ == "__main__":
    # By its name, for the code of `__main__` is not that of this module.
    from tests.helpers import sweep_programs

    sys.exit(sweep_programs.main(json.loads(sys.argv[1])))
