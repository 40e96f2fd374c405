"""`method="exact"`: the reduced model with the absorbing element, integrated from event to event.

In each regime of `fivcore.contact.law` (separation, stick, slip with T = mu N or T = -mu N) the model is linear.
It is propagated by its eigenvalues (`exact_regimes`) to the first zero of one of the regime's margins, found by a
certified search (`exact_kernels`). So there is neither order nor time step: `step` is the grid on whose midpoints
statistics and series are read. The error is rounding, some 1e-13 of the motion until the first slip, which flutter
then amplifies to 1e-10 at the first separation.

An event within DWELL of the last one (a graze, or the tip of the cone) is not acted on: the regime is kept for
DWELL and the next one decided from the state alone. The motion stays linear and its energy balance exact; where
gap or cone were overstepped meanwhile, the decision changes the element's displacement, booked as impact.
"""

from __future__ import annotations

import numpy as np

from fivcore.contact.ablation import modified
from fivcore.contact.reduced import default_cutoff, full_model, reduced_model
from fivcore.contact.uniqueness import check_unique, critical_mu_of
from fivcore.errors import ContactError, DivergenceError, not_unique
from fivcore.jit import Array
from fivcore.transient.exact_kernels import SCENE, S, observe, search, waves_at
from fivcore.transient.exact_regimes import SLIP_DOWN, SLIP_UP, regimes
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.options import Options
from fivcore.transient.statistics import SEPARATION, STICK
from fivcore.transient.stepped import SteppedRun

# An event this soon after another is not acted on, s.
DWELL = 1e-10
# Largest growth of slip within DWELL, as a power of e; largest rounding error of a state, relative to the root of
# the motion's energy.
MOST_GROWTH, LOST = 10.0, 1e-9
# Ends of a regime other than a margin's: the end of the ramp or of the run, and that of DWELL.
BOUNDARY, HELD = -1, -2
# Default grid on which statistics are read, and length of a segment, s.
STEP, SEGMENT = 1e-6, 0.04


