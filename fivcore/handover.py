"""The state of a run handed over from one reduced model to another that keeps more modes, and back.

States are those at the start of a step, midway between two kicks, where a lasting force deflects the modes further
than it does without kicks; coordinates are deviations from the equilibrium under the unit load.
"""

from __future__ import annotations

import numpy as np

from fivcore.fast_solver import Solver
from fivcore.kernel import Array


def lifted(few: Solver, many: Solver, q: Array, v: Array, u: Array) -> tuple[Array, Array, Array]:
    """Displacements, velocities and the element's state with more modes.

    What was not kept follows the contact force statically, and so does what still is not.
    """
    model = many.model
    common = few.model.kept[model.kept]
    force = few.K @ u
    displaced, moving = np.zeros(len(common)), np.zeros(len(common))
    displaced[common], moving[common] = q - few.between_kicks(force), v
    more = ~common
    push = model.normal[more] * (force[0] - 1.0) + model.tangential[more] * force[1]
    displaced[more] = push / model.stiffness[more]
    return displaced + many.between_kicks(force), moving, np.asarray(np.linalg.solve(many.K, force))


def restricted(
    many: Solver, few: Solver, q: Array, v: Array, u: Array, touches: bool
) -> tuple[Array, Array, Array]:
    """The same with fewer modes: what is no longer kept stays at the contact as the element's state."""
    model = many.model
    common = few.model.kept[model.kept]
    force = many.K @ u if touches else np.zeros(2)
    still = q - many.between_kicks(force)
    lost = np.stack([model.normal[~common], model.tangential[~common]]) @ (still + model.rest)[~common]
    # What kicks miss of the modes' flexibility is the element's, with many modes as with few.
    missed = (few.missed - many.missed) @ force
    return still[common] + few.between_kicks(force), v[common], u + lost + missed
