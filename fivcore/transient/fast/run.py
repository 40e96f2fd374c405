"""`method="fast"`: the reduced model in symmetric impulses and exact moves, second order in the step.

`FastRun` keeps the state of one scene and takes it through the phases of a run, a segment at a time. Steady
sliding that is proved to last (`transient.fast.steady`) is filled in.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.beams.modes import propagator
from fivcore.contact.reduced import ReducedModel, modified, reduced_model
from fivcore.contact.step_map import at_most, largest_stable_step, stable
from fivcore.errors import SceneValueError, not_unique
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.transient.fast import layout, onset
from fivcore.transient.fast.kernel import advance
from fivcore.transient.fast.skip import NO_TABLES, SkipTables, skip_tables, workspace_for
from fivcore.transient.fast.solver import Solver, put, solver_of, take
from fivcore.transient.fast.steady import NEARLY_STEADY, SteadySliding, sliding_growth, steady_sliding
from fivcore.transient.normalised import Normalised, State, displacement, residual_gaps, slip_distance
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import (
    FIELDS,
    SAMPLE,
    SAMPLED_COUNTERS,
    SEPARATION,
    SETTLED,
    SLIP,
    STICK,
    Segment,
    count_in,
    first_counted,
    room_for_sticks,
)
from fivcore.transient.stepped import duplicate

# Segments, s: where motion may settle, which is examined after each, and elsewhere.
SHORT_SEGMENT, LONG_SEGMENT = 0.04, 0.25
# Their usual steps at most, and all that they may need, each with room in memory for a stick; so long is a record.
MOST_STEPS, MOST_ROOM = 1_000_000, 1e8
# Share of a mode's energy, as a power of e, that may be lost between two samples of the dissipation.
FAST_DECAY = 0.25
# Rows of a record that are handed over at once, about.
MOST_ROWS = 10_000
# Phases of a run, in order: while the drive starts; until the contact is about to slip; the onset with the finer
# model (`transient.fast.onset`), until contact opens and for a while after; the motion from then on.
RAMP, BEFORE_SLIP, CLOSED, OPENED, MOTION = range(5)


class FastRun:
    """One run in progress; `begun` is its start, s, if it continues another run.

    What changes on the way: the motion in `record`, `blocks` and `tangent`; `_shift`, the modes' equilibrium in an
    accelerating frame; the model in use, `_solver`; the phase and its end, `_phase` and `_ends`; the segment's,
    `_until`, `_length` and `_fine_energy`; where the run pauses and ends, `pause` and `steps`; and whether it may
    end early, `may_settle`. A copy (`stepped.duplicate`) goes on alike.
    """

    begun = 0.0

    def __init__(self, scene: Normalised, options: RunOptions) -> None:
        self.scene, self.options = scene, options
        model = modified(reduced_model(scene.rig, scene.theta, options.cutoff), options.modify)
        self.step = checked_step(model, scene, options)
        # The run goes no further than to step `pause`, which may move.
        self.pause = self.steps = max(round(options.duration / self.step), 1)
        # A ramp shorter than a step is none.
        starts = options.initial is None or not options.initial.running
        self._ramp = options.ramp if starts and options.ramp >= self.step else 0.0
        law, distance = scene.friction, slip_distance(scene)
        self._kinetic, self._law = scene.mu * law.ratio(scene.speed_per_load), () if law.constant else law.law
        self._refines = options.cutoff is None and options.initial is None and bool(model.K.any())
        self._refines = self._refines and isinstance(scene.rig, Rig)
        self._share = 1.0 - min(onset.LEAD * scene.speed_per_load / distance, 1.0) if distance > 0.0 else 0.0
        self._sample_every = max(round(model.interval / self.step), 1)
        self._row_every = options.rows(self.step)[0]
        self.rate = 1.0 / (self._sample_every * self.step)
        self.may_settle = options.end_early and bool(model.K.any()) and law.constant
        self._short, self._long = SHORT_SEGMENT * scene.rig.time_scale, LONG_SEGMENT * scene.rig.time_scale
        self._length, self._fine_energy = self._short, False
        # The step at which the phase ends, if nothing has ended it, and that at which its segment ends, which a
        # record may cut into several.
        self._phase, self._ends, self._until = RAMP, int(self._ramp / self.step), 0
        self.segments: Iterable[Segment] = ()
        self.record = options.record_of(scene, layout.SCENE)
        # A deviation that follows the motion (`kernel.advance`).
        self.tangent: Any = ()
        self._solver = self._coarse = solver_of(model, self.step)
        self.blocks = aligned(self._solver.blocks)
        self._start(options.initial)
        if not self._ends:
            self._end_ramp()

    # State.

    @property
    def model(self) -> ReducedModel:
        """The model in use."""
        return self._solver.model

    @property
    def models(self) -> list[tuple[float | None, ReducedModel]]:
        """The models of the run, each with the cut-off asked for."""
        own, fine = [(self.options.cutoff, self._coarse.model)], vars(self).get("_fine")
        return own + ([(onset.finer_cutoff(self.scene.rig), fine.model)] if fine else [])

    @cached_property
    def growing(self) -> Array:
        """Frequencies of growing motions about steady sliding, Hz; empty where no onset is computed."""
        return sliding_growth(self.scene, self._coarse.model, self.step) if self._refines else np.zeros(0)

    @cached_property
    def _fine(self) -> Solver | None:
        """Solver of the onset; None where there is none. Growth in the finer model alone starts no vibration."""
        return onset.finer_solver(self.scene, self.step, self.options) if len(self.growing) else None

    @property
    def places(self) -> NDArray[np.int64]:
        """Places of the modes in rows of `blocks`, (n,)."""
        return self._solver.places

    def _row(self, row: int) -> Array:
        return take(self.blocks, self.places, row)

    def _start(self, initial: State | None) -> None:
        model, scene, solver = self.model, self.scene, self._solver
        u: Array = np.zeros(2)
        contact = self.options.contact
        if initial is None:
            q, v = (np.zeros(len(model.normal)) for _ in range(2))
            u = solver.contact.flexibility[0]
        else:
            q = initial.displacement[model.kept] - model.static_equilibrium
            v = initial.velocity[model.kept].copy()
            if model.K.any():
                u = residual_gaps(scene, model.kept, initial)
                if contact != SEPARATION:
                    u = solver.contact.flexibility @ (model.K @ u)
        # Within the ramp coordinates are deviations from the equilibrium in the accelerating frame.
        self._shift = np.zeros(len(q))
        if initial is not None and initial.running:
            q += solver.between_impulses(solver.contact.stiffness @ u * (contact != SEPARATION))
        elif self._ramp > 0.0:
            elastic = model.stiffness > 0.0
            push = model.inertia[elastic] * scene.speed_per_load / self._ramp
            self._shift[elastic] = push / model.stiffness[elastic]
            self.record["work"] -= self._ramp_work(q)
        else:
            v += model.inertia * scene.speed_per_load
        self._first_energy = self._energy_of(q, v, u)
        self._use(solver)
        record = self.record
        record["contact"], record["u_N"], record["u_T"] = contact, *u
        record["anchor"] = u[1] + model.tangential @ q + solver.at_rest[1]
        self._place(*_move(model, q - self._shift, v, 0.5 * self.step))
        if initial is not None and initial.running:
            # Stick holds the surfaces where they are at the first impulse.
            u[1] -= 0.5 * self.step * (model.tangential @ v - scene.speed_per_load)
            drive = 0.5 * self.step * scene.speed_per_load
            record["anchor"] = u[1] + float(record["g_T"][0]) + solver.at_rest[1] - drive
        if contact == STICK:
            record["next_skip"] = 0

    def resumed(self, options: RunOptions) -> FastRun:
        """Return a run that continues this one after its end."""
        run: FastRun = duplicate(self)
        run.blocks, run.options, run.begun = aligned(self.blocks), options, self.time
        run.pause = run.steps = self.now + max(round(options.duration / self.step), 1)
        run._row_every = options.rows(self.step)[0]
        run.may_settle = options.end_early and bool(self.model.K.any()) and self.scene.friction.constant
        run._first_energy = self.stored_energy()
        run._set_settle(options.record_of(self.scene, None, run.record, self.time))
        return run

    def state(self) -> tuple[Array, Array, Array]:
        """Displacements from rest and velocities of the modes, and the gaps of the others, between two steps."""
        solver, K = self._solver, self.model.K
        touches, u = bool(self.record["contact"] != SEPARATION), self._u
        force = solver.contact.stiffness @ u if touches else np.zeros(2)
        q, v = self._between(solver)
        if touches and K.any():
            # The law has u_N, and in stick u_T, in the middle of the last step.
            drive = self.scene.speed_per_load * min(self.time / self._ramp if self._ramp else 1.0, 1.0)
            rates = self.model.shapes @ v - [0.0, drive]
            rates[1] *= self.record["contact"][0] == STICK
            u = np.linalg.solve(K, force) - 0.5 * solver.step * rates
        return q + self._shift - solver.between_impulses(force), v, np.asarray(u)

    def _set_settle(self, record: Any) -> None:
        settled = float(record["settled_from"][0])
        record["settle"] = first_counted(settled, self._solver.step, 0.5) if settled < np.inf else 0

    def _use(self, solver: Solver) -> None:
        """Go on with a solver; the record keeps what belongs to the run."""
        old, self.record = self.record, solver.record.copy()
        for name in [name for name, _ in FIELDS] + ["contact", "u_N", "u_T", "anchor", "now", "settle"]:
            self.record[name] = old[name]
        record = self.record
        self._solver, self.blocks = solver, aligned(solver.blocks)
        record["mu"], record["kinetic"] = self.scene.mu, self._kinetic if not self._law else self.scene.mu
        record["speed"], record["ramp"] = self.scene.speed_per_load, self._ramp
        record["acceleration"] = self.scene.speed_per_load / self._ramp if self._ramp > 0.0 else 0.0
        self._set_settle(record)

    def _place(self, q: Array, v: Array) -> None:
        """Put the modes where they are before an impulse."""
        model, record = self.model, self.record
        put(self.blocks, self.places, layout.Q, q)
        put(self.blocks, self.places, layout.V, v)
        record["g_N"], record["g_T"] = model.normal @ q, model.tangential @ q
        record["v_N"], record["v_T"] = model.normal @ v, model.tangential @ v
        for name in layout.RIGID.split():
            record[name] = np.nan
        record["p_rest"] = self._solver.at_rest[0]
        record["T_rest"] = self._solver.at_rest[1] + model.tangential @ self._shift

    # Segments.

    @property
    def _finer(self) -> int:
        """Steps of the phase in a step of the run."""
        return onset.FINER if self._phase in (CLOSED, OPENED) else 1

    @property
    def now(self) -> int:
        """Steps of the run that have been taken."""
        return int(self.record["now"][0]) // self._finer

    @property
    def time(self) -> float:
        """Time up to which the run has come, s."""
        return float(self.record["now"][0]) * self._solver.step

    @property
    def done(self) -> bool:
        """Whether the run has come to its end."""
        return self.now >= self.steps

    def advance(self) -> None:
        """Go on to the end of the next segment and leave in `segments` what happened there."""
        tables, scene = self._plan(), self.record[0]
        begun, last, every = int(scene["now"]), int(scene["last"]), int(scene["sample_every"])
        samples = np.empty((count_in(begun, last, every), SAMPLE))
        rows = np.empty((count_in(begun, last, int(scene["row_every"])), 6))
        sticks, modes = np.empty((int(scene["stick_room"]), 2)), self.blocks.ravel()
        advance(self.record, modes, samples, rows, sticks, tables, workspace_for(tables), self._law, self.tangent)
        first, count = -(-begun // every), int(scene["samples"])
        t = np.asarray((np.arange(first, first + count) * every + 0.5) * self._solver.step)
        segment = Segment(t, samples[:count], sticks[: int(scene["sticks"])], rows[: int(scene["rows"])])
        self.segments = [segment]
        self._conclude(segment)

    def _plan(self) -> SkipTables:
        """Decide where the next segment ends and what ends it before; return tables of its skips."""
        record, solver, finer = self.record, self._solver, self._finer
        every, rows = self._sample_every * finer, self._row_every * finer
        now, tables = int(record["now"][0]), NO_TABLES
        # No skip crosses a multiple of this; segments end there, so that recording changes nothing.
        grid = layout.MAX_SKIP * every
        if now >= self._until:
            self._until = self._segment_end(now, grid)
            # In the first segments a start that is no rest may decay within less than a sample.
            decay = float(self._coarse.model.damping.max()) * self._coarse.model.interval
            self._fine_energy = self.time < self._short and decay > FAST_DECAY
        if self._phase in (BEFORE_SLIP, MOTION) and self.options.skip_sticks and now * self.step >= self._ramp:
            tables = skip_tables(solver.model, solver.step, every)
        last = self._until
        if rows:
            piece = grid * max(MOST_ROWS * rows // grid, 1)
            last = min(last, (now // piece + 1) * piece)
        record["last"] = last = min(last, self.pause * finer)
        record["threshold"] = self._share * self.scene.mu if self._phase == BEFORE_SLIP else np.inf
        record["until_open"] = self._phase == CLOSED
        record["sample_every"], record["next_sample"] = every, -(-now // every) * every
        energy = 1 if self._fine_energy else every
        record["energy_every"], record["next_energy"] = energy, -(-now // energy) * energy
        record["row_every"], record["next_row"] = rows, -(-now // rows) * rows if rows else layout.NEVER
        record["may_skip"] = tables is not NO_TABLES
        if tables is NO_TABLES:
            record["next_skip"] = layout.NEVER
        elif record["contact"] == STICK:
            # At the next sample at the earliest.
            due = int(record["next_skip"][0])
            record["next_skip"] = max(due if due < layout.NEVER else 0, int(record["next_sample"][0]))
        record["stopped"] = record["samples"] = record["rows"] = record["sticks"] = 0
        step = solver.step
        record["stick_room"] = room_for_sticks(now * step, last * step, float(record["least_stick"][0]), step)
        return tables

    def _segment_end(self, now: int, grid: int) -> int:
        if self._phase == OPENED:
            return self._ends
        if self._phase == CLOSED:
            return min(now + round(self._short / self._solver.step), self._ends)
        length = min(max(round(self._length / self.step), 1), MOST_STEPS)
        last = (now // grid + (1 if now % grid else max(length // grid, 1))) * grid
        return min(last, self._ends) if self._phase == RAMP else last

    def _conclude(self, segment: Segment) -> None:
        """Decide what follows a segment."""
        record = self.record
        now, stopped = int(record["now"][0]), bool(record["stopped"][0])
        opened = not np.isnan(record["first_separation"][0])
        if (phase := self._phase) == RAMP and now == self._ends:
            self._end_ramp()
        elif phase == BEFORE_SLIP and stopped:
            self._phase = MOTION
            if not opened and self._fine is not None:
                self._enter_onset(self._fine)
        elif phase == CLOSED and (stopped or opened or now >= self._ends):
            coarse = -(-now // onset.FINER) + round(onset.AFTER / self.step)
            self._phase, self._ends, self._until = OPENED, coarse * onset.FINER, 0
        elif phase == OPENED and now >= self._ends:
            self._leave_onset()
        if stopped:
            self._until = 0
        if now < self._until or {phase, self._phase} & {CLOSED, OPENED}:
            return
        settles = phase != RAMP and not stopped and now < self.steps
        if settles and (steady := self._settled(segment)) is not None:
            self.segments = chain([segment], self._fill(steady))
        varies = self._slip_variation(segment) >= self.scene.speed_per_load
        self._length = self._long if varies else self._short

    # The ramp.

    def _end_ramp(self) -> None:
        """Stop the acceleration of the clamp, between the impulses of two steps."""
        self._phase = BEFORE_SLIP if self._refines else MOTION
        if not self._shift.any():
            return
        model, ramp = self.model, self._ramp
        push = model.inertia * self.scene.speed_per_load / ramp * (ramp - self._ends * self.step)
        q, v = _move(model, self._shift, push, 0.5 * self.step)
        before_q, before_v = self._between(self._solver)
        self.record["work"] += self._ramp_work(before_q + self._shift)
        self.record["work"] += np.sum(push * (before_v + 0.5 * push))
        self._shift = np.zeros(len(q))
        self._place(self._row(layout.Q) + q, self._row(layout.V) + v)

    # The onset.

    def _enter_onset(self, fine: Solver) -> None:
        """Go on with more modes and finer steps."""
        coarse, now = self._coarse, self.now
        state = onset.prolong(coarse, fine, *self._between(coarse), self._u)
        self._change_to(fine, state, now * self.step)
        self.record["now"] = now * onset.FINER
        self._phase, self._until = CLOSED, 0
        self._ends = (now + round(onset.LONGEST / self.step)) * onset.FINER

    def _leave_onset(self) -> None:
        """Go on with the modes and steps of the run."""
        fine, now, touches = self._solver, self.now, bool(self.record["contact"] != SEPARATION)
        state = onset.restrict(fine, self._coarse, *self._between(fine), self._u, touches)
        self._change_to(self._coarse, state, now * self.step)
        self.record["now"], self._phase, self._until = now, MOTION, 0

    def _between(self, solver: Solver) -> tuple[Array, Array]:
        """Displacements and velocities half a step ago, between two impulses."""
        return _move(solver.model, self._row(layout.Q), self._row(layout.V), -0.5 * solver.step)

    def _change_to(self, solver: Solver, state: tuple[Array, Array, Array], t: float) -> None:
        """Go on with another model and step from modes and u at time t, between two impulses."""
        q, v, u = state
        self._use(solver)
        self._shift = np.zeros(len(q))
        self._place(*_move(solver.model, q, v, 0.5 * solver.step))
        # Stick, if it goes on, holds the surfaces where they are at the next impulse.
        drive = displacement(np.array(t + 0.5 * solver.step), self.scene.speed_per_load, self._ramp)
        shifted = float(self.record["g_T"][0]) + solver.at_rest[1] - float(drive)
        self.record["u_N"], self.record["u_T"], self.record["anchor"] = *u, u[1] + shifted

    # The end.

    def _slip_variation(self, segment: Segment) -> float:
        """By how much the slip rate varied at the end of a segment; infinite where the contact does not slide."""
        # As many whatever the segment's length: a record cuts segments into several.
        recent = segment.samples[-layout.MAX_SKIP // 4 :, 1]
        slides = self.record["contact"][0] == SLIP and len(recent) > 1
        return float(np.ptp(recent)) if slides else np.inf

    def _settled(self, segment: Segment) -> SteadySliding | None:
        """Steady sliding, if nothing else can follow a segment; a proof is tried only where it looks so."""
        speed = self.scene.speed_per_load
        if not (self.may_settle and self._slip_variation(segment) <= NEARLY_STEADY * speed):
            return None
        steady = steady_sliding(self.model, self._kinetic, self.step)
        self.may_settle = steady is not None and steady.decays
        state = self._row(layout.Q), self._row(layout.V), self._u
        return steady if steady is not None and steady.is_permanent(*state, speed) else None

    def _fill(self, steady: SteadySliding) -> Iterator[Segment]:
        """Fill in steady sliding to the end of the run: all its steps count the same."""
        speed, record, every, step = self.scene.speed_per_load, self.record, self._sample_every, self.step
        if self.options.until is not None:
            least = (float(record["settled_from"][0]) + self.options.until.least) / step
            self.pause = self.steps = min(max(int(np.ceil(least)), self.pause), self.steps)
        first, last = int(record["now"][0]), self.steps
        q, v, u = steady.start(speed)
        self._place(q, v)
        record["u_N"], record["u_T"] = u
        velocity, N, T, slip_rate, _ = row = steady.row(speed)
        sample = [velocity, slip_rate, N, *(float(record[name][0]) for name in SAMPLED_COUNTERS)]
        settled = int(np.clip(first_counted(record["settled_from"][0], step, 0.5), first, last))
        if settled > first:
            for name in SETTLED:
                record[name] = 0.0
        if last > settled:
            record["max_N"] = np.maximum(record["max_N"], N)
            record["max_slip"] = np.maximum(record["max_slip"], abs(slip_rate))
        record["sum_N"] += (last - settled) * step * N
        record["slip_time"] += (last - settled) * step
        record["work"] += (last - first) * step * T * speed
        record["friction"] -= (last - first) * step * T * slip_rate
        model = self.model
        middle = v + 0.5 * step * (model.normal * (N - 1.0) + model.tangential * T)
        record["damped"] += (last - first) * step * (model.damping @ middle**2)
        record["now"] = last
        begin, rows = -(-first // every), self._row_every
        count = -(-last // every) - begin
        for start in range(first, last, MOST_ROWS * rows) if rows else ():
            end = min(start + MOST_ROWS * rows, last)
            written = np.empty((count_in(start, end, rows), 6))
            written[:, 0] = (np.arange(-(-start // rows), -(-end // rows)) * rows + 0.5) * step
            written[:, 1:] = row
            yield Segment(np.zeros(0), np.empty((0, SAMPLE)), rows=written)
        if count > 0:
            t = np.array([(begin * every + 0.5) * step])
            yield Segment(t, np.array([sample]), repeated=count - 1)

    # Energy.

    @property
    def _u(self) -> Array:
        return np.array([self.record["u_N"][0], self.record["u_T"][0]])

    def stored_energy(self) -> float:
        """Energy of the modes about the equilibrium, the springs, the load and the ramp's push, normalised."""
        q = self._row(layout.Q) + self._shift
        return self._energy_of(q, self._row(layout.V), self._u) - self._ramp_work(q)

    def _ramp_work(self, q: Array) -> float:
        """Work of the accelerating clamp on the inertia of P2 over modal displacements."""
        return float(np.sum(self.model.stiffness * self._shift * q))

    def _energy_of(self, q: Array, v: Array, u: Array) -> float:
        model, K = self.model, self._solver.contact.stiffness
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + model.normal @ q + 0.5 * u @ K @ u)

    def released_energy(self) -> float:
        """Decrease of the stored energy since the start, normalised."""
        return self._first_energy - self.stored_energy()

    def flush(self, floor: float) -> bool:
        """Set what is far below every scale to zero; False where a number is not finite."""
        moving = self.blocks[:, layout.Q : layout.V + 1]
        moving[np.abs(moving) < floor] = 0.0
        return bool(np.isfinite(moving).all())


