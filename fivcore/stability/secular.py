"""The characteristic equation of steady sliding: one scalar equation that has every eigenvalue as a root.

With the contact closed and T = mu N, the undamped eigenvalues lambda (rad2/s2; section 3.4 of the paper) are the
roots of f(lambda) = h_NN + mu h_NT = sum_i (a_i + mu b_i) / (p_i - lambda) = 0, a = n n, b = n t, where p, n, t
are the squared frequencies and the normal and tangential gap shapes of the separate beams' modes. Poles far beyond
the band enter as a power series, exact to rounding. The Ehrlich-Aberth iteration on P = f prod_i (p_i - lambda)
finds all roots together (Aberth, Math. Comp. 27, 1973, 339-344). The argument principle counts them independently.

With damping by mode (`fivcore.stability.by_mode`) p - lambda becomes p + c phi + phi^2, and the same kernels find
the exponents phi: where p is (2, n) its rows are p and c. Friction that falls with the speed
(`fivcore.stability.falling`) makes f bilinear, r - phi (a c - b^2), each of the four such a sum: c is then (4, n).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fivcore.beams.modes import EPS
from fivcore.errors import UnsolvedError
from fivcore.finite_elements import STATIC
from fivcore.jit import Array, Complex, kernel
from fivcore.rig import Structural
from fivcore.structure import Structure, structure_of

# In units of the band's lambda: roots are counted within this; eigenvalues reported are at most MOST_REPORTED.
RADIUS, MOST_REPORTED = 6.0, 5.0
# Where a guess goes that finds no root: far beyond any band.
OUTSIDE = 1e12


@dataclass(frozen=True, eq=False)
class SlidingProblem:
    """The sliding problem of one rig, theta and band, ready for any mu; `unit` is the unit of every lambda."""

    # The band's lambda, (2 pi fmax)^2 unless damping is heavy, rad2/s2.
    unit: float
    # Poles near the band, (n,), or stiffness and damping of their modes, (2, n); residues a without friction and b
    # for each unit of mu, (2, n).
    poles: Array
    residues: Array
    # Power series of the far poles, likewise, (2, terms).
    tail: Array
    # Where the search for roots starts: from the roots without friction.
    guesses: Complex
    # Eigenvalues of uncoupled modes, with a node at the contact, (k,).
    uncoupled: Array | Complex


@lru_cache(maxsize=128)
def sliding_problem(rig: Structural, theta: float, fmax: float) -> SlidingProblem:
    """Poles, residues, tail and guesses of the sliding problem, cached."""
    own = structure_of(rig, theta)
    omega = 2.0 * np.pi * fmax
    # The largest lambda on the imaginary axis of the band; omega^2 but for heavy damping.
    unit = omega * max(omega, np.hypot(omega, rig.d1) / np.hypot(1.0, rig.d2 * omega))
    p, residues = contact_terms(own, unit)
    order = np.argsort(p, kind="stable")
    p, residues = p[order], residues[:, order]
    # A mode with a node at the contact keeps its eigenvalue: its root is nearer to the pole than rounding.
    static = np.sum(residues[0, p > 0.0] / p[p > 0.0])
    coupled = np.abs(residues).max(axis=0) > 1e-17 * static * p
    uncoupled, p, residues = p[~coupled], p[coupled], residues[:, coupled]
    # Of two modes with one frequency, one combination leaves the gap closed and is uncoupled.
    single = np.diff(p, prepend=-np.inf) > 4.0 * EPS * p
    uncoupled = np.append(uncoupled, p[~single])
    p, residues = p[single], np.add.reduceat(residues, np.nonzero(single)[0], axis=1)
    # Poles are kept up to five times the band's frequency, so that the power series of the others gains a factor
    # of 25 a term in the band and of 4 at RADIUS; and one beyond the band, so that every root lies between two.
    near = max(int(np.searchsorted(p, 25.0)), min(int(np.searchsorted(p, 1.0)) + 2, len(p)))
    powers = p[near:] ** -np.arange(1.0, 27.0)[:, None]
    # Not a matrix product: BLAS would round differently with the number of its threads.
    tail = (residues[:, None, near:] * powers).sum(axis=-1)
    p, residues = p[:near], residues[:, :near].copy()
    # Without friction the residues are positive: one root between any two poles, here as if there were no others.
    a = residues[0]
    roots = ((a[:-1] * p[1:] + a[1:] * p[:-1]) / (a[:-1] + a[1:])).astype(complex)
    aberth(roots, p, a, tail[0])
    # Neighbours start on opposite sides of the real axis, ready to become a pair.
    guesses = roots * (1.0 + np.where(np.arange(near - 1) % 2, 1e-3j, -1e-3j))
    if np.any(tail):
        # One more for what friction may bring in from outside, above all along the negative real axis.
        guesses = np.append(guesses, RADIUS * (-1.0 + 0.1j))
    return SlidingProblem(unit, p, residues, tail, guesses, np.sort(uncoupled[uncoupled <= RADIUS]))


def contact_terms(own: Structure, unit: float) -> tuple[Array, Array]:
    """Poles (n,) and residues (2, n) of all modes, as in `SlidingProblem`."""
    p, residues = own.stiffness / unit, own.normal * np.stack([own.normal, own.tangential]) / unit
    if own.static:
        # In any band static modes are compliances, so far beyond it that they are nothing else.
        further = np.maximum(STATIC / p[-own.static :], 1.0)
        p[-own.static :] *= further
        residues[:, -own.static :] *= further
    return p, residues


def sliding_roots(problem: SlidingProblem, mu: float) -> Complex:
    """All roots within RADIUS, and perhaps others; an ArithmeticError if the count says that one is missing."""
    c, tail = (each[0] + mu * each[1] for each in (problem.residues, problem.tail))
    return all_roots(problem, c, tail, mu)


def all_roots(problem: SlidingProblem, c: Array, tail: Array, mu: float) -> Complex:
    """`sliding_roots` of given residues and tail; `mu` is named in the message."""
    roots, more = problem.guesses.copy(), 0
    for _ in range(6):
        missing = find_roots(roots, problem.poles, c, tail)
        if not missing:
            return roots
        # More roots have come into the circle than there are guesses (large mu, on few rigs).
        more += min(abs(missing), 2 * problem.poles.shape[-1])
        roots = np.append(problem.guesses, RADIUS * np.exp(2j * np.pi * (np.arange(more) + 0.3) / more))
    raise UnsolvedError(
        f"mu = {mu!r}: some exponents of steady sliding could not be found; another mu or fmax near it will do"
    )


@kernel
def nearest_pole(x: float, p: Array) -> int:
    """Index of the pole nearest to x."""
    best = 0
    for i in range(1, len(p)):
        if abs(p[i] - x) < abs(p[best] - x):
            best = i
    return best


@kernel
def falling_value(z: complex, p: Array, c: Array, tail: Array) -> complex:
    """`value` with friction that falls."""
    sums = np.zeros(4, dtype=np.complex128)
    for k in range(tail.shape[1] - 1, -1, -1):
        for r in range(4):
            sums[r] = sums[r] * z + tail[r, k]
    for i in range(p.shape[1]):
        inverse = 1.0 / (p[0, i] + z * (p[1, i] + z))
        for r in range(4):
            sums[r] += c[r, i] * inverse
    return sums[0] - z * (sums[1] * sums[3] - sums[2] * sums[2])


@kernel
def value(z: complex, p: Array, c: Array, tail: Array) -> complex:
    """f(z); c = a + mu b, the same for the tail."""
    total = 0j
    if c.ndim == 2:
        return falling_value(z, p, c, tail)
    for k in range(len(tail) - 1, -1, -1):
        total = total * z + tail[k]
    if p.ndim == 2:
        for i in range(p.shape[1]):
            total += c[i] / (p[0, i] + z * (p[1, i] + z))
    else:
        for i in range(len(p)):
            total += c[i] / (p[i] - z)
    return total


@kernel
def newton_step(z: complex, p: Array, c: Array, tail: Array) -> tuple[complex, bool]:
    """P(z) / P'(z), the nearest pole taken out of f, and whether f(z) is no more than rounding of its terms."""
    nearest = nearest_pole(z.real, p)
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
    return reduced / derivative if derivative != 0.0 else 0j, rounding


