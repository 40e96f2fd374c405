"""What a query of a million points takes.

The file is made by a sweep of a function that costs nothing. Each query is a process of its own, from the start of
Python on; memory is the most that it has had resident.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.benchmarks.tables import Column, Table

QUERIES = {
    "twenty rows of an expression": ("--where", 'mu > 0.2 and level > 1.9 and regime == "wild"', "--limit", "20"),
    "no row": ("--where", "level > 9", "--limit", "20"),
    "the twenty greatest": ("--where", "theta < 4", "--sort", "-level", "--limit", "20"),
    "one row": ("--where", "mu == 0.1 + 0.2 and theta == 5.0000001"),
    "all rows, four columns": ("--show", "theta,mu,level,regime"),
    "all rows, sorted": ("--show", "theta,mu,level,regime", "--sort", "level"),
    "all rows, all columns": (),
}
WORDS = ("calm", "steady_sliding", "wild")


def cheap(points):
    """Eight numbers and a word of each point."""
    theta, mu = points["theta"], points["mu"]
    found = {f"number_{k}": np.sin((k + 1) * theta) * np.cos(k * mu) for k in range(7)}
    found["level"] = 1.0 + np.sin(50.0 * mu) * np.cos(theta)
    return found | {"regime": np.minimum(1.5 * found["level"], 2.0).astype(np.int8)}


def worded(dataset):
    """The codes' meanings."""
    dataset["regime"].attrs.pop("units")
    dataset["regime"].attrs |= {"flag_values": np.arange(3, dtype=np.int8), "flag_meanings": " ".join(WORDS)}
    return dataset


def make(path: Path, count: int) -> None:
    """A result of `count` points."""
    from sweeps import Axis, Grid, Sweep, Variable

    side = round(count**0.5)
    # With 5 and 0.3 among their values.
    axes = {
        "theta": Axis(np.linspace(0.0, 0.01 * (side - 1), side).round(10), "degree", "inclination"),
        "mu": Axis(np.linspace(0.0, 0.001 * (side - 1), side).round(10), "1", "friction"),
    }
    variables = {name: Variable("m", name) for name in (*(f"number_{k}" for k in range(7)), "level")}
    variables["regime"] = Variable("1", "regime", dtype="int8")
    Sweep("large", cheap, Grid(axes), variables, title="Large", derive=worded).plan(path).run()


# A process inherits the most that its parent has had resident, so that this small one starts the query.
LAUNCHER = """
import resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True)
taken = time.perf_counter() - start
print(taken, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024.0, file=sys.stderr)
"""


def measured(path: Path, *asked: str) -> tuple[float, float, int]:
    """Wall time (s), most resident memory (bytes) and number of rows of a query as CSV."""
    command = [sys.executable, "-m", "studies", "query", str(path), *asked, "--format", "csv", "-q"]
    with tempfile.TemporaryFile() as out:
        launched = [sys.executable, "-S", "-c", LAUNCHER, *command]
        told = subprocess.run(launched, stdout=out, stderr=subprocess.PIPE, text=True, check=True).stderr
        out.seek(0)
        taken, most = map(float, told.split())
        return taken, most, sum(1 for _ in out) - 1


def queries(points: int = 1_000_000) -> Table:
    """Each query once, for a second of them is no other."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.nc"
        make(path, points)
        # What Python compiles is at hand then.
        measured(path, *next(iter(QUERIES.values())))
        for name, given in QUERIES.items():
            taken, most, count = measured(path, *given)
            rows.append([name, count, taken, most])
    return Table([Column("query"), Column("rows"), Column("time", "s"), Column("memory", "B")], rows)


TABLES = {"queries": queries}
