"""Modes at the contact of rigs with the same mesh and any parameters, without solving eigenproblems.

Cantilevers with the same number of elements are similar: a mode's squared frequency goes with E / (rho L^2) if it
is axial and with E t^2 / (rho L^4) if it bends, its mass-normalised displacement with m^-1/2. Masses here are in
units of the beam's.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fivcore.beams.elements import axial, bending
from fivcore.beams.modes import cantilever_modes, one_blas_thread, supported_modes
from fivcore.jit import Array, kernel
from fivcore.rig import Beam


@lru_cache(maxsize=16)
@one_blas_thread()
def unit_cantilever(elements: int) -> tuple[Array, Array, Array]:
    """Modes of the cantilever whose length, width, thickness, modulus and density are 1.

    Squared frequency, participation factor and displacement of the free end, (3, n), axial modes first; deflection
    and rotation of all nodes in bending, (2 nodes, modes); what the squared participation factors, axial and
    bending, leave of the mass, (2,).
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
    # A point within rounding of a node belongs to the node.
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
    own = modes[0] * np.where(np.arange(n) < n // 3, along, across)
    order, sine, cosine = np.argsort(own), np.sin(np.radians(theta)), np.cos(np.radians(theta))
    # The beam's own axes, from A down to C and across it, in terms of x and y.
    along_x = np.where(order < n // 3, -sine, cosine)
    along_y = np.where(order < n // 3, -cosine, -sine)
    x, y = along_x * modes[2][order], along_y * modes[2][order]
    support = head_mass + cosine * cosine * rest[0] + sine * sine * rest[1]
    values, moved, shapes = supported_modes(own[order], along_y * modes[1][order], support)
    result = np.zeros((3, n + 1))
    result[0, 1:], result[1, 0] = values, np.sqrt(1.0 / (1.0 + head_mass))
    for k in range(n):
        normal, tangential = moved[k], 0.0
        for i in range(n):
            normal += y[i] * shapes[k, i]
            tangential += x[i] * shapes[k, i]
        result[1, k + 1], result[2, k + 1] = normal, tangential
    return result
