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

from collections.abc import Iterator

import numpy as np

from fivcore.contact.reduced import ReducedModel, full_model
from fivcore.contact.step_map import at_most
from fivcore.errors import not_unique
from fivcore.jit import Array
from fivcore.transient import spectra as listener
from fivcore.transient.chunks import Chunk, rows_in
from fivcore.transient.drive import Canonical, State
from fivcore.transient.moving_contact import STRETCH, ContactMotion, moved_model
from fivcore.transient.published_kernel import advance
from fivcore.transient.statistics import (
    SEPARATION,
    SLIP,
    STATE,
    STICK,
    WORK,
    Tally,
)

# Section 3.3 of the paper: time step, beta2 and the relaxation time of the friction law.
STEP, BETA2, TAU = 2e-8, 0.8, 1e-7
# What the scheme adds to d2 of itself, s.
ADDED_DAMPING = (BETA2 - 0.5) * STEP

CHUNK = 0.02


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

    def __init__(
        self,
        scene: Canonical,
        *,
        ramp: float,
        step: float | None,
        initial: State | None,
        tally: Tally,
        sample_rate: float | None,
        motion: ContactMotion | None = None,
        beta2: float = BETA2,
        tau: float = TAU,
    ) -> None:
        self.scene, self.ramp, self.tally = scene, ramp, tally
        self.model = model = full_model(scene.rig, scene.theta)
        self.step = STEP if step is None else step
        limit = largest_step(model.stiffness, model.damping, beta2)
        if self.step > limit:
            raise ValueError(
                f"step = {self.step:g}: with this rig the published scheme needs at most {at_most(limit)} s; else"
                " its fastest mode grows"
            )
        self._motion, self._slide = motion, (np.zeros(0), np.zeros(0))
        self._b, self._r = beta2, self.step / tau
        self._inverse = 1.0 / (1.0 + beta2 * self.step * model.damping)
        self._W = contact_closing(model, self.step, beta2)
        if slip_divisors(self._W, scene.mu, self._r).min() <= 0.0:
            critical = self._W[0] * (1.0 + self._r) / (self._r * abs(self._W[1]))
            raise not_unique(scene.mu, critical)
        self._hearing = max(round(listener.INTERVAL / self.step), 1)
        self._recording = 0 if sample_rate is None else max(round(1.0 / (sample_rate * self.step)), 1)
        self.rate = 1.0 / (self._hearing * self.step)
        self._begin(initial)

    def _begin(self, initial: State | None) -> None:
        model, dt, b = self.model, self.step, self._b
        rest = model.rest
        # The unit load alone: at rest stiffness times displacement is load plus normal force.
        self._load = np.where(model.stiffness > 0.0, model.stiffness * rest - model.normal, -model.normal)
        ramping = model.inertia * self.scene.pace / self.ramp if self.ramp > 0.0 else np.zeros(len(rest))
        T = 0.0
        if initial is None:
            self.tally.flags[STATE] = STICK
            q, v, a = rest.copy(), np.zeros(len(rest)), np.zeros(len(rest))
        else:
            self.tally.flags[STATE] = initial.contact
            q, v = initial.displacement.copy(), initial.velocity.copy()
            a = self._load - model.stiffness * q - model.damping * v
            if initial.contact != SEPARATION:
                # The gap does not accelerate, and what slips has its friction already.
                pace = self.scene.pace if self.ramp == 0.0 else 0.0
                slips = initial.contact == SLIP
                m = -self.scene.mu * float(np.sign(model.tangential @ v - pace)) if slips else 0.0
                push = model.normal + m * model.tangential
                N = -float(model.normal @ a) / float(model.normal @ push)
                a, T = a + push * N, m * N
        if self.ramp == 0.0:
            v = v + model.inertia * self.scene.pace
        self._contact = np.array([model.tangential @ q, T])
        self._first_energy = self._energy_of(q, v)
        self._f = self._load + ramping
        self._vs = v + dt * (1.0 - b) * a
        self._a = (self._f - model.stiffness * q - model.damping * self._vs) * self._inverse
        self._q, self._reach = q, np.empty(len(q))
        self._set_gaps()

    def _set_gaps(self) -> None:
        dt = self.step
        reach = self._q + dt * (self._vs + self._b * dt * self._a) + 0.5 * dt**2 * self._a
        self._gaps = np.array([self.model.normal @ reach, self.model.tangential @ reach])

    def chunks(self, last: int) -> Iterator[Chunk | Array]:
        """Run to step `last`, handing over what was recorded and heard."""
        per_chunk = max(round(CHUNK / self.step), 1)
        if self._motion is not None:
            per_chunk = max(int(STRETCH / (abs(self._motion.speed) * self.step)), 1)
        ramp_ends = round(self.ramp / self.step)
        hearing, recording = self._hearing, self._recording
        modes = self._modes()
        i = 0
        if ramp_ends == 0:
            self._end_ramp(0)
        while i < last:
            target = min(i + per_chunk, last)
            if i < ramp_ends:
                target = min(target, ramp_ends)
            if self._motion is not None:
                self._follow(self._motion, i, target)
                modes = self._modes()
            heard = np.empty(((target - i) // hearing + 1, 2))
            rows = np.empty((rows_in(i, target, recording), 6))
            sticks = self.tally.room(i * self.step, target * self.step, self.step)
            before = self._q.copy() if i < ramp_ends else self._q
            advance(
                modes, self._f, self._W, self.scene.mu, (self.step, self._b, self._r),
                (self.scene.pace, self.ramp), self._slide, i, target, self._q, self._vs, self._a, self._reach,
                self._contact, self._gaps, self.tally.arrays, sticks, heard, hearing, rows, recording,
            )  # fmt: skip
            if i < ramp_ends:
                # The accelerating clamp works on the inertia of P2; on the contact it does in the kernel.
                self.tally.sums[WORK] += np.sum((self._f - self._load) * (self._q - before))
            yield rows
            yield Chunk.cut(i, target, self.step, 1.0, heard, hearing, self.tally.taken(sticks))
            i = target
            if i == ramp_ends:
                self._end_ramp(i)

    def _end_ramp(self, step: int) -> None:
        """The clamp stops accelerating: what was predicted for step `step` is predicted anew."""
        if self.ramp == 0.0:
            return
        model = self.model
        # What the ramp lasts beyond a whole number of steps.
        push = model.inertia * self.scene.pace / self.ramp * (self.ramp - step * self.step)
        self.tally.sums[WORK] += np.sum(push * (self._vs + 0.5 * push))
        self._vs += push
        self._a = (self._load - model.stiffness * self._q - model.damping * self._vs) * self._inverse
        self._f = self._load
        if self._motion is not None:
            self.model = moved_model(model, self.scene, self._motion.position((step + 1) * self.step))
        self._set_gaps()

    def _modes(self) -> tuple[Array, ...]:
        """What `advance` takes; it moves the gap shapes along with the contact point."""
        model = self.model
        shapes = (model.normal.copy(), model.tangential.copy())
        return model.stiffness, model.damping, self._inverse, *shapes, model.point_b

    def _follow(self, motion: ContactMotion, first: int, last: int) -> None:
        """Take the contact point along with P2 through steps `first` to `last`."""
        begin, end = (motion.position((i + 1) * self.step) for i in (first, last))
        model, after = (moved_model(self.model, self.scene, place) for place in (begin, end))
        steps = last - first
        self._slide = ((after.normal - model.normal) / steps, (after.tangential - model.tangential) / steps)
        self.model = model
        self._W = contact_closing(model, self.step, self._b)

    def stored_energy(self) -> float:
        """Of the modes and the load, canonical; v* stands for the velocity."""
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
