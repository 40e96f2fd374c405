"""All exponents of steady sliding in a band: a dense eigenproblem, and Newton steps.

With the contact closed, n q = 0, and T' = m N' + k d(g_T)/dt, the exponents phi are the roots of

    f(phi) = h_NN + m h_NT - k phi (h_NN h_TT - h_NT^2) = 0,    h_ab = sum_i a_i b_i / (p_i + c_i phi + phi^2)

over the modes p, c, n, t of the structure with its contact open. m is the coefficient of friction at the speed of
sliding, and k, N s/m, is 0 unless friction falls with the speed (`fivcore.stability.falling`). The modes inverted
at a real shift are a diagonal with a change of rank one, or two with k, all of whose eigenvalues LAPACK finds: few
far modes are enough there (`fivcore.contact.compression`). Newton steps on f with more of them give all digits.

Without k and with Rayleigh damping f is a function of the undamped eigenvalue lambda (rad2/s2; section 3.4 of the
paper), with phi^2 + (d1 + d2 lambda) phi + lambda = 0: p - lambda is in the place of p + c phi + phi^2, and the
eigenproblem half as large.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from fivcore.beams.modes import EPS, one_blas_thread
from fivcore.contact.compression import BLOCKS, FAR, compressed, interpolated
from fivcore.errors import InputError
from fivcore.jit import Array, Complex, kernel
from fivcore.structure import Structure

# Exponents are listed up to |phi| = TOP; undamped eigenvalues up to LARGEST times the largest of the band.
TOP, LARGEST = 2.0, 5.0
# `FAR` and `BLOCKS` of the eigenproblem; how much more than what is listed its eigenvalues may be.
NEAR, FEW, MARGIN = 9.0, 2, 1.02
# Damping that is none; real shifts, of which that is used where f is farthest from 0.
FAINT, SHIFTS = 1e-12, np.array([1.3, 0.55, 2.4])
# Where friction falls: STIFF d2 2 pi fmax is at most 1, unless there are few modes. Points solved together.
STIFF, CROWD = 5.0, 200
BATCH = 256


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
        Squared frequency, damping, and n n, n t and t t of all modes that move a gap, far ones compressed.
    few : tuple of ndarray
        p, c, (k,), and n, t, (2, k), of fewer modes for the eigenproblem.
    uncoupled : ndarray, (any,)
        Exponents of modes with a node at the contact; their lambda where `rayleigh` is given.
    rayleigh : (float, float) or None
        d1 and d2; None with damping by mode or where friction falls.
    """

    omega: float
    largest: float
    p: Array
    c: Array
    residues: Array
    few: tuple[Array, Array, Array]
    uncoupled: Array | Complex
    rayleigh: tuple[float, float] | None


def damped_by_mode(own: Structure, fmax: float) -> bool:
    """Whether damping by mode changes exponents in the band."""
    return own.rayleigh is None and bool(own.damping.max() > FAINT * 2.0 * np.pi * fmax)


