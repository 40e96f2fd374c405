"""Pseudo-modes: a few damped modes that stand for bands of the modes above a cut-off."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from fivcore.contact.reduced import DAMPING, MODAL, ReducedModel

# Up to here dropped modes are gathered into bands, Hz; those above are left to the element.
HIGHEST, BANDS = 300e3, 2


def with_pseudo_modes(model: ReducedModel, full: ReducedModel, damping: float | None) -> ReducedModel:
    """Put two pseudo-modes in place of each band of dropped modes, and an element in place of what lies above.

    Bands are BANDS equal ratios of frequency, from the highest kept mode to HIGHEST. The shapes of a band's
    pseudo-modes are the principal axes of its static flexibility, which they keep; each has the frequency at which
    it also keeps the band's inverse mass along its axis. Each is a passive oscillator and the element is passive,
    so that their sum is.

    Parameters
    ----------
    model, full : ReducedModel
        With an absorbing element; with every mode of the same rig and inclination.
    damping : float, optional
        Share of critical damping of the pseudo-modes. Default: they lose their motion at the rate of the band's
        width, as a blow on a continuum of modes would; but a band has few, and they give back what they take.
    """
    omega = np.sqrt(full.stiffness)
    edges = np.geomspace(np.sqrt(model.stiffness.max()) * (1.0 + 1e-9), 2.0 * np.pi * HIGHEST, BANDS + 1)
    flexibility, added = np.linalg.inv(model.K), []
    for low, high in pairwise(edges):
        band = (omega > low) & (omega <= high)
        g = full.shapes[:, band]
        static = (g / full.stiffness[band]) @ g.T
        flexibility = flexibility - static
        compliances, axes = np.linalg.eigh(static)
        for compliance, axis in zip(compliances, axes.T, strict=True):
            if compliance > 1e-9 * compliances[-1]:
                stiffness = float(axis @ g @ g.T @ axis) / compliance
                rate = high - low if damping is None else 2.0 * damping * np.sqrt(stiffness)
                added.append((stiffness, rate, *(np.sqrt(compliance * stiffness) * axis)))
    columns = dict(zip(("stiffness", "damping", "normal", "tangential"), np.transpose(added), strict=True))
    none = np.zeros(len(added))
    modal = {name: np.concatenate([getattr(model, name), columns.get(name, none)]) for name in MODAL}
    stiff = replace(model, **modal, K=np.linalg.inv(flexibility))
    return replace(stiff, C=2.0 * DAMPING / stiff.contact_frequency * stiff.K)
