"""The compiled heart of `method="fast"`: kept modes move exactly, the contact acts in symmetric kicks.

One step from kick to kick, for kicks in the middle of the time steps: evaluate the gap, let
`fivcore.contact_law` find the force, change the velocities by step times force, move every mode freely over
one step (a Strang splitting, second order). Coordinates are deviations from the static equilibrium under the
unit load, so the load needs no force of its own: a kick carries N - 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.kernel import inlined, kernel, reordered
from fivcore.tally import (
    DAMPED,
    FIRST_SEPARATION,
    FRICTION,
    IMPACT,
    SEPARATION,
    SETTLED_FROM,
    SLIP,
    STATE,
    STICK,
    TERMINATION,
    WORK,
    follow,
    measure,
    spread,
)

# Slots of `contact`: the element's state and g_T + u_T at the last moment of sliding.
U_N, U_T, ANCHOR = 0, 1, 2
# Every how many steps the modal damping is sampled for the energy balance, and the histograms are filled.
SAMPLED, SPREAD = 8, 4


@reordered
def kick_and_move(flow: Any, normal: Any, tangential: Any, q: Any, v: Any, hN: float, hT: float) -> Any:
    """Kick, move freely over one step, and return g_N, g_T and their rates there."""
    gN, gT, vN, vT = 0.0, 0.0, 0.0, 0.0
    for j in range(q.shape[0]):
        was, rate = q[j], v[j] + (normal[j] * hN + tangential[j] * hT)
        x = flow[0, j] * was + flow[1, j] * rate
        y = flow[2, j] * was + flow[3, j] * rate
        q[j], v[j] = x, y
        gN += normal[j] * x
        gT += tangential[j] * x
        vN += normal[j] * y
        vT += tangential[j] * y
    return gN, gT, vN, vT


@reordered
def seen(normal: Any, tangential: Any, q: Any, v: Any) -> Any:
    """g_N, g_T and their rates."""
    gN, gT, vN, vT = 0.0, 0.0, 0.0, 0.0
    for j in range(q.shape[0]):
        gN += normal[j] * q[j]
        gT += tangential[j] * q[j]
        vN += normal[j] * v[j]
        vT += tangential[j] * v[j]
    return gN, gT, vN, vT


@reordered
def follow_shapes(slideN: Any, slideT: Any, normal: Any, tangential: Any, q: Any) -> Any:
    """Gap shapes of the next step, and by how much the gaps change with them alone."""
    gN, gT = 0.0, 0.0
    for j in range(q.shape[0]):
        normal[j] += slideN[j]
        tangential[j] += slideT[j]
        gN += slideN[j] * q[j]
        gT += slideT[j] * q[j]
    return gN, gT


@reordered
def along(shape: Any, v: Any) -> Any:
    """Velocity of a point."""
    x = 0.0
    for j in range(v.shape[0]):
        x += shape[j] * v[j]
    return x


@reordered
def damped(damping: Any, normal: Any, tangential: Any, v: Any, hN: float, hT: float) -> Any:
    """Power that the modes lose after a kick by hN and hT."""
    x = 0.0
    for j in range(v.shape[0]):
        y = v[j] + (normal[j] * hN + tangential[j] * hT)
        x += damping[j] * y * y
    return x


@inlined
def find_contact(
    laws: Any, mu: float, was: int, uN: float, uT: float, anchor: float, p: float, gT: float, vN: float, vT: float,
    half: float, WNT: float, WTT: float, rigid: bool,
) -> Any:  # fmt: skip
    """State, N, T, the element's new state and its u_T before, from penetration, g_T and their rates.

    `laws` are the numbers of `fivcore.contact_law.regime_maps`, not arrays: whoever passes arrays to a function
    with branches pays for counting references to them, here more than for the physics.
    """
    freeN, freeT = laws[20] * uN + laws[21] * uT, laws[22] * uN + laws[23] * uT
    # Without an element the gap of a lasting contact is rounding: only its force can end it.
    if p <= freeN and not (rigid and was != SEPARATION):
        return SEPARATION, 0.0, 0.0, freeN, freeT, uT
    if was == STICK:
        uT = anchor - gT
        N = (laws[0] * p + laws[2] * vN) + (laws[1] * uT + laws[3] * vT)
        T = (laws[4] * p + laws[6] * vN) + (laws[5] * uT + laws[7] * vT)
        if N > 0.0 and abs(T) <= mu * N:
            return STICK, N, T, p, uT, uT
        # From the middle of the step, where stick holds u_T, back to its start, where slip begins.
        uT += laws[32] * (vT + half * (WNT * N + WTT * T))
    else:
        N = (laws[24] * p + laws[26] * vN) + (laws[25] * uT + laws[27] * vT)
        T = (laws[28] * p + laws[30] * vN) + (laws[29] * uT + laws[31] * vT)
        if N > 0.0 and abs(T) <= mu * N:
            after = uT - laws[32] * (vT + half * (WNT * N + WTT * T))
            return STICK, N, T, p, after, uT
    if T > 0.0:
        N = laws[8] * p + laws[9] * uT + laws[10] * vN
        T = mu * N
        after = laws[11] * p + laws[12] * uT + laws[13] * vN
    else:
        N = laws[14] * p + laws[15] * uT + laws[16] * vN
        T = -mu * N
        after = laws[17] * p + laws[18] * uT + laws[19] * vN
    if N > 0.0:
        return SLIP, N, T, p, after, uT
    return SEPARATION, 0.0, 0.0, laws[20] * p + laws[21] * uT, laws[22] * p + laws[23] * uT, uT


@kernel
def advance(
    model: Any,
    laws: Any,
    mu: float,
    landing: float,
    K: Any,
    C: Any,
    W: Any,
    drive: Any,
    slide: Any,
    step: float,
    first: int,
    last: int,
    q: Any,
    v: Any,
    gaps: Any,
    contact: Any,
    tally: Any,
    sticks: Any,
    heard: Any,
    hearing: int,
    rows: Any,
    recording: int,
    stop: int,
    share: float,
) -> int:
    """Steps `first` to `last` of one scene; state arrays are changed in place.

    Parameters
    ----------
    model : tuple
        Flow over a step (4, n), damping, normal and tangential gap shapes, and shape at B, each (n,).
    laws : tuple of 34 floats
        What `fivcore.contact_law.regime_maps` returns, row by row.
    mu, landing : float
        Coefficient of friction, and what share of the laws' force acts at touch-down.
    K, C, W : ndarray, (2, 2)
        Of the element and of the kept modes.
    drive : ndarray, (7,)
        V, ramp, penetration and g_T at rest, the inertia of the base as a shift of g_T, and by how much
        the gaps at rest change in a step.
    slide : tuple
        By how much the gap shapes change in a step, each (n,); empty where the contact point stays.
    q, v : ndarray, (n,)
        Before the kick in the middle of step `first`.
    gaps : ndarray, (4,)
        What the modes make of g_N, g_T and their rates there, as the last stretch left it; NaN: find out. A sum
        in another order has other last bits, and motion must not depend on the stretches it is taken in.
    contact : ndarray, (3,)
        U_N, U_T, ANCHOR.
    tally : tuple
        `fivcore.tally.Tally.arrays`.
    sticks : ndarray, (most, 2)
        Receives the long sticks, begin and end in steps.
    heard : ndarray, (most, 2)
        Receives the velocity of B and the slip rate every `hearing` steps.
    rows : ndarray, (most, 6)
        Receives t, velocity of B, N, T, slip velocity and state every `recording` steps (0: never).
    stop : int
        0: go on to `last`; 1: stop before |T| exceeds a share of mu N; 2: stop at the first separation.
    share : float

    Returns
    -------
    int
        The step reached.
    """
    flow, damping, normal, tangential, point_b = model
    flags, moments, sums, forces, speeds, word, bits = tally
    V, ramp, p_rest, gT_rest, shift, rest_N, rest_T = drive
    slideN, slideT = slide
    n, moving, creep = q.shape[0], slideN.shape[0] > 0, 0.0
    half, rigid = 0.5 * step, landing != 1.0
    gN, gT, vN, vT = gaps
    if np.isnan(gN):
        gN, gT, vN, vT = seen(normal, tangential, q, v)
    B_N, B_T = 0.0, 0.0
    for j in range(n):
        B_N += point_b[j] * normal[j]
        B_T += point_b[j] * tangential[j]
        if moving:
            creep += slideN[j] * q[j] / step
    if moving:
        creep += rest_N / step
    # The next multiples; comparing is cheaper than dividing.
    heard_rows, next_heard = 0, -(-first // hearing) * hearing
    written, next_row = 0, -(-first // recording) * recording if recording > 0 else -1
    for i in range(first, last):
        t = (i + 0.5) * step
        if t < ramp:
            X, pace = 0.5 * V * t * t / ramp, V * t / ramp
        else:
            X, pace = V * (t - 0.5 * ramp), V
        was = flags[STATE]
        p = p_rest - gN
        slid = gT + (gT_rest + shift - X)
        # The unit load's share of the kick comes first; pace is the drive's.
        rateN, rateT = vN - (half * W[0, 0] - creep), vT - half * W[1, 0] - pace
        state, N, T, uN, uT, before = find_contact(
            laws,
            mu,
            was,
            contact[U_N],
            contact[U_T],
            contact[ANCHOR],
            p,
            slid,
            rateN,
            rateT,
            half,
            W[1, 0],
            W[1, 1],
            rigid,
        )
        if stop == 1 and (state != STICK or abs(T) > share * mu * N):
            last = i
            break
        if was == SEPARATION and state != SEPARATION:
            N, T = landing * N, landing * T
        meanN = rateN + half * (W[0, 0] * N + W[0, 1] * T)
        meanT = rateT + half * (W[1, 0] * N + W[1, 1] * T)
        if state == STICK:
            if was != STICK:
                contact[ANCHOR] = slid + uT
            ratesN, ratesT = -meanN, -meanT
        elif state == SLIP:
            ratesN, ratesT = -meanN, (uT - before) / step
        else:
            ratesN, ratesT = 0.0, 0.0
        speed = meanT + ratesT
        if state == SEPARATION:
            sums[TERMINATION] += 0.5 * (
                K[0, 0] * (contact[U_N] ** 2 - uN**2)
                + 2.0 * K[0, 1] * (contact[U_N] * before - uN * uT)
                + K[1, 1] * (before**2 - uT**2)
            )
        else:
            sums[WORK] += step * (T * pace - N * creep)
            sums[FRICTION] -= step * T * speed
            sums[TERMINATION] += step * (
                C[0, 0] * ratesN**2
                + 2.0 * C[0, 1] * ratesN * ratesT
                + (C[1, 1] * laws[33] if state == SLIP else C[1, 1]) * ratesT**2
            )
        if rigid:
            # Nothing moves in the element, so what work the contact takes is the landing's loss.
            sums[IMPACT] -= step * (N * meanN + (T * meanT if state == STICK else 0.0))
            speed = meanT
        contact[U_N], contact[U_T] = uN, uT
        if state != was:
            follow(flags, moments, sums, forces, speeds, sticks, t, state)
        if t >= moments[SETTLED_FROM]:
            measure(sums, state, N, abs(speed), step)
            if i % SPREAD == 0:
                spread(forces, speeds, word, bits, N, abs(speed), SPREAD * step)
        hN, hT = step * (N - 1.0), step * T
        listen, record = i == next_heard, i == next_row
        if listen or record:
            x = 0.5 * (B_N * hN + B_T * hT) + along(point_b, v)
            if listen:
                heard[heard_rows, 0], heard[heard_rows, 1] = x, speed
                heard_rows, next_heard = heard_rows + 1, next_heard + hearing
            if record:
                rows[written, 0], rows[written, 1], rows[written, 2] = t, x, N
                rows[written, 3], rows[written, 4], rows[written, 5] = T, speed, state
                written, next_row = written + 1, next_row + recording
        if i % SAMPLED == 0:
            lost = damped(damping, normal, tangential, v, 0.5 * hN, 0.5 * hT)
            sums[DAMPED] += SAMPLED * step * lost
        gN, gT, vN, vT = kick_and_move(flow, normal, tangential, q, v, hN, hT)
        if moving:
            creep, along_T = follow_shapes(slideN, slideT, normal, tangential, q)
            gN, gT, vN, vT = seen(normal, tangential, q, v)
            # What sticks does not slide over P2.
            contact[ANCHOR] += along_T + rest_T
            p_rest, gT_rest, creep = p_rest - rest_N, gT_rest + rest_T, (creep + rest_N) / step
        if stop == 2 and not np.isnan(moments[FIRST_SEPARATION]):
            last = i + 1
            break
    gaps[0], gaps[1], gaps[2], gaps[3] = gN, gT, vN, vT
    return last
