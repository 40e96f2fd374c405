"""Modal bases of the two separate beams, and their displacement at the contact.

The beams are coupled only by the two contact forces at one point. In the modes of the separate beams everything
else is diagonal: squared angular frequencies and the contribution of each mode to the normal and tangential gaps.
All modes together are equivalent to the finite-element model. The gap g_N = y_C - y_D is open when positive; g_T =
x_C - x_D. N >= 0 and T act on P1 along +y and +x, and in the opposite directions on P2.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular
from threadpoolctl import ThreadpoolController

from fivcore.beams.elements import axial, bending, hermite
from fivcore.errors import InputError
from fivcore.jit import Array, ReadOnlyArrays, kernel
from fivcore.rig import Beam, Rig

EPS = 2.220446049250313e-16
_blas = ThreadpoolController()
_blas_lock = threading.RLock()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Restrict BLAS to one thread, because the number of threads changes the last bits of its results."""
    # The limit applies to the whole process; the lock prevents its removal while another thread needs it.
    with _blas_lock, _blas.limit(limits=1):
        yield


@dataclass(frozen=True, eq=False)
class Basis(ReadOnlyArrays):
    """Mass-normalised modes seen from the contact point; arrays are read-only."""

    # Squared angular frequencies of the undamped modes, (n,), rad2/s2, ascending within each family.
    stiffness: Array
    # Gap shapes: change of g_N and g_T for a unit of each modal coordinate, (n,), kg^-1/2.
    normal: Array
    tangential: Array
    # Undeformed positions x, y relative to the contact point, (nodes, 2), m, from the support on.
    nodes: Array
    # Displacement along x and y (kg^-1/2) and rotation (kg^-1/2 / m) at them, the support included, (nodes, 3, n).
    shapes: Array


@lru_cache(maxsize=16)
@one_blas_thread()
def lower_basis(beam: Beam, contact_position: float) -> Basis:
    """Modes of P2 alone, a cantilever; bending first, then axial.

    The contact lies on the neutral axis: bending modes have no tangential, axial modes no normal part.
    """
    (axial_values, u), (bending_values, w) = cantilever_modes(beam)
    axial_row, bending_row = hermite(beam, contact_position)
    nb, n = len(bending_values), 3 * beam.elements
    normal, tangential, shapes = np.zeros(n), np.zeros(n), np.zeros((beam.elements + 1, 3, n))
    normal[:nb], tangential[nb:] = -bending_row @ w, -axial_row @ u
    shapes[1:, 0, nb:], shapes[1:, 1, :nb], shapes[1:, 2, :nb] = u, w[0::2], w[1::2]
    s = np.linspace(0.0, beam.length, beam.elements + 1)
    nodes = np.stack([s - contact_position, np.zeros_like(s)], axis=1)
    return Basis(np.append(bending_values, axial_values), _clean(normal), _clean(tangential), nodes, shapes)


@lru_cache(maxsize=16)
@one_blas_thread()
def upper_basis(beam: Beam, head_mass: float, theta: float) -> Basis:
    """Modes of P1 alone: x and rotation blocked at A, y free with the head mass, C free; rigid mode first.

    The motion is that of the support along y plus that of a cantilever clamped at the support. Only this function
    depends on theta.
    """
    (axial_values, u), (bending_values, w) = cantilever_modes(beam)
    na, total = beam.elements, beam.mass + head_mass
    sine, cosine = np.sin(np.radians(theta)), np.cos(np.radians(theta))
    # The beam's own axes, from A down to C and across it, in terms of x and y.
    axis, transverse = np.array([-sine, -cosine]), np.array([cosine, -sine])
    parts = np.append(axis[1] * (axial(beam).base_inertia @ u), transverse[1] * (bending(beam).base_inertia @ w))
    own = np.append(axial_values, bending_values)
    order = np.argsort(own)
    values, moved, relative = supported_modes(own[order], parts[order], total - float(parts @ parts))
    ascending = np.argsort(values, kind="stable")
    values, moved, relative = values[ascending], moved[ascending], relative[ascending][:, np.argsort(order)].T
    u, w, shapes = u @ relative[:na], w @ relative[na:], np.zeros((beam.elements + 1, 3, len(values) + 1))
    shapes[:, 1, 0] = 1.0 / np.sqrt(total)
    shapes[1:, 0, 1:] = axis[0] * u + transverse[0] * w[0::2]
    shapes[1:, 1, 1:] = axis[1] * u + transverse[1] * w[0::2]
    shapes[:, 1, 1:] += moved
    shapes[1:, 2, 1:] = w[1::2]
    s = np.linspace(beam.length, 0.0, beam.elements + 1)
    tip = _clean(shapes[-1, 1]), _clean(shapes[-1, 0])
    return Basis(np.append(0.0, values), *tip, -np.outer(s, axis), shapes)


