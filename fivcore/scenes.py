"""Loading time, equilibrium and stability of the simulated model of a scene, without a run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.contact.reduced import reduced_model
from fivcore.errors import InputError
from fivcore.rig import Scene, one_contact
from fivcore.stability.falling import sliding_point, wedging
from fivcore.structure import modal_structure
from fivcore.transient import normalised
from fivcore.transient.fast.steady import eigenvalues
from fivcore.transient.published import with_numerical_damping

Array = NDArray[np.float64]


def loading_time(scene: Scene) -> float:
    """Static stick time t0 = mu F / (k_t V), s: the drive loads a stuck contact from rest until it slips."""
    return normalised.loading_time(normalised.Normalised.of(scene))


def speed_per_load(V: float, F: float) -> float:
    """Speed of the drive per load, m/s/N, to the digits with which scenes are normalised."""
    return normalised.Normalised.of(Scene(V, 0.0, 0.0, F)).speed_per_load


def equilibrium(scene: Scene, about: str = "sliding") -> Array:
    """Modal displacements of steady sliding (T = mu(V) N), or of rest under the load (T = 0), with V > 0."""
    one_contact(scene.rig, "starts are those of one contact")
    own = modal_structure(scene.rig, scene.theta).motion
    mu = scene.mu * scene.friction.ratio(scene.V) if about == "sliding" else 0.0
    held, rigid = 1.0 + wedging(own) * mu, own.stiffness == 0.0
    if not held > 0.0:
        raise InputError(f"mu = {scene.mu:g}: the contact jams, so that there is no steady sliding")
    normal_force = scene.F * own.preload / held
    force = scene.F * own.load + normal_force * (own.normal + mu * own.tangential)
    q = np.where(rigid, 0.0, force) / np.where(rigid, 1.0, own.stiffness)
    # A rigid motion closes the contact.
    q[rigid] = -(own.normal @ q) / own.normal[rigid]
    return np.asarray(q)


def model_exponents(
    scene: Scene, cutoff: float | None = None, numerical_damping: str = "none", method: str = "fast"
) -> NDArray[Any]:
    """Exponents of small motions about steady sliding of the reduced model of `simulate`, 1/s.

    The model has the numerical damping of the options and modes up to its cut-off, far above the band of
    `sliding_modes`. The result is empty for rigid contact, in which only rounding holds the gap of a lasting
    contact, and for several contacts.
    """
    rig = with_numerical_damping(scene.rig, method, numerical_damping)
    model = reduced_model(rig, scene.drive_theta, cutoff)
    if scene.rig.several or not model.K.any():
        return np.empty(0, dtype=complex)
    own = modal_structure(rig, scene.drive_theta)
    kinetic, fall = sliding_point(own, scene.friction, scene.mu, abs(scene.V), scene.F)
    return eigenvalues(model, kinetic, model.default_step, fall)
