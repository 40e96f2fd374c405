"""What a simulated second costs by `fast` and by the published scheme: medians, methods taken in turns."""

from __future__ import annotations

import statistics
import time

from fivcore import Scene, simulate, simulate_many
from tests.benchmarks.tables import Column, Table

SPEEDS = (0.5, 1.0, 2.0, 5.0)


def seconds(scene: Scene, duration: float, method: str = "fast", **given: object) -> float:
    """Processor time of one run."""
    start = time.process_time()
    simulate(scene, duration, method, **given)
    return time.process_time() - start


def together(scene: Scene, duration: float, count: int, **given: object) -> float:
    """Wall time of each of many repeat runs of a scene, which differ by the ramp."""
    ramps = [1e-3 * (1.0 + 0.013 * (k % 64)) for k in range(count)]
    start = time.perf_counter()
    simulate_many([scene] * count, duration, ramp=ramps, **given)
    return (time.perf_counter() - start) / count


def second(repeat: int = 5) -> Table:
    """A simulated second of a scene: of 3 s by `fast`, so that onset and first stick weigh as in a study."""

    def at(speed: float) -> Scene:
        return Scene(speed * 1e-3, 5.0, 0.2, 9.0)

    runs = {f"{speed:g} mm/s": lambda speed=speed: seconds(at(speed), 3.0) / 3.0 for speed in SPEEDS}
    runs["2 mm/s, every step taken"] = lambda: seconds(at(2.0), 3.0, skip_sticks=False) / 3.0
    published = "2 mm/s, `paper`"
    runs[published] = lambda: seconds(at(2.0), 0.3, "paper") / 0.3
    seconds(at(2.0), 0.01, "paper")
    seconds(at(2.0), 0.1)
    times = [[run() for run in runs.values()] for _ in range(repeat)]
    medians = dict(zip(runs, map(statistics.median, zip(*times, strict=True)), strict=True))
    rows = [[what, taken, medians[published] / taken] for what, taken in medians.items()]
    return Table([Column("a simulated second at"), Column("time", "s"), Column("times as fast as `paper`")], rows)


TABLES = {"second": second}
