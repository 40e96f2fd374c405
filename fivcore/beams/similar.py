"""Modes at the contact of rigs that differ in all parameters but the mesh, without eigenproblems.

Cantilevers with the same number of elements are similar: a mode's squared frequency goes with E / (rho L^2) if it
is axial and with E t^2 / (rho L^4) if it bends, its mass-normalised displacement with m^-1/2. P1's support moves
along y. In the modes of the clamped P1 that is a rank-one change of the modal mass, from I to I - G G^T / m_total
with the participation factors G, so that its squared frequencies are the roots of a secular equation, one above
each pole d (Golub, SIAM Review 15, 1973, 318-334). A root is sought as its distance from the nearest pole, which
alone tells the shape of the mode (Li, LAPACK Working Note 89, 1993). Masses here are in units of the beam's.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fivcore.beams.elements import axial, bending
from fivcore.beams.modes import EPS, cantilever_modes, one_blas_thread
from fivcore.jit import Array, kernel
from fivcore.rig import Beam


@lru_cache(maxsize=16)
@one_blas_thread()
def unit_cantilever(elements: int) -> tuple[Array, Array, Array]:
    """Modes of the cantilever whose length, width, thickness, modulus and density are 1.

    Returns
    -------
    modes : ndarray, (3, 3 elements)
        Squared frequency, participation factor, and displacement of the free end; axial modes first.
    deflections : ndarray, (2 elements + 2, 2 elements)
        Bending modes: deflection and rotation of each node, the clamped one included.
    rest : ndarray, (2,)
        What the squared participation factors, axial ones and bending ones, leave of the mass.
    """
    beam = Beam(1.0, 1.0, 1.0, 1.0, 1.0, elements)
    (along, u), (across, w) = cantilever_modes(beam)
    parts = axial(beam).base_inertia @ u, bending(beam).base_inertia @ w
    modes = np.stack([np.append(along, across), np.concatenate(parts), np.append(u[-1], w[-2])])
    return modes, np.pad(w, ((2, 0), (0, 0))), np.array([1.0 - part @ part for part in parts])


@kernel
def lower_deflections(position: float, deflections: Array) -> Array:
    """Deflections of P2's bending modes at `position` over length, interpolated as by `elements.hermite`."""
    n = len(deflections) // 2 - 1
    place = position * n
    # A point that rounding puts a hair beside a node belongs to the node.
    place = np.rint(place) if abs(place - np.rint(place)) < 1e-9 else place
    e = min(int(place), n - 1)
    x, y, u = place - e, 1.0 - (place - e), deflections[2 * e : 2 * e + 4]
    ends = (1.0 + 2.0 * x) * y * y * u[0] + x * x * (1.0 + 2.0 * y) * u[2]
    return ends + x * y / n * (y * u[1] - x * u[3])


@kernel
def upper_modes(theta: float, head_mass: float, along: float, across: float, modes: Array, rest: Array) -> Array:
    """Squared frequencies of P1's modes and their normal and tangential gap shapes, (3, n), the rigid one first.

    `along` and `across` scale the squared frequencies of axial and of bending modes.
    """
    n = modes.shape[1]
    own = np.empty(n)
    for i in range(n):
        own[i] = modes[0, i] * (along if i < n // 3 else across)
    order = np.argsort(own)
    sine, cosine = np.sin(np.radians(theta)), np.cos(np.radians(theta))
    support = head_mass + cosine * cosine * rest[0] + sine * sine * rest[1]
    result, moving, m, total = np.zeros((3, n + 1)), np.empty(n, dtype=np.int64), 0, 0.0
    result[1, 0] = np.sqrt(1.0 / (1.0 + head_mass))
    d, w, g, y, x, gap = np.empty(n + 1), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        j = order[i]
        # The beam's own axes, from A down to C and across it, in terms of x and y.
        along_x, along_y = (-sine, -cosine) if j < n // 3 else (cosine, -sine)
        # Two poles are never one.
        pole, part = max(own[j], result[0, i] * (1.0 + 2.0 * EPS)), along_y * modes[1, j]
        result[0, i + 1], result[1, i + 1], result[2, i + 1] = pole, along_y * modes[2, j], along_x * modes[2, j]
        # A mode that moves the support less than rounding keeps its frequency and its shape.
        if part * part > EPS * EPS * support:
            moving[m], d[m], g[m], w[m] = i + 1, pole, part, part * part * pole
            y[m], x[m] = result[1, i + 1], result[2, i + 1]
            total += w[m]
            m += 1
    if m > 0:
        # The last root lies below this.
        d[m] = d[m - 1] + max(d[m - 1], total / support)
    for k in range(m):
        root, slope, tangential = secular_root(k, d, w[:m], support, gap), 0.0, 0.0
        normal = 1.0 / root
        for i in range(m):
            q = g[i] / gap[i]
            slope += q * q * d[i]
            normal += y[i] * q
            tangential += x[i] * q
        scale, j = np.sqrt(root / slope), moving[k]
        result[0, j], result[1, j], result[2, j] = root, scale * normal, scale * tangential
    return result


@kernel
def secular_root(k: int, d: Array, w: Array, m: float, gap: Array) -> float:
    """Root z of m + sum_i w_i / (d_i - z) = 0 between d_k and d_(k+1); fill `gap` with d - z.

    One more d than w. Iteration by Bunch, Nielsen, Sorensen, Numer. Math. 31, 1978, 31-48.
    """
    n, middle, c = len(w), 0.5 * (d[k + 1] - d[k]), m
    for i in range(n):
        if i < k or i > k + 1:
            c += w[i] / (d[i] - d[k] - middle)
    above = w[k + 1] if k + 1 < n else 0.0
    left = c + (above - w[k]) / middle > 0.0
    origin, low, high = (k, 0.0, middle) if left else (k + 1, -middle, 0.0)
    p, q = d[k] - d[origin], d[k + 1] - d[origin]
    z = _two_poles(c, c * (p + q) + w[k] + above, w[k] * q + above * p)
    for _ in range(200):
        if not low < z < high:
            z = 0.5 * (low + high)
        f, size, slope_below, slope_above = m, m, 0.0, 0.0
        for i in range(n):
            gap[i] = d[i] - d[origin] - z
            term = w[i] / gap[i]
            f += term
            size += abs(term)
            if i <= k:
                slope_below += term / gap[i]
            else:
                slope_above += term / gap[i]
        low, high = (z, high) if f < 0.0 else (low, z)
        # The terms of the poles below and above as one pole each, with their value and slope.
        p, q = d[k] - d[origin] - z, d[k + 1] - d[origin] - z
        c = f - slope_below * p - slope_above * q
        step = _two_poles(c, c * (p + q) + slope_below * p * p + slope_above * q * q, p * q * f)
        if abs(f) <= 2.0 * EPS * size or abs(step) <= EPS * abs(z):
            break
        z += step
    return d[origin] + z


@kernel
def _two_poles(c: float, a: float, b: float) -> float:
    """Root of c z^2 - a z + b = 0 between the poles of a sum of two."""
    root = np.sqrt(max(a * a - 4.0 * b * c, 0.0))
    return (a - root) / (2.0 * c) if a <= 0.0 else 2.0 * b / (a + root)
