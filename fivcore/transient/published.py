"""`method="paper"`: the published scheme on every mode of both beams (sections 3.2 and 3.3 of the paper).

The paper prints equations (15) and (16) for beta2 = 0.5 without damping, and (14) and (18) with errors. With b =
beta2 and r = dt / tau the scheme reads, per mode,

    v* = v + dt (1 - b) a,   a* = (f - k q - c v*) / (1 + b dt c),   q_free = q + dt (v* + b dt a*) + dt^2 a* / 2.

If the free gap is open, N = T = 0. Otherwise stick is tried, with g_N = 0 and g_T of the last step; it is accepted
if N > 0 and |T| < mu N. Otherwise the contact slips with the simplified Prakash-Clifton law
T = (T_last + r s mu N) / (1 + r), g_N = 0 and N >= 0, where s is the sign of T in the trial. If friction depends
on the slip rate, mu is that at the slip rate of the step (`fivcore.friction.slip_speed`; not in the paper). Then a
= a* + force / (1 + b dt c), v = v* + b dt a and q = q + dt v + dt^2 a / 2.

This is Newmark's method with beta = 0 and gamma = b. For b > 1/2 it is of first order and adds (b - 1/2) dt to d2.
The kernel adds its sums over modes in a fixed order.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fivcore.contact.law import ratio
from fivcore.contact.reduced import ReducedModel, full_model
from fivcore.contact.step_map import at_most
from fivcore.errors import SceneValueError, not_unique
from fivcore.friction import slip_speed
from fivcore.jit import Array, inlined, kernel
from fivcore.rig import ContactModel, Rig
from fivcore.structure import modal_structure
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import FIELDS, SEPARATION, SLIP, STICK, clear, count_step, enter, first_counted
from fivcore.transient.stepped import Run

# Section 3.3 of the paper: time step, beta2 and the relaxation time of the friction law.
PAPER_STEP, BETA2, TAU = 2e-8, 0.8, 1e-7
# The paper's step in units of 1 / omega of the highest mode of both beams.
PERIOD_SHARE = 0.2
# Numerical damping of the scheme, which adds to d2, s.
ADDED_DAMPING = (BETA2 - 0.5) * PAPER_STEP
# Length of a segment, s.
SEGMENT = 0.02
# The modal damping is sampled every so many steps for the energy balance.
SAMPLED = 64

# Step, beta2, dt / tau, friction, drive, gaps closed by unit forces within a step (W); free gaps of the present
# step, g_T and T at the end of the last one; contact state, present step, first step of the statistics, intervals
# and numbers of samples and rows of the record.
_NUMBERS = ("dt", "b", "r", "mu", "speed", "ramp", "W_NN", "W_NT", "W_TT", "gap_N", "gap_T", "last_gT", "last_T")
_WHOLE = ("contact", "now", "settle", "sample_every", "row_every", "samples", "rows")
# Law of friction that depends on the slip rate (`Friction.law`); friction at which a moving contact sticks, which
# is also that of slip if constant; last slip rate; whether friction depends on it.
_FRICTION = [("law", "f8", (3,)), ("kinetic", "f8"), ("slip_rate", "f8"), ("falls", "i8")]
SCENE = np.dtype([
    *FIELDS, *((name, "f8") for name in _NUMBERS), *((name, "i8") for name in _WHOLE), *_FRICTION
])  # fmt: skip


def with_numerical_damping(rig: ContactModel, method: str, numerical_damping: str) -> ContactModel:
    """Return the rig that a method simulates: "fast" and "exact" add the numerical damping to d2."""
    if method == "paper" or numerical_damping == "none":
        return rig
    if isinstance(rig, Rig):
        return replace(rig, d2=rig.d2 + ADDED_DAMPING)
    return modal_structure(rig, 0.0).with_stiffness_damping((BETA2 - 0.5) * paper_step(rig))


def paper_step(rig: ContactModel) -> float:
    """The paper's step, s; for a structure, the same fraction of the period of its highest mode."""
    if isinstance(rig, Rig):
        return PAPER_STEP
    return PERIOD_SHARE / float(2.0 * np.pi * modal_structure(rig, 0.0).motion.frequency[-1])


def relaxation_time(rig: ContactModel, step: float) -> float:
    """Relaxation time of T, s: the paper's; for a structure the same number of steps.

    After an impact with the normal impulse P in one step, T is r / (1 + r)^k mu P / dt in the steps k = 1, 2, ...:
    while the contact lasts and slips, their sum is mu P, the tangential impulse of `fivcore.contact.law`.
    """
    return TAU if isinstance(rig, Rig) else TAU / PAPER_STEP * step


