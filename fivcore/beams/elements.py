"""Euler-Bernoulli beam elements with consistent mass, assembled to cantilevers in the beam's own frame.

Node 0 is clamped; the s axis runs from it along the beam. Axial and bending motion do not couple in this frame, so
they are assembled as two families with the degrees of freedom u (axial displacement), or w and phi = dw/ds
(deflection and rotation), node after node. u is linear in an element and w cubic (Hermite): the frequencies have
errors of O(h^2) and O(h^4).

The flexibility's root R, K^-1 = R R^T, has a closed form: the deformation of every element between a node and the
clamp moves the node like a rigid body. Inverting K would lose digits in proportion to the fourth power of the
number of elements; R loses none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fivcore.jit import Array
from fivcore.rig import Beam


@dataclass(frozen=True, eq=False)
class Family:
    """Matrices of one family (axial or bending) of a beam clamped at node 0, SI.

    Attributes
    ----------
    stiffness, mass : ndarray, (n, n)
        Of the free nodes 1 to N.
    flexibility_root : ndarray, (n, n)
        R with R R^T = stiffness^-1.
    carried : ndarray, (n,)
        Base excitation, kg: the mass matrix times a unit translation of the whole beam.
    """

    stiffness: Array
    mass: Array
    flexibility_root: Array
    carried: Array


def axial(beam: Beam) -> Family:
    """Axial family of a beam."""
    h = beam.length / beam.elements
    k = beam.axial_stiffness / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
    m = beam.mass / beam.elements / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    stiffness, mass = _assemble(k, beam.elements, 1), _assemble(m, beam.elements, 1)
    # A node moves by the sum of the elongations between it and the clamp.
    root = np.sqrt(h / beam.axial_stiffness) * np.tri(beam.elements)
    return Family(stiffness[1:, 1:], mass[1:, 1:], root, mass[1:].sum(axis=1))


def bending(beam: Beam) -> Family:
    """Bending family of a beam."""
    n = beam.elements
    h = beam.length / n
    rows = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    scale = np.array([1.0, h, 1.0, h])
    k = beam.bending_stiffness / h**3 * np.array(rows, dtype=float) * np.outer(scale, scale)
    rows = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    m = beam.mass / n / 420.0 * np.array(rows, dtype=float) * np.outer(scale, scale)
    stiffness, mass = _assemble(k, n, 2), _assemble(m, n, 2)
    # Cholesky factor of the flexibility of one clamped element at its tip, [[h3/3, h2/2], [h2/2, h]] / EI.
    soft = 1.0 / np.sqrt(beam.bending_stiffness)
    deflection, coupled, turning = h * np.sqrt(h / 3.0), np.sqrt(0.75 * h), np.sqrt(h / 4.0)
    before = np.tri(n)
    lever = h * np.maximum(np.subtract.outer(np.arange(n), np.arange(n)), 0)
    root = np.zeros((2 * n, 2 * n))
    root[0::2, 0::2] = soft * (before * deflection + lever * coupled)
    root[0::2, 1::2] = soft * lever * turning
    root[1::2, 0::2] = soft * before * coupled
    root[1::2, 1::2] = soft * before * turning
    return Family(stiffness[2:, 2:], mass[2:, 2:], root, mass[2:, 0::2].sum(axis=1))


def hermite(beam: Beam, position: float) -> tuple[Array, Array]:
    """Rows that read u and w at `position` (m from node 0) from the free nodes' degrees of freedom.

    Returns
    -------
    axial_row : ndarray, (N,)
        Linear interpolation of u.
    bending_row : ndarray, (2 N,)
        Cubic Hermite interpolation of w.
    """
    h = beam.length / beam.elements
    # A point that rounding puts a hair beside a node belongs to the node.
    place = position / h
    if abs(place - round(place)) < 1e-9:
        place = float(round(place))
    element = min(int(place), beam.elements - 1)
    x = place - element
    axial_row = np.zeros(beam.elements + 1)
    axial_row[element : element + 2] = 1.0 - x, x
    bending_row = np.zeros(2 * beam.elements + 2)
    bending_row[2 * element : 2 * element + 4] = (
        (1.0 + 2.0 * x) * (1.0 - x) ** 2,
        h * x * (1.0 - x) ** 2,
        x * x * (3.0 - 2.0 * x),
        -h * x * x * (1.0 - x),
    )
    return axial_row[1:], bending_row[2:]


def _assemble(element: Array, elements: int, per_node: int) -> Array:
    size = per_node * (elements + 1)
    matrix = np.zeros((size, size))
    for e in range(elements):
        span = slice(per_node * e, per_node * (e + 2))
        matrix[span, span] += element
    return matrix
