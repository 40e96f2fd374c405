"""What a lasting force looks like when it comes in kicks, and what the contact's law must make up for.

Once in a step the kept modes are kicked by step times the force; between kicks they move exactly. Their answer to
a lasting force is a sawtooth, and at the kicks, where the contact looks, it is not the deflection of the force:
it is less by about step^2 / 12 times the mode's shape squared, the end correction of the trapezoidal rule for
the convolution of force and impulse response. This holds at any frequency of the force, up to the fourth power
of the step. All modes together seem to lack the flexibility step^2 / 12 W, and the element, which stands for
flexibility anyway, is made softer by just as much. Its relaxation stays one in both directions, and of the dashpot
that along the normal is what it was. What is left of second order comes from it: step^2 / 12 W (omega C)^2 where
the stiffness is K.

A damped mode also seems to drift under a lasting force, for its velocity decays between two kicks: the mean of
what it is before and after a kick is not zero, but about damping step^2 / 12 times the shape squared. Were this
not taken off, stick would slip and stick again for some ten steps where it ends gently, and what grows there
would start from that noise.

Both are taken for a steady force, exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fivcore.jit import Array

# Below this phase of a mode in a step its series is used: what is left out is the eighth power.
SMALL = 1e-2


class Kicks(NamedTuple):
    """How kicks go together with what they act on; (2, 2), normal first.

    Attributes
    ----------
    missed : ndarray
        Flexibility that the modes seem to lack, m/N; zero without an element.
    stiffness : ndarray
        Of the element, N/m, made softer by `missed`; zero without an element.
    damping : ndarray
        Of the element, N s/m.
    mobility : ndarray
        By how much a force raises the mean rates of the gaps over its kick, m/s per N.
    """

    missed: Array
    stiffness: Array
    damping: Array
    mobility: Array


def kicks(stiffness: Array, damping: Array, shapes: Array, K: Array, C: Array, step: float) -> Kicks:
    """Find them for modes with gap shapes (2, n) and an element of stiffness K and damping C, in proportion."""
    half = 0.5 * step * shapes @ shapes.T
    if not K.any() or step == 0.0:
        return Kicks(np.zeros((2, 2)), K, C, half)
    missed, drift = ((shapes * each) @ shapes.T for each in at_kicks(stiffness, damping, step))
    softer = np.asarray(np.linalg.inv(np.linalg.inv(K) + missed))
    return Kicks(missed, softer, C[0, 0] / softer[0, 0] * softer, half - drift)


def at_kicks(stiffness: Array, damping: Array, step: float) -> tuple[Array, Array]:
    """What a steady unit force seems to lack in deflection, and by how much it seems to drift, at its kicks.

    Parameters
    ----------
    stiffness, damping : ndarray, (n,)
        Of modes with unit mass, as in `fivcore.beams.free_motion.propagator`.
    step : float
        s.

    Returns
    -------
    missed, drift : ndarray, (n,)
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
    missed = np.where(
        small, (1.0 + (stiffness * step**2 - 4.0 * decay**2) / 60.0) / 12.0, 1.0 / spring - sine / nearness
    )
    turned = (1.0 + (stiffness * step**2 - 2.0 * decay**2) / 30.0) * decay / 6.0
    drift = np.where(small, turned, (-0.5 * np.expm1(-2.0 * decay) - decay * sine) / nearness)
    return step**2 * missed, step * drift


def between_kicks(stiffness: Array, step: float) -> Array:
    """How much further a steady unit force in kicks deflects modes, midway between two of them, s2."""
    z = 0.5 * step * np.sqrt(stiffness)
    small = z < 1e-3
    safe = np.where(small, 1.0, z)
    # h / (2 omega sin(omega h / 2)) - 1 / omega^2 = h^2 / 4 (1 / (z sin z) - 1 / z^2), z = omega h / 2.
    excess = np.where(small, 1.0 / 6.0, 1.0 / (safe * np.sin(safe)) - 1.0 / safe**2)
    return np.asarray(0.25 * step**2 * excess)
