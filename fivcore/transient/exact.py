"""`method="exact"`: the reduced model, integrated from event to event.

In each contact status of `fivcore.contact.law` (separation, stick, slip with T = mu N or T = -mu N) the model is
linear in x: (q, v) of the kept modes, with u_T in slip and u in separation. With the prescribed motion d of
`fivcore.transient.exact_kernels`, d' = D d, x' = M x + B d and M z_k = lambda_k z_k,

    x(s) = Re sum_k c_k z_k exp(lambda_k s) + E d(s),     M E + B = E D,

up to the first zero of a margin, found by a certified search. So there is neither order nor time step: `step` is
the grid on whose midpoints statistics and series are read. The error is rounding: some 1e-10 of the motion until
the first slip, which flutter then amplifies to 3e-8 at the first separation. Modal displacements all but cancel in
a gap, and with them some three digits.

An event within DWELL of the last one (a graze, or the tip of the cone) is not acted on: the status is kept for
DWELL and the next one decided from the state alone. The motion stays linear and its energy balance exact; where
gap or cone were overstepped meanwhile, the decision changes u, booked as impact.

Where every mode is kept, the surfaces are rigid: x is (q, v) of the modes of the structure that the contact holds,
N and T are what keeps the gap closed and, in stick, the surfaces together. Their law is that of
`fivcore.contact.law`: an impact leaves no closing speed, its tangential impulse is within the cone; T jumps where
slip ends.

Where friction jumps to a kinetic coefficient, slip is linear with that one. A slipping contact sticks only where
kinetic friction holds it, and a sticking one slips where |T| = mu N, at once at a finite rate.
Where friction falls with the speed, slip is that of `fivcore.transient.exact_falling`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from fivcore.beams.modes import one_blas_thread
from fivcore.contact.law import resistance
from fivcore.contact.reduced import ReducedModel, default_cutoff, modified, reduced_model
from fivcore.errors import ContactError, DivergenceError, SceneValueError, not_unique
from fivcore.jit import Array, Complex
from fivcore.transient.exact_kernels import ONE, Q_R, SCENE, V_R, A, P, S, observe, search, waves_at
from fivcore.transient.normalised import Normalised, energies, residual_gaps, slip_distance
from fivcore.transient.options import Options
from fivcore.transient.statistics import SEPARATION, STICK
from fivcore.transient.stepped import SteppedRun

# An event this soon after another is not acted on, s.
DWELL = 1e-10
# Largest growth of slip within DWELL, as a power of e; largest rounding error of a state, relative to the root of
# the motion's energy.
MOST_GROWTH, LOST = 10.0, 1e-9
# Ends of a status other than a margin's: the end of the ramp or of the run, and that of DWELL.
BOUNDARY, HELD = -1, -2
# Default grid on which statistics are read, length of a segment, and the shortest ramp, s.
STEP, SEGMENT, SHORT = 1e-6, 0.04, 1e-7
# A rate of a rigid contact is zero below this, in units of the modes' rates.
AT_REST = 1e-9
# Slip with T = mu N and with T = -mu N; the other statuses have the numbers of `fivcore.transient.statistics`.
SLIP_UP, SLIP_DOWN = 2, 3


class ExactRun(SteppedRun):
    """One run in progress; `held` counts the events within DWELL of the last one.

    Raises
    ------
    SceneValueError
        Where a contact with a spring has no dashpot, or is rigid and its directions are parallel.
    ContactError
        Where the contact force is not unique, or slip grows too fast to be resolved.
    """

    READ_AT = 0.5

    def __init__(self, scene: Normalised, options: Options) -> None:
        model = modified(reduced_model(scene.rig, scene.theta, options.cutoff), options.modify)
        self.model, self.rigid = model, not model.K.any()
        if not (self.rigid or model.C.any()):
            cutoff = default_cutoff(scene.rig) if options.cutoff is None else options.cutoff
            raise SceneValueError(
                f"cutoff = {cutoff:g}: the contact has no dashpot, which method 'exact' needs; use a cutoff that"
                " leaves out more modes, or method 'fast'"
            )
        # Change of (N, T) with the rates of the gaps, in rigid contact with their accelerations.
        self._resistance = resistance(model.W) if self.rigid else model.C
        # Of a contact that slips, at the lowest speed, over the static coefficient.
        ratio = scene.friction.kinetic_ratio if scene.friction.decay_speed == 0.0 else 1.0
        limit = model.painleve_mu(None) / ratio if ratio > 0.0 else np.inf
        if scene.mu >= limit:
            raise not_unique(scene.mu, limit)
        unit = scene.rig.time_unit
        step = STEP * unit if options.step is None else options.step
        super().__init__(scene, options, step, round(SEGMENT * unit / step), SCENE)
        self._dwell = dwell = DWELL * unit
        self._slipping = ratio * scene.mu
        self._statuses = statuses(model, scene.mu, self._slipping)
        if max(status.eigenvalues.real.max(initial=0.0) for status in self._statuses) * dwell > MOST_GROWTH:
            raise ContactError(
                f"{not_unique(scene.mu, limit)}, and so close to it slip grows by more"
                f" than e^{MOST_GROWTH:g} within {dwell:g} s, which is not resolved"
            )
        # Energy of the motion: at rest, of the drive, and of what friction loads before the contact slips.
        driven = 0.5 * scene.speed_per_load**2 / np.trace(model.W) + 0.5 * scene.mu * slip_distance(scene)
        self._size = sum(energies(scene)) + driven
        self._now, self.held = 0.0, 0
        # The full state is (q, v, u_N, u_T), q as deviations from `ReducedModel.rest`.
        initial, n = options.initial, len(model.stiffness)
        y = np.zeros(2 * n + 2)
        self._gaps_at_rest = np.zeros(2) if self.rigid else np.linalg.solve(model.K, [1.0, 0.0])
        if initial is not None:
            y[:n] = initial.displacement[model.kept] - model.rest
            y[n : 2 * n] = initial.velocity[model.kept]
            if not self.rigid:
                y[2 * n :] = residual_gaps(scene, model.kept, initial) - self._gaps_at_rest
        # The acceleration in a ramp of 10 ns is so large that the motion would be lost in its rounding.
        self._ramp = options.ramp if options.ramp >= SHORT * unit else 0.0
        if initial is not None and initial.running:
            self._ramp = 0.0
        elif self._ramp == 0.0:
            y[n : 2 * n] += model.inertia * scene.speed_per_load
        self._first_energy = self._energy_of(y)
        # Rigid surfaces may start with any rates: an impact corrects them, and does nothing to surfaces at rest.
        self._decide(0.0, y, options.contact, touchdown=self.rigid and options.contact != SEPARATION)

    def state(self) -> tuple[Array, Array, Array]:
        """Displacements from rest and velocities of the modes, and the gaps of the others."""
        y, n = self._state_at(self._now), len(self.model.stiffness)
        return y[:n], y[n : 2 * n], y[2 * n :] + self._gaps_at_rest

    def _take(self, first: int, last: int, samples: Array, rows: Array, sticks: Array) -> None:
        goal = last * self.step
        while True:
            end, until = goal, last
            if self._stop < goal:
                end, until = self._stop, min(max(int(np.ceil(self._stop / self.step - 0.5)), first), last)
            self._observe(end, first, until, samples, rows, sticks)
            first, self._now = until, end
            if self._stop >= goal:
                return
            self._next_status()

    def _observe(self, end: float, first: int, until: int, samples: Array, rows: Array, sticks: Array) -> None:
        """Record the present status up to the time `end`, and the middles of steps from `first` up to `until`."""
        r = self._status
        motion = (r.eigenvalues, self._amplitudes, r.outputs, self._start)
        ratio = self._slipping if self._which == SLIP_UP else -self._slipping
        observe(
            motion, min(self._which, SLIP_UP), ratio, self._origin, self._now, end, self.step, first, until,
            self.record, samples, rows, sticks,
        )  # fmt: skip

    def _enter(self, t: float, which: int, y: Array, orders: tuple[int, int, int] = (0, 0, 0)) -> None:
        """Begin a contact status at time `t` in the full state `y` and find its end.

        The forces are continuous but at touch-down, where the dashpot lets N jump, and where friction jumps. So
        the margin that has just vanished departs from zero with its first derivative (slip rate after stick,
        distance to the edge of the cone after slip) or its second (gap where N falls to zero, or after a
        touch-down without closing speed): `orders`, as in `search`. Without the dashpot of rigid surfaces gap and
        slip rate depart with the next derivative.
        """
        model, r, n = self.model, self._statuses[which], len(self.model.stiffness)
        end, acceleration = self._drive(t)
        start = np.array([0.0, self._clamp_velocity(t), acceleration, 1.0, 0.0, 0.0, 0.0, 0.0])
        if which == STICK:
            start[S] = model.tangential @ y[:n] + y[-1]
        elif which == SEPARATION and model.stiffness.min() == 0.0:
            j = int(np.argmin(model.stiffness))
            start[4:] = y[j], y[n + j], model.inertia[j] * acceleration - model.normal[j], model.damping[j]
        self._which, self._status, self._origin, self._start = which, r, t, start
        self._amplitudes = np.append(r.entry @ np.append(y, start[:6]), np.ones(6))
        entered, energy = self._state_at(t), self._energy_of(y)
        # A mode slower than all others by many orders of magnitude responds to the drive with a displacement so
        # large that the digits of the motion are lost in it; where two eigenvalues coincide, there is no basis.
        error = entered - y
        lost = np.sum(error[n : 2 * n] ** 2) + np.sum(model.stiffness * error[:n] ** 2)
        if not np.isfinite(lost):
            raise DivergenceError(f"the motion has blown up at t = {t:.6g} s")
        if lost > LOST**2 * 2.0 * max(self._size, abs(energy)):
            raise DivergenceError(
                f"at t = {t:.6g} s the motion is lost in the rounding of a mode far slower than it, or of two"
                " coincident eigenvalues (change mu in the eighth digit)"
            )
        self.record["impact"] += energy - self._energy_of(entered)
        margins, left = r.margins * self._amplitudes, max(end - t, 0.0)
        length, self._event = search(r.eigenvalues, margins, start, np.array(orders), left)
        self._stop = end if self._event == BOUNDARY else t + length
        if self._event != BOUNDARY and length < self._dwell:
            self._stop, self._event = t + self._dwell, HELD
            self.held += 1

    def _next_status(self) -> None:
        """Enter the status that follows the event that ends the present one; in contact event 0 is N = 0."""
        t, which, event = self._stop, self._which, self._event
        y = self._state_at(t)
        if event == BOUNDARY and not self.rigid:
            self._enter(t, which, y)
        elif event in (BOUNDARY, HELD) or which == SEPARATION:
            self._decide(t, y, which, touchdown=event == 0)
        elif event == 0:
            self._enter(t, SEPARATION, y, (3 if self.rigid else 2, 0, 0))
        elif self._slipping < self.scene.mu and not (self.rigid and which >= SLIP_UP):
            # T jumps as slip begins, and is well within the cone where it ends.
            self._decide(t, y, SLIP_UP if which == STICK else STICK, even=True)
        elif which == STICK:
            self._enter(t, SLIP_UP if event == 1 else SLIP_DOWN, y, (0, 2 if self.rigid else 1, 0))
        elif self.rigid:
            self._decide(t, y, which, even=True)
        else:
            self._enter(t, STICK, y, (0, 1, 0) if which == SLIP_UP else (0, 0, 1))

    def _decide(self, t: float, y: Array, was: int, touchdown: bool = False, even: bool = False) -> None:
        """Enter the status that the state alone demands (`fivcore.contact.law`).

        At `touchdown` the gap closes; where `even`, the slip rate is zero but for rounding.
        """
        g_N, energy = self.model.normal @ y[: len(self.model.stiffness)], self._energy_of(y)
        if was == SEPARATION and g_N + y[-2] > 0.0 and not touchdown:
            self._enter(t, SEPARATION, y)
            return
        slip_rate = 0.0
        if self.rigid:
            opens, slip_rate = self._close(t, y, SEPARATION if touchdown else was, even)
            self.record["impact"] += energy - self._energy_of(y)
            if opens:
                self._enter(t, SEPARATION, y, (1, 0, 0))
                return
        N, T = self._sticking_force(t, y)
        up = slip_rate < 0.0 if slip_rate else T > 0.0
        # A slipping contact sticks only where kinetic friction holds it.
        most = self.scene.mu if was == STICK else self._slipping
        sticks = slip_rate == 0.0 and N > 0.0 and abs(T) <= most * N
        if not sticks and self._slipping_force(N, T, up, slip_rate) <= 0.0:
            self._enter(t, SEPARATION, y, (2 if self.rigid or was == SEPARATION else 1, 0, 0))
            return
        if not self.rigid:
            # Contact is entered with a u_N of its own, which is not yet that of the gap.
            y[-2] = -g_N
            self.record["impact"] += energy - self._energy_of(y)
        which = STICK if sticks else SLIP_UP if up else SLIP_DOWN
        self._enter(t, which, y, (0, int(self.rigid and not sticks and slip_rate == 0.0), 0))

    def _close(self, t: float, y: Array, was: int, even: bool) -> tuple[bool, float]:
        """Close the gap of rigid surfaces in the state `y`; return whether they part, and the slip rate."""
        (q, v), model, P = np.split(y[:-2], 2), self.model, self._clamp_velocity(t)
        parts, W = model.shapes * v, model.W
        rates, zero = parts.sum(axis=1) - [0.0, P], AT_REST * np.add(np.abs(parts).sum(axis=1), [0.0, P])
        q -= model.normal * (model.normal @ q / W[0, 0])
        impulse = np.array([-rates[0] / W[0, 0], 0.0])
        if was == SEPARATION:
            if rates[0] > zero[0]:
                return True, 0.0
            N, T = -self._resistance @ rates
            m = self._impact_mu(rates, T > 0.0)
            even = abs(T) <= m * N
            N = N if even else slipping_force(N, T, m if T > 0.0 else -m, self._resistance)
            impulse = np.array([N, T if even else np.copysign(m * N, T)])
        v += impulse @ model.shapes
        slip_rate = float(rates[1] + W[1] @ impulse)
        # Past its zero where an event was not acted on.
        past = was >= SLIP_UP and (slip_rate > 0.0) == (was == SLIP_UP)
        return False, 0.0 if even or past or was == STICK or abs(slip_rate) <= zero[1] else slip_rate

    def _impact_mu(self, rates: Array, up: bool) -> float:
        """Coefficient of friction in an impact with T > 0 (`up`) or T < 0, from the gaps' rates before it."""
        return self._slipping

    def _sticking_force(self, t: float, y: Array) -> Array:
        """(N, T) of a contact that sticks in the full state `y`."""
        (q, v), model = np.split(y[:-2], 2), self.model
        if self.rigid:
            acceleration = self._drive(t)[1]
            free = model.inertia * acceleration - model.damping * v - model.stiffness * q
            return np.asarray(self._resistance @ ([0.0, acceleration] - model.shapes @ free) + [1.0, 0.0])
        rates = np.array([0.0, self._clamp_velocity(t)]) - model.shapes @ v
        return np.asarray(model.K @ np.array([-(model.normal @ q), y[-1]]) + model.C @ rates + [1.0, 0.0])

    def _slipping_force(self, N: float, T: float, up: bool, slip_rate: float) -> float:
        """N in slip with T > 0 (`up`) or T < 0, from (N, T) in stick."""
        return slipping_force(N, T, self._slipping if up else -self._slipping, self._resistance)

    def _drive(self, t: float) -> tuple[float, float]:
        """End of the ramp or of the run, whichever is ahead, and the acceleration of P2's clamp until then."""
        end = self.steps * self.step
        return (min(self._ramp, end), self.scene.speed_per_load / self._ramp) if t < self._ramp else (end, 0.0)

    def _clamp_velocity(self, t: float) -> float:
        ramp = self._ramp
        return self.scene.speed_per_load * (t / ramp if t < ramp else 1.0)

    def _state_at(self, t: float) -> Array:
        waves = np.empty_like(self._amplitudes)
        waves_at(self._status.eigenvalues, self._start, t - self._origin, waves)
        return np.asarray((self._status.state @ (self._amplitudes * waves)).real)

    def _energy_of(self, y: Array) -> float:
        model, n = self.model, len(self.model.stiffness)
        q, v, u = y[:n], y[n : 2 * n], y[2 * n :]
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + model.normal @ q + u[0] + 0.5 * u @ model.K @ u)

    def stored_energy(self) -> float:
        """Energy of the modes about the equilibrium, the springs and the load, normalised."""
        return self._energy_of(self._state_at(self._now))

    def flush(self, floor: float) -> bool:
        """Set amplitudes below `floor` to zero; False where one is not finite."""
        self._amplitudes[np.abs(self._amplitudes) < floor] = 0.0
        return bool(np.isfinite(self._amplitudes).all())


