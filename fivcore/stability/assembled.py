"""Complex modes of assembled finite-element models with friction, and the friction at which they begin to grow.

Shift-invert Arnoldi computes all modes in a band at a few values of mu (Tisseur and Meerbergen, SIAM Review 43,
2001, 235-286). Their real and imaginary parts span a basis for the other values, at which Galerkin projection
leaves a small dense problem. The residual of each mode is tested in the full problem; if one fails, the full
problem is solved at that mu and its modes extend the basis. Up to UNPROJECTED degrees of freedom all problems are
solved densely.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import linalg, optimize, sparse
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs, splu

from fivcore import checks
from fivcore.beams.modes import EPS, one_blas_thread
from fivcore.errors import InputError, UnsolvedError
from fivcore.jit import Array, Complex, ReadOnlyArrays

# Degrees of freedom up to which nothing is projected.
UNPROJECTED = 200
# Bound of |Re lam| relative to the band; additional range that the basis covers.
SIDE, BASIS_MARGIN = 0.5, 1.1
# Number of eigenvalues computed at once, at the start and to check for missing ones; their ratio to the degrees of
# freedom above which a dense solve is faster; relative size of an independent component of a vector.
NEAREST, FURTHER, DENSE_SHARE, PARALLEL = 40, 8, 0.5, 1e-8
# Restarts of an Arnoldi method that take as long as a dense solve, by the squared ratio of degrees of freedom to
# vectors kept.
RESTARTS = 1.0
# Largest residual; largest residual due to directions missing from the basis; |Re lam| / |lam| of a neutral mode.
MOST_RESIDUAL, DROP, NEUTRAL = 1e-8, 1e-9, 1e-7
# Number of intervals of mu searched for onsets; shortest interval after bisection, relative to mu_max.
CELLS, SHORTEST_CELL = 64, 1e-5
_norm = partial(np.linalg.norm, axis=0)


@dataclass(frozen=True, eq=False)
class AssembledModes(ReadOnlyArrays):
    """Modes in a band, one of each conjugate pair, ascending in frequency; missing ones are NaN.

    Attributes
    ----------
    mu : ndarray, (...)
    frequency, growth_rate : ndarray, (..., modes)
        Im(lam) / 2 pi, Hz, 0 for a real eigenvalue; Re(lam), 1/s, above 0 for a mode that grows and exactly 0 for
        a neutral one, whose rate is below `growth_error` or below 1e-7 |lam|, the effect of the eighth digit of
        the matrices.
    residual : ndarray, (..., modes)
        |lam^2 M x + lam C x + (K + mu Kf) x| over the sum of the terms' norms, or over 1e8 times their rounding.
    growth_error : ndarray, (..., modes)
        Estimated error of lam, 1/s, to first order: condition number times residual and rounding.
    """

    mu: Array
    frequency: Array
    growth_rate: Array
    residual: Array
    growth_error: Array


class _Problem:
    """The matrices at any mu, and the basis. Modes are columns of an array: lam, residual, error, d lam / d mu."""

    def __init__(self, mu: float, fmax: float, *parts: Any) -> None:
        self.band, self.parts, self.fixed = 2.0 * np.pi * checks.band(fmax), parts, list[Any]()
        mass, _, stiffness, _ = self.matrices(mu)
        # Unit of lam: the band, unless all eigenvalues are far below it.
        scale = np.sqrt(abs(stiffness).max() / (abs(mass).max() or 1.0)) or self.band
        self.size, self.unit = mass.shape[0], min(self.band, float(scale))
        self.vectors = self.basis = np.eye(self.size, self.size if self.size <= UNPROJECTED else 0)
        self.small: list[Array] = []
        self.count, self.solutions = NEAREST, 0

    def matrices(self, mu: float) -> list[Any]:
        """M, C, K and Kf at this mu, checked."""
        if self.fixed:
            return self.fixed
        found: list[Any] = []
        for name, part in zip(("mass", "damping", "stiffness", "friction_stiffness"), self.parts, strict=True):
            value = part(mu) if callable(part) else part
            value = 0.0 * found[0] if value is None and name in ("damping", "friction_stiffness") else value
            found.append(sparse.csr_array(checks.square_matrix(name, value, found[0].shape[0] if found else None)))
        mass = found[0]
        if (most := abs(mass - mass.T).max()) > 1e-10 * abs(mass).max():
            raise InputError(f"mass differs from its transpose by {most:g}: it must be symmetric")
        self.fixed = [] if any(map(callable, self.parts)) else found
        return found

    def inside(self, lam: Complex, margin: float = 1.0) -> Any:
        top = margin * self.band
        return (lam.imag >= -NEUTRAL * self.unit) & (lam.imag <= top) & (np.abs(lam.real) <= SIDE * top)

    @one_blas_thread()
    def modes(self, mu: float) -> Complex:
        """All modes of the region at this mu; lam of a neutral one has the real part 0."""
        try:
            found = self.project(mu)
            lam, solved = found[0], found[1].real <= MOST_RESIDUAL
            if self.basis.shape[1] < self.size and (self.solutions < 3 or not solved.all()):
                lam, found = self.solve(mu), self.project(mu)
                found = found[:, found[1].real <= MOST_RESIDUAL]
                solved = np.abs(np.subtract.outer(lam, found[0])).min(axis=1, initial=np.inf) < 1e-6 * self.unit
        except (RuntimeError, np.linalg.LinAlgError) as error:
            text = "every degree of freedom needs mass, damping or stiffness"
            raise InputError(f"matrices at mu = {mu:g}: {error}; {text}") from None
        if (missing := lam[~solved & self.inside(lam)]).size:
            place = f"{missing[0].imag / (2.0 * np.pi):.6g} Hz, mu = {mu:g}"
            raise UnsolvedError(f"assembled modes: at {place}, a residual stays above {MOST_RESIDUAL:g}")
        found = found[:, self.inside(found[0])]
        found[0].real[np.abs(found[0].real) <= np.maximum(found[2].real, NEUTRAL * np.abs(found[0]))] = 0.0
        found[0].imag[np.abs(found[0].imag) <= NEUTRAL * self.unit] = 0.0
        return found[:, np.lexsort((found[0].real, found[0].imag))]

    def project(self, mu: float) -> Complex:
        """Modes of the projected problem in the region and its margin."""
        given = self.matrices(mu)
        if not self.small or not self.fixed:
            self.small = [self.basis.T @ (matrix @ self.basis) for matrix in given]
        # Inversion at a real shift: eigenvalues up to its size are accurate, however large the others are.
        shift, (m, c, k, f), size = 1.1 * self.unit, self.small, self.basis.shape[1]
        m, c, k = shift**2 * m, shift * c, k + mu * f
        half = np.linalg.solve(m + c + k, np.hstack([c + m, m]))
        inverse, left, right = linalg.eig(np.vstack([-half, np.eye(size, 2 * size) - half]), left=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            lam = shift + shift / inverse
            kept = self.inside(lam, BASIS_MARGIN)
            lam, right, left = lam[kept], right[:size, kept], (left[:size] + left[size:])[:, kept]
            left = np.linalg.solve((m + c + k).T, left)
            turn = np.sum(left.conj() * (2.0 * lam / shift * (m @ right) + c @ right), axis=0) / shift
            slope = -np.sum(left.conj() * (f @ right), axis=0) / turn
            full = given[0], given[1], given[2] + mu * given[3]
            rest, scale, rounding = _forces(*full, lam, self.basis @ right, self.unit)
            return np.array([lam, rest / scale, _norm(left) * (rest + rounding) / np.abs(turn), slope])

    def solve(self, mu: float) -> Complex:
        """Return the full problem's eigenvalues there, and add their vectors to the basis."""
        mass, damping, stiffness, friction = self.matrices(mu)
        stiffness, half = stiffness + mu * friction, 0.5 * BASIS_MARGIN * self.band
        # The disc about the middle of the region that contains the region and its margin.
        radius = float(np.hypot(half, SIDE * BASIS_MARGIN * self.band))
        pairs = _eigenvalues_near(mass, damping, stiffness, 1j * half, radius, self.count)
        if pairs is None:
            self.basis, self.small = np.eye(self.size), []
            return np.asarray(self.project(mu)[0])
        self.count = pairs.shape[1] + FURTHER
        lam, *_ = pairs = pairs[:, self.inside(pairs[0], BASIS_MARGIN)]
        vectors = pairs[1:]
        # Directions missing from the basis are measured by their forces, like residuals.
        vectors = vectors / _forces(mass, damping, stiffness, lam, vectors, self.unit)[1]
        weight = stiffness + (0.01 * self.unit) ** 2 * mass
        vectors = np.hstack([self.vectors, vectors.real, vectors.imag])
        _, values, turn = np.linalg.svd(weight @ vectors, full_matrices=False)
        kept = values > DROP
        self.vectors, self.small, self.solutions = vectors @ turn[kept].T, [], self.solutions + 1
        self.basis = np.linalg.qr(self.vectors / values[kept])[0]
        return lam


