"""Compiled kernels of the flutter onsets: where an eigenvalue of the damped rig crosses the imaginary axis.

On the axis, phi = i omega, the undamped eigenvalue is lambda = x - i y with y >= 0 the effect of damping, and
mu = -A / B with A = h_NN(lambda), B = h_NT(lambda). An onset is a frequency at which this mu is real, and
that is a zero of

    W = A_i B_r - A_r B_i,        A = A_r - i y A_i,   B = B_r - i y B_i.

Dividing the imaginary parts by y keeps W finite without damping, where A_i and B_i become derivatives and
W = 0 says that mu(lambda) is stationary: two real eigenvalues meet. A and B are multiplied by (p_n - lambda)
of the pole nearest to the interval looked at, which changes no zero and takes the pole away.

The search cannot miss a pair of zeros: an interval is left alone only when a bound on |W''| shows that W
keeps its sign in it, when mu is shown to stay outside (0, mu_max], or when W is shown to be monotone.

Units: omega in units of 2 pi fmax, so p in units of its square, d1 and d2 to match.
"""

from __future__ import annotations

import numpy as np

from fivcore.jit import Array, kernel

# Intervals narrower than this (of the band) are not halved any more: two zeros so close are one.
NARROWEST = 1e-13
# A search that needs more intervals than this has met a W that vanishes altogether; hundreds are usual.
MOST_INTERVALS = 100_000


@kernel
def axis_point(omega: float, d1: float, d2: float) -> tuple[float, float]:
    """X and y of lambda = -(phi^2 + d1 phi) / (1 + d2 phi) at phi = i omega."""
    scale = 1.0 / (1.0 + (d2 * omega) ** 2)
    return omega * omega * (1.0 - d1 * d2) * scale, omega * (d1 + d2 * omega * omega) * scale


@kernel
def gap_parts(
    omega: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float
) -> tuple[float, float, float, float, float]:
    """A_r, A_i, B_r, B_i and y at omega, with the pole p[n] taken out."""
    x, y = axis_point(omega, d1, d2)
    ar, ai, br, bi = a[n], 0.0, b[n], 0.0
    for i in range(len(p)):
        if i != n:
            distance = p[i] - x
            shift = p[n] - p[i]
            if shift == 0.0:
                ar += a[i]
                br += b[i]
                continue
            square = distance * distance + y * y
            imaginary = shift / square
            # Not 1 + imaginary * distance, which cancels for a pole far above the band.
            real = ((p[n] - x) * distance + y * y) / square
            ar += a[i] * real
            ai += a[i] * imaginary
            br += b[i] * real
            bi += b[i] * imaginary
    return ar, ai, br, bi, y


@kernel
def onset_function(omega: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float) -> float:
    """W, whose zeros are the onsets and recoveries."""
    ar, ai, br, bi, _ = gap_parts(omega, n, p, a, b, d1, d2)
    return ai * br - ar * bi


@kernel
def onset_friction(omega: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float) -> float:
    """Real part of mu = -A / B."""
    ar, ai, br, bi, y = gap_parts(omega, n, p, a, b, d1, d2)
    return -(ar * br + y * y * ai * bi) / (br * br + y * y * bi * bi)


@kernel
def _nearest(omega: float, p: Array, d1: float, d2: float) -> int:
    x, _ = axis_point(omega, d1, d2)
    best = 0
    for i in range(1, len(p)):
        if abs(p[i] - x) < abs(p[best] - x):
            best = i
    return best


