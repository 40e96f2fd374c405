"""A chain of blocks on a belt (Burridge and Knopoff, Bull. Seism. Soc. Am. 57, 1967, 341-371), event by event."""

import numpy as np
from scipy.optimize import brentq

from fivcore import Structure

# Times at which signs are looked at, as a share of the shortest period.
SCAN = 2e-3


def chain(frequency=50.0, coupling=1.7, factors=(1.0, 1.1, 0.9)):
    """Stiffness of coupled blocks of mass 1, each on a spring of this frequency, Hz; and their structure."""
    c = len(factors)
    links = np.diag(np.r_[1.0, np.full(c - 2, 2.0), 1.0]) - np.eye(c, k=1) - np.eye(c, k=-1)
    K = (2.0 * np.pi * frequency) ** 2 * (np.eye(c) + coupling * links)
    values, shapes = np.linalg.eigh(K)
    # Each is pressed by its own weight: a rigid motion, which its contact holds.
    normal, tangential = np.eye(c, 2 * c), np.hstack([np.zeros((c, c)), shapes])
    frequencies = np.append(np.zeros(c), np.sqrt(values) / (2.0 * np.pi))
    load = -normal.sum(axis=0) / c
    return K, Structure.from_modes(
        frequencies, normal, tangential, load=load, friction=factors, output=tangential[0]
    )


def stick_times(K, V, static, kinetic, duration):
    """Times at which each block sticks again, s, from the start with the belt, all springs unloaded.

    `static` and `kinetic` are the forces of friction on each block, N. Slipping blocks follow the exact solution
    of their linear equations; sticking blocks move at V.
    """
    c, now = len(K), 0.0
    x, v, sticks, way = np.zeros(c), np.full(c, V), np.ones(c, dtype=bool), np.zeros(c)
    found, scan = [[] for _ in range(c)], SCAN * 2.0 * np.pi / np.sqrt(np.linalg.eigvalsh(K).max())
    while now < duration:
        free, held = np.flatnonzero(~sticks), np.flatnonzero(sticks)
        within, beside = K[np.ix_(free, free)], K[np.ix_(free, held)]
        rest = np.linalg.solve(within, way[free] * kinetic[free] - beside @ x[held])
        drift = np.linalg.solve(within, -beside @ np.full(len(held), V))
        values, turn = np.linalg.eigh(within)
        omega = np.sqrt(values)
        even, odd = turn.T @ (x[free] - rest), turn.T @ (v[free] - drift) / omega

        def state(
            t, x=x, free=free, sticks=sticks, rest=rest, drift=drift, omega=omega, turn=turn, ab=(even, odd)
        ):
            a, b = ab
            position, rate = x + V * t, np.full(len(x), V)
            position[free] = rest + drift * t + turn @ (a * np.cos(omega * t) + b * np.sin(omega * t))
            rate[free] = drift + turn @ (omega * (b * np.cos(omega * t) - a * np.sin(omega * t)))
            return position, rate

        def left(t, sticks=sticks, way=way, state=state):
            """The margin of each block before it slips, N, or sticks, m/s."""
            position, rate = state(t)
            return np.where(sticks, static - np.abs(K @ position), (V - rate) * way)

        t, before = 0.0, left(1e-9 * scan)
        while not np.any((before >= 0.0) & ((after := left(t + scan)) < 0.0)):
            t, before = t + scan, after
        ended = np.flatnonzero((before >= 0.0) & (after < 0.0))
        roots = [brentq(lambda s, i=i, left=left: left(s)[i], t, t + scan, xtol=1e-17) for i in ended]
        t, i = min(roots), ended[int(np.argmin(roots))]
        x, v = state(t)
        now += t
        force = -(K @ x)[i]
        sticks, way = sticks.copy(), way.copy()
        if sticks[i] or abs(force) > static[i]:
            sticks[i], way[i] = False, -np.sign(force)
        else:
            sticks[i], v[i] = True, V
            found[i].append(now)
    return found
