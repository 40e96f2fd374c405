"""Complex eigenvalues of steady sliding: frequencies, growth rates and shapes (section 3.4 of the paper).

V > 0 throughout: the sign of V matters only together with that of theta (`Scene.drive_theta`), its size and
the load F not at all. Proportional damping only maps the undamped eigenvalue lambda to the pair phi with
phi^2 + (d1 + d2 lambda) phi + lambda = 0, so every eigenvalue comes from one scalar equation
(`fivcore.secular`) whatever the damping.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.optimize import brentq

from fivcore import checks, secular
from fivcore.bases import one_blas_thread, rig_bases
from fivcore.kernel import Array, Complex
from fivcore.rig import Rig

# Poles up to this many times the band (in frequency) are kept; the power series of the others then loses a
# factor of 16 a term within the band and of 4 at twice the band, where the roots are still counted.
NEAR = 4.0
TAIL_TERMS = 26

# Stands where there are fewer eigenvalues than places for them: far beyond any band.
OUTSIDE = 1e12
NOTHING = complex(np.nan, np.nan)


@dataclass(frozen=True, eq=False)
class _Problem:
    """The sliding problem of one rig, theta and band, ready for any mu. Scaled by the band's lambda."""

    unit: float  # rad2/s2
    poles: Array
    a: Array
    b: Array
    tail_a: Array
    tail_b: Array
    guesses: Complex
    radius: float
    hidden: Array  # eigenvalues that the contact does not see, scaled
    hidden_modes: NDArray[np.int64]  # (k, 2): the separate mode, and a second where two coincide, else -1
    stiffness: Array
    normal: Array
    tangential: Array


@dataclass(frozen=True, eq=False)
class SlidingModes:
    """Modes of steady sliding within a band, ascending in frequency; missing ones are NaN.

    The leading dimensions, written `...`, are those of theta and mu broadcast; the last is the mode.

    Attributes
    ----------
    frequency : ndarray, (..., modes)
        Im(phi) / 2 pi, Hz; zero for a mode that does not oscillate.
    growth_rate : ndarray, (..., modes)
        Re(phi), 1/s: above zero the steady sliding state is unstable (the paper's eta with its sign turned).
    eigenvalue : ndarray, (..., modes)
        The undamped eigenvalue lambda, rad2/s2.
    theta, mu : ndarray, (...)
        Degrees and 1.
    fmax : float
        The band, Hz: modes above it are not listed. Above 20 kHz the undamped model has growing pairs that
        depend on mesh and basis; a result means something only with its band and damping.
    rig : Rig
    """

    frequency: Array
    growth_rate: Array
    eigenvalue: Complex
    theta: Array
    mu: Array
    fmax: float
    rig: Rig
    _hidden: NDArray[np.int64]

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """(..., modes): whether the mode grows."""
        return np.asarray(self.growth_rate > 0.0)

    @property
    def shape(self) -> Complex:
        """(..., modes, nodes, 3): displacement along x, along y, and rotation at the nodes.

        P1's nodes from A to C come first, then P2's from the clamp to the free end (`node_positions`).
        Scaled so that the largest translation is 1. Computed when asked for.
        """
        lead, modes = self.frequency.shape[:-1], self.frequency.shape[-1]
        nodes = self.rig.p1.elements + self.rig.p2.elements + 2
        shapes = np.full((*lead, modes, nodes, 3), NOTHING)
        for index in np.ndindex(*lead, modes):
            if np.isfinite(self.frequency[index]):
                theta, mu = float(self.theta[index[:-1]]), float(self.mu[index[:-1]])
                shapes[index] = _shape(
                    self.rig, theta, mu, self.fmax, self.eigenvalue[index], int(self._hidden[index])
                )
        return shapes


def sliding_modes(rig: Rig, theta: Any, mu: Any, fmax: float = 10e3) -> SlidingModes:
    """Complex modes of the steady sliding state for V > 0 (equations (10) to (12) of the paper).

    Parameters
    ----------
    rig : Rig
    theta : float or array_like
        Inclination of P1, degrees; broadcast against `mu`. A basis is built once for each distinct theta.
    mu : float or array_like
        Coefficient of friction.
    fmax : float
        Band, Hz.

    Returns
    -------
    SlidingModes

    Raises
    ------
    ValueError
        For an argument out of range.
    ArithmeticError
        If the eigenvalues found do not match their number by the argument principle, so that one could have
        been missed.

    Notes
    -----
    The eigenvalues are those of the finite-element model with all its modes: no truncation error. The mode
    near 8 kHz that does not depend on mu is P2's axial one, which the contact drives but never feels.
    """
    band = checks.positive("fmax", fmax, "Hz")
    angles = checks.array("theta", theta, checks.theta_degrees)
    frictions = checks.array("mu", mu, checks.friction)
    try:
        angles, frictions = np.broadcast_arrays(angles, frictions)
    except ValueError:
        raise ValueError(
            f"mu of shape {frictions.shape}: it must broadcast with theta of shape {angles.shape}"
        ) from None
    lead = angles.shape
    flat_theta, flat_mu = angles.ravel(), frictions.ravel()

    found: list[tuple[NDArray[np.intp], Complex, Complex, NDArray[np.int64]]] = []
    most = 0
    distinct, member = np.unique(flat_theta, return_inverse=True)
    for t, angle in enumerate(distinct):
        points = np.nonzero(member == t)[0]
        phi, eigenvalues, hidden = _eigenvalues(rig, float(angle), flat_mu[points], band)
        found.append((points, phi, eigenvalues, hidden))
        most = max(most, phi.shape[1])

    frequency = np.full((flat_mu.size, most), np.nan)
    growth = np.full_like(frequency, np.nan)
    eigenvalue = np.full(frequency.shape, NOTHING)
    which = np.full(frequency.shape, -1, dtype=np.int64)
    for points, phi, eigenvalues, hidden in found:
        modes = phi.shape[1]
        frequency[points, :modes] = phi.imag / (2.0 * np.pi)
        growth[points, :modes] = phi.real
        eigenvalue[points, :modes] = eigenvalues
        which[points, :modes] = hidden
    full = (*lead, most)
    return SlidingModes(
        frequency.reshape(full),
        growth.reshape(full),
        eigenvalue.reshape(full),
        angles,
        frictions,
        band,
        rig,
        which.reshape(full),
    )


