"""Other rigs than the paper's: rigs within workshop tolerances, strategies, and scenes that vibrate."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from fivcore import Beam, Rig


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
