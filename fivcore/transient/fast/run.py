"""`method="fast"`: the reduced model in symmetric impulses and exact moves, second order in the step.

`FastRun` keeps the state of one scene and takes it through the stages of a run, a segment at a time: the ramp of
the drive, the onset with a finer model (`onset`), sticks that are skipped (`skip`), and the end where steady
sliding is proved to last (`steady`).
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from fivcore.beams.modes import propagator
from fivcore.contact.reduced import ReducedModel, modified, reduced_model
from fivcore.contact.step_map import at_most, largest_stable_step, stable
from fivcore.errors import SceneValueError, not_unique
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.transient import statistics
from fivcore.transient.fast import layout, onset, skip, steady
from fivcore.transient.fast.kernel import advance
from fivcore.transient.fast.onset import BEFORE_SLIP, CLOSED, MOTION, OPENED, RAMP
from fivcore.transient.fast.solver import Solver, put, solver_of, take
from fivcore.transient.normalised import Normalised, State, displacement, residual_gaps, slip_distance
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import SEPARATION, STICK, Segment, count_in, first_counted, room_for_sticks
from fivcore.transient.stepped import Run

# Length of a segment, s: while steady sliding may begin, which is checked after each segment; and otherwise.
SHORT_SEGMENT, LONG_SEGMENT = 0.04, 0.25
# Usual largest number of steps in a segment; absolute limit, since each step may need memory for a stick.
MOST_STEPS, MOST_ROOM = 1_000_000, 1e8
# Share of a mode's energy, as a power of e, that may be lost between two samples of the dissipation.
FAST_DECAY = 0.25


class FastRun(Run):
    """One run in progress.

    The following change during a run: `record`, `blocks` and `tangent` (the motion), `shift` (modal equilibrium in
    the accelerating frame), `solver` (the present model), `phase` and `phase_end` (its last possible step);
    `segment_end`, `length` (s) and `_fine_energy` (dissipation is summed in every step) of a segment; `pause` and
    `steps` (where the run pauses and ends) and `may_settle`. A copy (`stepped.duplicate`) continues identically.
    """

    def __init__(self, scene: Normalised, options: RunOptions) -> None:
        self.model = model = modified(reduced_model(scene.rig, scene.theta, options.cutoff), options.modify)
        super().__init__(scene, options, checked_step(model, scene, options), 0.0, layout.SCENE)
        # A ramp shorter than a step is ignored.
        starts = options.initial is None or not options.initial.running
        self.ramp = options.ramp if starts and options.ramp >= self.step else 0.0
        law, distance = scene.friction, slip_distance(scene)
        self.kinetic, self._law = scene.mu * law.ratio(scene.speed_per_load), () if law.constant else law.law
        default = options.cutoff is None and options.initial is None
        self._refines = default and bool(model.K.any()) and isinstance(scene.rig, Rig)
        self.lead = 1.0 - min(onset.LEAD * scene.speed_per_load / distance, 1.0) if distance > 0.0 else 0.0
        self.sample_every = max(round(model.interval / self.step), 1)
        self.row_every = options.rows(self.step)[0]
        self.rate = 1.0 / (self.sample_every * self.step)
        self.may_settle = options.end_early and bool(model.K.any()) and law.constant
        self.short, self.long = SHORT_SEGMENT * scene.rig.time_scale, LONG_SEGMENT * scene.rig.time_scale
        self.length, self._fine_energy = self.short, False
        self.phase, self.phase_end, self.segment_end = RAMP, int(self.ramp / self.step), 0
        # A deviation that follows the motion (`kernel.advance`).
        self.tangent: Any = ()
        self.solver = self.coarse = solver_of(model, self.step)
        self._start(options.initial)
        if not self.phase_end:
            self._end_ramp()

    @property
    def models(self) -> list[tuple[float | None, ReducedModel]]:
        """The models of the run, each with its requested cut-off."""
        own, fine = [(self.options.cutoff, self.coarse.model)], vars(self).get("fine")
        return own + ([(onset.finer_cutoff(self.scene.rig), fine.model)] if fine else [])

    @cached_property
    def growing(self) -> Array:
        """Frequencies of growing motions about steady sliding, Hz; empty where no onset is computed."""
        return steady.sliding_growth(self.scene, self.coarse.model, self.step) if self._refines else np.zeros(0)

    @cached_property
    def fine(self) -> Solver | None:
        """Solver of the onset, or None if sliding is stable in the run's own model."""
        return onset.finer_solver(self.scene, self.step, self.options) if len(self.growing) else None

    def values(self, row: int) -> Array:
        """A row of the modes in `blocks`, (n,)."""
        return take(self.blocks, self.places, row)

    def _start(self, initial: State | None) -> None:
        model, scene, solver = self.model, self.scene, self.solver
        q, v = np.zeros((2, len(model.normal)))
        u: Array = solver.contact.flexibility[0]
        contact = self.options.contact
        if initial is not None:
            q = initial.displacement[model.kept] - model.static_equilibrium
            v = initial.velocity[model.kept].copy()
            u = residual_gaps(scene, model.kept, initial) if model.K.any() else np.zeros(2)
            if contact != SEPARATION:
                u = solver.contact.flexibility @ (model.K @ u)
        # During the ramp, coordinates are deviations from the equilibrium in the accelerating frame.
        self.shift = np.zeros(len(q))
        if initial is not None and initial.running:
            q += solver.between_impulses(solver.contact.stiffness @ u * (contact != SEPARATION))
        elif self.ramp > 0.0:
            elastic = model.stiffness > 0.0
            push = model.inertia[elastic] * scene.speed_per_load / self.ramp
            self.shift[elastic] = push / model.stiffness[elastic]
            self.record["work"] -= ramp_work(self, q)
        else:
            v += model.inertia * scene.speed_per_load
        self._first_energy = self._energy_of(q, v, u)
        self._use(solver)
        record = self.record
        record["contact"], record["u_N"], record["u_T"] = contact, *u
        record["anchor"] = u[1] + model.tangential @ q + solver.at_rest[1]
        self.place(*moved(model, q - self.shift, v, 0.5 * self.step))
        if initial is not None and initial.running:
            # Stick fixes the surfaces at their positions of the first impulse.
            u[1] -= 0.5 * self.step * (model.tangential @ v - scene.speed_per_load)
            drive = 0.5 * self.step * scene.speed_per_load
            record["anchor"] = u[1] + float(record["g_T"][0]) + solver.at_rest[1] - drive
        if contact == STICK:
            record["next_skip"] = 0

    def resumed(self, options: RunOptions) -> FastRun:
        """Return a run that continues this one after its end."""
        run: FastRun = super().resumed(options)
        run.blocks, run.row_every = aligned(self.blocks), options.rows(self.step)[0]
        run.may_settle = options.end_early and bool(self.model.K.any()) and self.scene.friction.constant
        run.record["settle"] = first_counted(run.record["settled_from"][0], run.solver.step, 0.5)
        return run

    def state(self) -> tuple[Array, Array, Array]:
        """Displacements from rest and velocities of the modes, and the gaps of the others, between two steps."""
        solver, K = self.solver, self.model.K
        touches, u = bool(self.record["contact"] != SEPARATION), self.u
        force = solver.contact.stiffness @ u if touches else np.zeros(2)
        q, v = self.between(solver)
        if touches and K.any():
            # The contact law refers u_N, and in stick u_T, to the middle of the last step.
            drive = self.scene.speed_per_load * min(self.time / self.ramp if self.ramp else 1.0, 1.0)
            rates = self.model.shapes @ v - [0.0, drive]
            rates[1] *= self.record["contact"][0] == STICK
            u = np.linalg.solve(K, force) - 0.5 * solver.step * rates
        return q + self.shift - solver.between_impulses(force), v, np.asarray(u)

    def _use(self, solver: Solver) -> None:
        """Continue with another solver; the record keeps the fields that belong to the run."""
        old, self.record = self.record, solver.record.copy()
        for name in [name for name, _ in statistics.FIELDS] + ["contact", "u_N", "u_T", "anchor", "now"]:
            self.record[name] = old[name]
        record = self.record
        self.solver, self.model, self.places = solver, solver.model, solver.places
        self.blocks = aligned(solver.blocks)
        record["mu"], record["kinetic"] = self.scene.mu, self.kinetic if not self._law else self.scene.mu
        record["speed"], record["ramp"] = self.scene.speed_per_load, self.ramp
        record["acceleration"] = self.scene.speed_per_load / self.ramp if self.ramp > 0.0 else 0.0
        record["settle"] = first_counted(record["settled_from"][0], solver.step, 0.5)

    def place(self, q: Array, v: Array) -> None:
        """Set the modal state before an impulse."""
        model, record = self.model, self.record
        put(self.blocks, self.places, layout.Q, q)
        put(self.blocks, self.places, layout.V, v)
        record["g_N"], record["g_T"] = model.normal @ q, model.tangential @ q
        record["v_N"], record["v_T"] = model.normal @ v, model.tangential @ v
        for name in layout.RIGID.split():
            record[name] = np.nan
        record["p_rest"] = self.solver.at_rest[0]
        record["T_rest"] = self.solver.at_rest[1] + model.tangential @ self.shift

    @property
    def finer(self) -> int:
        """Steps of the phase in a step of the run."""
        return onset.FINER if self.phase in (CLOSED, OPENED) else 1

    @property
    def now(self) -> int:
        """Steps of the run that have been taken."""
        return int(self.record["now"][0]) // self.finer

    @property
    def time(self) -> float:
        """Time up to which the run has come, s."""
        return float(self.record["now"][0]) * self.solver.step

    def advance(self) -> None:
        """Advance to the end of the next segment and store its results in `segments`."""
        phase, record = self.phase, self.record[0]
        begun, last = self._plan()
        onset.prepare(self)
        tables = skip.prepare(self)
        every = int(record["sample_every"])
        samples = np.empty((count_in(begun, last, every), statistics.SAMPLE))
        rows = np.empty((count_in(begun, last, int(record["row_every"])), 6))
        sticks, modes = np.empty((int(record["stick_room"]), 2)), self.blocks.ravel()
        kernel = tables, skip.workspace_for(tables), self._law, self.tangent
        advance(self.record, modes, samples, rows, sticks, *kernel)
        first, count = -(-begun // every), int(record["samples"])
        t = np.asarray((np.arange(first, first + count) * every + 0.5) * self.solver.step)
        segment = Segment(t, samples[:count], sticks[: int(record["sticks"])], rows[: int(record["rows"])])
        self.segments = [segment]
        if phase == RAMP and record["now"] == self.phase_end:
            self._end_ramp()
        onset.conclude(self)
        if record["stopped"]:
            self.segment_end = 0
        if self.record["now"] >= self.segment_end and not {phase, self.phase} & {CLOSED, OPENED}:
            steady.conclude(self, phase, segment)

    def _plan(self) -> tuple[int, int]:
        """Plan the next segment; return the first step and the one after the last."""
        record, finer = self.record, self.finer
        every, rows = self.sample_every * finer, self.row_every * finer
        now = int(record["now"][0])
        # No skip crosses a multiple of this; segments end there, so that recording changes nothing.
        grid = layout.MAX_SKIP * every
        if now >= self.segment_end:
            self.segment_end = self._segment_end(now, grid)
            # In the first segments, an initial state away from rest may decay within a sample.
            decay = float(self.coarse.model.damping.max()) * self.coarse.model.interval
            self._fine_energy = self.time < self.short and decay > FAST_DECAY
        last = self.segment_end
        if rows:
            piece = grid * max(layout.MOST_ROWS * rows // grid, 1)
            last = min(last, (now // piece + 1) * piece)
        record["last"] = last = min(last, self.pause * finer)
        record["sample_every"], record["next_sample"] = every, -(-now // every) * every
        energy = 1 if self._fine_energy else every
        record["energy_every"], record["next_energy"] = energy, -(-now // energy) * energy
        record["row_every"], record["next_row"] = rows, -(-now // rows) * rows if rows else layout.NEVER
        record["stopped"] = record["samples"] = record["rows"] = record["sticks"] = 0
        step = self.solver.step
        record["stick_room"] = room_for_sticks(now * step, last * step, float(record["least_stick"][0]), step)
        return now, last

    def _segment_end(self, now: int, grid: int) -> int:
        if self.phase == OPENED:
            return self.phase_end
        if self.phase == CLOSED:
            return min(now + round(self.short / self.solver.step), self.phase_end)
        length = min(max(round(self.length / self.step), 1), MOST_STEPS)
        last = (now // grid + (1 if now % grid else max(length // grid, 1))) * grid
        return min(last, self.phase_end) if self.phase == RAMP else last

    def _end_ramp(self) -> None:
        """Stop the acceleration of the clamp, between the impulses of two steps."""
        self.phase = BEFORE_SLIP if self._refines else MOTION
        if not self.shift.any():
            return
        q, v = stopped(self, self.phase_end, *self.between(self.solver))
        self.place(self.values(layout.Q) + q, self.values(layout.V) + v)

    def between(self, solver: Solver) -> tuple[Array, Array]:
        """Displacements and velocities half a step ago, between two impulses."""
        return moved(solver.model, self.values(layout.Q), self.values(layout.V), -0.5 * solver.step)

    def change_to(self, solver: Solver, state: tuple[Array, Array, Array], t: float) -> None:
        """Continue with another model and step from modal state and u at time t, between two impulses."""
        q, v, u = state
        self._use(solver)
        self.shift = np.zeros(len(q))
        self.place(*moved(solver.model, q, v, 0.5 * solver.step))
        # Stick fixes the surfaces at their positions of the next impulse.
        drive = displacement(np.array(t + 0.5 * solver.step), self.scene.speed_per_load, self.ramp)
        shifted = float(self.record["g_T"][0]) + solver.at_rest[1] - float(drive)
        self.record["u_N"], self.record["u_T"], self.record["anchor"] = *u, u[1] + shifted

    @property
    def u(self) -> Array:
        """Gaps of the modes that are not kept, u_N and u_T, after the last step."""
        return np.array([self.record["u_N"][0], self.record["u_T"][0]])

    def stored_energy(self) -> float:
        """Energy of the modes about the equilibrium, the springs, the load and the ramp's push, normalised."""
        q = self.values(layout.Q) + self.shift
        return self._energy_of(q, self.values(layout.V), self.u) - ramp_work(self, q)

    def _energy_of(self, q: Array, v: Array, u: Array) -> float:
        model, K = self.model, self.solver.contact.stiffness
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + model.normal @ q + 0.5 * u @ K @ u)

    def flush(self, floor: float) -> bool:
        """Set what is far below every scale to zero; False where a number is not finite."""
        moving = self.blocks[:, layout.Q : layout.V + 1]
        moving[np.abs(moving) < floor] = 0.0
        return bool(np.isfinite(moving).all())


def checked_step(model: ReducedModel, scene: Normalised, options: RunOptions) -> float:
    """Step of a run, s, after checks of its stability, its length and the uniqueness of its contact force."""
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

    It is at most a hundredth of the duration and a quarter of the time V / (mu N / m) in which friction
    accelerates the contact mass to V; if that is very short, 1e-4 of the step that the modes need.
    """
    step = model.default_step
    if model.K.any() or isinstance(scene.rig, Rig):
        return step
    W = np.diag(model.W)
    catching = scene.speed_per_load / max(scene.mu * float(W[len(W) // 2 :].max()), 1e-300)
    return min(step, max(0.25 * catching, 1e-4 * step, least_step(model, duration)), 0.01 * duration)


def check_falling(model: ReducedModel, scene: Normalised, step: float) -> None:
    """Raise an error if friction falls so steeply that the slip rate of a step under the load is not unique."""
    fall = -scene.mu * scene.friction.slope(0.0)
    if not fall or fall < (most := model.discrete(step).slip.steepest_fall(scene.mu)):
        return
    steps = model.largest_step * 0.5 ** np.arange(0.0, 20.0, 0.25)
    for allowed in steps[[fall < model.discrete(each).slip.steepest_fall(scene.mu) for each in steps]][:1]:
        raise SceneValueError(
            f"step = {step:g}: friction falls so steeply with speed that it must be at most"
            f" {at_most(allowed, 3)} s; beyond, slip is not unique within a step"
        )
    speed = scene.friction.decay_speed * scene.load
    raise SceneValueError(
        f"Friction: decay_speed = {speed:g}: with this scene and step = {step:g} it must be at least"
        f" {speed * fall / most * 1.001:.3g} m/s, or 0 for a jump; below, slip is not unique"
    )


def ramp_work(run: Any, q: Array) -> float:
    """Work of the accelerating clamp on the inertia of P2 over modal displacements."""
    return float(np.sum(run.model.stiffness * run.shift * q))


def stopped(run: Any, end: int, before_q: Array, before_v: Array) -> tuple[Array, Array]:
    """End the ramp after `end` steps; return the change of the modal state, which is given half a step earlier."""
    push = run.model.inertia * run.scene.speed_per_load / run.ramp * (run.ramp - end * run.step)
    q, v = moved(run.model, run.shift, push, 0.5 * run.step)
    run.record["work"] += ramp_work(run, before_q + run.shift)
    run.record["work"] += np.sum(push * (before_v + 0.5 * push))
    run.shift = np.zeros(len(q))
    return q, v


def moved(model: ReducedModel, q: Array, v: Array, time: float) -> tuple[Array, Array]:
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
