"""A second, plain implementation of the rig: global finite elements and dense algebra, without fivcore.

Both beams are assembled node by node in x, y and rotation. `scalar` is the arithmetic: float, NumPy's longdouble,
or mpmath's mpf for a small mesh, whose arrays contain objects.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
from scipy.linalg import eig
from threadpoolctl import threadpool_limits

# Tests run side by side, and threads that wait for each other cost more than they compute.
one_blas_thread = threadpool_limits.wrap(limits=1, user_api="blas")
# The square of the largest angular frequency that any test compares.
REFINED = (2.0 * np.pi * 60e3) ** 2


def element(beam: Any, scalar: Any = float) -> tuple[np.ndarray, np.ndarray]:
    """Six by six stiffness and mass, (u, w, phi) at either end, in the element's own frame."""
    length, width, thickness = scalar(beam.length), scalar(beam.width), scalar(beam.thickness)
    young, density = scalar(beam.young_modulus), scalar(beam.density)
    h, area = length / beam.elements, width * thickness
    m, one = density * area * h, scalar(1)
    stiffness, mass = np.full((2, 6, 6), scalar(0))
    along, across, levers = np.ix_([0, 3], [0, 3]), np.ix_([1, 2, 4, 5], [1, 2, 4, 5]), np.array([one, h, one, h])
    stiffness[along] = young * area / h * np.array([[1, -1], [-1, 1]])
    mass[along] = m / 6 * np.array([[2, 1], [1, 2]])
    levers = np.outer(levers, levers)
    bend = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    stiffness[across] = young * width * thickness**3 / 12 / h**3 * levers * np.array(bend)
    lump = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    mass[across] = m / 420 * levers * np.array(lump)
    return stiffness, mass


def assemble(rig: Any, theta: float, scalar: Any = float) -> tuple[Any, Any, Any, Any]:
    """K, M, G_N, G_T of both beams; P1 from C to A with (y) left at A, P2 without its clamped node."""
    if scalar is mpmath.mpf:
        angle = mpmath.radians(scalar(theta))
        sine, cosine = mpmath.sin(angle), mpmath.cos(angle)
    else:
        angle = scalar(theta) * (4 * np.arctan(scalar(1))) / 180
        sine, cosine = np.sin(angle), np.cos(angle)
    n1, n2, one = rig.p1.elements, rig.p2.elements, scalar(1)
    second = 3 * (n1 + 1)
    size = second + 3 * (n2 + 1)
    stiffness, mass = np.full((2, size, size), scalar(0))
    normal, tangential = np.full((2, size), scalar(0))
    # From the element's (u, w) to (x, y): columns are the axis and the transverse, turned left from it.
    for beam, first, (x, y) in ((rig.p1, 0, (sine, cosine)), (rig.p2, second, (one, 0 * one))):
        turn = np.kron(np.eye(2, dtype=int), np.array([[x, y, 0], [-y, x, 0], [0, 0, one]]))
        for whole, part in zip((stiffness, mass), element(beam, scalar), strict=True):
            for start in range(first, first + 3 * beam.elements, 3):
                whole[start : start + 6, start : start + 6] += turn.T @ part @ turn
    mass[3 * n1 + 1, 3 * n1 + 1] += scalar(rig.head_mass)
    normal[1], tangential[0] = one, one
    h = scalar(rig.p2.length) / n2
    place = scalar(rig.contact_position) / h
    if abs(place - round(float(place))) < 1e-9:
        place = scalar(round(float(place)))
    e = min(int(place), n2 - 1)
    x, o = place - e, second + 3 * e
    tangential[[o, o + 3]] = x - 1, -x
    normal[[o + 1, o + 2]] = -(1 - 3 * x**2 + 2 * x**3), -h * (x - 2 * x**2 + x**3)
    normal[[o + 4, o + 5]] = -(3 * x**2 - 2 * x**3), -h * (x**3 - x**2)
    free = np.delete(np.arange(size), [3 * n1, 3 * n1 + 2, second, second + 1, second + 2])
    return stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], normal[free], tangential[free]


