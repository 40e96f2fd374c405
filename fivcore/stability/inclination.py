"""How steady sliding depends on the inclination, in closed form.

P1's modes change with theta, but only because its support is free along y: held at A, it has the same modes at
any inclination. Written in those, theta enters through sine and cosine alone, so that eigenvalues and onsets
can be followed over theta, derivatives included, without a modal analysis at every angle.

Of P1 held at A let phi be a mode's shape at the tip, gamma what a motion of A throws on it, and

    H = sum phi^2 / (p - lambda),   G = sum phi gamma / (p - lambda),   S = sum gamma^2 / (p - lambda)

over its axial (a) and its bending modes (b). With m the mass of P1 and its head, h the receptance of P2 normal to
it, and c and s the cosine and sine of theta,

    E = 1 + lambda (c^2 G_a + s^2 G_b),        D = m + lambda (c^2 S_a + s^2 S_b),
    h_NN = h + c^2 H_a + s^2 H_b - E^2 / (lambda D),
    h_NT = s c [H_a - H_b - (G_a - G_b) E / D],

and lambda is an eigenvalue where h_NN + mu h_NT = 0. D vanishes at the modes of P1 free along y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fivcore.beams.modes import cantilever_modes, families, lower_basis
from fivcore.jit import Array
from fivcore.rig import Rig

# Damping in place of less on the imaginary axis, as a share of the band: an imaginary step, by which the imaginary
# part of a function becomes its derivative, with an error of the order of the square.
UNDAMPED = 1e-9


@dataclass(frozen=True, eq=False)
class Receptance:
    """The gap's receptance at one eigenvalue and angle, and its derivatives.

    Attributes
    ----------
    normal, coupling : complex
        h_NN and h_NT / sin(2 theta).
    normal_rate, coupling_rate : complex
        Their derivatives with respect to lambda.
    normal_turn, coupling_turn : complex
        Their derivatives with respect to theta, 1/rad.
    sine, cosine : float
        Of 2 theta.
    free : complex
        A function that takes P1's poles away if both are multiplied by it.
    free_rate, free_turn : complex
        Derivatives of its logarithm.
    """

    normal: complex
    coupling: complex
    normal_rate: complex
    coupling_rate: complex
    normal_turn: complex
    coupling_turn: complex
    sine: float
    cosine: float
    free: complex
    free_rate: complex
    free_turn: complex

    def loaded(self, mu: complex) -> tuple[complex, complex, complex]:
        """Sum of h_NN and mu h_NT, and its derivatives with respect to lambda and theta."""
        weight = mu * self.sine
        return (
            self.normal + weight * self.coupling,
            self.normal_rate + weight * self.coupling_rate,
            self.normal_turn + weight * self.coupling_turn + 2.0 * mu * self.cosine * self.coupling,
        )


@dataclass(frozen=True, eq=False)
class Inclination:
    """One rig and band at any inclination; frequencies are in units of the band.

    Attributes
    ----------
    poles : ndarray, (n,)
        lambda of the beams' modes, P1 held at A.
    weights : ndarray, (6, n)
        Residues of H, G and S: of each the mean of axial and bending (P2's receptance in the first), and half
        the difference.
    held : int
        How many of them are P1's; they come first.
    mass : float
        Of P1 and its head, kg.
    d1, d2 : float
        Damping.
    """

    poles: Array
    weights: Array
    held: int
    mass: float
    d1: float
    d2: float

    def receptance(self, value: complex, theta: float) -> Receptance:
        """At lambda = `value` and theta in radians."""
        inverse = 1.0 / (self.poles - value)
        # Not a matrix product: BLAS would round differently with the number of its threads.
        hm, hd, gm, gd, sm, sd = np.einsum("kn,n->k", self.weights, inverse)
        hm1, hd1, gm1, gd1, sm1, sd1 = np.einsum("kn,n->k", self.weights, inverse * inverse)
        cosine, sine = math.cos(2.0 * theta), math.sin(2.0 * theta)
        g, g1, s, s1 = gm + cosine * gd, gm1 + cosine * gd1, sm + cosine * sd, sm1 + cosine * sd1
        e, d = 1.0 + value * g, self.mass + value * s
        e1, d1 = g + value * g1, s + value * s1
        q = e / d
        q1 = (e1 - q * d1) / d
        # Multiplied by D alone they would gain the poles of P1 held at A.
        near = inverse[np.argmax(np.abs(inverse[: self.held]))]
        return Receptance(
            hm + cosine * hd - q * e / value,
            hd - q * gd,
            hm1 + cosine * hd1 - (q1 * e + q * e1 - q * e / value) / value,
            hd1 - q1 * gd - q * gd1,
            -2.0 * sine * (hd - 2.0 * q * gd + q * q * sd),
            2.0 * sine * value * gd * (gd - q * sd) / d,
            sine,
            cosine,
            d / near,
            d1 / d - near,
            -2.0 * sine * value * sd / d,
        )

    def on_axis(self, omega: float) -> tuple[complex, complex]:
        """The eigenvalue lambda of phi = i omega, and its derivative with respect to omega."""
        d1 = self.d1 if max(self.d1, self.d2) > UNDAMPED else UNDAMPED
        below = 1.0 + 1j * self.d2 * omega
        value = (omega * omega - 1j * d1 * omega) / below
        return value, (2.0 * omega - 1j * d1 - 1j * self.d2 * value) / below


@lru_cache(maxsize=16)
def inclination(rig: Rig, fmax: float) -> Inclination:
    """The rig in units of the band; what exists already is not built again."""
    unit = 2.0 * np.pi * fmax
    lower = lower_basis(rig.p2, rig.contact_position)
    felt = lower.normal != 0.0
    (pa, along_modes), (pb, across_modes) = cantilever_modes(rig.p1)
    along, across = families(rig.p1)
    # At the tip the last axial displacement and the last deflection; at A what the family throws on it.
    ta, ga = along_modes[-1], np.einsum("i,in->n", along.carried, along_modes)
    tb, gb = across_modes[-2], np.einsum("i,in->n", across.carried, across_modes)
    poles = np.concatenate([pa, pb, lower.stiffness[felt]]) / unit**2
    weights = np.zeros((6, len(poles)))
    na, n = len(pa), len(pa) + len(pb)
    for k, (axial, bending) in enumerate([(ta * ta, tb * tb), (ta * ga, tb * gb), (ga * ga, gb * gb)]):
        weights[2 * k : 2 * k + 2, :na] = 0.5 * axial
        weights[2 * k, na:n], weights[2 * k + 1, na:n] = 0.5 * bending, -0.5 * bending
    weights[0, n:] = lower.normal[felt] ** 2
    d1, d2 = rig.d1 / unit, rig.d2 * unit
    return Inclination(poles, weights, n, rig.p1.mass + rig.head_mass, d1, d2)
