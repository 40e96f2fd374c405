"""Compiled kernels of the sliding problem: all eigenvalues of one scalar equation.

With the contact held closed and the friction force at its limit, T = mu N, the undamped eigenvalues lambda
(squared angular frequencies) of the coupled rig are the roots of

    f(lambda) = h_NN + mu h_NT = sum_i (a_i + mu b_i) / (p_i - lambda) = 0,    a = n n,  b = n t,

where p, n, t are the squared frequencies and the normal and tangential gap shapes of the separate beams'
modes. Everything is scaled by the band: p and lambda are in units of (2 pi fmax)^2. Poles near the band are
kept as they are; the many beyond it enter as a power series, f's `tail`, exact to rounding in the band.

The roots are found together by the Ehrlich-Aberth iteration on P(lambda) = f(lambda) prod_i (p_i - lambda),
which converges to each root once (Aberth, Math. Comp. 27, 1973, 339-344), and counted independently by the
argument principle.

Arguments are plain arrays; working space is allocated once a call, outside the loops.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fivcore.jit import Array, Complex, kernel

MOST_SWEEPS = 200
# In place of a count that could not be made.
NO_COUNT = -1_000_000
EPS = 2.220446049250313e-16


@kernel
def value(z: complex, p: Array, c: Array, tail: Array) -> complex:
    """f(z); c = a + mu b, the same for the tail."""
    total = 0j
    for k in range(len(tail) - 1, -1, -1):
        total = total * z + tail[k]
    for i in range(len(p)):
        total += c[i] / (p[i] - z)
    return total


@kernel
def between(x: float, i: int, p: Array, a: Array, tail: Array) -> float:
    """(p_i - x)(p_i+1 - x) f(x) at mu = 0, which falls through zero once between these two poles."""
    rest = 0.0
    for k in range(len(tail) - 1, -1, -1):
        rest = rest * x + tail[k]
    for j in range(len(p)):
        if j != i and j != i + 1:
            rest += a[j] / (p[j] - x)
    return a[i] * (p[i + 1] - x) + a[i + 1] * (p[i] - x) + (p[i] - x) * (p[i + 1] - x) * rest


@kernel
def newton_step(z: complex, p: Array, c: Array, tail: Array) -> tuple[complex, bool]:
    """P(z) / P'(z), with the pole nearest to z taken out of f so that it may be reached.

    Also tells whether f(z) is no more than the rounding of its terms: then z cannot be bettered.
    """
    nearest = 0
    for i in range(1, len(p)):
        if abs(p[i] - z.real) < abs(p[nearest] - z.real):
            nearest = i
    rest, slope = 0j, 0j
    for k in range(len(tail) - 1, -1, -1):
        slope = slope * z + rest
        rest = rest * z + tail[k]
    size = abs(rest.real) + abs(rest.imag)
    others = 0j
    for i in range(len(p)):
        if i != nearest:
            inverse = 1.0 / (p[i] - z)
            term = c[i] * inverse
            rest += term
            size += abs(term.real) + abs(term.imag)
            slope += term * inverse
            others += inverse
    gap = p[nearest] - z
    reduced = c[nearest] + gap * rest
    rounding = abs(reduced) <= 16.0 * EPS * (abs(c[nearest]) + abs(gap) * size)
    derivative = gap * slope - rest - others * reduced
    if derivative == 0.0:
        return 0j, rounding
    return reduced / derivative, rounding


@kernel
def aberth(z: Complex, last: Array, p: Array, c: Array, tail: Array) -> None:
    """Move the guesses `z` (in place) to as many different roots.

    A guess has settled when its steps are too short to matter, or when f is rounding there and the steps get
    no shorter, which near a double root happens earlier. `last` holds the length of the last step, -1 once
    settled.
    """
    n = len(z)
    last[:] = np.inf
    unsettled = n
    for _ in range(MOST_SWEEPS):
        for j in range(n):
            if last[j] < 0.0:
                continue
            step, rounding = newton_step(z[j], p, c, tail)
            crowd = 0j
            for i in range(n):
                if i != j and z[i] != z[j]:
                    crowd += 1.0 / (z[j] - z[i])
            step = step / (1.0 - step * crowd)
            z[j] -= step
            length = abs(step)
            if length <= 4.0 * EPS * abs(z[j]) or (rounding and length >= last[j]):
                last[j] = -1.0
                unsettled -= 1
            else:
                last[j] = length
        if unsettled == 0:
            break


@kernel
def winding(radius: float, p: Array, c: Array, tail: Array) -> int:
    """Roots minus poles of f within |z| < radius, by the argument principle; NO_COUNT if it cannot say.

    f is real on the real axis, so the upper half circle does. Arcs are halved until f changes by less than
    half its size along either half of each.
    """
    turned = 0.0
    angle, width = 0.0, np.pi / 32.0
    here = value(complex(radius, 0.0), p, c, tail)
    while angle < np.pi:
        width = min(width, np.pi - angle)
        end = value(radius * complex(np.cos(angle + width), np.sin(angle + width)), p, c, tail)
        middle_angle = angle + 0.5 * width
        middle = value(radius * complex(np.cos(middle_angle), np.sin(middle_angle)), p, c, tail)
        if abs(middle - here) < 0.5 * min(abs(here), abs(middle)) and abs(end - middle) < 0.5 * abs(middle):
            turned += np.angle(middle / here) + np.angle(end / middle)
            here = end
            angle += width
            width *= 2.0
        else:
            width *= 0.5
            if width < 1e-12:
                return NO_COUNT
    return int(np.rint(turned / np.pi))


@kernel
def _tidy(z: Complex) -> None:
    """Take rounding out of the symmetry: real roots become real, pairs conjugate to the last bit.

    A root near the real axis whose mirror image is no other root is real.
    """
    for j in range(len(z)):
        mirror = z[j].conjugate()
        partner, nearest = j, 0.1 * abs(z[j].imag)
        for i in range(len(z)):
            if i != j and abs(z[i] - mirror) < nearest:
                partner, nearest = i, abs(z[i] - mirror)
        if partner != j:
            z[partner] = mirror
        elif abs(z[j].imag) < 1e-6 * abs(z[j]):
            z[j] = complex(z[j].real, 0.0)


@kernel
def sliding_roots(
    mu: Array,
    p: Array,
    a: Array,
    b: Array,
    tail_a: Array,
    tail_b: Array,
    guesses: Complex,
    radius: float,
    roots: Complex,
    missed: NDArray[np.int64],
) -> None:
    """Fill `roots` (mu, guess) and `missed` (mu), the number of roots within `radius` not found."""
    inside = 0
    for i in range(len(p)):
        if abs(p[i]) < radius:
            inside += 1
    c, tail = np.empty_like(a), np.empty_like(tail_a)
    last = np.empty(len(guesses))
    for m in range(len(mu)):
        for i in range(len(a)):
            c[i] = a[i] + mu[m] * b[i]
        for i in range(len(tail_a)):
            tail[i] = tail_a[i] + mu[m] * tail_b[i]
        z = roots[m]
        z[:] = guesses
        aberth(z, last, p, c, tail)
        # A guess that did not settle inside the circle is a root that was not found.
        found, astray = 0, 0
        for j in range(len(z)):
            if abs(z[j]) < radius:
                if last[j] < 0.0:
                    found += 1
                else:
                    astray += 1
        _tidy(z)
        missed[m] = abs(inside + winding(radius, p, c, tail) - found) + astray


@kernel
def damp(values: Complex, d1: float, d2: float, phi: Complex) -> None:
    """Fill `phi` with the root of phi^2 + (d1 + d2 lambda) phi + lambda = 0 with Im >= 0, for each lambda.

    Of two real roots the larger: the one that grows, or the one that decays more slowly.
    """
    for m in range(values.shape[0]):
        for j in range(values.shape[1]):
            half = 0.5 * (d1 + d2 * values[m, j])
            root = np.sqrt(half * half - values[m, j])
            if half.real * root.real + half.imag * root.imag < 0.0:
                root = -root
            large, small = -half - root, root - half
            # The difference cancels when damping is heavy; the product of both roots is lambda.
            if abs(small) < 0.5 * abs(large):
                small = values[m, j] / large
            chosen = small
            if large.imag > small.imag or (large.imag == small.imag and large.real > small.real):
                chosen = large
            phi[m, j] = complex(chosen.real, chosen.imag + 0.0)
