"""The law of the reduced contact: a visco-elastic element in place of the modes that are not kept.

The element has a state u = (u_N, u_T) and carries the contact force, K u + C u' = (N, T). The physical gap is
g_N + u_N, the slip rate g_T' + u_T'. Every regime is linear:

- separation: N = T = 0, while g_N + u_N > 0;
- stick: u_N = -g_N and g_T + u_T is constant, while N > 0 and |T| <= mu N;
- slip: u_N = -g_N and T = s mu N with s = -sign of the slip rate; u_T follows its own first-order equation.

At touch-down u is continuous and N jumps by C_NN times the closing speed. The forces that sticking needs decide
between stick and slip: T -+ mu N increases with u_T' wherever C_TT > mu |C_TN|, so that exactly one of stick, slip
forwards and slip backwards exists (`fivcore.contact.uniqueness`). Without an element the kept modes touch rigidly,
with restitution 0.
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
        of g_N and g_T before the impulse.
    slip : ndarray, (2, 2, 3)
        For T = mu N, then for T = -mu N: N and u_T at the end of the step, from (p, u_T, v_N).
    separation : ndarray, (2, 2)
        u at the end of the step from u at its start.
    entering, landing : ndarray, (2, 4)
        As `stick`, for a step that begins in slip, with u_T at its start, and for one in which the surfaces meet.
    mean_offset : float
        Time from the start of a step to the mean of a relaxing u_T, s. With it in `entering`, sticking needs more
        than mu N exactly where sliding would go the right way: a step too has one solution.
    square_ratio : float
        Mean square of the rate of a relaxing u_T over a step, in units of its mean squared.
    landing_offset : float
        Mean time in stick before the impulse where the surfaces meet, s: half a step.
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
    """Write each regime as linear maps for one step of `transient.fast_kernel`, symmetric in time.

    Positions are held over the impulse, and velocities enter by their mean, which makes the dashpot implicit in
    closed form; u_T in slip and u in separation relax exactly.

    Parameters
    ----------
    K, C : ndarray, (2, 2)
        The element's stiffness, N/m, and damping, N s/m (zero: purely elastic); normal first. Both zero: no
        element, the kept modes touch rigidly.
    M : ndarray, (2, 2)
        Mean rates of the gaps over an impulse by a unit force, m/s per N (`fivcore.contact.impulse`).
    mu : float
    step : float
        s.
    """
    if not K.any():
        return _rigid_maps(M, mu)
    offset, square_ratio, separation = step, 1.0, np.zeros((2, 2))
    if C.any():
        decay = step * K[1, 1] / C[1, 1]
        slow = decay < 1e-4
        offset = step * (0.5 + decay / 12.0 if slow else float(-1.0 / decay - 1.0 / np.expm1(-decay)))
        square_ratio = 0.5 * decay / np.tanh(0.5 * decay) if decay > 1e-6 else 1.0
        separation = expm(-step * np.linalg.solve(C, K))
    tangential = np.array([0.0, 1.0])
    entering, landing = (_stick(K, C + late * K * tangential, M) for late in (offset, 0.5 * step))
    slip = np.stack([_slip(K, C, M, m, step) for m in (mu, -mu)])
    return RegimeMaps(_stick(K, C, M), slip, separation, entering, offset, square_ratio, landing, 0.5 * step)


def _stick(K: Array, C: Array, M: Array) -> Array:
    """(N, T) from (p, u_T, v_N, v_T) with the mean of the rates in the dashpot."""
    implicit = np.linalg.inv(np.eye(2) + C @ M)
    return np.hstack([implicit @ K, -implicit @ C])


def _rigid_maps(M: Array, mu: float) -> RegimeMaps:
    """Maps without an element: zero mean rates in lasting contact; the kernel halves the forces at touch-down."""
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
    """Divisors of slip for T = mu N and T = -mu N, (4,); all are above zero where the contact force is unique.

    The first two, C_TT -+ mu C_TN over C_TT (K without damping), decide between stick and slip; the last two are
    the step's own, 1 for a step of zero.
    """
    matrix = C if C.any() else K
    law = [1.0 - s * mu * matrix[0, 1] / matrix[1, 1] for s in (1.0, -1.0)]
    if not C.any() or step == 0.0 or min(law) <= 0.0:
        return np.array([*law, 1.0, 1.0])
    own = [1.0 - (M[0, 0] + m * M[0, 1]) * _slipping(K, C, m, step)[0][2] for m in (mu, -mu)]
    return np.array([*law, *own])
