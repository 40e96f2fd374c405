"""Flutter onsets of many rigs at once beside one at a time.

Every number of every rig is scattered; medians over repetitions in one run, in turns.
"""

from __future__ import annotations

import statistics
import time

import numpy as np

from fivcore import flutter_onsets, flutter_onsets_many
from tests.benchmarks.stability import forget
from tests.benchmarks.tables import Column, Table
from tests.helpers.scattered import rig_of, scattered

MANY, FEW, ALL = 2048, 32, 100_000
ANGLES, RIGS = np.linspace(-20.0, 40.0, 61), 1024


def seconds(run) -> float:
    """Seconds a run takes."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def costs(repeat: int = 7) -> Table:
    """What a rig takes each way, and how many times faster than the first."""
    numbers = scattered(MANY)
    rigs = [(rig_of(numbers, row), float(numbers["theta"][row])) for row in range(FEW)]

    def one_at_a_time() -> None:
        forget()
        for rig, theta in rigs:
            flutter_onsets(rig, theta)

    runs = [
        ("`flutter_onsets`, one rig after another", one_at_a_time, FEW),
        ("`flutter_onsets_many`, one thread", lambda: flutter_onsets_many(numbers), MANY),
        ("`flutter_onsets_many`, two threads", lambda: flutter_onsets_many(numbers, threads=2), MANY),
    ]
    for _, run, _ in runs:
        run()
    times = np.array([[seconds(run) / count for _, run, count in runs] for _ in range(repeat)])
    rows = [
        [what, statistics.median(own), ALL * statistics.median(own), statistics.median(ratios)]
        for (what, *_), own, ratios in zip(runs, times.T, (times[:, :1] / times).T, strict=True)
    ]
    named = [Column("what"), Column("a rig", "s"), Column("100 000 rigs, from that", "s"), Column("times faster")]
    return Table(named, rows)


def errors() -> Table:
    """Largest relative difference of an onset's friction from the one of a rig at a time."""
    numbers, largest = scattered(200, 1), 0.0
    found = flutter_onsets_many(numbers)
    for row in range(200):
        one = flutter_onsets(rig_of(numbers, row), float(numbers["theta"][row]))
        for many, each in ((found.mu, one.mu), (found.recovery_mu, one.recovery_mu)):
            largest = max(largest, np.max(np.abs(many[row][: len(each)] / each - 1.0), initial=0.0))
    return Table([Column("difference"), Column("largest", form=".1e")], [["friction, relative", float(largest)]])


def whole() -> Table:
    """Two runs in full on two threads."""
    numbers, at = scattered(ALL, 2), {name: np.repeat(values, 61) for name, values in scattered(RIGS, 3).items()}
    at["theta"] = np.tile(ANGLES, RIGS)
    mu = np.linspace(0.0, 0.5, 51)
    rows = [
        [f"{ALL} rigs, mu up to 1", seconds(lambda: flutter_onsets_many(numbers, threads=2))],
        [
            f"{RIGS} rigs at 61 angles, unstable or not at 51 mu up to 0.5",
            seconds(lambda: flutter_onsets_many(at, mu_max=0.5, threads=2).unstable(mu)),
        ],
    ]
    return Table([Column("in full, two threads"), Column("time", "s")], rows)


TABLES = {"costs": costs, "errors": errors, "whole": whole}
