"""Compiled kernels of `method="exact"`: event search, work and dissipation by quadrature, sampling.

Within a contact status every output, at the time s since it was entered, is

    f(s) = Re sum_k a_k w_k(s),     w = (exp(lambda_1 s), ..., exp(lambda_m s), S, P, A, 1, q_r, v_r).

Its last six entries, d, are the prescribed motion: displacement S and velocity P = S' of P2's clamp with constant
S'' = A, and P1's rigid mode in free flight, v_r' = pull - drag v_r, which only separation needs. Kernels take d at
s = 0, pull and drag as `start` (8,).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.jit import inlined, kernel
from fivcore.transient.statistics import FIELDS, SLIP, clear, count_step, enter

# Statistics of a scene, its contact state, the present step, intervals and numbers of samples and rows.
_WHOLE = ("contact", "now", "sample_every", "row_every", "samples", "rows")
SCENE = np.dtype([*FIELDS, *((name, "i8") for name in _WHOLE)])
# Slots of `start`; the first six are those of d.
S, P, A, ONE, Q_R, V_R, PULL, DRAG = range(8)
# Outputs that precede the n modal velocities, each times the root of its mode's damping: rates of u, the
# dashpot's forces, modal force of a unit acceleration times velocity, and the five numbers of a row.
RATE_N, RATE_T, VISCOUS_N, VISCOUS_T, INERTIAL, V_B, N_, T_, SPEED, SIGNALS = range(10)
# A zero is located when the next step towards it is shorter than this; longest step of the search, s.
LOCATED, AHEAD = 1e-14, 1e-4
# Over 2.5 / omega of the fastest oscillation the quadrature's relative error is 3e-12.
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)


@kernel
def waves_at(eigenvalues: Any, start: Any, s: float, out: Any) -> None:
    """Write w at s into `out` (m + 6,)."""
    m, drag, rate, pull = len(eigenvalues), start[DRAG], start[V_R], start[PULL]
    for k in range(m):
        size, angle = np.exp(eigenvalues[k].real * s), eigenvalues[k].imag * s
        out[k] = complex(size * np.cos(angle), size * np.sin(angle))
    z = drag * s
    if z < 1e-2:
        series = 1.0 - z / 3.0 * (1.0 - z / 4.0 * (1.0 - z / 5.0 * (1.0 - z / 6.0)))
        first, second = s * (1.0 - z / 2.0 * series), 0.5 * s * s * series
    else:
        first = -np.expm1(-z) / drag
        second = (s - first) / drag
    out[m + S], out[m + P] = start[S] + s * (start[P] + 0.5 * s * start[A]), start[P] + s * start[A]
    out[m + A], out[m + ONE] = start[A], 1.0
    out[m + Q_R] = start[Q_R] + rate * first + pull * second
    out[m + V_R] = rate - drag * rate * first + pull * first


@inlined
def _differentiate(eigenvalues: Any, start: Any, w: Any, out: Any) -> None:
    """Write the derivative of w, or of one of its derivatives, into `out`."""
    m = len(eigenvalues)
    for k in range(m):
        out[k] = eigenvalues[k] * w[k]
    out[m + S], out[m + P], out[m + A], out[m + ONE], out[m + Q_R] = w[m + P], w[m + A], 0.0, 0.0, w[m + V_R]
    out[m + V_R] = start[PULL] * w[m + ONE] - start[DRAG] * w[m + V_R]


@kernel
def search(eigenvalues: Any, factors: Any, start: Any, orders: Any, end: float) -> tuple[float, int]:
    """Find the first zero of k functions, a in `factors` (k, m + 6), within the time `end`, s.

    Returns the time, s, and the function's index, or `end` and -1. On (s, s + h)

        |f''| <= B = sum_k |a_k w_k''(s)| max(1, exp(h Re lambda_k)),

    so f has no zero before f + f' x - B x^2 / 2 has one. Repeated steps to the positive root of this parabola pass
    a near miss or converge to the first zero, from before it and with second order: no pair of zeros is missed.

    An entry of `orders` (k,), 0 to 3, counts the derivatives, the value included, that vanish at s = 0. With the
    next one g > 0 and a bound B on the one after it, f >= s^order / order! (g - B s / (order + 1)); the search
    begins at half of the zero of this bound. Where g <= 0 the zero is at s = 0.
    """
    m, (count, size) = len(eigenvalues), factors.shape
    fastest = 1.0 / AHEAD
    for k in range(m):
        fastest = max(fastest, eigenvalues[k].real)
    # A step never spans more than a factor of e of growth, beyond which the bound is too loose to be of use.
    ahead = min(end, AHEAD, 1.0 / fastest)
    growth, bend, until = np.ones(size), np.empty(size), np.zeros(count)
    growth[:m] = np.maximum(1.0, np.exp(eigenvalues.real * ahead))
    magnitudes, w = np.abs(factors), np.empty((5, size), dtype=np.complex128)
    waves_at(eigenvalues, start, 0.0, w[0])
    for order in range(4):
        _differentiate(eigenvalues, start, w[order], w[order + 1])
    for i in range(count):
        order = orders[i]
        if order == 0:
            continue
        rise = (factors[i] * w[order]).real.sum()
        bound = (magnitudes[i] * np.abs(w[order + 1]) * growth).sum()
        if not rise > 0.0:
            return 0.0, i
        until[i] = min(0.5 * (order + 1) * rise / bound, ahead) if bound > 0.0 else ahead
    s = until.min()
    while s < end:
        waves_at(eigenvalues, start, s, w[0])
        _differentiate(eigenvalues, start, w[0], w[1])
        _differentiate(eigenvalues, start, w[1], w[2])
        for k in range(size):
            bend[k] = growth[k] * np.sqrt(w[2, k].real ** 2 + w[2, k].imag ** 2)
        for i in range(count):
            if until[i] > s:
                continue
            f, slope, bound = 0.0, 0.0, 0.0
            for k in range(size):
                f += (factors[i, k] * w[0, k]).real
                slope += (factors[i, k] * w[1, k]).real
                bound += magnitudes[i, k] * bend[k]
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
def _read(motion: Any, s: float, w: Any, out: Any) -> None:
    """Write the first outputs, as many as `out` has, at s."""
    eigenvalues, amplitudes, outputs, start = motion
    waves_at(eigenvalues, start, s, w)
    out[:] = 0.0
    for k in range(len(w)):
        wave = amplitudes[k] * w[k]
        if wave == 0.0:
            continue
        x, y, real, imaginary = wave.real, wave.imag, outputs[0, k], outputs[1, k]
        for j in range(len(out)):
            out[j] += real[j] * x - imaginary[j] * y


@inlined
def arrive(scene: Any, contact: int, origin: float, sticks: Any) -> None:
    """Count a change of the contact state; the first slip begins the statistics anew."""
    was, scene.contact = scene.contact, contact
    if contact != was:
        if enter(scene, was, contact, origin):
            sticks[scene.sticks - 1] = (scene.last_stick, origin)
        if origin < scene.settled_from:
            clear(scene)


@inlined
def wanted(scene: Any, i: int, step: float) -> bool:
    """Whether anything is read in the middle of step i."""
    written = scene.row_every > 0 and i % scene.row_every == 0
    return (i + 0.5) * step >= scene.settled_from or i % scene.sample_every == 0 or written


@inlined
def write(scene: Any, contact: int, i: int, step: float, signals: Any, samples: Any, rows: Any) -> None:
    """Add velocity of B, N, T and slip rate in the middle of step i to statistics and series."""
    velocity, N, T, speed = signals
    t = (i + 0.5) * step
    if t >= scene.settled_from:
        count_step(scene, contact, N, abs(speed), step)
    if i % scene.sample_every == 0:
        samples[scene.samples] = (
            velocity, speed, N, scene.stick_time, scene.separation_time, scene.sum_N, scene.switches
        )  # fmt: skip
        scene.samples += 1
    if scene.row_every > 0 and i % scene.row_every == 0:
        rows[scene.rows] = (t, velocity, N, T, speed, float(contact))
        scene.rows += 1


@kernel
def observe(
    motion: Any, contact: int, ratio: float, origin: float, now: float, end: float, step: float, first: int,
    last: int, scenes: Any, samples: Any, rows: Any, sticks: Any,
) -> None:  # fmt: skip
    """Add what a status contributes between the times `now` and `end`, s, to the record `scenes` (1,).

    `motion` holds eigenvalues (m,), amplitudes (m + 6,), `Status.outputs` and `start`; the status with its contact
    state was entered at the time `origin`, and `ratio` is T / N in slip. Statistics and series are read in the
    middle of the steps from `first` up to `last`: a row of `samples` is velocity of B, slip rate and N; one of
    `rows` is time, velocity of B, N, T, slip rate and contact state.

    Work and dissipation are integrated by Gauss-Legendre quadrature of order 16. An interval is at most 2.5 over
    the fastest frequency, and at most a quarter of the fastest time longer than the time since the status was
    entered, which resolves fast decay while it lasts.
    """
    eigenvalues, amplitudes, outputs, start = motion
    scene, w, out = scenes[0], np.empty_like(amplitudes), np.empty(outputs.shape[2])
    arrive(scene, contact, origin, sticks)
    for i in range(first, last):
        if wanted(scene, i, step):
            _read(motion, (i + 0.5) * step - origin, w, out[:SIGNALS])
            # The sum for T is off by the rounding of large terms; in slip N gives it.
            T = ratio * out[N_] if contact == SLIP else out[T_]
            write(scene, contact, i, step, (out[V_B], out[N_], T, out[SPEED]), samples, rows)
    fastest = oscillates = 1e-300
    for k in range(len(eigenvalues)):
        fastest, oscillates = max(fastest, np.abs(eigenvalues[k])), max(oscillates, np.abs(eigenvalues[k].imag))
    finest, longest = 0.25 / fastest, 2.5 / oscillates
    s, end = now - origin, end - origin
    while s < end:
        h = min(longest, s + finest, end - s)
        for g in range(len(POINTS)):
            at, weight = s + 0.5 * h * (1.0 + POINTS[g]), 0.5 * h * WEIGHTS[g]
            _read(motion, at, w, out)
            damped = 0.0
            for j in range(SIGNALS, len(out)):
                damped += out[j] * out[j]
            scene.work += weight * (out[T_] * (start[P] + at * start[A]) + out[INERTIAL] * start[A])
            scene.damped += weight * damped
            scene.friction -= weight * out[T_] * out[SPEED]
            scene.termination += weight * (out[RATE_N] * out[VISCOUS_N] + out[RATE_T] * out[VISCOUS_T])
        if h == end - s:
            break
        s += h