class ExactRun(SteppedRun):
    """One run in progress; `held` counts the events within DWELL of the last one.

    Raises
    ------
    ValueError
        Where the reduced model has no absorbing element.
    ContactError
        Where the contact force is not unique, or slip grows too fast to be resolved.
    """

    READ_AT = 0.5

    def __init__(self, scene: Normalised, options: Options) -> None:
        model = reduced_model(scene.rig, scene.theta, options.cutoff, options.termination)
        self.model = model = modified(model, options.modify)
        cutoff = default_cutoff(scene.rig) if options.cutoff is None else options.cutoff
        if not model.K.any():
            raise ValueError(
                f"cutoff = {cutoff:g}: it keeps every mode of this rig, and method 'exact' needs an element for"
                " the others; use a lower cutoff or method 'fast'"
            )
        if not model.C.any():
            raise ValueError(
                f"cutoff = {cutoff:g}: the relaxation time of this rig's element is 0, and method 'exact' needs a"
                " dashpot; use another cutoff or method 'fast'"
            )
        check_unique(model, scene.mu, None)
        step = STEP if options.step is None else options.step
        super().__init__(scene, options, step, round(SEGMENT / step), SCENE)
        self._shape = np.stack([model.normal, model.tangential])
        self._regimes = regimes(model, scene.mu)
        if max(regime.eigenvalues.real.max() for regime in self._regimes) * DWELL > MOST_GROWTH:
            raise ContactError(
                f"{not_unique(scene.mu, critical_mu_of(model, None))}, and so close to it slip grows by more"
                f" than e^{MOST_GROWTH:g} within {DWELL:g} s, which is not resolved"
            )
        stored = np.sum(model.stiffness * model.rest**2)
        self._size = float(stored + scene.speed_per_load**2 * np.sum(model.inertia**2))
        self._now, self.held = 0.0, 0
        # The full state is (q, v, u_N, u_T), q as deviations from `ReducedModel.rest`.
        initial, n = options.initial, len(model.stiffness)
        contact = STICK if initial is None else initial.contact
        y = np.zeros(2 * n + 2)
        if initial is not None:
            y[:n] = initial.displacement[model.kept] - model.rest
            y[n : 2 * n] = initial.velocity[model.kept]
            # The element's displacement is that of the modes that are not kept.
            full = full_model(scene.rig, scene.theta)
            dropped = np.stack([full.normal, full.tangential]) * np.logical_not(model.kept)
            y[2 * n :] = dropped @ initial.displacement - np.linalg.solve(model.K, [1.0, 0.0])
        if options.ramp == 0.0:
            y[n : 2 * n] += model.inertia * scene.speed_per_load
        self.record["contact"] = contact
        self._first_energy = self._energy_of(y)
        self._decide(0.0, y, contact)

    def _take(self, first: int, last: int, samples: Array, rows: Array, sticks: Array) -> None:
        goal = last * self.step
        while True:
            r, end, until = self._regime, goal, last
            if self._stop < goal:
                end, until = self._stop, min(max(int(np.ceil(self._stop / self.step - 0.5)), first), last)
            motion = (r.eigenvalues, self._amplitudes, r.outputs, self._start)
            observe(
                motion, min(self._which, SLIP_UP), self._origin, self._now, end, self.step, first, until,
                self.record, samples, rows, sticks,
            )  # fmt: skip
            first, self._now = until, end
            if self._stop >= goal or not np.isfinite(self._amplitudes).all():
                return
            self._next_regime()

    def _enter(self, t: float, which: int, y: Array, orders: tuple[int, int, int] = (0, 0, 0)) -> None:
        """Begin a regime at time `t` in the full state `y` and find its end.

        The forces are continuous but at touch-down, where the dashpot lets N jump. So the margin that has just
        vanished departs from zero with its first derivative (slip rate after stick, distance to the edge of the
        cone after slip) or its second (gap where N falls to zero, or after a touch-down without closing speed):
        `orders`, as in `search`.
        """
        model, r, n = self.model, self._regimes[which], len(self.model.stiffness)
        end, acceleration = self.steps * self.step, 0.0
        if t < self.options.ramp:
            end, acceleration = min(self.options.ramp, end), self.scene.speed_per_load / self.options.ramp
        start = np.array([0.0, self._clamp_velocity(t), acceleration, 1.0, 0.0, 0.0, 0.0, 0.0])
        if which == STICK:
            start[S] = model.tangential @ y[:n] + y[-1]
        elif which == SEPARATION:
            j = int(np.argmin(model.stiffness))
            start[4:] = y[j], y[n + j], model.inertia[j] * acceleration - model.normal[j], model.damping[j]
        self._which, self._regime, self._origin, self._start = which, r, t, start
        self._amplitudes = np.append(r.entry @ np.append(y, start[:6]), np.ones(6))
        entered, energy = self._state_at(t), self._energy_of(y)
        # A mode slower than all others by many orders of magnitude responds to the drive with a displacement so
        # large that the digits of the motion are lost in it.
        error = entered - y
        lost = np.sum(error[n : 2 * n] ** 2) + np.sum(model.stiffness * error[:n] ** 2)
        if lost > LOST**2 * max(self._size, 2.0 * abs(energy)):
            raise DivergenceError(
                f"at t = {t:.6g} s the motion is lost in the rounding of a mode far slower than it"
            )
        self.record["impact"] += energy - self._energy_of(entered)
        margins, left = r.margins * self._amplitudes, max(end - t, 0.0)
        length, self._event = search(r.eigenvalues, margins, start, np.array(orders), left)
        self._stop = end if self._event == BOUNDARY else t + length
        if self._event != BOUNDARY and length < DWELL:
            self._stop, self._event = t + DWELL, HELD
            self.held += 1

    def _next_regime(self) -> None:
        """Enter the regime that follows the event at the end of the present one; in contact event 0 is N = 0."""
        t, which, event = self._stop, self._which, self._event
        y = self._state_at(t)
        if event == BOUNDARY:
            self._enter(t, which, y)
        elif event == HELD or which == SEPARATION:
            self._decide(t, y, which, landed=event != HELD)
        elif event == 0:
            self._enter(t, SEPARATION, y, (2, 0, 0))
        elif which == STICK:
            self._enter(t, SLIP_UP if event == 1 else SLIP_DOWN, y, (0, 1, 0))
        else:
            self._enter(t, STICK, y, (0, 1, 0) if which == SLIP_UP else (0, 0, 1))

    def _decide(self, t: float, y: Array, was: int, landed: bool = False) -> None:
        """Enter the regime that the state alone demands (`fivcore.contact.law`); `landed`: the gap has closed."""
        K, C, mu, n = self.model.K, self.model.C, self.scene.mu, len(self.model.stiffness)
        g_N = self.model.normal @ y[:n]
        if was == SEPARATION and g_N + y[-2] > 0.0 and not landed:
            self._enter(t, SEPARATION, y)
            return
        # The force that sticking needs.
        rates = np.array([0.0, self._clamp_velocity(t)]) - self._shape @ y[n : 2 * n]
        N, T = K @ np.array([-g_N, y[-1]]) + C @ rates + [1.0, 0.0]
        which, m = (SLIP_UP, mu) if T > 0.0 else (SLIP_DOWN, -mu)
        if N > 0.0 and abs(T) <= mu * N:
            self._enter(t, STICK, y)
        # Slip changes (N, T) by C times the change of u_T', until T = m N.
        elif N - C[0, 1] * ((T - m * N) / (C[1, 1] - m * C[0, 1])) > 0.0:
            self._enter(t, which, y)
        else:
            self._enter(t, SEPARATION, y, (2 if was == SEPARATION else 1, 0, 0))

    def _clamp_velocity(self, t: float) -> float:
        ramp = self.options.ramp
        return self.scene.speed_per_load * (t / ramp if t < ramp else 1.0)

    def _state_at(self, t: float) -> Array:
        waves = np.empty_like(self._amplitudes)
        waves_at(self._regime.eigenvalues, self._start, t - self._origin, waves)
        return np.asarray((self._regime.state @ (self._amplitudes * waves)).real)

    def _energy_of(self, y: Array) -> float:
        model, n = self.model, len(self.model.stiffness)
        q, v, u = y[:n], y[n : 2 * n], y[2 * n :]
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + model.normal @ q + u[0] + 0.5 * u @ model.K @ u)

    def stored_energy(self) -> float:
        """Energy of the modes about the equilibrium, the element and the load, normalised."""
        return self._energy_of(self._state_at(self._now))

    def calm(self, floor: float) -> bool:
        """Set amplitudes below `floor` to zero; False where one is not finite."""
        self._amplitudes[np.abs(self._amplitudes) < floor] = 0.0
        return bool(np.isfinite(self._amplitudes).all())


def states_at(
    scene: Normalised, times: Array, *, ramp: float, cutoff: float | None = None, initial: State | None = None
) -> Array:
    """Exact motion of the kept modes at ascending `times` (m,), s; the others are arguments of `ExactRun`.

    Returns modal displacements as deviations from `ReducedModel.rest`, then modal velocities, those of P2 relative
    to its clamp, (m, 2n); normalised (F = 1).
    """
    end = float(times[-1]) + DWELL
    run = ExactRun(scene, Options(end, "exact", ramp=ramp, cutoff=cutoff, initial=initial, step=end))
    states = []
    for t in times:
        while run._stop <= t:
            run._next_regime()
        states.append(run._state_at(float(t))[:-2])
    return np.stack(states)
