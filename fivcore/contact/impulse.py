"""Compliance defect and drift of modes under a lasting force in impulses.

Once in a step the kept modes take an impulse, the step times the force, and in between they move exactly. At the
impulses, where the contact law is evaluated, a mode's deflection is too small by about step^2 / 12 times its
shape squared: the end correction of the trapezoidal rule for the convolution of force and impulse response, up
to O(step^4). The spring is made softer by the defect of all modes, step^2 / 12 W; C_NN stays and C remains
proportional to K (`ReducedModel.discrete`). The second-order error that remains is step^2 / 12 W (omega C)^2
beside K.

The mean velocity of a damped mode under a lasting force is about damping step^2 / 12 times the shape squared. This
drift is subtracted, or the contact would slip and stick again for some ten steps where stick ends gently.
"""

from __future__ import annotations

import numpy as np

from fivcore.jit import Array

# Below this phase of a mode in a step its series is used, with an error of the eighth power.
SMALL = 1e-2


def at_impulses(stiffness: Array, damping: Array, step: float) -> tuple[Array, Array]:
    """Defect of the deflection, s2, and mean velocity (drift), s, of modes at the impulses of a steady unit force.

    Both (n,) and exact, for modes of unit mass, stiffness in rad2/s2 and damping in 1/s, (n,), and a step in s.
    """
    decay, spring = 0.5 * damping * step, stiffness * step**2
    phase, small = np.sqrt((spring - decay**2).astype(complex)), spring < SMALL**2
    safe = np.where(phase == 0.0, 1e-30, phase)
    left = np.exp(-decay)
    sine = left * (np.sin(safe) / safe).real
    # Determinant of the identity less one step's flow, without cancellation.
    determinant = np.where(small, 1.0, (1.0 - left) ** 2 + 4.0 * left * (np.sin(0.5 * safe) ** 2).real)
    series = (1.0 + (spring - 4.0 * decay**2) / 60.0) / 12.0
    defect = np.where(small, series, 1.0 / np.where(small, 1.0, spring) - sine / determinant)
    series = (1.0 + (spring - 2.0 * decay**2) / 30.0) * decay / 6.0
    drift = np.where(small, series, (-0.5 * np.expm1(-2.0 * decay) - decay * sine) / determinant)
    return step**2 * defect, step * drift


def between_impulses(stiffness: Array, step: float) -> Array:
    """Excess deflection of modes midway between two impulses of a steady unit force, s2."""
    z = 0.5 * step * np.sqrt(stiffness)
    small = z < 1e-3
    safe = np.where(small, 1.0, z)
    # h / (2 omega sin(omega h / 2)) - 1 / omega^2 = h^2 / 4 (1 / (z sin z) - 1 / z^2), z = omega h / 2.
    excess = np.where(small, 1.0 / 6.0, 1.0 / (safe * np.sin(safe)) - 1.0 / safe**2)
    return np.asarray(0.25 * step**2 * excess)
