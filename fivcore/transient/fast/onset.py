"""A finer model for the onset of vibration, and the transfer of a run's state to it and back.

The first separation follows a growth that lives partly above the cut-off (with the paper's rig at 54 to 145 kHz),
and the first burst begins with what has grown there. Unless a cut-off is given, the run therefore uses a finer
model from `LEAD` before the first slip to `AFTER` after the first separation: `HIGHER` times the cut-off and
1 / `FINER` of the step. Where sliding is stable in the run's own model it does not: the motion begins to vibrate
at the friction at which that model loses its linear stability.

A state is that at the start of a step, midway between two impulses, where a lasting force deflects the modes
further than without impulses. Coordinates are deviations from the equilibrium under the unit load.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fivcore.contact.reduced import default_cutoff, modified, reduced_model
from fivcore.jit import Array
from fivcore.rig import ContactModel
from fivcore.transient.fast.solver import Solver, solver_of
from fivcore.transient.normalised import Normalised
from fivcore.transient.options import Options
from fivcore.transient.statistics import SEPARATION

# Phases of a run, in order: while the drive starts; until the contact is about to slip; with the finer model,
# until contact opens and for a while after; the motion from then on.
RAMP, BEFORE_SLIP, CLOSED, OPENED, MOTION = range(5)

FINER, HIGHER = 4, 4.0
# Before the first slip, until what the change of model excites is gone; longest to separation; after it, s.
LEAD, LONGEST, AFTER = 3e-3, 21e-3, 3e-3


def prepare(run: Any) -> None:
    """Let the next segment of a run end where the contact is about to slip, or opens."""
    run.record["threshold"] = run.lead * run.scene.mu if run.phase == BEFORE_SLIP else np.inf
    run.record["until_open"] = run.phase == CLOSED


def conclude(run: Any) -> None:
    """Change to the finer model where the contact is about to slip, and back after the first separation."""
    record, phase = run.record, run.phase
    now, stopped = int(record["now"][0]), bool(record["stopped"][0])
    opened = not np.isnan(record["first_separation"][0])
    if phase == BEFORE_SLIP and stopped:
        run.phase = MOTION
        if not opened and run.fine is not None:
            _enter(run, run.fine)
    elif phase == CLOSED and (stopped or opened or now >= run.phase_end):
        last = (-(-now // FINER) + round(AFTER / run.step)) * FINER
        run.phase, run.phase_end, run.segment_end = OPENED, last, 0
    elif phase == OPENED and now >= run.phase_end:
        _leave(run)


def _enter(run: Any, fine: Solver) -> None:
    """Go on with more modes and finer steps."""
    now, (q, v) = run.now, run.between(run.coarse)
    run.change_to(fine, prolong(run.coarse, fine, q, v, run.u), now * run.step)
    run.record["now"] = now * FINER
    run.phase, run.segment_end = CLOSED, 0
    run.phase_end = (now + round(LONGEST / run.step)) * FINER


def _leave(run: Any) -> None:
    """Go on with the modes and steps of the run."""
    fine, now, touches = run.solver, run.now, bool(run.record["contact"] != SEPARATION)
    q, v = run.between(fine)
    run.change_to(run.coarse, restrict(fine, run.coarse, q, v, run.u, touches), now * run.step)
    run.record["now"], run.phase, run.segment_end = now, MOTION, 0


def finer_cutoff(rig: ContactModel) -> float:
    """Cut-off of the finer model, Hz."""
    return HIGHER * default_cutoff(rig)


def finer_solver(scene: Normalised, step: float, options: Options) -> Solver | None:
    """The finer solver; None where damping, a rigid contact or uniqueness of force or slip rule it out."""
    # With more material damping, s, nothing grows above the cut-off.
    if scene.rig.d2 > 1e-7:
        return None
    model = reduced_model(scene.rig, scene.theta, finer_cutoff(scene.rig))
    # With every mode kept there is no u that `prolong` could find.
    if not model.K.any():
        return None
    model, step, fall = modified(model, options.modify), step / FINER, -scene.mu * scene.friction.slope(0.0)
    # The phase is too short for the energy to grow: the limit of linear stability is enough.
    if step > model.largest_step / model.largest_share or scene.mu >= model.painleve_mu(step):
        return None
    unique = not fall or fall < model.discrete(step).slip.steepest_fall(scene.mu)
    return solver_of(model, step) if unique else None


def prolong(few: Solver, many: Solver, q: Array, v: Array, u: Array) -> tuple[Array, Array, Array]:
    """Transfer displacements, velocities and u to the model with more modes.

    The added modes and the new u follow the contact force statically.
    """
    model, common = many.model, few.model.kept[many.model.kept]
    force = few.contact.stiffness @ u
    displaced, moving = many.between_impulses(force), np.zeros(len(common))
    displaced[common] += q - few.between_impulses(force)
    push = model.normal * (force[0] - 1.0) + model.tangential * force[1]
    displaced[~common] += push[~common] / model.stiffness[~common]
    moving[common] = v
    return displaced, moving, many.contact.flexibility @ force


def restrict(many: Solver, few: Solver, q: Array, v: Array, u: Array, touches: bool) -> tuple[Array, Array, Array]:
    """Transfer them to the model with fewer modes; u takes over the gap of the lost modes."""
    model, common = many.model, few.model.kept[many.model.kept]
    force = many.contact.stiffness @ u if touches else np.zeros(2)
    still = q - many.between_impulses(force)
    lost = model.shapes[:, ~common] @ (still + model.static_equilibrium)[~common]
    # Each u includes the compliance defect of its own step (`fivcore.contact.law`).
    defect = (few.contact.defect - many.contact.defect) @ force
    return still[common] + few.between_impulses(force), v[common], u + lost + defect