def node_positions(rig: Rig, theta: float) -> Array:
    """Undeformed x, y of all nodes relative to the contact point, m, in the order of `SlidingModes.shape`."""
    upper, lower = rig_bases(rig, checks.theta_degrees(theta))
    return np.concatenate([upper.nodes, lower.nodes])


def _eigenvalues(rig: Rig, theta: float, mu: Array, fmax: float) -> tuple[Complex, Complex, NDArray[np.int64]]:
    """Phi and lambda within the band, (mu, modes), ascending in frequency; and the hidden modes' indices."""
    problem = _problem(rig, theta, fmax)
    roots = _roots(problem, mu)
    n, k = roots.shape[1], len(problem.hidden)
    values = np.empty((len(mu), n + k), dtype=complex)
    values[:, :n], values[:, n:] = roots, problem.hidden
    values *= problem.unit
    which = np.concatenate([np.full(n, -1), np.arange(k)])

    phi = np.empty_like(values)
    secular.damp(values, rig.d1, rig.d2, phi)
    # Guesses beyond the counted circle serve to keep the others honest and are not results.
    outside = (phi.imag > 2.0 * np.pi * fmax) | (np.abs(values) > problem.radius * problem.unit)
    frequency = np.where(outside, np.inf, phi.imag)
    order = np.lexsort((phi.real, frequency), axis=-1)
    modes = int((~outside).sum(axis=1).max(initial=0))
    order = order[:, :modes]
    keep = np.take_along_axis(~outside, order, axis=1)
    phi = np.where(keep, np.take_along_axis(phi, order, axis=1), NOTHING)
    values = np.where(keep, np.take_along_axis(values, order, axis=1), NOTHING)
    return phi, values, np.where(keep, which[order], -1)


def _roots(problem: _Problem, mu: Array) -> Complex:
    """Scaled eigenvalues for each mu, all within the counted circle among them."""
    system = (problem.poles, problem.a, problem.b, problem.tail_a, problem.tail_b)
    roots = np.empty((len(mu), len(problem.guesses)), dtype=complex)
    missed = np.zeros(len(mu), dtype=np.int64)
    secular.sliding_roots(mu, *system, problem.guesses, problem.radius, roots, missed)
    for m in np.nonzero(missed)[0]:
        # More roots have come into the circle than there were guesses (large mu, on few rigs): start anew
        # from a dense solve with all modes.
        guesses = _dense_guesses(problem, float(mu[m]))
        again = np.empty((1, len(guesses)), dtype=complex)
        secular.sliding_roots(mu[m : m + 1], *system, guesses, problem.radius, again, missed[m : m + 1])
        if missed[m]:
            raise ArithmeticError(
                f"sliding_modes: {missed[m]} eigenvalues unaccounted for at mu = {mu[m]:g}; change fmax"
            )
        wider = max(0, len(guesses) - roots.shape[1])
        roots = np.pad(roots, ((0, 0), (0, wider)), constant_values=OUTSIDE)
        roots[m] = OUTSIDE
        roots[m, : len(guesses)] = again[0]
    return roots


def _dense_guesses(problem: _Problem, mu: float) -> Complex:
    """Eigenvalues in and around the circle, from the modes of both beams with the constraint eliminated."""
    seen = problem.normal != 0.0
    stiffness, normal = problem.stiffness[seen] / problem.unit, problem.normal[seen]
    force = normal + mu * problem.tangential[seen]
    with one_blas_thread():
        right, left = null_space(normal[None]), null_space(force[None])
        flexible = np.linalg.solve(left.T @ (stiffness[:, None] * right), left.T @ right)
        values = (1.0 / np.linalg.eigvals(flexible)).astype(complex)
    # Eigenvalues of modes that no other guess may settle on come along.
    near = values[np.abs(values) < 2.0 * problem.radius]
    return near[np.lexsort((near.imag, near.real))]


