"""The reduced model's regimes as first-order systems, plainly (`fivcore.contact.law` says the law).

Written from the law alone, for what a user would do with a general tool: eigenvalues of steady sliding, and an
integrator with events. The state is (q, v, u_N, u_T), all as deviations from rest under a unit load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fivcore.contact.reduced import ReducedModel

Array = NDArray[np.float64]
SEPARATION, STICK, SLIP_UP, SLIP_DOWN = range(4)


@dataclass(frozen=True, eq=False)
class System:
    """y' = A y + B (1, X', X''), X being the displacement of P2's clamp; load 1 N.

    Attributes
    ----------
    A, B : ndarray, (m, m) and (m, 3)
    signals, drift : ndarray, (4, m) and (4, 3)
        N, T, gap and slip rate as rows on y and on (1, X', X'').
    """

    A: Array
    B: Array
    signals: Array
    drift: Array


def systems(model: ReducedModel, mu: float) -> tuple[System, System, System, System]:
    """Separation, stick, slip with T = mu N and slip with T = -mu N, for a model with an absorbing element."""
    if not model.C.any():
        raise ValueError("model: it must have an absorbing element")
    n = len(model.stiffness)
    size = 2 * n + 2
    unit, one = np.eye(size + 3), size
    v, u, clamp = unit[n : 2 * n], unit[2 * n : size], unit[size + 1]
    rate_N, rate_T = model.normal @ v, model.tangential @ v - clamp
    found = []
    for which in range(4):
        m = (0.0, 0.0, mu, -mu)[which]
        if which == SEPARATION:
            load = np.stack([unit[one], 0.0 * unit[one]])
            rate = -np.linalg.solve(model.C, model.K @ u + load)
        else:
            rate = np.stack([-rate_N, -rate_T])
            if which != STICK:
                # T - m N = 0 for the rate of u_T.
                K, C = model.K[1] - m * model.K[0], model.C[1] - m * model.C[0]
                rate[1] = -(K @ u + C[0] * rate[0] - m * unit[one]) / C[1]
        force = model.K @ u + model.C @ rate
        whole = np.zeros((size, size + 3))
        whole[:n] = v
        whole[n : 2 * n] = (
            -model.stiffness[:, None] * unit[:n]
            - model.damping[:, None] * v
            + np.outer(model.normal, force[0])
            + np.outer(model.tangential, force[1])
            + np.outer(model.inertia, unit[size + 2])
        )
        whole[2 * n :] = rate
        gap = model.normal @ unit[:n] + u[0]
        signals = np.stack([force[0] + unit[one], force[1], gap, rate_T + rate[1]])
        found.append(System(whole[:, :size], whole[:, size:], signals[:, :size], signals[:, size:]))
    return found[0], found[1], found[2], found[3]


def sliding_eigenvalues(model: ReducedModel, mu: float) -> NDArray[np.complex128]:
    """Eigenvalues of steady sliding (T = mu N on P1, dragged along +x), with any termination, 1/s."""
    n, m = len(model.stiffness), mu
    push = model.normal + m * model.tangential
    if model.C.any():
        return np.linalg.eigvals(systems(model, mu)[SLIP_UP].A).astype(complex)
    k, c = np.diag(model.stiffness), np.diag(model.damping)
    if model.K.any():
        # u_N = -g_N, and u_T follows it.
        K = model.K
        ratio = -(K[1, 0] - m * K[0, 0]) / (K[1, 1] - m * K[0, 1])
        k = k + (K[0, 0] + K[0, 1] * ratio) * np.outer(push, model.normal)
    else:
        # The force that keeps the gap from accelerating.
        along = np.eye(n) - np.outer(push, model.normal) / (model.normal @ push)
        k, c = along @ k, along @ c
    # Displacements in units of velocity, so that the matrix is balanced.
    scale = float(np.sqrt(model.stiffness.max()))
    return np.linalg.eigvals(np.block([[np.zeros((n, n)), scale * np.eye(n)], [-k / scale, -c]])).astype(complex)
