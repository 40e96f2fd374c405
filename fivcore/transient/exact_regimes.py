"""Contact regimes of `method="exact"` as linear systems in their own eigenbases.

The state x is (q, v) of the kept modes, with u_T in slip and (u_N, u_T) in separation. With the prescribed motion
d of `fivcore.transient.exact_kernels`, d' = D d, x' = M x + B d and M z_k = lambda_k z_k,

    x(s) = Re sum_k c_k z_k exp(lambda_k s) + E d(s),     M E + B = E D,

where k runs over one eigenvalue of each conjugate pair. Eigenpairs are refined by first-order perturbation, which
converges with second order: with Z^-1 M Z = diag(lambda) + R, lambda_k grows by R_kk and Z by Z X,
X_jk = R_jk / (lambda_k - lambda_j).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.reduced import ReducedModel
from fivcore.jit import Array, Complex
from fivcore.transient.exact_kernels import ONE, Q_R, V_R, A, P, S
from fivcore.transient.statistics import SEPARATION, STICK

# Slip with T = mu N and with T = -mu N; the other regimes have the numbers of `fivcore.transient.statistics`.
SLIP_UP, SLIP_DOWN = 2, 3
# Largest condition number of an eigenbasis, number of refinements.
WORST, REFINEMENTS = 1e9, 2
# Types of the refinement, with a mantissa of 64 bits on x86-64. Where it has the 53 bits of double (MSVC, macOS on
# arm64) two to three digits are lost: with the paper's rig at 20 mm/s states up to the first separation change by
# 5e-9 of the motion, events by 2e-13 s, and the energy residual grows from 6e-15 to 5e-13. A rig with d1 = 1e5 1/s
# then raises `fivcore.DivergenceError`.
REAL: Any = np.longdouble
COMPLEX: Any = np.clongdouble


class Regime(NamedTuple):
    """One linear regime in its eigenbasis: factors of w, of which real parts count.

    Attributes
    ----------
    eigenvalues : ndarray of complex, (m,)
        1/s.
    entry : ndarray of complex, (m, 2n + 8)
        c at the start from the full state (q, v, u_N, u_T) and d; c of a pair of eigenvalues counts twice.
    state : ndarray of complex, (2n + 2, m + 6)
        The full state.
    margins : ndarray of complex, (k, m + 6)
        The functions that stay positive within the regime.
    outputs : ndarray, (2, m + 6, 9 + n)
        The outputs of `fivcore.transient.exact_kernels`, transposed: real and imaginary parts.
    """

    eigenvalues: Complex
    entry: Complex
    state: Complex
    margins: Complex
    outputs: Array


@lru_cache(maxsize=32)
@one_blas_thread()
def regimes(model: ReducedModel, mu: float) -> tuple[Regime, ...]:
    """Return the four regimes of a model with an absorbing element."""
    return tuple(_regime(model, mu, which) for which in (SEPARATION, STICK, SLIP_UP, SLIP_DOWN))


def _regime(model: ReducedModel, mu: float, which: int) -> Regime:
    """Write one regime's equations as rows of factors of (x, d), and change to its eigenbasis."""
    modal = (model.stiffness, model.damping, model.normal, model.tangential, model.inertia, model.point_b)
    k, c, normal, tangential, inertia, point_b, K, C = (part.astype(REAL) for part in (*modal, model.K, model.C))
    n, rigid = len(k), int(np.argmin(model.stiffness))
    # P1's rigid mode is part of d in separation, u_N is -g_N in contact, and u_T follows the clamp in stick.
    dependent = {SEPARATION: [rigid, n + rigid], STICK: [2 * n, 2 * n + 1]}.get(which, [2 * n])
    x = np.delete(np.arange(2 * n + 2), dependent)
    unit = np.delete(np.eye(2 * n + 8, dtype=REAL), dependent, axis=1)
    q, v, u, d = np.split(unit, [n, 2 * n, 2 * n + 2])
    if which == SEPARATION:
        q[rigid], v[rigid] = d[Q_R], d[V_R]
    g_N, rate_N, rate_T = normal @ q, normal @ v, tangential @ v - d[P]
    load = np.stack([d[ONE], 0.0 * d[ONE]])
    rate, force = np.zeros((2, *u.shape), dtype=REAL)
    if which == SEPARATION:
        rate = -np.linalg.inv(model.C) @ (K @ u + load)
    else:
        m = mu if which == SLIP_UP else -mu
        u[0], rate[0] = -g_N, -rate_N
        if which == STICK:
            u[1], rate[1] = d[S] - tangential @ q, -rate_T
        else:
            # T = m N: K_T u + C_T u' = m (K_N u + C_N u' + 1), solved for u_T'.
            stiff, viscous = K[1] - m * K[0], C[1] - m * C[0]
            rate[1] = -(stiff @ u + viscous[0] * rate[0] - m * d[ONE]) / viscous[1]
        force = K @ u + C @ rate + load
    acceleration = -c[:, None] * v - k[:, None] * q + np.outer(inertia, d[A])
    acceleration += np.stack([normal, tangential]).T @ (force - load)
    speed = 0.0 * rate_T if which == STICK else rate_T + rate[1]
    N, T = force
    margins = {
        SEPARATION: [g_N + u[0]], STICK: [N, mu * N - T, mu * N + T], SLIP_UP: [N, -speed], SLIP_DOWN: [N, speed],
    }[which]  # fmt: skip
    outputs = np.vstack([rate, C @ rate, inertia @ v, point_b @ v, N, T, speed, np.sqrt(c)[:, None] * v])
    moving, size, r = np.vstack([v, acceleration, rate])[x], len(x), int(np.sum(x < n))
    # Displacements weighted by frequency and u by stiffness: the norm is then near the energy's.
    omega = np.sqrt(np.maximum(-np.diag(moving[r : 2 * r, :r]).astype(float), 1.0))
    scale = np.concatenate([omega, np.ones(r), np.full(size - 2 * r, np.sqrt(model.K[1, 1]))])
    matrix, forcing = moving[:, :size] * scale[:, None] / scale, moving[:, size:] * scale[:, None]
    # D is nilpotent where B is not zero: three iterations solve for E, the others refine.
    inverse, steady, D = np.linalg.inv(matrix.astype(float)), np.zeros_like(forcing), np.zeros((6, 6))
    D[S, P] = D[P, A] = 1.0
    for _ in range(3 + REFINEMENTS):
        steady += inverse @ (steady @ D - forcing - matrix @ steady)
    eigenvalues, vectors, back = _eigenbasis(matrix)
    kept = eigenvalues.imag >= 0.0
    eigenvalues, vectors, steady = eigenvalues[kept], vectors[:, kept] / scale[:, None], steady / scale[:, None]
    back = np.where(eigenvalues.imag > 0.0, 2.0, 1.0)[:, None] * back[kept] * scale
    # (x, d) from w.
    change = np.block([[vectors, steady], [np.zeros((6, vectors.shape[1])), np.eye(6)]])
    entry = back @ np.hstack([np.eye(2 * n + 2)[x], -steady])
    state, watched, seen = (
        (rows @ change).astype(complex) for rows in (np.vstack([q, v, u]), np.stack(margins), outputs)
    )
    return Regime(
        eigenvalues.astype(complex), entry.astype(complex), state, watched, np.stack([seen.real.T, seen.imag.T])
    )


