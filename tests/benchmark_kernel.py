"""What bounds the steps of `method="fast"`: `python -m tests.benchmark_kernel`.

The peak is what fused multiply-adds that need nothing but registers reach on one core, in this run. Beside it: the
modes alone, which is what a step would cost if contact, counting and listening were free; and whole steps, scenes
side by side. It prints a table of the README.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits

from fivcore import Rig, Scene, simulate_many
from fivcore.contact.reduced import reduced_model
from fivcore.jit import kernel
from fivcore.transient import lane_rows as rows
from fivcore.transient.bench import GROUPS
from fivcore.transient.fast_solver import frozen_solver
from fivcore.transient.lane_modes import kick_and_move
from fivcore.transient.lanes import WIDTH, aligned, each, fma, load, store
from tests.benchmark_stability import machine

SCENE = Scene(5e-3, 5.0, 0.2, 9.0)
# Of a mode that is felt in both directions, and in one: multiply-adds, multiplications, loads, stores.
BOTH, ONE = (8, 2, 8, 2), (5, 2, 7, 2)


@kernel
def _multiply_add(table: int, count: int) -> None:
    a, b = load(table, 0), load(table, 1)
    c0, c1, c2, c3, c4, c5, c6, c7 = a, a, a, a, a, a, a, a
    d0, d1, d2, d3, d4, d5, d6, d7 = b, b, b, b, b, b, b, b
    for _ in range(count):
        c0, c1, c2, c3 = fma(c0, a, b), fma(c1, a, b), fma(c2, a, b), fma(c3, a, b)
        c4, c5, c6, c7 = fma(c4, a, b), fma(c5, a, b), fma(c6, a, b), fma(c7, a, b)
        d0, d1, d2, d3 = fma(d0, a, b), fma(d1, a, b), fma(d2, a, b), fma(d3, a, b)
        d4, d5, d6, d7 = fma(d4, a, b), fma(d5, a, b), fma(d6, a, b), fma(d7, a, b)
    c = (c0 + c1) + (c2 + c3) + (c4 + c5) + (c6 + c7)
    store(table, 2, c + (d0 + d1) + (d2 + d3) + (d4 + d5) + (d6 + d7))


@kernel
def _modes_alone(
    both: int, normal: int, tangential: int, modes: int, q: int, v: int, out: int, steps: int
) -> None:
    size = both + normal + tangential
    height = rows.BOTH * both + rows.ONE * (normal + tangential)
    for _ in range(steps):
        for group in range(GROUPS):
            gN, gT, vN, vT = kick_and_move(
                (both, normal, tangential), modes, group * height, q, v, group * size, each(1e-9), each(1e-9)
            )
            store(out, group, gN + gT + vN + vT)


def shortest(run: Callable[[], None], repeat: int = 15) -> float:
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
    table, count = aligned(3), 200_000
    table[0], table[1] = 0.5, 1.0
    taken = shortest(lambda: _multiply_add(table.ctypes.data, count))
    return 16 * WIDTH * 2 * count / taken


def modes_alone() -> float:
    """Seconds per scene and step."""
    model = reduced_model(Rig(), SCENE.theta)
    solver = frozen_solver(model, SCENE.mu, model.default_step)
    size = sum(solver.sizes)
    modes = aligned(GROUPS * len(solver.coefficients))
    modes[:] = np.tile(solver.coefficients, GROUPS)[:, None]
    q, v, out, steps = aligned(GROUPS * size), aligned(GROUPS * size), aligned(GROUPS), 20_000
    places = [part.ctypes.data for part in (modes, q, v, out)]
    return shortest(lambda: _modes_alone(*solver.sizes, *places, steps)) / (steps * GROUPS * WIDTH)


def whole() -> float:
    """Seconds per scene and step of a sweep, all that Python does included; every step taken."""
    duration, count = 2.0, 2 * GROUPS * WIDTH
    steps = duration / reduced_model(Rig(), SCENE.theta).default_step
    times = []
    for _ in range(5):
        start = time.perf_counter()
        simulate_many([SCENE] * count, duration, ramp=[1e-3 * (1.0 + 0.013 * k) for k in range(count)], leap=False)
        times.append((time.perf_counter() - start) / count / steps)
    return statistics.median(times)


def main() -> None:
    """Print the table."""
    with threadpool_limits(1):
        print(machine())
        model = reduced_model(Rig(), SCENE.theta)
        both, normal, tangential = frozen_solver(model, SCENE.mu, model.default_step).sizes
        fused, plain, loads, stores = (
            both * of_both + (normal + tangential) * of_one for of_both, of_one in zip(BOTH, ONE, strict=True)
        )
        operations = 2 * fused + plain
        most = peak()
        print(
            f"\nPeak of one core: {most / 1e9:.1f} Gflop/s. Modes felt in both directions, along the normal, along"
        )
        print(
            f"the tangent: {both}, {normal}, {tangential}. A step of {WIDTH} scenes has, for their modes, {fused}"
        )
        print(f"multiply-adds and {plain} multiplications, {loads} loads and {stores} stores of a register.\n")
        print("| | ns a scene and step | flops counted | Gflop/s | of the peak |")
        print("| --- | --- | --- | --- | --- |")
        for name, taken in (("modes alone", modes_alone()), ("whole steps", whole())):
            rate = operations / taken
            print(
                f"| {name} | {1e9 * taken:.2f} | {operations} | {rate / 1e9:.1f} | {100.0 * rate / most:.0f} % |"
            )
        print("\nCounted are the modes' operations only.")


if __name__ == "__main__":
    main()