def checked_step(model: ReducedModel, scene: Normalised, options: RunOptions) -> float:
    """Step of a run, s, if steps so long are stable, so short not too many, and have a unique solution."""
    step = default_step(model, scene, options.duration) if options.step is None else options.step
    limit, what = model.largest_step, "the contact"
    if model.default_step < step <= limit and not stable(model, scene.mu, step):
        limit, what = largest_stable_step(model, scene.mu, step), f"slip with mu = {scene.mu:g}"
    if step > limit:
        raise SceneValueError(
            f"step = {step:g}: with these modes it must be at most {at_most(limit, 3)} s;"
            f" beyond, {what} is unstable"
        )
    if scene.mu >= (most := model.painleve_mu(step)):
        raise not_unique(scene.mu, most)
    check_falling(model, scene, step)
    least = least_step(model, options.duration)
    if step < least:
        what, damping = f"step = {step:g}: it must be at least {least:g} s", float(model.damping.max())
        if options.step is None and step * damping > 1.0:
            what = f"d1 = {scene.rig.d1:g}, d2 = {scene.rig.d2:g}: d1 + d2 omega^2 = {damping:.4g} of the"
            what += f" fastest mode must be at most {at_most(2.0 / least, 3)} 1/s"
        raise SceneValueError(f"{what} over this duration, or a segment has more than {MOST_ROOM:g} steps")
    return step


