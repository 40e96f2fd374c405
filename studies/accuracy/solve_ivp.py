"""SciPy's solve_ivp with events on the reduced model: the obvious tool, used as its documentation says.

Each regime is a linear system, written from the contact law alone (`fivcore.contact.law`), and integrated until
one of its events: the gap closes, the normal force vanishes, the friction cone is reached, slip stops. What comes
next is decided from the state. Nothing keeps the integrator from stepping over two events that lie within one of
its steps, or events from following each other without time going on (chatter on the tip of the cone, an impact
that does not end).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import integrate

from fivcore import DivergenceError, Scene, Transient
from fivcore.contact.reduced import ReducedModel
from fivcore.transient.normalised import Normalised

Array = NDArray[np.float64]
SEPARATION, STICK, SLIP_UP, SLIP_DOWN = range(4)
# So many events in a row, each within so short a time of the last one (s), are none that it gets past.
MOST_EVENTS, NO_TIME = 100, 1e-12


class System(NamedTuple):
    """One regime: y' = A y + B (1, X', X''), for y = (q, v, u_N, u_T) from rest under a load of 1 N.

    X is the displacement of P2's clamp. `signals` and `drift`, (4, m) and (4, 3), give N, T, gap and slip rate
    from y and from (1, X', X'').
    """

    A: Array
    B: Array
    signals: Array
    drift: Array


def systems(model: ReducedModel, mu: float) -> list[System]:
    """Separation, stick, slip with T = mu N and slip with T = -mu N, for a model with an absorbing element."""
    n = len(model.stiffness)
    size = 2 * n + 2
    unit, one = np.eye(size + 3), size
    v, u, clamp = unit[n : 2 * n], unit[2 * n : size], unit[size + 1]
    rate_N, rate_T = model.normal @ v, model.tangential @ v - clamp
    regimes = list[System]()
    for regime, m in ((SEPARATION, 0.0), (STICK, 0.0), (SLIP_UP, mu), (SLIP_DOWN, -mu)):
        if regime == SEPARATION:
            load = np.stack([unit[one], 0.0 * unit[one]])
            rate = -np.linalg.solve(model.C, model.K @ u + load)
        else:
            rate = np.stack([-rate_N, -rate_T])
            if regime != STICK:
                # T - m N = 0 for the rate of u_T.
                K, C = model.K[1] - m * model.K[0], model.C[1] - m * model.C[0]
                rate[1] = -(K @ u + C[0] * rate[0] - m * unit[one]) / C[1]
        force = model.K @ u + model.C @ rate
        whole = np.zeros((size, size + 3))
        whole[:n] = v
        whole[n : 2 * n] = (
            -model.stiffness[:, None] * unit[:n]
            - model.damping[:, None] * v
            + np.outer(model.normal, force[0])
            + np.outer(model.tangential, force[1])
            + np.outer(model.inertia, unit[size + 2])
        )
        whole[2 * n :] = rate
        gap = model.normal @ unit[:n] + u[0]
        signals = np.stack([force[0] + unit[one], force[1], gap, rate_T + rate[1]])
        regimes.append(System(whole[:, :size], whole[:, size:], signals[:, :size], signals[:, size:]))
    return regimes


def run(
    scene: Scene, model: ReducedModel, duration: float, ramp: float, tolerance: float, times: Array
) -> Transient:
    """Integrate from rest under the load, for V > 0 and a ramp, and read the velocity of B at `times`."""
    speed, mu, n = Normalised.of(scene).speed_per_load, scene.mu, len(model.stiffness)
    # A velocity of the drive's size, in every coordinate.
    slowest = np.sqrt(model.stiffness[model.stiffness > 0.0].min())
    size, slow = speed / float(np.abs(model.tangential).max()), speed / model.contact_frequency
    scale = [size / np.maximum(np.sqrt(model.stiffness), slowest), np.full(n, size), np.full(2, slow)]
    absolute = tolerance * np.concatenate(scale)
    regimes, regime, y, t, idle = systems(model, mu), STICK, np.zeros(2 * n + 2), 0.0, 0
    firsts = {"first_slip_time": np.nan, "first_separation_time": np.nan}
    velocity = np.full(len(times), np.nan)
    for begin, end in pairwise([0.0, min(ramp, duration), duration]):

        def drive(t: Any, ramping: bool = begin < ramp) -> Array:
            """1, X' and X''."""
            one = np.ones_like(np.asarray(t, dtype=float))
            shape, acceleration = (t / ramp, speed / ramp) if ramping else (one, 0.0)
            return np.stack([one, speed * shape, one * acceleration])

        while t < end:
            system = regimes[regime]
            solution = integrate.solve_ivp(
                lambda t, y, system=system, drive=drive: system.A @ y + system.B @ drive(t),
                (t, end),
                y,
                rtol=tolerance,
                atol=absolute,
                dense_output=True,
                events=_events(regime, system, mu, drive),
            )
            read = (times >= t) & (times < solution.t[-1])
            if read.any():
                velocity[read] = scene.F * (model.point_b @ solution.sol(times[read])[n : 2 * n])
            idle = idle + 1 if solution.t[-1] - t < NO_TIME else 0
            t, y = float(solution.t[-1]), solution.y[:, -1]
            if solution.status < 0 or idle == MOST_EVENTS:
                raise DivergenceError(f"SciPy's solve_ivp cannot go on at {t:g} s: {solution.message}", scene)
            if solution.status == 1:
                hit = next(k for k, each in enumerate(solution.t_events) if len(each))
                regime = _after(regime, hit, mu, [each.signals @ y + each.drift @ drive(t) for each in regimes])
                name = f"first_{'separation' if regime == SEPARATION else 'slip'}_time"
                if regime != STICK and np.isnan(firsts[name]):
                    firsts[name] = t
    reached = times < duration
    return Transient(scene, firsts, times[reached], velocity[reached])


def _events(regime: int, system: System, mu: float, drive: Callable[[float], Array]) -> list[Callable[..., float]]:
    """Functions that are positive within the regime."""

    def margins(t: float, y: Array) -> list[float]:
        N, T, gap, slip = system.signals @ y + system.drift @ drive(t)
        if regime == SEPARATION:
            return [gap]
        # T = mu N acts on P1 while it moves backwards over P2.
        return [N, mu * N - T, mu * N + T] if regime == STICK else [N, -slip if regime == SLIP_UP else slip]

    def event(k: int) -> Callable[..., float]:
        def value(t: float, y: Array) -> float:
            return float(margins(t, y)[k])

        value.terminal, value.direction = True, -1.0  # type: ignore[attr-defined]
        return value

    return [event(k) for k in range({SEPARATION: 1, STICK: 3}.get(regime, 2))]


def _after(regime: int, hit: int, mu: float, signals: list[Array]) -> int:
    """The regime after an event; `signals` are what each regime would have there."""
    if regime == SEPARATION:
        # Stick if it needs no more than the cone has; else slip, the way sticking would have been broken.
        N, T = signals[STICK][:2]
        slip = SLIP_UP if T > 0.0 else SLIP_DOWN
        return STICK if abs(T) <= mu * N else slip if signals[slip][0] > 0.0 else SEPARATION
    if hit == 0:
        return SEPARATION
    # Forces are continuous where slip ends: there sticking needs just what the cone has.
    return STICK if regime != STICK else SLIP_UP if hit == 1 else SLIP_DOWN
