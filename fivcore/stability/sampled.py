"""Flutter onsets by sampling: modal damping, and friction that falls with the speed.

On the path of `onsets` around the growing exponents of the band, the characteristic equation is one for a real
unknown x, from which the friction follows, with complex coefficients (D-decomposition: Neimark, 1948). Its real
and imaginary parts have a common root where a function W of the path is 0: for an equation of first order W has
the sign of Im(x), for one of second order it is the resultant. W is sampled in steps that are a fraction of the
distance from the nearest pole, and sign changes and minima between samples are refined (Brent, Algorithms for
Minimization without Derivatives, 1973). Between any two crossings the growing exponents are counted; if the number
disagrees with the crossings, the samples were too coarse.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq, fminbound

from fivcore.beams.modes import EPS
from fivcore.errors import UnsolvedError
from fivcore.jit import Array, Complex, kernel
from fivcore.stability.exponents import LARGEST_PHI, BandModes, band_modes, exponents, pair
from fivcore.stability.onsets import ARC, FIRST, MOST_INTERVALS, PATH_TOP, contour, endless, isolated_crossings
from fivcore.structure import Structure

# Sampling steps as fractions of the distance from the nearest pole; smallest step.
STEPS, LEAST_STEP = (0.1, 0.04, 0.015, 0.005), 1e-9
# The last place: W is 0 on the real axis, at both ends of the path.
LAST = ARC - FIRST


class FrictionPath(NamedTuple):
    """How steady sliding depends on x: friction m = m0 + m1 x, falling by k = fall x^power / (1 + wedging m).

    `wedging` is h_NT / h_NN at rest, by which T changes N; `fall` is in units of 1 / omega, power 1 or 2.
    """

    m0: float = 0.0
    m1: float = 1.0
    wedging: float = 0.0
    fall: float = 0.0
    power: float = 1.0


@kernel
def quadratic(
    phi: complex, n: int, p: Array, c: Array, residues: Array, path: FrictionPath
) -> tuple[complex, complex, complex]:
    """Coefficients in x of (A + m B) (1 + wedging m) - fall x^power phi (A C - B^2), mode n's pole taken out."""
    m0, m1, f, fall, power = path
    sums = np.zeros(3, dtype=np.complex128)
    for i in range(len(p)):
        if i != n:
            inverse = 1.0 / (p[i] + phi * (c[i] + phi))
            for r in range(3):
                sums[r] += residues[r, i] * inverse
    gap, a, b, t = p[n] + phi * (c[n] + phi), residues[0, n], residues[1, n], residues[2, n]
    A, B, share = a + gap * sums[0], b + gap * sums[1], 0j
    if fall != 0.0:
        d = a * sums[2] + t * sums[0] - 2.0 * b * sums[1] + gap * (sums[0] * sums[2] - sums[1] * sums[1])
        share = fall * phi * d
    c0, c1, c2 = (A + m0 * B) * (1.0 + f * m0), (A + m0 * B) * (f * m1) + m1 * B * (1.0 + f * m0), f * m1 * m1 * B
    return (c0, c1 - share, c2) if power == 1.0 else (c0, c1, c2 - share)


@kernel
def _cross(a: complex, b: complex) -> float:
    return a.real * b.imag - a.imag * b.real


@kernel
def crossing_function(
    omega: float, n: int, p: Array, c: Array, residues: Array, path: FrictionPath, sign: float
) -> float:
    """W, times sign."""
    c0, c1, c2 = quadratic(contour(omega), n, p, c, residues, path)
    if path.m1 * path.wedging == 0.0 and path.power == 1.0:
        return sign * _cross(c0, c1)
    return sign * (_cross(c0, c2) ** 2 - _cross(c0, c1) * _cross(c1, c2))


@kernel
def sample(p: Array, c: Array, residues: Array, path: FrictionPath, poles: Complex, share: float) -> Array:
    """Places on the path, W there, and the mode whose pole is taken out, (k, 3)."""
    omega, count, samples = FIRST, 0, np.empty((4096, 3))
    while True:
        phi, nearest, least, away = contour(omega), 0, np.inf, np.inf
        for i in range(len(p)):
            one, other = phi - poles[0, i], phi - poles[1, i]
            u, v = one.real**2 + one.imag**2, other.real**2 + other.imag**2
            away = min(away, u, v)
            if u * v < least:
                nearest, least = i, u * v
        if count == len(samples):
            samples = np.concatenate((samples, np.empty((count, 3))))
        samples[count] = np.array([omega, crossing_function(omega, nearest, p, c, residues, path, 1.0), nearest])
        count += 1
        if omega == LAST:
            return samples[:count]
        corner = 1.0 if omega < 1.0 else PATH_TOP if omega < PATH_TOP else LAST
        omega = min(omega + max(share * np.sqrt(away), LEAST_STEP), corner)


