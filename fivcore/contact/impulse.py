"""What a lasting force looks like when it comes in impulses, and what the contact's element makes up for.

Once in a step the kept modes take an impulse, the step times the force; between impulses they move exactly. Their
answer to a lasting force is a sawtooth. At the impulses, where the contact looks, it is less than the deflection
of the force by about step^2 / 12 times the mode's shape squared: the end correction of the trapezoidal rule for
the convolution of force and impulse response. This holds at any frequency of the force, up to the fourth power of
the step. All modes together have the compliance defect step^2 / 12 W, and the element, which stands for compliance
anyway, is made softer by just as much. Its relaxation stays one in both directions, and of the dashpot that along
the normal is what it was. What is left of second order comes from it: step^2 / 12 W (omega C)^2 where the
stiffness is K.

A damped mode also drifts under a lasting force, for its velocity decays between two impulses: the mean of what it
is before and after an impulse is not zero, but about damping step^2 / 12 times the shape squared. Were this not
taken off, stick would slip and stick again for some ten steps where it ends gently, and what grows there would
start from that noise.

Both are taken for a steady force, exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fivcore.jit import Array

# Below this phase of a mode in a step its series is used: what is left out is the eighth power.
SMALL = 1e-2


class Impulse(NamedTuple):
    """How impulses go together with what they act on; (2, 2), normal first.

    Attributes
    ----------
    defect : ndarray
        Compliance that the modes seem to lack, m/N; zero without an element.
    stiffness : ndarray
        Of the element, N/m, corrected by `defect`; zero without an element.
    damping : ndarray
        Of the element, N s/m.
    mobility : ndarray
        By how much a force raises the mean rates of the gaps over its impulse, m/s per N.
    """

    defect: Array
    stiffness: Array
    damping: Array
    mobility: Array


def corrected(stiffness: Array, damping: Array, shapes: Array, K: Array, C: Array, step: float) -> Impulse:
    """The correction for modes with gap shapes (2, n) and an element, K and C in proportion."""
    half = 0.5 * step * shapes @ shapes.T
    if not K.any() or step == 0.0:
        return Impulse(np.zeros((2, 2)), K, C, half)
    defect, drift = ((shapes * each) @ shapes.T for each in at_impulses(stiffness, damping, step))
    softened = np.asarray(np.linalg.inv(np.linalg.inv(K) + defect))
    return Impulse(defect, softened, C[0, 0] / softened[0, 0] * softened, half - drift)


def at_impulses(stiffness: Array, damping: Array, step: float) -> tuple[Array, Array]:
    """Defect in deflection, and drift, that a steady unit force seems to have at its impulses.

    Parameters
    ----------
    stiffness, damping : ndarray, (n,)
        Of modes with unit mass, as in `fivcore.beams.free_motion.propagator`.
    step : float
        s.

    Returns
    -------
    defect, drift : ndarray, (n,)
        s2, and s.
    """
    decay = 0.5 * damping * step
    # Of a free mode only the series is left.
    phase = np.sqrt((stiffness * step**2 - decay**2).astype(complex))
    small = stiffness * step**2 < SMALL**2
    safe = np.where(np.abs(phase) < 1e-6, 1e-6, phase)
    left = np.exp(-decay)
    sine = left * (np.sin(safe) / safe).real
    # One step's flow less the identity, its determinant, without cancellation.
    nearness = (1.0 - left) ** 2 + 4.0 * left * (np.sin(0.5 * safe) ** 2).real
    spring = np.where(small, 1.0, stiffness * step**2)
    nearness = np.where(small, 1.0, nearness)
    defect = np.where(
        small, (1.0 + (stiffness * step**2 - 4.0 * decay**2) / 60.0) / 12.0, 1.0 / spring - sine / nearness
    )
    turned = (1.0 + (stiffness * step**2 - 2.0 * decay**2) / 30.0) * decay / 6.0
    drift = np.where(small, turned, (-0.5 * np.expm1(-2.0 * decay) - decay * sine) / nearness)
    return step**2 * defect, step * drift


def between_impulses(stiffness: Array, step: float) -> Array:
    """How much further a steady unit force in impulses deflects modes, midway between two of them, s2."""
    z = 0.5 * step * np.sqrt(stiffness)
    small = z < 1e-3
    safe = np.where(small, 1.0, z)
    # h / (2 omega sin(omega h / 2)) - 1 / omega^2 = h^2 / 4 (1 / (z sin z) - 1 / z^2), z = omega h / 2.
    excess = np.where(small, 1.0 / 6.0, 1.0 / (safe * np.sin(safe)) - 1.0 / safe**2)
    return np.asarray(0.25 * step**2 * excess)
