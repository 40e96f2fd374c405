"""Search for flutter onsets: the friction at which steady sliding loses its stability, by isolated roots.

On the imaginary axis, phi = i omega, the undamped eigenvalue is lambda = x - i y and mu = -A / B with A = h_NN,
B = h_NT there. mu is real, at an onset, where W = A_i B_r - A_r B_i = 0 with A = A_r - i y A_i, B = B_r - i y B_i;
without damping, y = 0, two real eigenvalues meet there. A and B are multiplied by (p_n - lambda) of the nearest
pole, which changes no zero. No pair of zeros is missed: an interval is left only when a bound on |W''| shows that
W keeps its sign in it or is monotone, or when mu is shown to stay outside (0, mu_max].

The same holds on the closed path around the growing modes of the band: up the imaginary axis to phi = i, along the
top of the band to |phi| = 2, on that circle to phi = 2 and along the real axis to 0. Zeros of W on the first three
parts are all places where a pair of modes enters or leaves, so they count the growing pairs at any friction; the
least mu on the real axis is where a motion begins to grow without oscillation. Kernels take phi in units of
2 pi fmax, p in units of its square, and d1 and d2 accordingly; omega is the arc length of the path.
"""

from __future__ import annotations

import numpy as np

from fivcore.beams.modes import EPS
from fivcore.errors import UnsolvedError
from fivcore.jit import Array, kernel

# Hundreds of intervals are usual; a search that needs more than this has met an identically vanishing W.
MOST_INTERVALS = 100_000
NONE, ONE, SPLIT = 0, 1, 2
# Where the path reaches |phi| = 2, which is where `sliding_modes` ends, and phi = 2.
PATH_TOP, ARC = 1.0 + 3.0**0.5, 1.0 + 3.0**0.5 + np.pi / 3.0
# Samples of the real axis, 20 a decade, and the first of them.
REAL, FIRST = 147, 1e-7


@kernel
def contour(omega: float) -> complex:
    """Point of the path, phi in units of 2 pi fmax."""
    if omega <= 1.0:
        return complex(0.0, omega)
    angle = np.pi / 6.0 - 0.5 * (omega - PATH_TOP)
    return complex(omega - 1.0, 1.0) if omega <= PATH_TOP else 2.0 * complex(np.cos(angle), np.sin(angle))