def slipping_force(N: float, T: float, m: float, resistance: Array) -> float:
    """N in slip, from (N, T) in stick: slip changes them by `resistance` (2, 2) times its rate, until T = m N."""
    return float(N - resistance[0, 1] * ((T - m * N) / (resistance[1, 1] - m * resistance[0, 1])))


class Status(NamedTuple):
    """One contact status in its eigenbasis; real parts of the products of these factors count.

    Eigenvalues are in 1/s. `entry` gives c at the start from the full state (q, v, u_N, u_T) and d, where c of a
    pair of eigenvalues counts twice. From w follow the full `state`, the `margins`, which stay positive within the
    status, and, in real and imaginary parts and transposed, the `outputs` of `fivcore.transient.exact_kernels`.
    """

    eigenvalues: Complex  # (m,)
    entry: Complex  # (m, 2n + 8)
    state: Complex  # (2n + 2, m + 6)
    margins: Complex  # (k, m + 6)
    outputs: Array  # (2, m + 6, 9 + n)


@lru_cache(maxsize=32)
@one_blas_thread()
def statuses(model: ReducedModel, mu: float, slipping: float) -> tuple[Status, ...]:
    """The motion of a model in each of the four contact statuses, with the coefficients of stick and of slip."""
    coefficients = {SEPARATION: 0.0, STICK: mu, SLIP_UP: slipping, SLIP_DOWN: slipping}
    return tuple(_status(model, mu, which) for which, mu in coefficients.items())