@lru_cache(maxsize=128)
def band_modes(own: Structure, fmax: float, falling: bool = False) -> BandModes:
    """The modes of a structure in a band, cached; `falling` keeps those that move the tangential gap alone."""
    omega = 2.0 * np.pi * fmax
    rayleigh = None if damped_by_mode(own, fmax) else (own.d1 / omega, own.d2 * omega)
    p, c, g = own.stiffness / omega**2, own.damping / omega, np.stack([own.normal, own.tangential]) / omega
    largest = 1.0
    if rayleigh:
        # Static modes are damped as all others are.
        c = rayleigh[0] + rayleigh[1] * p
        largest = max(1.0, float(np.hypot(1.0, rayleigh[0]) / np.hypot(1.0, rayleigh[1])))
    order = np.lexsort((c, p))
    p, c, g = p[order], c[order], g[:, order]
    new = np.diff(p, prepend=-np.inf) > 4.0 * EPS * p
    new |= np.abs(np.diff(c, prepend=-np.inf)) > 4.0 * EPS * np.maximum(c, np.sqrt(p))
    starts = np.flatnonzero(new)
    for first, number in zip(starts, np.diff(starts, append=len(p)), strict=True):
        # Of modes with one pole, two combinations move the gaps: one both, one the tangential gap alone.
        if number > 1:
            g[:, first : first + number] = _two_of(g[:, first : first + number])
    # A mode with a node at the contact keeps its exponents: its root is nearer to the pole than rounding.
    compliance = (g[:, p > 0.0] ** 2 / p[p > 0.0]).sum(axis=1, keepdims=True)
    felt, moved = np.abs(g) * (np.abs(g) if falling else np.abs(g).max(axis=0)) > 1e-17 * compliance * p
    coupled = felt | (moved & falling)
    hidden = p[~coupled] if rayleigh and not falling else pair(p[~coupled], c[~coupled]).ravel()
    hidden = hidden[(hidden.imag >= 0.0) & (np.abs(hidden) <= MARGIN * LARGEST * largest)]
    p, c, g = p[coupled], c[coupled], np.ascontiguousarray(g[:, coupled])
    near, far = NEAR * largest, FAR * largest
    if falling and own.d2 * omega * STIFF > 1.0:
        # Exponents of stiff modes crowd at -1 / d2, near the band.
        if own.static or len(p) > CROWD:
            raise InputError(
                f"d2 = {own.d2:g}: with friction that falls with the speed it must be at most"
                f" {1.0 / (STIFF * omega):.3g} s for fmax = {fmax:g} Hz; choose a smaller d2 or fmax"
            )
        near = far = np.inf
    few = compressed(p, c, g, near, FEW)
    if rayleigh:
        p, c, g = compressed(p, c, g, far, BLOCKS)
        residues = g[[0, 0, 1]] * g[[0, 1, 1]]
    else:
        residues, beyond = g[[0, 0, 1]] * g[[0, 1, 1]], p > far
        if beyond.sum() > 2 * BLOCKS:
            some = interpolated(p[beyond], c[beyond], residues[:, beyond])
            p, c, residues = (
                np.concatenate([each[..., ~beyond], more], axis=-1)
                for each, more in zip((p, c, residues), some, strict=True)
            )
    return BandModes(omega, largest, p, c, residues, few, hidden, None if falling else rayleigh)


def _two_of(g: Array) -> Array:
    """Gap shapes (2, m) of modes with one pole, turned so that all but two, or one, are zero."""
    turned, size = np.zeros_like(g), np.hypot.reduce(g[0])
    along = g[0] if size > 0.0 else g[1]
    along = along / max(np.hypot.reduce(along), 1e-300)
    both = along @ g[1]
    turned[0, 0], turned[1, :2] = size, (both, np.hypot.reduce(g[1] - both * along))
    return turned


def pair(p: Any, c: Any) -> Complex:
    """Both roots of phi^2 + c phi + p = 0, (2, n), those with Im >= 0 or the larger first."""
    root = np.sqrt(0.25 * c**2 - p + 0j)
    low = -0.5 * c - root
    high = np.where(np.abs(root.imag) > 0.0, root - 0.5 * c, p / np.where(low == 0.0, 1.0, low))
    return np.stack([high, low])


def undamped_roots(modes: BandModes, m: Array) -> Complex:
    """Undamped eigenvalues of the band without k, with Rayleigh damping, (points, any), with NaN; m is (points,)."""
    p, _, (n, t) = modes.few
    d = 1.0 / (p + modes.largest * SHIFTS[:, None])
    terms = d * n * (n + np.multiply.outer(m, t))[:, None]
    # As far as possible from a root.
    best = np.argmax(np.abs(terms.sum(axis=-1)) / np.abs(terms).sum(axis=-1), axis=1)
    d, terms = d[best], terms[np.arange(len(m)), best]
    inverse = (d * (n + np.multiply.outer(m, t)))[:, :, None] * (d * n)[:, None]
    inverse /= -terms.sum(axis=-1)[:, None, None]
    inverse[:, np.arange(len(p)), np.arange(len(p))] += d
    with np.errstate(divide="ignore", invalid="ignore"):
        found = 1.0 / np.linalg.eigvals(inverse) - modes.largest * SHIFTS[best][:, None]
    found = np.where((found.imag >= 0.0) & (np.abs(found) <= MARGIN * LARGEST * modes.largest), found, np.nan)
    found = _packed(found.astype(complex))
    polish(found, m, np.zeros(len(m)), modes.p, np.full(len(modes.p), -1.0), 0.0, modes.residues)
    return np.concatenate([found, np.where(found.imag > 0.0, found.conj(), np.nan)], axis=1)