@kernel
def axis_point(omega: float, d1: float, d2: float) -> tuple[float, float]:
    """Parts x and y of lambda = -(phi^2 + d1 phi) / (1 + d2 phi) = x - i y on the path."""
    phi = contour(omega)
    s, c = phi.real, phi.imag
    scale = 1.0 / ((1.0 + d2 * s) ** 2 + (d2 * c) ** 2)
    x = (c * c - s * (s + d1)) * (1.0 + d2 * s) - (2.0 * s + d1) * d2 * c * c
    return x * scale, c * (2.0 * s + d1 + d2 * (s * s + c * c)) * scale


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
            share = 1.0 / (distance * distance + y * y)
            imaginary = shift * share
            # Not 1 + imaginary * distance, which cancels for a pole far above the band.
            real = ((p[n] - x) * distance + y * y) * share
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
def classify_interval(
    low: float, high: float, w: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float, mu_max: float
) -> tuple[int, float, float]:
    """NONE if no onset lies in (low, high), ONE if exactly one zero of W does, else SPLIT: it must be halved.

    Also returns W at both ends, NaN if unknown; w is its value at the lower end, if known.
    """
    middle, width = 0.5 * (low + high), high - low
    half = 0.5 * width
    x, y = axis_point(middle, d1, d2)
    # Bounds on the first and second derivative of lambda = n / q with respect to omega; |phi| is at most `size`.
    size, q = min(high, 2.0), np.hypot(1.0, d2 * min(low, 1.0))
    l1 = (2.0 * size + d1 + size * (size + d1) * d2 / q) / q
    l2 = (2.0 + 2.0 * d2 * l1) / q + (0.5 * l1 if low >= PATH_TOP else 0.0)
    # Sums over |p_n - p_i| u^k (|a_i| + i |b_i|), where 1 / u is the least |p_i - lambda|.
    s2, s3, s4 = 0j, 0j, 0j
    for i in range(len(p)):
        shift = abs(p[n] - p[i])
        if shift == 0.0:
            continue
        clear = np.sqrt((p[i] - x) ** 2 + y * y) - l1 * half
        if clear <= 0.0:
            return SPLIT, w, np.nan
        u = 1.0 / clear
        # Real and imaginary parts separately, since a complex product would cost more.
        of_a, of_b, square = abs(a[i]) * (shift * u * u), abs(b[i]) * (shift * u * u), u * u
        s2 += complex(of_a, of_b)
        s3 += complex(of_a * u, of_b * u)
        s4 += complex(of_a * square, of_b * square)
    # Bounds on first and second derivatives of A + i B: whole (w), and of the parts divided by y (i).
    w1, w2, i1, i2 = l1 * s2, 2.0 * l1 * l1 * s3 + l2 * s2, 2.0 * l1 * s3, 6.0 * l1 * l1 * s4 + 2.0 * l2 * s3
    aw1, bw1, ai1, bi1 = w1.real, w1.imag, i1.real, i1.imag
    # Onsets outside (0, mu_max] are ignored.
    ra, rb = receptances(middle, n, p, a, b, d1, d2)
    size_a, size_b = np.hypot(ra.real, y * ra.imag), np.hypot(rb.real, y * rb.imag)
    product = ra.real * rb.real + y * y * ra.imag * rb.imag
    if size_a - aw1 * half > mu_max * (size_b + bw1 * half):
        return NONE, w, np.nan
    if product > (size_a * bw1 + size_b * aw1 + aw1 * bw1 * half) * half:
        return NONE, w, np.nan
    ar, br = abs(ra.real) + aw1 * half, abs(rb.real) + bw1 * half
    ai, bi = abs(ra.imag) + ai1 * half, abs(rb.imag) + bi1 * half
    curvature = i2.real * br + 2.0 * ai1 * bw1 + ai * w2.imag + w2.real * bi + 2.0 * aw1 * bi1 + ar * i2.imag
    bound = curvature * width * width
    w_low = onset_function(low, n, p, a, b, d1, d2) if np.isnan(w) else w
    w_high = onset_function(high, n, p, a, b, d1, d2)
    if (w_low > 0.0) == (w_high > 0.0):
        return NONE if min(abs(w_low), abs(w_high)) > 0.125 * bound else SPLIT, w_low, w_high
    return ONE if abs(w_high - w_low) > bound else SPLIT, w_low, w_high


@kernel
def isolate(p: Array, a: Array, b: Array, d1: float, d2: float, mu_max: float, brackets: Array) -> tuple[int, int]:
    """Fill `brackets` with low, high and pole index of each zero of W; return how many, and intervals judged."""
    found, judged, low, width, w_low, last = 0, 0, 0.0, 1.0 / 64.0, np.nan, -1
    while low < ARC and judged < MOST_INTERVALS:
        high = min(low + width, 1.0 if low < 1.0 else PATH_TOP if low < PATH_TOP else ARC)
        n = int(np.argmin(np.abs(p - axis_point(0.5 * (low + high), d1, d2)[0])))
        w_low, last = w_low if n == last else np.nan, n
        verdict, w_low, w_high = classify_interval(low, high, w_low, n, p, a, b, d1, d2, mu_max)
        judged += 1
        # Two zeros this close count as one.
        if verdict == SPLIT and high - low > 1e-13:
            width = 0.5 * (high - low)
            continue
        if verdict == SPLIT:
            w_low, w_high = onset_function(low, n, p, a, b, d1, d2), onset_function(high, n, p, a, b, d1, d2)
        if verdict != NONE and (w_low > 0.0) != (w_high > 0.0):
            brackets[found, 0], brackets[found, 1], brackets[found, 2] = low, high, n
            found += 1
        low, width, w_low = high, 1.3 * width, w_high
    return found, judged


