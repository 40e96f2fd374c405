"""Compiled steps of the published scheme, `method="paper"` (`fivcore.transient.published`).

The other methods are measured against this one, so unlike them it adds its sums in a fixed order: the same bits on
every machine.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import inlined, kernel
from fivcore.transient.statistics import FIELDS, SEPARATION, SLIP, STICK, clear, count_step, enter

# The modal damping is sampled every so many steps for the energy balance.
SAMPLED = 64

# Step, beta2, dt / tau, friction, drive, gaps that unit forces close within a step (W); free gaps of the present
# step, g_T and T at the end of the last one; contact state, the present step, the step from which statistics
# count, intervals and numbers of samples and rows of the record.
_NUMBERS = ("dt", "b", "r", "mu", "speed", "ramp", "W_NN", "W_NT", "W_TT", "gap_N", "gap_T", "last_gT", "last_T")
_WHOLE = ("contact", "now", "settle", "sample_every", "row_every", "samples", "rows")
SCENE = np.dtype([*FIELDS, *((name, "f8") for name in _NUMBERS), *((name, "i8") for name in _WHOLE)])


@inlined
def _gaps(normal: Any, tangential: Any, q: Any) -> Any:
    """Normal and tangential gap, each added four at a time."""
    n0, n1, n2, n3, t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    whole = q.shape[0] // 4 * 4
    for j in range(0, whole, 4):
        n0 += normal[j] * q[j]
        n1 += normal[j + 1] * q[j + 1]
        n2 += normal[j + 2] * q[j + 2]
        n3 += normal[j + 3] * q[j + 3]
        t0 += tangential[j] * q[j]
        t1 += tangential[j + 1] * q[j + 1]
        t2 += tangential[j + 2] * q[j + 2]
        t3 += tangential[j + 3] * q[j + 3]
    for j in range(whole, q.shape[0]):
        n0 += normal[j] * q[j]
        t0 += tangential[j] * q[j]
    return (n0 + n1) + (n2 + n3), (t0 + t1) + (t2 + t3)


@inlined
def published_contact(
    gN: float, gT: float, last_gT: float, last_T: float, WNN: float, WNT: float, WTT: float, mu: float, r: float
) -> Any:
    """Contact state, N and T from the free gaps and the gaps W that unit forces close within the step."""
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
    scenes: Any, last: int, modes: Any, f: Any, slide: Any, q: Any, vs: Any, a: Any, free: Any, samples: Any,
    rows: Any, sticks: Any,
) -> None:  # fmt: skip
    """Take the steps up to `last` of one scene; the record and the state change in place.

    `scenes` (1,) is the record, `modes` holds k, c, 1 / (1 + b dt c), normal and tangential gap shapes and the
    shape at B, `f` the constant modal force, `slide` (2, n) the changes of the gap shapes in a step, empty where
    the contact point stays; `q`, `vs` and `a` are q, v* and a* of the present step, `free` workspace for q_free,
    each (n,). Rows of `samples` and `rows` are as in `fivcore.transient.segment.Segment`.
    """
    scene = scenes[0]
    k, c, inverse, normal, tangential, point_b = modes
    dt, b, V, ramp = scene.dt, scene.b, scene.speed, scene.ramp
    n = q.shape[0]
    while scene.now < last:
        now = scene.now
        t = (now + 1.0) * dt
        X = 0.5 * V * t * t / ramp if t < ramp else V * (t - 0.5 * ramp)
        if now == scene.settle:
            clear(scene)
        gT, was = scene.gap_T - X, scene.contact
        contact, N, T = published_contact(
            scene.gap_N, gT, scene.last_gT, scene.last_T, scene.W_NN, scene.W_NT, scene.W_TT, scene.mu, scene.r
        )
        shifted = gT + scene.W_NT * N + scene.W_TT * T
        slip_rate = (shifted - scene.last_gT) / dt
        scene.last_gT, scene.last_T, scene.contact = shifted, T, contact
        count_step(scene, contact, N, abs(slip_rate), dt)
        if contact != was:
            if enter(scene, was, contact, t):
                sticks[scene.sticks - 1] = (scene.last_stick, t)
            if scene.settled_from < np.inf:
                scene.settle = int(np.ceil(scene.settled_from / dt - 1.0))
        scene.work += dt * T * (V * t / ramp if t < ramp else V)
        scene.friction -= dt * T * slip_rate
        sampled = now % scene.sample_every == 0
        written = scene.row_every > 0 and now % scene.row_every == 0
        if sampled or written:
            x = 0.0
            for j in range(n):
                x += point_b[j] * (vs[j] + b * dt * (a[j] + (normal[j] * N + tangential[j] * T) * inverse[j]))
            if sampled:
                samples[scene.samples] = (x, slip_rate, N)
                scene.samples += 1
            if written:
                rows[scene.rows] = (t, x, N, T, slip_rate, float(contact))
                scene.rows += 1
        if now % SAMPLED == 0:
            x = 0.0
            for j in range(n):
                x += c[j] * vs[j] * vs[j]
            scene.damped += SAMPLED * dt * x
        # Correct this step with the force found and predict the next.
        for j in range(n):
            acceleration = a[j] + (normal[j] * N + tangential[j] * T) * inverse[j]
            v = vs[j] + b * dt * acceleration
            x = q[j] + dt * v + 0.5 * dt * dt * acceleration
            star = v + dt * (1.0 - b) * acceleration
            predicted = (f[j] - k[j] * x - c[j] * star) * inverse[j]
            q[j], vs[j], a[j] = x, star, predicted
            free[j] = x + dt * (star + b * dt * predicted) + 0.5 * dt * dt * predicted
        along = 0.0
        for j in range(slide.shape[1]):
            normal[j] += slide[0, j]
            tangential[j] += slide[1, j]
            along += slide[1, j] * q[j]
        scene.gap_N, scene.gap_T = _gaps(normal, tangential, free)
        # A change of g_T by the change of its shape is no slip.
        scene.last_gT += along
        scene.now = now + 1
