"""`method="fast"`: the reduced model in symmetric kicks and exact moves, second order.

The first separation is reached by a growth that lives partly above the cut-off (with the paper's rig at 54
and 96 kHz). Unless a cut-off is given, the few milliseconds from just before the first slip to the first
separation are therefore taken with five times the cut-off, a twelfth of the step and the damping that the
published scheme adds there of itself; before and after, the reduced model does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fivcore import listener
from fivcore.chunks import Chunk
from fivcore.contact_motion import STRETCH, ContactMotion, moved_model
from fivcore.drive import Canonical, State, displacement, slip_distance
from fivcore.errors import ContactError
from fivcore.fast_kernel import ANCHOR, SAMPLED, SPREAD, U_T, advance
from fivcore.fast_solver import Solver, frozen_solver, kicked
from fivcore.kernel import Array, apart
from fivcore.propagation import propagator
from fivcore.published import ADDED_DAMPING
from fivcore.reduced import ReducedModel, default_cutoff, full_model, reduced_model
from fivcore.settled import NEAR, SteadySliding, steady_sliding
from fivcore.step_limit import largest_stable_step, stable
from fivcore.tally import FIRST_SEPARATION, IMPACT, SEPARATION, SETTLED_FROM, SLIP, STATE, STICK, WORK, Tally

# The onset: how much finer, how far the cut-off is raised; for how long before the first slip, so that what
# the change of model stirs up dies away, and for how long in all at most, s.
FINER, HIGHER, LEAD, LONGEST = 12, 5.0, 6e-3, 18e-3
MOST_DAMPING = 1e-7
# Between two returns to Python, s: where motion may be settling, for an early end is looked for after each, and
# elsewhere. Of several threads only one at a time can do what is done there.
SHORT_STRETCH, LONG_STRETCH = 0.04, 0.2
MOST_STEPS = 1_000_000


class FastRun:
    """One run in progress."""

    def __init__(
        self,
        scene: Canonical,
        *,
        ramp: float,
        cutoff: float | None,
        termination: str,
        step: float | None,
        initial: State | None,
        tally: Tally,
        sample_rate: float | None,
        motion: ContactMotion | None = None,
        end_early: bool = False,
    ) -> None:
        self.scene, self.ramp, self.tally = scene, ramp, tally
        self.model = reduced_model(scene.rig, scene.theta, cutoff, termination)
        self.step = self.model.default_step if step is None else step
        limit = self.model.largest_step
        if self.step > limit:
            raise ValueError(
                f"step = {self.step:g}: with this rig and cut-off it must be at most {limit:.3g} s; beyond, the"
                " contact is unstable"
            )
        if self.step > self.model.default_step and not stable(self.model, scene.mu, self.step):
            limit = largest_stable_step(self.model, scene.mu, self.step)
            raise ValueError(
                f"step = {self.step:g}: at mu = {scene.mu:g} it must be at most {limit:.3g} s, for slip's sake"
            )
        wanted = cutoff is None and initial is None and motion is None and termination != "none"
        self._fine = self._onset_solver(termination) if wanted else None
        distance = slip_distance(scene)
        self._share = 1.0 - min(LEAD * scene.pace / distance, 1.0) if distance > 0.0 else 0.0
        self._motion, self._slide, self._rest_slide = motion, (np.zeros(0), np.zeros(0)), (0.0, 0.0)
        self._stretch = 0 if motion is None else max(int(STRETCH / (abs(motion.speed) * self.step)), 1)
        self._hearing = max(round(listener.INTERVAL / self.step), 1)
        self._recording = 0 if sample_rate is None else max(round(1.0 / (sample_rate * self.step)), 1)
        self._solver = frozen_solver(self.model, scene.mu, self.step)
        self.rate = 1.0 / (self._hearing * self.step)
        self._may_settle = end_early and motion is None and bool(self.model.K.any())
        self._contact = apart(np.zeros(3))
        self._begin(initial)

    def _begin(self, initial: State | None) -> None:
        model, scene = self.model, self.scene
        kept = model.kept
        if initial is None:
            self.tally.flags[STATE] = STICK
            q, v = np.zeros(len(model.rest)), np.zeros(len(model.rest))
            self._contact[:2] = np.linalg.solve(model.K, [1.0, 0.0]) if model.K.any() else 0.0
        else:
            full = full_model(scene.rig, scene.theta)
            self.tally.flags[STATE] = initial.contact
            q = initial.displacement[kept] - model.rest
            v = initial.velocity[kept].copy()
            if model.K.any():
                dropped = np.stack([full.normal, full.tangential]) * np.logical_not(kept)
                self._contact[:2] = dropped @ initial.displacement
        self._contact[ANCHOR] = self._contact[U_T] + model.tangential @ (q + model.rest)
        # Kicks come in the middle of a step.
        self._shift = np.zeros(len(q))
        if self.ramp > 0.0:
            elastic = model.stiffness > 0.0
            self._shift[elastic] = model.inertia[elastic] * scene.pace / self.ramp / model.stiffness[elastic]
        else:
            v += model.inertia * scene.pace
        self._first_energy = self._energy_of(q, v, self._contact)
        self._place(*_move(model, q - self._shift, v, 0.5 * self.step))

    def _place(self, q: Array, v: Array) -> None:
        """Put the modes where they are before a kick; their gaps are not known yet."""
        self._q, self._v, self._gaps = apart(q), apart(v), apart(np.full(4, np.nan))

    def chunks(self, last: int) -> Iterator[Chunk]:
        """Run to step `last`, handing over what was heard."""
        length = SHORT_STRETCH
        ramp_ends = int(self.ramp / self.step)
        watching = self._fine is not None
        i = 0
        if ramp_ends == 0 and self._shift.any():
            self._end_ramp(0)
        while i < last:
            per_chunk = self._stretch or min(max(round(length / self.step), 1), MOST_STEPS)
            target = min(i + per_chunk, last)
            if i < ramp_ends:
                target = min(target, ramp_ends)
            if self._motion is not None:
                self._follow(self._motion, i, target)
            stop = 1 if watching and i >= ramp_ends else 0
            reached, chunk = self._advance(self._solver, i, target, 1, stop)
            yield chunk
            i = reached
            if i == ramp_ends and self._shift.any():
                self._end_ramp(ramp_ends)
            if self._fine is not None and reached < target:
                watching = False
                if np.isnan(self.tally.moments[FIRST_SEPARATION]):
                    for chunk, at in self._onset(self._fine, i, last):
                        i = at
                        yield chunk
            elif i > ramp_ends and last - i > per_chunk and (steady := self._settled(chunk)) is not None:
                yield self._rest(steady, i, last)
                return
            length = SHORT_STRETCH if self._unrest(chunk) < self.scene.pace else LONG_STRETCH

    def _unrest(self, chunk: Chunk) -> float:
        """By how much the slip rate varied at the end of a stretch; infinite where motion cannot be settling."""
        recent = chunk.slip_rate[3 * len(chunk.slip_rate) // 4 :]
        slides = self._may_settle and self.tally.flags[STATE] == SLIP and len(recent) > 1
        return float(np.ptp(recent)) if slides else np.inf

    def _settled(self, chunk: Chunk) -> SteadySliding | None:
        """Steady sliding, if nothing else can follow this stretch; a proof is tried only where it looks so."""
        pace = self.scene.pace
        if not self._unrest(chunk) <= NEAR * pace:
            return None
        steady = steady_sliding(self.model, self.scene.mu, self.step)
        self._may_settle = steady is not None and steady.decays
        for_good = steady is not None and steady.for_good(self._q, self._v, self._contact[:2], pace)
        return steady if for_good else None

    def _rest(self, steady: SteadySliding, first: int, last: int) -> Chunk:
        """Steps `first` to `last` of steady sliding: a few are taken and counted as often as they occur."""
        q, v, self._contact[:2] = steady.start(self.scene.pace)
        self._place(q, v)
        counted, self.tally = self.tally, Tally().start(SLIP, 0.0, 0.0, None)
        self._advance(self._solver, first, first + SAMPLED, 1, 0)
        sample, self.tally = self.tally, counted
        settled = int(np.clip(np.ceil(counted.moments[SETTLED_FROM] / self.step - 0.5), first, last))
        entries = (-(-last // SPREAD) - -(-settled // SPREAD)) / (SAMPLED // SPREAD)
        counted.repeat(sample, (last - settled) / SAMPLED, entries, (last - first) / SAMPLED)
        return Chunk.steady(first, last, self.step, steady.row(self.scene.pace), self._hearing, self._recording)

    def _advance(self, solver: Solver, first: int, last: int, finer: int, stop: int) -> tuple[int, Chunk]:
        """Steps `first` to `last` of this solver; `finer` of them make one of the run's."""
        hearing, recording = self._hearing * finer, self._recording * finer
        heard = np.empty(((last - first) // hearing + 1, 2))
        rows = np.empty(((last - first) // recording + 1 if recording else 0, 6))
        sticks = self.tally.room(first * solver.step, last * solver.step, solver.step)
        reached = advance(
            solver.model_arrays,
            solver.laws,
            self.scene.mu,
            solver.landing,
            solver.model.K,
            solver.model.C,
            solver.W,
            self._drive(solver),
            self._slide,
            solver.step,
            first,
            last,
            self._q,
            self._v,
            self._gaps,
            self._contact,
            self.tally.arrays,
            sticks,
            heard,
            hearing,
            rows,
            recording,
            stop,
            self._share,
        )
        taken = self.tally.taken(sticks)
        return reached, Chunk.cut(first, reached, solver.step, 0.5, heard, hearing, rows, recording, taken)

    def _drive(self, solver: Solver) -> Array:
        shift = solver.model.tangential @ self._shift
        return np.array([self.scene.pace, self.ramp, *solver.at_rest, shift, *self._rest_slide])

    def _follow(self, motion: ContactMotion, first: int, last: int) -> None:
        """Take the contact point along with P2 through steps `first` to `last`."""
        begin, end = (motion.position((i + 0.5) * self.step) for i in (first, last))
        q = self._q + self.model.rest
        model, after = (moved_model(self.model, self.scene, place) for place in (begin, end))
        ends = ((model.normal, after.normal), (model.tangential, after.tangential))
        slides = [(b - a) / (last - first) for a, b in ends]
        self._slide = (slides[0], slides[1])
        self._rest_slide = (float(slides[0] @ model.rest), float(slides[1] @ model.rest))
        before = self.stored_energy()
        self._place(q - model.rest, self._v)
        self.model, self._solver = model, Solver(model, self.scene.mu, self.step)
        # Another element and another equilibrium: what that changes is nobody's loss.
        self.tally.sums[IMPACT] += before - self.stored_energy()

    def _end_ramp(self, step: int) -> None:
        """The clamp stops accelerating, between the kicks of steps `step` - 1 and `step`."""
        model = self.model
        push = model.inertia * self.scene.pace / self.ramp * (self.ramp - step * self.step)
        q, v = _move(model, self._shift, push, 0.5 * self.step)
        boundary_q, _ = _move(model, self._q, self._v, -0.5 * self.step)
        work = float(np.sum(model.stiffness * self._shift * (boundary_q + self._shift)))
        self.tally.sums[WORK] += work
        self._place(self._q + q, self._v + v)
        self._shift = np.zeros(len(q))

    def _onset_solver(self, termination: str) -> Solver | None:
        """More modes, finer steps; None where they would keep every mode or lose their unique contact force."""
        rig = replace(self.scene.rig, d2=self.scene.rig.d2 + ADDED_DAMPING)
        model = reduced_model(rig, self.scene.theta, HIGHER * default_cutoff(rig), termination)
        step = self.step / FINER
        # With much material damping nothing grows up there, and the element is no spring to start from.
        if self.scene.rig.d2 > MOST_DAMPING:
            return None
        if not (self.model.K.any() and model.K.any()) or step > model.largest_step:
            return None
        try:
            return frozen_solver(model, self.scene.mu, step)
        except ContactError:
            return None

    def _onset(self, fine: Solver, first: int, last: int) -> Iterator[tuple[Chunk, int]]:
        """From step `first` to the first separation (or LONGEST) with more modes and finer steps."""
        coarse = self._solver
        model = fine.model
        common = coarse.model.kept[model.kept]
        before = self.stored_energy()
        # Lift: what was not kept follows the contact force statically, and so does what was.
        q, v = _move(coarse.model, self._q, self._v, -0.5 * coarse.step)
        force = coarse.model.K @ self._contact[:2]
        q = q - kicked(coarse, force)
        q_fine, v_fine = np.zeros(len(common)), np.zeros(len(common))
        q_fine[common], v_fine[common] = q, v
        more = ~common
        q_fine[more] = (
            model.normal[more] * (force[0] - 1.0) + model.tangential[more] * force[1]
        ) / model.stiffness[more]
        q_fine += kicked(fine, force)
        self._contact[:2] = np.linalg.solve(model.K, force)
        self.model, self._solver = model, fine
        self._place(*_move(model, q_fine, v_fine, 0.5 * fine.step))
        self._shift = np.zeros(len(common))
        self._hold(first * coarse.step + 0.5 * fine.step)
        self.tally.sums[IMPACT] += before - self.stored_energy()
        until = min(last, first + round(LONGEST / coarse.step)) * FINER
        i = first * FINER
        while i < until:
            target = min(i + round(SHORT_STRETCH / fine.step), until)
            reached, chunk = self._advance(fine, i, target, FINER, 2)
            yield chunk, -(-reached // FINER)
            i = reached
            if reached < target or not np.isnan(self.tally.moments[FIRST_SEPARATION]):
                break
        if i % FINER:
            reached, chunk = self._advance(fine, i, i + FINER - i % FINER, FINER, 0)
            yield chunk, reached // FINER
            i = reached
        # Restrict: what is no longer kept stays at the contact as the element's state.
        before = self.stored_energy()
        q, v = _move(model, self._q, self._v, -0.5 * fine.step)
        lost = np.stack([model.normal[more], model.tangential[more]]) @ (q + model.rest)[more]
        self._contact[:2] += lost
        self.model, self._solver = coarse.model, coarse
        if self.tally.flags[STATE] != SEPARATION:
            force = model.K @ (self._contact[:2] - lost)
            q -= kicked(fine, force)
            q[common] += kicked(coarse, force)
        self._place(*_move(coarse.model, q[common], v[common], 0.5 * coarse.step))
        self._shift = np.zeros(len(self._q))
        self._hold((i // FINER + 0.5) * coarse.step)
        self.tally.sums[IMPACT] += before - self.stored_energy()

    def _hold(self, t: float) -> None:
        """Stick, if it goes on, holds the surfaces where they are at the next kick, at time `t`."""
        at_c = self.model.tangential @ (self._q + self.model.rest)
        self._contact[ANCHOR] = (
            self._contact[U_T] + at_c - float(displacement(np.array(t), self.scene.pace, self.ramp))
        )

    def stored_energy(self) -> float:
        """Of the modes about the equilibrium, the element and the load, canonical."""
        return self._energy_of(self._q + self._shift, self._v, self._contact)

    def _energy_of(self, q: Array, v: Array, contact: Array) -> float:
        model, u = self.model, contact[:2]
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + model.normal @ q + 0.5 * u @ model.K @ u)

    def released_energy(self) -> float:
        """What has been taken out of the store since the start."""
        return self._first_energy - self.stored_energy()

    def calm(self, floor: float) -> bool:
        """Set what is far below every scale to zero; False where a number is not finite."""
        for part in (self._q, self._v):
            part[np.abs(part) < floor] = 0.0
        return bool(np.isfinite(self._q).all() and np.isfinite(self._v).all())


def _move(model: ReducedModel, q: Array, v: Array, time: float) -> tuple[Array, Array]:
    """Free motion of the kept modes over any time, backwards too."""
    a, b, c, d = propagator(model.stiffness, model.damping, time)
    return a * q + b * v, c * q + d * v
