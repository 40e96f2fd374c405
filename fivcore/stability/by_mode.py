"""Steady sliding of a structure with damping by mode: the characteristic equation in the exponent phi.

No mapping leads from undamped eigenvalues to these exponents, so the equation is solved in them:
f(phi) = h_NN + mu h_NT = sum_i (a_i + mu b_i) / (p_i + c_i phi + phi^2) + R, with the kernels of `secular`. Modes
far beyond the band enter as a power series; R is the compliance of static modes.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fivcore.beams.modes import EPS
from fivcore.jit import Array, Complex
from fivcore.rig import Structural
from fivcore.stability.secular import RADIUS, SlidingProblem, aberth, sliding_roots
from fivcore.structure import Structure

# 2 pi fmax in the unit of phi: MOST_REPORTED is |phi| = 2 * 2 pi fmax, where `sliding_modes` ends.
BAND = 2.5
# Up to this, in the unit of phi, poles are kept; the series of the others gains a factor of 2 a term at RADIUS.
KEPT, TERMS = 12.5, 53
# Damping, in units of 2 pi fmax, that is none.
FAINT = 1e-12


def damped_by_mode(own: Structural, fmax: float) -> bool:
    """Whether it is a structure whose damping by mode changes exponents in the band."""
    return isinstance(own, Structure) and own.rayleigh is None and own.damping.max() > FAINT * 2.0 * np.pi * fmax


@lru_cache(maxsize=128)
def damped_problem(own: Structure, fmax: float) -> SlidingProblem:
    """`sliding_problem` in the exponent phi; `unit` is its unit, rad/s."""
    m, unit = len(own.frequency), 2.0 * np.pi * fmax / BAND
    both = own.normal * np.stack([own.normal, own.tangential])
    order = np.lexsort((own.damping[:m], own.stiffness[:m]))
    p, c, residues = own.stiffness[order] / unit**2, own.damping[order] / unit, both[:, order] / unit**2
    residual = (both[:, m:] / own.stiffness[m:]).sum(axis=1)
    # As in `sliding_problem`: modes with a node at the contact, and all but one of those with one pole.
    static = residual[0] + np.sum(residues[0, p > 0.0] / p[p > 0.0])
    coupled = np.abs(residues).max(axis=0) > 1e-17 * static * p
    hidden, p, c, residues = [(p[~coupled], c[~coupled])], p[coupled], c[coupled], residues[:, coupled]
    new = np.diff(p, prepend=-np.inf) > 4.0 * EPS * p
    single = new | (np.abs(np.diff(c, prepend=-np.inf)) > 4.0 * EPS * np.maximum(c, np.sqrt(p)))
    hidden.append((p[~single], c[~single]))
    p, c, residues = p[single], c[single], np.add.reduceat(residues, np.flatnonzero(single), axis=1)
    distance = np.abs(exponents(p, c)).min(axis=0)
    limit = max(KEPT, *np.sort(distance)[: int(np.sum(distance < BAND)) + 2][-1:])
    near = distance <= limit
    tail = far_series(p[~near], c[~near], residues[:, ~near])
    tail[:, 0] += residual
    tail = tail[:, : 1 if near.all() else TERMS].copy()
    p, c, residues = p[near], c[near], residues[:, near].copy()
    guesses = frictionless(p, c, residues[0], tail)
    uncoupled = np.concatenate([exponents(*each).ravel() for each in hidden])
    uncoupled = uncoupled[(np.abs(uncoupled) <= RADIUS) & (uncoupled.imag >= 0.0)]
    return SlidingProblem(unit, np.stack([p, c]), residues, tail, guesses, uncoupled)


def far_series(p: Array, c: Array, residues: Array) -> Array:
    """Power series of sum residues / (p + c phi + phi^2), (rows, TERMS)."""
    series = np.zeros((TERMS, len(p)))
    series[0] = 1.0 / p
    for k in range(1, TERMS):
        series[k] = -(c * series[k - 1] + (series[k - 2] if k > 1 else 0.0)) / p
    return np.asarray((residues[:, None] * series).sum(axis=-1))


def frictionless(p: Array, c: Array, a: Array, tail: Array) -> Complex:
    """Guesses of exponents: those without friction, slightly moved, and two for those from beyond the poles."""
    between, local = ((a[:-1] * x[1:] + a[1:] * x[:-1]) / (a[:-1] + a[1:]) for x in (p, c))
    if np.any(tail):
        # The root above the last mode, and one more.
        above = p[-1] + min(a[-1] / tail[0, 0], 2.0 * RADIUS**2) if tail[0, 0] > 0.0 else 2.0 * RADIUS**2
        between, local = np.append(between, [above, -(RADIUS**2)]), np.append(local, [c[-1], 0.0])
    start = exponents(between, local)
    # Aside from poles, from the real and from the imaginary axis, on which symmetry would keep them.
    turns = np.exp(1e-3j * np.where(np.arange(len(between)) % 2, -1.0, 1.0) * np.array([[1.0], [-0.7]]))
    start = (start * turns).ravel()
    roots = start.copy()
    aberth(roots, np.stack([p, c]), a, tail[0])
    return np.asarray(np.where(np.abs(roots) < 2.0 * RADIUS, roots * turns.ravel(), start))


def exponents(p: Array, c: Array) -> Complex:
    """Both roots of phi^2 + c phi + p = 0, (2, n), those with Im >= 0 or the larger first."""
    root = np.sqrt(0.25 * c**2 - p + 0j)
    low = -0.5 * c - root
    high = np.where(np.abs(root.imag) > 0.0, root - 0.5 * c, p / np.where(low == 0.0, 1.0, low))
    return np.stack([high, low])


def damped_roots(problem: SlidingProblem, mu: float) -> Complex:
    """`sliding_roots` of a problem in phi; of a conjugate pair that with Im > 0; no growth that is rounding."""
    return upper_half(sliding_roots(problem, mu))


def upper_half(roots: Complex) -> Complex:
    """Those with Im >= 0, without growth that is rounding."""
    roots = roots[roots.imag >= 0.0]
    return np.where(np.abs(roots.real) <= 16.0 * EPS * np.abs(roots), 1j * roots.imag, roots)
