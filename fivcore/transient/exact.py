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

from collections.abc import Sequence

import numpy as np

from fivcore.contact.ablation import modified
from fivcore.contact.reduced import ReducedModel, default_cutoff, full_model, reduced_model
from fivcore.errors import ContactError, DivergenceError, not_unique
from fivcore.jit import Array
from fivcore.transient.exact_kernels import SCENE, S, integrate, prescribed, sample, search, switch
from fivcore.transient.exact_regimes import SLIP_DOWN, SLIP_UP, regimes
from fivcore.transient.normalised import Normalised, State
from fivcore.transient.options import Options
from fivcore.transient.record import INTERVAL, Segment, count_in, room_for_sticks
from fivcore.transient.statistics import SEPARATION, SETTLING, STICK, begin

# An event this soon after another is not acted on, s.
DWELL = 1e-10
# Largest growth of slip within DWELL, as a power of e; largest rounding error of a state, relative to the root of
# the motion's energy.
MOST_GROWTH, LOST = 10.0, 1e-9
# Ends of a regime other than a margin's: the end of the ramp or of the run, and that of DWELL.
BOUNDARY, HELD = -1, -2
# Default grid on which statistics are read, and length of a segment, s.
STEP, SEGMENT = 1e-6, 0.04


class ExactRun:
    """One run in progress; `held` counts the events within DWELL of the last one.

    Raises
    ------
    ValueError
        Where the reduced model has no absorbing element.
    ContactError
        Where the contact force is not unique, or slip grows too fast to be resolved.
    """

    def __init__(self, scene: Normalised, options: Options) -> None:
        self.scene, self.options, self.ramp = scene, options, options.ramp
        model = reduced_model(scene.rig, scene.theta, options.cutoff, options.termination)
        self.model = modified(model, options.modify)
        _require_element(self.model, default_cutoff(scene.rig) if options.cutoff is None else options.cutoff)
        critical = self.model.critical_mu(None)
        if scene.mu >= critical:
            raise not_unique(scene.mu, critical)
        model, rate = self.model, options.sampling_rate
        self.step = STEP if options.step is None else options.step
        self.steps = max(round(options.duration / self.step), 1)
        every = max(round(INTERVAL / self.step), 1)
        self.rate = 1.0 / (every * self.step)
        self.record = begin(np.zeros(1, SCENE), options.settle, SETTLING, options.min_stick)
        self.record["sample_every"] = every
        self.record["row_every"] = 0 if rate is None else max(round(1.0 / (rate * self.step)), 1)
        self.segments: list[Segment] = []
        self._shape = np.stack([model.normal, model.tangential])
        self._regimes = regimes(model, scene.mu)
        eigenvalues = np.concatenate([regime.eigenvalues for regime in self._regimes])
        self._finest = 0.25 / float(np.abs(eigenvalues).max())
        self._longest = 2.5 / float(np.abs(eigenvalues.imag).max())
        if float(eigenvalues.real.max()) * DWELL > MOST_GROWTH:
            raise ContactError(
                f"{not_unique(scene.mu, critical)}, and so close to it slip grows by more"
                f" than e^{MOST_GROWTH:g} within {DWELL:g} s, which is not resolved"
            )
        stored = np.sum(model.stiffness * model.rest**2)
        self._size = float(stored + scene.speed_per_load**2 * np.sum(model.inertia**2))
        self._taken, self._now, self.held = 0, 0.0, 0
        self._sticks = np.empty((0, 2))
        self._begin(options.initial)

    def _begin(self, initial: State | None) -> None:
        """Enter the first regime in the full state (q, v, u_N, u_T), q as deviations from `ReducedModel.rest`."""
        model, n = self.model, len(self.model.stiffness)
        contact = STICK if initial is None else initial.contact
        y = np.zeros(2 * n + 2)
        if initial is not None:
            y[:n] = initial.displacement[model.kept] - model.rest
            y[n : 2 * n] = initial.velocity[model.kept]
            # The element's displacement is that of the modes that are not kept.
            full = full_model(self.scene.rig, self.scene.theta)
            dropped = np.stack([full.normal, full.tangential]) * np.logical_not(model.kept)
            y[2 * n :] = dropped @ initial.displacement - np.linalg.solve(model.K, [1.0, 0.0])
        if self.ramp == 0.0:
            y[n : 2 * n] += model.inertia * self.scene.speed_per_load
        self.record["contact"] = contact
        self._first_energy = self._energy_of(y)
        self._decide(0.0, y, contact)

    @property
    def done(self) -> bool:
        """Whether the run has come to its end."""
        return self._taken >= self.steps

    @property
    def time(self) -> float:
        """Time up to which the run has come, s."""
        return self._taken * self.step

    @staticmethod
    def advance(runs: Sequence[ExactRun]) -> None:
        """Take every run to the end of its next segment and leave its samples, rows and sticks in `segments`."""
        for run in runs:
            run._advance()

    def _advance(self) -> None:
        record, step, first = self.record, self.step, self._taken
        every, row_every = int(record["sample_every"][0]), int(record["row_every"][0])
        last = min(first + max(round(SEGMENT / step), 1), self.steps)
        samples = np.empty((count_in(first, last, every), 3))
        rows = np.empty((count_in(first, last, row_every), 6))
        # A step may hold more than one event.
        room = room_for_sticks(first * step, last * step, float(record["least_stick"][0]), min(step, 1e-7))
        self._sticks = np.empty((room, 2))
        record["samples"] = record["rows"] = record["sticks"] = 0
        record["stick_room"] = room
        self._pass_through(first, last, samples, rows)
        self._taken = last
        begun = -(-first // every)
        t = np.asarray((np.arange(begun, begun + len(samples)) * every + 0.5) * step)
        self.segments = [Segment(t, samples, self._sticks[: int(record["sticks"][0])].copy(), rows)]

    def _pass_through(self, i: int, target: int, samples: Array, rows: Array) -> None:
        """Go on from step `i` to the end of step `target` - 1, through as many regimes as it takes."""
        model, step, goal = self.model, self.step, target * self.step
        while True:
            r, end, until = self._regime, goal, target
            if self._stop < goal:
                end, until = self._stop, min(max(int(np.ceil(self._stop / step - 0.5)), i), target)
            motion = (r.eigenvalues, self._amplitudes, *r.outputs, self._start)
            sample(motion, self._origin, step, i, until, self.record, samples, rows)
            integrate(
                motion, self._now - self._origin, end - self._origin, self._finest, self._longest,
                model.damping, model.inertia, model.C, self.record,
            )  # fmt: skip
            i, self._now = until, end
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
        if t < self.ramp:
            end, acceleration = min(self.ramp, end), self.scene.speed_per_load / self.ramp
        start = np.array([0.0, self._clamp_velocity(t), acceleration, 1.0, 0.0, 0.0, 0.0, 0.0])
        if which == STICK:
            start[S] = model.tangential @ y[:n] + y[-1]
        elif which == SEPARATION:
            j = int(np.argmin(model.stiffness))
            start[4:] = y[j], y[n + j], model.inertia[j] * acceleration - model.normal[j], model.damping[j]
        self._which, self._regime, self._origin, self._start = which, r, t, start
        self._amplitudes = r.amplitudes[0] @ y + r.amplitudes[1] @ start[:6]
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
        switch(self.record, min(which, 2), t, self._sticks)
        margins, left = r.margins[0] * self._amplitudes, max(end - t, 0.0)
        length, self._event = search(r.eigenvalues, margins, r.margins[1], start, np.array(orders), left)
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
        return self.scene.speed_per_load * t / self.ramp if t < self.ramp else self.scene.speed_per_load

    def _state_at(self, t: float) -> Array:
        r, s = self._regime, t - self._origin
        modal, forced = r.state
        waves = self._amplitudes * np.exp(r.eigenvalues * s)
        return np.asarray((modal @ waves).real + forced @ prescribed(self._start, s))

    def state_at(self, t: float) -> Array:
        """Go on to time `t` without statistics; return modal displacements, velocities and the element's state."""
        while self._stop <= t:
            self._next_regime()
        return self._state_at(t)

    def _energy_of(self, y: Array) -> float:
        model, n = self.model, len(self.model.stiffness)
        q, v, u = y[:n], y[n : 2 * n], y[2 * n :]
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + model.normal @ q + u[0] + 0.5 * u @ model.K @ u)

    def stored_energy(self) -> float:
        """Energy of the modes about the equilibrium, the element and the load, normalised."""
        return self._energy_of(self._state_at(self._now))

    def released_energy(self) -> float:
        """Decrease of the stored energy since the start, normalised."""
        return self._first_energy - self.stored_energy()

    def calm(self, floor: float) -> bool:
        """Set amplitudes below `floor` to zero; False where one is not finite."""
        self._amplitudes[np.abs(self._amplitudes) < floor] = 0.0
        return bool(np.isfinite(self._amplitudes).all())


def _require_element(model: ReducedModel, cutoff: float) -> None:
    """Refuse a model in which nothing, or a spring alone, stands for the modes above the cut-off."""
    if not model.K.any():
        raise ValueError(
            f"cutoff = {cutoff:g}: it keeps every mode of this rig, and method 'exact' needs an element for the"
            " others; use a lower cutoff or method 'fast'"
        )
    if not model.C.any():
        raise ValueError(
            f"cutoff = {cutoff:g}: the relaxation time of this rig's element is 0, and method 'exact' needs a"
            " dashpot; use another cutoff or method 'fast'"
        )


def states_at(
    scene: Normalised, times: Array, *, ramp: float, cutoff: float | None = None, initial: State | None = None
) -> Array:
    """Exact motion of the kept modes at ascending `times` (m,), s; the others are arguments of `ExactRun`.

    Returns modal displacements as deviations from `ReducedModel.rest`, then modal velocities, those of P2 relative
    to its clamp, (m, 2n); normalised (F = 1).
    """
    end = float(times[-1]) + DWELL
    run = ExactRun(scene, Options(end, "exact", ramp=ramp, cutoff=cutoff, initial=initial, step=end))
    return np.stack([run.state_at(float(t))[:-2] for t in times])