def coulomb_crossings(own: Structure, fmax: float, ratio: float, mu_max: float) -> Array:
    """Crossings with a constant coefficient of friction, `ratio` mu, up to mu_max: as `sampled_crossings`."""
    if ratio * mu_max < 1e-12:
        return np.empty((0, 3))
    modes = band_modes(own, fmax)
    if modes.rayleigh is None:
        found = sampled_crossings(modes, FrictionPath(), 0.0, ratio * mu_max)
    else:
        (d1, d2), (a, b, _), brackets = modes.rayleigh, modes.residues, np.empty((MOST_INTERVALS, 3))
        found, judged = isolated_crossings(modes.p, a, b, d1, d2, ratio * mu_max, brackets)
        if judged == MOST_INTERVALS:
            raise endless(mu_max, fmax)
        found = found[np.lexsort(found.T[1::-1])]
    return np.asarray(found / [ratio, 1.0, 1.0])


def sampled_crossings(
    modes: BandModes, path: FrictionPath, low: float, high: float, name: str = "mu",
    value_of: Callable[[float], float] = float,
    friction_at: Callable[[float], tuple[float, float]] = lambda value: (value, 0.0),
) -> Array:  # fmt: skip
    """All places where the number of growing exponents of the band changes, (k, 3), ascending.

    Value, from `low` to `high`, of the parameter; place on the path of `onsets`; change of the number of growing
    exponents. `value_of` is the parameter at x, falling for V alone, `friction_at` m and k, N s/m, at its value.
    """
    p, c, residues, _ = system = modes.p, modes.c, modes.residues, path
    if not np.any(residues[1]) and not path.fall:
        return np.empty((0, 3))
    way, poles = -1.0 if name == "V" else 1.0, pair(p, c)

    def candidates(phi: complex, n: int) -> list[tuple[float, complex, complex]]:
        """Values with both roots x, the root closest to the real axis first."""
        each = np.array(quadratic(phi, n, *system))[::-1]
        roots = np.roots(each / max(np.abs(each).max(), 1e-300))
        roots = roots[np.argsort(np.abs(roots.imag / np.where(roots == 0.0, 1.0, roots)))]
        others = roots[::-1] if len(roots) == 2 else 0.0 * roots
        both = zip(roots.tolist(), others.tolist(), strict=True)
        return [(value_of(root.real), root, other) for root, other in both]

    for share in STEPS:
        onsets: list[tuple[float, float, float]] = []
        samples = sample(*system, poles, share)
        # Real exponents pass 0 (if friction does not fall) and 2.
        for x in (LARGEST_PHI,) if path.fall else (0.0, LARGEST_PHI):
            n = int(np.argmin(np.abs(p + x * (c + x))))
            for value, root, _ in candidates(complex(x), n):
                if abs(root.imag) <= 1e-9 * abs(root) and low < value <= high:
                    inside = [each for _, each, _ in candidates(complex(x * (1.0 - 1e-6) or 1e-6), n)]
                    beside = min(inside, key=lambda z: abs(z - root))
                    onsets.append((value, ARC, way * float(np.sign(beside.real - root.real))))
        for start, end, n in intervals(samples, system):
            rising = crossing_function(end, n, *system, 1.0) > 0.0
            if rising == (crossing_function(start, n, *system, 1.0) > 0.0):
                continue
            omega = brentq(crossing_function, start, end, (n, *system, 1.0), xtol=1e-18, rtol=4.0 * EPS)
            for value, _, other in candidates(contour(omega), n)[:1]:
                if low < value <= high:
                    onsets.append((value, omega, 2.0 * way if rising == (other.imag <= 0.0) else -2.0 * way))
        table = np.array(sorted(onsets)).reshape(-1, 3)
        if counts_agree(modes, friction_at, table, low, high):
            return table
    raise UnsolvedError(
        f"flutter onsets: those from {name} = {low:g} to {high:g} do not explain which motions grow below"
        f" fmax = {modes.omega / (2.0 * np.pi):g} Hz; other limits or another fmax near it will do"
    )


def counts_agree(modes: BandModes, friction_at: Any, crossings: Array, low: float, high: float) -> bool:
    """Whether crossings explain the number of growing exponents between any two of them."""
    ends = np.concatenate([[low], crossings[:, 0], [high]])
    expected, wide = np.concatenate([[0.0], np.cumsum(crossings[:, 2])]), np.diff(ends) > 1e-9 * ends[1:]
    middles = (0.5 * (ends[:-1] + ends[1:]))[wide].tolist()
    roots = exponents(modes, *np.array([friction_at(value) for value in middles]).reshape(-1, 2).T)
    inside = (roots.real > 0.0) & (np.abs(roots) <= LARGEST_PHI) & (roots.imag <= 1.0)
    growing = np.sum(np.where(roots.imag > 0.0, 2.0, 1.0) * inside, axis=1) - expected[wide]
    return bool(np.all(growing == growing[:1]))


def intervals(samples: Array, system: tuple[Array, Array, Array, FrictionPath]) -> list[tuple[float, float, int]]:
    """Intervals in which W changes its sign, and the mode whose pole is taken out."""
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
