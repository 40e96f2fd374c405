"""Compiled kernels of `method="exact"`: certified search, dissipation by quadrature, sampling.

Within a regime every output of interest is, at the time s since the regime was entered,

    f(s) = Re sum_k a_k exp(lambda_k s) + drift . d(s),     d = (S, P, A, 1, q_r, v_r):

S and P = S' follow the drive of P2's clamp (S'' = A, a constant), q_r and v_r are P1's rigid mode in free flight.
They come as one array, `start` = (S, P, A, 1, q_r, v_r, pull, drag) at s = 0, with v_r' = pull - drag v_r.

The search cannot miss a pair of crossings. On (s, s + h)

    |f''| <= B = sum_k |a_k lambda_k^2 exp(lambda_k s)| max(1, exp(h Re lambda_k)) + what the drift adds,

so f cannot vanish before the parabola f + f' x - B x^2 / 2 does. Moving on by its positive root again and again
either passes every near miss or converges, from before and quadratically, to the first crossing.

A function that begins at zero, with `order` - 1 derivatives, is certified by its first derivative g that does not
vanish and a bound B on the next one: f >= s^order / order! (g - B s / (order + 1)), so it is positive up to
(order + 1) g / B, of which half is taken. Where g is not positive the event is at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import Array, inlined, kernel
from fivcore.transient.statistics import (
    DAMPED,
    FRICTION,
    SETTLED_FROM,
    TERMINATION,
    WORK,
    measure,
    spread,
)

# Slots of `start`.
S, P, A, ONE, Q_R, V_R, PULL, DRAG = range(8)
# The signals after the modal velocities in a regime's outputs.
N_, T_, GAP, SPEED, RATE_N, RATE_T, V_B = range(7)
SIGNALS = 7
# A crossing is located when less than this is left to it, s.
LOCATED = 1e-14
# How far ahead growth is allowed for in one bound, s.
AHEAD = 1e-4

# Gauss-Legendre with eight points: over 2.5 / omega of the fastest oscillation its relative error is 3e-12.
# Written out: computed, their last bits would be the machine's.
_POINTS = np.array(
    [
        -0.9602898564975362,
        -0.7966664774136267,
        -0.525532409916329,
        -0.18343464249564978,
        0.18343464249564978,
        0.525532409916329,
        0.7966664774136267,
        0.9602898564975362,
    ]
)
_WEIGHTS = np.array(
    [
        0.10122853629037706,
        0.22238103445337443,
        0.3137066458778869,
        0.36268378337836166,
        0.36268378337836166,
        0.3137066458778869,
        0.22238103445337443,
        0.10122853629037706,
    ]
)


@inlined
def flight(start: Any, s: float) -> Any:
    """S, P, q_r and v_r at s."""
    drag = start[DRAG]
    z = drag * s
    if z < 1e-2:
        first = s * (1.0 - z / 2.0 * (1.0 - z / 3.0 * (1.0 - z / 4.0 * (1.0 - z / 5.0 * (1.0 - z / 6.0)))))
        second = 0.5 * s * s * (1.0 - z / 3.0 * (1.0 - z / 4.0 * (1.0 - z / 5.0 * (1.0 - z / 6.0))))
    else:
        first = -np.expm1(-z) / drag
        second = (s - first) / drag
    position = start[S] + s * (start[P] + 0.5 * s * start[A])
    pull, rate = start[PULL], start[V_R]
    return (
        position,
        start[P] + s * start[A],
        start[Q_R] + rate * first + pull * second,
        rate - drag * rate * first + pull * first,
    )


@kernel
def search(rates: Any, parts: Any, drift: Any, start: Any, orders: Any, end: float) -> tuple[float, int]:
    """The first time at which one of several functions falls to zero.

    Parameters
    ----------
    rates : ndarray of complex, (m,)
    parts : ndarray of complex, (k, m)
        a_k of each function.
    drift : ndarray, (k, 6)
    start : ndarray, (8,)
    orders : ndarray of int, (k,)
        How many derivatives, the value included, are known to vanish at s = 0.
    end : float
        How far to look, s.

    Returns
    -------
    time : float
        At most `end`.
    which : int
        Index of the function; -1: none of them vanishes before `end`.
    """
    m, count = len(rates), len(parts)
    # Growth is never allowed for over more than a factor of e: a bound over a longer time would be useless.
    ahead = min(end, AHEAD, 1.0 / max(rates.real.max(), 1.0 / AHEAD))
    growth = np.empty(m)
    curvature = np.empty((count, m))
    until = np.zeros(count)
    waves = np.empty(m, dtype=np.complex128)
    sizes = np.empty(m)
    drag = start[DRAG]
    for k in range(m):
        growth[k] = max(1.0, np.exp(rates[k].real * ahead))
        for i in range(count):
            curvature[i, k] = abs(parts[i, k]) * abs(rates[k]) ** 2 * growth[k]
    pull = start[PULL] - drag * start[V_R]
    for i in range(count):
        order = orders[i]
        if order == 0:
            continue
        rise, bound = 0.0, 0.0
        for k in range(m):
            rise += (parts[i, k] * rates[k] ** order).real
            bound += abs(parts[i, k]) * abs(rates[k]) ** (order + 1) * growth[k]
        bend = drift[i, Q_R] * pull - drift[i, V_R] * drag * pull
        if order == 1:
            rise += (
                drift[i, S] * start[P] + drift[i, P] * start[A] + drift[i, Q_R] * start[V_R] + drift[i, V_R] * pull
            )
            bound += abs(drift[i, S] * start[A])
        elif order == 2:
            rise += drift[i, S] * start[A] + bend
        else:
            rise += bend * (-drag) ** (order - 2)
        bound += (abs(drift[i, Q_R]) + abs(drift[i, V_R]) * drag) * abs(pull) * drag ** (order - 1)
        if not rise > 0.0:
            return 0.0, i
        until[i] = min(0.5 * (order + 1) * rise / bound, ahead) if bound > 0.0 else ahead
    s = until.min()
    while s < end:
        for k in range(m):
            sizes[k] = np.exp(rates[k].real * s)
            angle = rates[k].imag * s
            waves[k] = complex(sizes[k] * np.cos(angle), sizes[k] * np.sin(angle))
        position, pace, q_r, v_r = flight(start, s)
        pull = start[PULL] - drag * v_r
        for i in range(count):
            if until[i] > s:
                continue
            f = drift[i, S] * position + drift[i, P] * pace + drift[i, A] * start[A] + drift[i, ONE]
            f += drift[i, Q_R] * q_r + drift[i, V_R] * v_r
            slope = drift[i, S] * pace + drift[i, P] * start[A] + drift[i, Q_R] * v_r + drift[i, V_R] * pull
            bound = abs(drift[i, S] * start[A]) + (abs(drift[i, Q_R]) + abs(drift[i, V_R]) * drag) * abs(pull)
            for k in range(m):
                part = parts[i, k] * waves[k]
                f += part.real
                slope += (part * rates[k]).real
                bound += curvature[i, k] * sizes[k]
            if not f > 0.0:
                return s, i
            root = np.sqrt(slope * slope + 2.0 * bound * f)
            step = 2.0 * f / (root - slope) if slope < 0.0 else (slope + root) / bound if bound > 0.0 else ahead
            # Written so that a number that is none ends the search.
            if not step > max(LOCATED, 1e-15 * s):
                return s, i
            until[i] = s + min(step, ahead)
        s = until.min()
    return end, -1


@inlined
def _outputs(
    rates: Any, c: Any, real: Any, imaginary: Any, drift: Any, start: Any, s: float, low: int, out: Any
) -> None:
    """Outputs from row `low` on at s, into `out`."""
    position, pace, q_r, v_r = flight(start, s)
    total = out.shape[0]
    for j in range(low, total):
        out[j] = drift[S, j] * position + drift[P, j] * pace + drift[A, j] * start[A] + drift[ONE, j]
        out[j] += drift[Q_R, j] * q_r + drift[V_R, j] * v_r
    for k in range(rates.shape[0]):
        size = np.exp(rates[k].real * s)
        angle = rates[k].imag * s
        wave = c[k] * complex(size * np.cos(angle), size * np.sin(angle))
        x, y = wave.real, wave.imag
        for j in range(low, total):
            out[j] += real[k, j] * x - imaginary[k, j] * y


@kernel
def integrate(
    rates: Any,
    c: Any,
    real: Any,
    imaginary: Any,
    drift: Any,
    start: Any,
    first: float,
    last: float,
    finest: float,
    longest: float,
    damping: Any,
    inertia: Any,
    C: Any,
    sums: Any,
) -> None:
    """Add work and dissipation from `first` to `last`, times since the regime was entered.

    Gauss-Legendre on the exact motion, not its closed form. Stretches are never longer than `longest`, nor
    than the time since the regime was entered plus `finest`: what decays fast is resolved while it lasts.
    """
    n = damping.shape[0]
    out = np.empty(n + SIGNALS)
    s = first
    while s < last:
        h = min(longest, s + finest, last - s)
        work, damped, friction, termination = 0.0, 0.0, 0.0, 0.0
        for g in range(_POINTS.shape[0]):
            at = s + 0.5 * h * (1.0 + _POINTS[g])
            _outputs(rates, c, real, imaginary, drift, start, at, 0, out)
            weight = 0.5 * h * _WEIGHTS[g]
            lost, carried = 0.0, 0.0
            for j in range(n):
                lost += damping[j] * out[j] * out[j]
                carried += inertia[j] * out[j]
            T, rate_N, rate_T = out[n + T_], out[n + RATE_N], out[n + RATE_T]
            work += weight * (T * (start[P] + at * start[A]) + carried * start[A])
            damped += weight * lost
            friction -= weight * T * out[n + SPEED]
            termination += weight * (
                C[0, 0] * rate_N * rate_N + 2.0 * C[0, 1] * rate_N * rate_T + C[1, 1] * rate_T * rate_T
            )
        sums[WORK] += work
        sums[DAMPED] += damped
        sums[FRICTION] += friction
        sums[TERMINATION] += termination
        if h == last - s:
            break
        s += h


@kernel
def sample(
    rates: Any,
    c: Any,
    real: Any,
    imaginary: Any,
    drift: Any,
    start: Any,
    origin: float,
    state: int,
    step: float,
    first: int,
    last: int,
    begin: int,
    tally: Any,
    heard: Any,
    hearing: int,
    rows: Any,
    recording: int,
) -> None:
    """Steps `first` to `last`, in the middle of each, of a regime entered at `origin`; `begin` is the chunk's."""
    _, moments, sums, forces, speeds, word, bits = tally
    low = real.shape[1] - SIGNALS
    out = np.empty(real.shape[1])
    for i in range(first, last):
        t = (i + 0.5) * step
        settled = t >= moments[SETTLED_FROM]
        listen = i % hearing == 0
        record = recording > 0 and i % recording == 0
        if not (settled or listen or record):
            continue
        _outputs(rates, c, real, imaginary, drift, start, t - origin, low, out)
        N, speed = out[low + N_], out[low + SPEED]
        if settled:
            measure(sums, state, N, abs(speed), step)
            spread(forces, speeds, word, bits, N, abs(speed), step)
        if listen:
            place = i // hearing - (begin + hearing - 1) // hearing
            heard[place, 0], heard[place, 1] = out[low + V_B], speed
        if record:
            place = i // recording - (begin + recording - 1) // recording
            rows[place, 0], rows[place, 1], rows[place, 2] = t, out[low + V_B], N
            rows[place, 3], rows[place, 4], rows[place, 5] = out[low + T_], speed, state


