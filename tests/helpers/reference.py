"""The rig written a second time, plainly: global finite elements and dense algebra, nothing of fivcore's.

Both beams are assembled node by node in x, y and rotation. `scalar` chooses the arithmetic: float, NumPy's
longdouble, or mpmath's mpf for a small mesh.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
from scipy.linalg import eig

# The square of the largest angular frequency that any test compares.
REFINED = (2.0 * np.pi * 60e3) ** 2


def element(beam: Any, scalar: Any = float) -> tuple[list, list]:
    """Six by six stiffness and mass, (u, w, phi) at either end, in the element's own frame."""
    length, width, thickness = scalar(beam.length), scalar(beam.width), scalar(beam.thickness)
    young, density = scalar(beam.young_modulus), scalar(beam.density)
    h, area = length / beam.elements, width * thickness
    inertia = width * thickness**3 / 12
    ea, ei, m = young * area / h, young * inertia / h**3, density * area * h
    k = [[scalar(0)] * 6 for _ in range(6)]
    c = [[scalar(0)] * 6 for _ in range(6)]
    for i, si in ((0, 1), (3, -1)):
        for j, sj in ((0, 1), (3, -1)):
            k[i][j] = si * sj * ea
            c[i][j] = m / 3 if i == j else m / 6
    bend = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    lump = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    for i, p in enumerate((1, 2, 4, 5)):
        for j, q in enumerate((1, 2, 4, 5)):
            levers = h ** ((i % 2) + (j % 2))
            k[p][q] = ei * levers * bend[i][j]
            c[p][q] = m / 420 * levers * lump[i][j]
    return k, c


def assemble(rig: Any, theta: float, scalar: Any = float) -> tuple[Any, Any, Any, Any]:
    """K, M, G_N, G_T of both beams; P1 from C to A with (y) left at A, P2 without its clamped node."""
    if scalar is mpmath.mpf:
        angle = scalar(theta) * mpmath.pi / 180
        sine, cosine = mpmath.sin(angle), mpmath.cos(angle)
    else:
        angle = scalar(theta) * (4 * np.arctan(scalar(1))) / 180
        sine, cosine = np.sin(angle), np.cos(angle)
    n1, n2 = rig.p1.elements, rig.p2.elements
    size = 3 * (n1 + 1) + 3 * (n2 + 1)
    zero = scalar(0)
    stiffness = [[zero] * size for _ in range(size)]
    mass = [[zero] * size for _ in range(size)]
    # From the element's (u, w) to (x, y): columns are the axis and the transverse, turned left from it.
    for beam, first, axis in ((rig.p1, 0, (sine, cosine)), (rig.p2, 3 * (n1 + 1), (scalar(1), zero))):
        k, c = element(beam, scalar)
        turn = [[zero] * 6 for _ in range(6)]
        for o in (0, 3):
            turn[o][o], turn[o][o + 1] = axis[0], axis[1]
            turn[o + 1][o], turn[o + 1][o + 1] = -axis[1], axis[0]
            turn[o + 2][o + 2] = scalar(1)
        kg, cg = _turned(k, turn), _turned(c, turn)
        for e in range(beam.elements):
            for i in range(6):
                for j in range(6):
                    stiffness[first + 3 * e + i][first + 3 * e + j] += kg[i][j]
                    mass[first + 3 * e + i][first + 3 * e + j] += cg[i][j]
    top = 3 * n1
    mass[top + 1][top + 1] += scalar(rig.head_mass)
    normal, tangential = [zero] * size, [zero] * size
    normal[1], tangential[0] = scalar(1), scalar(1)
    h = scalar(rig.p2.length) / n2
    place = scalar(rig.contact_position) / h
    if abs(place - round(float(place))) < 1e-9:
        place = scalar(round(float(place)))
    e = min(int(place), n2 - 1)
    x, o = place - e, 3 * (n1 + 1) + 3 * e
    tangential[o], tangential[o + 3] = -(1 - x), -x
    normal[o + 1], normal[o + 2] = -(1 - 3 * x**2 + 2 * x**3), -h * (x - 2 * x**2 + x**3)
    normal[o + 4], normal[o + 5] = -(3 * x**2 - 2 * x**3), -h * (x**3 - x**2)
    held = {top, top + 2, 3 * (n1 + 1), 3 * (n1 + 1) + 1, 3 * (n1 + 1) + 2}
    free = [i for i in range(size) if i not in held]
    if scalar is not mpmath.mpf:
        cut = np.ix_(free, free)
        rows = np.array(normal)[free], np.array(tangential)[free]
        return np.array(stiffness)[cut], np.array(mass)[cut], *rows
    return (
        mpmath.matrix([[stiffness[i][j] for j in free] for i in free]),
        mpmath.matrix([[mass[i][j] for j in free] for i in free]),
        [normal[i] for i in free],
        [tangential[i] for i in free],
    )


