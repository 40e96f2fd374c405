"""Runs of `method="fast"` with several contacts: the same splitting, with one coupled contact problem per step.

The overall state is separation if no contact is closed, slip if one slips, and stick otherwise. N and T are the
sums over all contacts, the slip rate is the largest. Values of each contact are in further columns of `rows` and
in `counters`.
"""

from __future__ import annotations

from typing import Any
from warnings import warn

import numpy as np

from fivcore.beams.modes import one_blas_thread, propagator
from fivcore.contact.law import between_impulses
from fivcore.contact.reduced import ReducedModel, modified, reduced_model
from fivcore.contact.several import step_matrices
from fivcore.contact.step_map import at_most
from fivcore.errors import ContactError, SceneValueError, not_unique
from fivcore.jit import Array
from fivcore.transient.fast import several_kernel as kernels
from fivcore.transient.fast.run import FAST_DECAY, default_step, least_step, moved, ramp_work, stopped
from fivcore.transient.fast.several_kernel import Law, Motion, take_steps
from fivcore.transient.normalised import Normalised, State, residual_gaps, status_of_all
from fivcore.transient.options import RunOptions
from fivcore.transient.statistics import FIELDS, SEPARATION, SLIP, STICK, first_counted
from fivcore.transient.stepped import Run

# Steps of a segment; share of unsolved steps that raises an error; number of contacts that triggers a warning.
SEGMENT, MOST_UNSOLVED, MANY = 20_000, 1e-3, 20
_COUNTS = "contact now last settle sample_every row_every energy_every look_every samples rows"
SCENE = np.dtype([
    *FIELDS,
    *((name, "f8") for name in ("speed", "ramp", "acceleration", "any_open", "all_stick")),
    *((name, "i8") for name in _COUNTS.split()),
])  # fmt: skip