@kernel
def value_and_slope(rates: Any, parts: Any, drift: Any, start: Any, s: float) -> tuple[float, float]:
    """One function of `search` and its derivative at s."""
    position, pace, q_r, v_r = flight(start, s)
    f = (
        drift[S] * position
        + drift[P] * pace
        + drift[A] * start[A]
        + drift[ONE]
        + drift[Q_R] * q_r
        + drift[V_R] * v_r
    )
    slope = drift[S] * pace + drift[P] * start[A] + drift[Q_R] * v_r
    slope += drift[V_R] * (start[PULL] - start[DRAG] * v_r)
    for k in range(len(rates)):
        part = parts[k] * np.exp(rates[k] * s)
        f += part.real
        slope += (part * rates[k]).real
    return f, slope


def full_state(rates: Any, c: Any, shapes: Any, drift: Any, start: Array, s: float) -> Array:
    """Displacements, velocities and element state at s."""
    flown = np.empty(4)
    _fly(start, s, flown)
    d = np.array([flown[0], flown[1], start[A], 1.0, flown[2], flown[3]])
    return np.asarray((shapes @ (c * np.exp(rates * s))).real + drift @ d)


@kernel
def _fly(start: Any, s: float, out: Any) -> None:
    out[0], out[1], out[2], out[3] = flight(start, s)