def rig_bases(rig: Rig, theta: float) -> tuple[Basis, Basis]:
    """Bases of P1 and of P2, from the caches."""
    return upper_basis(rig.p1, rig.head_mass, theta), lower_basis(rig.p2, rig.contact_position)


def contact_modes(rig: Rig, theta: float) -> Array:
    """Stiffness, normal and tangential gap shapes of both beams' modes, P1's first, (3, n)."""
    return np.hstack([(basis.stiffness, basis.normal, basis.tangential) for basis in rig_bases(rig, theta)])


def residual_flexibility(stiffness: Array, shape: Array) -> Array:
    """Residual flexibility of the gaps, (2, 2), m/N, due to truncated modes: stiffness (n,), shape (2, n).

    Row and column 0 are normal, 1 tangential; with c contacts the first c are normal, the others tangential.
    Raises `ValueError` for a rigid mode.
    """
    if np.any(stiffness == 0.0):
        raise InputError("stiffness holds 0: the static flexibility of a rigid mode is infinite, so keep it")
    shape = np.ascontiguousarray(shape)
    return np.asarray((shape / stiffness) @ shape.T)


def natural_modes(stiffness: Array, mass: Array, flexibility_root: Array) -> tuple[Array, Array]:
    """Squared angular frequencies (n,), ascending, and mass-normalised modes (n, n), one a column, of a beam.

    A symmetric eigenproblem gives only its largest eigenvalues to full relative accuracy, and a beam's squared
    frequencies span ten orders of magnitude. The lower modes are therefore taken from the flexibility R R^T, R its
    root (eigenvalues 1 / omega^2 of R^T M R), the upper ones from the stiffness. Both are equally accurate at the
    geometric mean of the extreme frequencies. Arguments are (n, n), stiffness and mass positive definite.
    """
    flexibility, y = eigh(flexibility_root.T @ mass @ flexibility_root)
    factor = cholesky(mass, lower=True)
    half = solve_triangular(factor, stiffness, lower=True)
    values, z = eigh(solve_triangular(factor, half.T, lower=True))
    vectors = solve_triangular(factor, z, lower=True, trans="T")
    lower = int(np.count_nonzero(flexibility > np.sqrt(flexibility[-1] / values[-1])))
    values[:lower] = 1.0 / flexibility[::-1][:lower]
    vectors[:, :lower] = flexibility_root @ y[:, ::-1][:, :lower] * np.sqrt(values[:lower])
    return values, vectors