def largest_step(stiffness: Array, damping: Array, beta2: float) -> float:
    """Largest stable step of the scheme, s, which the fastest mode determines.

    With z = omega dt it solves (beta2 / 2) z^2 - 2 zeta (beta2 - 1/2) z = 1 (Hughes, The Finite Element Method,
    section 9.1, for beta = 0).
    """
    fastest = int(np.argmax(stiffness))
    omega = float(np.sqrt(stiffness[fastest]))
    damped = (beta2 - 0.5) * float(damping[fastest]) / (2.0 * omega)
    return (damped + float(np.sqrt(0.5 * beta2 + damped**2))) / (0.5 * beta2 * omega)


class PaperRun(Run):
    """One run in progress."""

    def __init__(self, scene: Normalised, options: RunOptions) -> None:
        rig = scene.rig if isinstance(scene.rig, Rig) else modal_structure(scene.rig, 0.0).truncated()
        self.model = model = full_model(rig, scene.theta)
        dt = paper_step(scene.rig) if options.step is None else options.step
        self._b = b = BETA2 if options.beta2 is None else options.beta2
        limit = largest_step(model.stiffness, model.damping, b)
        if dt > limit:
            raise SceneValueError(
                f"step = {dt:g}: with these modes the published scheme needs at most {at_most(limit)} s; else"
                " its fastest mode grows"
            )
        tau = relaxation_time(scene.rig, dt)
        painleve = painleve_limit(model, dt, b, tau)
        if scene.mu >= painleve:
            raise not_unique(scene.mu, painleve)
        initial, speed = options.initial, scene.speed_per_load
        starts = initial is None or not initial.running
        ramp = options.ramp if starts else 0.0
        super().__init__(scene, options, dt, round(SEGMENT * rig.time_scale / dt), SCENE)
        self._inverse = 1.0 / (1.0 + b * dt * model.damping)
        record = self.record
        record["dt"], record["b"], record["r"], record["mu"] = dt, b, dt / tau, scene.mu
        friction = scene.friction
        record["law"], record["falls"] = friction.law, not friction.constant
        record["kinetic"] = scene.mu * friction.kinetic_ratio if friction.constant else scene.mu
        record["speed"], record["ramp"] = speed, ramp
        record["W_NN"], record["W_NT"], record["W_TT"] = contact_closing(model, dt, b)
        record["settle"] = first_counted(record["settled_from"][0], dt, 1.0)
        # Unit load: at rest, stiffness times displacement equals load plus normal force.
        self._load = model.stiffness * model.static_equilibrium - model.normal
        q, T = model.static_equilibrium.copy(), 0.0
        v, a = np.zeros((2, len(q)))
        if initial is not None:
            q, v = (part[: len(model.normal)].copy() for part in (initial.displacement, initial.velocity))
            a = self._load - model.stiffness * q - model.damping * v
            if initial.contact != SEPARATION:
                # The gap acceleration is zero, and a slipping contact starts with its friction force.
                slip_rate = float(model.tangential @ v) - (speed if ramp == 0.0 else 0.0)
                m = -scene.mu * friction.ratio(slip_rate) * float(np.sign(slip_rate))
                m = m if initial.contact == SLIP else 0.0
                push = model.normal + m * model.tangential
                N = -float(model.normal @ a) / float(model.normal @ push)
                a, T = a + push * N, m * N
        if ramp == 0.0 and starts:
            v = v + model.inertia * speed
        record["last_gT"], record["last_T"] = model.tangential @ q, T
        self._first_energy = self._energy_of(q, v)
        self._q, self._vs = q, v + dt * (1.0 - b) * a
        # During the ramp the inertia of P2 acts. A segment ends with the ramp.
        self._push = model.inertia * speed / ramp if ramp > 0.0 else np.zeros(len(q))
        self._f = self._load + self._push
        self._cut = round(ramp / dt)
        self._predict()
        if ramp > 0.0 and self._cut == 0:
            self._end_ramp(0)

    def _predict(self) -> None:
        """Compute a* and the free gaps of the next step from q, v* and f."""
        dt, model, q, vs = self.step, self.model, self._q, self._vs
        self._a = a = (self._f - model.stiffness * q - model.damping * vs) * self._inverse
        free = q + dt * (vs + self._b * dt * a) + 0.5 * dt**2 * a
        self.record["gap_N"], self.record["gap_T"] = model.normal @ free, model.tangential @ free

    def _take(self, first: int, last: int, samples: Array, rows: Array, sticks: Array) -> None:
        model, before = self.model, self._q.copy()
        modes = (model.stiffness, model.damping, self._inverse, *model.shapes, model.output)
        state = (self._q, self._vs, self._a, np.empty_like(self._q))
        advance(self.record, last, modes, self._f, *state, samples, rows, sticks)
        # The accelerating clamp works on the inertia of P2; its work on the contact is counted in the kernel.
        self.record["work"] += np.sum((self._f - self._load) * (self._q - before))
        if last == self._cut:
            self._end_ramp(last)

    def _end_ramp(self, step: int) -> None:
        """Stop the acceleration of the clamp and predict step `step` anew."""
        # The ramp is not a whole number of steps; its remainder acts as an impulse.
        push = self._push * (float(self.record["ramp"][0]) - step * self.step)
        self.record["work"] += np.sum(push * (self._vs + 0.5 * push))
        self._vs += push
        self._f = self._load
        self._predict()

    def state(self) -> tuple[Array, Array, Array]:
        """Displacements from rest and velocities v* of all modes; no modes are truncated."""
        return self._q - self.model.static_equilibrium, self._vs, np.zeros(2)

    def stored_energy(self) -> float:
        """Energy of the modes and the load, normalised, with v* as velocity."""
        return self._energy_of(self._q, self._vs)

    def _energy_of(self, q: Array, v: Array) -> float:
        return float(0.5 * np.sum(v**2 + self.model.stiffness * q**2) - self._load @ q)

    def flush(self, floor: float) -> bool:
        """Set numbers below `floor` to zero; False where one is not finite."""
        for part in (self._q, self._vs, self._a):
            part[np.abs(part) < floor] = 0.0
        return bool(np.isfinite(self._q).all() and np.isfinite(self._vs).all())


