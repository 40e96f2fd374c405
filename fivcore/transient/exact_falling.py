"""Slip of `method="exact"` where friction falls with the speed: T = s mu(|w|) N with the slip rate w, s = -sign w.

Stick and separation stay those of `fivcore.transient.exact`. In slip (q, v, u_T) and the energies are integrated
by the method of order 8 of Dormand and Prince (SciPy's DOP853) with a relative tolerance of 1e-13; w follows at
each instant from the contact's own equation, by Newton's method to rounding. N and w are read at FRACTIONS of a
step, and their zeros are located on its polynomial, to rounding.

Between rigid surfaces N keeps the gap closed, and u is zero. The coefficient of friction in an impact is that at
the mean of the slip rates before and after it, as in `fast`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import DOP853, OdeSolution
from scipy.optimize import brentq

from fivcore.contact.law import slide
from fivcore.errors import ContactError, DivergenceError
from fivcore.friction import friction_ratio, slip_speed
from fivcore.jit import Array, inlined, kernel
from fivcore.transient.exact import BOUNDARY, HELD, SLIP_UP, ExactRun, slipping_force
from fivcore.transient.exact_kernels import arrive, wanted, write
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import ENERGIES, SLIP, STICK

# Relative tolerance of a step, and what counts as zero in units of the motion's size.
TOLERANCE, ZERO = 1e-13, 1e-14
# Where in a step margins are read; the largest number of steps whose polynomials are kept.
FRACTIONS, MOST = np.arange(1, 9) / 8.0, 1000


class FallingRun(ExactRun):
    """One run in progress, of a scene whose friction falls with the speed.

    Raises
    ------
    ContactError
        Besides where `ExactRun` does, where friction falls faster with the slip rate than the dashpot's force
        rises: the slip rate is then not unique.
    """

    _path: Any
    _system: Any

    def __init__(self, scene: Normalised, options: RunOptions) -> None:
        self._law = (scene.mu, *scene.friction.law)
        super().__init__(scene, options)

    # BLAS reads beyond the rows that the integrator has filled.
    @np.errstate(invalid="ignore")
    def _enter(self, t: float, which: int, y: Array, orders: tuple[int, int, int] = (0, 0, 0)) -> None:
        model, (q, v), C, end = self.model, np.split(y[:-2].copy(), 2), self.model.C, self._drive(t)[0]
        if which == STICK and not self.rigid:
            N = self._sticking_force(t, y)[0]
            self._check(N, C[1, 1] - self.scene.mu * (abs(C[0, 1]) - self.scene.friction.slope(0.0) * N))
        if which < SLIP_UP:
            super()._enter(t, which, y, orders)
            return
        if not np.isfinite(y).all():
            raise DivergenceError(f"the motion has blown up at t = {t:.6g} s")
        omega = np.sqrt(np.where(model.stiffness > 0.0, model.stiffness, model.stiffness.max()))
        # Root of the energy; at rest, that of the fastest mode under a unit force.
        energy = np.sum(v**2 + model.stiffness * q**2) + model.K[1, 1] * y[-1] ** 2
        size = np.sqrt(energy + model.W[0, 0] / model.stiffness.max())
        self._which, self._origin, self._amplitudes = which, t, y.copy()
        drive = (self._clamp_velocity(t), self._drive(t)[1], 1.0 if which == SLIP_UP else -1.0)
        modes = (model.stiffness, model.damping, model.shapes, model.inertia, model.point_b)
        self._system = (*modes, model.K, C, self._law, drive, self.rigid)
        start = np.concatenate([q, v, y[-1:], np.zeros(4)])
        least_u = 1.0 if self.rigid else model.K[1, 1] ** -0.5
        zero = ZERO * size * np.concatenate([1.0 / omega, np.ones(len(v)), [least_u], 4 * [size]])
        self._zero = -10.0 * ZERO * np.array([1.0, abs(drive[0]) + size * np.sqrt(model.W[1, 1])])
        self._check(*watch(np.zeros(1), start[None], self._system)[0, ::3])
        length, longest = max(end - t, self._dwell), 2.0 / omega.max()
        solver = DOP853(self._rates, 0.0, start, length, max_step=longest, rtol=TOLERANCE, atol=zero)
        times, pieces, self._stop, self._event = [0.0], list[Any](), end, BOUNDARY
        while solver.status == "running" and not (self._event == HELD and solver.t >= self._dwell):
            if len(pieces) == MOST:
                self._stop = t + solver.t
                break
            solver.step()
            if solver.status == "failed":
                self._check(watch(np.array([solver.t]), solver.y[None], self._system)[0, 0], 0.0)
            times.append(solver.t)
            pieces.append(solver.dense_output())
            found, event = (np.inf, BOUNDARY) if self._event == HELD else self._find(pieces[-1])
            if self._dwell <= found < np.inf:
                self._stop, self._event = t + found, event
                break
            if found < np.inf:
                self._stop, self._event = t + self._dwell, HELD
                self.held += 1
        self._path = OdeSolution(times, pieces)

    def _rates(self, s: float, z: Array) -> Array:
        out = np.empty_like(z)
        slip(s, z, self._system, out)
        return out

    def _find(self, piece: Any) -> tuple[float, int]:
        """Find the first zero of a margin in a step, and which; infinity where there is none."""
        s = np.append(piece.t_old, piece.t_old + FRACTIONS * (piece.t - piece.t_old))
        values = watch(s, piece(s).T, self._system)
        signs = np.array([1.0, -self._system[-2][2]])
        past = values[:, [0, 2]] * signs < self._zero
        first = int(np.argmax(past[1:].any(axis=1))) + 1 if past[1:].any() else len(s)
        if np.isnan(values).any():
            # Within the step there are states without a slip rate.
            self._check(watch(s[:1], piece.y_old[None], self._system)[0, 0], 0.0)
        for N, slack in values[1:first, ::3]:
            self._check(N, slack)
        if first == len(s):
            return np.inf, BOUNDARY

        def margin(at: float, k: int) -> float:
            return float(signs[k] * watch(np.array([at]), piece(at)[None], self._system)[0, 2 * k])

        low, high = s[first - 1 : first + 1]
        zeros = [
            (brentq(margin, low, high, (k,), xtol=1e-14 * (high - low)) if margin(low, k) > 0.0 else low, k)
            for k in np.flatnonzero(past[first]).tolist()
        ]
        return min(zeros)

    def _check(self, N: float, slack: float) -> None:
        """Raise an error where the slip rate is not unique: T - s mu N does not rise with u_T'."""
        if not slack > 0.0:
            scene, C, law = self.scene, self.model.C, self.scene.friction
            least = scene.mu * (1.0 - law.kinetic_ratio) * N / (C[1, 1] - scene.mu * abs(C[0, 1]))
            raise ContactError(
                f"friction: decay_speed = {law.decay_speed * scene.load:g} m/s: the slip rate is not unique where"
                f" N = {N * scene.load:.3g} N; it must be above {least * scene.load:.3g} m/s, or 0 for a jump"
            )

    def _impact_mu(self, rates: Array, up: bool) -> float:
        sense, law = 1.0 if up else -1.0, slide(self.model.K, self.model.C, 0.5 * self.model.W, 1.0)
        alpha, (mu, *fall) = -0.5 * rates[0], self._law
        ahead = -sense * (rates[1] + law.rate_N / law.beta * alpha)
        _, ratio = slip_speed(ahead, ahead, law.mobility, alpha, law.beta, sense * law.gamma, mu, tuple(fall))
        return float(mu * ratio)

    def _slipping_force(self, N: float, T: float, up: bool, slip_rate: float) -> float:
        sense = 1.0 if up else -1.0
        if self.rigid:
            m = sense * self.scene.mu * self.scene.friction.ratio(slip_rate)
            return slipping_force(N, T, m, self._resistance)
        return float(N - sense * self.model.C[0, 1] * sliding(N, T, self.model.C, self._law, sense)[0])

    def _state_at(self, t: float) -> Array:
        if self._which < SLIP_UP:
            return super()._state_at(t)
        n = len(self.model.stiffness)
        z = self._path(t - self._origin)
        return np.concatenate([z[: 2 * n], [0.0 if self.rigid else -(self.model.normal @ z[:n]), z[2 * n]]])

    def _observe(self, end: float, first: int, until: int, samples: Array, rows: Array, sticks: Array) -> None:
        if self._which < SLIP_UP:
            super()._observe(end, first, until, samples, rows, sticks)
            return
        s = (np.arange(first, until) + 0.5) * self.step - self._origin
        states = self._path(s).T if len(s) else np.empty((0, len(self._amplitudes) + 3))
        observe_slip(self._system, s, states, self._origin, first, self.step, self.record, samples, rows, sticks)
        gained = self._path(np.array([self._now, end]) - self._origin)[-4:]
        for name, (before, after) in zip(ENERGIES, gained, strict=False):
            self.record[name] += after - before


