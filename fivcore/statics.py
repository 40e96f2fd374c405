"""Statics of several contacts: which of them a load closes is a linear complementarity problem.

At rest, with T = 0, 0 <= N is complementary to gap + n q >= 0. The equilibrium is that of least energy, the point
of a polyhedron next to another, which nonnegative least squares finds (Lawson and Hanson, Solving Least Squares
Problems, 1974, chapter 23). Rigid motions are held by springs that the iteration moves along until they bear
nothing (proximal point; Rockafellar, SIAM J. Control Optim. 14, 1976, 877-898). Then the contacts that were found
are solved exactly.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from fivcore.errors import InputError
from fivcore.jit import Array

# Share of the largest force, and of the largest gap by a single force, that is rounding; most iterations.
ROUNDING, ITERATIONS = 1e-9, 500
# Springs of rigid motions, in units of what the load needs to move them as far as all else.
SOFT = 1e-2


def resting(stiffness: Array, normal: Array, load: Array, gap: Array) -> tuple[Array, Array]:
    """Normal forces, N, and gaps, m, of c contacts at rest, each (c,).

    Parameters
    ----------
    stiffness, load : ndarray, (n,)
        Of the modes, rad2/s2, 0 for a rigid motion; modal forces, N kg^-1/2.
    normal, gap : ndarray, (c, n), (c,)
        What the modes add to the gaps, kg^-1/2; initial gaps, m.

    Raises
    ------
    ValueError
        Where the load moves the structure away, or turns it over the contacts.
    """
    rigid = stiffness == 0.0
    soft = 1.0 / np.where(rigid, np.inf, stiffness)
    held, moved = normal[:, rigid], load[rigid]
    if len(moved) and nnls(held.T, -moved)[1] > ROUNDING * np.abs(load).max():
        raise InputError("load: with it the structure moves away or turns over, and no contact forces hold it")
    compliance, free = (normal * soft) @ normal.T, gap + normal @ (soft * load)
    # So soft that the load moves a rigid body further than gaps and elastic modes are wide, but seen beside them.
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
        found = _closed(compliance, held, free, moved, ROUNDING * N.max(initial=0.0) < N)
        if found is not None:
            # What touches without a force may share one.
            touching = found[1] <= ROUNDING * (np.abs(free).max() + np.abs(compliance @ found[0]).max(initial=0.0))
            return _closed(compliance, held, free, moved, touching) or found
    raise InputError("load: the contacts that it closes are not found; check load, normal and gap")


def _closed(
    compliance: Array, held: Array, free: Array, moved: Array, closed: Array
) -> tuple[Array, Array] | None:
    """Forces and gaps with these contacts closed, if none of the former pulls and none of the latter overlaps."""
    c, r = int(closed.sum()), held.shape[1]
    system = np.zeros((c + r, c + r))
    system[:c, :c], system[:c, c:], system[c:, :c] = (
        compliance[np.ix_(closed, closed)],
        held[closed],
        held[closed].T,
    )
    # In units in which compliance and rigid motions are of order 1.
    unit = float(np.abs(system[:c, :c]).max(initial=0.0)) or 1.0
    scale = np.repeat([unit**-0.5, unit**0.5 / (np.abs(system[:c, c:]).max(initial=0.0) or 1.0)], [c, r])
    # Where contacts share a force in many ways, that with the least squares of all.
    system, right = scale[:, None] * system * scale, scale * np.append(-free[closed], -moved)
    solved = np.linalg.lstsq(system, right, rcond=1e-12)[0]
    held_at_rest = np.abs(system @ solved - right).max(initial=0.0) <= ROUNDING * np.abs(right).max(initial=0.0)
    solved *= scale
    forces = np.zeros(len(free))
    forces[closed] = solved[:c]
    gaps = free + compliance @ forces + held @ solved[c:]
    gaps[closed] = 0.0
    size = float(np.abs(free).max() + np.abs(compliance @ np.abs(forces)).max(initial=0.0))
    if not held_at_rest or forces.min(initial=0.0) < 0.0 or gaps.min(initial=0.0) < -ROUNDING * size:
        return None
    return forces, gaps
