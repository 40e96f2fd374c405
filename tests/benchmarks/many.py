"""Flutter onsets of many rigs at once beside one at a time: `python -m tests.benchmarks.many [--whole]`.

Every number of every rig is scattered; medians over repetitions in this one run, in turns. `--whole` adds two runs
in full on two threads: 100 000 rigs, and 1024 rigs at 61 angles. It prints the tables of the README.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np
from threadpoolctl import threadpool_limits

from fivcore import flutter_onsets, flutter_onsets_many
from tests.benchmarks.stability import forget, machine
from tests.helpers.scattered import rig_of, scattered

MANY, FEW, ALL = 2048, 32, 100_000
ANGLES, RIGS = np.linspace(-20.0, 40.0, 61), 1024


def seconds(run) -> float:
    """Seconds a run takes."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def costs(repeat: int = 7) -> tuple[list[tuple[str, float]], list[float]]:
    """Rows of the table: what, seconds a rig; and the ratios to the first row."""
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
    table = [(what, statistics.median(column)) for (what, _, _), column in zip(runs, times.T, strict=True)]
    return table, [statistics.median(column) for column in (times[:, :1] / times).T]


def errors() -> float:
    """Largest relative difference of an onset's friction from the one of a rig at a time."""
    numbers, largest = scattered(200, 1), 0.0
    found = flutter_onsets_many(numbers)
    for row in range(200):
        one = flutter_onsets(rig_of(numbers, row), float(numbers["theta"][row]))
        for many, each in ((found.mu, one.mu), (found.recovery_mu, one.recovery_mu)):
            largest = max(largest, np.max(np.abs(many[row][: len(each)] / each - 1.0), initial=0.0))
    return largest


def whole() -> list[tuple[str, float]]:
    """Two runs in full on two threads: what, seconds."""
    numbers, at = scattered(ALL, 2), {name: np.repeat(values, 61) for name, values in scattered(RIGS, 3).items()}
    at["theta"] = np.tile(ANGLES, RIGS)
    mu = np.linspace(0.0, 0.5, 51)
    return [
        (f"{ALL} rigs, mu up to 1", seconds(lambda: flutter_onsets_many(numbers, threads=2))),
        (
            f"{RIGS} rigs at 61 angles, unstable or not at 51 mu up to 0.5",
            seconds(lambda: flutter_onsets_many(at, mu_max=0.5, threads=2).unstable(mu)),
        ),
    ]


def main() -> None:
    """Print the tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--whole", action="store_true")
    print(machine().removesuffix(", one core used"))
    with threadpool_limits(1):
        print("\n| what | a rig | 100 000 rigs, from that | times faster |\n| --- | --- | --- | --- |")
        for (what, each), ratio in zip(*costs(), strict=True):
            print(f"| {what} | {1e3 * each:.3g} ms | {each * ALL:.3g} s | {ratio:.3g} |")
        print(f"\nLargest relative difference of a friction between both: {errors():.1e}")
        if parser.parse_args().whole:
            print("\n| in full, two threads | seconds |\n| --- | --- |")
            for what, each in whole():
                print(f"| {what} | {each:.3g} |")


if __name__ == "__main__":
    main()
