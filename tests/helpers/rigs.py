"""Rigs that are not the paper's: what a workshop might build, strategies, and scenes that vibrate."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from fivcore import Beam, Rig, Scene, sliding_modes


def workshop_rig(seed: int, damping: bool = True) -> Rig:
    """Beams of other sizes, materials and meshes, a contact anywhere on the outer nine tenths of P2."""
    rng = np.random.default_rng(seed)

    def beam(low: float, high: float, most: int) -> Beam:
        length = 10 ** rng.uniform(low, high)
        slender = 10 ** rng.uniform(-2.0, -0.9)
        young, density = 10 ** rng.uniform(9.5, 11.5), 10 ** rng.uniform(3.2, 4.0)
        return Beam(length, 0.01, length * slender, young, density, int(rng.integers(4, most)))

    p1, p2 = beam(-2.0, -0.5, 25), beam(-1.5, 0.0, 40)
    position, head = rng.uniform(0.1, 1.0) * p2.length, 10 ** rng.uniform(-3.0, 1.5)
    d1, d2 = rng.choice([10.0, 50.0]), rng.choice([1e-9, 1e-8])
    return Rig(p1, p2, position, head, d1 if damping else 0.0, d2 if damping else 0.0)


angles = st.floats(-75.0, 75.0)
frictions = st.floats(0.0, 2.0)
rigs = st.builds(workshop_rig, st.integers(0, 10_000), st.booleans())

# Young's modulus and density: two steels, cast iron, brass, titanium and aluminium.
MATERIALS = ((185e9, 7900.0), (200e9, 7950.0), (110e9, 7200.0), (105e9, 8500.0), (114e9, 4430.0), (70e9, 2700.0))


def drawn_scene(seed: int, number: int) -> Scene:
    """The first unstable scene of a sequence on rigs like the paper's (those of `fiv run accuracy`).

    P1 is 40 to 70 mm long and 1.5 to 4 mm thick, P2 120 to 250 mm long; the contact lies at 35 to 80 % of P2.
    """
    rng = np.random.default_rng([seed, number])
    while True:
        upper, lower = (MATERIALS[k] for k in rng.integers(0, len(MATERIALS), 2))
        length, thickness, below = rng.uniform([0.040, 0.0015, 0.120], [0.070, 0.004, 0.250])
        p1 = Beam(length, 0.010, thickness, *upper, int(length / (np.sqrt(thickness / 0.0015) / 600.0)))
        p2 = Beam(below, 0.015, 0.003, *lower, round(600.0 * below))
        share, head, theta, mu = rng.uniform([0.35, 1.0, 2.0, 0.15], [0.80, 6.0, 14.0, 0.45])
        rig = Rig(p1, p2, share * below, head)
        speed, load = rng.uniform([1e-3, 5.0], [5e-3, 15.0])
        if sliding_modes(rig, theta, mu).growth_rate.max() > 0.0:
            return Scene(speed, theta, mu, load, rig)