def least_step(model: ReducedModel, duration: float) -> float:
    """Shortest step of a run, s."""
    return min(duration, layout.MAX_SKIP * model.interval) / MOST_ROOM


def default_step(model: ReducedModel, scene: Normalised, duration: float) -> float:
    """Step of a run, s; a rigid contact, whose step follows the modes alone, may need a shorter one.

    It is at most a hundredth of the duration, and a quarter of the time V / (mu N / m) in which friction takes the
    contact's mass along, or where that is very short, 1e-4 of what the modes need.
    """
    step = model.default_step
    if model.K.any() or isinstance(scene.rig, Rig):
        return step
    catching = scene.speed_per_load / max(scene.mu * float(model.W[1, 1]), 1e-300)
    return min(step, max(0.25 * catching, 1e-4 * step, least_step(model, duration)), 0.01 * duration)


def check_falling(model: ReducedModel, scene: Normalised, step: float) -> None:
    """Raise where friction falls so steeply that under the load slip is not unique in a step."""
    fall = -scene.mu * scene.friction.slope(0.0)
    if not fall or fall < (most := model.steepest_fall(step, scene.mu)):
        return
    steps = model.largest_step * 0.5 ** np.arange(0.0, 20.0, 0.25)
    for allowed in steps[[fall < model.steepest_fall(each, scene.mu) for each in steps]][:1]:
        raise SceneValueError(
            f"step = {step:g}: friction falls so steeply with speed that it must be at most"
            f" {at_most(allowed, 3)} s; beyond, slip is not unique within a step"
        )
    speed = scene.friction.decay_speed * scene.load
    raise SceneValueError(
        f"Friction: decay_speed = {speed:g}: with this scene and step = {step:g} it must be at least"
        f" {speed * fall / most * 1.001:.3g} m/s, or 0 for a jump; below, slip is not unique"
    )


def _move(model: ReducedModel, q: Array, v: Array, time: float) -> tuple[Array, Array]:
    """Free motion of the kept modes over any time, backwards too."""
    a, b, c, d = _flow(model, time)
    return a * q + b * v, c * q + d * v


@lru_cache(maxsize=64)
def _flow(model: ReducedModel, time: float) -> Array:
    return propagator(model.stiffness, model.damping, time)


def aligned(blocks: Array) -> Array:
    """Copy blocks so that no register's worth of them lies across lines of the processor's cache."""
    buffer = np.empty(blocks.size + 8)
    start = -buffer.ctypes.data % 64 // 8
    own: Array = buffer[start : start + blocks.size].reshape(blocks.shape)
    own[:] = blocks
    return own
