"""Exact motion of free damped modes over a step, by their characteristic roots."""

from __future__ import annotations

import numpy as np

from fivcore.jit import Array


def propagator(stiffness: Array, damping: Array, step: float) -> Array:
    """Exact solution of q'' + c q' + k q = 0 over a step, s, as rows a, b, c, d of q -> a q + b v, v -> c q + d v.

    (4, n). k and c, (n,), in rad2/s2 and 1/s, may have any size: oscillating, overdamped or free (k = 0).
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
