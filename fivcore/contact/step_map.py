"""The largest step at which the kicks of `fast` are stable in slip as well as in stick.

In slip the contact's stiffness is that of the element seen through friction, which may exceed what
`ReducedModel.largest_step` knows. Kicks that are too far apart show as an eigenvalue of a step's matrix near
-1 and beyond it: the motion changes sign from step to step. True flutter has arguments far from pi.
"""

from __future__ import annotations

import numpy as np

from fivcore.beams.free_motion import propagator
from fivcore.contact.law import regime_maps
from fivcore.contact.reduced import ReducedModel
from fivcore.jit import Array

# Arguments beyond this share of pi are the step's, not the motion's.
ALTERNATING = 0.9


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


def step_matrices(model: ReducedModel, mu: float, step: float) -> list[Array]:
    """One step from kick to kick in stick and in slip either way, on (q, v) and in slip u_T."""
    _, K, C, M = model.kicks(step)
    stick, slip, *_ = regime_maps(K, C, M, mu, step)
    n, t = model.normal, model.tangential
    size = len(n)
    a, b, c, d = (np.diag(row) for row in propagator(model.stiffness, model.damping, step))
    zero = np.zeros(size)
    rows = [np.concatenate(part) for part in ((-n, zero), (-t, zero), (zero, n), (zero, t))]
    kick = np.eye(2 * size)
    kick[size:] += step * (np.outer(n, stick[0] @ rows) + np.outer(t, stick[1] @ rows))
    flow = np.block([[a, b], [c, d]])
    matrices = [np.asarray(flow @ kick)]
    inputs = np.zeros((3, 2 * size + 1))
    inputs[0, :size], inputs[1, -1], inputs[2, size:-1] = -n, 1.0, n
    for m, law in zip((mu, -mu), slip, strict=True):
        kick = np.eye(2 * size + 1)
        kick[size:-1] += step * np.outer(n + m * t, law[0] @ inputs)
        kick[-1] = law[1] @ inputs
        whole = np.eye(2 * size + 1)
        whole[:-1, :-1] = flow
        matrices.append(np.asarray(whole @ kick))
    return matrices
