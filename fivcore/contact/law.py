"""The reduced contact: a visco-elastic element in place of the modes that are not kept.

The element has a state of its own, u = (u_N, u_T), and carries the contact force: K u + C u' = (N, T). Each
surface moves by the kept modes plus u, so the physical gap is g_N + u_N and the slip rate g_T' + u_T'.

Regimes, all linear:

- separation: N = T = 0 and K u + C u' = 0, while g_N + u_N > 0;
- stick: u_N = -g_N and g_T + u_T stands still, while N > 0 and |T| <= mu N;
- slip: u_N = -g_N and T = s mu N with s = -sign of the slip rate; u_T follows its own first-order equation.

Touch-down is where g_N + u_N falls to zero: u is continuous there, u' is not, and N jumps by C_NN times the
closing speed. Whether the surfaces stick or slip is decided by the forces that sticking would need: with
y = u_T' still to be found, T(y) = T_0 + C_TT y and N(y) = N_0 + C_TN y, T -+ mu N is increasing in y wherever
C_TT > mu |C_TN|. Then exactly one of stick, slip forwards and slip backwards exists, at touch-down and at
every other instant; `fivcore.ContactError` says where it does not.

Without an element ("none") the kept modes touch rigidly, with restitution 0.

`regime_maps` turns each regime into numbers for one step of `transient.fast_kernel`: positions are held over
the step's kick, velocities enter by their mean (which makes the dashpot implicit, in closed form), and u_T in
slip and both parts of u in separation relax exactly. Every regime is symmetric in time. What a lasting force
seems to lack when it comes in impulses, `fivcore.contact.impulse` makes up for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from fivcore.jit import Array


class RegimeMaps(NamedTuple):
    """Contact forces and element state after one step, as linear maps.

    Attributes
    ----------
    stick : ndarray, (2, 4)
        (N, T) from (p, u_T, v_N, v_T): penetration p = -g_N, the element's tangential state, and the rates
        of g_N and of the slip before the impulse.
    slip : ndarray, (2, 2, 3)
        For T = mu N, then for T = -mu N: N and u_T at the end of the step, from (p, u_T, v_N).
    separation : ndarray, (2, 2)
        u at the end of the step from u at its start.
    entering : ndarray, (2, 4)
        As `stick`, for a step that begins in slip, u_T being what it was at the step's start.
    mean_offset : float
        How long after the start of a step u_T has its mean over the step, s: with it, what sticking needs
        exceeds mu N exactly where sliding would go the right way, so that one step has one answer too.
    square_ratio : float
        Mean square of the rate of a relaxing u_T over a step, in units of its mean squared.
    landing : ndarray, (2, 4)
        As `stick`, for a step in which the surfaces meet: on the average they have stuck for half a step when the
        impulse comes.
    landing_offset : float
        That time, s.
    """

    stick: Array
    slip: Array
    separation: Array
    entering: Array
    mean_offset: float
    square_ratio: float
    landing: Array
    landing_offset: float


def regime_maps(K: Array, C: Array, M: Array, mu: float, step: float) -> RegimeMaps:
    """Write each regime as linear maps for one step.

    Parameters
    ----------
    K, C : ndarray, (2, 2)
        The element's stiffness, N/m, and damping, N s/m (zero: purely elastic); normal first. Both zero: no
        element, the kept modes touch rigidly.
    M : ndarray, (2, 2)
        By how much a force raises the mean rates of the gaps over its kick, m/s per N (`fivcore.contact.impulse`).
    mu : float
    step : float
        s.
    """
    if not K.any():
        return _rigid_maps(M, mu)
    lag, tangential = mean_lag(K, C, step), np.array([0.0, 1.0])
    stick = _stick(K, C, M)
    entry, landing = (_stick(K, C + late * K * tangential, M) for late in (lag, 0.5 * step))
    slip = np.stack([_slip(K, C, M, sign * mu, step) for sign in (1.0, -1.0)])
    separation = expm(-step * np.linalg.solve(C, K)) if C.any() else np.zeros((2, 2))
    decay = step * K[1, 1] / C[1, 1] if C.any() else 0.0
    unevenness = 0.5 * decay / np.tanh(0.5 * decay) if decay > 1e-6 else 1.0
    return RegimeMaps(stick, slip, separation, entry, lag, unevenness, landing, 0.5 * step)


def mean_lag(K: Array, C: Array, step: float) -> float:
    """When, after the start of a step, a relaxing u_T has its mean, s: half the step for slow relaxation."""
    if not C.any():
        return step
    decay = step * K[1, 1] / C[1, 1]
    if decay < 1e-4:
        return step * (0.5 + decay / 12.0)
    return float(step * (-1.0 / decay - 1.0 / np.expm1(-decay)))


def _stick(K: Array, C: Array, M: Array) -> Array:
    """(N, T) from (p, u_T, v_N, v_T) with the mean of the rates in the dashpot."""
    implicit = np.linalg.inv(np.eye(2) + C @ M)
    return np.hstack([implicit @ K, -implicit @ C])


def _rigid_maps(M: Array, mu: float) -> RegimeMaps:
    """Without an element: in lasting contact the mean rates are zero, so no drift and no loss.

    Half of these forces, which the kernel takes at touch-down, bring the surfaces to rest: restitution 0.
    """
    stick, slip = np.zeros((2, 4)), np.zeros((2, 2, 3))
    stick[:, 2:] = -np.linalg.inv(M)
    for i, m in enumerate((mu, -mu)):
        slip[i, 0, 2] = -1.0 / (M[0, 0] + m * M[0, 1])
    return RegimeMaps(stick, slip, np.zeros((2, 2)), stick, 0.0, 1.0, stick, 0.0)


def _slip(K: Array, C: Array, M: Array, m: float, step: float) -> Array:
    """N and the new u_T for T = m N; rows on (p, u_T, v_N)."""
    normal, mean, mean_rate = _slipping(K, C, m, step)
    # v = v_N + (M_NN + m M_NT) N, solved for N.
    inertia = M[0, 0] + m * M[0, 1]
    force = normal / (1.0 - inertia * normal[2])
    if not C.any():
        return np.stack([force, mean])
    through = np.array([0.0, 0.0, 1.0]) + inertia * force
    end = step * (np.array([mean_rate[0], mean_rate[1], 0.0]) + mean_rate[2] * through)
    return np.stack([force, end + np.array([0.0, 1.0, 0.0])])


def _slipping(K: Array, C: Array, m: float, step: float) -> tuple[Array, Array, Array]:
    """N, and means over the step of u_T and its rate, for T = m N; rows on (p, u_T, v), v the mean rate of g_N."""
    if C.any():
        # u_T' = rate u_T + on_p p + on_v v.
        divisor = C[1, 1] - m * C[0, 1]
        rate = (m * K[0, 1] - K[1, 1]) / divisor
        on_p, on_v = (m * K[0, 0] - K[1, 0]) / divisor, (C[1, 0] - m * C[0, 0]) / divisor
        mean_rate = np.expm1(rate * step) / (rate * step) * np.array([on_p, rate, on_v])
        mean = (mean_rate - np.array([on_p, 0.0, on_v])) / rate
    else:
        mean_rate = np.zeros(3)
        mean = np.array([(m * K[0, 0] - K[1, 0]) / (K[1, 1] - m * K[0, 1]), 0.0, 0.0])
    return np.array([K[0, 0], 0.0, -C[0, 0]]) + K[0, 1] * mean + C[0, 1] * mean_rate, mean, mean_rate


def slip_divisors(K: Array, C: Array, M: Array, mu: float, step: float) -> Array:
    """What slip divides by, for T = mu N and T = -mu N: all must be above zero for a unique contact force.

    The first two decide between stick and slip (C_TT -+ mu C_TN, or K without damping), relative to
    C_TT; the last two are the step's own, 1 for a step of zero.
    """
    matrix = C if C.any() else K
    law = [1.0 - s * mu * matrix[0, 1] / matrix[1, 1] for s in (1.0, -1.0)]
    if not C.any() or step == 0.0 or min(law) <= 0.0:
        return np.array([*law, 1.0, 1.0])
    own = [1.0 - (M[0, 0] + m * M[0, 1]) * _slipping(K, C, m, step)[0][2] for m in (mu, -mu)]
    return np.array([*law, *own])
