"""Onset of sliding's flutter by a reduced model, from its own eigenvalues, to be compared with all modes."""

import numpy as np
from scipy.optimize import brentq

from fivcore.contact.reduced import ReducedModel
from studies.accuracy.solve_ivp import SLIP_UP, systems

# The onset lies within this share of that of all modes; slower than this is not vibration, Hz.
AROUND, SLOWEST = 0.2, 1.0


def growth_of(model: ReducedModel, mu: float, band: float) -> float:
    """Growth rate of the least stable mode of steady sliding below the band's end, 1/s."""
    found = sliding_eigenvalues(model, mu)
    frequency = np.abs(found.imag) / (2.0 * np.pi)
    return float(found.real[(frequency > SLOWEST) & (frequency < band)].max())


def onset_of(model: ReducedModel, near: float, band: float = 10e3) -> float:
    """The coefficient of friction near that of all modes at which growth begins."""
    low, high = (1.0 - AROUND) * near, (1.0 + AROUND) * near
    return float(brentq(lambda mu: growth_of(model, mu, band), low, high, xtol=1e-15, rtol=1e-13))


def sliding_eigenvalues(model: ReducedModel, mu: float) -> np.ndarray:
    """Eigenvalues of steady sliding (T = mu N on P1, dragged along +x), with any termination, 1/s."""
    if model.C.any():
        return np.linalg.eigvals(systems(model, mu)[SLIP_UP].A).astype(complex)
    n, push = len(model.stiffness), model.normal + mu * model.tangential
    k, c = np.diag(model.stiffness), np.diag(model.damping)
    if model.K.any():
        # u_N = -g_N, and u_T follows it.
        K = model.K
        ratio = -(K[1, 0] - mu * K[0, 0]) / (K[1, 1] - mu * K[0, 1])
        k = k + (K[0, 0] + K[0, 1] * ratio) * np.outer(push, model.normal)
    else:
        # The force that keeps the gap from accelerating.
        along = np.eye(n) - np.outer(push, model.normal) / (model.normal @ push)
        k, c = along @ k, along @ c
    # Displacements in units of velocity, so that the matrix is balanced.
    scale = float(np.sqrt(model.stiffness.max()))
    return np.linalg.eigvals(np.block([[np.zeros((n, n)), scale * np.eye(n)], [-k / scale, -c]])).astype(complex)
