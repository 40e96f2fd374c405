"""How cost grows, what sticks spare, what a first result costs: `python -m tests.benchmarks.scaling`.

Medians of this one run, one core. Exponents are slopes of straight lines through logarithms; of modes, once what a
step costs without any is taken off. `--figure FILE` draws them. It prints tables of the README.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from threadpoolctl import threadpool_limits

from fivcore import Rig, Scene, simulate, simulate_many
from fivcore.contact.reduced import reduced_model
from studies.plotting import figures
from tests.benchmarks.stability import machine

SCENE = Scene(5e-3, 5.0, 0.2, 9.0)
SPEEDS = (0.5e-3, 0.7e-3, 0.8e-3, 0.92e-3, 1e-3, 1.2e-3, 2e-3, 5e-3)
NEVER = 50e-3
DURATIONS = (4.0, 8.0, 16.0, 32.0, 64.0)
COUNTS = (32, 64, 128, 256, 512)
EACH = 2.0
CUTOFFS = (4e5, 6e5, 9e5, 1.3e6, 2e6, 3e6)
FIRST = "from fivcore import Scene, simulate; simulate(Scene(5e-3, 5.0, 0.2, 9.0), 0.1)"


def together(scene: Scene, duration: float, count: int, **given: Any) -> float:
    """Wall time of scenes side by side, which differ by the ramp, s."""
    ramps = [1e-3 * (1.0 + 0.013 * (k % 64)) for k in range(count)]
    start = time.perf_counter()
    simulate_many([scene] * count, duration, ramp=ramps, **given)
    return time.perf_counter() - start


def medians(runs: Sequence[Any], repeat: int) -> list[float]:
    """Median times of several things, taken in turns."""
    times: list[list[float]] = [[] for _ in runs]
    for _ in range(repeat):
        for found, run in zip(times, runs, strict=True):
            found.append(run())
    return [statistics.median(found) for found in times]


def exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """Slope of a straight line through the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def growth(repeat: int = 3) -> dict[str, tuple[list[float], list[float], float]]:
    """Cost over duration, scenes and modes: x, seconds, exponent."""
    together(SCENE, 0.1, 32)
    by_duration = medians([lambda d=d: together(SCENE, d, 32) for d in DURATIONS], repeat)
    by_count = medians([lambda n=n: together(SCENE, EACH, n) for n in COUNTS], repeat)
    steps, step = 6000, 1e-8
    sizes = [len(reduced_model(Rig(), SCENE.theta, cutoff).rest) for cutoff in CUTOFFS]
    many = [
        lambda cutoff=cutoff: together(SCENE, steps * step, 32, cutoff=cutoff, step=step, leap=False)
        for cutoff in CUTOFFS
    ]
    medians(many, 1)
    by_modes = medians(many, repeat)
    # What a step costs without modes: where the straight line through the cost meets none.
    weights = 1.0 / np.array(by_modes)
    _, without = np.polyfit(sizes, by_modes, 1, w=weights)
    own = [taken - float(without) for taken in by_modes]
    found = {}
    for name, x, y in (
        ("duration, s", list(DURATIONS), by_duration),
        ("scenes", [float(n) for n in COUNTS], by_count),
        ("modes", [float(n) for n in sizes], own),
    ):
        found[name] = (x, y, exponent(x, y))
    rest = 1e9 * float(without) / steps / 32
    print("\nHow the cost grows: 32 scenes of 4 to 64 s; 32 to 512 scenes of 2 s; 32 scenes of 6000 steps with")
    print(f"{sizes[0]} to {sizes[-1]} modes, less {rest:.0f} ns a scene and step for all else.\n")
    print("| cost over | from | to | exponent |")
    print("| --- | --- | --- | --- |")
    for name, (x, _, slope) in found.items():
        print(f"| {name} | {x[0]:g} | {x[-1]:g} | {slope:.3f} |")
    return found


def draw(found: dict[str, tuple[list[float], list[float], float]], path: Path) -> None:
    """Cost over each, in units of the first."""
    with figures.style():
        figure, axis = plt.subplots(figsize=(4.6, 3.6), layout="constrained")
        for marker, (name, (x, y, slope)) in zip("osD", found.items(), strict=True):
            unit = np.array(x) / x[0]
            axis.loglog(unit, np.array(y) / y[0], marker, label=f"{name.split(',')[0]}: exponent {slope:.3f}")
        most = max(x[-1] / x[0] for x, _, _ in found.values())
        axis.loglog([1.0, most], [1.0, most], "-", color="0.6", zorder=0, label="exponent 1")
        axis.set_xlabel("duration, scenes, modes / smallest")
        axis.set_ylabel("cost / smallest")
        axis.legend()
        figure.savefig(path)
        plt.close(figure)


def sticks(repeat: int = 5) -> None:
    """What a simulated second costs, by the share of it that long sticks fill."""
    duration = 3.0
    print(f"\nWhat sticks spare: a simulated second of {duration:g} s, 32 scenes side by side and one alone, in")
    print(f"units of {1e3 * NEVER:g} mm/s, where there are none.\n")
    print("| V, mm/s | in long sticks | side by side, ms | ratio | alone, ms | ratio |")
    print("| --- | --- | --- | --- | --- | --- |")
    shares, runs = [], []
    for V in (NEVER, *SPEEDS):
        scene = Scene(V, 5.0, 0.2, 9.0)
        summary = simulate(scene, duration).summary
        stuck = summary["first_slip_time"] + float(np.sum(summary["stick_times"]))
        shares.append(stuck / duration)
        runs.append(lambda scene=scene: together(scene, duration, 32) / 32)
        runs.append(lambda scene=scene: together(scene, duration, 1))
    times = np.array(medians(runs, repeat)).reshape(-1, 2) / duration
    for V, share, (side, alone) in sorted(zip((NEVER, *SPEEDS), shares, times.tolist(), strict=True)):
        print(
            f"| {1e3 * V:g} | {100.0 * share:.0f} % | {1e3 * side:.2f} | {side / times[0, 0]:.2f}"
            f" | {1e3 * alone:.1f} | {alone / times[0, 1]:.2f} |"
        )


def fresh(folder: str) -> float:
    """Seconds from starting Python to a first result, with compiled code kept in a folder."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", FIRST], check=True, env=os.environ | {"NUMBA_CACHE_DIR": folder})
    return time.perf_counter() - start


def first_result(repeat: int = 5) -> None:
    """What a fresh process costs, with nothing compiled and with everything."""
    cold, warm = [], []
    for _ in range(repeat):
        with tempfile.TemporaryDirectory() as folder:
            cold.append(fresh(folder))
            warm.append(fresh(folder))
    print(
        f"\nA first result, 0.1 s of motion, from the start of Python: {statistics.median(warm):.2f} s,", end=" "
    )
    print(f"and {statistics.median(cold):.1f} s where nothing has been compiled yet (the first time ever)")


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables, and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args(argv)
    print(machine())
    first_result()
    with threadpool_limits(1):
        sticks()
        found = growth()
    if given.figure is not None:
        draw(found, given.figure)


if __name__ == "__main__":
    main()
