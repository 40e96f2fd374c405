"""Scenes of rigs drawn at random, which test whether a setting suits other rigs than the paper's."""

from __future__ import annotations

import numpy as np

from fivcore import Beam, Rig, Scene, sliding_modes

# Young's modulus and density of carbon steel, stainless steel, cast iron, brass, titanium and aluminium.
MATERIALS = ((185e9, 7900.0), (200e9, 7950.0), (110e9, 7200.0), (105e9, 8500.0), (114e9, 4430.0), (70e9, 2700.0))


def drawn_scene(seed: int, number: int) -> Scene:
    """The first scene that vibrates of a random sequence of rigs like the paper's.

    P1 is 40 to 70 mm long and 1.5 to 4 mm thick, P2 120 to 250 mm long; the contact lies at 35 to 80 % of P2.
    Elements are as long as the paper's; those of a thicker P1 are longer, so that the published scheme is stable
    with its step.
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
