"""A finer model for the onset of vibration, and the transfer of a run's state to it and back.

The growth that leads to the first separation lies partly above the cut-off (54 to 145 kHz with the paper's rig)
and determines how the first burst begins. Unless a cut-off is given, a run therefore uses a finer model from
`LEAD` before the first slip until `AFTER` after the first separation, with `HIGHER` times the cut-off and 1 /
`FINER` of the step. The finer model is not used if sliding is stable in the run's own model, so that vibration
begins at the friction at which that model loses its linear stability.

States refer to the start of a step, midway between two impulses, where a constant force deflects the modes further
than it would without impulses. Coordinates are deviations from the equilibrium under the unit load.
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

# Phases of a run in order: ramp of the drive; until shortly before slip; with the finer model until the contact
# opens and for a while after; all later motion.
RAMP, BEFORE_SLIP, CLOSED, OPENED, MOTION = range(5)

FINER, HIGHER = 4, 4.0
# Time before the first slip, in which the transient of the model change decays; longest time to separation; time
# after it, s.
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
    """Change to more modes and finer steps."""
    now, (q, v) = run.now, run.between(run.coarse)
    run.change_to(fine, prolong(run.coarse, fine, q, v, run.u), now * run.step)
    run.record["now"] = now * FINER
    run.phase, run.segment_end = CLOSED, 0
    run.phase_end = (now + round(LONGEST / run.step)) * FINER


def _leave(run: Any) -> None:
    """Return to the modes and steps of the run."""
    fine, now, touches = run.solver, run.now, bool(run.record["contact"] != SEPARATION)
    q, v = run.between(fine)
    run.change_to(run.coarse, restrict(fine, run.coarse, q, v, run.u, touches), now * run.step)
    run.record["now"], run.phase, run.segment_end = now, MOTION, 0


def finer_cutoff(rig: ContactModel) -> float:
    """Cut-off of the finer model, Hz."""
    return HIGHER * default_cutoff(rig)


def finer_solver(scene: Normalised, step: float, options: Options) -> Solver | None:
    """The finer solver, or None if damping, rigid contact or a lack of uniqueness rules it out."""
    # With more material damping than this, s, nothing grows above the cut-off.
    if scene.rig.d2 > 1e-7:
        return None
    model = reduced_model(scene.rig, scene.theta, finer_cutoff(scene.rig))
    # Without truncated modes there is no u that `prolong` could determine.
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
    """Transfer the state to the model with fewer modes; u takes over the gaps of the omitted modes."""
    model, common = many.model, few.model.kept[many.model.kept]
    force = many.contact.stiffness @ u if touches else np.zeros(2)
    still = q - many.between_impulses(force)
    lost = model.shapes[:, ~common] @ (still + model.static_equilibrium)[~common]
    # Each u includes the compliance defect of its own step (`fivcore.contact.law`).
    defect = (few.contact.defect - many.contact.defect) @ force
    return still[common] + few.between_impulses(force), v[common], u + lost + defect
