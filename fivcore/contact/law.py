"""The law of the reduced contact: a spring and a dashpot in parallel for the modes that are not kept.

They have a state u = (u_N, u_T) and carry the contact force, K u + C u' = (N, T). The physical gap is g_N + u_N,
the slip rate g_T' + u_T'. Every contact status is linear:

- separation: N = T = 0, while g_N + u_N > 0;
- stick: u_N = -g_N and g_T + u_T is constant, while N > 0 and |T| <= mu N;
- slip: u_N = -g_N and T = s mu N with s = -sign of the slip rate; u_T follows its own first-order equation.

At touch-down u is continuous and N jumps by C_NN times the closing speed. If C_TT > mu |C_TN| (K in place of C
without damping), T - mu N and T + mu N increase with u_T', and exactly one of stick, slip forwards and slip
backwards is possible. The Painleve limit is the least mu at which this condition fails, or at which the divisor
that gives N in a step of `fast` is zero; above it the force is not unique. In rigid contact an impact leaves no
closing speed, and its tangential impulse is within the cone.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from fivcore.errors import SceneValueError
from fivcore.jit import Array

# Least square of the sine between the directions of rigid contact, in which rounding is 1e-15.
LEAST_SINE = 1e-12


class StatusMaps(NamedTuple):
    """Contact forces and u after one step, as linear maps."""

    # (N, T) from (p, u_T, v_N, v_T), (2, 4): penetration p = -g_N, and the rates of the gaps before the impulse.
    stick: Array
    # For T = mu N, then for T = -mu N: N and u_T at the end of the step, from (p, u_T, v_N), (2, 2, 3).
    slip: Array
    # u at the end of the step from u at its start, (2, 2).
    separation: Array
    # As `stick`, for a step that begins in slip, with u_T at its start.
    entering: Array
    # Time from a step's start to the mean of a relaxing u_T, s; with it in `entering` a step has one solution.
    mean_offset: float
    # Mean square of the rate of a relaxing u_T over a step, in units of its mean squared.
    square_ratio: float
    # As `entering` and `mean_offset` where the surfaces meet: half a step.
    closure: Array
    closure_offset: float


def status_maps(K: Array, C: Array, M: Array, mu: float, step: float) -> StatusMaps:
    """Write each contact status as linear maps for one step of `transient.fast.kernel`, symmetric in time.

    Positions are held over the impulse, and velocities enter by their mean, which makes the dashpot implicit in
    closed form; u_T in slip and u in separation relax exactly.

    Parameters
    ----------
    K, C : ndarray, (2, 2)
        Spring, N/m, and dashpot, N s/m (zero: purely elastic); normal first. Both zero: rigid contact.
    M : ndarray, (2, 2)
        Effective Delassus matrix over a step: mean rates of the gaps over an impulse by a unit force, m/s per N
        (`fivcore.contact.impulse`).
    mu : float
    step : float
        s.
    """
    both = np.array([[mu], [-mu]])
    if not K.any():
        stick, slip = np.zeros((2, 4)), np.zeros((2, 2, 3))
        stick[:, 2:], slip[:, 0, 2:] = -resistance(M), -1.0 / (M[0, 0] + both * M[0, 1])
        return StatusMaps(stick, slip, np.zeros((2, 2)), stick, 0.0, 1.0, stick, 0.0)
    offset, square_ratio, separation = step, 1.0, np.zeros((2, 2))
    if C.any():
        decay = step * K[1, 1] / C[1, 1]
        offset = step * float(0.5 + decay / 12.0 if decay < 1e-4 else -1.0 / decay - 1.0 / np.expm1(-decay))
        square_ratio = 0.5 * decay / np.tanh(0.5 * decay) if decay > 1e-6 else 1.0
        separation = _relaxation(tuple(np.linalg.solve(C, K).ravel().tolist()), step)
    # (N, T) with the mean of the rates in the dashpot; u_T follows g_T only from the offset on.
    stick, entering, closure = (
        np.linalg.inv(np.eye(2) + damping @ M) @ np.hstack([K, -damping])
        for damping in (C + late * K * np.eye(2)[1] for late in (0.0, offset, 0.5 * step))
    )
    slip = _slip(K, C, M, both, step)[1]
    return StatusMaps(stick, slip, separation, entering, offset, square_ratio, closure, 0.5 * step)


class Slide(NamedTuple):
    """Numbers of slip in a step that do not depend on the coefficient of friction.

    With y = m N the force of friction, N = (alpha + gamma y) / beta with alpha = by_p p + by_v v_N, and the mean
    slip rate is v_T - relaxing u_T + rate_N N + rate_T y. u_T becomes keep u_T + end_N N + end_T y.
    """

    by_p: float
    by_v: float
    beta: float
    gamma: float
    relaxing: float
    rate_N: float
    rate_T: float
    keep: float
    end_N: float
    end_T: float

    @property
    def mobility(self) -> float:
        """Change of the mean slip rate for a unit of y, m/s per N."""
        return self.rate_T + self.rate_N * self.gamma / self.beta


def slide(K: Array, C: Array, M: Array, step: float) -> Slide:
    """Slip for any coefficient; arguments are those of `status_maps`, K and C in proportion.

    With P = p - tau v_N' and U = u_T + tau u_T', tau = C / K, it is K (P, U) = (N, y): u_T relaxes towards U,
    which is constant over the step, at the rate 1 / tau.
    """
    if not K.any():
        return Slide(0.0, -1.0, M[0, 0], -M[0, 1], 0.0, M[0, 1], M[1, 1], 0.0, 0.0, 0.0)
    tau, determinant = C[0, 0] / K[0, 0], float(np.linalg.det(K))
    gone = -np.expm1(-step / tau) if tau > 0.0 else 1.0
    U_N, U_T = -K[1, 0] / determinant, K[0, 0] / determinant
    return Slide(
        by_p=determinant,
        by_v=-determinant * tau,
        beta=K[1, 1] + tau * determinant * M[0, 0],
        gamma=K[0, 1] - tau * determinant * M[0, 1],
        relaxing=gone / step,
        rate_N=M[0, 1] + gone / step * U_N,
        rate_T=M[1, 1] + gone / step * U_T,
        keep=1.0 - gone,
        end_N=gone * U_N,
        end_T=gone * U_T,
    )


def steepest_fall(slide: Slide, mu: float) -> float:
    """Largest -d mu / dv, s/m, up to which slip is unique in a step with N = 1."""
    # In either direction of slip.
    factors = [slide.beta / (slide.beta - way * mu * slide.gamma) for way in (1.0, -1.0)]
    return 1.0 / (slide.mobility * max(factors))


def resistance(W: Array) -> Array:
    """Inverse of the Delassus matrix (2, 2) of a rigid contact."""
    if np.linalg.det(W) <= LEAST_SINE * W[0, 0] * W[1, 1]:
        raise SceneValueError(
            "normal, tangential: they are parallel over the modes that are kept, so the force of a rigid contact"
            " is not unique; give more modes, or the compliance of the others (`Structure.from_matrices`)"
        )
    return np.asarray(np.linalg.inv(W))


@lru_cache(maxsize=256)
def _relaxation(rates: tuple[float, ...], step: float) -> Array:
    """Map of u over a step of separation."""
    return np.asarray(expm(-step * np.reshape(rates, (2, 2))))


def painleve_mu(K: Array, C: Array, M: Array, step: float) -> float:
    """Painleve limit: smallest friction for which a divisor of slip is zero; a step of zero: by the law itself.

    Arguments are those of `status_maps`, K and C in proportion.
    """
    law = ratio(K[1, 1], K[0, 1])
    if not C.any() or step == 0.0:
        return law

    # At a root the maps are infinite.
    @np.errstate(divide="ignore", invalid="ignore")
    def least(mu: Array) -> Array:
        """Smaller of the two divisors at each mu."""
        return _slip(K, C, M, np.concatenate([mu, -mu])[:, None], step)[0].reshape(2, -1).min(axis=0)

    # The step's own divisors are positive at mu = 0 and smooth up to the law's limit; no mu exceeds 1e6.
    trial = np.linspace(0.0, min(law, 1e6) * (1.0 - 1e-9), 400)
    past = np.flatnonzero(least(trial) <= 0.0)
    if not len(past):
        return law
    return float(brentq(lambda mu: least(np.array([mu]))[0], *trial[past[0] - 1 : past[0] + 1]))


def ratio(direct: float, cross: float) -> float:
    """Friction at which the cross term equals the direct one."""
    return float(abs(direct / cross)) if cross else float("inf")


def _slip(K: Array, C: Array, M: Array, m: Array, step: float) -> tuple[Array, Array]:
    """Slip with T = m N, m (n, 1): divisors (n, 1), and maps (n, 2, 3) from (p, u_T, v_N) to N and the new u_T."""
    zero = np.zeros_like(m)
    if C.any():
        # u_T' = rate u_T + on_p p + on_v v, v the mean rate of g_N; the means of u_T and u_T' over the step.
        divisor = C[1, 1] - m * C[0, 1]
        rate = (m * K[0, 1] - K[1, 1]) / divisor
        on_p, on_v = (m * K[0, 0] - K[1, 0]) / divisor, (C[1, 0] - m * C[0, 0]) / divisor
        mean_rate = np.expm1(rate * step) / (rate * step) * np.hstack([on_p, rate, on_v])
        mean = (mean_rate - np.hstack([on_p, zero, on_v])) / rate
    else:
        mean_rate = np.zeros((len(m), 3))
        mean = np.hstack([(m * K[0, 0] - K[1, 0]) / (K[1, 1] - m * K[0, 1]), zero, zero])
    normal = np.array([K[0, 0], 0.0, -C[0, 0]]) + K[0, 1] * mean + C[0, 1] * mean_rate
    # v = v_N + inertia N, solved for N.
    inertia = M[0, 0] + m * M[0, 1]
    solved = 1.0 - inertia * normal[:, 2:]
    force = normal / solved
    end = step * (mean_rate + mean_rate[:, 2:] * inertia * force) + [0.0, 1.0, 0.0] if C.any() else mean
    return solved, np.stack([force, end], axis=1)