def damped_roots(modes: BandModes, m: Array, k: Array) -> Complex:
    """Exponents with Im >= 0 in the band, (points, any), with NaN; m and k, in units of 1 / omega, are (points,)."""
    p, c, (n, t) = modes.few
    size, one = len(p), np.arange(len(p))
    # As far as possible from a root.
    d = 1.0 / (p + SHIFTS[:, None] * (c + SHIFTS[:, None]))
    A, B, C = (d[:, None] * np.stack([n * n, n * t, t * t])).sum(axis=-1).T
    parts = A + 0.0 * m[:, None], m[:, None] * B, -k[:, None] * SHIFTS * (A * C - B * B)
    best = np.argmax(np.abs(sum(parts)) / sum(map(np.abs, parts)), axis=1)
    d, s = d[best], SHIFTS[best][:, None]
    # State q and v = phi q, phi = s + 1 / beta: q = base y + forces (N, F), F = k d(g_T)/dt, v = s q + y_q.
    base = np.zeros((len(m), size, 2 * size))
    base[:, one, one], base[:, one, size + one] = -d * (c + s), -d
    forces = np.stack([d * (n + np.multiply.outer(m, t)), d * t], axis=2)
    rows = np.stack([np.tile(n, (len(m), 1)), (k[:, None] * s) * t], axis=1)
    known, closing = rows @ base, rows @ forces
    known[:, 1, :size] += k[:, None] * t
    closing[:, 1, 1] -= 1.0
    q = base - forces @ np.linalg.solve(closing, known)
    inverse = np.concatenate([q, s[:, :, None] * q], axis=1)
    inverse[:, size + one, one] += 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        found = s + 1.0 / np.linalg.eigvals(inverse)
    inside = (found.imag >= 0.0) & (found.imag <= MARGIN) & (np.abs(found) <= MARGIN * TOP)
    found = _packed(np.where(inside, found, np.nan).astype(complex))
    polish(found, m, k, modes.p, modes.c, 1.0, modes.residues)
    return np.where(np.abs(found.real) <= 16.0 * EPS * np.abs(found), 1j * found.imag, found)


def _packed(values: Complex) -> Complex:
    """Each row in order, its NaN last, with no more columns than needed."""
    order = np.argsort(np.isnan(values), axis=1, kind="stable")
    most = int(np.sum(~np.isnan(values), axis=1).max(initial=0))
    return np.ascontiguousarray(np.take_along_axis(values, order[:, :most], axis=1))


@one_blas_thread()
def exponents(modes: BandModes, m: Array, k: Array) -> Complex:
    """All of the band, (points, any), with NaN: lambda where `rayleigh` is given, else phi with Im >= 0.

    m and k, N s/m, are (points,).
    """
    parts = []
    for i in range(0, len(m), BATCH):
        at = slice(i, i + BATCH)
        parts.append(undamped_roots(modes, m[at]) if modes.rayleigh else damped_roots(modes, m[at], modes.omega * k[at]))
    most = max((each.shape[1] for each in parts), default=0)
    table = [np.pad(each, ((0, 0), (0, most - each.shape[1])), constant_values=np.nan) for each in parts]
    return np.concatenate([np.empty((0, most), dtype=complex), *table])


