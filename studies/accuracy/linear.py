"""Onset and growth of sliding's flutter by a reduced model, to be held against all modes."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import brentq

from fivcore import Scene, flutter_onsets, sliding_modes
from fivcore.contact.reduced import TERMINATIONS, ReducedModel, full_model, reduced_model
from studies.accuracy.odes import sliding_eigenvalues
from studies.accuracy.settings import Option, cutoff_of, meshed
from studies.motion import transients

# The onset is looked for within this share of that of all modes.
REACH = 0.2
# Slower than this is not vibration, Hz.
SLOWEST = 1.0


def stability(scene: Scene, option: Option) -> dict[str, Any]:
    """The lowest onset and the largest growth rate at the scene's friction, by termination of the dropped modes.

    Without a cut-off all modes are kept, and all terminations are the same.
    """
    own = meshed(scene, option)
    rig, theta, mu = own.rig, own.drive_theta, own.mu
    onsets = flutter_onsets(rig, theta, fmax=transients.BAND).mu
    onset = float(onsets[0]) if len(onsets) else np.nan
    if option.kind != "cut-off":
        growth = float(np.max(sliding_modes(rig, theta, mu, fmax=transients.BAND).growth_rate))
        alike = np.ones(len(TERMINATIONS))
        count = len(full_model(rig, theta).stiffness)
        return {"onset_mu": onset * alike, "growth_rate": growth * alike, "modes": count}
    models = [reduced_model(rig, theta, cutoff_of(option, rig), kind) for kind in TERMINATIONS]
    return {
        "onset_mu": np.array([onset_of(model, onset) for model in models]),
        "growth_rate": np.array([growth_of(model, mu) for model in models]),
        "modes": int(models[0].kept.sum()),
    }


def growth_of(model: ReducedModel, mu: float) -> float:
    """Growth rate of the least stable mode of steady sliding below the band's end, 1/s."""
    found = sliding_eigenvalues(model, mu)
    frequency = np.abs(found.imag) / (2.0 * np.pi)
    return float(found.real[(frequency > SLOWEST) & (frequency < transients.BAND)].max())


def onset_of(model: ReducedModel, near: float) -> float:
    """The coefficient of friction near that of all modes at which growth begins; NaN if there is none."""
    low, high = (1.0 - REACH) * near, (1.0 + REACH) * near
    if not (growth_of(model, low) < 0.0 < growth_of(model, high)):
        return float("nan")
    return float(brentq(lambda mu: growth_of(model, mu), low, high, xtol=1e-15, rtol=1e-13))
