"""What the studies cost as a user runs them.

Each is a process of its own, from nothing, on threads; time is that of the whole command, with its imports, its
planning, its file and its figure.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr

from tests.benchmarks.tables import Column, Table

# V and F that grow by one ratio: ten of each have nineteen V / F.
GRID = (
    f"V={','.join(repr(1e-3 * 1.3**k) for k in range(10))}",
    "theta=-10:20:13",
    "mu=0.05:0.35:11",
    f"F={','.join(repr(9.0 * 1.3**k) for k in range(10))}",
    "duration=1",
)
# By name: what the table calls it, the study, what is set, and what the project asks of itself, s.
CASES = {
    "stability": ("`stability` at 501 x 401", "stability", ("theta=-10:20:501", "mu=0:0.5:401"), 20.0),
    "table6": ("`table6`", "table6", (), 120.0),
    "stick_time": ("`stick_time`", "stick_time", (), 180.0),
    "regimes": ("`regimes`, 40 x 40, to 0.005", "regimes", (), 600.0),
    "grid": ("`scenes`, 10 x 13 x 11 x 10, 1 s each", "scenes", GRID, 180.0),
}


def run(name: str, folder: str) -> tuple[float, float, xr.Dataset]:
    """Wall and processor time of a study's command, s, and what it found."""
    _, study, given, _ = CASES[name]
    command = [sys.executable, "-m", "studies", "run", study, "--out", folder, "--fresh", "--yes", "-q"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    subprocess.run(
        [*command, *(part for spec in given for part in ("--set", spec))], check=True, stdout=subprocess.DEVNULL
    )
    taken = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return taken, cpu, xr.open_dataset(Path(folder) / study / f"{study}.nc")


def motion(name: str, found: xr.Dataset) -> list[float | None]:
    """Simulated time of all computations, and what a second of it takes on one core."""
    computed = found["wall_time"].values > 0.0
    if name == "regimes":
        simulated = found["duration"].values[computed].sum() * found.sizes["member"]
    elif name == "grid":
        simulated = float(computed.sum())
    else:
        return [None, None]
    return [float(simulated), float(np.sum(found["wall_time"].values[computed]) / simulated)]


def commands() -> Table:
    """Every case, one after another."""
    rows = []
    for name, (what, *_, most) in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            taken, cpu, found = run(name, folder)
            with found:
                rows.append([what, taken, most, cpu, int((found["status"] == 1).sum()), *motion(name, found)])
    times = (Column(each, "s") for each in ("time", "at most", "CPU time"))
    later = (Column(each, "s") for each in ("simulated", "a second of it, one core"))
    return Table([Column("what"), *times, Column("points"), *later], rows)


TABLES = {"commands": commands}