@kernel
def damped_step(z: complex, p: Array, c: Array, tail: Array) -> tuple[complex, bool]:
    """`newton_step` with damping by mode; P = f prod_i (p_i + c_i phi + phi^2)."""
    nearest, least = 0, np.inf
    rest, slope = 0j, 0j
    for k in range(len(tail) - 1, -1, -1):
        slope = slope * z + rest
        rest = rest * z + tail[k]
    for i in range(p.shape[1]):
        distance = abs(p[0, i] + z * (p[1, i] + z))
        if distance < least:
            nearest, least = i, distance
    size = abs(rest.real) + abs(rest.imag)
    others = 0j
    for i in range(p.shape[1]):
        if i != nearest:
            inverse = 1.0 / (p[0, i] + z * (p[1, i] + z))
            term, fall = c[i] * inverse, (p[1, i] + 2.0 * z) * inverse
            rest += term
            size += abs(term.real) + abs(term.imag)
            slope -= term * fall
            others += fall
    gap = p[0, nearest] + z * (p[1, nearest] + z)
    reduced = c[nearest] + gap * rest
    parts = p[0, nearest] + abs(z) * (p[1, nearest] + abs(z))
    rounding = abs(reduced) <= 16.0 * EPS * (abs(c[nearest]) + abs(gap) * size + parts * abs(rest))
    derivative = gap * slope + (p[1, nearest] + 2.0 * z) * rest + others * reduced
    return reduced / derivative if derivative != 0.0 else 0j, rounding


