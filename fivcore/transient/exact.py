"""`method="exact"`: the reduced model of `fivcore.contact.law`, propagated exactly from event to event.

In each regime the motion is linear, so it is written in the regime's eigenbasis, and the events between the
regimes are found by the certified search of `transient.exact_kernels`. Nothing depends on a step: in the middle of
every `step` statistics and series are read, no more. What remains is rounding: of the order of 1e-13 until the
first slip, from where the flutter makes it grow with the motion, to 1e-10 at the first separation.

What begins at zero. With an absorbing element the forces are continuous at every event but touch-down: the slip
rate and, in stick, the distance to the cone grow with their first derivative, and the gap with its second. With an
elastic element u' jumps instead: slip begins at a finite rate, the gap grows with its first derivative, and the
distance to the cone after slip with its second. Rigid surfaces part with the third derivative and begin to slip
with the second. `_turn` names the order, and the search takes that derivative for the sign.

Dwell. An event within DWELL of the last one (a graze, or the tip of the cone) is not acted on: the regime is kept
for DWELL, and then decided anew from the state alone. The regime's motion is linear all the same, so its own
energy balance stays exact; what a decision changes in the state (the element's displacement, when the gap or
the cone were overstepped meanwhile) is counted in sums[IMPACT]. `held` says how often that has happened.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fivcore.contact.reduced import full_model, reduced_model
from fivcore.contact.uniqueness import check_unique, critical_mu_of
from fivcore.errors import ContactError, DivergenceError, not_unique
from fivcore.jit import Array
from fivcore.transient import spectra as listener
from fivcore.transient.chunks import Chunk, rows_in
from fivcore.transient.drive import Canonical, State
from fivcore.transient.exact_kernels import S, full_state, integrate, sample, search
from fivcore.transient.exact_regimes import SLIP_DOWN, SLIP_UP, regimes
from fivcore.transient.statistics import IMPACT, SEPARATION, SETTLED_FROM, STATE, STICK, SUM_N, WORK, Tally, follow

# An event this soon after another, s, is not acted on.
DWELL = 1e-10
# Slip may grow by so much, as a power of e, within DWELL; and so much of the size of the motion, the root of its
# energy, may be lost in rounding.
MOST_GROWTH, LOST = 10.0, 1e-9
# What ended a stretch that no watched function did.
BOUNDARY, HELD = -1, -2
# Grid on which statistics are read, s.
STEP = 1e-6
CHUNK = 0.04
_NONE = (0, 0, 0)


class ExactRun:
    """One run in progress.

    Attributes
    ----------
    held : int
        How many events came within DWELL of the last one.
    """

    def __init__(
        self,
        scene: Canonical,
        *,
        ramp: float,
        cutoff: float | None,
        termination: str,
        step: float | None,
        initial: State | None,
        tally: Tally,
        sample_rate: float | None,
        relaxation_time: float | None = None,
        cross_terms: bool = True,
    ) -> None:
        self.scene, self.ramp, self.tally = scene, ramp, tally
        model = reduced_model(scene.rig, scene.theta, cutoff, termination, relaxation_time, cross_terms)
        self.model = model
        check_unique(model, scene.mu, None)
        self.step = STEP if step is None else step
        self._hearing = max(round(listener.INTERVAL / self.step), 1)
        self._recording = 0 if sample_rate is None else max(round(1.0 / (sample_rate * self.step)), 1)
        self.rate = 1.0 / (self._hearing * self.step)
        self._element, self._dashpot = bool(model.K.any()), bool(model.C.any())
        self._shape = np.stack([model.normal, model.tangential])
        self._rigid = int(np.argmin(model.stiffness))
        # What resists a change of slip: (N, T) changes by it times the change of the slip rate, or of its rate.
        self._resistance = (model.C if self._dashpot else model.K) if self._element else np.linalg.inv(model.W)
        self._regimes = regimes(model, scene.mu)
        every = np.concatenate([r.rates for r in self._regimes])
        self._finest = 0.25 / float(np.abs(every).max())
        self._longest = 2.5 / float(np.abs(every.imag).max())
        self.held = 0
        fastest = max(float(r.rates.real.max()) for r in self._regimes)
        if fastest * DWELL > MOST_GROWTH:
            raise ContactError(
                f"{not_unique(scene.mu, critical_mu_of(model, None))}, and so close to it slip grows by more than"
                f" e^{MOST_GROWTH:g} within {DWELL:g} s, which is not resolved"
            )
        self._size = float(np.sum(model.stiffness * model.rest**2) + scene.pace**2 * np.sum(model.inertia**2))
        self._begin(initial)

    def _begin(self, initial: State | None) -> None:
        model = self.model
        n = len(model.stiffness)
        self._initial = STICK if initial is None else initial.contact
        self.tally.flags[STATE] = self._initial
        y = np.zeros(2 * n + 2)
        if initial is not None:
            y[:n] = initial.displacement[model.kept] - model.rest
            y[n : 2 * n] = initial.velocity[model.kept]
            if self._element:
                full = full_model(self.scene.rig, self.scene.theta)
                dropped = np.stack([full.normal, full.tangential]) * np.logical_not(model.kept)
                y[2 * n :] = dropped @ initial.displacement - np.linalg.solve(model.K, [1.0, 0.0])
        if self.ramp == 0.0:
            y[n : 2 * n] += model.inertia * self.scene.pace
        self._y, self._started = y, False
        self._first_energy = self._energy_of(y)
        self._now, self._end, self._sticks = 0.0, np.inf, np.zeros((0, 2))

    def start(self, end: float) -> None:
        """Find the first regime; the run is to end at `end`."""
        self._end, self._started, self._origin = end, True, 0.0
        y, which = self._y, self._initial
        if not self._element and which == STICK:
            # Whatever the surfaces' relative motion is, it ends at once.
            self._land(0.0, y)
        else:
            self._decide(0.0, y, which if which < 2 else SLIP_UP)

    def chunks(self, last: int) -> Iterator[Chunk | Array]:
        """Run to step `last`, handing over what was recorded and heard."""
        self.start(last * self.step)
        per_chunk = max(round(CHUNK / self.step), 1)
        hearing, recording = self._hearing, self._recording
        for first in range(0, last, per_chunk):
            target = min(first + per_chunk, last)
            heard = np.zeros(((target - first) // hearing + 1, 2))
            rows = np.zeros((rows_in(first, target, recording), 6))
            # There may be more than one event within a step.
            self._sticks = self.tally.room(first * self.step, target * self.step, min(self.step, 1e-7))
            self._reach(first, target, heard, rows)
            taken = self.tally.taken(self._sticks)
            yield rows
            yield Chunk.cut(first, target, self.step, 0.5, heard, hearing, taken)

    def _reach(self, first: int, target: int, heard: Array, rows: Array) -> None:
        """Go on to the end of step `target` - 1."""
        i, goal = first, target * self.step
        while True:
            end = min(self._stop, goal)
            r, c, start = self._regime, self._c, self._start_values
            motion = (r.rates, c, r.real, r.imaginary, r.drift, start)
            until = min(max(int(np.ceil(end / self.step - 0.5)), i), target) if end < goal else target
            sample(
                *motion, self._origin, min(self._which, 2), self.step, i, until, first, self.tally.arrays,
                heard, self._hearing, rows, self._recording,
            )  # fmt: skip
            model = self.model
            integrate(
                *motion, self._now - self._origin, end - self._origin, self._finest, self._longest,
                model.damping, model.inertia, model.C, self.tally.sums,
            )  # fmt: skip
            i, self._now = until, end
            if self._stop >= goal or not np.isfinite(c).all():
                return
            self._turn()

    def _enter(self, t: float, which: int, y: Array, orders: tuple[int, int, int] = _NONE) -> None:
        """Begin a regime at time `t` in the full state `y`, and find when it ends."""
        model, r, n = self.model, self._regimes[which], len(self.model.stiffness)
        ramping = t < self.ramp
        acceleration = self.scene.pace / self.ramp if ramping else 0.0
        start = np.array([0.0, self._pace(t), acceleration, 1.0, 0.0, 0.0, 0.0, 0.0])
        if which == STICK:
            start[S] = model.tangential @ y[:n] + (y[-1] if self._element else 0.0)
        elif which == SEPARATION:
            j = self._rigid
            start[4:] = y[j], y[n + j], model.inertia[j] * acceleration - model.normal[j], model.damping[j]
        c = r.into @ y + r.into_drift @ start[:6]
        self._which, self._regime, self._c, self._start_values, self._origin = which, r, c, start, t
        found = self._state_at(t)
        self._check(t, y, found)
        self.tally.sums[IMPACT] += self._energy_of(y) - self._energy_of(found)
        flags, moments, sums, forces, speeds, *_ = self.tally.arrays
        follow(flags, moments, sums, forces, speeds, self._sticks, t, min(which, 2))
        boundary = min(self.ramp, self._end) if ramping else self._end
        parts = np.ascontiguousarray(r.watched * c)
        length, self._hit = search(
            r.rates, parts, r.watched_drift, start, np.array(orders, dtype=np.int64), max(boundary - t, 0.0)
        )
        self._stop = boundary if self._hit == BOUNDARY else t + length
        if self._hit != BOUNDARY and length < DWELL:
            self._stop = t + DWELL
            self._hit = HELD
            self.held += 1

    def _check(self, t: float, asked: Array, found: Array) -> None:
        """Refuse to go on where the modes of a state are not found again in the regime's eigenbasis.

        Where one mode is slower than all else by many orders of magnitude, its answer to the drive is so much
        larger than the motion that the digits of the latter are lost in it.
        """
        n = len(self.model.stiffness)
        wrong = (found - asked)[: 2 * n]
        size = np.sum(wrong[n:] ** 2) + np.sum(self.model.stiffness * wrong[:n] ** 2)
        # Without an element a landing changes velocities; no slow mode has been seen to matter there.
        if self._element and size > LOST**2 * max(self._size, 2.0 * abs(self._energy_of(asked))):
            raise DivergenceError(
                f"at t = {t:.6g} s the motion is lost in the rounding of a mode far slower than it"
            )

    def _turn(self) -> None:
        """The stretch is over: decide what follows."""
        t, which, hit = self._stop, self._which, self._hit
        y = self._state_at(t)
        if hit == HELD or (hit == BOUNDARY and not self._element and which != SEPARATION):
            self._decide(t, y, which)
        elif hit == BOUNDARY:
            self._enter(t, which, y)
        elif which == SEPARATION:
            self._land(t, y)
        elif hit == 0:
            # N = 0: the gap begins to grow with N's loss, which each element sees in another derivative.
            self._enter(t, SEPARATION, y, ((2 if self._dashpot else 1) if self._element else 3, 0, 0))
        elif which == STICK:
            begins = (1 if self._dashpot else 0) if self._element else 2
            self._enter(t, SLIP_UP if hit == 1 else SLIP_DOWN, y, (0, begins, 0))
        elif self._element:
            begins = 1 if self._dashpot else 2
            self._enter(t, STICK, y, (0, begins, 0) if which == SLIP_UP else (0, 0, begins))
        else:
            self._resume(t, y)

    def _decide(self, t: float, y: Array, was: int) -> None:
        """What follows from the state alone."""
        n = len(self.model.stiffness)
        gap, _ = self._shape @ y[:n]
        if was == SEPARATION:
            if gap + y[-2] > 0.0:
                self._enter(t, SEPARATION, y)
            else:
                self._land(t, y)
        elif not self._element:
            rate = float(self.model.tangential @ y[n : 2 * n]) - self._pace(t)
            self._resume(t, y, 0.0 if was == STICK else rate)
        else:
            which = self._cone(self._sticking(t, y))
            self._enter(t, which, y, (1, 0, 0) if which == SEPARATION and self._dashpot else _NONE)

    def _land(self, t: float, y: Array) -> None:
        """Touch-down: the closing speed alone decides, by the force, force rate or impulse that stops it."""
        n = len(self.model.stiffness)
        rates = np.array([0.0, self._pace(t)]) - self._shape @ y[n : 2 * n]
        if not self._element:
            impulse = self._resistance @ rates
            which = self._cone(impulse)
            if which != STICK:
                impulse = self._slipping(impulse, which) if which != SEPARATION else np.zeros(2)
            before, y = self._energy_of(y), y.copy()
            y[n : 2 * n] += self._shape.T @ impulse
            # Friction pulls at the moving clamp too, and that is the drive's work.
            work = impulse[1] * self._pace(t)
            self.tally.sums[WORK] += work
            self.tally.sums[IMPACT] += before + work - self._energy_of(y)
            if t >= self.tally.moments[SETTLED_FROM]:
                # An impulse belongs to the mean of N, though to no instant's.
                self.tally.sums[SUM_N] += impulse[0]
            speed = float(self.model.tangential @ y[n : 2 * n]) - self._pace(t)
            self._resume(t, y, 0.0 if which == STICK else speed)
            return
        if not self._dashpot:
            which = self._cone(self.model.K @ rates)
            self._enter(t, which, y, (1, 1, 1) if which == STICK else (1, 0, 0))
            return
        which = self._cone(self._sticking(t, y))
        self._enter(t, which, y, (2, 0, 0) if which == SEPARATION else _NONE)

    def _resume(self, t: float, y: Array, speed: float = 0.0) -> None:
        """Rigid surfaces in contact, with a slip rate: what the accelerations decide."""
        model, n = self.model, len(self.model.stiffness)
        ramping = self.scene.pace / self.ramp if t < self.ramp else 0.0
        free = model.inertia * ramping - model.stiffness * y[:n] - model.damping * y[n : 2 * n]
        force = self._resistance @ (np.array([0.0, ramping]) - self._shape @ free) + [1.0, 0.0]
        if speed == 0.0:
            which = self._cone(force)
            orders = (2, 0, 0) if which == SEPARATION else (0, 0, 0) if which == STICK else (0, 1, 0)
            self._enter(t, which, y, orders)
            return
        which = SLIP_DOWN if speed > 0.0 else SLIP_UP
        if self._slipping(force, which)[0] > 0.0:
            self._enter(t, which, y)
        else:
            self._enter(t, SEPARATION, y, (2, 0, 0))

    def _sticking(self, t: float, y: Array) -> Array:
        """(N, T) that the element carries if the surfaces do not move on each other."""
        n = len(self.model.stiffness)
        u = np.array([-self.model.normal @ y[:n], y[-1]])
        rates = np.array([0.0, self._pace(t)]) - self._shape @ y[n : 2 * n]
        return np.asarray(self.model.K @ u + self.model.C @ rates + [1.0, 0.0])

    def _slipping(self, force: Array, which: int) -> Array:
        """(N, T) on the edge of the cone from (N, T) of sticking."""
        m = self.scene.mu if which == SLIP_UP else -self.scene.mu
        R = self._resistance
        excess = (force[1] - m * force[0]) / (R[1, 1] - m * R[0, 1])
        return force - R[:, 1] * excess

    def _cone(self, force: Array) -> int:
        """The regime, from what sticking would need: unique, see `fivcore.contact.law`."""
        N, T = force
        if N > 0.0 and abs(T) <= self.scene.mu * N:
            return STICK
        which = SLIP_UP if T > 0.0 else SLIP_DOWN
        return which if self._slipping(force, which)[0] > 0.0 else SEPARATION

    def _pace(self, t: float) -> float:
        """Velocity of the clamp."""
        return self.scene.pace * t / self.ramp if t < self.ramp else self.scene.pace

    def _state_at(self, t: float) -> Array:
        r = self._regime
        return full_state(r.rates, self._c, r.state, r.state_drift, self._start_values, t - self._origin)

    def stored_energy(self) -> float:
        """Of the modes about the equilibrium, the element and the load, canonical."""
        return self._energy_of(self._state_at(self._now) if self._started else self._y)

    def _energy_of(self, y: Array) -> float:
        model, n = self.model, len(self.model.stiffness)
        q, v, u = y[:n], y[n : 2 * n], y[2 * n :]
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + model.normal @ q + u[0] + 0.5 * u @ model.K @ u)

    def state_at(self, t: float) -> Array:
        """Go on to time t: modal displacements and velocities, and the element's state."""
        while self._stop <= t:
            self._turn()
        return self._state_at(t)

    def released_energy(self) -> float:
        """What has been taken out of the store since the start."""
        return self._first_energy - self.stored_energy()

    def calm(self, floor: float) -> bool:
        """Set what is far below every scale to zero; False where a number is not finite."""
        self._c[np.abs(self._c) < floor] = 0.0
        return bool(np.isfinite(self._c).all())
