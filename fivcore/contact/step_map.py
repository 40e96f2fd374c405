"""One step of `fast` as an affine map of x, the state before the impulse: (q, v) in stick, (q, v, u_T) in slip.

The contact has four inputs, s = S x + s0: penetration, u_T and the rates of the two gaps. Its law answers with
L s: N, T and in slip u_T after the step (`fivcore.contact.law`). The impulse of N and T changes v, then the modes
move freely. Stability of the step, the stick skip and the steady-state certificate share S, L and the matrix of x.

A step that is too long has an eigenvalue near -1 and beyond it: the motion changes its sign in every step, while
flutter turns by far less than pi. In slip the element, seen through friction, may be stiffer than
`ReducedModel.largest_step` knows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from fivcore.beams.free_motion import propagator
from fivcore.contact.impulse import Impulse
from fivcore.contact.law import regime_maps
from fivcore.contact.reduced import ReducedModel
from fivcore.jit import Array, Complex

# Arguments beyond this share of pi are the step's, not the motion's.
ALTERNATING = 0.9


class StepMap(NamedTuple):
    """A step in one regime, as a map of x with m components.

    Attributes
    ----------
    matrix : ndarray, (m, m)
    impulse : ndarray, (m, 2)
        What a unit of N and of T adds to x within the step.
    force : ndarray, (2, m)
        N and T from x.
    seen, law : ndarray, (4, m), (2 or 3, 4)
        S and L.
    units : ndarray, (m,)
        The sum of squares of units * x is an energy, which makes eigenvectors as well conditioned as they can be.
    """

    matrix: Array
    impulse: Array
    force: Array
    seen: Array
    law: Array
    units: Array


def stick_map(model: ReducedModel, impulse: Impulse, step: float) -> StepMap:
    """Map of a step in stick, where u_T follows g_T."""
    n, t, zero = model.normal, model.tangential, np.zeros(len(model.normal))
    seen = np.stack([np.r_[-n, zero], np.r_[-t, zero], np.r_[zero, n], np.r_[zero, t]])
    law = regime_maps(impulse.stiffness, impulse.damping, impulse.mobility, 0.0, step).stick
    return _step_map(model, step, seen, law, np.zeros(0))


def slip_map(model: ReducedModel, impulse: Impulse, mu: float, step: float, way: int) -> StepMap:
    """Map of a step in slip with T = mu N (`way` = 0) or T = -mu N (1)."""
    n, t, zero = model.normal, model.tangential, np.zeros(len(model.normal))
    seen = np.stack([np.r_[-n, zero, 0.0], np.r_[zero, zero, 1.0], np.r_[zero, n, 0.0], np.r_[zero, t, 0.0]])
    force, u_T = regime_maps(impulse.stiffness, impulse.damping, impulse.mobility, mu, step).slip[way]
    law = np.column_stack([np.stack([force, (-mu if way else mu) * force, u_T]), np.zeros(3)])
    return _step_map(model, step, seen, law, np.sqrt(model.K[1:, 1]))


def _step_map(model: ReducedModel, step: float, seen: Array, law: Array, unit: Array) -> StepMap:
    """Close the loop of contact and modes; `unit` is that of u_T where u_T is part of x, and empty elsewhere."""
    size, total = len(model.normal), seen.shape[1]
    # Without a stiffness of its own the free mode has the contact's.
    omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, model.contact_frequency**2))
    a, b, c, d = (np.diag(row) for row in propagator(model.stiffness, model.damping, step))
    flow = block_diag(np.block([[a, b], [c, d]]), np.eye(len(unit)))
    output, impulse, jump = law @ seen, np.zeros((total, 2)), np.eye(total)
    impulse[size : 2 * size] = step * np.stack([model.normal, model.tangential], axis=1)
    jump += impulse @ output[:2]
    jump[2 * size :] = output[2:]
    units = np.concatenate([omega, np.ones(size), unit])
    return StepMap(flow @ jump, flow @ impulse, output[:2], seen, law, units)


def eigenvectors(step_map: StepMap) -> tuple[Complex, Complex, Complex, float]:
    """Eigenvalues z and eigenvectors X of the matrix M, X^-1, and the maximum norm of X^-1 (M X - X diag(z))."""
    matrix = step_map.units[:, None] * step_map.matrix / step_map.units
    # Entries that are only rounding would spoil the eigenvectors' balance; the norm includes what they do.
    z, X = np.linalg.eig(np.where(np.abs(matrix) < 1e-15, 0.0, matrix))
    inverse = np.linalg.inv(X)
    error = float(np.abs(inverse @ (matrix @ X - X * z)).sum(axis=1).max())
    X, inverse = X / step_map.units[:, None], inverse * step_map.units
    return z.astype(complex), X.astype(complex), inverse.astype(complex), error


def step_matrices(model: ReducedModel, mu: float, step: float) -> list[Array]:
    """Matrices of a step in stick, in slip with T = mu N and in slip with T = -mu N."""
    impulse = model.impulse(step)
    slip = (slip_map(model, impulse, mu, step, way).matrix for way in (0, 1))
    return [stick_map(model, impulse, step).matrix, *slip]


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