@kernel
def falling_step(z: complex, p: Array, c: Array, tail: Array) -> tuple[complex, bool]:
    """`damped_step` with friction that falls; a c = b^2 for each mode, so that f has no double poles."""
    nearest, least = 0, np.inf
    # Each sum, its derivative, and the size of its terms.
    sums, slopes, sizes = np.zeros(4, dtype=np.complex128), np.zeros(4, dtype=np.complex128), np.zeros(4)
    for k in range(tail.shape[1] - 1, -1, -1):
        for r in range(4):
            slopes[r] = slopes[r] * z + sums[r]
            sums[r] = sums[r] * z + tail[r, k]
    for r in range(4):
        sizes[r] = abs(sums[r].real) + abs(sums[r].imag)
    for i in range(p.shape[1]):
        distance = abs(p[0, i] + z * (p[1, i] + z))
        if distance < least:
            nearest, least = i, distance
    others = 0j
    for i in range(p.shape[1]):
        if i != nearest:
            inverse = 1.0 / (p[0, i] + z * (p[1, i] + z))
            fall = (p[1, i] + 2.0 * z) * inverse
            others += fall
            for r in range(4):
                term = c[r, i] * inverse
                sums[r] += term
                slopes[r] -= term * fall
                sizes[r] += abs(term.real) + abs(term.imag)
    gap, rise = p[0, nearest] + z * (p[1, nearest] + z), p[1, nearest] + 2.0 * z
    own, a, b, t = c[0, nearest], c[1, nearest], c[2, nearest], c[3, nearest]
    product = sums[1] * sums[3] - sums[2] * sums[2]
    mixed = a * sums[3] + t * sums[1] - 2.0 * b * sums[2] + gap * product
    change = a * slopes[3] + t * slopes[1] - 2.0 * b * slopes[2] + rise * product
    change += gap * (slopes[1] * sums[3] + sums[1] * slopes[3] - 2.0 * sums[2] * slopes[2])
    reduced = own + gap * sums[0] - z * mixed
    parts = p[0, nearest] + abs(z) * (p[1, nearest] + abs(z))
    size = a * sizes[3] + t * sizes[1] + 2.0 * abs(b) * sizes[2] + parts * abs(product)
    size = abs(z) * (size + abs(gap) * (sizes[1] * sizes[3] + sizes[2] * sizes[2]))
    size += abs(own) + abs(gap) * sizes[0] + parts * abs(sums[0])
    derivative = rise * sums[0] + gap * slopes[0] - mixed - z * change + others * reduced
    return reduced / derivative if derivative != 0.0 else 0j, abs(reduced) <= 16.0 * EPS * size


