"""One step of `fast` as a linear map: what stability, the skip and the proof of steady sliding share.

In stick a step from impulse to impulse is an affine map of x = (q, v), in slip either way one of (q, v, u_T). Here
are their matrices. Their eigenvalues tell whether a step is stable: steps that are too long show as an eigenvalue
near -1 and beyond it, for the motion changes sign from step to step, while true flutter has arguments far from pi.
In slip the contact's stiffness is that of the element seen through friction, which may exceed what
`ReducedModel.largest_step` knows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fivcore.beams.free_motion import propagator
from fivcore.contact.impulse import Impulse
from fivcore.contact.law import regime_maps
from fivcore.contact.reduced import ReducedModel
from fivcore.jit import Array

# Arguments beyond this share of pi are the step's, not the motion's.
ALTERNATING = 0.9


class StickMap(NamedTuple):
    """A step in stick as a map of x = (q, v) before the impulse.

    Attributes
    ----------
    matrix : ndarray, (2n, 2n)
    impulse : ndarray, (2n, 2)
        What a unit of N and of T adds to x within the step.
    force : ndarray, (2, 2n)
        N and T from x.
    seen : ndarray, (4, 2n)
        Penetration, u_T and the rates of the gaps before the impulse from x.
    units : ndarray, (2n,)
        In units of these, x squared is an energy: eigenvectors are then as well conditioned as they can be.
    """

    matrix: Array
    impulse: Array
    force: Array
    seen: Array
    units: Array


def stick_map(model: ReducedModel, impulse: Impulse, step: float) -> StickMap:
    """The map of a step in stick."""
    n, t, size = model.normal, model.tangential, len(model.normal)
    zero = np.zeros(size)
    seen = np.stack([np.r_[-n, zero], np.r_[-t, zero], np.r_[zero, n], np.r_[zero, t]])
    stick = regime_maps(impulse.stiffness, impulse.damping, impulse.mobility, 0.0, step).stick
    flow = free_flow(model, step)
    kick = step * np.concatenate([np.zeros((size, 2)), np.stack([n, t], axis=1)])
    force = stick @ seen
    return StickMap(flow @ (np.eye(2 * size) + kick @ force), flow @ kick, force, seen, energy_units(model))


def slip_matrix(model: ReducedModel, impulse: Impulse, mu: float, step: float, way: int) -> Array:
    """Matrix of a step in slip with T = mu N (`way` = 0) or T = -mu N (1) on (q, v, u_T), (2n + 1, 2n + 1)."""
    n, t, size = model.normal, model.tangential, len(model.normal)
    law = regime_maps(impulse.stiffness, impulse.damping, impulse.mobility, mu, step).slip[way]
    inputs = np.zeros((3, 2 * size + 1))
    inputs[0, :size], inputs[1, -1], inputs[2, size:-1] = -n, 1.0, n
    kick = np.eye(2 * size + 1)
    kick[size:-1] += step * np.outer(n + (-mu if way else mu) * t, law[0] @ inputs)
    kick[-1] = law[1] @ inputs
    whole = np.eye(2 * size + 1)
    whole[:-1, :-1] = free_flow(model, step)
    return np.asarray(whole @ kick)


def free_flow(model: ReducedModel, step: float) -> Array:
    """Matrix of the free motion over a step on (q, v), (2n, 2n)."""
    a, b, c, d = (np.diag(row) for row in propagator(model.stiffness, model.damping, step))
    return np.block([[a, b], [c, d]])


def energy_units(model: ReducedModel) -> Array:
    """Frequencies (the contact's for the free mode) and ones: x times them squared is an energy, (2n,)."""
    omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, model.contact_frequency**2))
    return np.concatenate([omega, np.ones(len(omega))])


def step_matrices(model: ReducedModel, mu: float, step: float) -> list[Array]:
    """One step from impulse to impulse in stick and in slip either way, on (q, v) and in slip u_T."""
    impulse = model.impulse(step)
    return [
        stick_map(model, impulse, step).matrix,
        *(slip_matrix(model, impulse, mu, step, way) for way in (0, 1)),
    ]


def stable(model: ReducedModel, mu: float, step: float) -> bool:
    """Whether no regime of the contact alternates with growth."""
    for matrix in step_matrices(model, mu, step):
        z = np.linalg.eigvals(matrix)
        if np.any((np.abs(z) > 1.0 + 1e-9) & (np.abs(np.angle(z)) > ALTERNATING * np.pi)):
            return False
    return True


def largest_stable_step(model: ReducedModel, mu: float, step: float) -> float:
    """Largest stable step between the default one, s, and `step`, which is not; by bisection."""
    low, high = min(model.default_step, step), step
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(model, mu, middle) else (low, middle)
    return low


def at_most(limit: float, digits: int = 4) -> str:
    """A limit for a reader, rounded down: what is told to be allowed must be."""
    unit = 10.0 ** (np.floor(np.log10(limit)) - digits + 1)
    return f"{np.floor(limit / unit) * unit:.{digits}g}"