def contact_closing(model: ReducedModel, step: float, beta2: float) -> tuple[float, float, float]:
    """Gap changes within one step for unit forces, m/N: NN, NT, TT."""
    inverse, scale = 1.0 / (1.0 + beta2 * step * model.damping), step**2 * (beta2 + 0.5)
    n, t = model.normal, model.tangential
    return scale * float(n @ (n * inverse)), scale * float(n @ (t * inverse)), scale * float(t @ (t * inverse))


def painleve_limit(model: ReducedModel, step: float, beta2: float, tau: float = TAU) -> float:
    """Painleve limit: smallest mu at which a divisor of slip, W_NN +- mu W_NT r / (1 + r), is zero."""
    (W_NN, W_NT, _), r = contact_closing(model, step, beta2), step / tau
    return ratio(W_NN * (1.0 + r) / r, W_NT)


@inlined
def _gaps(normal: Any, tangential: Any, q: Any) -> Any:
    """Normal and tangential gap, each added four at a time."""
    n0, n1, n2, n3, t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    whole = q.shape[0] // 4 * 4
    for j in range(0, whole, 4):
        n0 += normal[j] * q[j]
        n1 += normal[j + 1] * q[j + 1]
        n2 += normal[j + 2] * q[j + 2]
        n3 += normal[j + 3] * q[j + 3]
        t0 += tangential[j] * q[j]
        t1 += tangential[j + 1] * q[j + 1]
        t2 += tangential[j + 2] * q[j + 2]
        t3 += tangential[j + 3] * q[j + 3]
    for j in range(whole, q.shape[0]):
        n0 += normal[j] * q[j]
        t0 += tangential[j] * q[j]
    return (n0 + n1) + (n2 + n3), (t0 + t1) + (t2 + t3)


