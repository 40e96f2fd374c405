"""The published scheme in finite-element coordinates, compiled: what the paper's authors would have run.

Newmark's method with beta = 0 and gamma = beta2, contact by Lagrange multipliers at the end of each step. K, M and
M + b dt C are banded (five diagonals on either side: three freedoms a node); the last is factored once. In exact
arithmetic it is `method="paper"`, which does the same in the modes of the separate beams.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded

from fivcore import Beam, Rig, Scene, Transient
from fivcore.beams.elements import hermite
from fivcore.beams.modes import rig_bases
from fivcore.contact.reduced import full_model
from fivcore.jit import kernel
from fivcore.transient.published import BETA2, STEP, TAU, published_contact

Array = NDArray[np.float64]
# Diagonals on either side of the main one.
BAND = 5


def element_matrices(beam: Beam) -> tuple[Array, Array]:
    """Stiffness and consistent mass of one element, (6, 6), on (u, w, rotation) at either end."""
    h = beam.length / beam.elements
    k, m = np.zeros((2, 6, 6))
    ends, bends = np.ix_((0, 3), (0, 3)), np.ix_((1, 2, 4, 5), (1, 2, 4, 5))
    levers = np.outer((1.0, h, 1.0, h), (1.0, h, 1.0, h))
    k[ends] = beam.axial_stiffness / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
    rows: Any = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    k[bends] = beam.bending_stiffness / h**3 * levers * np.array(rows)
    mass = beam.mass / beam.elements
    m[ends] = mass / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    rows = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    m[bends] = mass / 420.0 * levers * np.array(rows)
    return k, m


def assemble(rig: Rig, theta: float) -> list[Array]:
    """Both beams in x and y: P1's nodes from C to A, of which only y is free, then P2's without the clamped one.

    K and M as bands (6, n), row d being the d-th diagonal below the main one; rows (n,) that read the gap, the
    shift of the surfaces without the clamp's own, and the displacement of B; forces (n,) of a unit load, and of a
    unit acceleration of the clamp for motion relative to it.
    """
    sine, cosine = np.sin(np.radians(theta)), np.cos(np.radians(theta))
    n1, n2 = 3 * (rig.p1.elements + 1), 3 * (rig.p2.elements + 1)
    K, M = np.zeros((2, n1 + n2, n1 + n2))
    for beam, first, axis in ((rig.p1, 0, (sine, cosine)), (rig.p2, n1, (1.0, 0.0))):
        turn = np.array([[axis[0], axis[1], 0.0], [-axis[1], axis[0], 0.0], [0.0, 0.0, 1.0]])
        both = np.kron(np.eye(2), turn)
        k, m = (both.T @ part @ both for part in element_matrices(beam))
        for e in range(beam.elements):
            at = slice(first + 3 * e, first + 3 * e + 6)
            K[at, at] += k
            M[at, at] += m
    M[n1 - 2, n1 - 2] += rig.head_mass
    normal, tangential, point_b, weight = np.zeros((4, n1 + n2))
    axial_row, bending_row = hermite(rig.p2, rig.contact_position)
    normal[1], tangential[0] = 1.0, 1.0
    normal[n1 + 4 :: 3], normal[n1 + 5 :: 3] = -bending_row[0::2], -bending_row[1::2]
    tangential[n1 + 3 :: 3] = -axial_row
    weight[n1 - 2] = -1.0
    place = rig.point_b * rig.p1.elements
    node = min(int(place), rig.p1.elements - 1)
    point_b[3 * node], point_b[3 * node + 3] = 1.0 - (place - node), place - node
    along = np.zeros(n1 + n2)
    along[n1::3] = 1.0
    inertia = -M @ along
    # At A only y is free; P2's first node is clamped.
    free = np.ones(n1 + n2, dtype=bool)
    free[[n1 - 3, n1 - 1, n1, n1 + 1, n1 + 2]] = False
    bands = [
        np.array([np.pad(np.diag(part[np.ix_(free, free)], -d), (0, d)) for d in range(BAND + 1)])
        for part in (K, M)
    ]
    return [*bands, *(row[free] for row in (normal, tangential, point_b, weight, inertia))]


def run(scene: Scene, duration: float, ramp: float, sample_rate: float) -> Transient:
    """Run the scheme with the paper's step, beta2 and tau from rest under the load, for V > 0 and a ramp."""
    dt, b, rig = STEP, BETA2, scene.rig
    K, M, normal, tangential, point_b, weight, inertia = assemble(rig, scene.theta)
    implicit = cholesky_banded((1.0 + b * dt * rig.d1) * M + b * dt * rig.d2 * K, lower=True)
    implicit[0] = 1.0 / implicit[0]
    rows = (normal, tangential)
    per = [row.copy() for row in rows]
    for each in per:
        _solve(implicit, each)
    scale = dt**2 * (b + 0.5)
    closing = tuple(scale * float(rows[i] @ per[j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    # Every mode's static displacement, put together at the free nodes.
    upper, lower = rig_bases(rig, scene.theta)
    of_upper, of_lower = np.split(full_model(rig, scene.theta).rest, [len(upper.stiffness)])
    first, second = upper.shapes @ of_upper, lower.shapes @ of_lower
    rest = scene.F * np.concatenate([first[:0:-1].ravel(), first[0, 1:2], second[1:].ravel()])
    steps, every = round(duration / dt), max(round(1.0 / (sample_rate * dt)), 1)
    record = np.zeros((-(-steps // every), 2))
    firsts = np.full(2, np.nan)
    _advance(
        K, M, implicit, normal, tangential, point_b, per[0], per[1],
        scene.F * weight, scene.V / ramp * inertia, closing, scene.mu,
        (dt, b, dt / TAU, rig.d1, rig.d2), (scene.V, ramp), rest, steps, every, record, firsts,
    )  # fmt: skip
    summary = dict(zip(("first_slip_time", "first_separation_time"), firsts.tolist(), strict=True))
    return Transient(scene, summary, *record.T)


@kernel
def _solve(factor: Array, x: Array) -> None:
    """Solve in place with a banded Cholesky factor, whose diagonal is stored inverted."""
    n = len(x)
    for i in range(n):
        x[i] *= factor[0, i]
        for d in range(1, min(BAND, n - 1 - i) + 1):
            x[i + d] -= factor[d, i] * x[i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for d in range(1, min(BAND, n - 1 - i) + 1):
            total -= factor[d, i] * x[i + d]
        x[i] = total * factor[0, i]


@kernel
def _add_product(band: Array, x: Array, factor: float, result: Array) -> None:
    """Add a banded symmetric matrix times x, times a factor."""
    n = len(x)
    for i in range(n):
        result[i] += factor * band[0, i] * x[i]
    for d in range(1, BAND + 1):
        for i in range(n - d):
            result[i + d] += factor * band[d, i] * x[i]
            result[i] += factor * band[d, i] * x[i + d]


@kernel
def _advance(
    K: Any, M: Any, implicit: Any, normal: Any, tangential: Any, point_b: Any, per_N: Any, per_T: Any, load: Any,
    push: Any, W: Any, mu: float, scheme: Any, drive: Any, rest: Any, steps: int, every: int, record: Any,
    firsts: Any,
) -> None:  # fmt: skip
    """All steps; `record` gets time and velocity of B now and then, `firsts` first slip and separation."""
    dt, b, r, d1, d2 = scheme
    V, ramp = drive
    WNN, WNT, WTT = W
    n = len(rest)
    q, v, a, star, mixed = rest.copy(), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    last_gT, last_T = np.dot(tangential, q), 0.0
    ramp_ends = round(ramp / dt)
    for i in range(steps):
        t = (i + 1.0) * dt
        for j in range(n):
            star[j] = v[j] + dt * (1.0 - b) * a[j]
            mixed[j] = q[j] + d2 * star[j]
            a[j] = load[j] + (push[j] if i < ramp_ends else 0.0)
        _add_product(K, mixed, -1.0, a)
        _add_product(M, star, -d1, a)
        _solve(implicit, a)
        gN, gT = 0.0, 0.0
        for j in range(n):
            reach = q[j] + dt * (star[j] + b * dt * a[j]) + 0.5 * dt * dt * a[j]
            gN += normal[j] * reach
            gT += tangential[j] * reach
        gT -= 0.5 * V * t * t / ramp if t < ramp else V * (t - 0.5 * ramp)
        state, N, T = published_contact(gN, gT, last_gT, last_T, WNN, WNT, WTT, mu, r)
        if state == 2 and np.isnan(firsts[0]):
            firsts[0] = t
        if state == 0 and np.isnan(firsts[1]):
            firsts[1] = t
        last_gT, last_T = gT + WNT * N + WTT * T, T
        for j in range(n):
            a[j] += per_N[j] * N + per_T[j] * T
            v[j] = star[j] + b * dt * a[j]
            q[j] += dt * v[j] + 0.5 * dt * dt * a[j]
        if i % every == 0:
            record[i // every, 0], record[i // every, 1] = t, np.dot(point_b, v)
