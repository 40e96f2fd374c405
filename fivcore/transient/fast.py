"""`method="fast"`: the reduced model in symmetric kicks and exact moves, second order.

The first separation is reached by a growth that lives partly above the cut-off (with the paper's rig at 54
and 96 kHz), and the burst that follows begins with what has grown there. Unless a cut-off is given, the few
milliseconds from just before the first slip to just after the first separation are therefore taken with five
times the cut-off, a fifth of the step and the damping that the published scheme adds there of itself; before and
after, the reduced model does.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

import numpy as np

from fivcore.beams.free_motion import propagator
from fivcore.contact.reduced import ReducedModel, full_model, reduced_model
from fivcore.contact.step_map import at_most, largest_stable_step, stable
from fivcore.jit import Array
from fivcore.transient import spectra as listener
from fivcore.transient.bench import Stretch, kind_of
from fivcore.transient.chunks import Chunk, rows_in
from fivcore.transient.drive import Canonical, State, displacement, slip_distance
from fivcore.transient.fast_solver import Solver, frozen_solver
from fivcore.transient.lane_rows import REACH, SAMPLED
from fivcore.transient.leaps import leaps
from fivcore.transient.moving_contact import STRETCH, ContactMotion, moved_model
from fivcore.transient.onset import FINER, finer_solver, lifted, restricted
from fivcore.transient.statistics import (
    FIRST_SEPARATION,
    IMPACT,
    SEPARATION,
    SETTLED_FROM,
    SLIP,
    STATE,
    STICK,
    WORK,
    Tally,
)
from fivcore.transient.steady import NEAR, SteadySliding, steady_sliding

# The onset: for how long before the first slip, so that what the change of model stirs up dies away, for how long
# to the first separation at most, and after it, s.
LEAD, LONGEST, AFTER = 3e-3, 21e-3, 3e-3
# Between two returns to Python, s: where motion may be settling, for an early end is looked for after each, and
# elsewhere. Of several threads only one at a time can do what is done there.
SHORT_STRETCH, LONG_STRETCH = 0.04, 1.0
MOST_STEPS = 1_000_000
# Rows of a record are handed over when there are about so many: of all runs under way they would fill the memory.
MOST_ROWS = 10_000
# What a run does: it asks for stretches, hands over rows of its record and chunks, and comes to a result.
Result = TypeVar("Result")
Asking = Generator[Stretch | Chunk | Array, None, Result]
# The contact's own state: the element's, and g_T + u_T at the last moment of sliding.
U_N, U_T, ANCHOR = range(3)


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
        relaxation_time: float | None = None,
        cross_terms: bool = True,
        leap: bool = True,
    ) -> None:
        self.scene, self.ramp, self.tally = scene, ramp, tally
        self.model = reduced_model(scene.rig, scene.theta, cutoff, termination, relaxation_time, cross_terms)
        self.step = self.model.default_step if step is None else step
        limit = self.model.largest_step
        if self.step > limit:
            raise ValueError(
                f"step = {self.step:g}: with this rig and cut-off it must be at most {at_most(limit, 3)} s;"
                " beyond, the contact is unstable"
            )
        if self.step > self.model.default_step and not stable(self.model, scene.mu, self.step):
            limit = largest_stable_step(self.model, scene.mu, self.step)
            raise ValueError(
                f"step = {self.step:g}: at mu = {scene.mu:g} it must be at most {at_most(limit, 3)} s, for slip's"
                " sake"
            )
        wanted = cutoff is None and initial is None and motion is None and bool(self.model.K.any())
        self._fine = finer_solver(scene, self.step, termination, cross_terms) if wanted else None
        distance = slip_distance(scene)
        self._share = 1.0 - min(LEAD * scene.pace / distance, 1.0) if distance > 0.0 else 0.0
        self._motion = motion
        self._slides: tuple[Array, ...] = ()
        self._rest_slide = (0.0, 0.0)
        self._stretch = 0 if motion is None else max(int(STRETCH / (abs(motion.speed) * self.step)), 1)
        self._hearing = max(round(listener.INTERVAL / (self.step * SAMPLED)), 1) * SAMPLED
        self._recording = 0 if sample_rate is None else max(round(1.0 / (sample_rate * self.step)), 1)
        self._solver = frozen_solver(self.model, scene.mu, self.step)
        self.rate = 1.0 / (self._hearing * self.step)
        self._may_settle = end_early and motion is None and bool(self.model.K.any())
        self._leaping = leap and motion is None
        self._contact = np.zeros(3)
        self._begin(initial)

    def _begin(self, initial: State | None) -> None:
        model, scene = self.model, self.scene
        kept = model.kept
        if initial is None:
            self.tally.flags[STATE] = STICK
            q, v = np.zeros(len(model.rest)), np.zeros(len(model.rest))
            self._contact[:2] = np.linalg.solve(self._solver.K, [1.0, 0.0]) if model.K.any() else 0.0
        else:
            full = full_model(scene.rig, scene.theta)
            self.tally.flags[STATE] = initial.contact
            q = initial.displacement[kept] - model.rest
            v = initial.velocity[kept].copy()
            if model.K.any():
                dropped = np.stack([full.normal, full.tangential]) * np.logical_not(kept)
                u = dropped @ initial.displacement
                touches = initial.contact != SEPARATION
                self._contact[:2] = np.linalg.solve(self._solver.K, model.K @ u) if touches else u
        self._contact[ANCHOR] = self._contact[U_T] + model.tangential @ q + self._solver.at_rest[1]
        self._leap_at = 0.0 if self.tally.flags[STATE] == STICK else np.inf
        # Kicks come in the middle of a step.
        self._shift = np.zeros(len(q))
        if self.ramp > 0.0:
            elastic = model.stiffness > 0.0
            self._shift[elastic] = model.inertia[elastic] * scene.pace / self.ramp / model.stiffness[elastic]
        else:
            v += model.inertia * scene.pace
        self._first_energy = self._energy_of(q, v, self._contact)
        self._start = q - self._shift, v
        self._place(*_move(model, *self._start, 0.5 * self.step))

    def _place(self, q: Array, v: Array) -> None:
        """Put the modes where they are before a kick; their gaps are not known yet."""
        model = self.model
        self._q, self._v = q, v
        at_rest = self._solver.at_rest
        shift = float(model.tangential @ self._shift)
        creep = (float(self._slides[0] @ q) + self._rest_slide[0]) / self.step if self._slides else 0.0
        shapes = (model.normal, model.tangential)
        gaps = [float(shape @ part) for part in (q, v) for shape in shapes]
        self._ahead = np.array([*gaps, at_rest[0], at_rest[1] + shift, creep])

    def chunks(self, last: int) -> Asking[None]:
        """Run to step `last`: ask for stretches to be filled in, hand over what was recorded and heard in them."""
        length = SHORT_STRETCH
        ramp_ends = int(self.ramp / self.step)
        i = 0
        if ramp_ends == 0 and self._shift.any():
            self._end_ramp(0, self._start)
        while i < last:
            per_chunk = self._stretch or min(max(round(length / self.step), 1), MOST_STEPS)
            target = min(i + per_chunk, last)
            if self._motion is None:
                # Where no leap crosses, and where lanes that are there together take their samples together.
                reach = REACH * self._hearing
                target = min((i // reach + (1 if i % reach else max(per_chunk // reach, 1))) * reach, last)
            if i < ramp_ends:
                target = min(target, ramp_ends)
            if self._motion is not None:
                self._follow(self._motion, i, target)
            share = self._share if self._fine is not None and i >= ramp_ends else np.inf
            i, chunk = yield from self._advance(i, target, share=share)
            yield chunk
            if i == ramp_ends and self._shift.any():
                self._end_ramp(ramp_ends, _move(self.model, self._q, self._v, -0.5 * self.step))
            if self._fine is not None and i < target:
                fine, self._fine = self._fine, None
                if np.isnan(self.tally.moments[FIRST_SEPARATION]):
                    i = yield from self._onset(fine, i, last)
                    self._leap_at = float(i) if self.tally.flags[STATE] == STICK else np.inf
            elif i > ramp_ends and last - i > per_chunk and (steady := self._settled(chunk)) is not None:
                yield (yield from self._rest(steady, i, last))
                return
            length = SHORT_STRETCH if self._unrest(chunk) < self.scene.pace else LONG_STRETCH

    def _unrest(self, chunk: Chunk) -> float:
        """By how much the slip rate varied at the end of a stretch; infinite where the contact does not slide."""
        recent = chunk.slip_rate[3 * len(chunk.slip_rate) // 4 :]
        slides = self.tally.flags[STATE] == SLIP and len(recent) > 1
        return float(np.ptp(recent)) if slides else np.inf

    def _settled(self, chunk: Chunk) -> SteadySliding | None:
        """Steady sliding, if nothing else can follow this stretch; a proof is tried only where it looks so."""
        pace = self.scene.pace
        if not (self._may_settle and self._unrest(chunk) <= NEAR * pace):
            return None
        steady = steady_sliding(self.model, self.scene.mu, self.step)
        self._may_settle = steady is not None and steady.decays
        for_good = steady is not None and steady.for_good(self._q, self._v, self._contact[:2], pace)
        return steady if for_good else None

    def _rest(self, steady: SteadySliding, first: int, last: int) -> Asking[Chunk]:
        """Steps `first` to `last` of steady sliding: a few are taken and counted as often as they occur."""
        q, v, self._contact[:2] = steady.start(self.scene.pace)
        self._place(q, v)
        counted, self.tally = self.tally, Tally().start(SLIP, 0.0, 0.0, None)
        recording, self._recording = self._recording, 0
        yield from self._advance(first, first + self._hearing)
        sample, self.tally, self._recording = self.tally, counted, recording
        settled = int(np.clip(np.ceil(counted.moments[SETTLED_FROM] / self.step - 0.5), first, last))
        entries = (-(-last // SAMPLED) - -(-settled // SAMPLED)) / (self._hearing // SAMPLED)
        counted.repeat(sample, (last - settled) / self._hearing, entries, (last - first) / self._hearing)
        row = steady.row(self.scene.pace)
        for begin in range(first, last, MOST_ROWS * max(recording, 1)) if recording else ():
            end = min(begin + MOST_ROWS * recording, last)
            rows = np.empty((rows_in(begin, end, recording), 1 + len(row)))
            rows[:, 0] = (np.arange(-(-begin // recording), -(-end // recording)) * recording + 0.5) * self.step
            rows[:, 1:] = row
            yield rows
        return Chunk.steady(first, last, self.step, row, self._hearing)

    def _advance(
        self, first: int, last: int, finer: int = 1, share: float = np.inf, until_open: bool = False
    ) -> Asking[tuple[int, Chunk]]:
        """Steps `first` to `last` of the present solver; `finer` of them make one of the run's."""
        hearing, recording = self._hearing * finer, self._recording * finer
        leaping = self._leaping and finer == 1 and first * self.step >= self.ramp
        # Pieces end where no leap crosses, so that recording changes nothing; but what ends a stretch is seen only
        # by where it stopped, and on the very last step of a piece it is not.
        reach = REACH * hearing
        piece = reach * max(MOST_ROWS * recording // reach, 1) if recording else last + 1
        step, reached, ended = self._solver.step, first, False
        heard, sticks = [np.empty((0, 2))], [np.empty((0, 2))]
        while reached < last and not ended:
            stretch = Stretch(
                self._solver,
                self._q,
                self._v,
                self._contact,
                self._ahead,
                self.tally,
                reached,
                min((reached // piece + 1) * piece, last),
                self.scene.pace,
                self.ramp,
                hearing,
                recording,
                share,
                until_open,
                self._slides,
                self._rest_slide,
                None if self._fine is None else kind_of(self._fine),
                leaps(self._solver, hearing) if leaping else None,
                self._leap_at,
            )
            yield stretch
            if leaping:
                self._leap_at = stretch.leap_at
            reached, ended = stretch.first, stretch.first < stretch.last
            heard.append(stretch.heard)
            sticks.append(stretch.sticks)
            if recording:
                yield stretch.rows
        whole = np.concatenate(heard), np.concatenate(sticks)
        return reached, Chunk.cut(first, reached, step, 0.5, whole[0], hearing, whole[1])

    def _follow(self, motion: ContactMotion, first: int, last: int) -> None:
        """Take the contact point along with P2 through steps `first` to `last`."""
        begin, end = (motion.position((i + 0.5) * self.step) for i in (first, last))
        q = self._q + self.model.rest
        model, after = (moved_model(self.model, self.scene, place) for place in (begin, end))
        ends = ((model.normal, after.normal), (model.tangential, after.tangential))
        before = self.stored_energy()
        self._slides = tuple((b - a) / (last - first) for a, b in ends)
        self._rest_slide = (float(self._slides[0] @ model.rest), float(self._slides[1] @ model.rest))
        self.model, self._solver = model, Solver(model, self.scene.mu, self.step)
        self._place(q - model.rest, self._v)
        # Another element and another equilibrium: what that changes is nobody's loss.
        self.tally.sums[IMPACT] += before - self.stored_energy()

    def _end_ramp(self, step: int, boundary: tuple[Array, Array]) -> None:
        """The clamp stops accelerating, between the kicks of steps `step` - 1 and `step`.

        `boundary` is the state at the start of `step`; the present one could not tell it after a ramp of far less
        than a step, when the shift is so large that its rounding hides everything else.
        """
        model = self.model
        push = model.inertia * self.scene.pace / self.ramp * (self.ramp - step * self.step)
        q, v = _move(model, self._shift, push, 0.5 * self.step)
        boundary_q, boundary_v = boundary
        work = float(np.sum(model.stiffness * self._shift * (boundary_q + self._shift)))
        work += float(np.sum(push * (boundary_v + 0.5 * push)))
        self.tally.sums[WORK] += work
        self._shift = np.zeros(len(q))
        self._place(self._q + q, self._v + v)

    def _onset(self, fine: Solver, first: int, last: int) -> Asking[int]:
        """More modes and finer steps from step `first` through the first separation; the step reached."""
        coarse = self._solver
        q, v = _move(coarse.model, self._q, self._v, -0.5 * coarse.step)
        self._change_to(fine, *lifted(coarse, fine, q, v, self._contact[:2]), first * coarse.step)
        until = min(last, first + round(LONGEST / coarse.step)) * FINER
        i = first * FINER
        while i < until:
            target = min(i + round(SHORT_STRETCH / fine.step), until)
            i, chunk = yield from self._advance(i, target, FINER, until_open=True)
            yield chunk
            if i < target or not np.isnan(self.tally.moments[FIRST_SEPARATION]):
                break
        target = min(-(-i // FINER) * FINER + round(AFTER / coarse.step) * FINER, last * FINER)
        if i < target:
            i, chunk = yield from self._advance(i, target, FINER)
            yield chunk
        touches = self.tally.flags[STATE] != SEPARATION
        q, v = _move(fine.model, self._q, self._v, -0.5 * fine.step)
        end = restricted(fine, coarse, q, v, self._contact[:2], touches)
        self._change_to(coarse, *end, i // FINER * coarse.step)
        return i // FINER

    def _change_to(self, solver: Solver, q: Array, v: Array, u: Array, t: float) -> None:
        """Go on with another model and step from the state at time t, the start of a step."""
        before = self.stored_energy()
        self.model, self._solver, self._contact[:2] = solver.model, solver, u
        self._shift = np.zeros(len(q))
        self._place(*_move(solver.model, q, v, 0.5 * solver.step))
        # Stick, if it goes on, holds the surfaces where they are at the next kick.
        at_c = solver.model.tangential @ self._q + solver.at_rest[1]
        drive = displacement(np.array(t + 0.5 * solver.step), self.scene.pace, self.ramp)
        self._contact[ANCHOR] = self._contact[U_T] + at_c - float(drive)
        self.tally.sums[IMPACT] += before - self.stored_energy()

    def stored_energy(self) -> float:
        """Of the modes about the equilibrium, the element and the load, canonical."""
        return self._energy_of(self._q + self._shift, self._v, self._contact)

    def _energy_of(self, q: Array, v: Array, contact: Array) -> float:
        model, u = self.model, contact[:2]
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + model.normal @ q + 0.5 * u @ self._solver.K @ u)

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
