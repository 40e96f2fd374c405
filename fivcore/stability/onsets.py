"""Flutter onsets: the friction at which steady sliding loses its stability, by isolated roots.

On the imaginary axis, phi = i omega, the undamped eigenvalue is lambda = x - i y and mu = -A / B with A = h_NN,
B = h_NT there. mu is real, at an onset, where W = A_i B_r - A_r B_i = 0 with A = A_r - i y A_i, B = B_r - i y B_i;
without damping, y = 0, two real eigenvalues meet there. A and B are multiplied by (p_n - lambda) of the nearest
pole, which changes no zero. No pair of zeros is missed: an interval is left only when a bound on |W''| shows that
W keeps its sign in it or is monotone, or when mu is shown to stay outside (0, mu_max]. The same holds along the
top of the band, where growing pairs enter and leave it: omega > 1 stands for phi = omega - 1 + i there. Kernels
take omega in units of 2 pi fmax, p in units of its square, d1 and d2 to match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from fivcore import checks
from fivcore.beams.modes import contact_modes
from fivcore.errors import UnsolvedError
from fivcore.jit import Array, kernel
from fivcore.rig import Rig
from fivcore.stability.secular import nearest_pole

# A search that needs more intervals than this has met a W that vanishes altogether; hundreds are usual.
MOST_INTERVALS = 100_000
# Where the path ends: |phi| = 2 at the top of the band, which is where `sliding_modes` ends.
END = 1.0 + 3.0**0.5


@dataclass(frozen=True, eq=False)
class FlutterOnsets:
    """Where growth rates pass through zero as mu rises, ascending in mu.

    A divergence has none of them: whether sliding is stable at a friction, only `sliding_modes` tells.

    Attributes
    ----------
    mu, frequency, recovery_mu, recovery_frequency : ndarray, (n,) or (m,)
        Friction and frequency (Hz) at which a growth rate rises through zero, or falls back through it.
    entry_mu : ndarray, (k,)
        Friction at which a pair enters the band through its top already growing, at no more than 1.7 times the
        band's angular frequency; not where one that left the band growing may be coming back.
    """

    mu: Array
    frequency: Array
    recovery_mu: Array
    recovery_frequency: Array
    entry_mu: Array


def flutter_onsets(rig: Rig, theta: float, fmax: float = 10e3, mu_max: float = 1.0) -> FlutterOnsets:
    """All flutter onsets and recoveries of steady sliding (V > 0) in a band, refined to rounding (Brent).

    Two onsets less than 1e-13 of the band apart are not reported.

    Parameters
    ----------
    rig : Rig
    theta, fmax, mu_max : float
        Degrees; band, Hz; largest friction of interest.

    Returns
    -------
    FlutterOnsets

    Raises
    ------
    ValueError, ArithmeticError
        For an argument out of range; if the onsets cannot be isolated.
    """
    checks.instance("rig", rig, Rig)
    angle = checks.theta_degrees(theta)
    band, most = checks.band(fmax), checks.between("mu_max", mu_max, 1e-12, 1e6, "a coefficient of friction")
    mu, place, sign = np.array(onset_crossings(rig, angle, band, most)).reshape(-1, 3).T
    on_axis, rises = place <= band, sign == 1.0
    onset, recovery, entry = on_axis & rises, on_axis & ~rises, entries(np.zeros(len(mu)), ~on_axis, rises)
    return FlutterOnsets(mu[onset], place[onset], mu[recovery], place[recovery], mu[entry])


def entries(row: Array, at_top: NDArray[np.bool_], rises: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which crossings, ascending in mu in each row, are entries of a pair that did not leave the band before."""
    entry, beyond = at_top & rises, dict.fromkeys(row, 0)
    for k in np.flatnonzero(at_top):
        entry[k] &= beyond[row[k]] == 0
        beyond[row[k]] += 0 if entry[k] else -1 if rises[k] else 1
    return entry


