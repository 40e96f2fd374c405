"""Statics of several contacts: a linear complementarity problem determines which of them a load closes.

At rest with T = 0, Signorini's conditions are 0 <= N, gap + n q >= 0, and N (gap + n q) = 0. The equilibrium
minimises the energy, a least-distance problem that nonnegative least squares solves (Lawson and Hanson, Solving
Least Squares Problems, 1974, chapter 23). Rigid-body motions are supported by springs whose anchor points the
iteration moves until the springs carry no force (proximal point algorithm; Rockafellar, SIAM J. Control Optim. 14,
1976, 877-898). The equations of the contacts found closed are then solved exactly.

In steady sliding the friction forces T = mu N act as well. The problem is then not symmetric and may have no
solution or several. Up to ALL_SETS contacts, all sets of closed contacts are compared; with more, contacts with
negative force are opened and penetrating ones closed, all at once and then one by one (Murty, Linear Algebra Appl.
7, 1974, 65-108).
"""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls

from fivcore.errors import InputError
from fivcore.jit import Array

# Rounding relative to the largest force, and to the largest gap due to a single force; most iterations.
ROUNDING, ITERATIONS = 1e-9, 500
# Stiffness of the springs of rigid motions, relative to that at which they move as far as all else.
SOFT = 1e-2
# Largest number of contacts for which all sets are compared; size of the sets that are compared after a search.
# Regularising springs of a trial, at contacts and at rigid motions, relative to the other terms; relative
# tolerance of forces and gaps of a trial.
ALL_SETS, FEW, CONTACT_SPRING, RIGID_SPRING, TRIAL = 8, 4, 1e-12, 1e-8, 1e-6
# Gap in steady sliding that counts as rounding, so that coincident contacts share their force.
TOUCHING = 1e-12


class _Problem(NamedTuple):
    """Gaps = free + compliance N + held x, and pushed^T N + moved = 0 on rigid motions x."""

    compliance: Array
    held: Array
    pushed: Array
    free: Array
    moved: Array

    @property
    def scale(self) -> Array:
        """Units, (c + r,), in which compliance and rigid motions are of order 1."""
        unit = float(np.abs(self.compliance).max(initial=0.0)) or 1.0
        rigid = unit**0.5 / (np.abs(self.held).max(initial=0.0) or 1.0)
        return np.repeat([unit**-0.5, rigid], self.held.shape)

    def system(self) -> tuple[Array, Array]:
        """Matrix and right side for all contacts closed."""
        r = self.held.shape[1]
        matrix = np.block([[self.compliance, self.held], [self.pushed.T, np.zeros((r, r))]])
        return matrix, -np.append(self.free, self.moved)

    def part(self, closed: Array) -> _Problem:
        """The problem of some contacts, (c,) of bool."""
        compliance = self.compliance[np.ix_(closed, closed)]
        return _Problem(compliance, self.held[closed], self.pushed[closed], self.free[closed], self.moved)

    def size(self, forces: Array) -> Array:
        """Magnitude, (...), of the terms that add up to the gaps."""
        opened = np.abs(np.abs(forces) @ self.compliance.T).max(axis=-1, initial=0.0)
        return np.asarray(np.abs(self.free).max() + opened)


def _problem(stiffness: Array, normal: Array, push: Array, load: Array, gap: Array) -> _Problem:
    rigid = stiffness == 0.0
    soft = normal / np.where(rigid, np.inf, stiffness)
    return _Problem(soft @ push.T, normal[:, rigid], push[:, rigid], gap + soft @ load, load[rigid])


def resting(stiffness: Array, normal: Array, load: Array, gap: Array) -> tuple[Array, Array]:
    """Normal forces, N, and gaps, m, of c contacts at rest, each (c,).

    Parameters
    ----------
    stiffness, load : ndarray, (n,)
        Of the modes, rad2/s2, 0 for a rigid motion; modal forces, N kg^-1/2.
    normal, gap : ndarray, (c, n), (c,)
        Gap shapes of the modes, kg^-1/2; initial gaps, m.

    Raises
    ------
    ValueError
        If the load moves the structure away or tips it over the contacts.
    """
    rigid, problem = stiffness == 0.0, _problem(stiffness, normal, normal, load, gap)
    compliance, held, _, free, moved = problem
    if len(moved) and nnls(held.T, -moved)[1] > ROUNDING * np.abs(load).max():
        raise InputError("load: with it the structure moves away or turns over, and no contact forces hold it")
    # So soft that rigid displacements exceed gaps and elastic deflections, but do not hide them in rounding.
    wide = float(np.abs(free).max() + np.trace(compliance) * np.abs(load).max()) or 1.0
    unit = SOFT * float(np.abs(held).max(initial=0.0) * np.abs(moved).max(initial=0.0)) / wide or 1.0
    springs = np.where(rigid, unit, stiffness)
    shapes, q = normal / np.sqrt(springs), np.zeros(len(load))
    for _ in range(ITERATIONS):
        still = (load + np.where(rigid, unit * q, 0.0)) / springs
        opening = -(gap + normal @ still)
        size = float(np.abs(opening).max()) or 1.0
        length = float(np.linalg.norm(shapes, axis=1).max())
        dual = nnls(np.vstack([shapes.T / length, opening / size]), np.eye(1, len(load) + 1, len(load))[0])[0]
        N = dual / max(1.0 - float(dual @ opening) / size, 1e-300) * size / length**2
        q = still + (normal.T @ N) / springs
        found = _settled(problem, ROUNDING * N.max(initial=0.0) < N)
        if found is not None:
            return found
    raise InputError("load: the contacts that it closes are not found; check load, normal and gap")


