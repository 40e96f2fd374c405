"""Compiled kernels of `method="exact"`: the rates of the model, steps of order 8, and the location of events.

The state z is (q, v, u_N, u_T), with q and u as deviations from rest, followed by the energies exchanged: work of
the drive, and losses by damping, friction and the contact dashpot. The `system` is constant during a run:

    stiffness, damping (n,); normal and tangential shapes (2, n); inertia, output (n,); K, C and the inverse of C,
    in rigid contact zero, zero and W; mu and the law of friction (`fivcore.friction.Friction.law`).

The drive (3,) is a time, the speed of P2's clamp there, and its acceleration from then on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import DOP853

from fivcore.friction import friction_ratio
from fivcore.jit import inlined, kernel, reordered_call
from fivcore.transient.statistics import FIELDS, SEPARATION, SLIP, STICK, clear, count_step, enter

# Statistics of a scene, its contact state, the present step, intervals and numbers of samples and rows.
_WHOLE = ("contact", "now", "sample_every", "row_every", "samples", "rows")
SCENE = np.dtype([*FIELDS, *((name, "i8") for name in _WHOLE)])
# Slip with T = mu N and with T = -mu N; the other statuses have the numbers of `fivcore.transient.statistics`.
SLIP_UP, SLIP_DOWN = 2, 3
# Rows of a law: forces, slip rate and gap; the rates of the state follow.
N, T, SLIP_RATE, GAP, RATES = range(5)
# Results of `follow` other than the index of a margin: no event; slip rate not unique; step too short.
NOTHING, NOT_UNIQUE, NO_STEP = -1, -2, -3
# The method of order 8 of Dormand and Prince, with errors of order 5 and 3 (Hairer, Norsett and Wanner, Solving
# Ordinary Differential Equations I, 1993, section II.10).
STAGES, POINTS, SUMS = DOP853.A[:12, :12].copy(), DOP853.C[:12].copy(), DOP853.B.copy()
ERROR_3, ERROR_5 = DOP853.E3.copy(), DOP853.E5.copy()
# Relative tolerance of a step, and zero tolerance relative to the size of the motion.
STEP_TOLERANCE, ZERO = 1e-13, 1e-14
# An event is located within this share of a step; shortest step, s.
LOCATED, SHORTEST_STEP = 1e-13, 1e-18


@inlined
def coefficient(x: float, law: Any) -> tuple[float, float]:
    """Coefficient of friction at the slip rate x and its derivative, continued beyond x = 0 for trial steps."""
    mu, kappa, decay_speed, rational = law
    near = max(x, -0.25 * decay_speed)
    ratio, slope = friction_ratio(near, kappa, decay_speed, rational)
    return mu * (ratio + slope * (x - near)), mu * slope


@kernel
def sliding(N: float, T: float, C: Any, law: Any, sense: float) -> tuple[float, float, float]:
    """Slip rate against T, mu at that rate, and derivative of T - s mu N by u_T', from (N, T) at zero slip rate.

    The iteration starts at the root for the smallest mu, which bounds all roots; with constant friction it is
    exact.
    """
    mu, slack = law[0] * law[1], 0.0
    x = (sense * T - mu * N) / (C[1, 1] - mu * sense * C[0, 1])
    for _ in range(60):
        mu, slope = coefficient(x, law)
        force = N - sense * C[0, 1] * x
        slack = C[1, 1] + slope * force - mu * sense * C[0, 1]
        change = (sense * T - C[1, 1] * x - mu * force) / max(slack, 1e-6 * C[1, 1])
        x += change
        if abs(change) <= 1e-15 * (abs(x) + abs(T) / C[1, 1]):
            break
    return x, mu, slack


@reordered_call
def rates(t: float, z: Any, which: int, system: Any, drive: Any, out: Any) -> Any:
    """Write the rates of z in a contact status; return N, T, slip rate, gap, and slack as `sliding`."""
    stiffness, damping, shapes, inertia, _, K, C, inverse, law = system
    n, acceleration = len(stiffness), drive[2]
    P, u_N, u_T, rigid = drive[1] + (t - drive[0]) * acceleration, z[2 * n], z[2 * n + 1], K[0, 0] == 0.0
    g_N, v_N, v_T, free_N, free_T, moved, damped = 0.0, 0.0, -P, 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        q, v, normal, tangential = z[j], z[n + j], shapes[0, j], shapes[1, j]
        force = inertia[j] * acceleration - damping[j] * v - stiffness[j] * q - normal
        out[j], out[n + j] = v, force
        g_N, v_N, v_T = g_N + normal * q, v_N + normal * v, v_T + tangential * v
        free_N, free_T = free_N + normal * force, free_T + tangential * force
        moved, damped = moved + inertia[j] * v, damped + damping[j] * v * v
    N, T, rate_N, rate_T, slack = 0.0, 0.0, 0.0, 0.0, 1.0
    sense = 1.0 if which == SLIP_UP else -1.0
    if which == SEPARATION:
        if not rigid:
            N, T = 1.0 + K[0, 0] * u_N + K[0, 1] * u_T, K[1, 0] * u_N + K[1, 1] * u_T
            rate_N, rate_T = -inverse[0, 0] * N - inverse[0, 1] * T, -inverse[1, 0] * N - inverse[1, 1] * T
            N, T = 0.0, 0.0
    elif rigid:
        if which == STICK:
            determinant = inverse[0, 0] * inverse[1, 1] - inverse[0, 1] * inverse[1, 0]
            free_T -= acceleration
            N = (inverse[0, 1] * free_T - inverse[1, 1] * free_N) / determinant
            T = (inverse[1, 0] * free_N - inverse[0, 0] * free_T) / determinant
        else:
            m = sense * coefficient(-sense * v_T, law)[0]
            N = -free_N / (inverse[0, 0] + m * inverse[0, 1])
            T = m * N
    else:
        rate_N, rate_T = -v_N, -v_T
        N = 1.0 + K[0, 0] * u_N + K[0, 1] * u_T + C[0, 0] * rate_N + C[0, 1] * rate_T
        T = K[1, 0] * u_N + K[1, 1] * u_T + C[1, 0] * rate_N + C[1, 1] * rate_T
        if which != STICK:
            x, mu, slack = sliding(N, T, C, law, sense)
            rate_T -= sense * x
            N -= sense * C[0, 1] * x
            T = sense * mu * N
    w = v_T + rate_T
    for j in range(n):
        out[n + j] += shapes[0, j] * N + shapes[1, j] * T
    out[2 * n], out[2 * n + 1] = rate_N, rate_T
    out[2 * n + 2], out[2 * n + 3], out[2 * n + 4] = T * P + moved * acceleration, damped, -T * w
    out[2 * n + 5] = C[0, 0] * rate_N * rate_N + (C[0, 1] + C[1, 0]) * rate_N * rate_T + C[1, 1] * rate_T * rate_T
    return N, T, w, g_N + u_N, slack


@kernel
def affine_law(units: Any, which: int, system: Any, drive: Any) -> Any:
    """Rows of a linear law, (4 + m, m + 1), to be multiplied by (z in `units`, (m,), and 1)."""
    m = len(units)
    rows, y, out, values = np.zeros((RATES + m, m + 1)), np.zeros(m + 4), np.empty(m + 4), np.empty(RATES + m)
    for j in range(m + 1):
        for sense in (1.0, -1.0):
            if j < m:
                y[j] = sense / units[j]
            values[:4] = rates(0.0, y, which, system, drive, out)[:4]
            values[4:] = units * out[:m]
            rows[:, j] += 0.5 * (sense if j < m else 1.0) * values
        if j < m:
            y[j] = 0.0
    return rows


@kernel
def rates_of(z: Any, which: int, system: Any, drive: Any, out: Any) -> Any:
    """Write the rates of z at time 0; return what `rates` does."""
    return rates(0.0, z, which, system, drive, out)


@inlined
def _least(values: Any, which: int, mu: float, zero: Any) -> tuple[float, int]:
    """The smallest margin of a status and its index; the status lasts while all margins are positive.

    Margins are the gap in separation; N, mu N - T and mu N + T in stick; N and the slip rate against T in slip.
    They are in units of the rounding of a force, a rate and a gap, `zero` (3,), plus 1 so that rounding ends no
    status.
    """
    N, T, w, gap, _ = values
    if which == SEPARATION:
        return 1.0 + gap / zero[2], 0
    least, number = N / zero[0], 0
    if which == STICK:
        for k, margin in ((1, (mu * N - T) / zero[0]), (2, (mu * N + T) / zero[0])):
            if margin < least:
                least, number = margin, k
    else:
        slip = (-w if which == SLIP_UP else w) / zero[1]
        if slip < least:
            least, number = slip, 1
    return 1.0 + least, number


@reordered_call
def _step(
    t: float, z: Any, h: float, which: int, system: Any, drive: Any, zeros: Any, stages: Any, out: Any
) -> float:
    """Write the state after a step of h from z, whose rates are `stages[0]`.

    Returns the fraction of the step at which a stage lies beyond the end of the status; 0 if none does.
    """
    place, lowest, mu = 0.0, 0.0, system[8][0]
    for i in range(1, 12):
        for j in range(len(z)):
            change = 0.0
            for k in range(i):
                change += STAGES[i, k] * stages[k, j]
            out[j] = z[j] + h * change
        least = _least(rates(t + POINTS[i] * h, out, which, system, drive, stages[i]), which, mu, zeros)[0]
        if least < lowest:
            place, lowest = POINTS[i], least
    for j in range(len(z)):
        change = 0.0
        for k in range(12):
            change += SUMS[k] * stages[k, j]
        out[j] = z[j] + h * change
    return place


@reordered_call
def _error(h: float, z: Any, new: Any, stages: Any, zero: Any) -> float:
    """Error of a step in units of its tolerance, from (13, m) `stages`; `zero` (m,) is the size of rounding."""
    fifth = third = 0.0
    for j in range(len(z)):
        a, b = 0.0, 0.0
        for k in range(13):
            a, b = a + ERROR_5[k] * stages[k, j], b + ERROR_3[k] * stages[k, j]
        size = zero[j] + STEP_TOLERANCE * max(abs(z[j]), abs(new[j]))
        # Not `** 2`: Numba compiles a power once, with the fast-math flags of the kernel that first needs it.
        a, b = a / size, b / size
        fifth, third = fifth + a * a, third + b * b
    return h * fifth / max(np.sqrt(fifth + 0.01 * third), 1e-300)


@reordered_call
def _keep_closed(z: Any, which: int, system: Any, P: float) -> None:
    """Remove the rounding error of a closed gap from u_N, or from q and v between rigid surfaces."""
    shapes, K, W = system[2], system[5], system[7]
    n, gap, v_N, v_T = shapes.shape[1], 0.0, 0.0, -P
    for j in range(n):
        gap += shapes[0, j] * z[j]
        v_N += shapes[0, j] * z[n + j]
        v_T += shapes[1, j] * z[n + j]
    if K[0, 0] != 0.0:
        z[2 * n] = -gap
        return
    gap, N, T = gap / W[0, 0], v_N / W[0, 0], 0.0
    if which == STICK:
        determinant = W[0, 0] * W[1, 1] - W[0, 1] * W[1, 0]
        N, T = (W[1, 1] * v_N - W[0, 1] * v_T) / determinant, (W[0, 0] * v_T - W[1, 0] * v_N) / determinant
    for j in range(n):
        z[j] -= shapes[0, j] * gap
        z[n + j] -= shapes[0, j] * N + shapes[1, j] * T


@kernel
def follow(
    motion: Any, which: int, origin: float, end: float, heeds: bool, system: Any, drive: Any, zeros: Any,
    step: float, scenes: Any, samples: Any, rows: Any, sticks: Any,
) -> int:  # fmt: skip
    """Follow a contact status, which began at the time `origin`, up to `end` or to its first event.

    `motion` (2n + 9,) holds z, time, next step and index of the next sampling time, and is changed in place.
    Returns the index of the margin that vanished (`_least`) or `NOTHING`, or `NO_STEP` or `NOT_UNIQUE` with the
    normal force in place of the next step. Without `heeds` events are ignored and the status lasts to the end.
    Statistics and series are evaluated in the middle of the steps of the run: a row of `samples` holds velocity of
    B, slip rate, N and counters, a row of `rows` time, velocity of B, N, T, slip rate and contact state.
    """
    m = len(motion) - 3
    n, scene, z, mu, contact = (m - 6) // 2, scenes[0], motion[:m], system[8][0], min(which, SLIP)
    stages, new, trial, spare = np.empty((13, m)), np.empty(m), np.empty(m), np.empty(m)
    t, h, i, event = motion[m], motion[m + 1], int(motion[m + 2]), NOTHING
    # The statistics restart at the first slip.
    was, scene.contact = scene.contact, contact
    if contact != was:
        if enter(scene, was, contact, origin):
            sticks[scene.sticks - 1] = (scene.last_stick, origin)
        if origin < scene.settled_from:
            clear(scene)
    values = rates(t, z, which, system, drive, stages[0])
    while True:
        middle = (i + 0.5) * step
        if t >= middle:
            settled, sampled = middle >= scene.settled_from, i % scene.sample_every == 0
            written, velocity = scene.row_every > 0 and i % scene.row_every == 0, 0.0
            if sampled or written:
                for j in range(n):
                    velocity += system[4][j] * z[n + j]
            if settled:
                count_step(scene, contact, values[0], abs(values[2]), step)
            if sampled:
                counters = scene.stick_time, scene.separation_time, scene.sum_N, scene.switches
                samples[scene.samples] = (velocity, values[2], values[0], *counters)
                scene.samples += 1
            if written:
                rows[scene.rows] = (middle, velocity, values[0], values[1], values[2], float(contact))
                scene.rows += 1
            i += 1
            continue
        if t >= end or event != NOTHING:
            break
        goal = min(middle, end)
        taken = min(h, goal - t)
        reaches = taken == goal - t
        place = _step(t, z, taken, which, system, drive, zeros, stages, new)
        if which != SEPARATION:
            _keep_closed(new, which, system, drive[1] + (t + taken - drive[0]) * drive[2])
        after = rates(t + taken, new, which, system, drive, stages[12])
        error = _error(taken, z, new, stages, zeros[3:])
        unique = values[4] > 0.0 and after[4] > 0.0
        if not (error < 1.0 and unique):
            h = taken * (max(0.2, 0.9 * error**-0.125) if error >= 1.0 else 0.2)
            # The steps shrink towards the force at which the slip rate is not unique.
            if h > max(SHORTEST_STEP, 1e-15 * t) and values[4] > 0.0:
                continue
            event, h = NO_STEP if unique else NOT_UNIQUE, values[0]
            break
        grown = taken * min(5.0, 0.9 * max(error, 1e-6) ** -0.125)
        h = max(grown, h) if reaches else grown
        if heeds:
            high, (least, number) = taken, _least(after, which, mu, zeros)
            if least > 0.0 and place > 0.0:
                _step(t, z, place * taken, which, system, drive, zeros, stages, trial)
                found = rates(t + place * taken, trial, which, system, drive, spare)
                above, k = _least(found, which, mu, zeros)
                if not above > 0.0:
                    high, least, number, after, new[:], stages[12] = place * taken, above, k, found, trial, spare
            if not least > 0.0:
                # Regula falsi (Illinois): the least margin is positive at `low`, if not at once negative.
                low, below = 0.0, _least(values, which, mu, zeros)[0]
                while below > 0.0 and high - low > LOCATED * taken:
                    at = low + (high - low) * min(max(below / (below - least), 0.02), 0.98)
                    _step(t, z, at, which, system, drive, zeros, stages, trial)
                    found = rates(t + at, trial, which, system, drive, spare)
                    above, k = _least(found, which, mu, zeros)
                    if above > 0.0:
                        low, below, least = at, above, 0.5 * least
                    else:
                        high, least, below, number = at, above, 0.5 * below, k
                        after, new[:], stages[12] = found, trial, spare
                event, reaches = number, False
                if not below > 0.0:
                    break
                taken = high
        t = goal if reaches else t + taken
        z[:], values, stages[0] = new, after, stages[12]
    motion[m], motion[m + 1], motion[m + 2] = t, h, i
    return event
