"""`method="paper"`: the published scheme on every mode of both beams (sections 3.2 and 3.3 of the paper).

Equations (15) and (16) are printed for beta2 = 0.5 and without damping, (14) and (18) with errors. With b = beta2
and r = dt / tau the scheme reads, per mode,

    v* = v + dt (1 - b) a,   a* = (f - k q - c v*) / (1 + b dt c),   q_free = q + dt (v* + b dt a*) + dt^2 a* / 2.

If the free gap is open, N = T = 0. Otherwise stick is tried, with g_N = 0 and g_T as in the last step; it is
accepted if N > 0 and |T| < mu N. Otherwise the contact slips with the simplified Prakash-Clifton law
T = (T_last + r s mu N) / (1 + r), g_N = 0 and N >= 0, where s is the sign of T in the trial. Then
a = a* + force / (1 + b dt c), v = v* + b dt a and q = q + dt v + dt^2 a / 2.

This is Newmark's method with beta = 0 and gamma = b. For b > 1/2 it is of first order and adds (b - 1/2) dt to d2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fivcore.contact.law import ratio
from fivcore.contact.reduced import ReducedModel, full_model
from fivcore.contact.step_map import at_most
from fivcore.errors import not_unique
from fivcore.jit import Array
from fivcore.transient.moving_contact import STRETCH, ContactMotion, moved_model
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.options import Options
from fivcore.transient.published_kernel import SCENE, advance
from fivcore.transient.record import INTERVAL, Segment, count_in, room_for_sticks
from fivcore.transient.statistics import SEPARATION, SETTLING, SLIP, STICK, begin

# Section 3.3 of the paper: time step, beta2 and the relaxation time of the friction law.
STEP, BETA2, TAU = 2e-8, 0.8, 1e-7
# The scheme's own addition to d2, s.
ADDED_DAMPING = (BETA2 - 0.5) * STEP
# Length of a segment, s.
SEGMENT = 0.02


def largest_step(stiffness: Array, damping: Array, beta2: float) -> float:
    """Largest stable step of the scheme, s, that of the fastest mode.

    With z = omega dt it solves (beta2 / 2) z^2 - 2 zeta (beta2 - 1/2) z = 1 (Hughes, The Finite Element Method,
    section 9.1, for beta = 0).
    """
    fastest = int(np.argmax(stiffness))
    omega = float(np.sqrt(stiffness[fastest]))
    damped = (beta2 - 0.5) * float(damping[fastest]) / (2.0 * omega)
    return (damped + float(np.sqrt(0.5 * beta2 + damped**2))) / (0.5 * beta2 * omega)


class PaperRun:
    """One run in progress."""

    def __init__(self, scene: Normalised, options: Options) -> None:
        self.scene, self.options = scene, options
        self.model = model = full_model(scene.rig, scene.theta)
        self.step = dt = STEP if options.step is None else options.step
        self._b = b = BETA2 if options.beta2 is None else options.beta2
        limit = largest_step(model.stiffness, model.damping, b)
        if dt > limit:
            raise ValueError(
                f"step = {dt:g}: with this rig the published scheme needs at most {at_most(limit)} s; else"
                " its fastest mode grows"
            )
        W, r = contact_closing(model, dt, b), dt / TAU
        critical = ratio(W[0] * (1.0 + r) / r, W[1])
        if scene.mu >= critical:
            raise not_unique(scene.mu, critical)
        self.steps = max(round(options.duration / dt), 1)
        direction, rate = options.contact_motion, options.sampling_rate
        self._motion = ContactMotion(scene, options.ramp, direction) if direction else None
        self._slide = (np.zeros(0), np.zeros(0))
        self._inverse = 1.0 / (1.0 + b * dt * model.damping)
        # Number of steps of the ramp; none ends at step -1.
        self._ramp_ends = round(options.ramp / dt) if options.ramp > 0.0 else -1
        sample_every = max(round(INTERVAL / dt), 1)
        self.rate = 1.0 / (sample_every * dt)
        self.segments: list[Segment] = []
        self.record = record = begin(np.zeros(1, SCENE), options.settle, SETTLING, options.min_stick)
        record["dt"], record["b"], record["r"], record["mu"] = dt, b, r, scene.mu
        record["speed"], record["ramp"] = scene.speed_per_load, options.ramp
        record["W_NN"], record["W_NT"], record["W_TT"] = W
        record["sample_every"] = sample_every
        record["row_every"] = 0 if rate is None else max(round(1.0 / (rate * dt)), 1)
        record["settle"] = int(np.ceil(record["settled_from"][0] / dt - 1.0))
        self._start(options.initial)

    def _start(self, initial: State | None) -> None:
        model, dt, ramp, record = self.model, self.step, self.options.ramp, self.record
        speed = self.scene.speed_per_load
        # The unit load alone: at rest stiffness times displacement is load plus normal force.
        self._load = model.stiffness * model.rest - model.normal
        q, T = model.rest.copy(), 0.0
        v, a = np.zeros((2, len(q)))
        record["contact"] = STICK if initial is None else initial.contact
        if initial is not None:
            q, v = initial.displacement.copy(), initial.velocity.copy()
            a = self._load - model.stiffness * q - model.damping * v
            if initial.contact != SEPARATION:
                # The gap does not accelerate, and what slips has its friction already.
                slip_rate = model.tangential @ v - (speed if ramp == 0.0 else 0.0)
                m = -self.scene.mu * float(np.sign(slip_rate)) if initial.contact == SLIP else 0.0
                push = model.normal + m * model.tangential
                N = -float(model.normal @ a) / float(model.normal @ push)
                a, T = a + push * N, m * N
        if ramp == 0.0:
            v = v + model.inertia * speed
        record["last_gT"], record["last_T"] = model.tangential @ q, T
        self._first_energy = self._energy_of(q, v)
        # Modal force of P2's inertia within the ramp.
        self._push = model.inertia * speed / ramp if ramp > 0.0 else np.zeros(len(q))
        self._f = self._load + self._push
        self._q, self._vs = q, v + dt * (1.0 - self._b) * a
        self._predict()
        if self._ramp_ends == 0:
            self._end_ramp(0)

    def _predict(self) -> None:
        """Set a* and the free gaps of the step that comes from q, v* and f."""
        dt, model, q, vs = self.step, self.model, self._q, self._vs
        self._a = a = (self._f - model.stiffness * q - model.damping * vs) * self._inverse
        free = q + dt * (vs + self._b * dt * a) + 0.5 * dt**2 * a
        self.record["gap_N"], self.record["gap_T"] = model.normal @ free, model.tangential @ free

    @property
    def done(self) -> bool:
        """Whether the run has come to its end."""
        return bool(self.record["now"][0] >= self.steps)

    @property
    def time(self) -> float:
        """Time up to which the run has come, s."""
        return float(self.record["now"][0]) * self.step

    @staticmethod
    def advance(runs: Sequence[PaperRun]) -> None:
        """Take every run to the end of its next segment and leave its samples, rows and sticks in `segments`."""
        for run in runs:
            run._advance()

    def _advance(self) -> None:
        record, motion, dt = self.record, self._motion, self.step
        now = int(record["now"][0])
        length = round(SEGMENT / dt) if motion is None else int(STRETCH / (abs(motion.speed) * dt))
        last = min(now + max(length, 1), self.steps)
        if now < self._ramp_ends:
            last = min(last, self._ramp_ends)
        if motion is not None:
            self._follow(motion, now, last)
        model, every = self.model, int(record["sample_every"][0])
        samples = np.empty((count_in(now, last, every), 3))
        rows = np.empty((count_in(now, last, int(record["row_every"][0])), 6))
        room = room_for_sticks(now * dt, last * dt, float(record["least_stick"][0]), dt)
        sticks = np.empty((room, 2))
        record["samples"] = record["rows"] = record["sticks"] = 0
        record["stick_room"] = room
        # The kernel moves the gap shapes along with the contact point.
        shapes = (model.normal.copy(), model.tangential.copy())
        modes = (model.stiffness, model.damping, self._inverse, *shapes, model.point_b)
        before, free = self._q.copy(), np.empty_like(self._q)
        state = (self._q, self._vs, self._a)
        advance(record, last, modes, self._f, self._slide, *state, free, samples, rows, sticks)
        # The accelerating clamp works on the inertia of P2; its work on the contact is counted in the kernel.
        record["work"] += np.sum((self._f - self._load) * (self._q - before))
        first = -(-now // every)
        t = np.asarray((np.arange(first, first + len(samples)) * every + 1.0) * dt)
        self.segments = [Segment(t, samples, sticks[: int(record["sticks"][0])].copy(), rows)]
        if last == self._ramp_ends:
            self._end_ramp(last)

    def _end_ramp(self, step: int) -> None:
        """Stop the acceleration of the clamp and predict step `step` anew."""
        # The rounded number of steps leaves a rest of the ramp, which acts as an impulse.
        push = self._push * (self.options.ramp - step * self.step)
        self.record["work"] += np.sum(push * (self._vs + 0.5 * push))
        self._vs += push
        self._f = self._load
        if self._motion is not None:
            self.model = moved_model(self.model, self.scene, self._motion.position((step + 1) * self.step))
        self._predict()

    def _follow(self, motion: ContactMotion, first: int, last: int) -> None:
        """Take the contact point along with P2 through steps `first` to `last`."""
        model, after = (
            moved_model(self.model, self.scene, motion.position((i + 1) * self.step)) for i in (first, last)
        )
        steps = last - first
        self._slide = ((after.normal - model.normal) / steps, (after.tangential - model.tangential) / steps)
        self.model = model
        W = contact_closing(model, self.step, self._b)
        self.record["W_NN"], self.record["W_NT"], self.record["W_TT"] = W

    def stored_energy(self) -> float:
        """Energy of the modes and the load, normalised; v* stands for the velocity."""
        return self._energy_of(self._q, self._vs)

    def _energy_of(self, q: Array, v: Array) -> float:
        return float(0.5 * np.sum(v**2 + self.model.stiffness * q**2) - self._load @ q)

    def released_energy(self) -> float:
        """Decrease of the stored energy since the start, normalised."""
        return self._first_energy - self.stored_energy()

    def calm(self, floor: float) -> bool:
        """Set numbers below `floor` to zero; False where one is not finite."""
        for part in (self._q, self._vs, self._a):
            part[np.abs(part) < floor] = 0.0
        return bool(np.isfinite(self._q).all() and np.isfinite(self._vs).all())


def contact_closing(model: ReducedModel, step: float, beta2: float) -> tuple[float, float, float]:
    """Gaps that unit forces close within one step, m/N: NN, NT, TT."""
    inverse = 1.0 / (1.0 + beta2 * step * model.damping)
    scale = step**2 * (beta2 + 0.5)
    n, t = model.normal, model.tangential
    return scale * float(n @ (n * inverse)), scale * float(n @ (t * inverse)), scale * float(t @ (t * inverse))
