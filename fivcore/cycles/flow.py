"""Flow of a normalised scene between contact events, with its tangent.

In a contact status of `fivcore.contact.law` the motion is y' = A y + b: a matrix exponential takes it, and any
deviation from it, over any time without a step. Where friction falls with the speed, slip is integrated together
with its variational equation by the method of order 8 of Dormand and Prince. In steps of `fast` an event moves by
whole steps only: their tangent misses that a deviation shifts a touchdown, where N jumps.

A state z (m + 1,) is (omega q, v, sqrt(K) u, 1), so that the sum of squares is an energy and affine maps are
matrices; q are deviations from `ReducedModel.static_equilibrium`. Statuses have the numbers of
`fivcore.transient.exact_kernels`: 0 separation, 1 stick, 2 slip with T > 0, 3 slip with T < 0.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from fivcore.contact.law import resistance
from fivcore.contact.reduced import ReducedModel, full_model, modified, reduced_model
from fivcore.errors import SceneValueError, not_unique
from fivcore.jit import Array
from fivcore.transient.exact_kernels import SLIP_DOWN, SLIP_UP, coefficient, sliding
from fivcore.transient.normalised import Normalised, State, residual_gaps, static_displacement
from fivcore.transient.options import Options
from fivcore.transient.statistics import SEPARATION, STICK

# Rows of a model that change their sign with a mode's.
SIGNED = ("normal", "tangential", "inertia", "output", "load")
# Rows of a law: forces, rates of u, slip rate and gap.
N, T, RATE_N, RATE_T, SLIP_RATE, GAP = range(6)
# Samples between events, in units of the shortest time, and in a block of them, as a power of 2.
COMPLIANT_GRID, RIGID_GRID, DOUBLINGS = 0.5, 0.1, 6
# A cycle without events closes where it crosses a plane.
PLANE = -1


class Segment(NamedTuple):
    """Motion from `start` (m + 1,) to an event, the number of a margin or `PLANE`, after `time`, s."""

    status: int
    event: int
    time: float
    start: Array


class Flow:
    """Motion of a scene in each contact status; `like` is a flow whose modes' signs its modes have."""

    def __init__(self, scene: Normalised, options: Options, like: Flow | None = None) -> None:
        self.options = options
        model = modified(reduced_model(scene.rig, scene.theta, options.cutoff), options.modify)
        n, law = len(model.stiffness), scene.friction
        self.signs = np.ones(n)
        if like is not None:
            now, then = (np.stack([*each.shapes, each.output]) for each in (model, like.model))
            if now.shape != then.shape:
                raise SceneValueError("scene: it has not as many modes as the one before; give a cutoff")
            self.signs = np.where(np.sum(now * then, axis=0) < 0.0, -1.0, 1.0)
            model = replace(model, **{name: self.signs * getattr(model, name) for name in SIGNED})
        self.scene, self.rigid = scene, not model.K.any()
        self.model: ReducedModel = model
        if not (self.rigid or model.C.any()):
            raise SceneValueError("scene: its contact has no dashpot, which a limit cycle needs; give d2 > 0")
        ratio = law.kinetic_ratio if law.decay_speed == 0.0 else 1.0
        if scene.mu * ratio >= (most := model.painleve_mu(None)):
            raise not_unique(scene.mu, most)
        self._slipping = ratio * scene.mu
        self._law = (self._slipping, 1.0, 0.0, 0.0) if law.constant else (scene.mu, *law.law)
        fastest = float(np.sqrt(model.stiffness.max())) if self.rigid else model.contact_frequency
        self.grid = (RIGID_GRID if self.rigid else COMPLIANT_GRID) / fastest
        omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, fastest**2))
        springs = np.zeros(0) if self.rigid else np.sqrt(np.diag(model.K))
        self._units = np.concatenate([omega, np.ones(n), springs])
        # Rows of q, v, u and 1.
        rows = np.eye(len(self._units) + 1)
        q, v, one = rows[:n] / omega[:, None], rows[n : 2 * n], rows[-1]
        self.velocity_B, self._gap = model.output @ v, model.normal @ q
        self._rates = model.shapes @ v - np.outer([0.0, scene.speed_per_load], one)
        free = -model.stiffness[:, None] * q - model.damping[:, None] * v - np.outer(model.normal, one)
        # Rate of z without contact, and what N, T and the rates of u add.
        self._base, self._push = 0.0 * rows, np.zeros((len(rows), 4))
        self._base[:n], self._base[n : 2 * n], self._push[n : 2 * n, :2] = omega[:, None] * v, free, model.shapes.T
        self._free_N = model.normal @ free
        if self.rigid:
            self._stick = -resistance(model.W) @ model.shapes @ free
        else:
            u = rows[2 * n : -1] / springs[:, None]
            self._push[2 * n : -1, 2:] = np.diag(springs)
            self._spring = model.K @ u + np.outer([1.0, 0.0], one)
            self._stick, self._gap = self._spring - model.C @ self._rates, self._gap + u[0]
        self._blocks: dict[int, list[Array]] = {}

    # The law of a status.

    def law(self, status: int, z: Array) -> tuple[Array, Array]:
        """Values of the rows N to GAP at z, (6,), and their derivatives, (6, m + 1)."""
        rows, sense = np.zeros((6, len(z))), 1.0 if status == SLIP_UP else -1.0
        rows[GAP] = self._gap
        if not self.rigid:
            rows[RATE_N : RATE_T + 1] = -self._rates
        if status == STICK:
            rows[:2] = self._stick
        elif status == SEPARATION:
            if not self.rigid:
                rows[RATE_N : RATE_T + 1] = -np.linalg.solve(self.model.C, self._spring)
            rows[SLIP_RATE] = self._rates[1] + rows[RATE_T]
        else:
            C, W = self.model.C, self.model.W
            if self.rigid:
                x, turn = -sense * float(self._rates[1] @ z), -sense * self._rates[1]
                mu, slope = coefficient(x, self._law)
                divisor = W[0, 0] + sense * mu * W[0, 1]
                force = -float(self._free_N @ z) / divisor
                rows[N] = -(self._free_N + force * W[0, 1] * sense * slope * turn) / divisor
            else:
                normal, tangential = self._stick @ z
                x, mu, slack = sliding(normal, tangential, C, self._law, sense)
                slope = coefficient(x, self._law)[1]
                turn = (sense * self._stick[1] - mu * self._stick[0]) / slack
                force = normal - sense * C[0, 1] * x
                rows[N] = self._stick[0] - sense * C[0, 1] * turn
                rows[RATE_T] -= sense * turn
            rows[T], rows[SLIP_RATE] = sense * (mu * rows[N] + slope * force * turn), -sense * turn
            if self.falls(status):
                others = rows @ z
                others[[N, T, SLIP_RATE]] = force, sense * mu * force, -sense * x
                others[RATE_T] = 0.0 if self.rigid else -float(self._rates[1] @ z) - sense * x
                return others, rows
        return rows @ z, rows

    def falls(self, status: int) -> bool:
        """Whether the law of a status is not linear."""
        return status >= SLIP_UP and not self.scene.friction.constant

    def field(self, status: int, z: Array) -> tuple[Array, Array]:
        """Rate of z, (m + 1,), and its derivative, (m + 1, m + 1)."""
        values, rows = self.law(status, z)
        return self._base @ z + self._push @ values[:4], self._base + self._push @ rows[:4]

    def margins(self, status: int, z: Array) -> tuple[Array, Array]:
        """Margins while which are positive the status lasts, (e,), and their derivatives, (e, m + 1).

        In separation the gap; in stick N, mu N - T and mu N + T; in slip N and the slip rate against T.
        """
        values, rows = self.law(status, z)
        weights = self._weights(status)
        return weights @ values, weights @ rows

    def along(self, status: int, states: Array) -> Array:
        """Margins at many states (m + 1, k), (k, e)."""
        if self.falls(status):
            return np.array([self.margins(status, z)[0] for z in states.T])
        return np.asarray((self.margins(status, states[:, 0])[1] @ states).T)

    def _weights(self, status: int) -> Array:
        weights = np.zeros((1 if status == SEPARATION else 3 if status == STICK else 2, 6))
        weights[0, GAP if status == SEPARATION else N] = 1.0
        if status == STICK:
            weights[1:, :2] = [[self.scene.mu, -1.0], [self.scene.mu, 1.0]]
        elif status >= SLIP_UP:
            weights[1, SLIP_RATE] = -1.0 if status == SLIP_UP else 1.0
        return weights

    # Motion within a status.

    def over(self, status: int, z: Array, time: float, tangent: bool = True) -> tuple[Array, Array]:
        """State after a time, s, which may be negative, and its derivative by z, (m + 1, m + 1), if wanted."""
        if not self.falls(status):
            power = expm(time * self.field(status, z)[1])
            return power @ z, power
        size = len(z)
        if not tangent:
            options = {"rtol": 1e-11, "atol": 1e-12 * self.size(z)}
            found = solve_ivp(lambda t, y: self.field(status, y)[0], (0.0, time), z, "DOP853", **options)
            return found.y[:, -1], np.eye(size)

        def rates(t: float, y: Array) -> Array:
            rate, derivative = self.field(status, y[:size])
            return np.append(rate, derivative @ y[size:].reshape(size, size))

        start = np.append(z, np.eye(size))
        tolerance = 1e-12 * np.append(np.full(size, self.size(z)), np.ones(size * size))
        found = solve_ivp(rates, (0.0, time), start, "DOP853", rtol=1e-11, atol=tolerance)
        return found.y[:size, -1], found.y[size:, -1].reshape(size, size)

    def size(self, z: Array) -> float:
        """Norm of a motion, not less than that of the drive."""
        return max(float(np.linalg.norm(z[:-1])), self.scene.speed_per_load)

    def samples(self, status: int, z: Array, time: float | None = None) -> tuple[Array, Array]:
        """Times (k,) and states (m + 1, k) up to `time`, s, by default of the next block of the grid."""
        count = 2**DOUBLINGS if time is None else max(int(np.ceil(time / self.grid)), 8)
        times = np.linspace(0.0, self.grid * count if time is None else time, count + 1)
        if self.falls(status):
            options = {"t_eval": times, "rtol": 1e-9, "atol": 1e-11 * self.size(z)}
            found = solve_ivp(lambda t, y: self.field(status, y)[0], times[[0, -1]], z, "DOP853", **options)
            return times, found.y
        states = z[:, None]
        if time is None:
            if status not in self._blocks:
                powers = [expm(self.grid * self.field(status, z)[1])]
                while len(powers) < DOUBLINGS:
                    powers.append(powers[-1] @ powers[-1])
                self._blocks[status] = powers
            for power in self._blocks[status]:
                states = np.hstack([states, power @ states])
            return times, np.column_stack([states, self._blocks[status][0] @ states[:, -1]])
        power = expm(times[1] * self.field(status, z)[1])
        while states.shape[1] <= count:
            states, power = np.hstack([states, power @ states]), power @ power
        return times, states[:, : count + 1]

    # Events.

    def entry(self, was: int, status: int, z: Array) -> Array:
        """Map of z at the end of a status to the start of the next, (m + 1, m + 1): gaps and rates close."""
        model, W, n, E = self.model, self.model.W, len(self.model.stiffness), np.eye(len(self._base))
        if status == SEPARATION and not (self.rigid and was == SEPARATION):
            return E
        if not self.rigid:
            E[2 * n] -= self._units[2 * n] * self._gap
            return E
        E[:n] -= np.outer(self._units[:n] * model.normal / W[0, 0], self._gap)
        normal, tangential = self._impulse(z) if was == SEPARATION else (0.0, 0.0)
        if abs(tangential) <= self._slipping * normal if was == SEPARATION else status == STICK:
            E[n : 2 * n] -= model.shapes.T @ resistance(W) @ self._rates
            return E
        m = float(np.copysign(self._slipping, tangential)) if was == SEPARATION else 0.0
        if m and not self.scene.friction.constant:
            raise SceneValueError(
                "friction: it falls with the speed and the rigid contact opens; limit cycles need a constant"
                " coefficient in impacts, or a structure with a compliant contact"
            )
        E[n : 2 * n] -= np.outer((model.normal + m * model.tangential) / (W[0, 0] + m * W[0, 1]), self._rates[0])
        return E

    def _impulse(self, z: Array) -> Array:
        """Normal and tangential impulse by which rigid surfaces stick after an impact."""
        return np.asarray(-resistance(self.model.W) @ (self._rates @ z))

    def following(self, status: int, event: int, z: Array) -> int:
        """Status after an event in the state z."""
        if status != SEPARATION and event == 0:
            return SEPARATION
        if status == STICK:
            return SLIP_UP if event == 1 else SLIP_DOWN
        if status >= SLIP_UP and not self.rigid:
            return STICK
        slip_rate = 0.0
        if status == SEPARATION and self.rigid:
            normal, tangential = self._impulse(z)
            z = self.entry(status, SLIP_UP, z) @ z
            slip_rate = float(self._rates[1] @ z) * (abs(tangential) > self._slipping * normal)
        normal, tangential = self._stick @ z
        if slip_rate == 0.0 and normal > 0.0 and abs(tangential) <= self._slipping * normal:
            return STICK
        after = SLIP_UP if (slip_rate < 0.0 if slip_rate else tangential > 0.0) else SLIP_DOWN
        return after if self.law(after, z)[0][N] > 0.0 else SEPARATION

    def to_event(self, status: int, z: Array, most: float, plane: Array | None = None) -> tuple[int, float, Array]:
        """The first event from z, its time, s, and the state there; or where z crosses a plane (m + 1,) upwards.

        The time is infinite if it is not within `most`, s.
        """
        passed, last = 0.0, len(self._weights(status))
        while passed <= most:
            times, states = self.samples(status, z)
            values = self.along(status, states)
            if plane is not None:
                values = np.column_stack([values, -(plane @ states)])
            # A margin that begins at zero may be negative by rounding, but not after a step.
            begun = (values[:-1] > 0.0) | (
                (np.arange(len(values) - 1) == 0)[:, None] & (np.arange(values.shape[1]) < last)
            )
            crossed = (values[1:] <= 0.0) & begun
            if crossed.any():
                k = int(np.argmax(crossed.any(axis=1)))
                falls = np.where(crossed[k], values[k] - values[k + 1], 1.0)
                shares = np.where(crossed[k], np.maximum(values[k], 0.0) / falls, 2.0)
                event = int(np.argmin(shares))
                time = self.grid * (float(shares[event]) or 1.0)
                event = event if event < last else PLANE
                for _ in range(4):
                    end, _ = self.over(status, states[:, k], time, tangent=False)
                    margin, row = self.margin(status, event, end, plane)
                    change = margin / float(row @ self.field(status, end)[0])
                    if not 1e-9 * self.grid < abs(change) < 0.5 * self.grid:
                        break
                    time -= change
                return event, passed + float(times[k]) + time, end
            passed, z = passed + float(times[-1]), states[:, -1]
        return PLANE, np.inf, z

    def margin(self, status: int, event: int, z: Array, plane: Array | None) -> tuple[float, Array]:
        """The margin that vanishes at an event, and its derivative, (m + 1,)."""
        if event == PLANE and plane is not None:
            return float(plane @ z), plane
        values, rows = self.margins(status, z)
        return float(values[event]), rows[event]

    # States of a run.

    def of_state(self, state: State) -> Array:
        """Z of a normalised state, whose drive runs."""
        model, kept = self.model, self.model.kept
        parts = [
            self.signs * state.displacement[kept] - model.static_equilibrium,
            self.signs * state.velocity[kept],
        ]
        if not self.rigid:
            parts.append(residual_gaps(self.scene, kept, state) - np.linalg.solve(model.K, [1.0, 0.0]))
        return np.append(self._units * np.concatenate(parts), 1.0)

    def state(self, status: int, z: Array) -> State:
        """The state of the scene, in its own units, at z."""
        model, full, n = self.model, full_model(self.scene.rig, self.scene.theta), len(self.model.stiffness)
        q, v, u = np.split(z[:-1] / self._units, [n, 2 * n])
        displacement, velocity = np.zeros((2, len(full.normal)))
        kept = np.flatnonzero(model.kept)
        displacement[kept], velocity[kept] = self.signs * (q + model.static_equilibrium), self.signs * v
        if not self.rigid:
            displacement += static_displacement(model, full, u + np.linalg.solve(model.K, [1.0, 0.0]))
        load = self.scene.load
        return State(load * displacement, load * velocity, min(status, SLIP_UP), True)