def sliding_eigenvalues(rig: Any, theta: float, mu: float, sign: int = 1) -> np.ndarray:
    """Undamped eigenvalues lambda of steady sliding: constraint eliminated, eigenvalues of K^-1 M, dense.

    Cholesky or LU of K costs digits in proportion to its condition. Each eigenvalue is therefore read a
    second time from its left and right vectors by a Rayleigh quotient of matrices in extended precision,
    whose error is the square of the vectors'. That product is slow, and made for modes below `REFINED` only.
    """
    k, m, normal, tangential = assemble(rig, theta, np.longdouble)
    force = normal + sign * np.longdouble(mu) * tangential
    kk, mm = _without(_without(k, normal).T, force).T, _without(_without(m, normal).T, force).T
    stiffness, mass = kk.astype(float), mm.astype(float)
    values, w, x = eig(np.linalg.solve(stiffness, mass), left=True)
    y = np.linalg.solve(stiffness.T, w)
    return _refined(kk, mm, 1.0 / values, y.conj().astype(np.clongdouble), x.astype(np.clongdouble))


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
        k, m, normal, tangential = assemble(rig, theta, mpmath.mpf)
        n = k.rows
        force = [normal[i] + mpmath.mpf(mu) * tangential[i] for i in range(n)]
        right, left = _nulls(normal), _nulls(force)
        inner = mpmath.lu_solve
        kk, mm = left.T * k * right, left.T * m * right
        columns = [inner(kk, mm[:, j]) for j in range(mm.cols)]
        flexible = mpmath.matrix(n - 1, n - 1)
        for j, column in enumerate(columns):
            for i in range(n - 1):
                flexible[i, j] = column[i]
        values = mpmath.eig(flexible, left=False, right=False)
        return np.array([complex(1 / v) for v in values])


def _without(matrix: np.ndarray, row: np.ndarray) -> np.ndarray:
    """A matrix times a basis of the vectors orthogonal to `row`, eliminating its largest entry."""
    pivot = int(np.argmax(np.abs(row)))
    others = np.delete(np.arange(len(row)), pivot)
    return matrix[:, others] - np.outer(matrix[:, pivot], row[others] / row[pivot])


def _refined(k: np.ndarray, m: np.ndarray, plain: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Eigenvalues by Rayleigh quotients, but where the vectors are too poor for that."""
    low = np.flatnonzero(np.abs(plain) < REFINED)
    y, x = left[:, low], right[:, low]
    quotients = (np.sum(y * (k @ x), axis=0) / np.sum(y * (m @ x), axis=0)).astype(plain.dtype)
    plain[low] = np.where(np.abs(quotients / plain[low] - 1.0) < 1e-4, quotients, plain[low])
    return plain


def _nulls(row: list) -> Any:
    """A basis of the vectors orthogonal to `row`, eliminating its largest entry."""
    n = len(row)
    pivot = max(range(n), key=lambda i: abs(row[i]))
    basis = mpmath.matrix(n, n - 1)
    for column, i in enumerate(i for i in range(n) if i != pivot):
        basis[i, column] = 1
        basis[pivot, column] = -row[i] / row[pivot]
    return basis


def _turned(matrix: list, turn: list) -> list:
    n = range(len(matrix))
    half = [[sum(matrix[i][k] * turn[k][j] for k in n) for j in n] for i in n]
    return [[sum(turn[k][i] * half[k][j] for k in n) for j in n] for i in n]