@lru_cache(maxsize=128)
def _problem(rig: Rig, theta: float, fmax: float) -> _Problem:
    stiffness, normal, tangential = contact_modes(rig, theta)
    unit = (2.0 * np.pi * fmax) ** 2
    order = np.argsort(stiffness, kind="stable")
    p = stiffness[order] / unit
    a = normal[order] ** 2 / unit
    b = normal[order] * tangential[order] / unit

    # A mode the contact does not see keeps its eigenvalue: its root is nearer to the pole than rounding.
    static = np.sum(a[p > 0.0] / p[p > 0.0])
    seen = np.maximum(a, np.abs(b)) > 1e-17 * static * p
    hidden = [(p[i], order[i], -1) for i in np.nonzero(~seen)[0]]
    p, a, b, order = p[seen], a[seen].copy(), b[seen].copy(), order[seen]
    # Of two modes with one frequency, one combination leaves the gap closed and is hidden.
    single = np.ones(len(p), dtype=bool)
    for i in range(1, len(p)):
        if p[i] - p[i - 1] <= 4.0 * secular.EPS * p[i]:
            hidden.append((p[i], order[i - 1], order[i]))
            a[i] += a[i - 1]
            b[i] += b[i - 1]
            single[i - 1] = False
    p, a, b = p[single], a[single], b[single]

    # At least one pole beyond the band, so that every root in it lies between two that are kept.
    near = max(int(np.searchsorted(p, NEAR**2)), min(int(np.searchsorted(p, 1.0)) + 2, len(p)))
    powers = p[near:, None] ** -np.arange(1.0, TAIL_TERMS + 1.0)
    tail_a, tail_b = a[near:] @ powers, b[near:] @ powers
    p, a, b = p[:near], a[:near], b[:near]

    # Without friction the residues are positive: exactly one root between any two poles.
    starts = np.array(
        [
            brentq(secular.between, p[i], p[i + 1], args=(i, p, a, tail_a), xtol=1e-300, rtol=1e-12)
            for i in range(near - 1)
        ]
    )
    marks = np.sort(np.concatenate([p, starts]))
    radius = _quiet_radius(marks)
    # Neighbours start on opposite sides of the real axis, ready to become a pair.
    tilt = np.where(np.arange(len(starts)) % 2, 1e-3j, -1e-3j)
    guesses = starts * (1.0 + tilt)
    if np.any(tail_a):
        # One more for what friction may bring in from outside, above all along the negative real axis.
        guesses = np.append(guesses, radius * (-1.0 + 0.1j))
    kept = sorted(h for h in hidden if h[0] <= radius)
    return _Problem(
        unit,
        p,
        a,
        b,
        tail_a,
        tail_b,
        guesses.astype(complex),
        radius,
        np.array([h[0] for h in kept]),
        np.array([h[1:] for h in kept], dtype=np.int64).reshape(-1, 2),
        stiffness,
        normal,
        tangential,
    )


def _quiet_radius(marks: Array) -> float:
    """A circle around the band and the strongly growing modes near it that stays clear of poles and roots."""
    candidates = marks[(marks > 1.5) & (marks < 6.0)]
    edges = np.concatenate([[1.5], candidates, [6.0]])
    widest = int(np.argmax(edges[1:] / edges[:-1]))
    return float(np.sqrt(edges[widest] * edges[widest + 1]))


def contact_modes(rig: Rig, theta: float) -> tuple[Array, Array, Array]:
    """Stiffness, normal and tangential gap shapes of both beams' modes, P1's first."""
    if not isinstance(rig, Rig):
        raise ValueError(f"rig = {rig!r}: it must be a Rig")
    upper, lower = rig_bases(rig, theta)
    return (
        np.concatenate([upper.stiffness, lower.stiffness]),
        np.concatenate([upper.normal, lower.normal]),
        np.concatenate([upper.tangential, lower.tangential]),
    )


def _shape(rig: Rig, theta: float, mu: float, fmax: float, eigenvalue: Any, hidden: int) -> Complex:
    upper, lower = rig_bases(rig, theta)
    problem = _problem(rig, theta, fmax)
    q = np.zeros(len(problem.stiffness), dtype=complex)
    if hidden >= 0:
        first, second = problem.hidden_modes[hidden]
        q[first] = 1.0
        if second >= 0:
            q[first], q[second] = problem.normal[second], -problem.normal[first]
    else:
        # q_i = (n_i + mu t_i) N / (p_i - lambda), with N chosen so that the nearest pole does no harm.
        force = problem.normal + mu * problem.tangential
        distance = problem.stiffness - eigenvalue
        nearest = int(np.argmin(np.where(force != 0.0, np.abs(distance), np.inf)))
        others = np.arange(len(q)) != nearest
        q[nearest] = force[nearest]
        q[others] = force[others] * distance[nearest] / distance[others]
    split = len(upper.stiffness)
    shape = np.concatenate([upper.shapes @ q[:split], lower.shapes @ q[split:]])
    translations = shape[:, :2].ravel()
    return np.asarray(shape / translations[np.argmax(np.abs(translations))])