@inlined
def coefficient(x: float, law: Any) -> tuple[float, float]:
    """Coefficient of friction at the slip rate x, and its derivative; continued beyond x = 0, where steps look."""
    mu, kappa, decay_speed, rational = law
    near = max(x, -0.25 * decay_speed)
    ratio, slope = friction_ratio(near, kappa, decay_speed, rational)
    return mu * (ratio + slope * (x - near)), mu * slope


@kernel
def sliding(N: float, T: float, C: Any, law: Any, sense: float) -> tuple[float, float, float]:
    """Slip rate against T, mu there, and by how much T - s mu N rises with u_T', from (N, T) at no slip rate.

    It begins at the root for the least mu, beyond which there is none.
    """
    mu, slack = law[0] * law[1], 0.0
    x = (sense * T - mu * N) / (C[1, 1] - mu * sense * C[0, 1])
    for _ in range(60):
        mu, slope = coefficient(x, law)
        force = N - sense * C[0, 1] * x
        slack = C[1, 1] + slope * force - mu * sense * C[0, 1]
        change = (sense * T - C[1, 1] * x - mu * force) / max(slack, 1e-6 * C[1, 1])
        x += change
        if abs(change) <= 1e-15 * (abs(x) + abs(T) / C[1, 1]):
            break
    return x, mu, slack


