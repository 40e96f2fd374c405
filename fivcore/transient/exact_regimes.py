"""The regimes of `method="exact"`, each a linear system written in its own eigenbasis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.reduced import ReducedModel
from fivcore.jit import Array, Complex
from fivcore.transient.exact_kernels import ONE, Q_R, V_R, A, P, S
from fivcore.transient.statistics import SEPARATION, STICK

# Regimes: those of `fivcore.transient.statistics`, slip with T = mu N and with T = -mu N apart.
SLIP_UP, SLIP_DOWN = 2, 3
# Largest condition number of an eigenbasis, and how often it is refined.
WORST, REFINED = 1e9, 2


@dataclass(frozen=True, eq=False)
class Regime:
    """One linear regime in its eigenbasis; one of each conjugate pair, weighted twice.

    Attributes
    ----------
    rates : ndarray of complex, (m,)
    into, into_drift : ndarray, (m, 2n + 2) and (m, 6)
        Amplitudes at the start from the full state (q, v, u_N, u_T) and from d.
    state, state_drift : ndarray, (2n + 2, m) and (2n + 2, 6)
        The full state from the amplitudes and from d.
    real, imaginary, drift : ndarray, (m, n + 7), the last (6, n + 7)
        Outputs: modal velocities and the signals of `fivcore.transient.exact_kernels`.
    watched, watched_drift : ndarray, (3, m) and (3, 6)
        What must stay positive.
    """

    rates: Complex
    into: Complex
    into_drift: Complex
    state: Complex
    state_drift: Array
    real: Array
    imaginary: Array
    drift: Array
    watched: Complex
    watched_drift: Array


def in_eigenbasis(moving: Any, scale: Any, taken: Any, state: Any, outputs: Any, watched: Any) -> Regime:
    """A regime from rows of factors; the eigenbasis is refined in extended precision."""
    size = len(moving)
    matrix, forcing = moving[:, :size], moving[:, size:]
    # Displacements weighted by frequency: then the norm is near the energy's.
    r = int(np.count_nonzero(np.isnan(scale)))
    scale[:r] = np.sqrt(np.maximum(-np.diag(matrix[r : 2 * r, :r]).astype(float), 1.0))
    matrix = matrix * scale[:, None] / scale
    inverse = np.linalg.inv(matrix.astype(float))
    steady = np.zeros((size, 6), dtype=np.longdouble)
    before: Any = np.zeros(size, dtype=np.longdouble)
    # x = e_S S + e_P P + e_A A + e_1, with S' = P and P' = A.
    for slot in (S, P, A, ONE):
        right = (before if slot in (P, A) else 0.0) - scale * forcing[:, slot]
        x = inverse @ right
        for _ in range(REFINED):
            x = x + inverse @ (right - matrix @ x)
        steady[:, slot], before = x, x
    rates, vectors, back = _refined(matrix)
    kept = rates.imag >= 0.0
    weight = np.where(rates.imag > 0.0, 2.0, 1.0)[kept]
    vectors = vectors[:, kept] / scale[:, None]
    steady = steady / scale[:, None]
    back = weight[:, None] * back[kept] * scale

    def drifting(rows: Any) -> Array:
        return np.ascontiguousarray(rows[:, :size] @ steady + rows[:, size:], dtype=float)

    def waving(rows: Any) -> Complex:
        return np.ascontiguousarray(rows[:, :size] @ vectors, dtype=complex)

    out = waving(outputs).T
    return Regime(
        rates[kept].astype(complex),
        np.ascontiguousarray(back @ taken, dtype=complex),
        np.ascontiguousarray(-back @ steady, dtype=complex),
        waving(state),
        drifting(state),
        np.ascontiguousarray(out.real),
        np.ascontiguousarray(out.imag),
        np.ascontiguousarray(drifting(outputs).T),
        waving(watched),
        drifting(watched),
    )


def _refined(matrix: Any) -> tuple[Any, Any, Any]:
    """Eigenvalues, eigenvectors and their inverse, refined in extended precision."""
    values, vectors = (part.astype(np.clongdouble) for part in np.linalg.eig(matrix.astype(float)))
    real = values.imag == 0.0
    # In units in which every row is as large as any other: close to the friction at which slip loses its unique
    # force, u_T is larger than all else by orders of magnitude, and no two eigenvalues coincide.
    units = 1.0 / np.abs(vectors).sum(axis=1)
    basis = (units[:, None] * vectors).astype(complex)
    if np.linalg.cond(basis) > WORST:
        raise ValueError(
            "method = 'exact': two eigenvalues of a contact regime coincide, so that it has no eigenbasis; change"
            " mu or theta in the eighth digit"
        )
    back = np.linalg.inv(basis).astype(np.clongdouble) * units
    for _ in range(REFINED):
        back = back + back @ (np.eye(len(values)) - vectors @ back)
        wrong = back @ (matrix @ vectors - vectors * values)
        values = values + np.diag(wrong)
        apart = values - values[:, None]
        # What coincides is decoupled, or the condition number would have told.
        close = np.abs(apart) <= 1e-9 * np.abs(values)
        vectors = vectors + vectors @ np.where(close, 0.0, wrong / np.where(close, 1.0, apart))
    back = back + back @ (np.eye(len(values)) - vectors @ back)
    # Rounding must not make a real eigenvalue one of a pair.
    return np.where(real, values.real, values), vectors, back


def regime(model: ReducedModel, mu: float, which: int) -> Regime:
    """One of SEPARATION, STICK, SLIP_UP (T = mu N) and SLIP_DOWN (T = -mu N)."""
    parts = (model.stiffness, model.damping, model.normal, model.tangential, model.inertia, model.point_b)
    k, c, normal, tangential, inertia, point_b = (part.astype(np.longdouble) for part in parts)
    K, C = model.K.astype(np.longdouble), model.C.astype(np.longdouble)
    G = np.stack([normal, tangential])
    n, element, dashpot = len(k), bool(K.any()), bool(C.any())
    free_flight, sticking = which == SEPARATION, which == STICK
    s = 1.0 if which == SLIP_UP else -1.0
    m = s * mu
    # Coordinates: what the constraints leave of the modes, their rates, and what the element adds.
    Z = np.eye(n, dtype=np.longdouble)
    rigid = int(np.argmin(model.stiffness))
    if free_flight:
        Z = np.delete(Z, rigid, axis=1)
    elif not element:
        Z = _complement(G if sticking else G[:1])
    r = Z.shape[1]
    extra = (2 if free_flight else 0 if sticking else 1) if dashpot else 0
    size = 2 * r + extra
    # Every quantity is a row of factors of the coordinates and of d.
    unit = np.eye(size + 6, dtype=np.longdouble)
    d = unit[size:]
    q, v = Z @ unit[:r], Z @ unit[r : 2 * r]
    if free_flight:
        q[rigid], v[rigid] = d[Q_R], d[V_R]
    elif sticking and not element:
        held = G.T @ np.linalg.inv((G @ G.T).astype(float))[:, 1]
        held /= tangential @ held
        q, v = q + np.outer(held, d[S]), v + np.outer(held, d[P])
    free = -c[:, None] * v - k[:, None] * q + np.outer(inertia, d[A])
    g_N, rate_N, rate_T = normal @ q, normal @ v, tangential @ v - d[P]
    u, rate, force = np.zeros((3, 2, size + 6), dtype=np.longdouble)
    load = np.stack([d[ONE], 0.0 * d[ONE]])
    if element and free_flight:
        flexible = np.linalg.inv(K.astype(float))
        u = unit[2 * r : size] if dashpot else -flexible @ load
        if dashpot:
            rate = -_solve2(C, K @ u + load)
    elif element:
        along = K[1] - m * K[0]
        across = C[1] - m * C[0]
        u[0], rate[0] = -g_N, -rate_N
        if sticking:
            u[1], rate[1] = d[S] - tangential @ q, -rate_T
        elif dashpot:
            u[1] = unit[2 * r]
            rate[1] = -(along @ u + across[0] * rate[0] - m * d[ONE]) / across[1]
        else:
            u[1] = -(along[0] * u[0] - m * d[ONE]) / along[1]
            rate[1] = -along[0] / along[1] * rate[0]
        force = K @ u + C @ rate + load
    elif sticking:
        force = load + _solve2(G @ G.T, np.stack([0.0 * d[A], d[A]]) - G @ free)
    elif not free_flight:
        force[0] = ((normal @ normal) * d[ONE] - normal @ free) / (normal @ normal + m * (normal @ tangential))
        force[1] = m * force[0]
    acceleration = free + G.T @ (force - load)
    moving = [unit[r : 2 * r], Z.T @ acceleration]
    if extra:
        moving.append(rate[2 - extra :])
    speed = 0.0 * rate_T if sticking else rate_T + rate[1]
    N, T = force
    always = d[ONE]
    watched = {SEPARATION: [g_N + u[0], always, always], STICK: [N, mu * N - T, mu * N + T]}
    signals = np.stack([N, T, g_N + u[0], speed, rate[0], rate[1], point_b @ v])
    taken = np.zeros((size, 2 * n + 2), dtype=np.longdouble)
    taken[:r, :n], taken[r : 2 * r, n : 2 * n] = Z.T, Z.T
    taken[2 * r :, 2 * n + 2 - extra :] = np.eye(extra)
    return in_eigenbasis(
        np.vstack(moving),
        np.concatenate([np.full(r, np.nan), np.ones(r), np.full(extra, np.sqrt(float(K[1, 1])))]),
        taken,
        np.vstack([q, v, u]),
        np.vstack([v, signals]),
        np.stack(watched.get(which, [N, -s * speed, always])),
    )


def _complement(rows: Any) -> Any:
    """Orthonormal columns on which all rows vanish."""
    full = np.linalg.qr(rows.T.astype(float), mode="complete")[0][:, len(rows) :].astype(np.longdouble)
    inverse = np.linalg.inv((rows @ rows.T).astype(float))
    for _ in range(REFINED):
        full = full - rows.T @ (inverse @ (rows @ full))
    return full


def _solve2(matrix: Any, right: Any) -> Any:
    """Solve a 2 x 2 system in the precision it is given in."""
    (a, b), (c, d) = matrix
    return np.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]]) / (a * d - b * c)


@lru_cache(maxsize=32)
@one_blas_thread()
def regimes(model: ReducedModel, mu: float) -> tuple[Regime, ...]:
    """All four regimes of a model."""
    return tuple(regime(model, mu, which) for which in (SEPARATION, STICK, SLIP_UP, SLIP_DOWN))
