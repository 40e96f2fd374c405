"""The finer model of the onset, and a run's state handed over to it and back.

The first separation is reached by a growth that lives partly above the cut-off (with the paper's rig at 54 and 96
kHz), and the burst that follows begins with what has grown there. Unless a cut-off is given, the few milliseconds
from just before the first slip to just after the first separation are therefore taken with HIGHER times the
cut-off, 1 / FINER of the step and the damping that the published scheme adds there of itself.

States are those at the start of a step, midway between two impulses, where a lasting force deflects the modes
further than it does without impulses; coordinates are deviations from the equilibrium under the unit load.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fivcore.contact.ablation import modified
from fivcore.contact.reduced import default_cutoff, reduced_model
from fivcore.errors import ContactError
from fivcore.jit import Array
from fivcore.transient.drive import Normalised
from fivcore.transient.fast_solver import Solver, frozen_solver
from fivcore.transient.options import Options
from fivcore.transient.published import ADDED_DAMPING

# How much finer the steps are, and how far the cut-off is raised.
FINER, HIGHER = 5, 5.0
# For how long before the first slip, so that what the change of model stirs up dies away, for how long to the
# first separation at most, and after it, s.
LEAD, LONGEST, AFTER = 3e-3, 21e-3, 3e-3
# With more material damping than that, s, nothing grows above the cut-off.
MOST_DAMPING = 1e-7


def finer_solver(scene: Normalised, step: float, options: Options) -> Solver | None:
    """More modes, and `FINER` steps for one; None where that is no use or would have no unique contact force."""
    # With much damping nothing grows up there; with every mode kept the element is no spring to start from.
    if scene.rig.d2 > MOST_DAMPING:
        return None
    rig = replace(scene.rig, d2=scene.rig.d2 + ADDED_DAMPING)
    model = reduced_model(rig, scene.theta, HIGHER * default_cutoff(rig), options.termination)
    if not model.K.any():
        return None
    model = modified(model, options.modify)
    if step / FINER > model.largest_step:
        return None
    try:
        return frozen_solver(model, scene.mu, step / FINER)
    except ContactError:
        return None


def prolong(few: Solver, many: Solver, q: Array, v: Array, u: Array) -> tuple[Array, Array, Array]:
    """Displacements, velocities and the element's state with more modes.

    What was not kept follows the contact force statically, and so does what still is not.
    """
    model = many.model
    common = few.model.kept[model.kept]
    force = few.impulse.stiffness @ u
    displaced, moving = np.zeros(len(common)), np.zeros(len(common))
    displaced[common], moving[common] = q - few.between_impulses(force), v
    more = ~common
    push = model.normal[more] * (force[0] - 1.0) + model.tangential[more] * force[1]
    displaced[more] = push / model.stiffness[more]
    return (
        displaced + many.between_impulses(force),
        moving,
        np.asarray(np.linalg.solve(many.impulse.stiffness, force)),
    )


def restrict(many: Solver, few: Solver, q: Array, v: Array, u: Array, touches: bool) -> tuple[Array, Array, Array]:
    """The same with fewer modes: what is no longer kept stays at the contact as the element's state."""
    model = many.model
    common = few.model.kept[model.kept]
    force = many.impulse.stiffness @ u if touches else np.zeros(2)
    still = q - many.between_impulses(force)
    lost = np.stack([model.normal[~common], model.tangential[~common]]) @ (still + model.rest)[~common]
    # What impulses miss of the modes' flexibility is the element's, with many modes as with few.
    defect = (few.impulse.defect - many.impulse.defect) @ force
    return still[common] + few.between_impulses(force), v[common], u + lost + defect
