"""Modes far above a band compressed to a few, once, for everything that a structure does in that band.

Seen from its contact a structure is h(phi) = sum_i g_i g_i^T / (p_i + c_i phi + phi^2), g = (n, t). With
Rayleigh damping this is a function of the undamped eigenvalue lambda, sum_i w_i w_i^T / (1 - lambda s_i) with
s = 1 / p and w = g sqrt(s). Block Lanczos from both rows of w gives the Gauss quadrature of this sum: k blocks
match its first 2 k moments, and its nodes and weights are modes again (Freund, Acta Numerica 12, 2003, 267-319).
The first block is residual flexibility (MacNeal; Rubin); a mode with s = 0 is static compliance.

Damping by mode leaves no such variable. There a few of the far modes stand for all of them: their responses are
interpolated to rounding in the disc of the band by those of some, chosen by QR with pivoting (interpolative
decomposition; Cheng, Gimbutas, Martinsson and Rokhlin, SIAM J. Sci. Comput. 26, 2005, 1389-1404).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from fivcore.beams.modes import EPS, one_blas_thread
from fivcore.jit import Array, kernel, reordered_call

# Modes with p above FAR times the band's largest |lambda| are far, and BLOCKS of two replace them.
FAR, BLOCKS = 16.0, 6
# A node of the quadrature is at least this share of the largest; below, its mode is nothing but compliance.
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
    """Gauss quadrature of sum w w^T / (1 - lambda s): nodes (k,), descending, their damping, and weights (2, k).

    `s` and `damping`, c / p, are (m,), `w` is (2, m), and k at most 2 blocks: a vector that is parallel to those
    before it is left out. The damping is that of the projected modes by its diagonal, exact with Rayleigh's law.
    """
    size, used, basis = 0, 0, np.zeros((2 * blocks, len(s)))
    for j in range(2 * blocks):
        if j >= 2 and used == size:
            break
        new = basis[size]
        new[:] = w[j] if j < 2 else s * basis[used]
        used += j >= 2
        length = np.sqrt(_dot(new, new))
        # Twice is enough (Parlett, The Symmetric Eigenvalue Problem, 1980, section 6-9).
        for _ in range(2):
            for i in range(size):
                share = _dot(basis[i], new)
                for row in range(len(s)):
                    new[row] -= share * basis[i, row]
        rest = np.sqrt(_dot(new, new))
        if rest > 1e-13 * length:
            new /= rest
            size += 1
    projected, loss, shares = np.empty((size, size)), np.empty((size, size)), np.zeros((2, size))
    for i in range(size):
        for j in range(i + 1):
            both = basis[i] * basis[j]
            projected[i, j] = projected[j, i] = _dot(both, s)
            loss[i, j] = loss[j, i] = _dot(both, damping)
        # The rows are in the span of the first vectors.
        for r in range(i, 2):
            shares[r, i] = _dot(basis[i], w[r])
    turn = jacobi(projected)
    nodes, weights, own = np.empty(size), np.zeros((2, size)), np.zeros(size)
    for i in range(size):
        nodes[i] = projected[i, i]
        for k in range(size):
            for r in range(2):
                weights[r, i] += shares[r, k] * turn[k, i]
            for j in range(size):
                own[i] += turn[k, i] * loss[k, j] * turn[j, i]
    order = np.argsort(-nodes)
    return nodes[order], own[order], weights[:, order]


@kernel
def jacobi(matrix: Array) -> Array:
    """Diagonalise a symmetric matrix, (n, n), in place; return its eigenvectors, one a column.

    Small couplings keep their relative accuracy, such as that of normal and tangential motion of an upright rig:
    LAPACK's would be rounding of the largest (Demmel and Veselic, SIAM J. Matrix Anal. 13, 1992, 1204-1245).
    """
    n = len(matrix)
    turn = np.eye(n)
    for _ in range(30):
        done = True
        for i in range(n):
            for j in range(i + 1, n):
                off = matrix[i, j]
                if abs(off) <= 1e-30 * np.sqrt(abs(matrix[i, i] * matrix[j, j])) or off == 0.0:
                    continue
                done = False
                slope = 0.5 * (matrix[j, j] - matrix[i, i]) / off
                tangent = (1.0 if slope >= 0.0 else -1.0) / (abs(slope) + np.hypot(1.0, slope))
                cosine = 1.0 / np.hypot(1.0, tangent)
                sine = tangent * cosine
                matrix[i, i] -= tangent * off
                matrix[j, j] += tangent * off
                matrix[i, j] = matrix[j, i] = 0.0
                for k in range(n):
                    if k != i and k != j:
                        x, y = matrix[k, i], matrix[k, j]
                        matrix[k, i] = matrix[i, k] = cosine * x - sine * y
                        matrix[k, j] = matrix[j, k] = sine * x + cosine * y
                    x, y = turn[k, i], turn[k, j]
                    turn[k, i], turn[k, j] = cosine * x - sine * y, sine * x + cosine * y
        if done:
            break
    return turn


@kernel
def compressed(p: Array, c: Array, g: Array, far: NDArray[np.bool_], blocks: int) -> tuple[Array, Array, Array]:
    """Modes p, c, (n,), and g, (2, n), with those that are `far`, (n,), replaced by at most 2 blocks."""
    others, near = np.flatnonzero(far), np.flatnonzero(~far)
    if len(others) <= 2 * blocks:
        return p, c, g
    s, damping, w = np.empty(len(others)), np.empty(len(others)), np.empty((2, len(others)))
    for k in range(len(others)):
        i = others[k]
        s[k], damping[k] = 1.0 / p[i], c[i] / p[i]
        w[0, k], w[1, k] = g[0, i] * np.sqrt(s[k]), g[1, i] * np.sqrt(s[k])
    nodes, lost, weights = lanczos(s, damping, w, blocks)
    size = len(near) + len(nodes)
    stiffness, dashpots, gaps = np.empty(size), np.empty(size), np.empty((2, size))
    for k in range(len(near)):
        i = near[k]
        stiffness[k], dashpots[k], gaps[0, k], gaps[1, k] = p[i], c[i], g[0, i], g[1, i]
    for k in range(len(near), size):
        i = k - len(near)
        stiffness[k] = 1.0 / max(nodes[i], STATIC_NODE * nodes[0])
        dashpots[k] = lost[i] * stiffness[k]
        gaps[0, k], gaps[1, k] = weights[0, i] * np.sqrt(stiffness[k]), weights[1, i] * np.sqrt(stiffness[k])
    return stiffness, dashpots, gaps


@one_blas_thread()
def interpolated(p: Array, c: Array, residues: Array) -> tuple[Array, Array, Array]:
    """Some of the modes p, c, (m,), and residues (3, k) in place of those of all, (3, m), whatever their damping.

    In units of the band, sum residues / (p + c phi + phi^2) stays as it is to rounding of its terms at rest.
    """
    share = np.sqrt((residues**2).sum(axis=0)) / p
    p, c, residues, share = (each[..., share > 0.0] for each in (p, c, residues, share))
    responses = share / (1.0 + CIRCLE * ((c + CIRCLE) / p))
    triangle, order = qr(np.vstack([responses.real, responses.imag]), mode="r", pivoting=True)
    size = int(np.sum(np.abs(np.diag(triangle)) > EPS * share.sum()))
    kept, weights = order[:size], np.eye(size, len(p))
    weights[:, size:] = solve_triangular(triangle[:size, :size], triangle[:size, size:])
    unit = share * p
    return p[kept], c[kept], (residues / unit)[:, order] @ weights.T * unit[kept]
