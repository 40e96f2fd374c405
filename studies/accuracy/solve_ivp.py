"""SciPy's solve_ivp with events on the reduced model: the obvious tool, used as its documentation says.

Each regime of `studies.accuracy.odes` is integrated until one of its events: the gap closes, the normal force
vanishes, the friction cone is reached, slip stops. What comes next is decided from the state. Nothing keeps the
integrator from stepping over two events that lie within one of its steps, and where events follow each other
without time going on (chatter on the tip of the cone, an impact that does not end) it gives up.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from fivcore import Scene
from fivcore.contact.reduced import ReducedModel
from fivcore.transient.normalised import Normalised
from studies.accuracy.odes import SEPARATION, SLIP_DOWN, SLIP_UP, STICK, System, systems
from studies.accuracy.trajectory import Track

Array = NDArray[np.float64]
NORMAL, TANGENTIAL, GAP, SLIP = range(4)
# So many events in a row, each within so short a time of the last one (s), are none that it gets past.
MOST_EVENTS, NO_TIME = 100, 1e-12


def run(
    scene: Scene, model: ReducedModel, duration: float, ramp: float, tolerance: float, times: Array
) -> tuple[Track, float]:
    """Integrate from rest under the load, for V > 0 and a ramp, and read the motion at `times`.

    Also when the run ended, s: it may give up before `duration`, and with it what can be read.
    """
    return _Run(scene, model, ramp, tolerance).through(duration, times)


class _Run:
    """One run in progress, for a load of 1 N."""

    def __init__(self, scene: Scene, model: ReducedModel, ramp: float, tolerance: float) -> None:
        self.scene = Normalised.of(scene)
        self.mu, self.ramp, self.tolerance = scene.mu, ramp, tolerance
        self.model, self.systems = model, systems(model, scene.mu)
        n = len(model.stiffness)
        self.y, self.regime = np.zeros(2 * n + 2), STICK
        # What a velocity of the drive's size is in every coordinate.
        slowest = np.sqrt(model.stiffness[model.stiffness > 0.0].min())
        frequency = np.maximum(np.sqrt(model.stiffness), slowest)
        size = self.scene.speed_per_load / float(np.abs(model.tangential).max())
        slow = self.scene.speed_per_load / model.contact_frequency
        self.scale = np.concatenate([size / frequency, np.full(n, size), np.full(2, slow)])
        self.firsts = np.full(2, np.nan)

    def through(self, duration: float, times: Array) -> tuple[Track, float]:
        """The whole run."""
        t, idle = 0.0, 0
        heard: list[tuple[Array, Array, Array]] = []
        for begin, end in pairwise([0.0, min(self.ramp, duration), duration]):
            t = begin
            while t < end and idle < MOST_EVENTS:
                system = self.systems[self.regime]
                found = solve_ivp(
                    self._rate(system, begin),
                    (t, end),
                    self.y,
                    rtol=self.tolerance,
                    atol=self.tolerance * self.scale,
                    dense_output=True,
                    events=self._events(system, begin),
                )
                heard.append(self._read(system, begin, found, times))
                after = float(found.t[-1])
                idle = idle + 1 if after - t < NO_TIME and found.status == 1 else 0
                t, self.y = after, found.y[:, -1]
                if found.status == 1:
                    hit = next(k for k, each in enumerate(found.t_events) if len(each))
                    self._switch(hit, t, begin)
                elif found.status < 0:
                    idle = MOST_EVENTS
            if idle >= MOST_EVENTS:
                break
        F = self.scene.load
        time, velocity, force = (np.concatenate(part) for part in zip(*heard, strict=True))
        return Track(time, F * velocity, F * force, *(float(first) for first in self.firsts)), t

    def _drive(self, t: Any, begin: float) -> Array:
        """1, X' and X'' of the stretch that began at `begin`: the ramp's, or after it."""
        pace, ramping = self.scene.speed_per_load, begin < self.ramp
        one = np.ones_like(np.asarray(t, dtype=float))
        return np.stack(
            [one, pace * (t / self.ramp if ramping else one), one * (pace / self.ramp if ramping else 0.0)]
        )

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
            return [
                watch(lambda s: s[NORMAL]),
                watch(lambda s: self.mu * s[NORMAL] - s[TANGENTIAL]),
                watch(lambda s: self.mu * s[NORMAL] + s[TANGENTIAL]),
            ]
        # T = mu N acts on P1 while it moves backwards over P2.
        sign = -1.0 if self.regime == SLIP_UP else 1.0
        return [watch(lambda s: s[NORMAL]), watch(lambda s: sign * s[SLIP])]

    def _switch(self, hit: int, t: float, begin: float) -> None:
        """The regime after an event."""
        if self.regime != SEPARATION and hit == 0:
            self.regime = SEPARATION
        elif self.regime == STICK:
            self.regime = SLIP_UP if hit == 1 else SLIP_DOWN
        elif self.regime == SEPARATION:
            self.regime = self._landed(t, begin)
        else:
            # Forces are continuous where slip ends: there sticking needs just what the cone has.
            self.regime = STICK
        first = {SLIP_UP: 0, SLIP_DOWN: 0, SEPARATION: 1}.get(self.regime)
        if first is not None and np.isnan(self.firsts[first]):
            self.firsts[first] = t

    def _landed(self, t: float, begin: float) -> int:
        """Stick if it needs no more than the cone has; else slip, the way sticking would have been broken."""
        N, T = self._signals(self.systems[STICK], t, self.y, begin)[:2]
        if abs(T) <= self.mu * N:
            return STICK
        regime = SLIP_UP if T > 0.0 else SLIP_DOWN
        N = self._signals(self.systems[regime], t, self.y, begin)[NORMAL]
        return regime if N > 0.0 else SEPARATION

    def _read(self, system: System, begin: float, found: Any, times: Array) -> tuple[Array, Array, Array]:
        """Times within a stretch, the velocity of B and the normal force there."""
        chosen = times[(times >= found.t[0]) & (times < found.t[-1])]
        if not len(chosen):
            return chosen, chosen, chosen
        y = found.sol(chosen)
        n = len(self.model.stiffness)
        N = system.signals[NORMAL] @ y + system.drift[NORMAL] @ self._drive(chosen, begin)
        return chosen, self.model.point_b @ y[n : 2 * n], N