@lru_cache(maxsize=16)
@one_blas_thread()
def cantilever_modes(beam: Beam) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Eigenvalues and modes of a beam clamped at one end, axial ones and bending ones."""
    return natural_modes(*axial(beam)[:3]), natural_modes(*bending(beam)[:3])


@kernel
def supported_modes(own: Array, parts: Array, support: float) -> tuple[Array, Array, Array]:
    """Modes of a clamped structure after its support is released in one direction.

    In the modes of the clamped structure, the release is a rank-one change of the modal mass from I to I - G G^T /
    m_total with the participation factors G. The squared frequencies are therefore the roots of a secular
    equation, one above each pole d (Golub, SIAM Review 15, 1973, 318-334). Each root is computed as its distance
    from the nearest pole, which gives accurate mode shapes (Li, LAPACK Working Note 89, 1993).

    `own` (n,) are squared frequencies of the clamped structure, rad2/s2, ascending, `parts` (n,) G, kg^1/2, and
    `support` is m_total less the sum of G^2, kg. Returns squared frequencies, each above its own, displacements of
    the support, kg^-1/2, and mass-normalised modes in those of the clamped structure, one a row.
    """
    n, m, total, pole = len(own), 0, 0.0, 0.0
    values, moved, shapes, moving = own.copy(), np.zeros(n), np.eye(n), np.empty(n, dtype=np.int64)
    d, w, gap = np.empty(n + 1), np.empty(n), np.empty(n)
    for j in range(n):
        # Separate equal poles by one ulp.
        pole = max(own[j], pole * (1.0 + 2.0 * EPS))
        values[j] = pole
        # A mode that moves the support less than rounding keeps its frequency and its shape.
        if parts[j] * parts[j] > EPS * EPS * support:
            moving[m], d[m], w[m] = j, pole, parts[j] * parts[j] * pole
            total += w[m]
            m += 1
    if m > 0:
        # The last root lies below this.
        d[m] = d[m - 1] + max(d[m - 1], total / support)
    for k in range(m):
        root, slope, j = secular_root(k, d, w[:m], support, gap), 0.0, moving[k]
        for i in range(m):
            q = parts[moving[i]] / gap[i]
            shapes[j, moving[i]] = q
            slope += q * q * d[i]
        scale = np.sqrt(root / slope)
        values[j], moved[j] = root, scale / root
        shapes[j] *= scale
    return values, moved, shapes


@kernel
def secular_root(k: int, d: Array, w: Array, m: float, gap: Array) -> float:
    """Root z of m + sum_i w_i / (d_i - z) = 0 between d_k and d_(k+1); fill `gap` with d - z.

    One more d than w. Iteration by Bunch, Nielsen, Sorensen, Numer. Math. 31, 1978, 31-48.
    """
    n, middle, c = len(w), 0.5 * (d[k + 1] - d[k]), m
    for i in range(n):
        if i < k or i > k + 1:
            c += w[i] / (d[i] - d[k] - middle)
    above = w[k + 1] if k + 1 < n else 0.0
    left = c + (above - w[k]) / middle > 0.0
    origin, low, high = (k, 0.0, middle) if left else (k + 1, -middle, 0.0)
    p, q = d[k] - d[origin], d[k + 1] - d[origin]
    z = _two_poles(c, c * (p + q) + w[k] + above, w[k] * q + above * p)
    for _ in range(200):
        if not low < z < high:
            z = 0.5 * (low + high)
        f, size, slope_below, slope_above = m, m, 0.0, 0.0
        for i in range(n):
            gap[i] = d[i] - d[origin] - z
            term = w[i] / gap[i]
            f += term
            size += abs(term)
            if i <= k:
                slope_below += term / gap[i]
            else:
                slope_above += term / gap[i]
        low, high = (z, high) if f < 0.0 else (low, z)
        # The terms of the poles below and above as one pole each, with their value and slope.
        p, q = d[k] - d[origin] - z, d[k + 1] - d[origin] - z
        c = f - slope_below * p - slope_above * q
        step = _two_poles(c, c * (p + q) + slope_below * p * p + slope_above * q * q, p * q * f)
        if abs(f) <= 2.0 * EPS * size or abs(step) <= EPS * abs(z):
            break
        z += step
    return d[origin] + z


@kernel
def _two_poles(c: float, a: float, b: float) -> float:
    """Root of c z^2 - a z + b = 0 between the poles of a sum of two."""
    root = np.sqrt(max(a * a - 4.0 * b * c, 0.0))
    return (a - root) / (2.0 * c) if a <= 0.0 else 2.0 * b / (a + root)


def _clean(row: Array) -> Array:
    """Set entries that are rounding relative to the largest to zero, so that decoupling is exact."""
    return np.where(np.abs(row) > 1e-15 * np.abs(row).max(initial=0.0), row, 0.0)


def propagator(stiffness: Array, damping: Array, step: float) -> Array:
    """Exact solution of q'' + c q' + k q = 0 over a step, s, as rows a, b, c, d of q -> a q + b v, v -> c q + d v.

    (4, n). k and c, (n,), in rad2/s2 and 1/s, may have any size: oscillating, overdamped or free (k = 0).
    """
    half = 0.5 * damping
    root = np.sqrt((half**2 - stiffness).astype(complex))
    # cosh and sinh / root of the step, with the damping inside the exponents so that nothing overflows.
    up, down = np.exp((root - half) * step), np.exp((-root - half) * step)
    cosine = (0.5 * (up + down)).real
    small = np.abs(root * step) < 1e-4
    safe = np.where(small, 1.0, root)
    series = step * np.exp(-half * step) * (1.0 + (root * step) ** 2 / 6.0)
    sine = np.where(small, series, (up - down) / (2.0 * safe)).real
    return np.stack([cosine + half * sine, sine, -stiffness * sine, cosine - half * sine])
