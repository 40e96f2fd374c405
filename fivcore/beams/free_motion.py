"""Exact motion of free damped modes over a step, by their characteristic roots."""

from __future__ import annotations

import numpy as np

from fivcore.jit import Array


def propagator(stiffness: Array, damping: Array, step: float) -> Array:
    """Matrix of the exact solution of q'' + c q' + k q = 0 over one step.

    Parameters
    ----------
    stiffness, damping : ndarray, (n,)
        k in rad2/s2 and c in 1/s, of any size: oscillating, overdamped or free (k = 0).
    step : float
        Duration, s.

    Returns
    -------
    ndarray, (4, n)
        Rows a, b, c, d of q -> a q + b v, v -> c q + d v.
    """
    half = 0.5 * damping
    root = np.sqrt((half**2 - stiffness).astype(complex))
    # cosh and sinh / root of the step, with the damping inside the exponents so that nothing overflows.
    up, down = np.exp((root - half) * step), np.exp((-root - half) * step)
    cosine = (0.5 * (up + down)).real
    small = np.abs(root) * step < 1e-4
    safe = np.where(small, 1.0, root)
    series = step * np.exp(-half * step) * (1.0 + (root * step) ** 2 / 6.0)
    sine = np.where(small, series, (up - down) / (2.0 * safe)).real
    return np.stack([cosine + half * sine, sine, -stiffness * sine, cosine - half * sine])