class SeveralRun(Run):
    """One run; `counts` holds Newton steps, factorisations, lost pivots, Gauss-Seidel steps and unsolved steps."""

    READ_AT = 0.5

    def __init__(self, scene: Normalised, options: RunOptions) -> None:
        self.model = model = modified(reduced_model(scene.rig, scene.theta, options.cutoff), options.modify)
        step, c, n = checked_step(model, scene, options), len(model.normal), len(model.stiffness)
        self.row_size = 6 + 4 * c
        super().__init__(scene, options, step, SEGMENT, SCENE)
        starts = options.initial is None or not options.initial.running
        self.ramp, self.shift = options.ramp if starts and options.ramp >= step else 0.0, np.zeros(n)
        self.law, self.counts = law_of(model, scene, step), np.zeros(5, np.int64)
        record, speed = self.record, scene.speed_per_load
        record["speed"], record["ramp"] = speed, self.ramp
        record["acceleration"] = speed / self.ramp if self.ramp else 0.0
        fast = float(model.damping.max()) * model.interval > FAST_DECAY
        record["energy_every"] = 1 if fast else record["sample_every"]
        record["settle"] = first_counted(record["settled_from"][0], step, 0.5)
        self._start(options.initial)

    def _start(self, initial: State | None) -> None:
        model, law, step, speed = self.model, self.law, self.step, self.scene.speed_per_load
        (c, n), status, u = model.normal.shape, np.where(law.closed, STICK, SEPARATION), law.flexibility @ law.rest
        q, v = np.zeros((2, n))
        if initial is not None:
            q = initial.displacement[model.kept] - model.static_equilibrium
            v = initial.velocity[model.kept].copy()
            status = np.full(c, initial.contact) if initial.statuses is None else np.array(initial.statuses)
            if model.K.any():
                u = residual_gaps(self.scene, model.kept, initial) - model.load_gap
                u = np.where(np.tile(status, 2) == SEPARATION, u, law.flexibility @ (model.K @ u))
        force = np.where(np.tile(status, 2) == SEPARATION, 0.0, law.rest)
        runs = initial is not None and initial.running
        if runs:
            q += self._between(force)
        elif self.ramp > 0.0:
            # In the accelerating frame elastic modes rest elsewhere.
            elastic = model.stiffness > 0.0
            self.shift[elastic] = (model.inertia * speed / self.ramp)[elastic] / model.stiffness[elastic]
            self.record["work"] -= ramp_work(self, q)
        else:
            v += model.inertia * speed
        self._first_energy = self._energy_of(q, v)
        first, rates = moved(model, q - self.shift, v, 0.5 * step)
        anchor = u[c:] + model.tangential @ q + law.at_rest[c:]
        if runs:
            # Stick fixes the surfaces at their positions of the first impulse.
            u[c:] -= 0.5 * step * (model.tangential @ rates - speed) * model.K.any()
            anchor = u[c:] + model.tangential @ first + law.at_rest[c:] - 0.5 * step * speed
        matrix = law.matrix[np.append(np.full(c, STICK), status), np.arange(2 * c)]
        work, places, counters = (
            np.zeros((8, 2 * c)),
            np.zeros((2, 2 * c), np.uint64),
            np.zeros((c, kernels.COUNTERS)),
        )
        self.motion = Motion(
            first, rates, u, force, model.shapes @ rates, anchor, np.zeros(c), status.astype(np.int64),
            status.astype(np.int64), counters, matrix.copy(), np.eye(2 * c), work, places, np.zeros(n),
        )  # fmt: skip
        self._place_shift()
        self.record["contact"] = status_of_all(status)

    def _place_shift(self) -> None:
        """Set the gaps at rest to those in the accelerating frame."""
        at_rest = rest_gaps(self.model, self.step) + np.repeat([-1.0, 1.0], len(self.motion.slip)) * (
            self.model.shapes @ self.shift
        )
        self.law = self.law._replace(at_rest=at_rest)

    def _take(self, first: int, last: int, samples: Array, rows: Array, sticks: Array) -> None:
        record, end = self.record, int(self.ramp / self.step)
        record["look_every"] = np.gcd.reduce([record[f"{name}_every"][0] for name in ("sample", "row", "energy")])
        record["last"] = min(last, end) if first < end else last
        arrays = self.motion, self.counts
        while True:
            take_steps(record, self.law, *arrays, samples, rows, sticks)
            if record["now"] == end and self.shift.any():
                self._end_ramp(end)
            if record["now"] >= last:
                break
            record["last"] = last
        if self.counts[2]:
            text = "the contact met statuses in which its forces are not unique (Painleve)"
            raise ContactError(f"mu = {self.scene.mu:g}: by t = {last * self.step:.6g} s {text}")
        if self.counts[4] > max(MOST_UNSOLVED * last, 10):
            text = (
                f"the contact problem of {self.counts[4]} of {last} steps was not solved; use a shorter step than"
            )
            raise ContactError(f"{text} {self.step:.3g} s")

    def _end_ramp(self, end: int) -> None:
        """Stop the acceleration of the base, between the impulses of two steps."""
        motion = self.motion
        q, v = stopped(self, end, *moved(self.model, motion.q, motion.v, -0.5 * self.step))
        motion.q[:] += q
        motion.v[:] += v
        self._place_shift()

    def _between(self, force: Array) -> Array:
        """Additional modal deflection midway between two impulses under constant contact forces."""
        return between_impulses(self.model.stiffness, self.step) * (self.model.shapes.T @ (force - self.law.rest))

    def state(self) -> tuple[Array, Array, Array]:
        """Displacements from rest and velocities of the modes, and the gaps of the others, between two steps."""
        model, motion, step = self.model, self.motion, self.step
        q, v = moved(model, motion.q, motion.v, -0.5 * step)
        u = motion.u + model.load_gap
        if model.K.any():
            drive = self.scene.speed_per_load * min(self.time / self.ramp if self.ramp else 1.0, 1.0)
            c = len(motion.slip)
            rates = model.shapes @ v - np.repeat([0.0, drive], c)
            rates[c:] *= motion.status == STICK
            closed = model.flexibility @ motion.force - 0.5 * step * rates + model.load_gap
            u = np.where(np.tile(motion.status, 2) == SEPARATION, u, closed)
        return q + self.shift - self._between(motion.force), v, np.asarray(u)

    @property
    def statuses(self) -> Array:
        """Status of each contact, (c,): 0 separation, 1 stick, 2 slip."""
        return np.minimum(self.motion.status, SLIP)

    def resumed(self, options: RunOptions) -> Any:
        """Return a run that continues this one after its end."""
        run = super().resumed(options)
        run.motion.counters[:], run.counts[3:] = 0.0, 0
        run.record["any_open"] = run.record["all_stick"] = 0.0
        return run

    def by_contact(self) -> dict[str, Any]:
        """Figures of each contact, (c,), in the scene's units; NaN before statistics begin."""
        F, table = self.scene.load, self.motion.counters.copy()
        times = table[:, : kernels.OPEN_TIME + 1].T
        total = times[:, 0].sum()
        if not (self.time > float(self.record["settled_from"][0]) and total > 0.0):
            table[:] = total = np.nan
        shares = dict(zip(("stick", "slip", "separation"), times / total, strict=True))
        return {f"contact_{name}_fraction": share for name, share in shares.items()} | {
            "contact_mean_normal_force": F * table[:, kernels.SUM_N] / total,
            "contact_max_normal_force": F * table[:, kernels.MAX_N],
            "contact_max_slip_speed": F * table[:, kernels.MAX_SLIP],
            "contact_switches_per_second": table[:, kernels.SWITCHES] / total,
            "any_open_fraction": float(self.record["any_open"][0]) / total,
            "all_stick_fraction": float(self.record["all_stick"][0]) / total,
            "unsolved_steps": int(self.counts[4]),
        }

    def stored_energy(self) -> float:
        """Energy of the modes about the equilibrium, the load and the ramp's push, normalised; no springs."""
        q = self.motion.q + self.shift
        return self._energy_of(q, self.motion.v) - ramp_work(self, q)

    def _energy_of(self, q: Array, v: Array) -> float:
        model = self.model
        return float(0.5 * np.sum(v**2 + model.stiffness * q**2) + self.law.rest @ (model.shapes @ q))

    def flush(self, floor: float) -> bool:
        """Set what is far below every scale to zero; False where a number is not finite."""
        for part in (self.motion.q, self.motion.v):
            part[np.abs(part) < floor] = 0.0
        return bool(np.isfinite(self.motion.q).all() and np.isfinite(self.motion.v).all())


