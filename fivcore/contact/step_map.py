"""One step of `fast` as an affine map of x, the state before the impulse: (q, v) in stick, (q, v, u_T) in slip.

The contact has four inputs, s = S x + s0: penetration, u_T and the rates of the two gaps. Its law answers with
L s: N, T and in slip u_T after the step (`fivcore.contact.law`). The impulse of N and T changes v, then the modes
move freely. Stability of the step, the stick skip and the steady-state certificate share S, L and the matrix of x.

A step that is too long has a growing eigenvalue whose argument is beyond 0.9 pi: the motion changes its sign in
every step, while flutter turns by far less. In slip the spring, seen through friction, may be stiffer than
`ReducedModel.largest_step` knows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from fivcore.beams.modes import propagator
from fivcore.contact.impulse import Impulse
from fivcore.contact.law import Slide, slide, status_maps
from fivcore.contact.reduced import ReducedModel
from fivcore.jit import Array, Complex


class StepMap(NamedTuple):
    """A step in one contact status, as a map of x with m components."""

    matrix: Array
    # What a unit of N and of T adds to x within the step, (m, 2).
    impulse: Array
    # S, (4, m), and L, (2 or 3, 4).
    seen: Array
    law: Array
    # The sum of squares of units * x, (m,), is an energy: eigenvectors are as well conditioned as they can be.
    units: Array


def step_map(
    model: ReducedModel, impulse: Impulse, step: float, friction: float | None = None, fall: float = 0.0
) -> StepMap:
    """Map of a step in slip with T = `friction` * N, mu or -mu; None: in stick, where u_T follows g_T.

    With `fall`, T = `friction` * N + `fall` * slip rate, and x is the deviation from steady sliding.
    """
    gaps, size, own = model.shapes, len(model.normal), int(friction is not None)
    maps = status_maps(impulse.stiffness, impulse.damping, impulse.delassus, friction or 0.0, step)
    law, seen = maps.stick, np.pad(np.kron(np.diag([-1.0, 1.0]), gaps), ((0, 0), (0, own)))
    if friction is not None:
        force, u_T = maps.slip[0]
        law, seen[1] = np.pad([force, friction * force, u_T], ((0, 0), (0, 1))), np.eye(2 * size + 1)[-1]
        if fall:
            law = _falling(slide(impulse.stiffness, impulse.damping, impulse.delassus, step), friction, fall)
    push, output = np.pad(step * gaps.T, ((size, own), (0, 0))), law @ seen
    jump = np.eye(2 * size + own) + push @ output[:2]
    jump[2 * size :] = output[2:]
    a, b, c, d = (np.diag(row) for row in propagator(model.stiffness, model.damping, step))
    flow = block_diag(np.block([[a, b], [c, d]]), np.eye(own))
    # Without a stiffness of its own the free mode has the contact's.
    omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, model.contact_frequency**2))
    units = np.concatenate([omega, np.ones(size), np.sqrt(model.K[1:, 1])[:own]])
    return StepMap(flow @ jump, flow @ push, seen, law, units)


def _falling(s: Slide, m: float, fall: float) -> Array:
    """N, T and u_T at the end from (p, u_T, v_N, v_T), (3, 4), for T = m N + fall times the slip rate."""
    alpha = np.array([s.by_p, 0.0, s.by_v, 0.0])
    free = np.array([0.0, -s.relaxing, 0.0, 1.0]) + s.rate_N / s.beta * alpha
    T = (m / s.beta * alpha + fall * free) / (1.0 - fall * s.mobility - m * s.gamma / s.beta)
    N = (alpha + s.gamma * T) / s.beta
    return np.stack([N, T, np.array([0.0, s.keep, 0.0, 0.0]) + s.end_N * N + s.end_T * T])


def eigenvectors(status: StepMap) -> tuple[Complex, Complex, Complex, float]:
    """Eigenvalues z and eigenvectors X of the matrix M, X^-1, and the maximum norm of X^-1 (M X - X diag(z))."""
    matrix, units = status.units[:, None] * status.matrix / status.units, status.units.astype(complex)
    # Entries that are only rounding would spoil the eigenvectors' balance; the norm includes what they do.
    z, X = np.linalg.eig(np.where(np.abs(matrix) < 1e-15, 0.0, matrix))
    inverse = np.linalg.inv(X)
    error = float(np.linalg.norm(inverse @ (matrix @ X - X * z), np.inf))
    return z.astype(complex), X / units[:, None], inverse * units, error


def stable(model: ReducedModel, mu: float, step: float) -> bool:
    """Whether in no contact status the motion alternates with growth."""
    impulse = model.impulse(step)
    z = np.concatenate([np.linalg.eigvals(step_map(model, impulse, step, way).matrix) for way in (None, mu, -mu)])
    return not np.any((np.abs(z) > 1.0 + 1e-9) & (np.abs(np.angle(z)) > 0.9 * np.pi))


def largest_stable_step(model: ReducedModel, mu: float, step: float) -> float:
    """Largest stable step between the default one, s, and the unstable `step`, by bisection."""
    low, high = min(model.default_step, step), step
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(model, mu, middle) else (low, middle)
    return low


def at_most(limit: float, digits: int = 4) -> str:
    """A limit as text, rounded down, so that the printed value is allowed itself."""
    unit = 10.0 ** (np.floor(np.log10(limit)) - digits + 1)
    return f"{np.floor(limit / unit) * unit:.{digits}g}"
