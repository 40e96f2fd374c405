"""How cost grows with duration, scenes and modes; measuring also draws results/reference/scaling.png.

Medians of one run, one core. Exponents are slopes of straight lines through logarithms; of modes, once what a step
costs without any is taken off.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from fivcore import Rig, Scene
from fivcore.contact.reduced import reduced_model
from studies.plotting import figures
from tests import HOME
from tests.benchmarks.tables import Column, Table
from tests.benchmarks.transient import together

SCENE = Scene(5e-3, 5.0, 0.2, 9.0)
DURATIONS = (4.0, 8.0, 16.0, 32.0, 64.0)
COUNTS = (32, 64, 128, 256, 512)
EACH = 2.0
FIGURE = HOME / "results" / "reference" / "scaling.png"
CUTOFFS = (4e5, 6e5, 9e5, 1.3e6, 2e6, 3e6)


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
    by_count = medians([lambda n=n: n * together(SCENE, EACH, n) for n in COUNTS], repeat)
    steps, step = 6000, 1e-8
    sizes = [len(reduced_model(Rig(), SCENE.theta, cutoff).normal) for cutoff in CUTOFFS]
    many = [
        lambda cutoff=cutoff: together(SCENE, steps * step, 32, cutoff=cutoff, step=step, skip_sticks=False)
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


def exponents() -> Table:
    """Of 32 scenes of 4 to 64 s, 32 to 512 scenes of 2 s, and 32 scenes of 6000 steps with ever more modes."""
    found = growth()
    draw(found, FIGURE)
    rows = [[name, x[0], x[-1], slope] for name, (x, _, slope) in found.items()]
    return Table([Column("cost over"), Column("from"), Column("to"), Column("exponent", form=".3f")], rows)


TABLES = {"exponents": exponents}
