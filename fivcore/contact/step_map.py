"""One step of `fast` as an affine map of x, the state before the impulse: (q, v) in stick, (q, v, u_T) in slip.

The contact has four inputs, s = S x + s0: penetration, u_T and the rates of the two gaps. Its law returns L s: N,
T and, in slip, u_T after the step (`fivcore.contact.law`). The impulse of N and T changes v, then the modes move
freely. The stability check of the step, the stick skip and the steady-state certificate share S, L and the matrix.

If the step is too long, a growing eigenvalue has an argument beyond 0.9 pi: the motion changes its sign in each
step, whereas flutter turns by much less. In slip, friction coupling may make the effective spring stiffer than
`ReducedModel.largest_step` assumes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fivcore.beams.modes import propagator
from fivcore.contact.reduced import ReducedModel
from fivcore.jit import Array, Complex


class StepMap(NamedTuple):
    """A step in one contact status, as a map of x with m components."""

    matrix: Array
    # Change of x within the step for unit N and unit T, (m, 2).
    impulse: Array
    # S, (4, m), and L, (2 or 3, 4).
    seen: Array
    law: Array
    # |units * x|^2, units (m,), is an energy; this scaling gives the best-conditioned eigenvectors.
    units: Array


def step_map(model: ReducedModel, step: float, friction: float | None = None, fall: float = 0.0) -> StepMap:
    """Map of a step in slip with T = `friction` * N (mu or -mu), or with None in stick, where u_T follows g_T.

    With `fall`, T = `friction` * N + `fall` * slip rate, and x is the deviation from steady sliding.
    """
    contact, gaps, n, slips = model.discrete(step), model.shapes, len(model.normal), friction is not None
    law = contact.stick() if friction is None else contact.slip.forces(friction, fall)
    size, i, push = 2 * n + slips, np.arange(n), step * gaps.T
    a, b, c, d = propagator(model.stiffness, model.damping, step)
    impulse, seen, matrix = np.zeros((size, 2)), np.zeros((4, size)), np.zeros((size, size))
    impulse[:n], impulse[n : 2 * n] = b[:, None] * push, d[:, None] * push
    seen[:2, :n], seen[2:, n : 2 * n] = -gaps, gaps
    matrix[i, i], matrix[i, n + i], matrix[n + i, i], matrix[n + i, n + i] = a, b, c, d
    if slips:
        seen[1] = np.eye(size)[-1]
        matrix[-1] = law[2] @ seen
    matrix += impulse @ (law[:2] @ seen)
    # A rigid-body mode has no stiffness and is scaled by the contact frequency.
    omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, model.contact_frequency**2))
    units = np.concatenate([omega, np.ones(n), np.sqrt(model.K[1:, 1])[:slips]])
    return StepMap(matrix, impulse, seen, law, units)


def eigenvectors(status: StepMap) -> tuple[Complex, Complex, Complex, float]:
    """Eigenvalues z and eigenvectors X of the matrix M, X^-1, and the maximum norm of X^-1 (M X - X diag(z))."""
    matrix, units = status.units[:, None] * status.matrix / status.units, status.units.astype(complex)
    # Entries below 1e-15 are set to zero because they would mislead balancing; `error` includes the effect.
    z, X = np.linalg.eig(np.where(np.abs(matrix) < 1e-15, 0.0, matrix))
    inverse = np.linalg.inv(X)
    error = float(np.linalg.norm(inverse @ (matrix @ X - X * z), np.inf))
    return z.astype(complex), X / units[:, None], inverse * units, error


def stable(model: ReducedModel, mu: float, step: float) -> bool:
    """Whether no contact status has a growing alternating motion, with the margin of `largest_share`."""
    step /= model.largest_share
    z = np.concatenate([np.linalg.eigvals(step_map(model, step, way).matrix) for way in (None, mu, -mu)])
    return not np.any((np.abs(z) > 1.0 + 1e-9) & (np.abs(np.angle(z)) > 0.9 * np.pi))


def largest_stable_step(model: ReducedModel, mu: float, step: float) -> float:
    """Largest stable step between the default one, s, and the unstable `step`, by bisection."""
    low, high = min(model.default_step, step), step
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(model, mu, middle) else (low, middle)
    return low


def at_most(limit: float, digits: int = 4) -> str:
    """Format a limit, rounded down so that the printed value is allowed."""
    unit = 10.0 ** (np.floor(np.log10(limit)) - digits + 1)
    return f"{np.floor(limit / unit) * unit:.{digits}g}"