@inlined
def published_contact(scene: Any, gN: float, gT: float) -> Any:
    """Contact state, N and T from the free gaps and the gap changes W for unit forces."""
    WNN, WNT, WTT, r, last_T = scene.W_NN, scene.W_NT, scene.W_TT, scene.r, scene.last_T
    if gN > 0.0:
        return SEPARATION, 0.0, 0.0
    back = gT - scene.last_gT
    determinant = WNN * WTT - WNT * WNT
    N = (back * WNT - gN * WTT) / determinant
    T = (gN * WNT - back * WNN) / determinant
    if N > 0.0 and abs(T) < (scene.mu if scene.contact == STICK else scene.kinetic) * N:
        return STICK, N, T
    m = scene.kinetic if T > 0.0 else -scene.kinetic
    if scene.falls != 0:
        # With y = m N: N = (alpha + gamma y) / beta, and the slip rate is -way ahead + mobility y.
        law, way, share = (scene.law[0], scene.law[1], scene.law[2]), 1.0 if T > 0.0 else -1.0, r / (1.0 + r)
        alpha, beta, gamma = -gN - WNT * last_T / (1.0 + r), WNN, -WNT * share
        ahead = -way * (back + WNT * alpha / beta + WTT * last_T / (1.0 + r)) / scene.dt
        mobility = (WNT * gamma / beta + WTT * share) / scene.dt
        _, ratio = slip_speed(-way * scene.slip_rate, ahead, mobility, alpha, beta, way * gamma, scene.mu, law)
        m = way * scene.mu * ratio
    N = (-gN - WNT * last_T / (1.0 + r)) / (WNN + m * WNT * r / (1.0 + r))
    if N <= 0.0:
        return SEPARATION, 0.0, 0.0
    return SLIP, N, (last_T + r * m * N) / (1.0 + r)


@kernel
def advance(
    scenes: Any, last: int, modes: Any, f: Any, q: Any, vs: Any, a: Any, free: Any, samples: Any, rows: Any,
    sticks: Any,
) -> None:  # fmt: skip
    """Take the steps up to `last` of one scene; the record and the state change in place.

    `scenes` (1,) is the record, `modes` holds k, c, 1 / (1 + b dt c), normal and tangential gap shapes and the
    shape at B, `f` the constant modal force; `q`, `vs` and `a` are q, v* and a* of the present step, `free`
    workspace for q_free, each (n,). Rows of `samples` and `rows` are as in `fivcore.transient.statistics.Segment`.
    """
    scene = scenes[0]
    k, c, inverse, normal, tangential, output = modes
    dt, b, V, ramp = scene.dt, scene.b, scene.speed, scene.ramp
    n = q.shape[0]
    while scene.now < last:
        now = scene.now
        t = (now + 1.0) * dt
        X = 0.5 * V * t * t / ramp if t < ramp else V * (t - 0.5 * ramp)
        if now == scene.settle:
            clear(scene)
        gT, was = scene.gap_T - X, scene.contact
        contact, N, T = published_contact(scene, scene.gap_N, gT)
        shifted = gT + scene.W_NT * N + scene.W_TT * T
        slip_rate = (shifted - scene.last_gT) / dt
        scene.last_gT, scene.last_T, scene.contact, scene.slip_rate = shifted, T, contact, slip_rate
        count_step(scene, contact, N, abs(slip_rate), dt)
        if contact != was:
            if enter(scene, was, contact, t):
                sticks[scene.sticks - 1] = (scene.last_stick, t)
            scene.settle = first_counted(scene.settled_from, dt, 1.0)
        scene.work += dt * T * (V * t / ramp if t < ramp else V)
        scene.friction -= dt * T * slip_rate
        sampled = now % scene.sample_every == 0
        written = scene.row_every > 0 and now % scene.row_every == 0
        if sampled or written:
            x = 0.0
            for j in range(n):
                x += output[j] * (vs[j] + b * dt * (a[j] + (normal[j] * N + tangential[j] * T) * inverse[j]))
            if sampled:
                counters = scene.stick_time, scene.separation_time, scene.sum_N, scene.switches
                samples[scene.samples] = (x, slip_rate, N, *counters)
                scene.samples += 1
            if written:
                rows[scene.rows] = (t, x, N, T, slip_rate, float(contact))
                scene.rows += 1
        if now % SAMPLED == 0:
            x = 0.0
            for j in range(n):
                x += c[j] * vs[j] * vs[j]
            scene.damped += SAMPLED * dt * x
        # Correct this step with the force found and predict the next.
        for j in range(n):
            acceleration = a[j] + (normal[j] * N + tangential[j] * T) * inverse[j]
            v = vs[j] + b * dt * acceleration
            x = q[j] + dt * v + 0.5 * dt * dt * acceleration
            star = v + dt * (1.0 - b) * acceleration
            predicted = (f[j] - k[j] * x - c[j] * star) * inverse[j]
            q[j], vs[j], a[j] = x, star, predicted
            free[j] = x + dt * (star + b * dt * predicted) + 0.5 * dt * dt * predicted
        scene.gap_N, scene.gap_T = _gaps(normal, tangential, free)
        scene.now = now + 1
