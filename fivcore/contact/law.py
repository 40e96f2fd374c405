"""The law of the reduced contact: a spring and a dashpot in parallel for the modes that are not kept.

They have a state u = (u_N, u_T) and carry the contact force, K u + C u' = (N, T), C = tau K. The physical gap is
g_N + u_N, the slip rate g_T' + u_T'. Every contact status is linear:

- separation: N = T = 0, while g_N + u_N > 0; u decays as exp(-t / tau);
- stick: u_N = -g_N and g_T + u_T is constant, while N > 0 and |T| <= mu N;
- slip: u_N = -g_N and T = s mu N with s = -sign of the slip rate; u_T follows its own first-order equation.

At touch-down u is continuous and N jumps by C_NN times the closing speed. With S = K^-1, exactly one of stick,
slip forwards and slip backwards is possible if S_NN > mu |S_NT|: T - mu N and T + mu N then increase with u_T'.
The Painleve limit is the least mu at which this fails, or at which the divisor that gives N in a step of `fast`
is zero (`DiscreteContact.painleve_mu`); above it the force is not unique. In rigid contact an impact leaves no
closing speed, and its tangential impulse is within the cone.

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

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fivcore.errors import SceneValueError
from fivcore.jit import Array, ReadOnlyArrays

# Below this phase of a mode in a step its series is used, with an error of the eighth power.
SMALL = 1e-2
# Least square of the sine between the directions of rigid contact, in which rounding is 1e-15.
LEAST_SINE = 1e-12


class SlipMap(NamedTuple):
    """Slip over a step with any coefficient of friction m: T = m N.

    N = alpha / (beta - m gamma), alpha = by_p p + by_v v_N; p = -g_N is the penetration, v are the rates of the
    gaps before the impulse. The mean slip rate is v_T - relaxing u_T + rate_N N + rate_T T, and u_T becomes
    decay u_T + end_N N + end_T T. In rigid contact alpha is -v_N, and u_T stays zero.
    """

    # alpha, m (m/s if rigid), for a unit of p (1) and of v_N (-tau, s).
    by_p: float
    by_v: float
    # m/N (m/s per N if rigid).
    beta: float
    gamma: float
    # (1 - decay) / step, 1/s.
    relaxing: float
    # m/s per N.
    rate_N: float
    rate_T: float
    # exp(-step / tau), of u in separation, too.
    decay: float
    # m/N.
    end_N: float
    end_T: float

    @property
    def mobility(self) -> float:
        """Change of the slip rate for a unit of T, m/s per N."""
        return self.rate_T + self.rate_N * self.gamma / self.beta

    def steepest_fall(self, mu: float) -> float:
        """Largest -d mu / dv, s/m, up to which slip is unique in a step with N = 1."""
        # In either direction of slip.
        return (1.0 - mu * abs(self.gamma) / self.beta) / self.mobility

    def forces(self, m: float, fall: float = 0.0) -> Array:
        """N, T and u_T at the end from (p, u_T, v_N, v_T), (3, 4), for T = m N + fall times the slip rate."""
        alpha = np.array([self.by_p, 0.0, self.by_v, 0.0])
        free = np.array([0.0, -self.relaxing, 0.0, 1.0]) + self.rate_N / self.beta * alpha
        T = (m / self.beta * alpha + fall * free) / (1.0 - fall * self.mobility - m * self.gamma / self.beta)
        N = (alpha + self.gamma * T) / self.beta
        return np.stack([N, T, np.array([0.0, self.decay, 0.0, 0.0]) + self.end_N * N + self.end_T * T])


@dataclass(frozen=True, eq=False)
class DiscreteContact(ReadOnlyArrays):
    """The contact in a step of `transient.fast.kernel`, for any friction; matrices are (2, 2), normal first.

    Positions are held over the impulse, and velocities enter by their mean, which makes the dashpot implicit in
    closed form; u_T in slip and u in separation relax exactly.
    """

    # S of the element with `defect`, m/N (zero: a rigid contact), and its relaxation time, s (0: purely elastic).
    flexibility: Array
    tau: float
    # Mean rates of the gaps over an impulse by a unit force, m/s per N.
    delassus: Array
    # s.
    step: float
    # Compliance that the modes lack in impulses, m/N (`at_impulses`).
    defect: Array = field(default_factory=lambda: np.zeros((2, 2)))

    @cached_property
    def stiffness(self) -> Array:
        """Spring of the element, N/m; zero if rigid."""
        return np.asarray(np.linalg.inv(self.flexibility)) if self.flexibility.any() else self.flexibility

    @cached_property
    def slip(self) -> SlipMap:
        """Slip with any coefficient of friction."""
        (M_NN, M_NT), (_, M_TT) = self.delassus.tolist()
        (S_NN, S_NT), (_, S_TT) = self.flexibility.tolist()
        if not S_NN:
            return SlipMap(0.0, -1.0, M_NN, -M_NT, 0.0, M_NT, M_TT, 0.0, 0.0, 0.0)
        tau, gone = self.tau, -float(np.expm1(-self.step / self.tau)) if self.tau > 0.0 else 1.0
        rate, beta, gamma = gone / self.step, S_NN + tau * M_NN, -(S_NT + tau * M_NT)
        rates = rate, M_NT + rate * S_NT, M_TT + rate * S_TT
        return SlipMap(1.0, -tau, beta, gamma, *rates, 1.0 - gone, gone * S_NT, gone * S_TT)

    @property
    def painleve_mu(self) -> float:
        """Least coefficient of friction at which the force of a step is not unique."""
        return min(ratio(*self.flexibility[0]), ratio(self.slip.beta, self.slip.gamma))

    def stick(self, late: float = 0.0) -> Array:
        """(N, T) of stick from (p, u_T, v_N, v_T), (2, 4); u_T follows g_T from `late`, s, after the start on."""
        if not self.flexibility.any():
            return np.hstack([np.zeros((2, 2)), -resistance(self.delassus)])
        times = np.diag([self.tau, self.tau + late])
        return np.linalg.solve(self.flexibility + times @ self.delassus, np.hstack([np.eye(2), -times]))

    @property
    def mean_time(self) -> float:
        """Time from the start of a step to the mean of a relaxing u_T, s; 0 if rigid.

        With it in `stick` a step has one solution where slip ends.
        """
        if not self.tau:
            return self.step if self.flexibility.any() else 0.0
        decay = self.step / self.tau
        return self.step * float(0.5 + decay / 12.0 if decay < 1e-4 else -1.0 / decay - 1.0 / np.expm1(-decay))

    @property
    def square_ratio(self) -> float:
        """Mean square of the rate of a relaxing u_T over a step, in units of its mean squared."""
        half = 0.5 * self.step / self.tau if self.tau else 0.0
        return float(half / np.tanh(half)) if half > 1e-6 else 1.0


def resistance(W: Array) -> Array:
    """Inverse of the Delassus matrix (2, 2) of a rigid contact."""
    if np.linalg.det(W) <= LEAST_SINE * W[0, 0] * W[1, 1]:
        raise SceneValueError(
            "normal, tangential: they are parallel over the modes that are kept, so the force of a rigid contact"
            " is not unique; give more modes, or the compliance of the others (`Structure.from_matrices`)"
        )
    return np.asarray(np.linalg.inv(W))


def ratio(direct: float, cross: float) -> float:
    """Friction at which the cross term equals the direct one."""
    return float(abs(direct / cross)) if cross else float("inf")


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
