"""Flow of a normalised scene between contact events, with its tangent: the law of method "exact".

In each contact status of `fivcore.contact.law` the motion obeys y' = A y + b, and a matrix exponential propagates
it and any deviation over any time without a step. If friction falls with the speed, slip and its deviations are
integrated as in method "exact". The steps of `fast` would not do, because their events move by whole steps only,
so that their tangent neglects the shift of a touchdown, where N jumps.

A state z, (m + 1,), is (q, v, u) of `fivcore.transient.exact_kernels`, scaled by the modal frequencies, 1 and the
roots of the springs so that its sum of squares is an energy, followed by 1 so that affine maps are matrices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from fivcore.contact.law import resistance
from fivcore.errors import SceneValueError
from fivcore.jit import Array
from fivcore.transient import exact_kernels as kernels
from fivcore.transient.exact import ExactRun
from fivcore.transient.exact_kernels import GAP, RATES, SLIP_RATE, SLIP_UP, N, T
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.options import Options, RunOptions
from fivcore.transient.statistics import SAMPLE, SEPARATION, STICK

# Sampling interval between events, in units of the shortest time; number of samples examined together for a plane.
COMPLIANT_GRID, RIGID_GRID, BLOCK = 0.5, 0.1, 64
# A cycle without events closes where it crosses a plane.
PLANE = -1
# Deviations for numerical derivatives with falling friction, relative to the motion and to the decay speed; a time
# at which nothing is sampled, s.
DEVIATION, BESIDE, NEVER = 1e-6, 1e-3, 1e6
NOWHERE = np.zeros((1, SAMPLE)), np.zeros((1, 6)), np.zeros((1, 2))


class Segment(NamedTuple):
    """Motion from `start`, (m + 1,), for `time`, s, to an event: the index of a margin, or `PLANE`."""

    status: int
    event: int
    time: float
    start: Array


# A segment, and the next status with its start.
Happening = tuple[Segment, int, Array]


class Flow:
    """Motion of a scene in each contact status; modes have the same signs as those of the flow `like`.

    Raises
    ------
    SceneValueError, ContactError
        As method "exact".
    """

    def __init__(self, scene: Normalised, options: Options, like: Flow | None = None) -> None:
        self.scene, self.options, self.run = scene, options, started(scene, options)
        self.model, self.rigid, n = self.run.model, self.run.rigid, len(self.run.model.stiffness)
        model, signs = self.model, np.ones(n)
        if like is not None:
            now, then = (np.stack([*each.shapes, each.output]) for each in (model, like.model))
            if now.shape != then.shape:
                raise SceneValueError("scene: it has not as many modes as the one before; give a cutoff")
            signs = like.signs * np.where(np.sum(now * then, axis=0) < 0.0, -1.0, 1.0)
        self.signs: Array = signs
        fastest = float(np.sqrt(model.stiffness.max())) if self.rigid else model.contact_frequency
        self.grid = (RIGID_GRID if self.rigid else COMPLIANT_GRID) / fastest
        omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, fastest**2))
        springs = np.ones(2) if self.rigid else np.sqrt(np.diag(model.K))
        self.units = np.concatenate([signs * omega, signs, springs])
        self._drive = np.array([0.0, scene.speed_per_load, 0.0])
        # Gap and rates of the gaps, of (y, 1).
        none = np.zeros(n)
        self._gap = np.concatenate([model.normal, none, [1.0, 0.0, 0.0]])
        self._rates = np.zeros((2, len(self._gap)))
        self._rates[:, n : 2 * n], self._rates[1, -1] = model.shapes, -scene.speed_per_load
        self.velocity_B = np.concatenate([none, signs * model.output, [0.0, 0.0, 0.0]])
        self._laws: dict[int, Array] = {}

    # The law of a status.

    def law(self, status: int, z: Array) -> Array:
        """Rows N to `RATES` and on about z, (4 + m, m + 1), whose products with z are the values there."""
        if self.falls(status):
            return self._falling(status, z)
        if status not in self._laws:
            self._laws[status] = np.asarray(kernels.affine_law(self.units, status, self.run.system, self._drive))
        return self._laws[status]

    def _falling(self, status: int, z: Array) -> Array:
        """Slip law about z with falling friction: the law of stick or of zero forces, plus the effect of slip."""
        (C, W), law, sense = self.run.system[6:8], self.run.system[8], 1.0 if status == SLIP_UP else -1.0
        rows, n = self.law(SEPARATION if self.rigid else STICK, z).copy(), len(self.model.stiffness)
        was, accelerations = rows[[N, T]], rows[RATES + n : RATES + 2 * n]

        def through(row: Array, value: float) -> Array:
            return np.append(row[:-1], value - row[:-1] @ z[:-1])

        if self.rigid:
            slip = -sense * rows[SLIP_RATE]
            mu, slope = kernels.coefficient(float(slip @ z), law)
            free, stiff = self.model.normal * self.signs @ accelerations, W[0, 0] + sense * mu * W[0, 1]
            normal = float(-free @ z) / stiff
            rows[N] = through(-(free + normal * sense * slope * W[0, 1] * slip) / stiff, normal)
        else:
            forces = was @ z
            x, mu, slack = kernels.sliding(forces[0], forces[1], C, law, sense)
            normal, slope = forces[0] - sense * C[0, 1] * x, kernels.coefficient(x, law)[1]
            slip = through((sense * was[1] - mu * was[0]) / slack, x)
            rows[N] -= sense * C[0, 1] * slip
            rows[SLIP_RATE] = -sense * slip
            rows[RATES + 2 * n + 1] -= sense * self.units[-1] * slip
        rows[T] = through(sense * (mu * rows[N] + slope * normal * slip), sense * mu * normal)
        accelerations += self.signs[:, None] * (self.model.shapes.T @ (rows[[N, T]] - was))
        return rows

    def falls(self, status: int) -> bool:
        """Whether the law of a status is not linear."""
        return status >= SLIP_UP and not self.scene.friction.constant

    def field(self, status: int, z: Array) -> Array:
        """Derivative of the rate of z about z, (m + 1, m + 1); its product with z is the rate."""
        return np.vstack([self.law(status, z)[RATES:], np.zeros(len(z))])

    def margins(self, status: int, z: Array) -> Array:
        """Rows of the margins, (e, m + 1), as in `law`; a status lasts while all its margins are positive.

        Margins are the gap in separation; N, mu N - T and mu N + T in stick; N and the slip rate against T in
        slip.
        """
        rows, mu = self.law(status, z), self.scene.mu
        if status == SEPARATION:
            return rows[GAP : GAP + 1]
        if status == STICK:
            return np.stack([rows[N], mu * rows[N] - rows[T], mu * rows[N] + rows[T]])
        return np.stack([rows[N], -rows[SLIP_RATE] if status == SLIP_UP else rows[SLIP_RATE]])

    def along(self, status: int, states: Array) -> Array:
        """Margins at many states (m + 1, k), (e, k)."""
        if self.falls(status):
            return np.transpose([self.margins(status, z) @ z for z in states.T])
        return np.asarray(self.margins(status, states[:, 0]) @ states)

    def margin(self, status: int, event: int, z: Array, plane: Array) -> Array:
        """The row (m + 1,) of the margin that vanishes at an event."""
        return plane if event == PLANE else self.margins(status, z)[event]

    def size(self, z: Array) -> float:
        """Norm of a motion, at least that of the drive."""
        return max(float(np.linalg.norm(z[:-1])), self.scene.speed_per_load)

    # Motion within a status.

    def _follow(self, status: int, z: Array, time: float, heeds: bool) -> tuple[int, float, Array]:
        """Event, its time, s, and the state there, or after `time`."""
        run = self.run
        run.enter(0.0, status, z[:-1] / self.units)
        # Work and losses start at zero here, because the error control of a step includes them.
        run.motion[-7:-3], run.motion[-2] = 0.0, self.grid
        event = kernels.follow(
            run.motion,
            status,
            0.0,
            time,
            heeds,
            run.system,
            self._drive,
            run.zeros,
            run.step,
            run.record,
            *NOWHERE,
        )
        if event < kernels.NOTHING:
            run.check(float(run.motion[-2]), 0.0)
        return event, float(run.motion[-3]), np.append(run.motion[:-7] * self.units, 1.0)

    def over(self, status: int, z: Array, time: float, tangent: bool = True) -> tuple[Array, Array]:
        """State after a time, s, which may be negative, and on request its derivative by z, (m + 1, m + 1)."""
        if not self.falls(status) or time <= 0.0:
            power = expm(time * self.field(status, z))
            return power @ z, power
        end, derivative = self._follow(status, z, time, False)[2], np.eye(len(z))
        if tangent:
            h, last = self._deviation(z), len(z) - 1
            # A deviation also keeps the gap closed.
            for j, change in enumerate(h * self.entry(status, status, z)[:, :last].T):
                ends = [self._follow(status, z + way * change, time, False)[2] for way in (1.0, -1.0)]
                derivative[:, j] = (ends[0] - ends[1]) / (2.0 * h)
            derivative[:last, last] = (end - derivative[:, :last] @ z[:last])[:last]
        return end, derivative

    def _deviation(self, z: Array) -> float:
        """A deviation small enough for a linear friction law."""
        model, least = self.model, BESIDE * self.scene.friction.decay_speed
        rate = np.abs(model.shapes[1]).max() if self.rigid else np.sqrt(model.K[1, 1]) / model.C[1, 1]
        return min(DEVIATION * self.size(z), least / rate)

    def samples(self, status: int, z: Array, time: float) -> tuple[Array, Array]:
        """Times (k,) and states (m + 1, k) up to `time`, s."""
        count = max(int(np.ceil(time / self.grid)), 8)
        times, states = np.linspace(0.0, time, count + 1), z[:, None]
        if self.falls(status):
            while states.shape[1] <= count:
                states = np.column_stack([states, self._follow(status, states[:, -1], times[1], False)[2]])
            return times, states
        power = expm(times[1] * self.field(status, z))
        while states.shape[1] <= count:
            states, power = np.hstack([states, power @ states]), power @ power
        return times, states[:, : count + 1]

    # Events.

    def to_event(self, status: int, z: Array, most: float, plane: Array | None) -> Happening | None:
        """Follow z to its first event or upward crossing of a plane (m + 1,) within `most`, s; None without."""
        crossed = None if plane is None else self._crossing(status, z, most, plane)
        event, time, end = self._follow(status, z, crossed[0] if crossed else most, True)
        if event == kernels.NOTHING:
            return (Segment(status, PLANE, crossed[0], z), status, crossed[1]) if crossed else None
        self.run.next_status(0.0, event, end[:-1] / self.units)
        return Segment(status, event, time, z), self.run.which, np.append(self.run.motion[:-7] * self.units, 1.0)

    def _crossing(self, status: int, z: Array, most: float, plane: Array) -> tuple[float, Array] | None:
        """Time, s, within `most`, and state where z first crosses a plane upwards."""
        begun = 0.0
        while begun < most:
            times, states = self.samples(status, z, min(BLOCK * self.grid, most - begun))
            height = plane @ states
            crossed = np.flatnonzero((height[:-1] < 0.0) & (height[1:] >= 0.0))
            if len(crossed):
                k = crossed[0]
                time = times[1] * height[k] / (height[k] - height[k + 1])
                for _ in range(3):
                    end, _ = self.over(status, states[:, k], time, tangent=False)
                    time -= float(plane @ end) / float(plane @ self.field(status, end) @ end)
                return begun + float(times[k]) + time, self.over(status, states[:, k], time, tangent=False)[0]
            begun, z = begun + float(times[-1]), states[:, -1]
        return None

    def entry(self, was: int, status: int, z: Array) -> Array:
        """Map of z at the end of a status to the start of the next, (m + 1, m + 1): gaps and rates close."""
        model, W, n, E = self.model, self.model.W, len(self.model.stiffness), np.eye(len(z))
        # Rigid surfaces have no u.
        E[2 * n : -1] *= not self.rigid
        if status == SEPARATION and not (self.rigid and was == SEPARATION):
            return E
        if not self.rigid:
            E[2 * n] -= self._gap
        else:
            E[:n] -= np.outer(model.normal / W[0, 0], self._gap)
            stick, m, sticks = resistance(W) @ self._rates, 0.0, status == STICK
            if was == SEPARATION:
                # Impulse that makes the surfaces stick.
                normal, tangential = -stick @ np.append(z[:-1] / self.units, 1.0)
                m = float(np.copysign(self.run.slipping, tangential))
                sticks = abs(tangential) <= abs(m) * normal
                if not (sticks or self.scene.friction.constant):
                    raise SceneValueError(
                        "friction: it falls with the speed and the rigid contact opens; limit cycles need a"
                        " constant coefficient in impacts, or a structure with a compliant contact"
                    )
            slides = np.outer((model.normal + m * model.tangential) / (W[0, 0] + m * W[0, 1]), self._rates[0])
            E[n : 2 * n] -= model.shapes.T @ stick if sticks else slides
        units = np.append(self.units, 1.0)
        return np.asarray(units[:, None] * E / units)

    # States of a run.

    def of_state(self, state: State) -> tuple[int, Array]:
        """Contact status and z of a state of the scene, in its own units."""
        load = self.scene.load
        own = State(state.displacement / load, state.velocity / load, state.contact, True)
        run = started(self.scene, self.options, own)
        return run.which, np.append(run.motion[:-7] * self.units, 1.0)

    def state(self, status: int, z: Array) -> State:
        """The state of the scene, in its own units, at z."""
        self.run.enter(0.0, status, z[:-1] / self.units)
        end = State.end_of(self.scene, self.run, np.zeros(0))
        return State(end.displacement, end.velocity, min(status, SLIP_UP), True)


def started(scene: Normalised, options: Options, initial: State | None = None) -> ExactRun:
    """A run of "exact" from a normalised state, by default at rest, without sampling."""
    options = RunOptions(
        duration=NEVER, step=NEVER, method="exact", ramp=0.0, cutoff=options.cutoff, modify=options.modify,
        initial=initial,
    )  # fmt: skip
    return ExactRun(scene, options)
