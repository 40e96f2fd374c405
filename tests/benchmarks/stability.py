"""What the linear half costs: medians over repetitions in one run, on one core."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from scipy.linalg import eigvals, null_space

from fivcore import Rig, flutter_onsets, onset_sensitivity, sliding_modes
from fivcore.beams import modes as bases
from fivcore.stability.exponents import band_modes
from tests.benchmarks.tables import Column, Table
from tests.helpers import reference


def median(run, repeat: int, prepare=lambda: None) -> float:
    """Median seconds of `run` after `prepare`, which is not timed."""
    times = []
    for _ in range(repeat):
        prepare()
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def forget() -> None:
    """Drop every basis."""
    for cached in (bases.lower_basis, bases.upper_basis, bases.cantilever_modes, bases.axial, bases.bending):
        cached.cache_clear()
    band_modes.cache_clear()


def dense(rig: Rig, theta: float, mu: float) -> float:
    """Seconds for the same modes by a dense generalised eigenproblem of all free degrees of freedom."""
    k, m, normal, tangential = reference.assemble(rig, theta)
    right, left = null_space(normal[None]), null_space((normal + mu * tangential)[None])
    stiffness, mass = left.T @ k @ right, left.T @ m @ right
    return median(lambda: eigvals(stiffness, mass), 3)


def costs() -> Table:
    """What each takes, and the most it may."""
    rig, fiv = Rig(), [str(Path(sys.executable).with_name("fiv")), "--help"]
    angles = iter(np.linspace(4.0, 12.0, 100_001))
    frictions = iter(np.linspace(0.1, 0.4, 100_001))
    flutter_onsets(rig, 5.0)
    sliding_modes(rig, 5.0, 0.2)
    new_rig = median(lambda: flutter_onsets(rig, 5.0), 51, forget)
    new_theta = median(lambda: flutter_onsets(rig, next(angles)), 201)
    first = median(lambda: sliding_modes(rig, next(angles), 0.2), 201)
    sliding_modes(rig, 5.0, 0.2)
    one = median(lambda: sliding_modes(rig, 5.0, next(frictions)), 1001)
    many = median(lambda: sliding_modes(rig, 5.0, np.linspace(0.0, 0.5, 1001)), 21) / 1001
    theta, mu = np.linspace(-5.0, 20.0, 251), np.linspace(0.0, 0.5, 201)
    table = median(lambda: sliding_modes(rig, theta[:, None], mu), 3, forget)
    curve = median(lambda: [flutter_onsets(rig, angle, mu_max=0.5) for angle in theta], 3, forget)
    start_up = median(lambda: subprocess.run(fiv, stdout=subprocess.DEVNULL, check=True), 21)
    rows = [
        ["flutter onsets, new rig: both bases built", new_rig, 20e-3],
        ["flutter onsets, new theta: P2's basis kept", new_theta, 5e-3],
        ["flutter onsets with all derivatives", median(lambda: onset_sensitivity(rig, 5.0), 21), 40e-3],
        ["sliding modes, first mu at a new theta", first, None],
        ["sliding modes, one further mu", one, 0.3e-3],
        ["sliding modes, each mu of an array", many, 0.1e-3],
        ["growth rates at 251 x 201 (theta, mu)", table, 10.0],
        ["onset curves mu(theta) at 251 theta, by roots", curve, None],
        ["one mu by a dense QZ of the finite elements", dense(rig, 5.0, 0.2), None],
        ["fiv --help", start_up, 0.2],
    ]
    return Table([Column("what"), Column("median", "s"), Column("at most", "s")], rows)


TABLES = {"costs": costs}