def _forces(m: Any, c: Any, k: Any, lam: Complex, x: Complex, unit: float) -> tuple[Any, Any, Any]:
    """Norms of (lam^2 M + lam C + K) x, of its reference, and of its rounding error."""
    forces, size = (lam**2 * (m @ x), lam * (c @ x), k @ x), np.maximum(np.abs(lam), unit)
    rounding = sum(size**power * abs(each).sum(axis=1).max() for power, each in enumerate((k, c, m)))
    rounding = 8.0 * EPS * rounding * _norm(x)
    return _norm(sum(forces)), np.maximum(sum(map(_norm, forces)), rounding / MOST_RESIDUAL), rounding


def _eigenvalues_near(m: Any, c: Any, k: Any, shift: complex, radius: float, count: int) -> Complex | None:
    """Find all eigenvalues in a disc and their vectors; None if there are so many that a dense solve is faster.

    Arnoldi iterations from random starts, each in the complement of the vectors found before, are repeated until
    one finds no further eigenvalue in the disc, because one iteration may miss members of a multiple eigenvalue.
    The first one computes `count`.
    """
    size, unit, force = m.shape[0], abs(shift), c + shift * m
    factors = splu((shift * force + k).tocsc(), permc_spec="MMD_AT_PLUS_A")
    random, basis = np.random.default_rng(0), np.zeros((2 * size, 0), dtype=complex)

    def invert(state: Complex) -> Complex:
        # The state is x and lam x / unit.
        x = -factors.solve(unit * (m @ state[size:]) + force @ state[:size])
        return np.concatenate([x, (state[:size] + shift * x) / unit])

    def left(state: Complex) -> Complex:
        state = invert(state)
        return state - basis @ (basis.conj().T @ state)

    operator = LinearOperator((2 * size, 2 * size), left, dtype=complex)
    while basis.shape[1] + count <= DENSE_SHARE * size:
        start, width = random.standard_normal(2 * size) + 0j, min(count + count // 4 + 20, 2 * size)
        # With overdamped modes, whose real eigenvalues are close together, restarts may take as long as a dense
        # solve.
        restarts = 1 + int(RESTARTS * (size / width) ** 2)
        try:
            inverse, states = eigs(operator, count, v0=start, ncv=width, tol=1e-12, maxiter=restarts)
        except ArpackError:  # Or too few eigenvalues are different.
            break
        near = np.abs(inverse) * radius > 1.0
        if not near.any():
            inverse, turn = np.linalg.eig(basis.conj().T @ invert(basis))
            return np.vstack([shift + 1.0 / inverse, (basis @ turn)[:size]])
        q, r = np.linalg.qr(states[:, near])
        # Of two parallel vectors, one is dropped and found again as an independent vector.
        basis = np.linalg.qr(np.hstack([basis, q[:, np.abs(np.diag(r)) > PARALLEL]]))[0]
        count = count if near.all() else FURTHER
    return None


def assembled_modes(
    mass: Any, damping: Any, stiffness: Any, *, friction_stiffness: Any = None, mu: Any = 1.0, fmax: float = 10e3
) -> AssembledModes:
    """All modes of (lam^2 M + lam C + K + mu Kf) x = 0 with 0 <= Im(lam) <= w, |Re(lam)| <= w / 2, w = 2 pi fmax.

    Real eigenvalues (overdamped or divergent motion) have frequency 0. With up to 200 degrees of freedom no mode
    is missing. Larger models are solved in full at the smallest, the largest and a middle mu, and at each mu at
    which a mode fails its residual test. There a mode is missing only if an Arnoldi iteration from a random start
    in the complement of all others does not find it; if the region contains a quarter of all modes, a dense solve
    is used. At other mu, a mode that enters the region may be missing if the basis does not contain it.

    Parameters
    ----------
    mass, damping, stiffness, friction_stiffness : array_like, sparse or callable
        Real. M is symmetric and may be singular; C, K and Kf need no symmetry; C and Kf may be None. A function
        is called with an entry of mu and returns the matrix: mu may be any parameter, such as a speed.
    mu : float or array_like
        Factor of Kf.
    fmax : float
        Band, Hz.

    Returns
    -------
    AssembledModes

    Raises
    ------
    ValueError, ArithmeticError
        For an argument out of range; for a residual that stays above 1e-8.
    """
    values = checks.array("mu", mu, lambda each: checks.number("mu", each, "a finite number", lambda _: True))
    places = np.unique(values).tolist()
    problem = _Problem(places[0] if places else 0.0, fmax, mass, damping, stiffness, friction_stiffness)
    # The largest first, then the smallest, the middle, quarters and so on.
    order = sorted(range(-1, len(places) - 1), key=lambda index: (index >= 0, f"{index:032b}"[::-1]))
    found = {places[index]: problem.modes(places[index]) for index in order}
    table = np.full((4, values.size, max((each.shape[1] for each in found.values()), default=0)), np.nan * 1j)
    for row, value in enumerate(values.ravel().tolist()):
        table[:, row, : found[value].shape[1]] = found[value]
    lam, residual, error, _ = table.reshape(4, *values.shape, table.shape[2])
    return AssembledModes(values, lam.imag / (2.0 * np.pi), lam.real, residual.real, error.real)


def assembled_onsets(
    mass: Any, damping: Any, stiffness: Any, friction_stiffness: Any, fmax: float = 10e3, mu_max: float = 1.0
) -> tuple[Array, Array]:
    """Factors mu of Kf at which a growth rate rises through zero, ascending, and frequencies there, Hz.

    A frequency of 0 means divergence. Growing modes are counted at CELLS + 1 values of mu; an interval is halved
    if their number increases by more than one, or if a tangent indicates growth. A mode that grows only within one
    interval without this indication is missed. Arguments and errors are those of `assembled_modes`, except that
    matrices may not be functions; both results are (n,).
    """
    parts = mass, damping, stiffness, friction_stiffness
    if any(map(callable, parts)):
        raise InputError("a matrix is a function: onsets need matrices; mu is the factor of friction_stiffness")
    most = checks.between("mu_max", mu_max, 1e-12, 1e6, "a factor of friction_stiffness")
    problem = _Problem(0.0, fmax, *parts)

    @cache
    def growing(mu: float) -> Complex:
        """Modes that are not neutral, the fastest growing first."""
        found = problem.modes(mu)
        order = np.argsort(-found[0].real)
        return found[:, order[found[0, order].real != 0.0]]

    def rate(mu: float, place: int) -> float:
        return float(growing(mu)[0, place].real) if place < growing(mu).shape[1] else -problem.unit

    grid, onsets = np.linspace(0.0, most, CELLS + 1).tolist(), []
    # The first three are solved in full.
    cells, _ = list(pairwise(grid)), [growing(mu) for mu in (0.0, most, grid[CELLS // 2])]
    while cells:
        low, high = cells.pop()
        ends = [(growing(mu)[0].real, growing(mu)[3].real * (0.5 * (low + high) - mu)) for mu in (low, high)]
        before, after = (int(np.count_nonzero(now > 0.0)) for now, _ in ends)
        doubt = any(((now < 0.0) & (now + 2.0 * change > 0.0)).any() for now, change in ends)
        if (after > before + 1 or (after <= before and doubt)) and high - low > SHORTEST_CELL * most:
            cells += [(low, 0.5 * (low + high)), (0.5 * (low + high), high)]
            continue
        for place in range(before, after):
            mu = root = optimize.brentq(rate, low, high, (place,), xtol=1e-14 * most, rtol=4.0 * EPS)
            step = 1e-14 * most
            while rate(mu, place) <= 0.0:
                mu, step = min(root + step, high), 4.0 * step
            # Back along the tangent, unless the mode was growing when it entered the region.
            lam, _, error, slope = growing(mu)[:, place]
            if lam.real < 100.0 * max(error.real, NEUTRAL * abs(lam)):
                back = lam.real / slope.real
                onsets.append((mu - back, (lam - back * slope).imag / (2.0 * np.pi)))
    mus, frequencies = np.array(sorted(onsets)).reshape(-1, 2).T
    return mus, frequencies
