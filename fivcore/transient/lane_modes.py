"""What is done to the modes of a group of lanes, within `fivcore.transient.fast_kernel`.

Modes come in three kinds, one after another: those that the contact feels in both directions, along its normal
only and along its tangent only; `sizes` are their numbers, all even. `row` is the group's first row of
coefficients, `first` its first mode.
"""

from __future__ import annotations

from typing import Any

from fivcore.jit import inlined
from fivcore.transient import lane_rows as rows
from fivcore.transient.lanes import each, fma, load, store


@inlined
def both_ways(
    modes: int, row: int, q: int, v: int, j: int, hN: Any, hT: Any, gN: Any, gT: Any, vN: Any, vT: Any
) -> Any:
    """Kick and move a mode; the gaps and their rates with what it adds to them."""
    normal, tangential, was = load(modes, row), load(modes, row + 1), load(q, j)
    rate = fma(tangential, hT, fma(normal, hN, load(v, j)))
    x = fma(load(modes, row + 2), was, load(modes, row + 3) * rate)
    y = fma(load(modes, row + 4), was, load(modes, row + 5) * rate)
    store(q, j, x)
    store(v, j, y)
    return fma(normal, x, gN), fma(tangential, x, gT), fma(normal, y, vN), fma(tangential, y, vT)


@inlined
def one_way(modes: int, row: int, q: int, v: int, j: int, h: Any, gap: Any, rate: Any) -> Any:
    """The same for a mode that the contact feels in one direction."""
    shape, was = load(modes, row), load(q, j)
    kicked = fma(shape, h, load(v, j))
    x = fma(load(modes, row + 1), was, load(modes, row + 2) * kicked)
    y = fma(load(modes, row + 3), was, load(modes, row + 4) * kicked)
    store(q, j, x)
    store(v, j, y)
    return fma(shape, x, gap), fma(shape, y, rate)


@inlined
def kick_and_move(sizes: Any, modes: int, row: int, q: int, v: int, first: int, hN: Any, hT: Any) -> Any:
    """Kick, move freely over one step, and return g_N, g_T and their rates there.

    Two sums of each kind: a sum waits for its last term, and the numbers of modes are even for this.
    """
    both, normal, tangential = sizes
    gN, gT, vN, vT = each(0.0), each(0.0), each(0.0), each(0.0)
    gN2, gT2, vN2, vT2 = gN, gT, vN, vT
    for j in range(first, first + both, 2):
        gN, gT, vN, vT = both_ways(modes, row, q, v, j, hN, hT, gN, gT, vN, vT)
        gN2, gT2, vN2, vT2 = both_ways(modes, row + rows.BOTH, q, v, j + 1, hN, hT, gN2, gT2, vN2, vT2)
        row += 2 * rows.BOTH
    first += both
    for j in range(first, first + normal, 2):
        gN, vN = one_way(modes, row, q, v, j, hN, gN, vN)
        gN2, vN2 = one_way(modes, row + rows.ONE, q, v, j + 1, hN, gN2, vN2)
        row += 2 * rows.ONE
    first += normal
    for j in range(first, first + tangential, 2):
        gT, vT = one_way(modes, row, q, v, j, hT, gT, vT)
        gT2, vT2 = one_way(modes, row + rows.ONE, q, v, j + 1, hT, gT2, vT2)
        row += 2 * rows.ONE
    return gN + gN2, gT + gT2, vN + vN2, vT + vT2


@inlined
def damped(sizes: Any, modes: int, row: int, damping: int, v: int, first: int, hN: Any, hT: Any) -> Any:
    """Power that the modes lose after a kick by hN and hT."""
    both, normal, tangential = sizes
    power, more = each(0.0), each(0.0)
    for j in range(first, first + both, 2):
        rate = fma(load(modes, row + 1), hT, fma(load(modes, row), hN, load(v, j)))
        power = fma(load(damping, j) * rate, rate, power)
        row += rows.BOTH
        rate = fma(load(modes, row + 1), hT, fma(load(modes, row), hN, load(v, j + 1)))
        more = fma(load(damping, j + 1) * rate, rate, more)
        row += rows.BOTH
    for kick, begin, end in ((hN, both, both + normal), (hT, both + normal, both + normal + tangential)):
        for j in range(first + begin, first + end, 2):
            rate = fma(load(modes, row), kick, load(v, j))
            power = fma(load(damping, j) * rate, rate, power)
            row += rows.ONE
            rate = fma(load(modes, row), kick, load(v, j + 1))
            more = fma(load(damping, j + 1) * rate, rate, more)
            row += rows.ONE
    return power + more


@inlined
def along(shape: int, v: int, first: int, end: int) -> Any:
    """Velocity of a point."""
    speed, more = each(0.0), each(0.0)
    for j in range(first, end, 2):
        speed = fma(load(shape, j), load(v, j), speed)
        more = fma(load(shape, j + 1), load(v, j + 1), more)
    return speed + more


@inlined
def follow_shapes(sizes: Any, modes: int, row: int, slides: int, q: int, v: int, first: int) -> Any:
    """Gap shapes of the next step, and by how much the gaps and their rates change with them alone."""
    both, normal, tangential = sizes
    gN, gT, vN, vT = each(0.0), each(0.0), each(0.0), each(0.0)
    # P1's shapes, the only ones that are felt both ways, stay.
    row, first = row + both * rows.BOTH, first + both
    for j in range(first, first + normal):
        slide = load(slides, j)
        store(modes, row, load(modes, row) + slide)
        gN, vN = fma(slide, load(q, j), gN), fma(slide, load(v, j), vN)
        row += rows.ONE
    first += normal
    for j in range(first, first + tangential):
        slide = load(slides, j)
        store(modes, row, load(modes, row) + slide)
        gT, vT = fma(slide, load(q, j), gT), fma(slide, load(v, j), vT)
        row += rows.ONE
    return gN, gT, vN, vT
