"""Euler-Bernoulli beam elements with consistent mass, assembled to cantilevers in the beam's own frame.

Node 0 is clamped; the s axis runs from it along the beam. Axial and bending motion do not couple: two families
with the degrees of freedom u (axial displacement), or w and phi = dw/ds (deflection and rotation), by nodes. u is
linear in an element and w cubic (Hermite): the frequencies have errors of O(h^2) and O(h^4).

The flexibility's root R, K^-1 = R R^T, has a closed form: the deformation of every element between a node and the
clamp moves the node like a rigid body. Inverting K loses digits as the fourth power of the number of elements.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from fivcore.jit import Array
from fivcore.rig import Beam


class Family(NamedTuple):
    """Matrices (n, n) of one family, axial or bending, of a beam clamped at node 0; free nodes 1 to N, SI."""

    stiffness: Array
    mass: Array
    # R with R R^T = stiffness^-1.
    flexibility_root: Array
    # Base excitation, (n,), kg: the mass matrix times a unit translation of the whole beam.
    base_inertia: Array


@lru_cache(maxsize=16)
def axial(beam: Beam) -> Family:
    """Axial family of a beam."""
    h = beam.length / beam.elements
    k = beam.axial_stiffness / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
    m = beam.mass / beam.elements / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    # A node moves by the sum of the elongations between it and the clamp.
    return _assembled(k, m, np.sqrt(h / beam.axial_stiffness) * np.tri(beam.elements))


@lru_cache(maxsize=16)
def bending(beam: Beam) -> Family:
    """Bending family of a beam."""
    n = beam.elements
    h = beam.length / n
    scale = np.outer([1.0, h, 1.0, h], [1.0, h, 1.0, h])
    k = np.array([[12.0, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    m = np.array([[156.0, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    # Cholesky factor of the flexibility of one clamped element at its tip, [[h3/3, h2/2], [h2/2, h]] / EI.
    deflection, coupled, turning = h * np.sqrt(h / 3.0), np.sqrt(0.75 * h), np.sqrt(h / 4.0)
    lever = h * np.maximum(np.subtract.outer(np.arange(n), np.arange(n)), 0)
    soft = 1.0 / np.sqrt(beam.bending_stiffness)
    root = np.kron(np.tri(n), [[deflection, 0], [coupled, turning]]) + np.kron(lever, [[coupled, 0], [0, 0]])
    root = soft * root + np.kron(soft * lever, [[0, turning], [0, 0]])
    return _assembled(beam.bending_stiffness / h**3 * k * scale, beam.mass / n / 420.0 * m * scale, root)


def hermite(beam: Beam, position: float) -> tuple[Array, Array]:
    """Rows (N,) and (2 N,) that interpolate u (linear) and w (cubic) of the nodes at `position`, m from node 0."""
    n, h = beam.elements, beam.length / beam.elements
    # A point within rounding of a node belongs to the node.
    place = round(position / h) if abs(position / h - round(position / h)) < 1e-9 else position / h
    e = min(int(place), n - 1)
    x, y, axial_row, bending_row = place - e, 1.0 - (place - e), np.zeros(n + 1), np.zeros(2 * n + 2)
    axial_row[e : e + 2] = y, x
    bending_row[2 * e : 2 * e + 4] = (1.0 + 2.0 * x) * y**2, h * x * y**2, x**2 * (1.0 + 2.0 * y), -h * x**2 * y
    return axial_row[1:], bending_row[2:]


def _assembled(k: Array, m: Array, root: Array) -> Family:
    """Assemble element matrices and leave out the clamped node, whose translation is the base excitation."""
    free = len(k) // 2
    size = len(root) + free
    stiffness, mass = np.zeros((2, size, size))
    for start in range(0, len(root), free):
        span = slice(start, start + len(k))
        stiffness[span, span] += k
        mass[span, span] += m
    return Family(stiffness[free:, free:], mass[free:, free:], root, mass[free:, ::free].sum(axis=1))