def _moving(model: ReducedModel, which: int) -> tuple[Array, Array, list[int]]:
    """Shapes (n, h) and frequencies (h,), rad/s, of the modes that are free in a status, and its entries of u.

    In rigid contact they are the modes of the structure held at the contact; else those of the model, of which in
    separation a rigid one is part of d.
    """
    k = model.stiffness
    if which == SEPARATION:
        elastic = k > 0.0
        return np.eye(len(k))[:, elastic], np.sqrt(k[elastic]), [0, 1] if model.K.any() else []
    if model.K.any():
        omega = np.sqrt(np.where(k > 0.0, k, model.contact_frequency**2))
        return np.eye(len(k)), omega, [] if which == STICK else [1]
    held = model.shapes[: 2 if which == STICK else 1]
    free = np.linalg.qr(held.T, mode="complete")[0][:, len(held) :]
    squares, vectors = np.linalg.eigh((free.T * k) @ free)
    return free @ vectors, np.sqrt(squares), []


def _status(model: ReducedModel, mu: float, which: int) -> Status:
    """Write the equations of a contact status as rows of factors of (x, d), and change to its eigenbasis.

    x is (q, v, u_N, u_T) less what follows from the rest: in contact u_N is -g_N, in stick u_T is S - g_T.
    """
    k, c, K, C, normal, tangential = model.stiffness, model.damping, model.K, model.C, *model.shapes
    n, rigid, is_rigid = len(k), np.flatnonzero(k == 0.0), not K.any()
    basis, omega, own = _moving(model, which)
    from_full = block_diag(basis.T, basis.T, np.eye(2)[own])
    size, modes = len(from_full), len(omega)
    rows = np.eye(size + 6)
    q, v, u, d = basis @ rows[:modes], basis @ rows[modes : 2 * modes], np.zeros((2, size + 6)), rows[size:]
    u[own] = rows[2 * modes : size]
    load, rate = np.stack([d[ONE], 0.0 * d[ONE]]), np.zeros_like(u)
    # T = m N in slip.
    m = mu if which == SLIP_UP else -mu
    if which == SEPARATION:
        q[rigid], v[rigid] = d[[Q_R] * len(rigid)], d[[V_R] * len(rigid)]
        rate, force = rate if is_rigid else -np.linalg.inv(C) @ (K @ u + load), 0.0 * load
    elif is_rigid:
        W = model.W
        if which == STICK:
            # The surfaces move with the drive.
            along = np.linalg.solve(W, [0.0, 1.0]) @ model.shapes
            q, v = q + np.outer(along, d[S]), v + np.outer(along, d[P])
        free = model.shapes @ (np.outer(model.inertia, d[A]) - c[:, None] * v - k[:, None] * q) - W @ load
        force = np.linalg.solve(W, np.stack([0.0 * d[A], d[A]]) - free)
        if which != STICK:
            force = np.outer([1.0, m], -free[0] / (W[0, 0] + m * W[0, 1]))
    else:
        u[0], rate = -normal @ q, np.stack([-normal @ v, d[P] - tangential @ v])
        if which == STICK:
            u[1] = d[S] - tangential @ q
        else:
            # K_T u + C_T u' = m (K_N u + C_N u' + 1), solved for u_T'.
            stiff, viscous = K[1] - m * K[0], C[1] - m * C[0]
            rate[1] = -(stiff @ u + viscous[0] * rate[0] - m * d[ONE]) / viscous[1]
        force = K @ u + C @ rate + load
    rate_T = tangential @ v - d[P]
    acceleration = -c[:, None] * v - k[:, None] * q + np.outer(model.inertia, d[A])
    acceleration += model.shapes.T @ (force - load)
    speed = 0.0 * rate_T if which == STICK else rate_T + rate[1]
    N, T = force
    margins = {
        SEPARATION: [normal @ q + u[0]], STICK: [N, mu * N - T, mu * N + T],
        SLIP_UP: [N, -speed], SLIP_DOWN: [N, speed],
    }[which]  # fmt: skip
    inertial, velocity, damped = model.inertia @ v, model.point_b @ v, np.sqrt(c)[:, None] * v
    outputs = np.vstack([rate, C @ rate, inertial, velocity, N, T, speed, damped])
    moving = from_full @ np.vstack([v, acceleration, rate])
    # Displacements weighted by frequency and u by stiffness: the norm is then near the energy's.
    scale = np.concatenate([omega, np.ones(modes), np.sqrt(np.diag(K))[own]])
    matrix, forcing = moving[:, :size] * scale[:, None] / scale, moving[:, size:] * scale[:, None]
    eigenvalues, vectors = (part.astype(complex) for part in np.linalg.eig(matrix))
    # Rows of one size lose fewer digits: near the Painleve limit u_T exceeds all else by orders of magnitude.
    units = 1.0 / np.abs(vectors).sum(axis=1)
    back = np.linalg.inv(units[:, None] * vectors) * units
    # D is nilpotent where B is not zero: three iterations solve Z^-1 (M E + B) = Z^-1 E D.
    forced, steady, D = back @ forcing, np.zeros((size, 6)), np.zeros((6, 6))
    D[S, P] = D[P, A] = 1.0
    for _ in range(3):
        steady = (steady @ D - forced) / eigenvalues[:, None]
    steady = (vectors @ steady).real
    kept = eigenvalues.imag >= 0.0
    eigenvalues, vectors, steady = eigenvalues[kept], vectors[:, kept] / scale[:, None], steady / scale[:, None]
    back = np.where(eigenvalues.imag > 0.0, 2.0, 1.0)[:, None] * back[kept] * scale
    # (x, d) from w.
    change = np.block([[vectors, steady], [np.zeros((6, vectors.shape[1])), np.eye(6)]])
    entry = back @ (np.pad(from_full, ((0, 0), (0, 6))) - np.pad(steady, ((0, 0), (2 * n + 2, 0))))
    full = (np.vstack([q, v, u]), np.stack(margins), outputs)
    state, watched, seen = (part @ change for part in full)
    return Status(eigenvalues, entry, state, watched, np.stack([seen.real.T, seen.imag.T]))
