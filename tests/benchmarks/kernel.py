"""What bounds the steps of `method="fast"`.

The peak is what multiply-adds that need nothing but registers reach on one core, in this run. Beside it: the modes
alone, which is what a step would cost if contact, counting and samples were free; and whole steps. Then what
compiling costs where nothing has been compiled yet.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from fivcore import Rig, Scene
from fivcore.contact.reduced import reduced_model
from fivcore.jit import kernel, reordered_call
from fivcore.transient.fast.kernel import move_both, move_normal
from fivcore.transient.fast.run import aligned
from fivcore.transient.fast.solver import solver_of
from tests.benchmarks.tables import Column, Table
from tests.benchmarks.transient import seconds

SCENE = Scene(5e-3, 5.0, 0.2, 9.0)
# Of a mode in a step: multiply-adds and multiplications, as `kernel.move` and `kernel.move_normal` have them.
BOTH, NORMAL = (9, 3), (6, 3)
# Numbers that are worked on at once: as many as fit into the registers of most processors beside two factors.
WIDE = 56
FIRST = "from fivcore import Scene, simulate; simulate(Scene(5e-3, 5.0, 0.2, 9.0), 0.1)"


@reordered_call
def _multiply_add(values: Any, a: float, b: float, count: int) -> None:
    x = np.empty(WIDE)
    for j in range(WIDE):
        x[j] = values[j]
    for _ in range(count):
        for j in range(WIDE):
            x[j] = x[j] * a + b
    for j in range(WIDE):
        values[j] = x[j]


@kernel
def _registers_alone(values: Any, count: int) -> None:
    _multiply_add(values, 0.5, 1.0, count)


@kernel
def _modes_alone(modes: Any, both: int, others: int, steps: int) -> float:
    total = 0.0
    for _ in range(steps):
        gN, vN = move_normal(modes, np.uint64(both), np.uint64(others), 1e-9)
        more = move_both(modes, both, both + others, 1, 1e-9, 1e-9)
        total += gN + vN + more[0] + more[1] + more[2] + more[3]
    return total


def shortest(run: Callable[[], Any], repeat: int = 15) -> float:
    """Seconds, of the fastest of some runs: what disturbs only adds."""
    times = []
    run()
    for _ in range(repeat):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def peak() -> float:
    """Floating-point operations per second that registers alone allow."""
    values, count = np.ones(WIDE), 200_000
    return 2 * WIDE * count / shortest(lambda: _registers_alone(values, count))


def modes_alone() -> tuple[float, int]:
    """Seconds per step, and operations."""
    model = reduced_model(Rig(), SCENE.theta)
    solver, steps = solver_of(model, model.default_step), 100_000
    both, others = (int(solver.record[name][0]) for name in ("both", "others"))
    modes = aligned(solver.blocks).ravel()
    taken = shortest(lambda: _modes_alone(modes, both, others, steps)) / steps
    operations = zip((both, others), (BOTH, NORMAL), strict=True)
    return taken, sum(count * (2 * fused + plain) for count, (fused, plain) in operations)


def whole() -> float:
    """Seconds per step of a run, all that Python does included; every step taken."""
    steps = 2.0 / reduced_model(Rig(), SCENE.theta).default_step
    return statistics.median(seconds(SCENE, 2.0, "fast", skip_sticks=False) for _ in range(5)) / steps


def first(repeat: int = 3) -> Table:
    """Processor seconds of a fresh process to a first result: with nothing compiled, and with everything."""
    cold, warm = [], []
    for _ in range(repeat):
        with tempfile.TemporaryDirectory() as folder:
            for times in (cold, warm):
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                subprocess.run(
                    [sys.executable, "-c", FIRST], check=True, env=os.environ | {"NUMBA_CACHE_DIR": folder}
                )
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    rows = [["nothing compiled yet", statistics.median(cold)], ["everything compiled", statistics.median(warm)]]
    return Table([Column("first result of a process"), Column("CPU time", "s")], rows)


def steps() -> Table:
    """A step of a scene, beside what registers alone allow; of flops, those of the modes are counted."""
    (alone, operations), most = modes_alone(), peak()
    times = {
        "registers alone": None,
        "modes alone": alone,
        "whole steps": whole(),
    }
    rates = [most if taken is None else operations / taken for taken in times.values()]
    flops = [None if taken is None else operations for taken in times.values()]
    rows = [
        [what, taken, count, rate, rate / most]
        for (what, taken), count, rate in zip(times.items(), flops, rates, strict=True)
    ]
    units = {"what": "", "a step": "s", "flops counted": "", "rate": "flop/s"}
    return Table([*(Column(*each) for each in units.items()), Column("of the peak", "%", ".0f")], rows)


TABLES = {"steps": steps, "first": first}
