"""SciPy's solve_ivp with events on the reduced model: the obvious tool, used as its documentation says.

Each regime is a linear system, written from the contact law alone (`fivcore.contact.law`), and integrated until one
of its events: the gap closes, the normal force vanishes, the friction cone is reached, slip stops. What comes next
is decided from the state. Nothing keeps the integrator from stepping over two events that lie within one of its
steps, and where events follow each other without time going on (chatter on the tip of the cone, an impact that does
not end) it gives up.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import integrate

from fivcore import Scene, Transient
from fivcore.contact.reduced import ReducedModel
from fivcore.transient.normalised import Normalised

Array = NDArray[np.float64]
SEPARATION, STICK, SLIP_UP, SLIP_DOWN = range(4)
NORMAL, TANGENTIAL, GAP, SLIP = range(4)
# So many events in a row, each within so short a time of the last one (s), are none that it gets past.
MOST_EVENTS, NO_TIME = 100, 1e-12


class System(NamedTuple):
    """One regime: y' = A y + B (1, X', X''), for y = (q, v, u_N, u_T) from rest under a load of 1 N.

    X is the displacement of P2's clamp. `signals` and `drift`, (4, m) and (4, 3), give N, T, gap and slip rate from
    y and from (1, X', X'').
    """

    A: Array
    B: Array
    signals: Array
    drift: Array


def systems(model: ReducedModel, mu: float) -> list[System]:
    """Separation, stick, slip with T = mu N and slip with T = -mu N, for a model with an absorbing element."""
    if not model.C.any():
        raise ValueError("model: it must have an absorbing element")
    n = len(model.stiffness)
    size = 2 * n + 2
    unit, one = np.eye(size + 3), size
    v, u, clamp = unit[n : 2 * n], unit[2 * n : size], unit[size + 1]
    rate_N, rate_T = model.normal @ v, model.tangential @ v - clamp
    found = []
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
        found.append(System(whole[:, :size], whole[:, size:], signals[:, :size], signals[:, size:]))
    return found


def run(
    scene: Scene, model: ReducedModel, duration: float, ramp: float, tolerance: float, times: Array
) -> tuple[Transient, float]:
    """Integrate from rest under the load, for V > 0 and a ramp, and read the motion at `times`.

    Also when the run ended, s: it may give up before `duration`, and with it what can be read.
    """
    return _Run(scene, model, ramp, tolerance).through(duration, times)


class _Run:
    """One run in progress, for a load of 1 N."""

    def __init__(self, scene: Scene, model: ReducedModel, ramp: float, tolerance: float) -> None:
        self.scene, self.speed = scene, Normalised.of(scene).speed_per_load
        self.mu, self.ramp, self.tolerance = scene.mu, ramp, tolerance
        self.model, self.systems = model, systems(model, scene.mu)
        n = len(model.stiffness)
        self.y, self.regime = np.zeros(2 * n + 2), STICK
        # What a velocity of the drive's size is in every coordinate.
        slowest = np.sqrt(model.stiffness[model.stiffness > 0.0].min())
        frequency = np.maximum(np.sqrt(model.stiffness), slowest)
        size = self.speed / float(np.abs(model.tangential).max())
        slow = self.speed / model.contact_frequency
        self.scale = np.concatenate([size / frequency, np.full(n, size), np.full(2, slow)])
        self.firsts = {"first_slip_time": float("nan"), "first_separation_time": float("nan")}

    def through(self, duration: float, times: Array) -> tuple[Transient, float]:
        """The whole run: the ramp, and what follows it."""
        t, idle = 0.0, 0
        parts: list[tuple[Array, Array, Array]] = []
        for begin, end in pairwise([0.0, min(self.ramp, duration), duration]):
            while t < end and idle < MOST_EVENTS:
                system = self.systems[self.regime]
                found = integrate.solve_ivp(
                    self._rate(system, begin),
                    (t, end),
                    self.y,
                    rtol=self.tolerance,
                    atol=self.tolerance * self.scale,
                    dense_output=True,
                    events=self._events(system, begin),
                )
                parts.append(self._read(system, begin, found, times))
                after = float(found.t[-1])
                idle = idle + 1 if after - t < NO_TIME and found.status == 1 else 0
                t, self.y = after, found.y[:, -1]
                if found.status == 1:
                    self._switch(next(k for k, each in enumerate(found.t_events) if len(each)), t, begin)
                elif found.status < 0:
                    idle = MOST_EVENTS
        time, velocity, force = (np.concatenate(part) for part in zip(*parts, strict=True))
        return Transient(self.scene, self.firsts, time, self.scene.F * velocity, self.scene.F * force), t

    def _drive(self, t: Any, begin: float) -> Array:
        """1, X' and X'' of the segment that began at `begin`: the ramp's, or after it."""
        one, ramping = np.ones_like(np.asarray(t, dtype=float)), begin < self.ramp
        speed, acceleration = (t / self.ramp, self.speed / self.ramp) if ramping else (one, 0.0)
        return np.stack([one, self.speed * speed, one * acceleration])

    def _rate(self, system: System, begin: float) -> Callable[[float, Array], Array]:
        return lambda t, y: system.A @ y + system.B @ self._drive(t, begin)

    def _signals(self, system: System, t: float, y: Array, begin: float) -> Array:
        return np.asarray(system.signals @ y + system.drift @ self._drive(t, begin))

    def _events(self, system: System, begin: float) -> list[Callable[[float, Array], float]]:
        """Functions that are positive within the regime."""

        def watch(what: Callable[[Array], float]) -> Callable[[float, Array], float]:
            def event(t: float, y: Array) -> float:
                return float(what(self._signals(system, t, y, begin)))

            event.terminal = True  # type: ignore[attr-defined]
            event.direction = -1.0  # type: ignore[attr-defined]
            return event

        if self.regime == SEPARATION:
            return [watch(lambda s: s[GAP])]
        if self.regime == STICK:
            cone = [watch(lambda s, sign=sign: self.mu * s[NORMAL] + sign * s[TANGENTIAL]) for sign in (-1.0, 1.0)]
            return [watch(lambda s: s[NORMAL]), *cone]
        # T = mu N acts on P1 while it moves backwards over P2.
        sign = -1.0 if self.regime == SLIP_UP else 1.0
        return [watch(lambda s: s[NORMAL]), watch(lambda s: sign * s[SLIP])]

    def _switch(self, hit: int, t: float, begin: float) -> None:
        """The regime after an event."""
        if self.regime == SEPARATION:
            self.regime = self._touchdown(t, begin)
        elif hit == 0:
            self.regime = SEPARATION
        elif self.regime == STICK:
            self.regime = SLIP_UP if hit == 1 else SLIP_DOWN
        else:
            # Forces are continuous where slip ends: there sticking needs just what the cone has.
            self.regime = STICK
        if self.regime != STICK:
            first = f"first_{'separation' if self.regime == SEPARATION else 'slip'}_time"
            self.firsts[first] = t if np.isnan(self.firsts[first]) else self.firsts[first]

    def _touchdown(self, t: float, begin: float) -> int:
        """Stick if it needs no more than the cone has; else slip, the way sticking would have been broken."""
        N, T = self._signals(self.systems[STICK], t, self.y, begin)[:2]
        if abs(T) <= self.mu * N:
            return STICK
        regime = SLIP_UP if T > 0.0 else SLIP_DOWN
        N = self._signals(self.systems[regime], t, self.y, begin)[NORMAL]
        return regime if N > 0.0 else SEPARATION

    def _read(self, system: System, begin: float, found: Any, times: Array) -> tuple[Array, Array, Array]:
        """Times within a segment, the velocity of B and the normal force there."""
        chosen = times[(times >= found.t[0]) & (times < found.t[-1])]
        if not len(chosen):
            return chosen, chosen, chosen
        y = found.sol(chosen)
        n = len(self.model.stiffness)
        N = system.signals[NORMAL] @ y + system.drift[NORMAL] @ self._drive(chosen, begin)
        return chosen, self.model.point_b @ y[n : 2 * n], N