def sliding(stiffness: Array, normal: Array, push: Array, load: Array, gap: Array) -> list[tuple[Array, Array]]:
    """All equilibria of steady sliding as normal forces, N, and gaps, m, each (c,); none if the contacts jam.

    Parameters are those of `resting` and `push`, (c, n), the modal response to normal forces with their friction.
    With more than ALL_SETS contacts at most one equilibrium is found.
    """
    problem, c, found = _problem(stiffness, normal, push, load, gap), len(gap), list[tuple[Array, Array]]()
    sets: Any = (np.arange(2**c)[:, None] >> np.arange(c)) % 2 == 1 if c <= ALL_SETS else _searched(problem)
    if c > ALL_SETS and _closed(problem, sets[0]) is None:
        places = [each for count in range(FEW + 1) for each in combinations(range(c), count)]
        sets = np.array([np.isin(np.arange(c), each) for each in places])
    forces, gaps = _trials(problem, sets)
    wrong = TRIAL * np.abs(forces).max(axis=1, keepdims=True), TRIAL * problem.size(forces)[:, None]
    for closed in sets[np.all((forces >= -wrong[0]) & (sets | (gaps >= -wrong[1])), axis=1)]:
        one = _settled(problem, closed, TOUCHING)
        # If contacts can share a force in many ways, one of these is an equilibrium.
        if one and not any(np.abs(one[1] - gaps).max() <= TRIAL * problem.size(one[0]) for _, gaps in found):
            found.append(one)
    return found[: None if c <= ALL_SETS else 1]


def sliding_forces(stiffness: Array, normal: Array, push: Array, load: Array, gap: Array, closed: Any) -> Array:
    """Normal forces, N, (c,), that keep these contacts closed in steady sliding; they may be negative."""
    return _solved(_problem(stiffness, normal, push, load, gap), closed)[0]


def _trials(problem: _Problem, sets: Array) -> tuple[Array, Array]:
    """Forces and gaps, (k, c), with soft springs, for sets of closed contacts, (k, c)."""
    (c, r), scale, (matrix, right) = problem.held.shape, problem.scale, problem.system()
    matrix = scale[:, None] * matrix * scale + np.diag(np.repeat([CONTACT_SPRING, -RIGID_SPRING], [c, r]))
    there = np.hstack([sets, np.ones((len(sets), r), dtype=bool)])
    matrices = np.where(there[:, :, None] & there[:, None], matrix, 0.0) + ~there[:, None] * np.eye(c + r)
    solved = scale * np.linalg.solve(matrices, np.where(there, scale * right, 0.0)[..., None])[..., 0]
    forces = solved[:, :c]
    return forces, problem.free + forces @ problem.compliance.T + solved[:, c:] @ problem.held.T


def _searched(problem: _Problem) -> Array:
    """Search for a set of closed contacts, (1, c), without tension or penetration; else return the last trial."""
    closed = np.ones((1, len(problem.free)), dtype=bool)
    for k in range(ITERATIONS):
        forces, gaps = _trials(problem, closed)
        wrong = np.where(closed, forces < 0.0, gaps < 0.0)
        if not wrong.any():
            break
        # Changing all at once may cycle.
        closed = closed ^ (wrong if k < len(problem.free) else wrong & (wrong.cumsum() == 1))
    return closed


def _settled(problem: _Problem, closed: Array, rounding: float = ROUNDING) -> tuple[Array, Array] | None:
    """`_closed` with all touching contacts included, to a tolerance of the gaps."""
    found = _closed(problem, closed)
    if found is None:
        return None
    # A contact that touches without force may share one.
    opened = np.abs(problem.compliance @ found[0]).max(initial=0.0)
    return _closed(problem, found[1] <= rounding * (np.abs(problem.free).max() + opened)) or found


def _closed(problem: _Problem, closed: Array) -> tuple[Array, Array] | None:
    """Forces and gaps with these contacts closed, if no force is negative and no gap penetrates."""
    forces, gaps, balanced = _solved(problem, closed)
    if not balanced or forces.min(initial=0.0) < 0.0 or gaps.min() < -ROUNDING * problem.size(forces):
        return None
    return forces, gaps


def _solved(problem: _Problem, closed: Array) -> tuple[Array, Array, bool]:
    """Forces and gaps with these contacts closed, and whether they balance the load."""
    part = problem.part(closed)
    scale, (system, right), forces = part.scale, part.system(), np.zeros(len(closed))
    # If contacts can share a force in many ways, the least-squares solution.
    system, right = scale[:, None] * system * scale, scale * right
    solved = np.linalg.lstsq(system, right, rcond=1e-12)[0]
    balanced = np.abs(system @ solved - right).max(initial=0.0) <= ROUNDING * np.abs(right).max(initial=0.0)
    forces[closed], rigid = np.split(scale * solved, [len(part.free)])
    gaps = problem.free + problem.compliance @ forces + problem.held @ rigid
    gaps[closed] = 0.0
    return forces, gaps, bool(balanced)
