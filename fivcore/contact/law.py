"""Contact law of the reduced model: a spring and a dashpot in parallel replace the truncated modes.

The deformation u = (u_N, u_T) of this element carries the contact force, K u + C u' = (N, T) with C = tau K. The
physical gap is g_N + u_N and the slip rate is g_T' + u_T'. The law is linear in each contact status:

- separation: N = T = 0, while g_N + u_N > 0; u decays as exp(-t / tau);
- stick: u_N = -g_N and g_T + u_T is constant, while N > 0 and |T| <= mu N;
- slip: u_N = -g_N and T = s mu N with s = -sign of the slip rate; u_T follows its own first-order equation.

At touch-down u is continuous and N jumps by C_NN times the closing speed. With S = K^-1, exactly one of stick,
forward slip and backward slip is possible if S_NN > mu |S_NT|, because T - mu N and T + mu N then increase with
u_T'. The Painleve limit is the smallest mu at which this condition fails, or at which the divisor that yields N in
a step of `fast` vanishes (`DiscreteContact.painleve_mu`); above it the contact force is not unique. In rigid
contact an impact leaves no closing speed, and its tangential impulse lies within the friction cone.

In each step the kept modes receive one impulse, the step times the force, and move exactly between impulses. The
contact law is evaluated at the impulses, where the deflection of a mode is too small by about step^2 / 12 times
its shape squared: the end correction of the trapezoidal rule for the convolution of force and impulse response,
up to O(step^4). The spring is therefore softened by the defect of all modes, step^2 / 12 W; C_NN is unchanged and
C remains proportional to K (`ReducedModel.discrete`). The remaining second-order error is step^2 / 12 W (omega
C)^2 relative to K.

Under a constant force the mean velocity of a damped mode is about damping step^2 / 12 times its shape squared.
This drift is subtracted; otherwise the contact would alternate between slip and stick for about ten steps where
stick ends gently.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fivcore.errors import SceneValueError
from fivcore.jit import Array, ReadOnlyArrays

# Below this phase per step a series replaces the closed form; its error is of the eighth power of the phase.
SMALL = 1e-2
# Smallest squared sine of the angle between the normal and tangential rows of a rigid contact; rounding is 1e-15.
LEAST_SINE = 1e-12


class SlipMap(NamedTuple):
    """Slip during a step with T = m N, for any coefficient of friction m.

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
    # exp(-step / tau); also the decay of u in separation.
    decay: float
    # m/N.
    end_N: float
    end_T: float

    @property
    def mobility(self) -> float:
        """Change of the slip rate for a unit of T, m/s per N."""
        return self.rate_T + self.rate_N * self.gamma / self.beta

    def steepest_fall(self, mu: float) -> float:
        """Steepest fall -d mu / dv, s/m, for which the slip rate of a step is unique with N = 1."""
        # Valid for both directions of slip.
        return (1.0 - mu * abs(self.gamma) / self.beta) / self.mobility

    def forces(self, m: float, fall: float = 0.0) -> Array:
        """Matrix (3, 4) from (p, u_T, v_N, v_T) to N, T and the final u_T, for T = m N + fall * slip rate."""
        alpha = np.array([self.by_p, 0.0, self.by_v, 0.0])
        free = np.array([0.0, -self.relaxing, 0.0, 1.0]) + self.rate_N / self.beta * alpha
        T = (m / self.beta * alpha + fall * free) / (1.0 - fall * self.mobility - m * self.gamma / self.beta)
        N = (alpha + self.gamma * T) / self.beta
        return np.stack([N, T, np.array([0.0, self.decay, 0.0, 0.0]) + self.end_N * N + self.end_T * T])


@dataclass(frozen=True, eq=False)
class DiscreteContact(ReadOnlyArrays):
    """Discrete contact law of a step of `transient.fast.kernel`, for any friction; matrices (2, 2), normal first.

    Positions are constant during the impulse and velocities enter as means, so the implicit dashpot has a closed
    form. In slip u_T relaxes exactly, in separation u does.
    """

    # Flexibility S of the element including `defect`, m/N (zero: rigid), and relaxation time, s (0: elastic).
    flexibility: Array
    tau: float
    # Mean rates of the gaps during an impulse for a unit force, m/s per N.
    delassus: Array
    # s.
    step: float
    # Compliance that modes lose when forces act as impulses, m/N (`at_impulses`).
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
        """Smallest coefficient of friction at which the contact force of a step is not unique."""
        return min(ratio(*self.flexibility[0]), ratio(self.slip.beta, self.slip.gamma))

    def stick(self, late: float = 0.0) -> Array:
        """Matrix (2, 4) from (p, u_T, v_N, v_T) to (N, T) in stick; u_T follows g_T from `late`, s, on."""
        if not self.flexibility.any():
            return np.hstack([np.zeros((2, 2)), -resistance(self.delassus)])
        times = np.diag([self.tau, self.tau + late])
        return np.linalg.solve(self.flexibility + times @ self.delassus, np.hstack([np.eye(2), -times]))

    @property
    def mean_time(self) -> float:
        """Time after the start of a step at which a relaxing u_T has its mean value, s; 0 if rigid.

        Passed as `late` to `stick`, it makes the solution of a step unique where slip ends.
        """
        if not self.tau:
            return self.step if self.flexibility.any() else 0.0
        decay = self.step / self.tau
        return self.step * float(0.5 + decay / 12.0 if decay < 1e-4 else -1.0 / decay - 1.0 / np.expm1(-decay))

    @property
    def square_ratio(self) -> float:
        """Mean square of the rate of a relaxing u_T during a step, divided by its squared mean."""
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
    """Coefficient of friction at which the cross term equals the direct term."""
    return float(abs(direct / cross)) if cross else float("inf")


def at_impulses(stiffness: Array, damping: Array, step: float) -> tuple[Array, Array]:
    """Deflection defect, s2, and mean velocity (drift), s, of modes at the impulses of a constant unit force.

    Both (n,) and exact, for modes of unit mass, stiffness in rad2/s2 and damping in 1/s, (n,), and a step in s.
    """
    decay, spring = 0.5 * damping * step, stiffness * step**2
    phase, small = np.sqrt((spring - decay**2).astype(complex)), spring < SMALL**2
    safe = np.where(phase == 0.0, 1e-30, phase)
    left = np.exp(-decay)
    sine = left * (np.sin(safe) / safe).real
    # Determinant of the identity minus the propagator of a step, without cancellation.
    determinant = np.where(small, 1.0, (1.0 - left) ** 2 + 4.0 * left * (np.sin(0.5 * safe) ** 2).real)
    series = (1.0 + (spring - 4.0 * decay**2) / 60.0) / 12.0
    defect = np.where(small, series, 1.0 / np.where(small, 1.0, spring) - sine / determinant)
    series = (1.0 + (spring - 2.0 * decay**2) / 30.0) * decay / 6.0
    drift = np.where(small, series, (-0.5 * np.expm1(-2.0 * decay) - decay * sine) / determinant)
    return step**2 * defect, step * drift


def between_impulses(stiffness: Array, step: float) -> Array:
    """Additional deflection of modes midway between two impulses of a constant unit force, s2."""
    z = 0.5 * step * np.sqrt(stiffness)
    small = z < 1e-3
    safe = np.where(small, 1.0, z)
    # h / (2 omega sin(omega h / 2)) - 1 / omega^2 = h^2 / 4 (1 / (z sin z) - 1 / z^2), z = omega h / 2.
    excess = np.where(small, 1.0 / 6.0, 1.0 / (safe * np.sin(safe)) - 1.0 / safe**2)
    return np.asarray(0.25 * step**2 * excess)
