"""Modes at the contact of rigs whose beams differ in every number but their elements, without eigenproblems.

Cantilevers with the same number of elements are similar: a mode's squared frequency goes with E / (rho L^2) if it is
axial and with E t^2 / (rho L^4) if it bends, its mass-normalised displacement with m^-1/2. P1's support moves along
y with the head mass. In the modes of the clamped P1 that is a rank-one change of the modal mass, from the identity to
I - G G^T / m_total with participation factors G, so that its squared frequencies are the roots of a secular equation,
one above each pole d (Golub, SIAM Review 15, 1973, 318-334). A root is sought as its distance from the nearest pole,
which alone tells the mode's shape (Li, LAPACK Working Note 89, 1993).

Kernels take lengths, masses and squared frequencies in units of the beam's own: L, m, and 1/s2 throughout.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fivcore.beams.elements import axial, bending
from fivcore.beams.modes import cantilever_modes
from fivcore.jit import Array, kernel
from fivcore.rig import Beam

EPS = 2.220446049250313e-16


@lru_cache(maxsize=16)
def unit_cantilever(elements: int) -> tuple[Array, Array, Array]:
    """Modes of the cantilever whose length, width, thickness, modulus and density are 1.

    Returns
    -------
    modes : ndarray, (3, 3 elements)
        Squared frequency, participation factor, and displacement of the free end; axial modes first.
    deflections : ndarray, (2 elements + 2, 2 elements)
        Bending modes: deflection and rotation of each node, the clamped one included.
    rest : ndarray, (2,)
        What all participation factors, axial ones and bending ones, leave of the mass.
    """
    beam = Beam(1.0, 1.0, 1.0, 1.0, 1.0, elements)
    (along, u), (across, w) = cantilever_modes(beam)
    parts = axial(beam).base_inertia @ u, bending(beam).base_inertia @ w
    modes = np.stack([np.append(along, across), np.concatenate(parts), np.append(u[-1], w[-2])])
    return modes, np.pad(w, ((2, 0), (0, 0))), np.array([1.0 - part @ part for part in parts])


@kernel
def lower_modes(position: float, scale: float, modes: Array, deflections: Array) -> tuple[Array, Array]:
    """Squared frequencies of P2's bending modes, and sqrt(m) times their gap shapes normal; position over length."""
    n = deflections.shape[1] // 2
    place = position * n
    # A point that rounding puts a hair beside a node belongs to the node.
    if abs(place - np.rint(place)) < 1e-9:
        place = np.rint(place)
    e = min(int(place), n - 1)
    x, y = place - e, 1.0 - (place - e)
    here, turn = (1.0 + 2.0 * x) * y * y, x * y * y / n
    there, back = x * x * (1.0 + 2.0 * y), -x * x * y / n
    u = deflections[2 * e : 2 * e + 4]
    normal = -(here * u[0] + turn * u[1] + there * u[2] + back * u[3])
    return scale * modes[0, n:], clean(normal)


