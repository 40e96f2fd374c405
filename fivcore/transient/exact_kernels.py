"""Compiled kernels of `method="exact"`: event search, work and dissipation by quadrature, sampling.

Within a contact regime every output, at the time s since the regime was entered, is

    f(s) = Re sum_k a_k exp(lambda_k s) + b . d(s),     d = (S, P, A, 1, q_r, v_r),

summed over the regime's eigenvalues. d is the prescribed motion: displacement S and velocity P = S' of P2's clamp
with S'' = A constant, and P1's rigid mode in free flight, v_r' = pull - drag v_r, which only separation needs.
Kernels take it as `start` = (S, P, A, 1, q_r, v_r, pull, drag) at s = 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import inlined, kernel
from fivcore.transient.statistics import FIELDS, clear, count_step, enter

# Statistics of a scene, its contact state, intervals and numbers of samples and rows of the record.
_WHOLE = ("contact", "sample_every", "row_every", "samples", "rows")
SCENE = np.dtype([*FIELDS, *((name, "i8") for name in _WHOLE)])
# Slots of `start`; the first six are those of d.
S, P, A, ONE, Q_R, V_R, PULL, DRAG = range(8)
# The signals that follow the modal velocities in a regime's outputs.
N_, T_, SPEED, RATE_N, RATE_T, V_B = range(6)
SIGNALS = 6
# A zero is located when the next step towards it is shorter than this; longest step of the search, s.
LOCATED, AHEAD = 1e-14, 1e-4
# Gauss-Legendre nodes and weights. Over 2.5 / omega of the fastest oscillation the relative error is 3e-12. They
# are literals because the last bits of computed ones depend on the machine.
_NODES = np.array([0.18343464249564978, 0.525532409916329, 0.7966664774136267, 0.9602898564975362])
_HALF_WEIGHTS = np.array([0.36268378337836166, 0.3137066458778869, 0.22238103445337443, 0.10122853629037706])
POINTS = np.concatenate([-_NODES[::-1], _NODES])
WEIGHTS = np.concatenate([_HALF_WEIGHTS[::-1], _HALF_WEIGHTS])


@kernel
def prescribed(start: Any, s: float) -> tuple[float, float, float, float, float, float]:
    """Return d at s; its third and fourth entries are constant."""
    drag, rate, pull = start[DRAG], start[V_R], start[PULL]
    z = drag * s
    if z < 1e-2:
        series = 1.0 - z / 3.0 * (1.0 - z / 4.0 * (1.0 - z / 5.0 * (1.0 - z / 6.0)))
        first, second = s * (1.0 - z / 2.0 * series), 0.5 * s * s * series
    else:
        first = -np.expm1(-z) / drag
        second = (s - first) / drag
    position, velocity = start[S] + s * (start[P] + 0.5 * s * start[A]), start[P] + s * start[A]
    q_r, v_r = start[Q_R] + rate * first + pull * second, rate - drag * rate * first + pull * first
    return position, velocity, start[A], 1.0, q_r, v_r


@inlined
def _forced_part(b: Any, d: Any, start: Any) -> tuple[float, float, float]:
    """Return b . d, its derivative, and a bound on its second derivative from now on."""
    pull = start[PULL] - start[DRAG] * d[V_R]
    value = b[S] * d[S] + b[P] * d[P] + b[A] * d[A] + b[ONE] + (b[Q_R] * d[Q_R] + b[V_R] * d[V_R])
    slope = b[S] * d[P] + b[P] * d[A] + b[Q_R] * d[V_R] + b[V_R] * pull
    return value, slope, abs(b[S] * d[A]) + (abs(b[Q_R]) + abs(b[V_R]) * start[DRAG]) * abs(pull)


@inlined
def _wave(eigenvalue: Any, s: float) -> Any:
    """Return exp(eigenvalue s) and its modulus."""
    size, angle = np.exp(eigenvalue.real * s), eigenvalue.imag * s
    return complex(size * np.cos(angle), size * np.sin(angle)), size


@kernel
def search(
    eigenvalues: Any, amplitudes: Any, forced: Any, start: Any, orders: Any, end: float
) -> tuple[float, int]:
    """Find the first zero of k functions, amplitudes (k, m) and b in `forced` (k, 6), within the time `end`, s.

    Returns the time, s, and the function's index, or `end` and -1. On (s, s + h)

        |f''| <= B = sum_k |a_k lambda_k^2 exp(lambda_k s)| max(1, exp(h Re lambda_k)) + |(b . d)''|,

    so f has no zero before f + f' x - B x^2 / 2 has one. Repeated steps to the positive root of this parabola pass
    a near miss or converge to the first zero, from before it and with second order: no pair of zeros is missed.

    An entry of `orders` (k,), 0 to 2, counts the derivatives, the value included, that vanish at s = 0. With the
    next one g > 0 and a bound B on the one after it, f >= s^order / order! (g - B s / (order + 1)); the search
    begins at half of the zero of this bound. Where g <= 0 the zero is at s = 0.
    """
    m, count = len(eigenvalues), len(amplitudes)
    # A step never spans more than a factor of e of growth, beyond which the bound is too loose to be of use.
    ahead = min(end, AHEAD, 1.0 / max(eigenvalues.real.max(), 1.0 / AHEAD))
    growth, sizes, waves = np.empty(m), np.empty(m), np.empty(m, dtype=np.complex128)
    curvature, until = np.empty((count, m)), np.zeros(count)
    for k in range(m):
        growth[k] = max(1.0, np.exp(eigenvalues[k].real * ahead))
        for i in range(count):
            curvature[i, k] = abs(amplitudes[i, k]) * abs(eigenvalues[k]) ** 2 * growth[k]
    for i in range(count):
        order, b = orders[i], forced[i]
        if order == 0:
            continue
        rise, bound = 0.0, 0.0
        for k in range(m):
            rise += (amplitudes[i, k] * eigenvalues[k] ** order).real
            bound += abs(amplitudes[i, k]) * abs(eigenvalues[k]) ** (order + 1) * growth[k]
        _, slope, bend = _forced_part(b, start, start)
        if order == 2:
            drag = start[DRAG]
            pull = start[PULL] - drag * start[V_R]
            slope = b[S] * start[A] + (b[Q_R] * pull - b[V_R] * drag * pull)
            bend = (abs(b[Q_R]) + abs(b[V_R]) * drag) * abs(pull) * drag
        rise, bound = rise + slope, bound + bend
        if not rise > 0.0:
            return 0.0, i
        until[i] = min(0.5 * (order + 1) * rise / bound, ahead) if bound > 0.0 else ahead
    s = until.min()
    while s < end:
        for k in range(m):
            waves[k], sizes[k] = _wave(eigenvalues[k], s)
        d = prescribed(start, s)
        for i in range(count):
            if until[i] > s:
                continue
            f, slope, bound = _forced_part(forced[i], d, start)
            for k in range(m):
                part = amplitudes[i, k] * waves[k]
                f += part.real
                slope += (part * eigenvalues[k]).real
                bound += curvature[i, k] * sizes[k]
            if not f > 0.0:
                return s, i
            root = np.sqrt(slope * slope + 2.0 * bound * f)
            step = 2.0 * f / (root - slope) if slope < 0.0 else (slope + root) / bound if bound > 0.0 else ahead
            # In this form NaN ends the search.
            if not step > max(LOCATED, 1e-15 * s):
                return s, i
            until[i] = s + min(step, ahead)
        s = until.min()
    return end, -1


@inlined
def _outputs(motion: Any, s: float, low: int, out: Any) -> None:
    """Write the outputs from number `low` on, at s, into `out`."""
    eigenvalues, amplitudes, real, imaginary, forced, start = motion
    d = prescribed(start, s)
    for j in range(low, out.shape[0]):
        out[j] = forced[S, j] * d[S] + forced[P, j] * d[P] + forced[A, j] * d[A] + forced[ONE, j]
        out[j] += forced[Q_R, j] * d[Q_R] + forced[V_R, j] * d[V_R]
    for k in range(eigenvalues.shape[0]):
        wave = amplitudes[k] * _wave(eigenvalues[k], s)[0]
        x, y = wave.real, wave.imag
        for j in range(low, out.shape[0]):
            out[j] += real[k, j] * x - imaginary[k, j] * y


@kernel
def integrate(
    motion: Any, first: float, last: float, finest: float, longest: float,
    damping: Any, inertia: Any, C: Any, scenes: Any,
) -> None:  # fmt: skip
    """Add work and dissipation between two times since the regime was entered, s, to the record `scenes` (1,).

    Gauss-Legendre quadrature of order 16. An interval is at most `longest`, and at most `finest` longer than the
    time since the regime was entered, which resolves fast decay while it lasts. `motion` holds eigenvalues (m,),
    amplitudes (m,), `Regime.outputs` and `start`.
    """
    n, start, scene = damping.shape[0], motion[5], scenes[0]
    out = np.empty(n + SIGNALS)
    s = first
    while s < last:
        h = min(longest, s + finest, last - s)
        work, damped, friction, termination = 0.0, 0.0, 0.0, 0.0
        for g in range(POINTS.shape[0]):
            at = s + 0.5 * h * (1.0 + POINTS[g])
            weight = 0.5 * h * WEIGHTS[g]
            _outputs(motion, at, 0, out)
            modal_loss, inertial = 0.0, 0.0
            for j in range(n):
                modal_loss += damping[j] * out[j] * out[j]
                inertial += inertia[j] * out[j]
            T, N_rate, T_rate = out[n + T_], out[n + RATE_N], out[n + RATE_T]
            work += weight * (T * (start[P] + at * start[A]) + inertial * start[A])
            damped += weight * modal_loss
            friction -= weight * T * out[n + SPEED]
            termination += weight * (
                C[0, 0] * N_rate * N_rate + 2.0 * C[0, 1] * N_rate * T_rate + C[1, 1] * T_rate * T_rate
            )
        scene.work += work
        scene.damped += damped
        scene.friction += friction
        scene.termination += termination
        if h == last - s:
            break
        s += h


@kernel
def switch(scenes: Any, contact: int, t: float, sticks: Any) -> None:
    """Enter the contact state at time t; the first slip begins the statistics anew."""
    scene = scenes[0]
    was, scene.contact = scene.contact, contact
    if contact == was:
        return
    if enter(scene, was, contact, t):
        sticks[scene.sticks - 1] = (scene.last_stick, t)
    if t < scene.settled_from:
        clear(scene)


@kernel
def sample(
    motion: Any, origin: float, step: float, first: int, last: int, scenes: Any, samples: Any, rows: Any
) -> None:
    """Read statistics and series in the middle of the steps `first` to `last` of a regime entered at `origin`, s.

    `motion` and `scenes` are those of `integrate`. A row of `samples` is velocity of B, slip rate and N; one of
    `rows` is time, velocity of B, N, T, slip rate and contact state.
    """
    scene = scenes[0]
    low = motion[2].shape[1] - SIGNALS
    out = np.empty(low + SIGNALS)
    for i in range(first, last):
        t = (i + 0.5) * step
        settled, sampled = t >= scene.settled_from, i % scene.sample_every == 0
        written = scene.row_every > 0 and i % scene.row_every == 0
        if not (settled or sampled or written):
            continue
        _outputs(motion, t - origin, low, out)
        N, T, speed, velocity = out[low + N_], out[low + T_], out[low + SPEED], out[low + V_B]
        if settled:
            count_step(scene, scene.contact, N, abs(speed), step)
        if sampled:
            samples[scene.samples] = (velocity, speed, N)
            scene.samples += 1
        if written:
            rows[scene.rows] = (t, velocity, N, T, speed, float(scene.contact))
            scene.rows += 1
