"""What bounds the steps of `method="fast"`: `python -m tests.benchmarks.kernel`.

The peak is what multiply-adds that need nothing but registers reach on one core, in this run. Beside it: the modes
alone, which is what a step would cost if contact, counting and samples were free; and whole steps, of scenes side
by side and of one alone. Then what compiling costs where nothing has been compiled yet. It prints a table of
fivcore/README.md.
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
from threadpoolctl import threadpool_limits

from fivcore import Rig, Scene
from fivcore.contact.reduced import reduced_model
from fivcore.jit import kernel, reordered_call
from fivcore.transient import fast_scene as at
from fivcore.transient.driver import AT_ONCE
from fivcore.transient.fast import aligned
from fivcore.transient.fast_kernel import apply_impulse
from fivcore.transient.fast_solver import frozen_solver
from tests.benchmarks.stability import machine
from tests.benchmarks.transient import together

SCENE = Scene(5e-3, 5.0, 0.2, 9.0)
# Of a mode in a step: multiply-adds and multiplications, as `apply_impulse` has them.
FUSED, PLAIN = 8, 2
# Numbers that are worked on at once: as many as fill the registers of most processors and wait for nothing.
WIDE = 64
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
def _modes_alone(blocks: Any, size: int, steps: int) -> float:
    first, left, total = np.uint64(0), np.uint64(size), 0.0
    whole, room = np.uint64(at.BLOCK), np.uint64(at.BLOCK_SIZE)
    for _ in range(steps):
        for k in range((size + at.BLOCK - 1) // at.BLOCK):
            count = min(left - np.uint64(k) * whole, whole)
            gN, gT, vN, vT = apply_impulse(blocks, first + np.uint64(k) * room, count, 1e-9, 1e-9)
            total += gN + gT + vN + vT
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
    return 2 * WIDE * count / shortest(lambda: _multiply_add(values, 0.5, 1.0, count))


def modes_alone() -> float:
    """Seconds per scene and step."""
    model = reduced_model(Rig(), SCENE.theta)
    solver, steps = frozen_solver(model, SCENE.mu, model.default_step), 100_000
    blocks = aligned(solver.blocks.size)
    blocks[:] = solver.blocks.ravel()
    return shortest(lambda: _modes_alone(blocks, solver.size, steps)) / steps


def whole(count: int) -> float:
    """Seconds per scene and step of a sweep, all that Python does included; every step taken."""
    steps = 2.0 / reduced_model(Rig(), SCENE.theta).default_step
    return statistics.median(together(SCENE, 2.0, count, leap=False) for _ in range(5)) / steps


def first_compile(repeat: int = 3) -> tuple[float, float]:
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
    return statistics.median(cold), statistics.median(warm)


def main() -> None:
    """Print the table."""
    with threadpool_limits(1):
        print(machine())
        model = reduced_model(Rig(), SCENE.theta)
        size = frozen_solver(model, SCENE.mu, model.default_step).size
        operations, most = size * (2 * FUSED + PLAIN), peak()
        print(f"\nPeak of one core: {most / 1e9:.1f} Gflop/s. A step of a scene has, for {size} places of modes,")
        print(f"{FUSED * size} multiply-adds and {PLAIN * size} multiplications.\n")
        print("| | ns a scene and step | flops counted | Gflop/s | of the peak |")
        print("| --- | --- | --- | --- | --- |")
        rows = {
            "modes alone": modes_alone(),
            f"whole steps, {AT_ONCE} scenes": whole(AT_ONCE),
            "whole steps, one scene": whole(1),
        }
        for name, taken in rows.items():
            rate = operations / taken
            print(
                f"| {name} | {1e9 * taken:.1f} | {operations} | {rate / 1e9:.1f} | {100.0 * rate / most:.0f} % |"
            )
        print("\nCounted are the modes' operations only.")
        cold, warm = first_compile()
        print(f"A first result takes {cold:.1f} s of the processor where nothing has been compiled yet,", end=" ")
        print(f"and {warm:.1f} s later")


if __name__ == "__main__":
    main()
