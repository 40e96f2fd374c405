"""Structures with several contacts."""

from dataclasses import replace

import numpy as np

from fivcore import Beam, Rig, Structure


def drawn(seed, c=None, **given):
    """Modes with 2 to 5 contacts that the load closes, with factors of friction; even seeds: Rayleigh damping."""
    rng = np.random.default_rng(seed)
    c = int(rng.integers(2, 6)) if c is None else c
    n = int(rng.integers(2 * c + 1, 24))
    frequency = np.sort(10.0 ** rng.uniform(1.5, 3.3, n))
    normal, tangential = rng.normal(size=(2, c, n))
    rayleigh = {"d1": rng.uniform(0.0, 20.0), "d2": rng.uniform(0.0, 1e-6)}
    damping = {"damping_ratio": rng.uniform(0.0, 0.05, n)} if seed % 2 else rayleigh
    load, friction = -rng.uniform(0.2, 1.0, c) @ normal, rng.uniform(0.5, 1.5, c)
    return Structure.from_modes(
        frequency, normal, tangential, load=load, **{"friction": friction} | damping | given
    )


def repeated(own, count=2):
    """A structure with several copies of its contact."""
    rows = {name: np.stack([getattr(own, name)] * count) for name in ("normal", "tangential")}
    wider = own.wider and repeated(own.wider, count)
    given = {"struck": rows["normal"], "gap": np.zeros(count), "friction": np.ones(count)}
    return replace(own, **rows, **given, wider=wider)


def free_beam(beam):
    """Stiffness and mass of a free beam: x, y and rotation of each node."""
    n, h = beam.elements, beam.length / beam.elements
    K, M = np.zeros((2, 3 * n + 3, 3 * n + 3))
    stretch, density = beam.axial_stiffness / h * np.array([[1.0, -1.0], [-1.0, 1.0]]), beam.mass / n
    scale = np.outer([1.0, h, 1.0, h], [1.0, h, 1.0, h])
    bend = np.array([[12.0, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]) * scale
    moving = np.array([[156.0, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]) * scale
    for first in range(0, 3 * n, 3):
        along, across = [first, first + 3], [first + 1, first + 2, first + 4, first + 5]
        K[np.ix_(along, along)] += stretch
        M[np.ix_(along, along)] += density / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        K[np.ix_(across, across)] += beam.bending_stiffness / h**3 * bend
        M[np.ix_(across, across)] += density / 420.0 * moving
    return K, M


def two_beams(c, fine=1, **given):
    """Two beams in contact at c nodes along the upper one; the lower one is clamped.

    They have `fine` times 30 and 18 elements.
    """
    low = Beam(0.15, 0.015, 0.003, 185e9, 7900.0, 30 * fine)
    top = Beam(0.09, 0.015, 0.0015, 185e9, 7900.0, 18 * fine)
    (K1, M1), (K2, M2) = free_beam(top), free_beam(low)
    K1[0, 0] += 1e7
    K1[1::3, 1::3] += 1e2 * np.eye(top.elements + 1)
    n = len(K1)
    K, M = np.zeros((2, n + len(K2) - 3, n + len(K2) - 3))
    K[:n, :n], M[:n, :n], K[n:, n:], M[n:, n:] = K1, M1, K2[3:, 3:], M2[3:, 3:]
    nodes = np.unique(np.linspace(0, top.elements, c).round().astype(int)).tolist() if c > 1 else [9 * fine]
    below = [n + 3 * (6 * fine + node) - 3 for node in nodes]
    normal = [{3 * node + 1: 1.0, other + 1: -1.0} for node, other in zip(nodes, below, strict=True)]
    # The surfaces are half a thickness from the axes: rotation moves them along x.
    arms = 0.5 * top.thickness, -0.5 * low.thickness
    tangential = [
        {3 * node: 1.0, 3 * node + 2: arms[0], other: -1.0, other + 2: arms[1]}
        for node, other in zip(nodes, below, strict=True)
    ]
    load = np.zeros(len(K))
    load[1:n:3] = -1.0 / (top.elements + 1)
    rows = (
        {"normal": normal, "tangential": tangential}
        if c > 1
        else {"normal": normal[0], "tangential": tangential[0]}
    )
    return Structure.from_matrices(M, K, **rows, load=load, **{"d1": 50.0, "d2": 1e-8} | given)


def paper_rig():
    return Structure.of(Rig(), 5.0)
