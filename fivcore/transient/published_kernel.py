"""The compiled part of `method="paper"`: steps of the published scheme (`transient.published`)."""

from __future__ import annotations

from typing import Any

from fivcore.jit import inlined, kernel
from fivcore.transient.statistics import (
    DAMPED,
    FRICTION,
    SEPARATION,
    SETTLED_FROM,
    SLIP,
    STATE,
    STICK,
    WORK,
    follow,
    measure,
    spread,
)

# Slots of `contact`.
GT_LAST, T_LAST = 0, 1
# Every how many steps the modal damping is sampled for the energy balance, and the histograms are filled.
SAMPLED, SPREAD = 64, 8


@inlined
def correct_and_predict(
    k: Any, c: Any, inverse: Any, normal: Any, tangential: Any, f: Any,
    q: Any, vs: Any, a: Any, reach: Any, N: float, T: float, dt: float, b: float,
) -> Any:  # fmt: skip
    """End one step with the contact force found, begin the next, and return its free gaps.

    Between steps `q` holds q, `vs` v* and `a` a*; `reach` receives q_free. This is the yardstick of the other
    methods, so unlike them it adds its sums in a fixed order, four at a time: the same bits on every machine.
    """
    n = q.shape[0]
    for j in range(n):
        acceleration = a[j] + (normal[j] * N + tangential[j] * T) * inverse[j]
        rate = vs[j] + b * dt * acceleration
        x = q[j] + dt * rate + 0.5 * dt * dt * acceleration
        star = rate + dt * (1.0 - b) * acceleration
        free = (f[j] - k[j] * x - c[j] * star) * inverse[j]
        q[j], vs[j], a[j] = x, star, free
        reach[j] = x + dt * (star + b * dt * free) + 0.5 * dt * dt * free
    n0, n1, n2, n3, t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    whole = n // 4 * 4
    for j in range(0, whole, 4):
        n0 += normal[j] * reach[j]
        n1 += normal[j + 1] * reach[j + 1]
        n2 += normal[j + 2] * reach[j + 2]
        n3 += normal[j + 3] * reach[j + 3]
        t0 += tangential[j] * reach[j]
        t1 += tangential[j + 1] * reach[j + 1]
        t2 += tangential[j + 2] * reach[j + 2]
        t3 += tangential[j + 3] * reach[j + 3]
    for j in range(whole, n):
        n0 += normal[j] * reach[j]
        t0 += tangential[j] * reach[j]
    return (n0 + n1) + (n2 + n3), (t0 + t1) + (t2 + t3)


@inlined
def published_contact(
    gN: float, gT: float, last_gT: float, last_T: float, WNN: float, WNT: float, WTT: float, mu: float, r: float
) -> Any:
    """State, N and T from the free gaps; W is the gap that a unit force closes within the step."""
    if gN > 0.0:
        return SEPARATION, 0.0, 0.0
    back = gT - last_gT
    determinant = WNN * WTT - WNT * WNT
    N = (back * WNT - gN * WTT) / determinant
    T = (gN * WNT - back * WNN) / determinant
    if N > 0.0 and abs(T) < mu * N:
        return STICK, N, T
    m = mu if T > 0.0 else -mu
    N = (-gN - WNT * last_T / (1.0 + r)) / (WNN + m * WNT * r / (1.0 + r))
    if N <= 0.0:
        return SEPARATION, 0.0, 0.0
    return SLIP, N, (last_T + r * m * N) / (1.0 + r)


@kernel
def advance(
    modes: Any,
    f: Any,
    W: Any,
    mu: float,
    scheme: Any,
    drive: Any,
    slide: Any,
    first: int,
    last: int,
    q: Any,
    vs: Any,
    a: Any,
    reach: Any,
    contact: Any,
    gaps: Any,
    tally: Any,
    sticks: Any,
    heard: Any,
    hearing: int,
    rows: Any,
    recording: int,
) -> None:
    """Steps `first` to `last` of one scene; state arrays are changed in place.

    Parameters
    ----------
    modes : tuple
        k, c, 1 / (1 + b dt c), normal and tangential gap shapes and the shape at B, each (n,).
    f : ndarray, (n,)
        Constant modal force.
    W : ndarray, (3,)
        dt^2 (b + 1/2) times the sums of shapes over 1 + b dt c: NN, NT, TT.
    scheme : tuple
        dt, b, r.
    drive : tuple
        V, ramp.
    slide : tuple
        By how much the gap shapes change in a step, each (n,); empty where the contact point stays.
    q, vs, a : ndarray, (n,)
        q, v* and a* of step `first`.
    reach : ndarray, (n,)
        Work space.
    contact : ndarray, (2,)
        g_T and T at the end of the last step.
    gaps : ndarray, (2,)
        Free g_N and g_T of step `first`, without the drive.
    tally, sticks, heard, hearing, rows, recording
        As in `fivcore.transient.statistics` and `fivcore.transient.chunks`.
    """
    k, c, inverse, normal, tangential, point_b = modes
    flags, moments, sums, forces, speeds, word, bits = tally
    dt, b, r = scheme
    V, ramp = drive
    slideN, slideT = slide
    WNN, WNT, WTT = W
    n = q.shape[0]
    for i in range(first, last):
        t = (i + 1.0) * dt
        X = 0.5 * V * t * t / ramp if t < ramp else V * (t - 0.5 * ramp)
        gT = gaps[1] - X
        was = flags[STATE]
        state, N, T = published_contact(gaps[0], gT, contact[GT_LAST], contact[T_LAST], WNN, WNT, WTT, mu, r)
        at = gT + WNT * N + WTT * T
        speed = (at - contact[GT_LAST]) / dt
        contact[GT_LAST], contact[T_LAST] = at, T
        if state != was:
            follow(flags, moments, sums, forces, speeds, sticks, t, state)
        if t >= moments[SETTLED_FROM]:
            measure(sums, state, N, abs(speed), dt)
            if i % SPREAD == 0:
                spread(forces, speeds, word, bits, N, abs(speed), SPREAD * dt)
        sums[WORK] += dt * T * (V * t / ramp if t < ramp else V)
        sums[FRICTION] -= dt * T * speed
        listen = i % hearing == 0
        record = recording > 0 and i % recording == 0
        if listen or record:
            x = 0.0
            for j in range(n):
                x += point_b[j] * (vs[j] + b * dt * (a[j] + (normal[j] * N + tangential[j] * T) * inverse[j]))
            if listen:
                place = i // hearing - (first + hearing - 1) // hearing
                heard[place, 0], heard[place, 1] = x, speed
            if record:
                place = i // recording - (first + recording - 1) // recording
                rows[place, 0], rows[place, 1], rows[place, 2] = t, x, N
                rows[place, 3], rows[place, 4], rows[place, 5] = T, speed, state
        if i % SAMPLED == 0:
            x = 0.0
            for j in range(n):
                x += c[j] * vs[j] * vs[j]
            sums[DAMPED] += SAMPLED * dt * x
        gaps[0], gaps[1] = correct_and_predict(k, c, inverse, normal, tangential, f, q, vs, a, reach, N, T, dt, b)
        if slideN.shape[0] > 0:
            gN, gT, along = 0.0, 0.0, 0.0
            for j in range(n):
                normal[j] += slideN[j]
                tangential[j] += slideT[j]
                gN += normal[j] * reach[j]
                gT += tangential[j] * reach[j]
                # What sticks does not slide over P2.
                along += slideT[j] * q[j]
            gaps[0], gaps[1] = gN, gT
            contact[GT_LAST] += along