def _eigenbasis(matrix: Any) -> tuple[Any, Any, Any]:
    """Eigenvalues, eigenvectors and their inverse, refined."""
    values, vectors = (part.astype(COMPLEX) for part in np.linalg.eig(matrix.astype(float)))
    real = values.imag == 0.0
    # Rows are scaled to the same size before the condition number is judged: close to the friction at which slip
    # loses its unique force, u_T is larger than all else by orders of magnitude, and no two eigenvalues coincide.
    units = 1.0 / np.abs(vectors).sum(axis=1)
    basis = (units[:, None] * vectors).astype(complex)
    if np.linalg.cond(basis) > WORST:
        raise ValueError(
            "method = 'exact': two eigenvalues of a contact regime coincide, so that it has no eigenbasis; change"
            " mu or theta in the eighth digit"
        )
    back, one = np.linalg.inv(basis).astype(COMPLEX) * units, np.eye(len(values))
    for _ in range(REFINEMENTS):
        back = back + back @ (one - vectors @ back)
        residual = back @ (matrix @ vectors - vectors * values)
        values = values + np.diag(residual)
        distance = values - values[:, None]
        # Eigenvalues that coincide here are decoupled, since the condition number is small.
        close = np.abs(distance) <= 1e-9 * np.abs(values)
        vectors = vectors + vectors @ np.where(close, 0.0, residual / np.where(close, 1.0, distance))
    back = back + back @ (one - vectors @ back)
    # Rounding must not make a real eigenvalue one of a pair.
    return np.where(real, values.real, values), vectors, back
