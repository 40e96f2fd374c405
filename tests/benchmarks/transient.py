"""What a simulated second costs by `fast` and by the published scheme: medians, methods taken in turns."""

from __future__ import annotations

import statistics
import time

import numpy as np

from fivcore import Scene, simulate, simulate_many
from tests.benchmarks.tables import Column, Table

COUNT = 32
SPEEDS = np.linspace(1e-3, 5e-3, COUNT)


def seconds(scene: Scene, duration: float, method: str, **given: object) -> float:
    """Wall time of one run."""
    start = time.perf_counter()
    simulate(scene, duration, method, **given)
    return time.perf_counter() - start


def together(scene: Scene | list[Scene], duration: float, count: int, **given: object) -> float:
    """Wall time of one of many scenes side by side, or of many repeat runs of one, which differ by the ramp."""
    scenes = scene if isinstance(scene, list) else [scene] * count
    ramps = [1e-3 * (1.0 + 0.013 * (k % 64)) for k in range(count)]
    start = time.perf_counter()
    simulate_many(scenes, duration, ramp=ramps, **given)
    return (time.perf_counter() - start) / count


def second(repeat: int = 5) -> Table:
    """A simulated second of a scene: of 3 s by `fast`, so that onset and first stick weigh as in a study."""

    def at(speed: float) -> Scene:
        return Scene(speed, 5.0, 0.2, 9.0)

    def many(scene: Scene | list[Scene], **given: bool) -> float:
        return together(scene, 3.0, COUNT, **given) / 3.0

    runs = {
        f"{COUNT} scenes at 2 mm/s, every step taken": lambda: many(at(2e-3), leap=False),
        f"{COUNT} scenes at 2 mm/s, sticks skipped": lambda: many(at(2e-3)),
        f"{COUNT} scenes at 0.5 mm/s, sticks skipped": lambda: many(at(0.5e-3)),
        "one scene at 2 mm/s, every step taken": lambda: seconds(at(2e-3), 3.0, "fast", leap=False) / 3.0,
        "one scene at 1 mm/s, sticks skipped": lambda: seconds(at(1e-3), 3.0, "fast") / 3.0,
        f"{COUNT} scenes from 1 to 5 mm/s, sticks skipped": lambda: many([at(V) for V in SPEEDS]),
        "one scene at 2 mm/s, `paper`": lambda: seconds(at(2e-3), 0.3, "paper") / 0.3,
    }
    seconds(at(2e-3), 0.01, "paper")
    together(at(2e-3), 0.1, COUNT)
    times = [[run() for run in runs.values()] for _ in range(repeat)]
    rows = [[what, statistics.median(each)] for what, each in zip(runs, zip(*times, strict=True), strict=True)]
    return Table([Column("a simulated second of"), Column("time", "s")], rows)


TABLES = {"second": second}
