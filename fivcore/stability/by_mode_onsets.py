"""Flutter onsets of a structure with damping by mode.

mu = -A / B, A = h_NN and B = h_NT at phi, is real on the path of `onsets` around the growing exponents of the band
where W = 0. W is sampled in steps that are a share of the distance from the nearest pole, and changes of its sign
and minima between the samples are refined (Brent, Algorithms for Minimization without Derivatives, 1973). Between
any two crossings the growing exponents are counted (`secular`, by the argument principle): where they are not
those that the crossings make, the samples were too coarse.

Where friction falls with the speed, h_TT takes part, and `quadratic` is the equation on the path: complex, for a
real unknown x, as D-decomposition has it (Neimark, 1948). Its real and its imaginary part have a common root where
their resultant, then W, is 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import brentq, fminbound

from fivcore.beams.modes import EPS
from fivcore.errors import UnsolvedError
from fivcore.jit import Array, Complex, kernel
from fivcore.stability.by_mode import BAND, damped_problem, damped_roots, exponents
from fivcore.stability.onsets import ARC, TOP
from fivcore.structure import Structure

# Steps of the samples, as shares of the distance from the nearest pole; the least step and the first place.
STEPS, LEAST, FIRST = (0.1, 0.04, 0.015, 0.005), 1e-9, 1e-7
# Samples of the real axis, 20 a decade.
REAL = 147
# The last place: on the real axis, at both ends of the path, W is 0.
LAST = ARC - FIRST


@kernel
def place(omega: float) -> complex:
    """Place on the path of `onsets`, phi in units of 2 pi fmax."""
    if omega <= 1.0:
        return complex(0.0, omega)
    angle = np.pi / 6.0 - 0.5 * (omega - TOP)
    return complex(omega - 1.0, 1.0) if omega <= TOP else 2.0 * complex(np.cos(angle), np.sin(angle))


@kernel
def _responses(phi: complex, n: int, p: Array, residues: Array, tail: Array) -> tuple[complex, complex]:
    """A and B, both without the pole of mode n."""
    a, b = 0j, 0j
    for k in range(tail.shape[1] - 1, -1, -1):
        a, b = a * phi + tail[0, k], b * phi + tail[1, k]
    factor = p[0, n] + phi * (p[1, n] + phi)
    a, b = a * factor, b * factor
    for i in range(p.shape[1]):
        share = complex(1.0)
        if i != n:
            share = factor / (p[0, i] + phi * (p[1, i] + phi))
        a, b = a + residues[0, i] * share, b + residues[1, i] * share
    return a, b


@kernel
def quadratic(
    phi: complex, n: int, p: Array, residues: Array, tail: Array, form: Array
) -> tuple[complex, complex, complex]:
    """Coefficients of (A + m B) (1 + f m) - q x^power phi (A C - B^2) in x; m = m0 + m1 x.

    `form` holds m0, m1, f, q and power; without the pole of mode n.
    """
    m0, m1, f, q, power = form
    sums = np.zeros(3, dtype=np.complex128)
    for k in range(tail.shape[1] - 1, -1, -1):
        for r in range(3):
            sums[r] = sums[r] * phi + tail[r, k]
    for i in range(p.shape[1]):
        if i != n:
            inverse = 1.0 / (p[0, i] + phi * (p[1, i] + phi))
            for r in range(3):
                sums[r] += residues[r, i] * inverse
    gap, a, b, c = p[0, n] + phi * (p[1, n] + phi), residues[0, n], residues[1, n], residues[2, n]
    d = a * sums[2] + c * sums[0] - 2.0 * b * sums[1] + gap * (sums[0] * sums[2] - sums[1] * sums[1])
    A, B, share = a + gap * sums[0], b + gap * sums[1], q * phi * d
    c0, c1, c2 = (A + m0 * B) * (1.0 + f * m0), (A + m0 * B) * (f * m1) + m1 * B * (1.0 + f * m0), f * m1 * m1 * B
    return (c0, c1 - share, c2) if power == 1.0 else (c0, c1, c2 - share)


@kernel
def _cross(a: complex, b: complex) -> float:
    return a.real * b.imag - a.imag * b.real


@kernel
def crossing_function(
    omega: float, n: int, p: Array, residues: Array, tail: Array, form: Any, sign: float
) -> float:
    """W, with the sign of Im(mu), times sign; with a form of `quadratic` that of Im(x), or the resultant."""
    if form is not None:
        c0, c1, c2 = quadratic(BAND * place(omega), n, p, residues, tail, form)
        if form[1] * form[2] == 0.0 and form[4] == 1.0:
            return sign * _cross(c0, c1)
        return sign * (_cross(c0, c2) ** 2 - _cross(c0, c1) * _cross(c1, c2))
    a, b = _responses(BAND * place(omega), n, p, residues, tail)
    return sign * (b.imag * a.real - b.real * a.imag)


@kernel
def sample(p: Array, residues: Array, tail: Array, form: Any, poles: Complex, share: float) -> Array:
    """Places on the path, W there, and the mode without whose pole it is, (k, 3)."""
    omega, count, samples = FIRST, 0, np.empty((4096, 3))
    while True:
        phi, nearest, least, away = BAND * place(omega), 0, np.inf, np.inf
        for i in range(p.shape[1]):
            one, other = phi - poles[0, i], phi - poles[1, i]
            u, v = one.real**2 + one.imag**2, other.real**2 + other.imag**2
            away = min(away, u, v)
            if u * v < least:
                nearest, least = i, u * v
        if count == len(samples):
            samples = np.concatenate((samples, np.empty((count, 3))))
        samples[count] = np.array(
            [omega, crossing_function(omega, nearest, p, residues, tail, form, 1.0), nearest]
        )
        count += 1
        if omega == LAST:
            return samples[:count]
        corner = 1.0 if omega < 1.0 else TOP if omega < TOP else LAST
        omega = min(omega + max(share * np.sqrt(away) / BAND, LEAST), corner)


def damped_crossings(own: Structure, fmax: float, mu_max: float) -> Array:
    """Friction, place on the path of `onsets` and change of the number of growing exponents, (k, 3), ascending."""
    problem = damped_problem(own, fmax)
    p, residues, tail, _ = system = problem.poles, problem.residues, problem.tail, None
    if not np.any(residues[1]) and not np.any(tail[1]):
        return np.empty((0, 3))
    poles = exponents(*p)
    # Real exponents pass 0 and 2.
    ends = []
    for x in (0.0, 2.0 * BAND):
        n = int(np.argmin(np.abs(p[0] + x * (p[1] + x))))
        a, b = _responses(complex(x), n, p, residues, tail)
        ends.append(-(a / b).real if b else np.inf)
    for share in STEPS:
        samples = sample(*system, poles, share)
        # With mu, a real exponent enters at 0, and leaves at 2, where Im(mu) > 0 on the path beside that end.
        changes = (ends[0], ARC + 2.0, np.sign(samples[0, 1])), (ends[1], ARC, -np.sign(samples[-1, 1]))
        found = [each for each in changes if 0.0 < each[0] <= mu_max]
        for low, high, n in brackets(samples, system):
            rising = crossing_function(high, n, *system, 1.0) > 0.0
            if rising == (crossing_function(low, n, *system, 1.0) > 0.0):
                continue
            omega = brentq(crossing_function, low, high, (n, *system, 1.0), xtol=1e-18, rtol=4.0 * EPS)
            a, b = _responses(BAND * place(omega), n, p, residues, tail)
            mu = -(a / b).real if b else np.inf
            if 0.0 < mu <= mu_max:
                found.append((mu, omega, 2.0 if rising else -2.0))
        crossings = np.array(sorted(found)).reshape(-1, 3)
        if agree(lambda mu: damped_roots(problem, mu), crossings, 0.0, mu_max):
            return crossings
    raise UnsolvedError(
        f"flutter onsets: those up to mu_max = {mu_max:g} do not explain which motions grow below fmax = {fmax:g}"
        " Hz; another mu_max or fmax near it will do"
    )


def divergence_onset(own: Structure, fmax: float, mu_max: float) -> float:
    """Least friction up to mu_max at which an exponent is real and grows, at most 2 * 2 pi fmax; NaN without one.

    For phi > 0 every term of A is positive, and has no resonance: 1 / mu = -B / A is smooth over log(phi), and its
    largest value is the least friction. Static modes are damped as in `falling.falling_problem`.
    """
    static = np.arange(len(own.stiffness)) >= len(own.frequency)
    n, t = own.normal, own.tangential

    def slope(log_phi: float) -> float:
        phi = np.exp(log_phi)
        moving = own.stiffness + phi * (own.damping + phi)
        dynamic = np.where(static, own.stiffness * (1.0 + own.d2 * phi), moving)
        return float((n * t / dynamic).sum() / (n * n / dynamic).sum())

    logs = np.log(2.0 * np.pi * fmax) + np.linspace(np.log(FIRST), np.log(2.0), REAL)
    values = np.array([slope(each) for each in logs])
    k = int(np.argmin(values))
    low, high = logs[max(k - 1, 0)], logs[min(k + 1, REAL - 1)]
    lowest = min(values[k], slope(fminbound(slope, low, high, xtol=1e-9)))
    return float(-1.0 / lowest) if lowest * mu_max <= -1.0 else float("nan")


def brackets(samples: Array, system: tuple[Array, Array, Array, Any]) -> list[tuple[float, float, int]]:
    """Intervals in which W changes its sign, and the mode without whose pole it does."""
    omega, W, mode = samples.T
    positive = W > 0.0
    flips = np.flatnonzero(positive[1:] != positive[:-1])
    found = [(float(omega[k]), float(omega[k + 1]), int(mode[k])) for k in flips]
    size = np.abs(W)
    least = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])
    least &= (positive[1:-1] == positive[:-2]) & (positive[1:-1] == positive[2:])
    for k in np.flatnonzero(least) + 1:
        low, high, n, sign = float(omega[k - 1]), float(omega[k + 1]), int(mode[k]), 1.0 if positive[k] else -1.0
        middle = float(fminbound(crossing_function, low, high, (n, *system, sign), xtol=1e-10 * high))
        if crossing_function(middle, n, *system, sign) < 0.0:
            found += [(low, middle, n), (middle, high, n)]
    return found


def agree(roots_at: Callable[[float], Complex], crossings: Array, least: float, most: float) -> bool:
    """Whether crossings explain the number of growing exponents between any two of them."""
    ends = np.concatenate([[least], crossings[:, 0], [most]])
    expected = np.concatenate([[0.0], np.cumsum(crossings[:, 2])])
    first = None
    for low, high, number in zip(ends[:-1], ends[1:], expected, strict=True):
        if high - low <= 1e-9 * high:
            continue
        roots = roots_at(float(0.5 * (low + high)))
        inside = (roots.real > 0.0) & (np.abs(roots) <= 2.0 * BAND) & (roots.imag <= BAND)
        growing = np.sum(np.where(roots.imag > 0.0, 2.0, 1.0)[inside])
        first = growing - number if first is None else first
        if growing - number != first:
            return False
    return True