@kernel
def slip(s: float, z: Any, system: Any, out: Any) -> tuple[float, float, float, float]:
    """Write the rates of z = (q, v, u_T, energies) in slip; return N, T, the slip rate, and slack as `sliding`."""
    stiffness, damping, shapes, inertia, _, K, C, law, (speed, acceleration, sense), closed = system
    n, u_T, P = len(stiffness), z[-5], speed + s * acceleration
    g_N, v_N, v_T, free, moved, damped, direct, cross = 0.0, 0.0, -P, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        q, v, normal, tangential = z[j], z[n + j], shapes[0, j], shapes[1, j]
        force = inertia[j] * acceleration - damping[j] * v - stiffness[j] * q - normal
        out[j], out[n + j] = v, force
        g_N, v_N, v_T, free = g_N + normal * q, v_N + normal * v, v_T + tangential * v, free + normal * force
        moved, damped = moved + inertia[j] * v, damped + damping[j] * v * v
        direct, cross = direct + normal * normal, cross + normal * tangential
    rate, w, slack, lost = 0.0, v_T, 1.0, 0.0
    if closed:
        mu = coefficient(-sense * w, law)[0]
        N = -free / (direct + sense * mu * cross)
    else:
        N = 1.0 - K[0, 0] * g_N + K[0, 1] * u_T - C[0, 0] * v_N - C[0, 1] * v_T
        T = -K[1, 0] * g_N + K[1, 1] * u_T - C[1, 0] * v_N - C[1, 1] * v_T
        x, mu, slack = sliding(N, T, C, law, sense)
        w = -sense * x
        rate, N = w - v_T, N + C[0, 1] * w
        lost = C[0, 0] * v_N * v_N - (C[0, 1] + C[1, 0]) * v_N * rate + C[1, 1] * rate * rate
    T = sense * mu * N
    for j in range(n):
        out[n + j] += shapes[0, j] * N + shapes[1, j] * T
    out[2 * n], out[2 * n + 1], out[2 * n + 2] = rate, T * P + moved * acceleration, damped
    out[2 * n + 3], out[2 * n + 4] = -T * w, lost
    return N, T, w, slack


@kernel
def watch(s: Any, states: Any, system: Any) -> Any:
    """N, T, slip rate and slack of states (m, k) at the times s (m,), s, as rows (m, 4)."""
    values, out = np.empty((len(s), 4)), np.empty(states.shape[1])
    for i in range(len(s)):
        values[i] = slip(s[i], states[i], system, out)
    return values


@kernel
def observe_slip(
    system: Any, s: Any, states: Any, origin: float, first: int, step: float,
    scenes: Any, samples: Any, rows: Any, sticks: Any,
) -> None:  # fmt: skip
    """Add a slip that began at the time `origin` to the record, as `exact_kernels.observe` does.

    `states` (m, k) are in the middle of m steps from `first` on.
    """
    scene, point_b, out = scenes[0], system[4], np.empty(states.shape[1])
    arrive(scene, SLIP, origin, sticks)
    for j in range(len(s)):
        if wanted(scene, first + j, step):
            N, T, w, _ = slip(s[j], states[j], system, out)
            velocity = 0.0
            for k in range(len(point_b)):
                velocity += point_b[k] * out[k]
            write(scene, SLIP, first + j, step, (velocity, N, T, w), samples, rows)
