"""Compression of modes far above a frequency band to a few modes with the same response in the band.

The receptance at the contact is h(phi) = sum_i g_i g_i^T / (p_i + c_i phi + phi^2), g = (n, t). With
Rayleigh damping this is a function of the undamped eigenvalue lambda, sum_i w_i w_i^T / (1 - lambda s_i) with
s = 1 / p and w = g sqrt(s). Block Lanczos from both rows of w gives the Gauss quadrature of this sum: k blocks
match its first 2 k moments, and its nodes and weights are modes again (Freund, Acta Numerica 12, 2003, 267-319).
The first block is residual flexibility (MacNeal; Rubin); a mode with s = 0 is static compliance.

With modal damping there is no such variable. A few far modes then represent all of them: within the disc of the
band, the responses of the others are interpolated to rounding from those of a few, chosen by pivoted QR
(interpolative decomposition; Cheng, Gimbutas, Martinsson and Rokhlin, SIAM J. Sci. Comput. 26, 2005, 1389-1404).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from fivcore.beams.modes import EPS, one_blas_thread
from fivcore.jit import Array, kernel, reordered_call

# Modes with p above FAR times the largest |lambda| of the band are far, and BLOCKS of two modes replace them; more
# blocks would add rounding to weak couplings of normal and tangential motion. With modal damping the factor is
# FAR_MODAL.
FAR, BLOCKS, FAR_MODAL = 40.0, 5, 16.0
# Smallest node of the quadrature relative to the largest; a mode below it is pure compliance.
STATIC_NODE = 1e-15
# Points at which responses are interpolated, in units of 2 pi fmax.
CIRCLE = 1.5 * np.exp(1j * np.pi * (np.arange(16) + 0.5) / 16.0)[:, None]


@reordered_call
def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@kernel
def lanczos(s: Array, damping: Array, w: Array, blocks: int) -> tuple[Array, Array, Array]:
    """Gauss quadrature of sum w w^T / (1 - lambda s): nodes (k,), descending, their damping, and weights (r, k).

    `s` and `damping`, c / p, are (m,), `w` is (r, m), and k is at most r blocks, because vectors parallel to
    earlier ones are omitted. The damping is the diagonal of the projected damping matrix, which is exact for
    Rayleigh damping.
    """
    size, used, rows = 0, 0, len(w)
    basis = np.zeros((rows * blocks, len(s)))
    for j in range(rows * blocks):
        if j >= rows and used == size:
            break
        new = basis[size]
        new[:] = w[j] if j < rows else s * basis[used]
        used += j >= rows
        length = np.sqrt(_dot(new, new))
        # Twice is enough (Parlett, The Symmetric Eigenvalue Problem, 1980, section 6-9).
        for i in range(2 * size):
            share = _dot(basis[i % size], new)
            for k in range(len(s)):
                new[k] -= share * basis[i % size, k]
        rest = np.sqrt(_dot(new, new))
        if rest > 1e-13 * length:
            new /= rest
            size += 1
    projected, shares = np.empty((size, size)), np.zeros((rows, size))
    for i in range(size):
        scaled = s * basis[i]
        for j in range(i + 1):
            projected[i, j] = projected[j, i] = _dot(basis[j], scaled)
        # The rows are in the span of the first vectors.
        for r in range(i, rows):
            shares[r, i] = _dot(basis[i], w[r])
    nodes, turn = jacobi(projected)
    weights, own, damped = np.zeros((rows, size)), np.empty(size), np.any(damping)
    for i in range(size):
        mode = np.zeros(len(s))
        for k in range(size):
            for r in range(rows):
                weights[r, i] += shares[r, k] * turn[k, i]
            if damped:
                mode += turn[k, i] * basis[k]
        own[i] = _dot(mode * mode, damping)
    order = np.argsort(-nodes)
    return nodes[order], own[order], weights[:, order]


@kernel
def jacobi(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues, (n,), and eigenvectors, (n, n), one a column, of a symmetric matrix.

    Weak couplings, such as that of normal and tangential motion of an upright rig, keep their relative accuracy,
    which LAPACK would lose to rounding of the largest entry (Demmel and Veselic, SIAM J. Matrix Anal. 13, 1992,
    1204-1245).
    """
    n, done = len(matrix), False
    both = np.vstack((matrix, np.eye(n)))
    for _ in range(30):
        if done:
            break
        done = True
        for i in range(n):
            for j in range(i + 1, n):
                off = both[i, j]
                if abs(off) <= 1e-30 * np.sqrt(abs(both[i, i] * both[j, j])) or off == 0.0:
                    continue
                done = False
                slope = 0.5 * (both[j, j] - both[i, i]) / off
                tangent = (1.0 if slope >= 0.0 else -1.0) / (abs(slope) + np.hypot(1.0, slope))
                cosine = 1.0 / np.hypot(1.0, tangent)
                sine = tangent * cosine
                for k in range(2 * n):
                    x, y = both[k, i], both[k, j]
                    both[k, i], both[k, j] = cosine * x - sine * y, sine * x + cosine * y
                for k in range(n):
                    x, y = both[i, k], both[j, k]
                    both[i, k], both[j, k] = cosine * x - sine * y, sine * x + cosine * y
                both[i, j] = both[j, i] = 0.0
    return np.diag(both[:n]).copy(), both[n:]


@kernel
def compressed(p: Array, c: Array, g: Array, far: NDArray[np.bool_], blocks: int) -> tuple[Array, Array, Array]:
    """Modes p, c, (n,), and g, (r, n), with those that are `far`, (n,), replaced by at most r blocks."""
    if np.sum(far) <= len(g) * blocks:
        return p, c, g
    s, near = 1.0 / p[far], ~far
    nodes, lost, weights = lanczos(s, c[far] * s, g[:, far] * np.sqrt(s), blocks)
    stiffness = 1.0 / np.maximum(nodes, STATIC_NODE * nodes[0])
    gaps = np.concatenate((g[:, near], weights * np.sqrt(stiffness)), axis=1)
    return np.append(p[near], stiffness), np.append(c[near], lost * stiffness), gaps


@one_blas_thread()
def interpolated(p: Array, c: Array, residues: Array, far: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Modes p, c, (n,), and residues (3, n) in which a few of those that are `far` represent all, for any damping.

    In units of the band, sum residues / (p + c phi + phi^2) is unchanged to the rounding of its terms at phi = 0.
    """
    unit = np.sqrt((residues**2).sum(axis=0))
    near, beyond = np.flatnonzero(~far), np.flatnonzero(far & (unit > 0.0))
    share = unit[beyond] / p[beyond]
    responses = share / (1.0 + CIRCLE * ((c[beyond] + CIRCLE) / p[beyond]))
    triangle, order = qr(np.vstack([responses.real, responses.imag]), mode="r", pivoting=True)
    size = int(np.sum(np.abs(np.diag(triangle)) > EPS * share.sum()))
    weights, beyond = np.eye(size, len(beyond)), beyond[order]
    weights[:, size:] = solve_triangular(triangle[:size, :size], triangle[:size, size:])
    kept = np.append(near, beyond[:size])
    some = (residues[:, beyond] / unit[beyond]) @ weights.T * unit[beyond[:size]]
    return p[kept], c[kept], np.hstack([residues[:, near], some])