@kernel
def aberth(z: Complex, p: Array, c: Array, tail: Array) -> None:
    """Move the guesses `z` (in place) to as many different roots; one that does not settle goes OUTSIDE."""
    n = len(z)
    last = np.full(n, np.inf)
    for _ in range(200):
        for j in range(n):
            if last[j] < 0.0:
                continue
            if c.ndim == 2:
                step, rounding = falling_step(z[j], p, c, tail)
            elif p.ndim == 2:
                step, rounding = damped_step(z[j], p, c, tail)
            else:
                step, rounding = newton_step(z[j], p, c, tail)
            crowd = 0j
            for i in range(n):
                if i != j and z[i] != z[j]:
                    crowd += 1.0 / (z[j] - z[i])
            step = step / (1.0 - step * crowd)
            length = abs(step)
            if not length < OUTSIDE:
                # So far outside the series has no value; NaN would spread to all others.
                z[j], last[j] = OUTSIDE, -1.0
                continue
            z[j] -= step
            # Near a double root f is rounding, and steps get no shorter, before they are too short to matter.
            if length <= 4.0 * EPS * abs(z[j]) or (rounding and length >= last[j]):
                length = -1.0
            last[j] = length
        if n == 0 or last.max() < 0.0:
            return
    for j in range(n):
        if last[j] >= 0.0:
            z[j] = OUTSIDE


@kernel
def winding(p: Array, c: Array, tail: Array) -> int:
    """Roots minus poles of f within RADIUS by the argument principle on half the circle; -1e6 if it fails."""
    turned, angle, width = 0.0, 0.0, np.pi / 32.0
    here = value(complex(RADIUS), p, c, tail)
    while angle < np.pi:
        width = min(width, np.pi - angle)
        if p.ndim == 2:
            # A root next to a pole turns f only within some of their distance, which a longer step would miss.
            # Without damping by mode they are on the real axis, where the path begins and ends.
            z = RADIUS * np.exp(1j * angle)
            for i in range(p.shape[1]):
                away = abs(p[0, i] + z * (p[1, i] + z)) / (RADIUS + p[1, i] + np.sqrt(p[0, i]))
                width = min(width, max(0.5 * away / RADIUS, 1e-9))
        middle = value(RADIUS * np.exp(1j * (angle + 0.5 * width)), p, c, tail)
        end = value(RADIUS * np.exp(1j * (angle + width)), p, c, tail)
        if abs(middle - here) < 0.5 * min(abs(here), abs(middle)) and abs(end - middle) < 0.5 * abs(middle):
            turned += np.angle(end / here)
            here = end
            angle += width
            width *= 2.0
        elif width < 1e-12:
            return -1_000_000
        else:
            width *= 0.5
    return int(np.rint(turned / np.pi))


@kernel
def find_roots(z: Complex, p: Array, c: Array, tail: Array) -> int:
    """Move the guesses `z` (in place) to roots, real or exactly conjugate; return how many are missing."""
    aberth(z, p, c, tail)
    missing = winding(p, c, tail)
    if p.ndim == 2:
        for i in range(p.shape[1]):
            half = 0.5 * p[1, i]
            root = np.sqrt(complex(half * half - p[0, i]))
            large = abs(half + root)
            missing += large < RADIUS
            missing += p[0, i] < RADIUS * large or large == 0.0
    else:
        for i in range(len(p)):
            missing += p[i] < RADIUS
    for j in range(len(z)):
        missing -= abs(z[j]) < RADIUS
        mirror = z[j].conjugate()
        partner, nearest = j, 0.1 * abs(z[j].imag)
        for i in range(len(z)):
            if i != j and abs(z[i] - mirror) < nearest:
                partner, nearest = i, abs(z[i] - mirror)
        if partner != j:
            z[partner] = mirror
        elif abs(z[j].imag) < 1e-6 * abs(z[j]):
            z[j] = complex(z[j].real)
    return missing


@kernel
def damp(values: Complex, d1: float, d2: float, phi: Complex) -> None:
    """Root `phi` of phi^2 + (d1 + d2 lambda) phi + lambda = 0 with Im >= 0, or the larger of two real roots."""
    for j in range(len(values)):
        half = 0.5 * (d1 + d2 * values[j])
        root = np.sqrt(half * half - values[j])
        if half.real * root.real + half.imag * root.imag < 0.0:
            root = -root
        large, chosen = -half - root, root - half
        # The difference cancels when damping is heavy; the product of both roots is lambda.
        if abs(chosen) < 0.5 * abs(large):
            chosen = values[j] / large
        if large.imag > chosen.imag or (large.imag == chosen.imag and large.real > chosen.real):
            chosen = large
        phi[j] = complex(chosen.real, chosen.imag + 0.0)
