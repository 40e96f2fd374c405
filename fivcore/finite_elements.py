"""Modes of a finite-element model with its contact open, and the static compliance of all others."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from fivcore import checks
from fivcore.errors import InputError
from fivcore.jit import Array

# Degrees of freedom up to which all modes are computed, dense.
DENSE = 600
# Stiffness of a static mode, in units of the largest one; largest stiffness of a rigid motion, likewise.
STATIC, RIGID = 1e12, 1e-10


def checked_matrix(name: str, value: Any, n: int | None) -> Any:
    """A symmetric matrix, sparse if it was."""
    try:
        # In coordinates SciPy finds an index out of range; elsewhere it would read beyond its arrays.
        sparsely = sparse.issparse(value)
        matrix = sparse.csc_array(value.tocoo(), dtype=float) if sparsely else np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} = {checks.short(value)}: it must be a matrix of numbers ({error})") from None
    allowed = "a square matrix" if n is None else f"of shape ({n}, {n}), as the mass matrix"
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or n not in (None, matrix.shape[0]):
        raise InputError(f"{name} of shape {matrix.shape}: it must be {allowed}")
    if not np.all(np.isfinite(matrix.data if sparse.issparse(matrix) else matrix)):
        raise InputError(f"{name}: it has entries that are not finite")
    most, off = abs(matrix).max(), abs(matrix - matrix.T).max()
    if off > 1e-8 * most:
        triangles = [abs(part(matrix, k)).max() for part, k in ((sparse.tril, -1), (sparse.triu, 1))]
        hint = "only one triangle is there: add the other one" if 0.0 in triangles else "take (A + A.T) / 2"
        raise InputError(f"{name}: not symmetric, by {off / most:.2g} of its largest entry; {hint}")
    return 0.5 * (matrix + matrix.T)


def lowest_modes(M: Any, K: Any, fmax: float | None, rows: Array) -> tuple[Array, Array, Array | None]:
    """Stiffness and mass-normalised modes up to fmax, Hz; static compliance of the others at `rows`, (3, 3)."""
    n = M.shape[0]
    limit = np.inf if fmax is None else (2.0 * np.pi * fmax) ** 2
    if n <= DENSE:
        M, K = (matrix.toarray() if sparse.issparse(matrix) else matrix for matrix in (M, K))
        try:
            values, vectors = linalg.eigh(K, M)
        except np.linalg.LinAlgError:
            text = "mass: it must be positive definite; remove degrees of freedom without mass, or condense them"
            raise InputError(text) from None
        if values.min() > -1e-12 * np.abs(values).max():
            values, vectors = _refined(M, K, values, vectors)
        _definite(values, 1e-14 * np.abs(values).max(), vectors)
        kept = values < limit
        if not kept.any():
            raise InputError(f"fmax = {fmax:g}: no mode is below it; the lowest has {_hertz(values[0]):.6g} Hz")
        if kept.all():
            return values, vectors, None
        dropped = rows @ vectors[:, ~kept]
        return values[kept], vectors[:, kept], (dropped / values[~kept]) @ dropped.T
    if M.diagonal().min() <= 0.0:
        raise InputError(
            f"mass: degree of freedom {int(M.diagonal().argmin())} has none; remove all without, or condense them"
        )
    M, K = sparse.csc_array(M), sparse.csc_array(K)
    # A negative shift: the factorised matrix is positive definite, with rigid motions too.
    shift = 1e-3 * limit
    factors = splu(sparse.csc_array(K + shift * M), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    inverse = LinearOperator((n, n), matvec=factors.solve, dtype=float)
    count = 20
    while True:
        count = min(count, n - 1)
        values, vectors = eigsh(K, count, M, sigma=-shift, OPinv=inverse, v0=np.ones(n))
        if values.max() > limit or count == n - 1:
            break
        count *= 2
    _definite(values, RIGID * limit, vectors)
    if not np.any(values < limit):
        raise InputError(f"fmax = {fmax:g}: no mode is below it; the lowest has {_hertz(values.min()):.6g} Hz")
    values, vectors = values[values < limit], vectors[:, values < limit]
    # Forces without the part that the modes bear; each solution has an error of shift / limit of the one before.
    forces = rows.T - M @ (vectors @ (vectors.T @ rows.T))
    solved = np.zeros_like(forces)
    for _ in range(8):
        solved += factors.solve(forces - K @ solved)
        solved -= vectors @ (vectors.T @ (M @ solved))
    return values, vectors, forces.T @ solved


def _refined(M: Array, K: Array, values: Array, vectors: Array) -> tuple[Array, Array]:
    """Low modes to their own precision, by one inverse iteration: rounding is relative to the highest."""
    low = values < 1e-6 * values.max()
    if not low.any():
        return values, vectors
    shift = 1e-6 * values.max()
    images = M @ vectors[:, low]
    small = images.T @ linalg.cho_solve(linalg.cho_factor(K + shift * M), images)
    inverse, mixed = np.linalg.eigh(0.5 * (small + small.T))
    values, vectors = values.copy(), vectors.copy()
    values[low], vectors[:, low] = (1.0 / inverse - shift)[::-1], vectors[:, low] @ mixed[:, ::-1]
    return values, vectors


def _hertz(value: float) -> float:
    return float(np.sqrt(max(value, 0.0))) / (2.0 * np.pi)


def _definite(values: Array, rounding: float, vectors: Array) -> None:
    """Set the stiffness of rigid motions to zero; an error where a motion has negative stiffness."""
    if values.min() < -rounding:
        dof = int(np.abs(vectors[:, values.argmin()]).argmax())
        text = f"a motion, largest at degree of freedom {dof}, has {values.min():g} 1/s2"
        raise InputError(f"stiffness: indefinite: {text}; add what supports the structure, or correct its sign")
    values[np.abs(values) <= rounding] = 0.0


def static_modes(compliance: Array, largest: float) -> tuple[Array, Array, Array, Array]:
    """Stiffness, normal and tangential shape and load, (1 or 2,), of modes with a static compliance (3, 3).

    Its rows are normal, tangential and load. They are so far above the others that they only have that compliance,
    to 1e-12 of it at the highest frequency.
    """
    values, vectors = np.linalg.eigh(compliance[:2, :2])
    kept = values > 1e-9 * max(values.max(), 0.0)
    root = np.sqrt(STATIC * largest)
    shapes = vectors[:, kept] * np.sqrt(values[kept]) * root
    load = (compliance[2, :2] @ vectors[:, kept]) / np.sqrt(values[kept]) * root
    return np.full(int(kept.sum()), STATIC * largest), shapes[0], shapes[1], load
