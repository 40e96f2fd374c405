"""A plain Moreau-Jean scheme for several contacts, in coordinates of its own: an independent reference.

The theta method with theta = 1/2 (Jean, Comput. Methods Appl. Mech. Eng. 177, 1999, 235-257): impulses on the
velocities of the contacts whose gaps would close, restitution 0, Coulomb's law by projected Gauss-Seidel.
"""

import numpy as np
from numba import njit


@njit
def run(M, C, K, N, T, gap, force, mu, V, q, v, step, steps, settle, sweeps):
    """Times of each contact in separation, stick and slip after `settle`, s, (c, 3), and mean forces, (c,)."""
    c = len(N)
    inverse = np.linalg.inv(M + 0.5 * step * C + 0.25 * step**2 * K)
    G = np.vstack((N, T))
    W = G @ inverse @ G.T
    impulse, shares, mean = np.zeros(2 * c), np.zeros((c, 3)), np.zeros(c)
    for k in range(steps):
        free = v + inverse @ (step * (force - C @ v - K @ (q + 0.5 * step * v)))
        u = G @ free
        u[c:] -= V
        near = gap + N @ (q + 0.5 * step * v) <= 0.0
        for i in range(c):
            if not near[i]:
                impulse[i] = impulse[c + i] = 0.0
        for _ in range(sweeps):
            change = 0.0
            for i in range(c):
                if not near[i]:
                    continue
                t = c + i
                old_N, old_T = impulse[i], impulse[t]
                rate = u[i] + W[i] @ impulse
                impulse[i] = max(impulse[i] - rate / W[i, i], 0.0)
                rate = u[t] + W[t] @ impulse
                most = mu[i] * impulse[i]
                impulse[t] = min(max(impulse[t] - rate / W[t, t], -most), most)
                change = max(change, abs(impulse[i] - old_N), abs(impulse[t] - old_T))
            if change <= 1e-12 * np.abs(impulse).max():
                break
        after = free + inverse @ (G.T @ impulse)
        q, v = q + 0.5 * step * (v + after), after
        if k * step >= settle:
            for i in range(c):
                if impulse[i] == 0.0:
                    shares[i, 0] += step
                elif abs(impulse[c + i]) < mu[i] * impulse[i]:
                    shares[i, 1] += step
                else:
                    shares[i, 2] += step
                mean[i] += impulse[i]
    return shares / (steps * step - settle), mean / (steps * step - settle)
