"""The same work over and over in a process of its own, which tells what it holds after every twentieth of it.

python -m tests.helpers.processes.repeated simulations 2000

prints a line of JSON at each twentieth: resident memory in bytes, blocks of memory that Python holds, open files
and threads. Work has a rig of its own each time, as in a sweep over rigs, so that what is kept of each shows.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

import studies
from fivcore import Rig, Scene, simulate
from fivcore.errors import SceneError
from studies import runner
from tests.helpers.rigs import workshop_rig

SAMPLES = 20
# In each twentieth all kinds of work come equally often.
KINDS = 10
RIGS = [Rig(), *(workshop_rig(seed) for seed in (0, 1, 5, 8))]
METHODS = ["fast", "fast", "exact", "fast", "paper"]
DURATIONS = {"fast": 4e-3, "exact": 3e-5, "paper": 2e-5}
SERIES = [False, ["velocity_B", "state"]]
_trim = getattr(ctypes.CDLL(None), "malloc_trim", lambda _: None)


def held() -> dict[str, int]:
    """What this process holds when it does nothing."""
    for _ in range(2):
        gc.collect()
    _trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return {
        "memory": pages * os.sysconf("SC_PAGE_SIZE"),
        "blocks": sys.getallocatedblocks(),
        "files": len(os.listdir("/proc/self/fd")),
        "threads": len(os.listdir("/proc/self/task")),
    }


def rig_of(number: int) -> Rig:
    """A rig that no other number has; every fifth has the same elements."""
    rig = RIGS[number % len(RIGS)]
    return replace(rig, head_mass=rig.head_mass * (1.0 + 1e-5 * number))


def simulation(number: int, folder: Path) -> None:
    """One short motion; of every KINDS one has a contact force that is not unique."""
    method, kind = METHODS[number % len(METHODS)], number % KINDS
    scene = Scene(0.02 + 1e-5 * number, 5.0, 10.0 if kind == 3 else 0.2, 9.0, rig_of(number))
    record = SERIES[kind // len(METHODS)]
    with suppress(SceneError):
        termination = "none" if kind == 3 else "absorbing"
        motion = simulate(scene, DURATIONS[method], method, record=record, termination=termination)
        assert len(motion.time) > 0 or not record


# Angles and frictions enough to fill what is kept of the latest within a third of 200 runs.
ANGLES = [1.0 + angle for angle in range(12)]
RUNS: list[tuple[str, dict[str, Any], str]] = [
    ("fig5", {"mu": [0.1, 0.2, 0.3]}, "growth_rate > 0"),
    (
        "scenes",
        {"V": [1e-3, 0.02], "theta": 5.0, "mu": [0.1, 0.2, 0.25, 0.3], "F": 9.0, "duration": 4e-3},
        "mu > 0.1",
    ),
    ("stability", {"theta": ANGLES, "mu": [0.1, 0.2]}, "growth_rate > 0"),
    ("table4", {}, "frequency > 100"),
]


def run(number: int, folder: Path) -> None:
    """A study planned, computed on threads, kept, opened, queried, closed; of every KINDS one is drawn."""
    name, values, where = RUNS[number % len(RUNS)]
    series = {"record": ["velocity_B"], "sample_rate": 50e3} if name == "scenes" else {}
    own = {"first_frequency": 16.0 + 1e-3 * number} if name == "table4" else {"head_mass": 2.9 + 1e-4 * number}
    runner.plan(name, values | own, folder, fresh=True, **series).run("threads", 2).close()
    with studies.open(name, out=folder) as data:
        data.fiv.query(where)
        if number % KINDS == 0:
            data.fiv.plot(folder / "figure.svg")
    assert not plt.get_fignums()


KEPT: list[Any] = []
# What is never given back, to be found.
LEAKS: dict[str, Callable[[], Any]] = {
    "memory": lambda: bytes(1000),
    "blocks": object,
    "files": lambda: os.open(os.devnull, os.O_RDONLY),
    "threads": lambda: threading.Thread(target=threading.Event().wait, daemon=True).start(),
}


def leak(name: str) -> Callable[[int, Path], None]:
    """Work that does nothing but leak."""
    return lambda number, folder: KEPT.append(LEAKS[name]())


WORK = {"simulations": simulation, "runs": run} | {f"leaking {name}": leak(name) for name in LEAKS}


def main(what: str, count: str) -> None:
    """Do the work."""
    with tempfile.TemporaryDirectory() as folder:
        for number in range(int(count)):
            WORK[what](number, Path(folder))
            if (number + 1) % (int(count) // SAMPLES) == 0:
                print(json.dumps(held()), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
