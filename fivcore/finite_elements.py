"""Modes of a finite-element model with its contact open, and the static compliance of all others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse.linalg import splu, spsolve_triangular

from fivcore import checks
from fivcore.beams.modes import EPS
from fivcore.errors import InputError, UnsolvedError
from fivcore.jit import Array

# Degrees of freedom up to which all modes are computed, dense.
DENSE_SIZE = 600
# Stiffness of a static mode, in units of the largest one.
STATIC = 1e12
# Block size of the Lanczos method; fraction of the modes up to which it is used, because it needs about three
# times as many vectors as modes; residual of a converged mode.
WIDTH, SPARSE_SHARE, CONVERGED = 8, 0.25, 1e-10
# Relative size of an orthogonalised direction that counts as rounding; relative error of a factorisation up to
# which its pivots are reliable.
ROUNDED_OFF, SOUND = 1e-12, 1e-10
# Largest memory for modes, GB.
MEMORY = 16.0
# Largest strain energy of a rigid motion, in units of EPS |x|^T |K| |x|. Since equal elements round alike, free
# plates have up to 0.5; the formulas of an element may round a few times as much.
RIGID = 8.0


def checked_matrix(name: str, value: Any, n: int | None) -> Any:
    """Check and return a symmetric matrix; it stays sparse."""
    matrix = checks.square_matrix(name, value, n)
    free = free_rows(matrix) if name == "stiffness" else np.full(matrix.shape[0], True)
    part = matrix if free.all() else matrix[free][:, free]
    most, off = abs(part).max(), abs(part - part.T).max()
    if off > 1e-8 * most:
        triangles = [abs(half(part, k)).max() for half, k in ((sparse.tril, -1), (sparse.triu, 1))]
        hint = "only one triangle is there: add the other one" if 0.0 in triangles else "take (A + A.T) / 2"
        raise InputError(f"{name}: not symmetric, by {off / most:.2g} of its largest entry; {hint}")
    return 0.5 * (matrix + matrix.T)


def free_rows(K: Any) -> NDArray[np.bool_]:
    """Mask of the unconstrained degrees of freedom, (n,); constrained ones are so stiff that others round off."""
    diagonal = K.diagonal()
    ascending = np.sort(diagonal[diagonal > 0.0])
    jumps = np.flatnonzero(ascending[:-1] < EPS * ascending[1:])
    free = np.asarray(diagonal <= (ascending[jumps[0]] if len(jumps) else np.inf))
    coupling = abs(K[~free]).sum(axis=1) - diagonal[~free]
    if np.any(coupling > len(free) * EPS * diagonal[~free]):
        text = f"{coupling.max():g} off the diagonal, beside which all others are rounding"
        raise InputError(f"stiffness: it has entries of {text}; tie degrees of freedom by eliminating some")
    return free


def lowest_modes(
    M: Any, K: Any, fmax: float | None, rows: Array, names: Any
) -> tuple[Array, Array, Array | None, float]:
    """Stiffness and mass-normalised modes up to fmax, Hz; static compliance of the others at `rows`, (3, 3).

    Also returns the frequency, Hz, up to which motions count as rigid, 0 without rigid motions. `names`, (n,), are
    the names of the degrees of freedom in messages. Completeness is verified: either all modes are computed, or as
    many as K - limit M has negative pivots (Sylvester's law of inertia).
    """
    n, limit = M.shape[0], np.inf if fmax is None else (2.0 * np.pi * fmax) ** 2
    _check_mass(M, names)
    if n > DENSE_SIZE:
        M, K = sparse.csc_array(M), sparse.csc_array(K)
        limit, count = _count_below(M, K, limit)
        # Three arrays of the basis, or of all modes.
        if (size := 24e-9 * n * min(n, 3 * count)) > MEMORY:
            raise InputError(f"fmax = {fmax:g}: the {count} modes below it need {size:.0f} GB; lower it")
    if n > DENSE_SIZE and max(count, WIDTH) < SPARSE_SHARE * n:
        # With a negative shift the factorised matrix is positive definite even with rigid motions.
        shift = 1e-3 * limit
        factors = _factorised(K + shift * M)
        if factors.U.diagonal().min() > 0.0:
            vectors = _block_lanczos(M, factors.solve, shift, limit, count)
        else:
            motion = _least_motion(factors)
            vectors = (motion / np.sqrt(motion @ (M @ motion)))[:, None]
        values, vectors = _ritz(K, vectors)
    else:
        M, K = (matrix.toarray() if sparse.issparse(matrix) else matrix for matrix in (M, K))
        values, vectors = refined(K, *linalg.eigh(K, M))
    rigid = _rigid(K, values, vectors, names)
    kept = values < limit
    if not kept.any():
        raise InputError(f"fmax = {fmax:g}: no mode is below it; the lowest has {_hertz(values.min()):.6g} Hz")
    if kept.all() and len(values) == n:
        return values, vectors, None, rigid
    if len(values) == n:
        dropped = rows @ vectors[:, ~kept]
        return values[kept], vectors[:, kept], (dropped / values[~kept]) @ dropped.T, rigid
    # Forces orthogonal to the modes; each iteration reduces the error by shift / limit.
    forces = rows.T - M @ (vectors @ (vectors.T @ rows.T))
    solved = np.zeros_like(forces)
    for _ in range(8):
        solved += factors.solve(forces - K @ solved)
        solved -= vectors @ (vectors.T @ (M @ solved))
    return values, vectors, forces.T @ solved, rigid


def _factorised(matrix: Any) -> Any:
    """L D L^T of a sparse symmetric matrix, with the pivots of the diagonal in an order that keeps it sparse."""
    options = {"SymmetricMode": True}
    return splu(sparse.csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)


def _least_motion(factors: Any) -> Array:
    """The motion x = L^-T e of the smallest pivot, (n,): x^T A x is that pivot."""
    pivots = factors.U.diagonal()
    unit = np.eye(1, len(pivots), pivots.argmin())[0]
    return np.asarray(spsolve_triangular(factors.L.T.tocsr(), unit, lower=False)[factors.perm_r])


def _count_below(M: Any, K: Any, limit: float) -> tuple[float, int]:
    """A limit just below the one given, and the number of modes below it: the negative pivots of K - limit M.

    If a mode is so close to the limit that the factorisation is inaccurate, the limit is lowered further.
    """
    start = np.random.default_rng(0).standard_normal(M.shape[0])
    for nudge in 10.0 ** np.arange(-9.0, -3.0):
        lower = (1.0 - nudge) * limit
        matrix = K - lower * M
        try:
            factors = _factorised(matrix)
        except RuntimeError:  # A pivot is zero.
            continue
        solved = factors.solve(start)
        error = np.abs(matrix @ solved - start) / (abs(matrix) @ np.abs(solved) + np.abs(start))
        if np.array_equal(factors.perm_r, factors.perm_c) and error.max() < SOUND:
            return lower, int(np.count_nonzero(factors.U.diagonal() < 0.0))
    raise UnsolvedError(f"fmax = {_hertz(limit):g}: the modes below it cannot be counted; another fmax may do")


def _block_lanczos(M: Any, solve: Callable[[Array], Array], shift: float, limit: float, count: int) -> Array:
    """The `count` lowest modes, at least one, mass-normalised, (n, count), by (K + shift M)^-1 = `solve`.

    Block Lanczos method with full orthogonalisation (Grimes, Lewis and Simon, SIAM J. Matrix Anal. Appl. 15, 1994,
    228-272). Directions that are already in the basis are replaced by random ones, so that all modes of equal
    frequency are found.
    """
    n, random, most = M.shape[0], np.random.default_rng(0), max(count, 1)
    # In Fortran order the first columns are contiguous, so products with them need no copy.
    basis, small, size, checked = np.empty((n, min(n, 4 * most)), order="F"), np.zeros((0, 0)), 0, 0
    block = _orthonormal(M, basis[:, :0], random.standard_normal((n, WIDTH)), random)
    while True:
        image, known, size = solve(M @ block), size, size + block.shape[1]
        if size > basis.shape[1]:
            basis = np.asfortranarray(np.pad(basis, ((0, 0), (0, size))))
        basis[:, known:size] = block
        column = basis[:, :size].T @ (M @ image)
        small = np.block([[small, column[:known]], [column.T]])
        block = _orthonormal(M, basis[:, :size], image, random)
        if size < n and size < max(most, 1.1 * checked):
            continue
        checked = size
        inverse, turn = np.linalg.eigh(small)
        # Each Ritz value bounds a different mode from above, so there are at least as many modes.
        found = int(np.count_nonzero(1.0 / inverse - shift < limit))
        inverse, turn = inverse[-most:], turn[:, -most:]
        rest = np.linalg.norm((block.T @ (M @ image)) @ turn[known:], axis=0)
        if size == n or found > count or (found == count and np.all(rest < CONVERGED * inverse)):
            break
    if found != count:
        text = f"{found} modes are below it, but {count} by the signs of pivots"
        raise UnsolvedError(f"fmax = {_hertz(limit):g}: {text}; another fmax may do")
    return np.asarray(basis[:, :size] @ turn)


def _orthonormal(M: Any, basis: Array, block: Array, random: np.random.Generator) -> Array:
    """M-orthonormal directions of a block, orthogonal to the basis, (n, k); random ones replace dependent ones."""
    block, lost = block[:, : basis.shape[0] - basis.shape[1]], np.array([True])
    for attempt in range(4):
        if attempt > 1 and not lost.any():
            break
        block = block / np.sqrt(np.sum(block * (M @ block), axis=0))
        block = block - basis @ (basis.T @ (M @ block))
        block = block @ np.linalg.eigh(block.T @ (M @ block))[1]
        lost = np.sum(block * (M @ block), axis=0) < ROUNDED_OFF**2
        if attempt < 2:
            block[:, lost] = random.standard_normal((len(block), int(lost.sum())))
    return np.asarray(block / np.sqrt(np.sum(block * (M @ block), axis=0)))


def _ritz(K: Any, vectors: Array) -> tuple[Array, Array]:
    """Rayleigh-Ritz: stiffness and modes within a span of modes."""
    # Elastic forces of a low mode nearly cancel, so they are summed in extended precision if available.
    small = vectors.T @ (K.astype(np.longdouble) @ vectors).astype(float)
    values, turn = np.linalg.eigh(0.5 * (small + small.T))
    return values, vectors @ turn


def refined(K: Array, values: Array, vectors: Array) -> tuple[Array, Array]:
    """Low modes accurate relative to their own frequency; LAPACK's rounding error is relative to the highest."""
    values, vectors, low = values.copy(), vectors.copy(), values < 1e-6 * values.max(initial=0.0)
    values[low], vectors[:, low] = _ritz(K, vectors[:, low])
    return values, vectors


def _hertz(value: float) -> float:
    return float(np.sqrt(max(value, 0.0))) / (2.0 * np.pi)


def _rigid(K: Any, values: Array, vectors: Array, names: Any) -> float:
    """Set the stiffness of rigid motions to zero; raise if a motion has negative stiffness.

    A motion is rigid if its strain energy is within the rounding error of the entries of K. Returns the largest
    frequency, Hz, that rounding alone may give a rigid motion.
    """
    rounding = RIGID * EPS * np.sum(np.abs(vectors) * (abs(K) @ np.abs(vectors)), axis=0)
    worst = int((values + rounding).argmin())
    if values[worst] < -rounding[worst]:
        place = names[np.abs(vectors[:, worst]).argmax()]
        text = f"a motion, largest at {place}, has {values[worst]:g} 1/s2"
        raise InputError(f"stiffness: indefinite: {text}; add what supports the structure, or correct its sign")
    rigid = np.abs(values) <= rounding
    values[rigid] = 0.0
    return _hertz(rounding[rigid].max(initial=0.0))


def _check_mass(M: Any, names: Any) -> None:
    """Raise unless the mass is positive definite to within rounding; the message names a motion without mass."""
    n, mass, text = M.shape[0], M.diagonal(), "mass: it must be positive definite"
    if mass.min() <= 0.0:
        least = int(mass.argmin())
        raise InputError(f"{text}; {names[least]} has {mass[least]:g}: remove all without mass, or condense them")
    scale = sparse.diags_array(1.0 / np.sqrt(mass))
    scaled = scale @ sparse.csc_array(M) @ scale + n * EPS * sparse.eye_array(n)
    motion = _least_motion(_factorised(scaled))
    if motion @ (scaled @ motion) < 2.0 * n * EPS * (motion @ motion):
        place = names[np.abs(scale @ motion).argmax()]
        raise InputError(f"{text}; a motion, largest at {place}, has none: condense it, or give it mass")


def static_modes(compliance: Array, largest: float) -> tuple[Array, Array, Array, Array]:
    """Stiffness, normal and tangential shapes and load of at most 2 c modes with a given static compliance.

    Rows of `compliance` are c normal gaps, c tangential gaps and the load. The frequencies of these modes are so
    high that their dynamic compliance differs from the static one by 1e-12 at the highest other frequency.
    """
    values, vectors = np.linalg.eigh(compliance[:-1, :-1])
    kept = values > 1e-9 * max(values.max(), 0.0)
    root = np.sqrt(STATIC * largest)
    shapes = vectors[:, kept] * np.sqrt(values[kept]) * root
    load = (compliance[-1, :-1] @ vectors[:, kept]) / np.sqrt(values[kept]) * root
    normal, tangential = shapes if len(shapes) == 2 else np.split(shapes, 2)
    return np.full(int(kept.sum()), STATIC * largest), normal, tangential, load
