"""`method="paper"`: the published scheme on every mode of both beams (sections 3.2 and 3.3 of the paper).

Equations (15) and (16) are printed for beta2 = 0.5 and without damping, (14) and (18) with slips; read with
b = beta2, r = dt / tau and per mode

    v* = v + dt (1 - b) a,   a* = (f - k q - c v*) / (1 + b dt c),   q_free = q + dt (v* + b dt a*) + dt^2 a* / 2.

If the free gap is open, N = T = 0. Otherwise stick is tried: g_N = 0 and g_T as it was; accepted if N > 0 and
|T| < mu N. Otherwise slip, s the sign of the stick trial's T: T = (T_last + r s mu N) / (1 + r), the simplified
Prakash-Clifton law, with g_N = 0 and N >= 0. Then a = a* + force / (1 + b dt c), v = v* + b dt a,
q = q + dt v + dt^2 a / 2. This is Newmark's method with beta = 0 and gamma = b: for b > 1/2 it is first order and
damps like (b - 1/2) dt of stiffness-proportional damping.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fivcore.contact.reduced import ReducedModel, full_model
from fivcore.contact.step_map import at_most
from fivcore.errors import not_unique
from fivcore.jit import Array
from fivcore.transient.moving_contact import STRETCH, ContactMotion, moved_model
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.options import Options
from fivcore.transient.published_kernel import SCENE, advance
from fivcore.transient.segment import INTERVAL, Segment, count_in, room_for_sticks
from fivcore.transient.statistics import SEPARATION, SETTLING, SLIP, STICK, begin

# Section 3.3 of the paper: time step, beta2 and the relaxation time of the friction law.
STEP, BETA2, TAU = 2e-8, 0.8, 1e-7
# What the scheme adds to d2 of itself, s.
ADDED_DAMPING = (BETA2 - 0.5) * STEP

# Length of a segment, s.
SEGMENT = 0.02


def largest_step(stiffness: Array, damping: Array, b: float) -> float:
    """Find the largest stable step of the scheme, s: a bisection on the spectral radius of the fastest mode."""
    fastest = int(np.argmax(stiffness))
    k, c = float(stiffness[fastest]), float(damping[fastest])
    low, high = 0.0, 20.0 / np.sqrt(k)
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _radius(k, c, middle, b) <= 1.0 + 1e-12:
            low = middle
        else:
            high = middle
    return low


def _radius(k: float, c: float, dt: float, b: float) -> float:
    """Spectral radius of one free step on (q, v, a) of a mode."""
    star = np.array([0.0, 1.0, dt * (1.0 - b)])
    a = (-k * np.array([1.0, 0.0, 0.0]) - c * star) / (1.0 + b * dt * c)
    v = star + b * dt * a
    q = np.array([1.0, 0.0, 0.0]) + dt * v + 0.5 * dt**2 * a
    return float(np.abs(np.linalg.eigvals(np.stack([q, v, a]))).max())


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
        self.steps = max(round(options.duration / dt), 1)
        self._motion = (
            ContactMotion(scene, options.ramp, options.contact_motion) if options.contact_motion != 0 else None
        )
        self._slide = (np.zeros(0), np.zeros(0))
        self._inverse = 1.0 / (1.0 + b * dt * model.damping)
        W, r = contact_closing(model, dt, b), dt / TAU
        if slip_divisors(W, scene.mu, r).min() <= 0.0:
            raise not_unique(scene.mu, W[0] * (1.0 + r) / (r * abs(W[1])))
        sample_every = max(round(INTERVAL / dt), 1)
        rate = options.sampling_rate
        self.rate = 1.0 / (sample_every * dt)
        self._ramp_ends = round(options.ramp / dt)
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
        model, dt, b, ramp = self.model, self.step, self._b, self.options.ramp
        rest, record = model.rest, self.record
        # The unit load alone: at rest stiffness times displacement is load plus normal force.
        self._load = np.where(model.stiffness > 0.0, model.stiffness * rest - model.normal, -model.normal)
        ramping = model.inertia * self.scene.speed_per_load / ramp if ramp > 0.0 else np.zeros(len(rest))
        T = 0.0
        if initial is None:
            record["contact"] = STICK
            q, v, a = rest.copy(), np.zeros(len(rest)), np.zeros(len(rest))
        else:
            record["contact"] = initial.contact
            q, v = initial.displacement.copy(), initial.velocity.copy()
            a = self._load - model.stiffness * q - model.damping * v
            if initial.contact != SEPARATION:
                # The gap does not accelerate, and what slips has its friction already.
                speed = self.scene.speed_per_load if ramp == 0.0 else 0.0
                slips = initial.contact == SLIP
                m = -self.scene.mu * float(np.sign(model.tangential @ v - speed)) if slips else 0.0
                push = model.normal + m * model.tangential
                N = -float(model.normal @ a) / float(model.normal @ push)
                a, T = a + push * N, m * N
        if ramp == 0.0:
            v = v + model.inertia * self.scene.speed_per_load
        record["last_gT"], record["last_T"] = model.tangential @ q, T
        self._first_energy = self._energy_of(q, v)
        self._f = self._load + ramping
        self._vs = v + dt * (1.0 - b) * a
        self._a = (self._f - model.stiffness * q - model.damping * self._vs) * self._inverse
        self._q, self._reach = q, np.empty(len(q))
        self._set_gaps()
        if self._ramp_ends == 0:
            self._end_ramp(0)

    def _set_gaps(self) -> None:
        dt, model = self.step, self.model
        reach = self._q + dt * (self._vs + self._b * dt * self._a) + 0.5 * dt**2 * self._a
        self.record["gap_N"], self.record["gap_T"] = model.normal @ reach, model.tangential @ reach

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
        """Take every run to the end of its next segment and leave in `segments` what it did there."""
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
        every, rows_every = int(record["sample_every"][0]), int(record["row_every"][0])
        samples = np.empty((count_in(now, last, every), 3))
        rows = np.empty((count_in(now, last, rows_every), 6))
        room = room_for_sticks(now * dt, last * dt, float(record["least_stick"][0]), dt)
        sticks = np.empty((room, 2))
        record["samples"] = record["rows"] = record["sticks"] = 0
        record["stick_room"] = room
        before = self._q.copy() if now < self._ramp_ends else self._q
        model = self.model
        # The kernel moves the gap shapes along with the contact point.
        shapes = (model.normal.copy(), model.tangential.copy())
        modes = (model.stiffness, model.damping, self._inverse, *shapes, model.point_b)
        advance(
            record,
            last,
            modes,
            self._f,
            self._slide,
            self._q,
            self._vs,
            self._a,
            self._reach,
            samples,
            rows,
            sticks,
        )
        if now < self._ramp_ends:
            # The accelerating clamp works on the inertia of P2; on the contact it does in the kernel.
            record["work"] += np.sum((self._f - self._load) * (self._q - before))
        first = -(-now // every)
        t = np.asarray((np.arange(first, first + len(samples)) * every + 1.0) * dt, dtype=np.float64)
        ended = sticks[: int(record["sticks"][0])].copy()
        self.segments = [Segment(t, samples, ended, rows)]
        if last == self._ramp_ends:
            self._end_ramp(last)

    def _end_ramp(self, step: int) -> None:
        """Stop the acceleration of the clamp: what was predicted for step `step` is predicted anew."""
        ramp = self.options.ramp
        if ramp == 0.0:
            return
        model = self.model
        # What the ramp lasts beyond a whole number of steps.
        push = model.inertia * self.scene.speed_per_load / ramp * (ramp - step * self.step)
        self.record["work"] += np.sum(push * (self._vs + 0.5 * push))
        self._vs += push
        self._a = (self._load - model.stiffness * self._q - model.damping * self._vs) * self._inverse
        self._f = self._load
        if self._motion is not None:
            self.model = moved_model(model, self.scene, self._motion.position((step + 1) * self.step))
        self._set_gaps()

    def _follow(self, motion: ContactMotion, first: int, last: int) -> None:
        """Take the contact point along with P2 through steps `first` to `last`."""
        begin, end = (motion.position((i + 1) * self.step) for i in (first, last))
        model, after = (moved_model(self.model, self.scene, place) for place in (begin, end))
        steps = last - first
        self._slide = ((after.normal - model.normal) / steps, (after.tangential - model.tangential) / steps)
        self.model = model
        W = contact_closing(model, self.step, self._b)
        self.record["W_NN"], self.record["W_NT"], self.record["W_TT"] = W

    def stored_energy(self) -> float:
        """Of the modes and the load, normalised; v* stands for the velocity."""
        return self._energy_of(self._q, self._vs)

    def _energy_of(self, q: Array, v: Array) -> float:
        return float(0.5 * np.sum(v**2 + self.model.stiffness * q**2) - self._load @ q)

    def released_energy(self) -> float:
        """What has been taken out of the store since the start."""
        return self._first_energy - self.stored_energy()

    def calm(self, floor: float) -> bool:
        """Set what is far below every scale to zero; False where a number is not finite."""
        for part in (self._q, self._vs, self._a):
            part[np.abs(part) < floor] = 0.0
        return bool(np.isfinite(self._q).all() and np.isfinite(self._vs).all())


def contact_closing(model: ReducedModel, step: float, beta2: float) -> tuple[float, float, float]:
    """How much a unit force moves the gaps within one step, m/N: NN, NT, TT."""
    inverse = 1.0 / (1.0 + beta2 * step * model.damping)
    scale = step**2 * (beta2 + 0.5)
    n, t = model.normal, model.tangential
    return scale * float(n @ (n * inverse)), scale * float(n @ (t * inverse)), scale * float(t @ (t * inverse))


def slip_divisors(W: tuple[float, float, float], mu: float, r: float) -> Array:
    """What the slip step divides by, for T = mu N and T = -mu N, relative to W_NN; above zero where unique."""
    return np.array([1.0 + s * mu * W[1] / W[0] * r / (1.0 + r) for s in (1.0, -1.0)])
