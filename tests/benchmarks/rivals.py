"""What one could use instead: SciPy's solve_ivp with events, and pseudo-modes in place of the contact element."""

import time
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from scipy import integrate

from fivcore import Rig, simulate, simulate_many
from fivcore.contact.reduced import CONTACT_DAMPING, MODAL, default_cutoff, full_model, reduced_model
from fivcore.transient.normalised import Normalised
from studies.accuracy.errors import FRACTIONS
from studies.accuracy.settings import CONVERGED, SETTINGS, TWO, scene_of
from tests.benchmarks.belt import belt
from tests.benchmarks.tables import Column, Table

SEPARATION, STICK, SLIP_UP, SLIP_DOWN = range(4)
RAMP, DURATION, MEMBERS = 1e-3, 1.2, 10


def systems(model, mu):
    """By regime, of z = (q, v, u, 1, X', X''): (q, v, u)'; N, T, gap, slip rate; what stays positive."""
    n, regimes, unit = len(model.stiffness), [], np.eye(2 * len(model.stiffness) + 5)
    q, v, u, one, clamp, push = unit[:n], unit[n : 2 * n], unit[2 * n : -3], *unit[-3:]
    rates = np.stack([-model.normal @ v, clamp - model.tangential @ v])
    for regime, m in ((SEPARATION, 0.0), (STICK, 0.0), (SLIP_UP, mu), (SLIP_DOWN, -mu)):
        rate, rows = rates.copy(), [[1, 0, 0, 0], [mu, -1, 0, 0], [mu, 1, 0, 0]]
        if regime == SEPARATION:
            rate, rows = -np.linalg.solve(model.C, model.K @ u + np.stack([one, 0.0 * one])), [[0, 0, 1, 0]]
        elif regime != STICK:  # T - m N = 0 for the rate of u_T; T = mu N acts on P1 while it moves backwards
            K, C = model.K[1] - m * model.K[0], model.C[1] - m * model.C[0]
            rate[1] = -(K @ u + C[0] * rate[0] - m * one) / C[1]
            rows[1:] = [[0, 0, 0, -1 if regime == SLIP_UP else 1]]
        force = model.K @ u + model.C @ rate
        pushed = np.outer(model.normal, force[0]) + np.outer(model.tangential, force[1])
        pushed += np.outer(model.inertia, push) - model.stiffness[:, None] * q - model.damping[:, None] * v
        signals = np.stack([force[0] + one, force[1], model.normal @ q + u[0], rate[1] - rates[1]])
        regimes.append((np.concatenate([v, pushed, rate]), signals, np.array(rows) @ signals))
    return regimes


def solve_ivp(scene, model, duration, tolerance):
    """Integrate regime by regime from rest under the load; times of the first slip and separation, s."""
    speed, n, mu = Normalised.of(scene).speed_per_load, len(model.stiffness), scene.mu
    omega = np.sqrt(np.maximum(model.stiffness, model.stiffness[model.stiffness > 0.0].min()))
    size, slow = speed / float(np.abs(model.tangential).max()), speed / model.contact_frequency
    absolute = tolerance * np.concatenate([size / omega, np.full(n, size), np.full(2, slow)])
    regimes, regime, y, t, firsts = systems(model, mu), STICK, np.zeros(2 * n + 2), 0.0, {}

    def along(t, y, matrix, ramping):
        return matrix @ np.append(y, [1.0, speed * t / RAMP, speed / RAMP] if ramping else [1.0, speed, 0.0])

    for ramping, end in ((True, RAMP), (False, duration)):
        while t < end:
            motion, _, margins = (partial(along, matrix=part, ramping=ramping) for part in regimes[regime])
            events = [partial(lambda t, y, k, m: m(t, y)[k], k=k, m=margins) for k in range(len(margins(t, y)))]
            for event in events:
                event.terminal, event.direction = True, -1.0
            found = integrate.solve_ivp(motion, (t, end), y, rtol=tolerance, atol=absolute, events=events)
            t, y = float(found.t[-1]), found.y[:, -1]
            if found.status == 1:
                hit = next(k for k, times in enumerate(found.t_events) if len(times))
                forces = [along(t, y, signals, ramping)[:2] for _, signals, _ in regimes]
                N, T = forces[STICK]
                slip = SLIP_UP if T > 0.0 else SLIP_DOWN
                if regime == SEPARATION:  # stick if it needs no more than the cone has
                    regime = STICK if abs(T) <= mu * N else slip if forces[slip][0] > 0.0 else SEPARATION
                else:
                    regime = SEPARATION if hit == 0 else STICK if regime != STICK else SLIP_UP + hit - 1
                firsts.setdefault(min(regime, SLIP_UP), t)
    return firsts.get(SLIP_UP, np.nan), firsts.get(SEPARATION, np.nan)