def sliding_shape(own: Structure, phi: complex, uncoupled: bool, falling: bool = True) -> Complex:
    """Modal coordinates of an exponent, (n,): those of contact forces that leave the normal gap closed.

    An uncoupled mode moves alone; of some with one frequency, it is the combination that leaves the normal gap, and
    with friction that falls the tangential one, closed.
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
        # Without coupling of the gaps one force or the other is zero.
        alone = n if abs(tangential) <= 1e-6 * (n[nearest] ** 2 + abs(gap) * np.abs(a).sum()) else t
        q[others], q[nearest] = gap * alone[others] / distance[others], alone[nearest]
    return q

@kernel
def newton_step(z: complex, p: Array, c: Array, power: float, rows: Array, count: int, gaps: Complex) -> tuple[complex, bool]:
    """P / P' of P = f prod_i (p_i + c_i z + power z^2), and whether f is no more than rounding of its terms.

    Of `rows`, n (n + m t), n n, sqrt(k) n t and k t t, only the first counts if `count` is 1 (no k), else all 4.
    The nearest pole is taken out of f; a c = b^2 for each mode, so that f has no double poles. `gaps`, (n,), is
    overwritten.
    """
    nearest, least = 0, np.inf
    for i in range(len(p)):
        gaps[i] = p[i] + z * (c[i] + power * z)
        square = gaps[i].real ** 2 + gaps[i].imag ** 2
        if square < least:
            nearest, least = i, square
    # Each sum, its derivative, and the size of its terms.
    sums, slopes, sizes, others = np.zeros(4, np.complex128), np.zeros(4, np.complex128), np.zeros(4), 0j
    for i in range(len(p)):
        if i != nearest:
            inverse = 1.0 / gaps[i]
            fall = (c[i] + 2.0 * power * z) * inverse
            others += fall
            for r in range(count):
                term = rows[r, i] * inverse
                sums[r] += term
                slopes[r] -= term * fall
                sizes[r] += abs(term.real) + abs(term.imag)
    gap, rise = gaps[nearest], c[nearest] + 2.0 * power * z
    parts = p[nearest] + abs(z) * (abs(c[nearest]) + power * abs(z))
    reduced = rows[0, nearest] + gap * sums[0]
    derivative = rise * sums[0] + gap * slopes[0]
    size = abs(rows[0, nearest]) + abs(gap) * sizes[0] + parts * abs(sums[0])
    if count > 1:
        a, b, t = rows[1, nearest], rows[2, nearest], rows[3, nearest]
        product = sums[1] * sums[3] - sums[2] * sums[2]
        mixed = a * sums[3] + t * sums[1] - 2.0 * b * sums[2] + gap * product
        change = a * slopes[3] + t * slopes[1] - 2.0 * b * slopes[2] + rise * product
        change += gap * (slopes[1] * sums[3] + sums[1] * slopes[3] - 2.0 * sums[2] * slopes[2])
        reduced -= z * mixed
        derivative -= mixed + z * change
        whole = a * sizes[3] + t * sizes[1] + 2.0 * abs(b) * sizes[2] + parts * abs(product)
        size += abs(z) * (whole + abs(gap) * (sizes[1] * sizes[3] + sizes[2] * sizes[2]))
    derivative += others * reduced
    return reduced / derivative if derivative != 0.0 else 0j, abs(reduced) <= 16.0 * EPS * size


@kernel
def polish(z: Complex, m: Array, k: Array, p: Array, c: Array, power: float, residues: Array) -> None:
    """Newton steps from every root z, (points, any), in place, to rounding; one that would go far stays."""
    rows, gaps = np.empty((4, len(p))), np.empty(len(p), np.complex128)
    for point in range(len(z)):
        root = np.sqrt(k[point])
        for i in range(len(p)):
            rows[0, i] = residues[0, i] + m[point] * residues[1, i]
            rows[1, i], rows[2, i], rows[3, i] = residues[0, i], root * residues[1, i], k[point] * residues[2, i]
        for j in range(z.shape[1]):
            here, last = z[point, j], np.inf
            if np.isnan(here.real):
                continue
            for _ in range(30):
                step, rounding = newton_step(here, p, c, power, rows, 4 if root > 0.0 else 1, gaps)
                length = abs(step)
                if rounding and length >= last:
                    break
                here -= step
                if length <= 4.0 * EPS * abs(here):
                    break
                last = length
            if abs(here - z[point, j]) <= 0.05 * abs(z[point, j]) + 1e-9:
                z[point, j] = here


@kernel
def damp(values: Complex, d1: float, d2: float, phi: Complex) -> None:
    """Root `phi` of phi^2 + (d1 + d2 lambda) phi + lambda = 0 with Im >= 0, or the larger of two real roots."""
    for j in range(len(values)):
        half = 0.5 * (d1 + d2 * values[j])
        root = np.sqrt(half * half - values[j])
        if half.real * root.real + half.imag * root.imag < 0.0:
            root = -root
        large, chosen = -half - root, root - half
        # The difference cancels when damping is heavy; the product of both roots is lambda.
        if abs(chosen) < 0.5 * abs(large):
            chosen = values[j] / large
        if large.imag > chosen.imag or (large.imag == chosen.imag and large.real > chosen.real):
            chosen = large
        phi[j] = complex(chosen.real, chosen.imag + 0.0)
