"""Onset of sliding's flutter by a reduced model, to be compared with all modes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from fivcore import Scene, flutter_onsets
from fivcore.contact.reduced import TERMINATIONS, ReducedModel, full_model, reduced_model
from studies.accuracy.settings import Option, cutoff_of
from studies.accuracy.solve_ivp import SLIP_UP, systems
from studies.motion import transients

# The onset lies within this share of that of all modes.
AROUND = 0.2
# Slower than this is not vibration, Hz.
SLOWEST = 1.0


def stability(scene: Scene, option: Option) -> dict[str, Any]:
    """The lowest onset, by termination of the dropped modes: without a cut-off none are, and all are the same."""
    rig, theta = scene.rig, scene.drive_theta
    onset = float(next(iter(flutter_onsets(rig, theta, fmax=transients.BAND).mu), np.nan))
    if option.kind != "cut-off":
        return {"onset_mu": np.full(len(TERMINATIONS), onset), "modes": len(full_model(rig, theta).stiffness)}
    models = [reduced_model(rig, theta, cutoff_of(option, rig), kind) for kind in TERMINATIONS]
    return {"onset_mu": np.array([onset_of(each, onset) for each in models]), "modes": int(models[0].kept.sum())}


def growth_of(model: ReducedModel, mu: float) -> float:
    """Growth rate of the least stable mode of steady sliding below the band's end, 1/s."""
    found = sliding_eigenvalues(model, mu)
    frequency = np.abs(found.imag) / (2.0 * np.pi)
    return float(found.real[(frequency > SLOWEST) & (frequency < transients.BAND)].max())


def onset_of(model: ReducedModel, near: float) -> float:
    """The coefficient of friction near that of all modes at which growth begins; NaN if there is none."""
    low, high = (1.0 - AROUND) * near, (1.0 + AROUND) * near
    if not (growth_of(model, low) < 0.0 < growth_of(model, high)):
        return float("nan")
    return float(brentq(lambda mu: growth_of(model, mu), low, high, xtol=1e-15, rtol=1e-13))


def sliding_eigenvalues(model: ReducedModel, mu: float) -> NDArray[np.complex128]:
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