@kernel
def upper_modes(
    theta: float, head_mass: float, along: float, across: float, modes: Array, rest: Array
) -> tuple[Array, Array, Array]:
    """Squared frequencies of P1's modes, the rigid one first, and sqrt(m) times their gap shapes.

    `along` and `across` scale the squared frequencies of axial and of bending modes.
    """
    n, elements = modes.shape[1], modes.shape[1] // 3
    sine, cosine = np.sin(np.radians(theta)), np.cos(np.radians(theta))
    d, g, normal, tangential = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        # The beam's own axes, from A down to C and across it, in terms of x and y.
        scale, x, y = (along, -sine, -cosine) if i < elements else (across, cosine, -sine)
        d[i], g[i] = scale * modes[0, i], y * modes[1, i]
        normal[i], tangential[i] = y * modes[2, i], x * modes[2, i]
    order = np.argsort(d, kind="mergesort")
    d, g, normal, tangential = d[order], g[order], normal[order], tangential[order]
    # Of two modes with one frequency, one combination does not move the support.
    for i in range(1, n):
        size = np.hypot(g[i - 1], g[i])
        if d[i] == d[i - 1] and size > 0.0:
            c, s = g[i] / size, g[i - 1] / size
            g[i - 1], g[i] = 0.0, size
            normal[i - 1], normal[i] = c * normal[i - 1] - s * normal[i], s * normal[i - 1] + c * normal[i]
            tangential[i - 1], tangential[i] = (
                c * tangential[i - 1] - s * tangential[i],
                s * tangential[i - 1] + c * tangential[i],
            )
    support = head_mass + cosine * cosine * rest[0] + sine * sine * rest[1]
    # A mode that moves the support less than rounding keeps its frequency and its shape.
    moving = np.flatnonzero(g * g > EPS * EPS * support)
    m = len(moving)
    pole, part, up, side = d[moving], g[moving], normal[moving], tangential[moving]
    weight, gap = part * part * pole, np.empty(m)
    if m > 0:
        # The last root lies below this.
        pole = np.append(pole, pole[-1] + max(pole[-1], np.sum(weight) / support))
    for k in range(m):
        root = secular_root(k, pole, weight, support, gap)
        slope, n_sum, t_sum = 0.0, 1.0 / root, 0.0
        for i in range(m):
            q = part[i] / gap[i]
            slope += q * q * pole[i]
            n_sum += up[i] * q
            t_sum += side[i] * q
        scale, j = np.sqrt(root / slope), moving[k]
        d[j], normal[j], tangential[j] = root, scale * n_sum, scale * t_sum
    rigid = np.sqrt(1.0 / (1.0 + head_mass))
    return (
        np.append(np.zeros(1), d),
        clean(np.append(np.full(1, rigid), normal)),
        clean(np.append(np.zeros(1), tangential)),
    )


@kernel
def secular_root(k: int, d: Array, w: Array, m: float, gap: Array) -> float:
    """Root z of m + sum_i w_i / (d_i - z) = 0 between d_k and d_(k+1); fill `gap` with d - z.

    One more d than w. Iteration by Bunch, Nielsen, Sorensen, Numer. Math. 31, 1978, 31-48.
    """
    n, middle, c = len(w), 0.5 * (d[k + 1] - d[k]), m
    for i in range(n):
        if i < k or i > k + 1:
            c += w[i] / (d[i] - d[k] - middle)
    w_next = w[k + 1] if k + 1 < n else 0.0
    left = c + (w_next - w[k]) / middle > 0.0
    origin, low, high = (k, 0.0, middle) if left else (k + 1, -middle, 0.0)
    below, above = d[k] - d[origin], d[k + 1] - d[origin]
    z = _two_poles(c, c * (below + above) + w[k] + w_next, w[k] * above + w_next * below)
    if not low < z < high:
        z = 0.5 * (low + high)
    for _ in range(200):
        f, size, slope_below, slope_above = m, m, 0.0, 0.0
        for i in range(k + 1):
            gap[i] = d[i] - d[origin] - z
            term = w[i] / gap[i]
            f += term
            size -= term
            slope_below += term / gap[i]
        for i in range(k + 1, n):
            gap[i] = d[i] - d[origin] - z
            term = w[i] / gap[i]
            f += term
            size += term
            slope_above += term / gap[i]
        if abs(f) <= 2.0 * EPS * size:
            break
        low, high = (z, high) if f < 0.0 else (low, z)
        # The terms of the poles below and above as one pole each, with their value and slope.
        p, q = below - z, above - z
        c = f - slope_below * p - slope_above * q
        step = _two_poles(c, c * (p + q) + slope_below * p * p + slope_above * q * q, p * q * f)
        last, z = z, z + step
        if not low < z < high:
            z = 0.5 * (low + high)
        if z == last or z == low or z == high:
            break
    for i in range(n):
        gap[i] = d[i] - d[origin] - z
    return d[origin] + z


@kernel
def _two_poles(c: float, a: float, b: float) -> float:
    """Root of c z^2 - a z + b = 0 between the poles of a sum of two."""
    root = np.sqrt(max(a * a - 4.0 * b * c, 0.0))
    return (a - root) / (2.0 * c) if a <= 0.0 else 2.0 * b / (a + root)


@kernel
def clean(row: Array) -> Array:
    """Set what is rounding beside the largest entry to zero: there is no coupling, not a tiny one."""
    most = np.abs(row).max()
    for i in range(len(row)):
        if abs(row[i]) <= 1e-15 * most:
            row[i] = 0.0
    return row