def onset_crossings(rig: Rig, theta: float, fmax: float, mu_max: float) -> list[tuple[float, float, bool]]:
    """Friction, place and whether a pair begins to grow in the band, of each crossing, ascending in friction.

    The place is the frequency in Hz, or t fmax > fmax at the top of the band; arguments are not checked.
    """
    stiffness, normal, tangential = contact_modes(rig, theta)
    unit = 2.0 * np.pi * fmax
    seen = normal != 0.0
    p = stiffness[seen] / unit**2
    a, b = normal[seen] ** 2 / unit**2, normal[seen] * tangential[seen] / unit**2
    d1, d2 = rig.d1 / unit, rig.d2 * unit
    if not np.any(b):
        return []
    brackets = np.empty((MOST_INTERVALS, 3))
    count, judged = isolate(p, a, b, d1, d2, mu_max, brackets)
    if judged == MOST_INTERVALS:
        raise UnsolvedError(
            f"flutter_onsets: no friction up to mu_max = {mu_max:g} can be told apart at theta = {theta:g} "
            f"below fmax = {fmax:g} Hz; choose a smaller band"
        )
    crossings = []
    for low, high, pole in brackets[:count]:
        system = (int(pole), p, a, b, d1, d2)
        omega = brentq(onset_function, low, high, args=system, xtol=1e-300, rtol=1e-14)
        mu = onset_friction(omega, *system)
        if 0.0 < mu <= mu_max:
            # d Re(phi) / d mu has the sign of d Im(mu) / d omega, and Im(mu) that of W.
            crossings.append((mu, omega * fmax, bool(onset_function(high, *system) > 0.0)))
    return sorted(crossings)


@kernel
def axis_point(omega: float, d1: float, d2: float) -> tuple[float, float]:
    """Parts x and y of lambda = -(phi^2 + d1 phi) / (1 + d2 phi) = x - i y on the path."""
    if omega > 1.0:
        s, square = omega - 1.0, 1.0 + (omega - 1.0) ** 2
        scale = 1.0 / ((1.0 + d2 * s) ** 2 + d2 * d2)
        return (1.0 - s * (s + d1) - d2 * square * (s + d1)) * scale, (2.0 * s + d1 + d2 * square) * scale
    scale = 1.0 / (1.0 + (d2 * omega) ** 2)
    return omega * omega * (1.0 - d1 * d2) * scale, omega * (d1 + d2 * omega * omega) * scale


@kernel
def receptances(
    omega: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float
) -> tuple[complex, complex]:
    """A_r + i A_i and B_r + i B_i at omega, with the pole p[n] taken out."""
    x, y = axis_point(omega, d1, d2)
    ar, ai, br, bi = 0.0, 0.0, 0.0, 0.0
    for i in range(len(p)):
        shift, distance = p[n] - p[i], p[i] - x
        real, imaginary = 1.0, 0.0
        if shift != 0.0:
            square = distance * distance + y * y
            imaginary = shift / square
            # Not 1 + imaginary * distance, which cancels for a pole far above the band.
            real = ((p[n] - x) * distance + y * y) / square
        ar += a[i] * real
        ai += a[i] * imaginary
        br += b[i] * real
        bi += b[i] * imaginary
    return complex(ar, ai), complex(br, bi)


@kernel
def onset_function(omega: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float) -> float:
    """W, whose zeros are the onsets and recoveries."""
    ra, rb = receptances(omega, n, p, a, b, d1, d2)
    return ra.imag * rb.real - ra.real * rb.imag


@kernel
def onset_friction(omega: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float) -> float:
    """Real part of mu = -A / B."""
    ra, rb = receptances(omega, n, p, a, b, d1, d2)
    y = axis_point(omega, d1, d2)[1]
    return -(complex(ra.real, y * ra.imag) / complex(rb.real, y * rb.imag)).real


