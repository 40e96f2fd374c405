"""Flutter onsets of a structure with damping by mode.

mu = -A / B, A = h_NN and B = h_NT at phi, is real on the path of `onsets` around the growing exponents of the band
where W = 0. W is sampled in steps that are a share of the distance from the nearest pole, and changes of its sign
and minima between the samples are refined (Brent, Algorithms for Minimization without Derivatives, 1973). Between
any two crossings the growing exponents are counted (`secular`, by the argument principle): where they are not
those that the crossings make, the samples were too coarse.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq, fminbound

from fivcore.beams.modes import EPS
from fivcore.errors import UnsolvedError
from fivcore.jit import Array, Complex, kernel
from fivcore.stability.by_mode import BAND, damped_problem, damped_roots, exponents
from fivcore.stability.onsets import ARC, TOP
from fivcore.stability.secular import SlidingProblem
from fivcore.structure import Structure

# Steps of the samples, as shares of the distance from the nearest pole; the least step and the first place.
STEPS, LEAST, FIRST = (0.1, 0.04, 0.015, 0.005), 1e-9, 1e-7
# The last place: on the real axis, at both ends of the path, W is 0.
LAST = ARC - FIRST


@kernel
def _place(omega: float) -> complex:
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
def _crossing(omega: float, n: int, p: Array, residues: Array, tail: Array, sign: float) -> float:
    """W, with the sign of Im(mu), times sign."""
    a, b = _responses(BAND * _place(omega), n, p, residues, tail)
    return sign * (b.imag * a.real - b.real * a.imag)


@kernel
def _sample(p: Array, residues: Array, tail: Array, poles: Complex, share: float) -> Array:
    """Places on the path, W there, and the mode without whose pole it is, (k, 3)."""
    omega, count, samples = FIRST, 0, np.empty((4096, 3))
    while True:
        phi, nearest, least, away = BAND * _place(omega), 0, np.inf, np.inf
        for i in range(p.shape[1]):
            one, other = phi - poles[0, i], phi - poles[1, i]
            u, v = one.real**2 + one.imag**2, other.real**2 + other.imag**2
            away = min(away, u, v)
            if u * v < least:
                nearest, least = i, u * v
        if count == len(samples):
            samples = np.concatenate((samples, np.empty((count, 3))))
        samples[count] = np.array([omega, _crossing(omega, nearest, p, residues, tail, 1.0), nearest])
        count += 1
        if omega == LAST:
            return samples[:count]
        corner = 1.0 if omega < 1.0 else TOP if omega < TOP else LAST
        omega = min(omega + max(share * np.sqrt(away) / BAND, LEAST), corner)


def damped_crossings(own: Structure, fmax: float, mu_max: float) -> Array:
    """Friction, place on the path of `onsets` and change of the number of growing exponents, (k, 3), ascending."""
    problem = damped_problem(own, fmax)
    p, residues, tail = system = problem.poles, problem.residues, problem.tail
    if not np.any(residues[1]) and not np.any(tail[1]):
        return np.empty((0, 3))
    poles = exponents(*p)
    # Real exponents pass 0 and 2.
    ends = []
    for x in (0.0, 2.0 * BAND):
        n = int(np.argmin(np.abs(p[0] + x * (p[1] + x))))
        a, b = _responses(complex(x), n, *system)
        ends.append(-(a / b).real if b else np.inf)
    for share in STEPS:
        samples = _sample(*system, poles, share)
        # Such an exponent grows from 0 on where Im(mu) > 0 on the path beside it, and leaves at 2 where it is.
        changes = (ends[0], ARC + 2.0, np.sign(samples[0, 1])), (ends[1], ARC, -np.sign(samples[-1, 1]))
        found = [each for each in changes if 0.0 < each[0] <= mu_max]
        for low, high, n in _brackets(samples, system):
            rising = _crossing(high, n, *system, 1.0) > 0.0
            if rising == (_crossing(low, n, *system, 1.0) > 0.0):
                continue
            omega = brentq(_crossing, low, high, (n, *system, 1.0), xtol=1e-18, rtol=4.0 * EPS)
            a, b = _responses(BAND * _place(omega), n, *system)
            mu = -(a / b).real if b else np.inf
            if 0.0 < mu <= mu_max:
                found.append((mu, omega, 2.0 if rising else -2.0))
        crossings = np.array(sorted(found)).reshape(-1, 3)
        if _agree(problem, crossings, mu_max):
            return crossings
    raise UnsolvedError(
        f"flutter onsets: those up to mu_max = {mu_max:g} do not explain which motions grow below fmax = {fmax:g}"
        " Hz; another mu_max or fmax near it will do"
    )


def _brackets(samples: Array, system: tuple[Array, Array, Array]) -> list[tuple[float, float, int]]:
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
        middle = float(fminbound(_crossing, low, high, (n, *system, sign), xtol=1e-10 * high))
        if _crossing(middle, n, *system, sign) < 0.0:
            found += [(low, middle, n), (middle, high, n)]
    return found


def _agree(problem: SlidingProblem, crossings: Array, mu_max: float) -> bool:
    """Whether crossings explain the number of growing exponents between any two of them."""
    ends = np.concatenate([[0.0], crossings[:, 0], [mu_max]])
    expected = np.concatenate([[0.0], np.cumsum(crossings[:, 2])])
    first = None
    for low, high, number in zip(ends[:-1], ends[1:], expected, strict=True):
        if high - low <= 1e-9 * high:
            continue
        roots = damped_roots(problem, float(0.5 * (low + high)))
        inside = (roots.real > 0.0) & (np.abs(roots) <= 2.0 * BAND) & (roots.imag <= BAND)
        growing = np.sum(np.where(roots.imag > 0.0, 2.0, 1.0)[inside])
        first = growing - number if first is None else first
        if growing - number != first:
            return False
    return True