def _sliding(rig: Any, theta: float, mu: float, scalar: Any) -> tuple[np.ndarray, np.ndarray]:
    """K and M of steady sliding, with the constraint eliminated from both sides."""
    k, m, normal, tangential = assemble(rig, theta, scalar)
    force = normal + scalar(mu) * tangential
    return _without(_without(k, normal).T, force).T, _without(_without(m, normal).T, force).T


@one_blas_thread
def sliding_eigenvalues(rig: Any, theta: float, mu: float) -> np.ndarray:
    """Undamped eigenvalues lambda of steady sliding (reverse sliding for mu < 0), those of K^-1 M, dense.

    Cholesky or LU of K loses digits in proportion to its condition. Each eigenvalue is therefore computed again
    from its left and right vectors by a Rayleigh quotient of matrices in extended precision, whose error is the
    square of the vectors'. That product is slow, and computed for modes below `REFINED` only.
    """
    kk, mm = _sliding(rig, theta, mu, np.longdouble)
    stiffness, mass = kk.astype(float), mm.astype(float)
    values, w, x = eig(np.linalg.solve(stiffness, mass), left=True)
    y = np.linalg.solve(stiffness.T, w)
    return _refined(kk, mm, 1.0 / values, y.conj().astype(np.clongdouble), x.astype(np.clongdouble))


@one_blas_thread
def glued_eigenvalues(rig: Any, theta: float) -> np.ndarray:
    """Undamped eigenvalues with both translations of C tied to P2, refined in the same way."""
    k, m, normal, tangential = assemble(rig, theta, np.longdouble)
    tangential = _without(tangential[None], normal)[0]
    for row in (normal, tangential):
        k, m = (_without(_without(each, row).T, row) for each in (k, m))
    values, x = eig(np.linalg.solve(k.astype(float), m.astype(float)))
    x = x.real.astype(np.longdouble)
    return np.sort(_refined(k, m, 1.0 / values.real, x, x))


def damped(eigenvalues: np.ndarray, d1: float, d2: float) -> np.ndarray:
    """Roots phi of phi^2 + (d1 + d2 lambda) phi + lambda = 0 with Im > 0, in order of frequency."""
    phi = np.concatenate([np.roots([1.0, d1 + d2 * v, v]) for v in eigenvalues])
    phi = phi[phi.imag > 1e-9 * np.abs(phi)]
    return phi[np.lexsort((phi.real, phi.imag))]


def sliding_eigenvalues_extended(rig: Any, theta: float, mu: float, digits: int = 50) -> np.ndarray:
    """The same in extended precision, each eigenvalue rounded to a complex double at the end."""
    with mpmath.workdps(digits):
        kk, mm = (mpmath.matrix(each.tolist()) for each in _sliding(rig, theta, mu, mpmath.mpf))
        values = mpmath.eig(mpmath.inverse(kk) * mm, left=False, right=False)
        return np.array([complex(1 / v) for v in values])


def _without(matrix: np.ndarray, row: np.ndarray) -> np.ndarray:
    """A matrix times a basis of the vectors orthogonal to `row`, eliminating its largest entry."""
    pivot = int(np.argmax(np.abs(row)))
    others = np.delete(np.arange(len(row)), pivot)
    return matrix[:, others] - np.outer(matrix[:, pivot], row[others] / row[pivot])


def _refined(k: np.ndarray, m: np.ndarray, plain: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Eigenvalues by Rayleigh quotients, except where the vectors are too inaccurate."""
    low = np.flatnonzero(np.abs(plain) < REFINED)
    y, x = left[:, low], right[:, low]
    quotients = (np.sum(y * (k @ x), axis=0) / np.sum(y * (m @ x), axis=0)).astype(plain.dtype)
    plain[low] = np.where(np.abs(quotients / plain[low] - 1.0) < 1e-4, quotients, plain[low])
    return plain