@kernel
def _judge(
    low: float, high: float, n: int, p: Array, a: Array, b: Array, d1: float, d2: float, mu_max: float
) -> int:
    """0: no onset in (low, high); 1: exactly one zero of W; 2: cannot tell, halve."""
    middle, width = 0.5 * (low + high), high - low
    half = 0.5 * width
    x, y = axis_point(middle, d1, d2)
    # Bounds on the first and second derivative of lambda = n / q with respect to omega.
    slope, size, q = 2.0 * high + d1, high * (high + d1), np.hypot(1.0, d2 * low)
    l1 = (slope + size * d2 / q) / q
    l2 = (2.0 + 2.0 * d2 * (slope + size * d2 / q) / q) / q
    reach = l1 * half
    ar, ai, br, bi, _ = gap_parts(middle, n, p, a, b, d1, d2)
    # Bounds on first and second derivatives: of A and B whole (w), of the parts divided by y (i).
    aw1, aw2, ai1, ai2 = 0.0, 0.0, 0.0, 0.0
    bw1, bw2, bi1, bi2 = 0.0, 0.0, 0.0, 0.0
    for i in range(len(p)):
        shift = abs(p[n] - p[i])
        if shift == 0.0:
            continue
        clear = np.hypot(p[i] - x, y) - reach
        if clear <= 0.0:
            return 2
        u = 1.0 / clear
        first = shift * l1 * u * u
        second = shift * (2.0 * l1 * l1 * u + l2) * u * u
        first_i = 2.0 * first * u
        second_i = shift * (6.0 * l1 * l1 * u + 2.0 * l2) * u * u * u
        aa, bb = abs(a[i]), abs(b[i])
        aw1 += aa * first
        aw2 += aa * second
        ai1 += aa * first_i
        ai2 += aa * second_i
        bw1 += bb * first
        bw2 += bb * second
        bi1 += bb * first_i
        bi2 += bb * second_i

    # Is mu elsewhere? Then nobody asks for the onset.
    size_a, size_b = np.hypot(ar, y * ai), np.hypot(br, y * bi)
    if size_a - aw1 * half > mu_max * (size_b + bw1 * half):
        return 0
    product = ar * br + y * y * ai * bi
    if product > (size_a * bw1 + size_b * aw1 + aw1 * bw1 * half) * half:
        return 0

    most_ar, most_br = abs(ar) + aw1 * half, abs(br) + bw1 * half
    most_ai, most_bi = abs(ai) + ai1 * half, abs(bi) + bi1 * half
    curvature = ai2 * most_br + 2.0 * ai1 * bw1 + most_ai * bw2 + aw2 * most_bi + 2.0 * aw1 * bi1 + most_ar * bi2
    w_low = onset_function(low, n, p, a, b, d1, d2)
    w_high = onset_function(high, n, p, a, b, d1, d2)
    if (w_low > 0.0) == (w_high > 0.0):
        return 0 if min(abs(w_low), abs(w_high)) > 0.125 * curvature * width * width else 2
    return 1 if abs(w_high - w_low) > curvature * width * width else 2


@kernel
def isolate(p: Array, a: Array, b: Array, d1: float, d2: float, mu_max: float, brackets: Array) -> tuple[int, int]:
    """Fill `brackets` (k, 3) with low, high and pole index, one zero of W each.

    Returns how many there are (more than fit are counted, not kept) and how many intervals were judged.
    """
    found, judged = 0, 0
    width = 1.0 / 64.0
    low = 0.0
    while low < 1.0 and judged < MOST_INTERVALS:
        high = min(low + width, 1.0)
        n = _nearest(0.5 * (low + high), p, d1, d2)
        verdict = _judge(low, high, n, p, a, b, d1, d2, mu_max)
        judged += 1
        if verdict == 2 and high - low > NARROWEST:
            width = 0.5 * (high - low)
            continue
        if verdict != 0:
            w_low = onset_function(low, n, p, a, b, d1, d2)
            w_high = onset_function(high, n, p, a, b, d1, d2)
            if (w_low > 0.0) != (w_high > 0.0):
                if found < len(brackets):
                    brackets[found, 0] = low
                    brackets[found, 1] = high
                    brackets[found, 2] = n
                found += 1
        low = high
        width = 2.0 * width
    return found, judged
