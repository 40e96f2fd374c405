"""The scalar equation of steady sliding for one rig, theta and band: set up once, solved for any mu.

`fivcore.stability.secular` states the equation and holds its compiled kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.optimize import brentq

from fivcore.beams.modes import contact_modes, one_blas_thread
from fivcore.jit import Array, Complex
from fivcore.rig import Rig
from fivcore.stability import secular

# Poles up to this many times the band (in frequency) are kept; the power series of the others then gains a
# factor of 25 a term within the band and of 2.8 on the largest circle on which roots are counted.
NEAR = 5.0
TAIL_TERMS = 26

# Eigenvalues up to this many times the band's lambda belong to a result, so that a mode may grow or decay
# at up to 1.7 times the band's angular frequency. The counted circle lies between here and MOST_COUNTED.
MOST_REPORTED = 4.0
MOST_COUNTED = 9.0

# Stands where there are fewer eigenvalues than places for them: far beyond any band.
OUTSIDE = 1e12


@dataclass(frozen=True, eq=False)
class SlidingProblem:
    """The sliding problem of one rig, theta and band, ready for any mu.

    Attributes
    ----------
    unit : float
        The band's lambda, (2 pi fmax)^2 unless damping is heavy, rad2/s2; what follows is scaled by it.
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
        Not scaled.
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
    """Poles, residues, tail and guesses of the sliding problem; what exists is not built again."""
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
        if p[i] - p[i - 1] <= 4.0 * secular.EPS * p[i]:
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
        [
            brentq(secular.between, p[i], p[i + 1], args=(i, p, a, tail_a), xtol=1e-300, rtol=1e-12)
            for i in range(near - 1)
        ]
    )
    marks = np.sort(np.concatenate([p, starts]))
    radius = _quiet_radius(marks)
    # Neighbours start on opposite sides of the real axis, ready to become a pair.
    tilt = np.where(np.arange(len(starts)) % 2, 1e-3j, -1e-3j)
    guesses = starts * (1.0 + tilt)
    if np.any(tail_a):
        # One more for what friction may bring in from outside, above all along the negative real axis.
        guesses = np.append(guesses, radius * (-1.0 + 0.1j))
    kept = sorted(h for h in hidden if h[0] <= radius)
    return SlidingProblem(
        unit,
        p,
        a,
        b,
        tail_a,
        tail_b,
        guesses.astype(complex),
        radius,
        np.array([h[0] for h in kept]),
        np.array([h[1:] for h in kept], dtype=np.int64).reshape(-1, 2),
        stiffness,
        normal,
        tangential,
    )


def _quiet_radius(marks: Array) -> float:
    """A circle around the band and the strongly growing modes near it that stays clear of poles and roots."""
    candidates = marks[(marks > MOST_REPORTED) & (marks < MOST_COUNTED)]
    edges = np.concatenate([[MOST_REPORTED], candidates, [MOST_COUNTED]])
    widest = int(np.argmax(edges[1:] / edges[:-1]))
    return float(np.sqrt(edges[widest] * edges[widest + 1]))


def sliding_roots(problem: SlidingProblem, mu: Array) -> Complex:
    """Scaled eigenvalues for each mu, all within the counted circle among them."""
    system = (problem.poles, problem.a, problem.b, problem.tail_a, problem.tail_b)
    roots = np.empty((len(mu), len(problem.guesses)), dtype=complex)
    missed = np.zeros(len(mu), dtype=np.int64)
    secular.sliding_roots(mu, *system, problem.guesses, problem.radius, roots, missed)
    for m in np.nonzero(missed)[0]:
        # More roots have come into the circle than there were guesses (large mu, on few rigs): start anew
        # from a dense solve with all modes.
        guesses = _dense_guesses(problem, float(mu[m]))
        again = np.empty((1, len(guesses)), dtype=complex)
        secular.sliding_roots(mu[m : m + 1], *system, guesses, problem.radius, again, missed[m : m + 1])
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
