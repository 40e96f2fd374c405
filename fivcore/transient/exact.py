"""`method="exact"`: the reduced model, integrated from event to event.

In each contact status of `fivcore.contact.law` (separation, stick, slip with T = mu N or T = -mu N) the motion is
smooth. It is integrated by the method of order 8 of Dormand and Prince (`fivcore.transient.exact_kernels`) with a
relative tolerance of 1e-13 up to the first zero of a margin, which is located to rounding. Accuracy does not
depend on `step`, which is only the grid at whose midpoints statistics and series are evaluated. The error is about
1e-11 of the motion until the first slip; flutter then amplifies it to 3e-8 at the first separation. Modal
displacements nearly cancel in a gap, which costs about three digits.

An event within DWELL of the previous one (grazing, or the tip of the friction cone) is not processed: the status
is kept for DWELL, and the next status follows from the state alone. The energy balance remains exact; if the gap
or the cone was violated meanwhile, the new status changes u, and this energy counts as impact loss.

If no mode is truncated, the surfaces are rigid: N and T are the constraint forces that keep the gap closed and, in
stick, the surfaces together. The law is that of `fivcore.contact.law`: an impact leaves no closing speed, and its
tangential impulse lies within the cone; T jumps where slip ends.

If friction jumps to a kinetic coefficient, an impact or a slipping compliant contact ends in stick only if kinetic
friction can hold it, and a sticking contact starts to slip at |T| = mu N with a finite rate. If friction falls
with the speed, the slip rate w at each instant satisfies the contact equation T = s mu(|w|) N with s = -sign w,
which Newton's method solves to rounding. The coefficient of friction of an impact belongs to the mean of the slip
rates before and after it, as in `fast`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import matrix_balance

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.law import DiscreteContact, resistance
from fivcore.contact.reduced import default_cutoff, modified, reduced_model
from fivcore.errors import ContactError, DivergenceError, SceneValueError, not_unique
from fivcore.friction import slip_speed
from fivcore.jit import Array
from fivcore.transient import exact_kernels as kernels
from fivcore.transient.exact_kernels import NOTHING, SLIP_DOWN, SLIP_UP, ZERO
from fivcore.transient.normalised import Normalised, residual_gaps
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import ENERGIES, SAMPLE, SEPARATION, STICK
from fivcore.transient.stepped import Run

# An event this soon after the previous one is not processed, s.
DWELL = 1e-10
# Largest growth exponent of slip within DWELL.
MOST_GROWTH = 10.0
# Default grid of the statistics, length of a segment, and shortest ramp, s.
READING_STEP, SEGMENT, SHORT = 1e-6, 0.04, 1e-7
# A gap rate of a rigid contact below this, relative to the modal rates, is zero.
AT_REST = 1e-9


class ExactRun(Run):
    """One run in progress; `held` counts the events within DWELL of the previous one.

    Raises `SceneValueError` for a contact with a spring but no dashpot and for a rigid contact with parallel
    normal and tangential rows, `ContactError` if the force is not unique or slip grows too fast to be resolved.
    """

    READ_AT = 0.5
    # Present status, its start, and the time before which events are not processed, s.
    which, _origin, _deaf = STICK, 0.0, 0.0

    def __init__(self, scene: Normalised, options: RunOptions) -> None:
        model = modified(reduced_model(scene.rig, scene.theta, options.cutoff), options.modify)
        self.model, self.rigid = model, not model.K.any()
        if not (self.rigid or model.C.any()):
            cutoff = default_cutoff(scene.rig) if options.cutoff is None else options.cutoff
            raise SceneValueError(
                f"cutoff = {cutoff:g}: the contact has no dashpot, which method 'exact' needs; use a cutoff that"
                " leaves out more modes, or method 'fast'"
            )
        # Rigid contact: change of (N, T) with the gap accelerations.
        self._resistance = resistance(model.W) if self.rigid else np.zeros((2, 2))
        # Ratio of the coefficient in slip, in the limit of zero speed, to the static one.
        ratio = scene.friction.kinetic_ratio if scene.friction.decay_speed == 0.0 else 1.0
        limit = model.painleve_mu(None) / ratio if ratio > 0.0 else np.inf
        if scene.mu >= limit:
            raise not_unique(scene.mu, limit)
        unit = scene.rig.time_scale
        step = READING_STEP * unit if options.step is None else options.step
        super().__init__(scene, options, step, round(SEGMENT * unit / step), kernels.SCENE)
        self._dwell = dwell = DWELL * unit
        self.slipping, self._law, self.held = ratio * scene.mu, (scene.mu, *scene.friction.law), 0
        modes = (model.stiffness, model.damping, model.shapes, model.inertia, model.output)
        inverse = model.W if self.rigid else np.linalg.inv(model.C)
        self.system = (*modes, model.K, model.C, inverse, self._law)
        n = len(model.stiffness)
        constant = (*self.system[:-1], (self.slipping, 1.0, 0.0, 0.0))
        if any(grows(constant, 2 * n + 2, which, MOST_GROWTH / dwell) for which in (SLIP_UP, SLIP_DOWN)):
            raise ContactError(
                f"{not_unique(scene.mu, limit)}, and so close to it slip grows by more"
                f" than e^{MOST_GROWTH:g} within {dwell:g} s, which is not resolved"
            )
        # z, time, next step and index of the next reading.
        self.motion = np.concatenate([np.zeros(2 * n + 6), [0.0, step, 0.0]])
        # The full state is (q, v, u_N, u_T), q as deviations from `ReducedModel.static_equilibrium`.
        initial, y = options.initial, np.zeros(2 * n + 2)
        self._gaps_at_rest = np.zeros(2) if self.rigid else np.linalg.solve(model.K, [1.0, 0.0])
        if initial is not None:
            y[:n] = initial.displacement[model.kept] - model.static_equilibrium
            y[n : 2 * n] = initial.velocity[model.kept]
            if not self.rigid:
                y[2 * n :] = residual_gaps(scene, model.kept, initial) - self._gaps_at_rest
        # During a ramp of 10 ns the motion would be lost in the rounding of the large acceleration.
        starts = initial is None or not initial.running
        self._ramp = options.ramp if starts and options.ramp >= SHORT * unit else 0.0
        if starts and self._ramp == 0.0:
            y[n : 2 * n] += model.inertia * scene.speed_per_load
        self._first_energy = self._energy_of(y)
        # Rigid surfaces may start with any gap rates, which an impact corrects. Sticking surfaces in states of
        # `fast` also have gap rates, but no impact follows.
        touchdown = self.rigid and options.contact != SEPARATION and (starts or options.contact != STICK)
        self._decide(0.0, y, options.contact, touchdown=touchdown)

    def state(self) -> tuple[Array, Array, Array]:
        """Displacements from rest and velocities of the modes, and the gaps of the others."""
        n = len(self.model.stiffness)
        q, v, u = np.split(self.motion[: 2 * n + 2].copy(), [n, 2 * n])
        return q, v, u + self._gaps_at_rest

    def _take(self, first: int, last: int, samples: Array, rows: Array, sticks: Array) -> None:
        # Segments end at a sampling time, so that the motion does not depend on them.
        self._go((last if last in (self.pause, self.steps) else last - 0.5) * self.step, samples, rows, sticks)

    def _go(self, goal: float, samples: Array, rows: Array, sticks: Array) -> None:
        """Follow the motion up to the time `goal`."""
        while (t := float(self.motion[-3])) < goal:
            boundary, acceleration = self._drive(t)
            before = self.motion[-7:-3].copy()
            drive = np.array([0.0, 0.0 if acceleration else self._clamp_velocity(t), acceleration])
            deaf = self._deaf > t
            end = min(goal, boundary, self._deaf if deaf else goal)
            event = kernels.follow(
                self.motion, self.which, self._origin, end, not deaf, self.system, drive, self.zeros,
                self.step, self.record, samples, rows, sticks,
            )  # fmt: skip
            t, y = float(self.motion[-3]), self.motion[:-7].copy()
            for name, gained in zip(ENERGIES, self.motion[-7:-3] - before, strict=False):
                self.record[name] += gained
            if event > NOTHING and t - self._origin < self._dwell:
                self._deaf = self._origin + self._dwell
                self.held += 1
            elif event > NOTHING:
                self.next_status(t, event, y)
            elif event == kernels.NO_STEP and (self.which < SLIP_UP or self.scene.friction.constant):
                raise DivergenceError(f"the motion has blown up at t = {t:.6g} s")
            elif event < NOTHING:
                self.check(float(self.motion[-2]), 0.0)
            elif t == self._deaf or (self.rigid and t == self._ramp):
                self._decide(t, y, self.which)

    def enter(self, t: float, which: int, y: Array) -> None:
        """Begin a contact status at time `t` in the full state `y`."""
        model, (q, v, u) = self.model, np.split(y, [len(self.model.stiffness), 2 * len(self.model.stiffness)])
        if not np.isfinite(y).all():
            raise DivergenceError(f"the motion has blown up at t = {t:.6g} s")
        if which == STICK and not self.rigid:
            (N, _), C, law = self._forces(t, y, STICK), model.C, self.scene.friction
            self.check(N, C[1, 1] - self.scene.mu * (abs(C[0, 1]) - law.slope(0.0) * N))
        omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, model.stiffness.max()))
        # Square root of the energy; at rest, that of the fastest mode under a unit force.
        energy = np.sum(v**2 + model.stiffness * q**2) + u @ model.K @ u
        size = np.sqrt(energy + model.W[0, 0] / model.stiffness.max())
        speed = abs(self._clamp_velocity(t)) + size * np.sqrt(model.W[1, 1])
        gap = np.abs(model.normal * q).sum() + abs(u[0]) + 1e-300
        springs = np.ones(2) if self.rigid else np.diag(model.K) ** -0.5
        margins = np.array([10.0, 10.0 * speed, 0.1 * gap])
        self.zeros = ZERO * np.concatenate([margins, size / omega, size + 0.0 * v, size * springs, 4 * [size**2]])
        self.which, self._origin, self._deaf = which, t, 0.0
        self.motion[:-7], self.motion[-3] = y, t

    def next_status(self, t: float, event: int, y: Array) -> None:
        """Enter the status that follows after an event; event 0 of a closed contact is N = 0."""
        which = self.which
        if which == SEPARATION:
            self._decide(t, y, which, touchdown=True)
        elif event == 0:
            self.enter(t, SEPARATION, y)
        elif self.slipping < self.scene.mu and not (self.rigid and which >= SLIP_UP):
            # T jumps as slip begins, and is well within the cone where it ends.
            self._decide(t, y, SLIP_UP if which == STICK else STICK, even=True)
        elif which == STICK:
            self.enter(t, SLIP_UP if event == 1 else SLIP_DOWN, y)
        elif self.rigid:
            self._decide(t, y, which, even=True)
        else:
            self.enter(t, STICK, y)

    def _decide(self, t: float, y: Array, was: int, touchdown: bool = False, even: bool = False) -> None:
        """Enter the status that follows from the state alone (`fivcore.contact.law`).

        At `touchdown` the gap closes; if `even`, the slip rate is zero to rounding.
        """
        g_N, energy = self.model.normal @ y[: len(self.model.stiffness)], self._energy_of(y)
        if was == SEPARATION and g_N + y[-2] > 0.0 and not touchdown:
            self.enter(t, SEPARATION, y)
            return
        slip_rate = 0.0
        if self.rigid:
            opens, slip_rate = self._close(t, y, SEPARATION if touchdown else was, even)
            self.record["impact"] += energy - self._energy_of(y)
            if opens:
                self.enter(t, SEPARATION, y)
                return
        N, T = self._forces(t, y, STICK)
        up = slip_rate < 0.0 if slip_rate else T > 0.0
        # Rigid surfaces without slip rate stick; a compliant contact sticks only if kinetic friction can hold it.
        most = self.scene.mu if was == STICK or self.rigid else self.slipping
        sticks = slip_rate == 0.0 and N > 0.0 and abs(T) <= most * N
        which = STICK if sticks else SLIP_UP if up else SLIP_DOWN
        if not sticks and self._forces(t, y, which)[0] <= 0.0:
            self.enter(t, SEPARATION, y)
            return
        if not self.rigid:
            # At the start of contact u_N does not yet match the gap.
            y[-2] = -g_N
            self.record["impact"] += energy - self._energy_of(y)
        self.enter(t, which, y)

    def _close(self, t: float, y: Array, was: int, even: bool) -> tuple[bool, float]:
        """Close the gap of rigid surfaces in the state `y`; return whether they part, and the slip rate."""
        (q, v), model, P = np.split(y[:-2], 2), self.model, self._clamp_velocity(t)
        parts, W = model.shapes * v, model.W
        rates, zero = parts.sum(axis=1) - [0.0, P], AT_REST * np.add(np.abs(parts).sum(axis=1), [0.0, P])
        q -= model.normal * (model.normal @ q / W[0, 0])
        impulse = -self._resistance @ rates if was == STICK else np.array([-rates[0] / W[0, 0], 0.0])
        if was == SEPARATION:
            if rates[0] > zero[0]:
                return True, 0.0
            N, T = -self._resistance @ rates
            m = self.impact_mu(rates, T > 0.0)
            even = abs(T) <= m * N
            N = N if even else slipping_force(N, T, m if T > 0.0 else -m, self._resistance)
            impulse = np.array([N, T if even else np.copysign(m * N, T)])
        v += impulse @ model.shapes
        slip_rate = float(rates[1] + W[1] @ impulse)
        # Beyond its zero if an event was not processed.
        past = was >= SLIP_UP and (slip_rate > 0.0) == (was == SLIP_UP)
        return False, 0.0 if even or past or was == STICK or abs(slip_rate) <= zero[1] else slip_rate

    def _forces(self, t: float, y: Array, which: int) -> tuple[float, float]:
        """N and T of a closed contact in a status and the full state `y`."""
        z, drive = np.pad(y, (0, 4)), np.array([0.0, self._clamp_velocity(t), self._drive(t)[1]])
        z[-6] = -(self.model.normal @ y[: len(self.model.normal)])
        N, T, *_ = kernels.rates_of(z, which, self.system, drive, np.empty_like(z))
        return N, T

    def check(self, N: float, slack: float) -> None:
        """Raise an error if the slip rate is not unique, because T - s mu N does not increase with u_T'."""
        if not slack > 0.0:
            scene, C, law = self.scene, self.model.C, self.scene.friction
            least = scene.mu * (1.0 - law.kinetic_ratio) * N / (C[1, 1] - scene.mu * abs(C[0, 1]))
            raise ContactError(
                f"friction: decay_speed = {law.decay_speed * scene.load:g} m/s: the slip rate is not unique where"
                f" N = {N * scene.load:.3g} N; it must be above {least * scene.load:.3g} m/s, or 0 for a jump"
            )

    def impact_mu(self, rates: Array, up: bool) -> float:
        """Coefficient of friction in an impact with T > 0 (`up`) or T < 0, from the gaps' rates before it."""
        if self.scene.friction.constant:
            # As at the end of slip, kinetic friction must be able to hold a sticking contact.
            return self.slipping
        sense, law = 1.0 if up else -1.0, DiscreteContact(np.zeros((2, 2)), 0.0, 0.5 * self.model.W, 1.0).slip
        alpha, (mu, *fall) = -0.5 * rates[0], self._law
        ahead = -sense * (rates[1] + law.rate_N / law.beta * alpha)
        _, ratio = slip_speed(ahead, ahead, law.mobility, alpha, law.beta, sense * law.gamma, mu, tuple(fall))
        return float(mu * ratio)

    def _drive(self, t: float) -> tuple[float, float]:
        """End of the ramp or of the run, whichever comes first, and the acceleration of P2's clamp until then."""
        end = self.steps * self.step
        return (min(self._ramp, end), self.scene.speed_per_load / self._ramp) if t < self._ramp else (end, 0.0)

    def _clamp_velocity(self, t: float) -> float:
        return self.scene.speed_per_load * (t / self._ramp if t < self._ramp else 1.0)

    def _energy_of(self, y: Array) -> float:
        model, n = self.model, len(self.model.stiffness)
        q, v, u = y[:n], y[n : 2 * n], y[2 * n :]
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + model.normal @ q + u[0] + 0.5 * u @ model.K @ u)

    def stored_energy(self) -> float:
        """Energy of the modes about the equilibrium, the springs and the load, normalised."""
        return self._energy_of(self.motion[:-7])

    def flush(self, floor: float) -> bool:
        """Set what is below `floor` to zero; False where the state is not finite."""
        y = self.motion[:-7]
        y[np.abs(y) < floor] = 0.0
        return bool(np.isfinite(y).all())