@kernel
def _judge(
    low: float, high: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float, mu_max: float
) -> int:
    """0 if no onset lies in (low, high), 1 if exactly one zero of W does, 2 if the interval must be halved."""
    middle, width = 0.5 * (low + high), high - low
    half = 0.5 * width
    x, y = axis_point(middle, d1, d2)
    # Bounds on the first and second derivative of lambda = n / q with respect to omega, which is at least |phi|.
    q = np.hypot(1.0, d2 * min(low, 1.0))
    l1 = (2.0 * high + d1 + high * (high + d1) * d2 / q) / q
    l2 = (2.0 + 2.0 * d2 * l1) / q
    # Sums over |p_n - p_i| u^k (|a_i| + i |b_i|), where 1 / u is the least |p_i - lambda|.
    s2, s3, s4 = 0j, 0j, 0j
    for i in range(len(p)):
        shift = abs(p[n] - p[i])
        if shift == 0.0:
            continue
        clear = np.hypot(p[i] - x, y) - l1 * half
        if clear <= 0.0:
            return 2
        u = 1.0 / clear
        share = complex(abs(a[i]), abs(b[i])) * (shift * u * u)
        s2 += share
        s3 += share * u
        s4 += share * (u * u)
    # Bounds on first and second derivatives of A + i B: whole (w), and of the parts divided by y (i).
    w1, w2, i1, i2 = l1 * s2, 2.0 * l1 * l1 * s3 + l2 * s2, 2.0 * l1 * s3, 6.0 * l1 * l1 * s4 + 2.0 * l2 * s3
    aw1, bw1, ai1, bi1 = w1.real, w1.imag, i1.real, i1.imag
    # An onset outside (0, mu_max] is not wanted.
    ra, rb = receptances(middle, n, p, a, b, d1, d2)
    size_a, size_b = np.hypot(ra.real, y * ra.imag), np.hypot(rb.real, y * rb.imag)
    product = ra.real * rb.real + y * y * ra.imag * rb.imag
    if size_a - aw1 * half > mu_max * (size_b + bw1 * half):
        return 0
    if product > (size_a * bw1 + size_b * aw1 + aw1 * bw1 * half) * half:
        return 0
    ar, br = abs(ra.real) + aw1 * half, abs(rb.real) + bw1 * half
    ai, bi = abs(ra.imag) + ai1 * half, abs(rb.imag) + bi1 * half
    curvature = i2.real * br + 2.0 * ai1 * bw1 + ai * w2.imag + w2.real * bi + 2.0 * aw1 * bi1 + ar * i2.imag
    bound = curvature * width * width
    w_low, w_high = onset_function(low, n, p, a, b, d1, d2), onset_function(high, n, p, a, b, d1, d2)
    if (w_low > 0.0) == (w_high > 0.0):
        return 0 if min(abs(w_low), abs(w_high)) > 0.125 * bound else 2
    return 1 if abs(w_high - w_low) > bound else 2


@kernel
def isolate(p: Array, a: Array, b: Array, d1: float, d2: float, mu_max: float, brackets: Array) -> tuple[int, int]:
    """Fill `brackets` with low, high and pole index of each zero of W; return how many, and intervals judged."""
    found, judged, low, width = 0, 0, 0.0, 1.0 / 64.0
    while low < END and judged < MOST_INTERVALS:
        high = min(low + width, 1.0 if low < 1.0 else END)
        n = nearest_pole(axis_point(0.5 * (low + high), d1, d2)[0], p)
        verdict = _judge(low, high, n, p, a, b, d1, d2, mu_max)
        judged += 1
        # Two zeros this close count as one.
        if verdict == 2 and high - low > 1e-13:
            width = 0.5 * (high - low)
            continue
        if verdict != 0:
            w_low, w_high = onset_function(low, n, p, a, b, d1, d2), onset_function(high, n, p, a, b, d1, d2)
            if (w_low > 0.0) != (w_high > 0.0):
                brackets[found, 0], brackets[found, 1], brackets[found, 2] = low, high, n
                found += 1
        low, width = high, 2.0 * width
    return found, judged
