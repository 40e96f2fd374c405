"""All exponents of steady sliding in a frequency band: dense eigenproblem and Newton refinement.

With the contact closed, n q = 0, and T' = m N' + k d(g_T)/dt, the exponents phi are the roots of

    f(phi) = h_NN + m h_NT - k phi (h_NN h_TT - h_NT^2) = 0,    h_ab = sum_i a_i b_i / (p_i + c_i phi + phi^2)

over the modes p, c, n, t of the structure with open contact. m is the coefficient of friction at the sliding
speed, and k, N s/m, is 0 unless friction falls with the speed (`fivcore.stability.falling`). The inverse of the
pencil at a real shift is a diagonal matrix with an update of rank one (two with k). LAPACK computes all its
eigenvalues, with only a few compressed far modes (`fivcore.contact.compression`). Newton steps on f with more of
them refine all digits.

Without k and with Rayleigh damping, f is a function of the undamped eigenvalue lambda (rad2/s2; section 3.4 of the
paper), with phi^2 + (d1 + d2 lambda) phi + lambda = 0: p - lambda replaces p + c phi + phi^2, and the eigenproblem
has half the size.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from fivcore.beams.modes import EPS, one_blas_thread
from fivcore.contact.compression import BLOCKS, FAR, FAR_MODAL, STATIC_NODE, compressed, interpolated
from fivcore.errors import InputError
from fivcore.jit import Array, Complex, kernel
from fivcore.structure import Structure

# Exponents are listed up to |phi| = LARGEST_PHI; undamped eigenvalues up to LARGEST times the largest of the band.
LARGEST_PHI, LARGEST = 2.0, 5.0
# `FAR` and `BLOCKS` of the eigenproblem; range of its eigenvalues relative to that of the listed ones.
COARSE_FAR, COARSE_BLOCKS, MARGIN = 9.0, 2, 1.02
# Damping below FAINT counts as zero. Among the real SHIFTS the one with f farthest from 0 is used. Newton steps
# may move a root by at most the fraction FURTHEST of its magnitude.
FAINT, SHIFTS, FURTHEST = 1e-12, (1.3, 0.55, 2.4), 0.05
# Roots closer than this fraction of their magnitude may coincide.
DISTINCT = 1e-7
# Matrix size up to which LAPACK uses one thread anyway, so threads of a sweep need no lock.
ONE_THREAD = 64
# With falling friction STIFF * d2 * 2 pi fmax is at most 1, unless there are few modes. Points solved together.
STIFF, CROWD = 5.0, 200
POINTS_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class BandModes:
    """Modes of a structure in a band, in units of omega.

    Attributes
    ----------
    omega : float
        2 pi fmax, rad/s.
    largest : float
        The largest |lambda| on the imaginary axis of the band: 1 but for heavy damping.
    p, c, residues : ndarray, (n,) and (3, n)
        Squared frequency, damping, and products n n, n t and t t of all modes that move a gap; far modes
        compressed.
    few : tuple of ndarray
        p, c, (k,), and n, t, (2, k), of fewer modes for the eigenproblem.
    uncoupled : ndarray, (any,)
        Exponents of modes with a node at the contact; their lambda where `rayleigh` is given.
    rayleigh : (float, float) or None
        d1 and d2; None with modal damping or where friction falls.
    """

    omega: float
    largest: float
    p: Array
    c: Array
    residues: Array
    few: tuple[Array, Array, Array]
    uncoupled: Array | Complex
    rayleigh: tuple[float, float] | None


@lru_cache(maxsize=128)
def band_modes(own: Structure, fmax: float, falling: bool = False) -> BandModes:
    """The modes of a structure in a band, cached; `falling` keeps those that move the tangential gap alone."""
    omega = 2.0 * np.pi * fmax
    modal = own.rayleigh is None and own.damping.max() > FAINT * omega
    rayleigh = None if modal else (own.d1 / omega, own.d2 * omega)
    p, c, g = own.stiffness / omega**2, own.damping / omega, np.stack([own.normal, own.tangential]) / omega
    # Static modes act by their compliance alone in any band.
    further = np.maximum(1.0 / (STATIC_NODE * p[len(own.frequency) :]), 1.0)
    p[len(own.frequency) :] *= further
    g[:, len(own.frequency) :] *= np.sqrt(further)
    largest = 1.0
    if rayleigh:
        # They are damped like all others.
        c = rayleigh[0] + rayleigh[1] * p
        largest = max(1.0, float(np.hypot(1.0, rayleigh[0]) / np.hypot(1.0, rayleigh[1])))
    order = np.lexsort((c, p))
    p, c, g = p[order], c[order], g[:, order]
    new = np.diff(p, prepend=-np.inf) > 4.0 * EPS * p
    new |= np.abs(np.diff(c, prepend=-np.inf)) > 4.0 * EPS * np.maximum(c, np.sqrt(p))
    for same in [] if new.all() else np.split(np.arange(len(p)), np.flatnonzero(new)[1:]):
        # Of modes with a common pole, two combinations move the gaps: one both gaps, one the tangential gap only.
        if len(same) > 1:
            first = slice(None, None, 1 if g[0, same].any() else -1)
            turned = np.asarray(np.linalg.qr(g[first, same].T, mode="r")).T[first]
            g[:, same] = np.pad(turned, ((0, 0), (0, len(same) - 2)))
    # A mode with a node at the contact keeps its exponents, because its root equals the pole to rounding.
    compliance = (g[:, p > 0.0] ** 2 / p[p > 0.0]).sum(axis=1, keepdims=True)
    felt, moved = np.abs(g) * (np.abs(g) if falling else np.abs(g).max(axis=0)) > 1e-17 * compliance * p
    coupled = felt | (moved & falling)
    uncoupled = p[~coupled] if rayleigh and not falling else pair(p[~coupled], c[~coupled]).ravel()
    uncoupled = uncoupled[uncoupled.imag >= 0.0]
    p, c, g = p[coupled], c[coupled], np.ascontiguousarray(g[:, coupled])
    # Squared distance from the band; for an overdamped mode that of its slower exponent.
    away = p / largest if rayleigh else np.abs(pair(p, c)[0]) ** 2
    if falling and own.d2 * omega * STIFF > 1.0:
        # Exponents of stiff modes accumulate at -1 / d2, near the band.
        if own.static or len(p) > CROWD:
            raise InputError(
                f"d2 = {own.d2:g}: with friction that falls with the speed it must be at most"
                f" {1.0 / (STIFF * omega):.3g} s for fmax = {fmax:g} Hz; choose a smaller d2 or fmax"
            )
        away = np.zeros(len(p))
    few = compressed(p, c, g, away > COARSE_FAR, COARSE_BLOCKS)
    far = away > (FAR if rayleigh else FAR_MODAL)
    if rayleigh:
        p, c, g = compressed(p, c, g, far, BLOCKS)
    residues = g[[0, 0, 1]] * g[[0, 1, 1]]
    if not rayleigh and far.sum() > 2 * BLOCKS:
        p, c, residues = interpolated(p, c, residues, far)
    return BandModes(omega, largest, p, c, residues, few, uncoupled, None if falling else rayleigh)


def pair(p: Any, c: Any) -> Complex:
    """Both roots of phi^2 + c phi + p = 0, (2, n), first that with Im >= 0 or the larger of two real ones."""
    half = 0.5 * c
    root = np.sqrt(half * half - p + 0j)
    root = np.where(half.real * root.real + half.imag * root.imag < 0.0, -root, root)
    large, small = -half - root, root - half
    # The difference cancels when damping is heavy; the product of both roots is p.
    with np.errstate(divide="ignore", invalid="ignore"):
        small = np.where(np.abs(small) < 0.5 * np.abs(large), p / large, small)
    swapped = (large.imag > small.imag) | ((large.imag == small.imag) & (large.real > small.real))
    return np.where(swapped, [large, small], [small, large]) + 0j


@kernel
def clearest_shift(
    m: float, k: float, p: Array, c: Array, power: float, n: Array, t: Array, unit: float
) -> tuple[float, float, float, float]:
    """The one of SHIFTS, in units of `unit`, where f is farthest from 0, and h_NN, h_NT and h_TT there."""
    best, clearest = (0.0, 0.0, 0.0, 0.0), -1.0
    for shift in SHIFTS:
        z = unit * shift
        soft = 1.0 / (p + z * (c + power * z))
        A, B, C = np.sum(n * n * soft), np.sum(n * t * soft), np.sum(t * t * soft)
        falling = k * z * (A * C - B * B)
        clear = abs(A + m * B - falling) / (A + abs(m * B) + falling)
        if clear > clearest:
            best, clearest = (z, A, B, C), clear
    return best


@kernel
def undamped_inverse(m: Array, p: Array, n: Array, t: Array, largest: float) -> tuple[Array, Array]:
    """Matrices with the eigenvalues 1 / (lambda - shift), (points, size, size), and their shifts."""
    size, inverse, shifts, c = len(p), np.zeros((len(m), len(p), len(p))), np.empty(len(m)), np.full(len(p), -1.0)
    for point in range(len(m)):
        shifts[point], A, B, _ = clearest_shift(m[point], 0.0, p, c, 0.0, n, t, -largest)
        d = 1.0 / (p - shifts[point])
        for i in range(size):
            force = d[i] * (n[i] + m[point] * t[i]) / (A + m[point] * B)
            for j in range(size):
                inverse[point, i, j] = -force * n[j] * d[j]
            inverse[point, i, i] += d[i]
    return inverse, shifts


@kernel
def damped_inverse(m: Array, k: Array, p: Array, c: Array, n: Array, t: Array) -> tuple[Array, Array]:
    """Matrices with the eigenvalues 1 / (phi - shift), (points, 2 size, 2 size), and their shifts.

    The state is q and v = phi q. With the shift s and d = 1 / (p + s c + s^2) it solves the linear equations

        v = s q + x,  q = -d ((c + s) x + y) + d n N + d t (m N + T),  n q = 0,  T = k t v

    for given x and y: (q, v) = inverse (x, y).
    """
    size, inverse, shifts = len(p), np.zeros((len(m), 2 * len(p), 2 * len(p))), np.empty(len(m))
    for point in range(len(m)):
        s, A, B, C = clearest_shift(m[point], k[point], p, c, 1.0, n, t, 1.0)
        shifts[point], d = s, 1.0 / (p + s * (c + s))
        # The equations for N and T, that for T divided by 1 + k s C, which may be large.
        scale = 1.0 + k[point] * s * C
        a11, a12 = A + m[point] * B, B
        a21, a22 = k[point] * s * (B + m[point] * C) / scale, (k[point] * s * C - 1.0) / scale
        determinant = a11 * a22 - a12 * a21
        for j in range(2 * size):
            i, of_x = j % size, 1.0 if j < size else 0.0
            share = -d[i] * (c[i] + s if j < size else 1.0)
            first, second = n[i] * share, k[point] * t[i] * (s * share + of_x) / scale
            N = (a12 * second - a22 * first) / determinant
            T = (a21 * first - a11 * second) / determinant
            for row in range(size):
                q = d[row] * (n[row] * N + t[row] * (m[point] * N + T)) + (share if row == i else 0.0)
                inverse[point, row, j] = q
                inverse[point, size + row, j] = s * q + (of_x if row == i else 0.0)
    return inverse, shifts


def eigenvalues(inverse: Array, shifts: Array) -> Complex:
    """Eigenvalues of matrices given by their inverses at the shifts, (points, size); infinite if there is none."""
    with one_blas_thread() if inverse.shape[1] > ONE_THREAD else nullcontext(), np.errstate(all="ignore"):
        return np.asarray(shifts[:, None] + 1.0 / np.linalg.eigvals(inverse).astype(complex))


def exponents(modes: BandModes, m: Array, k: Array) -> Complex:
    """All exponents of the band, (points, any), NaN-padded: lambda if `rayleigh` is given, else phi with Im >= 0.

    m and k, N s/m, are (points,). The last columns are `modes.uncoupled`.
    """
    (p, c, (n, t)), parts = modes.few, []
    power, dashpots, largest = 1.0, modes.c, LARGEST_PHI
    if modes.rayleigh:
        power, dashpots, largest = 0.0, -np.ones(len(modes.p)), LARGEST * modes.largest
    for i in range(0, max(len(m), 1), POINTS_AT_ONCE):
        friction, fall = m[i : i + POINTS_AT_ONCE], modes.omega * k[i : i + POINTS_AT_ONCE]
        starts = eigenvalues(*undamped_inverse(friction, p, n, t, modes.largest))
        if not modes.rayleigh:
            starts, whole = damped_starts(starts, friction, fall, p, c, n, t)
            starts[~whole] = eigenvalues(*damped_inverse(friction[~whole], fall[~whole], p, c, n, t))
        parts.append(polished(starts, friction, fall, modes.p, dashpots, modes.residues, power, largest))
    found = np.concatenate(parts)
    found = found[:, : np.count_nonzero(~np.isnan(found), axis=1).max(initial=0)]
    found = np.pad(found, ((0, 0), (0, len(modes.uncoupled))))
    found[:, found.shape[1] - len(modes.uncoupled) :] = modes.uncoupled
    found[np.abs(found) > largest] = complex(np.nan, np.nan)
    return found


def sliding_shape(own: Structure, phi: complex, uncoupled: bool, falling: bool = True) -> Complex:
    """Modal coordinates of an exponent, (n,), with contact forces that keep the normal gap closed.

    An uncoupled mode moves alone. Of several modes with one frequency, the result is the combination that keeps
    the normal gap, and with falling friction also the tangential gap, closed.
    """
    damping = own.damping + own.d2 * own.stiffness * (np.arange(len(own.stiffness)) >= len(own.frequency))
    n, t, distance = own.normal, own.tangential, own.stiffness + phi * (damping + phi)
    q = np.zeros(len(n), dtype=complex)
    if uncoupled:
        modes = np.flatnonzero(np.abs(distance) <= 64.0 * EPS * (own.stiffness + abs(phi) ** 2))
        closed = np.stack([n, t])[: 1 + falling, modes]
        q[modes] = np.linalg.svd(closed / np.abs(closed).max(axis=1, initial=1e-300, keepdims=True))[2][-1]
        return q
    nearest = int(np.argmin(np.where((n != 0.0) | (t != 0.0), np.abs(distance), np.inf)))
    gap, others = distance[nearest], np.arange(len(n)) != nearest
    a, b = ((n * each)[others] / distance[others] for each in (n, t))
    A, B = a.sum(), b.sum()
    normal, tangential = n[nearest] * t[nearest] + gap * B, -(n[nearest] ** 2) - gap * A
    q[others] = (n * normal + t * tangential)[others] / distance[others]
    q[nearest] = n[nearest] * B - t[nearest] * A
    if not np.any(n * t):
        # Without coupling of the gaps one of the two forces is zero.
        alone = n if abs(tangential) <= 1e-6 * (n[nearest] ** 2 + abs(gap) * np.abs(a).sum()) else t
        q[others], q[nearest] = gap * alone[others] / distance[others], alone[nearest]
    return q


@kernel
def newton_step(
    z: complex, p: Array, c: Array, power: float, rows: Array, count: int, inverse: Complex
) -> complex:
    """P / P' of P = f prod_i (p_i + c_i z + power z^2); the nearest pole is taken out of f.

    Of `rows`, n (n + m t), n n, sqrt(k) n t and k t t, only the first counts if `count` is 1 (no k), else all 4;
    as (n t)^2 = n n t t for each mode, f has no double poles. `inverse` is overwritten.
    """
    nearest, least, gap = 0, np.inf, 0j
    for i in range(len(p)):
        here = p[i] + z * (c[i] + power * z)
        square = here.real**2 + here.imag**2
        inverse[i] = complex(here.real / square, -here.imag / square)
        if square < least:
            nearest, least, gap = i, square, here
    sums, slopes, others = np.zeros(4, np.complex128), np.zeros(4, np.complex128), 0j
    for i in range(len(p)):
        if i != nearest:
            fall = (c[i] + 2.0 * power * z) * inverse[i]
            others += fall
            for r in range(count):
                term = rows[r, i] * inverse[i]
                sums[r] += term
                slopes[r] -= term * fall
    rise = c[nearest] + 2.0 * power * z
    reduced, derivative = rows[0, nearest] + gap * sums[0], rise * sums[0] + gap * slopes[0]
    if count > 1:
        a, b, t = rows[1, nearest], rows[2, nearest], rows[3, nearest]
        product = sums[1] * sums[3] - sums[2] * sums[2]
        mixed = a * sums[3] + t * sums[1] - 2.0 * b * sums[2] + gap * product
        change = a * slopes[3] + t * slopes[1] - 2.0 * b * slopes[2] + rise * product
        change += gap * (slopes[1] * sums[3] + sums[1] * slopes[3] - 2.0 * sums[2] * slopes[2])
        reduced -= z * mixed
        derivative -= mixed + z * change
    derivative += others * reduced
    return reduced / derivative if derivative != 0.0 else 0j


@kernel
def refined(
    start: complex, known: Complex, p: Array, c: Array, power: float, rows: Array, count: int, inverse: Complex
) -> Any:
    """A root by Newton steps with deflation of known roots and conjugates, and the length of the last step."""
    here, length, last = start, 0.0, np.inf
    for turn in range(30):
        step, crowd = newton_step(here, p, c, power, rows, count, inverse), 0j
        for other in known:
            away = here - other.real
            square = away * away + other.imag**2
            crowd += 2.0 * away / square if square != 0.0 else 0.0
        step = step / (1.0 - step * crowd) if step * crowd != 1.0 else step
        length = abs(step)
        # Near a double root f is dominated by rounding, and steps stop shrinking.
        if turn > 3 and length >= last and length < 1e-4 * abs(here):
            break
        here -= step
        if length <= 4.0 * EPS * abs(here):
            break
        last = length
    return here, length


@kernel
def damped_starts(values: Complex, m: Array, k: Array, p: Array, c: Array, n: Array, t: Array) -> Any:
    """Exponents of modes from their undamped eigenvalues, (points, any), and whether all were found, (points,).

    Newton steps start from the first-order effect of damping and falling friction on each eigenvalue. P of
    `newton_step` has 2 (size - 1) roots, so that many distinct roots are all of them.
    """
    size, inverse, rows = len(p), np.empty(len(p), np.complex128), np.empty((4, len(p)))
    table, whole = np.full((len(m), 2 * size), complex(np.nan, np.nan)), np.zeros(len(m), np.bool_)
    for point in range(len(m)):
        root, count, number, most = np.sqrt(k[point]), 0, 0, np.abs(values[point]).max()
        rows[0], rows[1], rows[2], rows[3] = n * (n + m[point] * t), n * n, root * n * t, k[point] * t * t
        for z in values[point]:
            if abs(z) == most:
                continue
            A, B, C, loss, slope = 0j, 0j, 0j, 0j, 0j
            for i in range(size):
                gap = p[i] - z
                soft = gap.conjugate() / (gap.real**2 + gap.imag**2 + 1e-300)
                square = rows[0, i] * soft * soft
                A, B, C = A + rows[1, i] * soft, B + rows[2, i] * soft, C + rows[3, i] * soft
                loss, slope = loss + c[i] * square, slope + square
            half = 0.5 * (loss + (A * C - B * B)) / slope if slope != 0.0 else 0j
            turn = np.sqrt(half * half - z)
            for start in (turn - half, -turn - half):
                if start.imag >= 0.0:
                    phi, rest = refined(
                        start, table[point, :count], p, c, 1.0, rows, 4 if root > 0.0 else 1, inverse
                    )
                    phi, least = complex(phi.real, abs(phi.imag)), DISTINCT * abs(phi)
                    # Far away P overflows, and steps are meaningless.
                    same = rest > least or 0.0 < phi.imag < least or not abs(phi) < 1e50
                    for i in range(count):
                        same |= abs(table[point, i] - phi) < least
                    number += -2 * size if same else 2 if phi.imag > 0.0 else 1
                    table[point, count] = phi
                    count += 1
            if number < 0:
                break
        whole[point] = number == 2 * (size - 1)
    return table, whole


@kernel
def polished(
    starts: Complex, m: Array, k: Array, p: Array, c: Array, residues: Array, power: float, top: float
) -> Complex:
    """Roots near `starts`, (points, any), refined to rounding by Newton steps, and padded with NaN.

    Listed are roots with |z| up to `top` and Im(z) from 0 to 1, or without `power` all roots and their conjugates.
    A root that Newton steps would move far keeps its start.
    """
    rows, inverse = np.empty((4, len(p))), np.empty(len(p), np.complex128)
    table = np.full(starts.shape, complex(np.nan, np.nan))
    for point in range(len(m)):
        root, count = np.sqrt(k[point]), 0
        for i in range(len(p)):
            rows[0, i] = residues[0, i] + m[point] * residues[1, i]
            rows[1, i], rows[2, i], rows[3, i] = residues[0, i], root * residues[1, i], k[point] * residues[2, i]
        for start in starts[point]:
            if not (0.0 <= power * start.imag <= MARGIN and start.imag >= 0.0 and abs(start) <= MARGIN * top):
                continue
            here, _ = refined(start, table[0, :0], p, c, power, rows, 4 if root > 0.0 else 1, inverse)
            here = here if abs(here - start) <= FURTHEST * abs(start) + 1e-9 else start
            # Growth below rounding is set to zero.
            if power > 0.0 and abs(here.real) <= 16.0 * EPS * abs(here):
                here = complex(0.0, here.imag)
            table[point, count] = here
            count += 1
            if power == 0.0 and here.imag > 0.0:
                table[point, count] = here.conjugate()
                count += 1
    return table
