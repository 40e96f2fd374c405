"""What leaps know of a stick: how it is packed, and sums over the amplitudes of its eigenvectors."""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import inlined, reordered
from fivcore.transient.lanes import WIDTH, each, fma, load, number_at, store

# What `transient.leaps` packs: how many eigenvalues z of a step, how many modes. Then z to the powers of the next
# LOOKS looks, real parts over all eigenvalues, then negative imaginary parts, (2 eigenvalues, LOOKS) ...
HEAD, LOOKS = WIDTH, 64
# ... then rows over the eigenvalues (real and imaginary parts: log z, 1 / (1 - z), and the readings N, T, velocity
# of B, how much the gap is closed beyond what would open it, and one step earlier penetration and u_T; then how
# far a reading can be off a straight line between two looks) ...
(LOG, SUM, ON_N, ON_T, ON_B, ON_C, WAS_P, WAS_U) = range(0, 16, 2)
BEND = 16
OVER_VALUES = 17
# ... then rows over x = (q, v): what a steady force and a growing one make of it (normal, tangential each), the
# gap shapes, shape at B and stiffness, and for each eigenvalue the real and imaginary parts of the way into its
# coordinate and back.
(STEADY, GROWING, SHAPES, OTHERS, INTO) = (0, 2, 4, 5, 6)


@reordered
def dot(a: Any, b: Any) -> float:
    """Sum of products."""
    total = 0.0
    for j in range(a.shape[0]):
        total += a[j] * b[j]
    return total


@reordered
def turn(re: Any, im: Any, by_re: Any, by_im: Any) -> None:
    """Turn and shrink all amplitudes."""
    for k in range(re.shape[0]):
        x, y = re[k], im[k]
        re[k] = x * by_re[k] - y * by_im[k]
        im[k] = x * by_im[k] + y * by_re[k]


@reordered
def four(over: Any, re: Any, im: Any) -> Any:
    """N, T, velocity of B and closing of the gap, apart from the line."""
    N, T, B, C = 0.0, 0.0, 0.0, 0.0
    for k in range(re.shape[0]):
        x, y = re[k], im[k]
        N += over[ON_N, k] * x - over[ON_N + 1, k] * y
        T += over[ON_T, k] * x - over[ON_T + 1, k] * y
        B += over[ON_B, k] * x - over[ON_B + 1, k] * y
        C += over[ON_C, k] * x - over[ON_C + 1, k] * y
    return N, T, B, C


@reordered
def weigh(over: Any, re: Any, im: Any, into: Any) -> None:
    """What each eigenvalue adds to N, T, velocity of B and closing: real parts, then imaginary parts."""
    count = re.shape[0]
    for reading in range(4):
        row = ON_N + 2 * reading
        for k in range(count):
            into[reading, k] = over[row, k] * re[k] - over[row + 1, k] * im[k]
            into[reading, count + k] = over[row, k] * im[k] + over[row + 1, k] * re[k]


@reordered
def forward(turns: Any, m: int, re: Any, im: Any) -> None:
    """Amplitudes m looks later, m from 1 to LOOKS."""
    count = re.shape[0]
    for k in range(count):
        x, y, c, s = re[k], im[k], turns[k, m - 1], -turns[count + k, m - 1]
        re[k], im[k] = x * c - y * s, x * s + y * c


@inlined
def look_ahead(turns: int, amplitudes: int, readings: int, count: int, width: int) -> None:
    """N, T, velocity of B and closing at the next LOOKS looks, apart from the line; tables by their addresses."""
    rows_of_all = LOOKS // WIDTH
    for block in range(0, rows_of_all, 2):
        N, T, B, C = each(0.0), each(0.0), each(0.0), each(0.0)
        N2, T2, B2, C2 = N, T, B, C
        for j in range(2 * count):
            z, z2 = load(turns, rows_of_all * j + block), load(turns, rows_of_all * j + block + 1)
            a, b = each(number_at(amplitudes, j)), each(number_at(amplitudes, width + j))
            c, d = each(number_at(amplitudes, 2 * width + j)), each(number_at(amplitudes, 3 * width + j))
            N, T, B, C = fma(a, z, N), fma(b, z, T), fma(c, z, B), fma(d, z, C)
            N2, T2, B2, C2 = fma(a, z2, N2), fma(b, z2, T2), fma(c, z2, B2), fma(d, z2, C2)
        store(readings, block, N)
        store(readings, block + 1, N2)
        store(readings + 8 * width, block, T)
        store(readings + 8 * width, block + 1, T2)
        store(readings + 16 * width, block, B)
        store(readings + 16 * width, block + 1, B2)
        store(readings + 24 * width, block, C)
        store(readings + 24 * width, block + 1, C2)


@reordered
def bends(over: Any, re: Any, im: Any, mu: float) -> Any:
    """How far N, mu N - T, mu N + T and the closing can be off straight lines between two looks."""
    N, ahead, back, C = 0.0, 0.0, 0.0, 0.0
    for k in range(re.shape[0]):
        size = over[BEND, k] * np.sqrt(re[k] * re[k] + im[k] * im[k])
        a, b, c, d = over[ON_N, k], over[ON_N + 1, k], over[ON_T, k], over[ON_T + 1, k]
        N += size * np.sqrt(a * a + b * b)
        ahead += size * np.sqrt((mu * a - c) ** 2 + (mu * b - d) ** 2)
        back += size * np.sqrt((mu * a + c) ** 2 + (mu * b + d) ** 2)
        C += size * np.sqrt(over[ON_C, k] ** 2 + over[ON_C + 1, k] ** 2)
    return N, ahead, back, C


@reordered
def powers(over: Any, steps: float, re: Any, im: Any, into_re: Any, into_im: Any) -> None:
    """Amplitudes some steps later."""
    for k in range(re.shape[0]):
        size, angle = np.exp(over[LOG, k] * steps), over[LOG + 1, k] * steps
        c, s = size * np.cos(angle), size * np.sin(angle)
        into_re[k], into_im[k] = re[k] * c - im[k] * s, re[k] * s + im[k] * c


@reordered
def energy(x: Any, shapes: Any, others: Any, K_NN: float, K_NT: float, K_TT: float, uN: float, uT: float) -> float:
    """Of the modes about the equilibrium, the element and the load."""
    n = x.shape[0] // 2
    total = 0.5 * (K_NN * uN * uN + 2.0 * K_NT * uN * uT + K_TT * uT * uT)
    for j in range(n):
        total += 0.5 * (x[n + j] * x[n + j] + others[n + j] * x[j] * x[j]) + shapes[j] * x[j]
    return total


@reordered
def add(x: Any, a: float, one: Any, b: float, other: Any) -> None:
    """Add a times one, less b times the other."""
    for j in range(x.shape[0]):
        x[j] += a * one[j] - b * other[j]


@inlined
def safe(over: Any, re: Any, im: Any, mu: float, N: float, T: float, C: float) -> bool:
    """Whether nothing can end stick between here and a look that is as good."""
    off = bends(over, re, im, mu)
    return off[0] < N and mu * N - T > off[1] and mu * N + T > off[2] and off[3] < C