@one_blas_thread()
def grows(system: Any, size: int, which: int, rate: float) -> bool:
    """Whether small motions of a status, with linearised friction, grow faster than a rate, 1/s."""
    law = kernels.affine_law(np.ones(size), which, system, np.zeros(3))
    matrix: Array = matrix_balance(law[kernels.RATES :, :-1], permute=False)[0]
    # A norm bounds all eigenvalues.
    return bool(np.abs(matrix).sum(axis=1).max() > rate and np.linalg.eigvals(matrix).real.max() > rate)


def slipping_force(N: float, T: float, m: float, resistance: Array) -> float:
    """N in slip, from (N, T) in stick: slip changes them by `resistance` (2, 2) times its rate, until T = m N."""
    return float(N - resistance[0, 1] * ((T - m * N) / (resistance[1, 1] - m * resistance[0, 1])))


def states_at(scene: Normalised, times: Array, *, step: float | None = None, **given: Any) -> Array:
    """Exact motion at ascending `times` (m,), s, with further options of a run.

    Returns modal displacements and velocities (P2 relative to its clamp) and (u_N, u_T), (m, 2n + 2), normalised
    (F = 1); displacements are deviations from the equilibrium under the load.
    """
    end = float(times[-1]) + DWELL
    options = RunOptions(duration=end, method="exact", step=step or end, **given)
    run = ExactRun(scene, options)
    # Only the states are stored.
    run.record["sample_every"], run.record["stick_room"] = np.iinfo(np.int64).max, 0
    states, nowhere = [], (np.empty((1, SAMPLE)), np.empty((1, 6)), np.empty((1, 2)))
    for t in times:
        run._go(float(t), *nowhere)
        states.append(run.motion[:-7].copy())
    return np.stack(states)