def with_pseudo_modes(model, full, damping):
    """Two damped modes for each of two bands of dropped modes, which keep its flexibility and its inverse mass."""
    omega, flexibility, added = np.sqrt(full.stiffness), np.linalg.inv(model.K), []
    for low, high in pairwise(np.geomspace(np.sqrt(model.stiffness.max()) * (1.0 + 1e-9), 2.0 * np.pi * 300e3, 3)):
        g, k = (part[..., (omega > low) & (omega <= high)] for part in (full.shapes, full.stiffness))
        static = (g / k) @ g.T
        flexibility = flexibility - static
        compliance, axes = np.linalg.eigh(static)
        compliance, axes = (part[..., compliance > 1e-9 * compliance[-1]] for part in (compliance, axes))
        stiffness = ((g.T @ axes) ** 2).sum(axis=0) / compliance
        rate, shapes = 2.0 * damping * np.sqrt(stiffness), np.sqrt(compliance * stiffness) * axes
        added.append([stiffness, rate, *shapes, 0.0 * rate])
    names, parts = ("stiffness", "damping", "normal", "tangential"), np.concatenate(added, axis=1)
    modal = {k: np.append(getattr(model, k), parts[names.index(k) if k in names else -1]) for k in MODAL}
    stiff = replace(model, **modal, K=np.linalg.inv(flexibility))
    return replace(stiff, C=2.0 * CONTACT_DAMPING / stiff.contact_frequency * stiff.K)


def second():
    """Cost and error: the largest of a fraction of time, beside the converged model; of the first separation."""
    rows, ramps = [], [RAMP * (1.0 + 0.013 * k) for k in range(MEMBERS)]
    for name in TWO:
        scene = scene_of(name, Rig())
        model, full = (make(scene.rig, scene.drive_theta) for make in (reduced_model, full_model))
        modify = partial(with_pseudo_modes, full=full, damping=0.02)
        runs = {"converged": SETTINGS[CONVERGED].options(scene), "default": {}}
        runs["pseudo-modes"] = {"cutoff": default_cutoff(scene.rig), "modify": modify}
        for what, options in runs.items():
            start = time.thread_time()
            found = simulate_many([scene] * MEMBERS, DURATION, ramp=ramps, **options)
            cost = (time.thread_time() - start) / (MEMBERS * DURATION)
            means = np.array([np.mean([run.summary[part] for run in found]) for part in FRACTIONS])
            rows.append([f"`fast`, {what}", name, cost, means])
        rows[-3:] = [[*row[:3], float(np.abs(row[3] - rows[-3][3]).max())] for row in rows[-3:]]
        first = simulate(scene, 0.2, "exact", ramp=RAMP).summary["first_separation_time"]
        for tolerance in (1e-4, 1e-6):
            start = time.thread_time()
            separation = solve_ivp(scene, model, first + 2e-3, tolerance)[1]
            cost = (time.thread_time() - start) / (first + 2e-3)
            error = None if np.isnan(separation) else abs(separation / first - 1.0)
            rows.append([f"`solve_ivp` to {tolerance:g}", name, cost, error])
    return Table([Column("method"), Column("scene"), Column("CPU time / simulated time"), Column("error")], rows)


TABLES = {"second": second, "belt": belt}
