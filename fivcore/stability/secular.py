"""The characteristic equation of steady sliding: one scalar equation that has every eigenvalue as a root.

With the contact held closed and the friction force at its limit, T = mu N, the undamped eigenvalues lambda
(squared angular frequencies; section 3.4 of the paper) of the coupled rig are the roots of

    f(lambda) = h_NN + mu h_NT = sum_i (a_i + mu b_i) / (p_i - lambda) = 0,    a = n n,  b = n t,

where p, n, t are the squared frequencies and the normal and tangential gap shapes of the separate beams' modes.
Everything is scaled by the band: p and lambda are in units of (2 pi fmax)^2. Poles near the band are kept as they
are; the many beyond it enter as a power series, the `tail`, exact to rounding in the band.

The Ehrlich-Aberth iteration on P(lambda) = f(lambda) prod_i (p_i - lambda) finds all roots together and converges
to each once (Aberth, Math. Comp. 27, 1973, 339-344). The argument principle counts them independently.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.optimize import brentq

from fivcore.beams.modes import contact_modes, one_blas_thread
from fivcore.jit import Array, Complex, kernel
from fivcore.rig import Rig

# Poles up to this many times the band (in frequency) are kept; the power series of the others then gains a factor
# of 25 a term within the band and of 2.8 on the largest circle on which roots are counted.
NEAR = 5.0
TAIL_TERMS = 26
# Eigenvalues up to this many times the band's lambda belong to a result, so that a mode may grow or decay at up to
# 1.7 times the band's angular frequency. The counted circle lies between here and MOST_COUNTED.
MOST_REPORTED = 4.0
MOST_COUNTED = 9.0
# Fills places for which there is no eigenvalue: far beyond any band.
OUTSIDE = 1e12
MOST_SWEEPS = 200
# In place of a count that could not be made.
NO_COUNT = -1_000_000
EPS = 2.220446049250313e-16


@dataclass(frozen=True, eq=False)
class SlidingProblem:
    """The sliding problem of one rig, theta and band, ready for any mu.

    Attributes
    ----------
    unit : float
        The band's lambda, (2 pi fmax)^2 unless damping is heavy, rad2/s2; it scales all below but the last three.
    poles, a, b : ndarray, (n,)
        Near poles and their residues: a without friction, b for each unit of mu.
    tail_a, tail_b : ndarray, (TAIL_TERMS,)
        Power series of the far poles.
    guesses : ndarray, (guesses,)
        Where the search for roots starts: from the roots without friction.
    radius : float
        Of the circle in which the roots are counted.
    hidden : ndarray, (k,)
        Eigenvalues that the contact does not feel.
    hidden_modes : ndarray, (k, 2)
        Their modes among those of the separate beams: one and -1, or two of which a combination is hidden.
    stiffness, normal, tangential : ndarray, (all modes,)
        As `contact_modes` gives them, SI.
    """

    unit: float
    poles: Array
    a: Array
    b: Array
    tail_a: Array
    tail_b: Array
    guesses: Complex
    radius: float
    hidden: Array
    hidden_modes: NDArray[np.int64]
    stiffness: Array
    normal: Array
    tangential: Array


@lru_cache(maxsize=128)
def sliding_problem(rig: Rig, theta: float, fmax: float) -> SlidingProblem:
    """Poles, residues, tail and guesses of the sliding problem, cached."""
    stiffness, normal, tangential = contact_modes(rig, theta)
    omega = 2.0 * np.pi * fmax
    # The largest lambda on the imaginary axis of the band; omega^2 but for heavy damping.
    unit = omega * max(omega, np.hypot(omega, rig.d1) / np.hypot(1.0, rig.d2 * omega))
    order = np.argsort(stiffness, kind="stable")
    p = stiffness[order] / unit
    a = normal[order] ** 2 / unit
    b = normal[order] * tangential[order] / unit

    # A mode the contact does not see keeps its eigenvalue: its root is nearer to the pole than rounding.
    static = np.sum(a[p > 0.0] / p[p > 0.0])
    seen = np.maximum(a, np.abs(b)) > 1e-17 * static * p
    hidden = [(p[i], order[i], -1) for i in np.nonzero(~seen)[0]]
    p, a, b, order = p[seen], a[seen].copy(), b[seen].copy(), order[seen]
    # Of two modes with one frequency, one combination leaves the gap closed and is hidden.
    single = np.ones(len(p), dtype=bool)
    for i in range(1, len(p)):
        if p[i] - p[i - 1] <= 4.0 * EPS * p[i]:
            hidden.append((p[i], order[i - 1], order[i]))
            a[i] += a[i - 1]
            b[i] += b[i - 1]
            single[i - 1] = False
    p, a, b = p[single], a[single], b[single]

    # At least one pole beyond the band, so that every root in it lies between two that are kept.
    near = max(int(np.searchsorted(p, NEAR**2)), min(int(np.searchsorted(p, 1.0)) + 2, len(p)))
    powers = p[near:, None] ** -np.arange(1.0, TAIL_TERMS + 1.0)
    # Not a matrix product: BLAS would round differently with the number of its threads.
    tail_a, tail_b = (a[near:, None] * powers).sum(axis=0), (b[near:, None] * powers).sum(axis=0)
    p, a, b = p[:near], a[:near], b[:near]

    # Without friction the residues are positive: exactly one root between any two poles.
    starts = np.array(
        [brentq(between, p[i], p[i + 1], args=(i, p, a, tail_a), xtol=1e-300, rtol=1e-12) for i in range(near - 1)]
    )
    radius = _clear_radius(np.sort(np.concatenate([p, starts])))
    # Neighbours start on opposite sides of the real axis, ready to become a pair.
    guesses = starts * (1.0 + np.where(np.arange(len(starts)) % 2, 1e-3j, -1e-3j))
    if np.any(tail_a):
        # One more for what friction may bring in from outside, above all along the negative real axis.
        guesses = np.append(guesses, radius * (-1.0 + 0.1j))
    kept = sorted(h for h in hidden if h[0] <= radius)
    values = np.array([h[0] for h in kept])
    modes = np.array([h[1:] for h in kept], dtype=np.int64).reshape(-1, 2)
    parts = (p, a, b, tail_a, tail_b, guesses.astype(complex), radius, values, modes)
    return SlidingProblem(unit, *parts, stiffness, normal, tangential)


def _clear_radius(marks: Array) -> float:
    """Radius of a circle around all reported eigenvalues that stays clear of poles and roots without friction."""
    candidates = marks[(marks > MOST_REPORTED) & (marks < MOST_COUNTED)]
    edges = np.concatenate([[MOST_REPORTED], candidates, [MOST_COUNTED]])
    widest = int(np.argmax(edges[1:] / edges[:-1]))
    return float(np.sqrt(edges[widest] * edges[widest + 1]))


def sliding_roots(problem: SlidingProblem, mu: Array) -> Complex:
    """Scaled eigenvalues for each mu, (mu, places), all within the counted circle among them.

    Raises
    ------
    ArithmeticError
        If the count within the circle says that one is missing.
    """
    system = (problem.poles, problem.a, problem.b, problem.tail_a, problem.tail_b)
    roots = np.empty((len(mu), len(problem.guesses)), dtype=complex)
    missed = np.zeros(len(mu), dtype=np.int64)
    find_roots(mu, *system, problem.guesses, problem.radius, roots, missed)
    for m in np.nonzero(missed)[0]:
        # More roots have come into the circle than there were guesses (large mu, on few rigs): start anew from a
        # dense solve with all modes.
        guesses = _dense_guesses(problem, float(mu[m]))
        again = np.empty((1, len(guesses)), dtype=complex)
        find_roots(mu[m : m + 1], *system, guesses, problem.radius, again, missed[m : m + 1])
        if missed[m]:
            number = "an unknown number of" if missed[m] > len(problem.stiffness) else f"{missed[m]}"
            raise ArithmeticError(
                f"mu = {float(mu[m])!r}: {number} eigenvalues could not be found with this rig and theta; "
                "another mu or fmax near it will do"
            )
        wider = max(0, len(guesses) - roots.shape[1])
        roots = np.pad(roots, ((0, 0), (0, wider)), constant_values=OUTSIDE)
        roots[m] = OUTSIDE
        roots[m, : len(guesses)] = again[0]
    return roots


def _dense_guesses(problem: SlidingProblem, mu: float) -> Complex:
    """Eigenvalues in and around the circle, from the modes of both beams with the constraint eliminated."""
    seen = problem.normal != 0.0
    stiffness, normal = problem.stiffness[seen] / problem.unit, problem.normal[seen]
    force = normal + mu * problem.tangential[seen]
    # Shifted, since a heavy head makes the smallest eigenvalue all but zero.
    shift = 0.37
    with one_blas_thread():
        right, left = null_space(normal[None]), null_space(force[None])
        flexible = np.linalg.solve(left.T @ ((stiffness + shift)[:, None] * right), left.T @ right)
        values = (1.0 / np.linalg.eigvals(flexible) - shift).astype(complex)
    # Eigenvalues of modes that no other guess may settle on come along.
    near = values[np.abs(values) < 2.0 * problem.radius]
    return near[np.lexsort((near.imag, near.real))]


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
def find_roots(
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
