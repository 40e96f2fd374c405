"""A second, plain implementation of the published scheme: finite-element coordinates, dense matrices, one loop.

Section 3.3 of the paper with beta2 in both of its places and damping implicit: Newmark's method with beta = 0 and
gamma = beta2, contact by Lagrange multipliers at the end of each step, simplified Prakash-Clifton friction. Of
fivcore only the arguments are used, and the shapes of the modes to transfer a state.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from fivcore.beams.modes import rig_bases
from tests.helpers.reference import assemble, element

SEPARATION, STICK, SLIP = 0, 1, 2


def finite_elements(rig: Any, theta: float) -> SimpleNamespace:
    """Matrices (n, n), rows and columns (n,); P1's nodes run from C to A, of which only y is free, then P2's.

    `weight` is the force of a unit load on A, along -y, `thrown` that of a unit acceleration of P2's clamp, for
    motion relative to it; g_T is without the clamp's own motion.
    """
    # Rounded once.
    K, M, normal, tangential = (part.astype(float) for part in assemble(rig, theta, np.longdouble))
    n1 = 3 * rig.p1.elements + 1
    weight, point_b, along = np.zeros((3, len(K)))
    weight[n1 - 1] = -1.0
    along[n1::3] = 1.0
    # All of P2 moves with the clamp, the clamped node too: its column of the first element's mass counts.
    thrown = -M @ along
    thrown[n1] -= element(rig.p2)[1][3][0]
    # B between two nodes, of which A has no displacement along x.
    nodes = np.arange(rig.p1.elements)
    point_b[3 * nodes] = np.maximum(1.0 - np.abs(rig.point_b * rig.p1.elements - nodes), 0.0)
    rows = {"normal": normal, "tangential": tangential, "point_b": point_b, "weight": weight, "thrown": thrown}
    return SimpleNamespace(K=K, M=M, C=rig.d1 * M + rig.d2 * K, **rows)


def nodal(rig: Any, theta: float, modal: np.ndarray) -> np.ndarray:
    """Modal coordinates of the separate beams as displacements in the order of `finite_elements`."""
    upper, lower = rig_bases(rig, theta)
    split = len(upper.stiffness)
    first, second = upper.shapes @ modal[:split], lower.shapes @ modal[split:]
    return np.concatenate([first[:0:-1].ravel(), first[0, 1:2], second[1:].ravel()])


def clamp(t: float, V: float, ramp: float) -> float:
    """Displacement of the clamp."""
    return V * t * t / (2.0 * ramp) if t < ramp else V * (t - ramp / 2.0)


def published_scheme(
    fe: Any, scene: Any, ramp: float, q: np.ndarray, v: np.ndarray, contact: int, steps: int, dt: float
) -> SimpleNamespace:
    """State and forces after each step, from displacements q and velocities v (of P2 relative to its clamp).

    The first prediction needs an acceleration: that by the load and the structure alone, without the drive; for
    touching surfaces with the force that prevents an acceleration of the gap, and where they slip its friction.
    """
    V, mu, F, b, r = scene.V, scene.mu, scene.F, 0.8, dt / 1e-7
    GN, GT = fe.normal, fe.tangential
    implicit, mass = cho_factor(fe.M + b * dt * fe.C), cho_factor(fe.M)
    per_N, per_T = cho_solve(implicit, GN), cho_solve(implicit, GT)
    closing = dt**2 * (b + 0.5) * np.array([[GN @ per_N, GN @ per_T], [GT @ per_N, GT @ per_T]])
    out = np.zeros((5, steps))
    a = cho_solve(mass, F * fe.weight - fe.K @ q - fe.C @ v)
    last_T = 0.0
    if contact != SEPARATION:
        m = -mu * np.sign(GT @ v) if contact == SLIP else 0.0
        push = cho_solve(mass, GN + m * GT)
        N = -(GN @ a) / (GN @ push)
        a, last_T = a + push * N, m * N
    ramp_ends, last_gT = round(ramp / dt), GT @ q
    for i in range(steps):
        load = F * fe.weight + (V / ramp * fe.thrown if i < ramp_ends else 0.0)
        v_star = v + dt * (1.0 - b) * a
        a_star = cho_solve(implicit, load - fe.K @ q - fe.C @ v_star)
        q_free = q + dt * (v_star + b * dt * a_star) + dt**2 / 2.0 * a_star
        gap = np.array([GN @ q_free, GT @ q_free - clamp((i + 1) * dt, V, ramp)])
        state, force = _contact(gap, closing, last_gT, last_T, mu, r)
        a = a_star + per_N * force[0] + per_T * force[1]
        v = v_star + b * dt * a
        q = q + dt * v + dt**2 / 2.0 * a
        gT = GT @ q - clamp((i + 1) * dt, V, ramp)
        out[:, i] = *force, (gT - last_gT) / dt, fe.point_b @ v, state
        last_gT, last_T = gT, force[1]
    names = "normal_force", "tangential_force", "slip_velocity", "velocity_B"
    return SimpleNamespace(**dict(zip(names, out, strict=False)), state=out[4].astype(int), q=q)


def _contact(
    gap: np.ndarray, closing: np.ndarray, last_gT: float, last_T: float, mu: float, r: float
) -> tuple[int, np.ndarray]:
    """Separation, stick or slip, and (N, T), from the gaps at the end of a step without contact."""
    if gap[0] > 0.0:
        return SEPARATION, np.zeros(2)
    stick = np.linalg.solve(closing, np.array([0.0, last_gT]) - gap)
    if stick[0] > 0.0 and abs(stick[1]) < mu * stick[0]:
        return STICK, stick
    # N and T from g_N = 0 and (1 + r) T - r s mu N = T_last.
    s = 1.0 if stick[1] > 0.0 else -1.0
    slip = np.linalg.solve([closing[0], [-r * s * mu, 1.0 + r]], [-gap[0], last_T])
    return (SLIP, slip) if slip[0] > 0.0 else (SEPARATION, np.zeros(2))
