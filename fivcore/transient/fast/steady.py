"""Steady-state certificate: proof that slip continues forever and converges to steady sliding, so a run may end.

A step in slip maps x = (q, v, u_T) to M x + b (`fivcore.contact.step_map`), with the fixed point x*. With computed
eigenvalues z and eigenvectors X of M, y = X^-1 (x - x*) becomes diag(z) y + E y, E = X^-1 (M X - X diag(z)). Let
rho be the largest |z| and e the maximum norm of E. If rho + e < 1, max_j |y_j| never grows, and no |y_j| exceeds
its present value by more than e / (1 - rho) times this maximum. An output R x therefore differs from its steady
value by at most sum_j |R X|_j times that bound. Slip continues as long as N > 0, the contact is closed, and the
forces that stick would require satisfy T > mu N and T > 0. These conditions are four outputs.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.reduced import ReducedModel
from fivcore.contact.step_map import eigenvectors, step_map
from fivcore.jit import Array, Complex
from fivcore.transient import statistics
from fivcore.transient.fast import layout
from fivcore.transient.fast.onset import RAMP
from fivcore.transient.normalised import Normalised
from fivcore.transient.statistics import SLIP, Segment

# A run ends when N / F and all speeds / V are certain to stay this close to steady sliding, nine decades below
# what could end slip. Rounding (1e-16 per step, over at most 1 / LEAST_DECAY steps) is therefore neglected. With
# the paper's rig at V / F below about 1e-5 m/s/N rounding exceeds the tolerance, and a run takes every step.
STEADY_TOLERANCE = 1e-9
# Variation of the slip rate, in units of V, below which a proof is attempted; smallest decay of a mode per step.
NEARLY_STEADY, LEAST_DECAY = 10.0 * STEADY_TOLERANCE, 1e-9
# Rows of the outputs: those of a record, penetration, then T required for stick and its excess over mu N.
VELOCITY, NORMAL, TANGENTIAL, SLIP_RATE, PENETRATION = range(5)


class SteadySliding:
    """Steady sliding at constant drive speed with T = mu N, computed in some milliseconds.

    The model needs a residual flexibility, because in rigid contact the gap is held by rounding alone.
    `eigenvalues`, (2n + 1,), are log(z) / step in 1/s: those of `fivcore.sliding_modes` for the kept modes, and
    one of u_T. `decays` states whether all decay by more than their errors. `state`, (2n + 1,), is x*. Raises
    `numpy.linalg.LinAlgError` if the eigenvectors or the fixed point are not unique.
    """

    @one_blas_thread()
    def __init__(self, model: ReducedModel, mu: float, step: float) -> None:
        contact, n, b = model.discrete(step), model.normal, model.output
        M, slip = contact.delassus, step_map(model, step, mu)
        # Two more columns: the unit load, whose impulse acts first, and a unit of V.
        load = [contact.defect[0, 0] - (n @ model.static_equilibrium + model.load_gap), 0.0, -M[0, 0], -M[1, 0]]
        p, u_T, _, rate_T = seen = np.column_stack([slip.seen, load, [0.0, 0.0, 0.0, -1.0]])
        (N, T, following), (stick_N, stick_T) = slip.law @ seen, contact.stick(contact.mean_time) @ seen
        net = N - np.eye(len(N))[-2]
        velocity = 0.5 * step * (b @ n * net + b @ model.tangential * T)
        velocity[len(n) : -3] += b
        slip_rate = rate_T + M[1, 0] * N + M[1, 1] * T + (following - u_T) / step
        self._rows = np.stack([velocity, N, T, slip_rate, p, stick_T, stick_T - mu * stick_N])
        constant = np.append((slip.impulse @ [net[-2], T[-2]])[:-1], following[-2])
        self.state = np.linalg.solve(np.eye(len(constant)) - slip.matrix, constant)
        z, X, self._inverse, error = eigenvectors(slip)
        self._weights = np.abs(self._rows[:, :-2] @ X)
        # Without a dashpot u_T has no memory, and one eigenvalue is zero.
        self.eigenvalues: Complex = np.asarray(np.log(z + np.finfo(float).tiny) / step, dtype=complex)
        decay = max(1.0 - float(np.abs(z).max()), LEAST_DECAY)
        self.decays, self._share = decay > max(LEAST_DECAY, 2.0 * error), error / decay
        self._left = contact.slip.decay

    def readings(self, speed: float) -> Array:
        """Return the outputs in steady sliding at V = `speed`."""
        return np.asarray(self._rows @ np.append(self.state, [1.0, speed]))

    def start(self, speed: float) -> tuple[Array, Array, Array]:
        """Return q and v before an impulse, and u after a step."""
        q, v = self.state[:-1].reshape(2, -1).copy()
        return q, v, np.array([self.readings(speed)[PENETRATION], self.state[-1]])

    @one_blas_thread()
    def bounds(self, x: Array) -> Array:
        """Bound the later deviation of each output from steady sliding, if slip continues from `x` and decays."""
        parts = np.abs(self._inverse @ (x - self.state))
        return np.asarray(self._weights @ (parts + self._share * parts.max()))

    def is_permanent(self, q: Array, v: Array, u: Array, speed: float) -> bool:
        """Whether slip continues forever, within STEADY_TOLERANCE of steady sliding at V = `speed`.

        q and v, (n,), are the modal state before an impulse in slip, u, (2,), is u after the last step.
        """
        bound, least = self.bounds(np.concatenate([q, v, u[1:]])), self.readings(speed)
        # The contact opens when the penetration falls below the relaxed u_N; u_N and u_T relax alike.
        bound[PENETRATION] = (1.0 + self._left) * max(bound[PENETRATION], abs(u[0] - least[PENETRATION]))
        least[PENETRATION] *= 1.0 - self._left
        # In slip T is mu N.
        rate = STEADY_TOLERANCE * speed
        least[:PENETRATION] = rate, min(STEADY_TOLERANCE, least[NORMAL]), np.inf, rate
        return self.decays and bool(np.all(bound < least))


def growing(eigenvalues: Complex) -> Array:
    """Frequencies of the motions that grow, Hz, ascending."""
    grows = (eigenvalues.real > 0.0) & (eigenvalues.imag >= 0.0)
    return np.asarray(np.sort(eigenvalues.imag[grows]) / (2.0 * np.pi))


@lru_cache(maxsize=64)
@one_blas_thread()
def eigenvalues(model: ReducedModel, mu: float, step: float, fall: float = 0.0) -> Complex:
    """Eigenvalues of steady sliding with coefficient `mu`, 1/s; friction falls with speed by `fall`, N s/m."""
    z = np.linalg.eigvals(step_map(model, step, mu, fall).matrix)
    return np.asarray(np.log(z + np.finfo(float).tiny) / step, dtype=complex)


def sliding_growth(scene: Normalised, model: ReducedModel, step: float) -> Array:
    """Frequencies of motions that grow about the steady sliding of a scene, Hz, ascending."""
    law, speed = scene.friction, scene.speed_per_load
    return growing(eigenvalues(model, scene.mu * law.ratio(speed), step, -scene.mu * law.slope(speed)))


@lru_cache(maxsize=64)
def steady_sliding(model: ReducedModel, mu: float, step: float) -> SteadySliding | None:
    """Steady sliding, or None if slip has no complete set of eigenvectors or no unique fixed point."""
    try:
        return SteadySliding(model, mu, step)
    except np.linalg.LinAlgError:
        return None


def conclude(run: Any, phase: int, segment: Segment) -> None:
    """Complete a run if only steady sliding can follow; choose the length of the next segment."""
    speed, model, record = run.scene.speed_per_load, run.model, run.record
    # Infinite if the contact does not slide. The number of samples is fixed, since recording divides segments.
    recent = segment.samples[-layout.MAX_SKIP // 4 :, 1]
    varies = float(np.ptp(recent)) if record["contact"][0] == SLIP and len(recent) > 1 else np.inf
    run.length = run.long if varies >= speed else run.short
    ended = phase == RAMP or record["stopped"][0] or record["now"][0] >= run.steps
    # A proof is attempted only if the motion is nearly steady.
    if ended or not run.may_settle or varies > NEARLY_STEADY * speed:
        return
    steady = steady_sliding(model, run.kinetic, run.step)
    run.may_settle = steady is not None and steady.decays
    if steady is not None and steady.is_permanent(run.values(layout.Q), run.values(layout.V), run.u, speed):
        run.segments = chain([segment], _fill(run, steady))


def _fill(run: Any, steady: SteadySliding) -> Iterator[Segment]:
    """Fill the rest of the run with steady sliding, in which all steps are equal."""
    speed, model, record, every, step = run.scene.speed_per_load, run.model, run.record, run.sample_every, run.step
    if run.options.until is not None:
        least = (float(record["settled_from"][0]) + run.options.until.least) / step
        run.pause = run.steps = min(max(int(np.ceil(least)), run.pause), run.steps)
    first, last = int(record["now"][0]), run.steps
    q, v, u = steady.start(speed)
    run.place(q, v)
    record["u_N"], record["u_T"], record["now"] = *u, last
    velocity, N, T, slip_rate = signals = steady.readings(speed)[:PENETRATION].tolist()
    sample = [velocity, slip_rate, N, *(float(record[name][0]) for name in statistics.SAMPLED_COUNTERS)]
    settled = int(np.clip(statistics.first_counted(record["settled_from"][0], step, 0.5), first, last))
    if settled > first:
        for name in statistics.SETTLED:
            record[name] = 0.0
    if last > settled:
        record["max_N"] = np.maximum(record["max_N"], N)
        record["max_slip"] = np.maximum(record["max_slip"], abs(slip_rate))
    time, counted = (last - first) * step, (last - settled) * step
    middle = v + 0.5 * step * (model.normal * (N - 1.0) + model.tangential * T)
    record["sum_N"] += counted * N
    record["slip_time"] += counted
    record["work"] += time * T * speed
    record["friction"] -= time * T * slip_rate
    record["damped"] += time * (model.damping @ middle**2)
    begin, rows = -(-first // every), run.row_every
    for start in range(first, last, layout.MOST_ROWS * rows) if rows else ():
        end = min(start + layout.MOST_ROWS * rows, last)
        written = np.empty((statistics.count_in(start, end, rows), 6))
        written[:, 0] = (np.arange(-(-start // rows), -(-end // rows)) * rows + 0.5) * step
        written[:, 1:] = (*signals, SLIP)
        yield Segment(np.zeros(0), np.empty((0, statistics.SAMPLE)), rows=written)
    if (count := statistics.count_in(first, last, every)) > 0:
        yield Segment(np.array([(begin * every + 0.5) * step]), np.array([sample]), repeated=count - 1)