def rest_gaps(model: ReducedModel, step: float) -> Array:
    """Penetrations and tangential gaps at rest at the impulses, (2c,), m per N of load."""
    c = len(model.normal)
    gaps = model.shapes @ model.static_equilibrium + model.load_gap + np.append(model.gap, np.zeros(c))
    # The load also acts in impulses, so the gap at rest has the same defect.
    missed = model.discrete(step).defect @ np.append(model.forces, np.zeros(c))
    return np.repeat([-1.0, 1.0], c) * (gaps - missed)


@one_blas_thread()
def law_of(model: ReducedModel, scene: Normalised, step: float) -> Law:
    """Constants of a step of a scene with several contacts."""
    contact, c, rigid = model.discrete(step), len(model.normal), not model.K.any()
    falls, M, S = not scene.friction.constant, contact.delassus, contact.flexibility
    keep = float(np.exp(-step / contact.tau)) if contact.tau else 0.0
    matrix, times = step_matrices(contact)
    unit = float(np.diag(matrix[STICK]).mean())
    mu = scene.mu * np.asarray(model.friction)
    return Law(
        model.shapes.copy(), propagator(model.stiffness, model.damping, step), model.output.copy(),
        model.damping.copy(), np.array(S), np.array(M), matrix / unit, unit, times,
        np.append(model.forces, np.zeros(c)), rest_gaps(model, step), np.asarray(model.forces) > 0.0,
        mu, mu if falls else mu * scene.friction.kinetic_ratio, falls, scene.friction.law, step, keep,
        1.0 if rigid else step / (1.0 - keep), rigid,
    )  # fmt: skip


def checked_step(model: ReducedModel, scene: Normalised, options: RunOptions) -> float:
    """Step of a run, s, if it is stable and not too short."""
    least, step, c = least_step(model, options.duration), options.step, len(model.normal)
    if not np.any(model.forces):
        text = "a larger load or smaller gaps would"
        raise SceneValueError(f"F = {scene.load / scene.rig.preload:g}: it closes none of {c} contacts; {text}")
    if step is None:
        step = default_step(model, scene, options.duration)
    if step > model.largest_step:
        raise SceneValueError(
            f"step = {step:g}: with these modes it must be at most {at_most(model.largest_step, 3)} s; beyond, the"
            " contact is unstable"
        )
    if step < least:
        raise SceneValueError(f"step = {step:g}: it must be at least {least:g} s over this duration")
    if scene.mu >= (most := model.painleve_mu(step)):
        steps = step * 0.5 ** np.arange(0.5, 8.0, 0.5)
        for shorter in (each for each in steps if each > least and scene.mu < model.painleve_mu(float(each))):
            raise SceneValueError(
                f"step = {step:g}: with mu = {scene.mu:g} it must be at most {at_most(float(shorter), 3)} s;"
                f" beyond, the contact forces are not unique from mu = {most:.6g} on (Painleve)"
            )
        raise not_unique(scene.mu, most)
    if c > MANY:
        # 20 chattering contacts take 6 microseconds per step.
        text = f"{c} contacts: some {8e-10 * c**3 / step:.2g} s of computation for each simulated second"
        warn(f"{text}; fewer, or a lower cutoff, take less", stacklevel=2)
    return step