@kernel
def onset_root(low: float, high: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float) -> float:
    """Zero of W between low and high, to rounding (Chandrupatla, Adv. Eng. Software 28, 1997, 145-149)."""
    x0, x1, f0, f1 = low, high, onset_function(low, n, p, a, b, d1, d2), onset_function(high, n, p, a, b, d1, d2)
    share, best = 0.5, low
    for _ in range(200):
        x = x0 + share * (x1 - x0)
        f = onset_function(x, n, p, a, b, d1, d2)
        # x2 is the end that the new point replaces, x1 the end on the other side of the zero.
        x2, f2 = x0, f0
        if (f > 0.0) != (f0 > 0.0):
            x2, f2, x1, f1 = x1, f1, x0, f0
        x0, f0 = x, f
        best = x0 if abs(f0) < abs(f1) else x1
        least = 2.0 * EPS * best / abs(x1 - x0)
        if least > 0.5 or f == 0.0:
            break
        # Inverse quadratic interpolation if it is monotone, otherwise bisection.
        xi, slope = (x0 - x1) / (x2 - x1), (f0 - f1) / (f2 - f1)
        share = 0.5
        if slope * slope < xi and (1.0 - slope) ** 2 < 1.0 - xi:
            share = f0 / (f1 - f0) * f2 / (f1 - f2) + (x2 - x0) / (x1 - x0) * f0 / (f2 - f0) * f1 / (f2 - f1)
        share = min(1.0 - least, max(least, share))
    return best


@kernel
def isolated_crossings(
    p: Array, a: Array, b: Array, d1: float, d2: float, mu_max: float, brackets: Array
) -> tuple[Array, int]:
    """Friction up to mu_max, place on the path and change of the number of growing eigenvalues, (k, 3).

    Ascending in place, with real eigenvalues at phi = 2; and how many intervals were judged.
    """
    if not np.any(b):
        return np.empty((0, 3)), 0
    number, judged = isolate(p, a, b, d1, d2, mu_max, brackets)
    found, count = np.empty((number + 1, 3)), 0
    for i in range(number + 1):
        # At phi = 2 a real eigenvalue enters, or leaves where mu(lambda) rises outwards.
        omega, n = ARC, 0
        change = -1.0 if onset_function(ARC, 0, p, a, b, d1, d2) > 0.0 else 1.0
        if i < number:
            low, high, n = brackets[i, 0], brackets[i, 1], int(brackets[i, 2])
            omega = onset_root(low, high, n, p, a, b, d1, d2)
            # d Re(phi) / d mu has the sign of d Im(mu) / d omega, and Im(mu) that of W.
            change = 2.0 if onset_function(high, n, p, a, b, d1, d2) > 0.0 else -2.0
        mu = onset_friction(omega, n, p, a, b, d1, d2)
        if 0.0 < mu <= mu_max:
            found[count, 0], found[count, 1], found[count, 2] = mu, omega, change
            count += 1
    return found[:count], judged


@kernel
def _inverse_friction(log_phi: float, p: Array, c: Array, a: Array, b: Array) -> float:
    """B / A at a real exponent."""
    phi, A, B = np.exp(log_phi), 0.0, 0.0
    for i in range(len(p)):
        soft = 1.0 / (p[i] + phi * (c[i] + phi))
        A, B = A + a[i] * soft, B + b[i] * soft
    return B / A


@kernel
def divergence_onset(p: Array, c: Array, a: Array, b: Array, mu_max: float) -> float:
    """Least friction up to mu_max at which an exponent is real and grows, at most phi = 2; NaN without one.

    For phi > 0 every term of A is positive and has no resonance, so 1 / mu = -B / A is a smooth function of
    log(phi), and its largest value gives the smallest friction.
    """
    logs, values = np.linspace(np.log(FIRST), np.log(2.0), REAL), np.empty(REAL)
    for k in range(REAL):
        values[k] = _inverse_friction(logs[k], p, c, a, b)
    k = int(np.argmin(values))
    low, high, lowest = logs[max(k - 1, 0)], logs[min(k + 1, REAL - 1)], values[k]
    for _ in range(50):
        third = (high - low) / 3.0
        one, other = _inverse_friction(low + third, p, c, a, b), _inverse_friction(high - third, p, c, a, b)
        lowest = min(lowest, one, other)
        low, high = (low, high - third) if one < other else (low + third, high)
    return -1.0 / lowest if lowest * mu_max <= -1.0 else np.nan


def endless(mu_max: float, fmax: float, where: str = "") -> UnsolvedError:
    """The error for a search that needs MOST_INTERVALS; fmax in Hz."""
    return UnsolvedError(
        f"flutter onsets up to mu_max = {mu_max:g}{where} below fmax = {fmax:g} Hz: the search needs too many"
        " intervals; choose a smaller band"
    )
