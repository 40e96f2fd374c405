"""What it takes to leap over the quiet part of a stick: its motion in closed form.

While contact sticks and the clamp moves at constant speed, a step of `transient.fast_kernel` is an affine map of
x = (q, v), the same whatever mu, V and F: x' = M x + b + c k in the k-th step, for the clamp loads the contact
evenly. So x is a line in k plus a sum of the eigenvectors of M, each turning and shrinking by its eigenvalue z in
a step, and everything the step decides by is known at any later step: N, T, the gap that the element leaves open.

How far a leap goes: readings are looked at every time the velocity of B is heard, and between two looks, m steps
apart, none can be off the straight line between them by more than the sum over all modes of |amplitude|
min(2, |m log z|^2 / 8). Where N, mu N - T, mu N + T and the closing of the gap stay above that, no step between
can end stick. What a leap leaves behind is what the steps would have left, but for their rounding.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fivcore.beams.free_motion import propagator
from fivcore.beams.modes import one_blas_thread
from fivcore.jit import Array
from fivcore.transient.fast_solver import Solver
from fivcore.transient.lanes import WIDTH, aligned
from fivcore.transient.leap_sums import HEAD, LOOKS

# Eigenvectors are used where M X - X diag(z) is smaller, in units in which the energy is a sum of squares.
ACCURATE = 1e-10
# What must be left of every mode after a step: a reading is also told one step earlier.
LEAST = 1e-3


@lru_cache(maxsize=64)
@one_blas_thread()
def leaps(solver: Solver, hearing: int) -> Array | None:
    """What `fivcore.transient.leap_kernel.leap` needs, packed; None where stick has no decaying eigenvectors.

    Parameters
    ----------
    solver : Solver
        With an element: without one stick and its end are not told apart by forces alone.
    hearing : int
        Steps between two looks.

    Returns
    -------
    ndarray
        Parts one after another, as `fivcore.transient.leap_kernel` reads them; modes in the order of the lanes.
    """
    model, step = solver.model, solver.step
    if not model.K.any():
        return None
    n, t, size = model.normal, model.tangential, len(model.normal)
    stick = np.array(solver.laws[:8]).reshape(2, 4)
    zero = np.zeros(size)
    # Penetration, u_T and the rates before the kick, as far as they depend on x.
    seen = np.stack([np.r_[-n, zero], np.r_[-t, zero], np.r_[zero, n], np.r_[zero, t]])
    force = stick @ seen
    a, b, c, d = propagator(model.stiffness, model.damping, step)
    flow = np.block([[np.diag(a), np.diag(b)], [np.diag(c), np.diag(d)]])
    kick = step * np.concatenate([np.zeros((size, 2)), np.stack([n, t], axis=1)])
    matrix = flow @ (np.eye(2 * size) + kick @ force)
    # In these units the energy is the sum of squares: eigenvectors are then as well conditioned as they can be.
    omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, model.contact_frequency**2))
    units = np.concatenate([omega, np.ones(size)])
    scaled = units[:, None] * matrix / units
    try:
        z, X = np.linalg.eig(scaled)
        into = np.linalg.inv(X)
        still = np.linalg.inv(np.eye(2 * size) - matrix)
    except np.linalg.LinAlgError:
        return None
    wrong = np.abs(into @ (scaled @ X - X * z)).sum(axis=1).max()
    if not wrong < ACCURATE or not np.abs(z).max() < 1.0 or not np.abs(z).min() > LEAST:
        return None
    # One of each conjugate pair, counted twice.
    kept = np.flatnonzero(z.imag >= 0.0)
    twice = np.where(z.imag[kept] > 0.0, 2.0, 1.0)
    z, X, into = z[kept], (X / units[:, None])[:, kept] * twice, (into * units)[kept]
    # The line: what a steady force, and one that grows by as much in each step, make of x.
    steady = still @ (flow @ kick)
    growing = still @ steady
    on_b = 0.5 * step * np.array([model.point_b @ n, model.point_b @ t])
    N, T = force @ X
    P, U = seen[:2] @ X
    B = model.point_b @ X[size:] + on_b[0] * N + on_b[1] * T
    left = solver.laws[20] * P + solver.laws[21] * U
    log = np.log(z)
    readings = (log, 1.0 / (1.0 - z), N, T, B, P - left / z, P / z, U / z)
    bend = np.minimum(2.0, 0.125 * np.abs(hearing * log) ** 2)
    over = np.stack([*(part for reading in readings for part in (reading.real, reading.imag)), bend])
    shapes = [np.r_[n, t], np.r_[model.point_b, model.stiffness]]
    rows = np.stack([*steady.T, *growing.T, *shapes, *into.real, *into.imag, *X.T.real, *X.T.imag])
    # Modes as the lanes have them, with the places that stay empty.
    room = sum(solver.sizes)
    table = np.zeros((len(rows), 2 * room))
    table[:, np.r_[solver.place, room + solver.place]] = rows
    head = np.zeros(HEAD)
    head[:2] = len(z), room
    turns = np.cumprod(np.tile(z**hearing, (LOOKS, 1)), axis=0).T
    parts = head, turns.real.ravel(), -turns.imag.ravel(), over.ravel(), table.ravel()
    count = sum(len(part) for part in parts)
    packed = aligned(-(-count // WIDTH)).ravel()[:count]
    return np.concatenate(parts, out=packed)
