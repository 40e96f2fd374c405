"""What the steps of `fivcore.fast` need of a model, made once for it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fivcore.bases import one_blas_thread
from fivcore.contact_law import regime_maps
from fivcore.kernel import Array
from fivcore.propagation import propagator
from fivcore.reduced import ReducedModel
from fivcore.uniqueness import check_unique


class Solver:
    """A model with everything that its steps need."""

    # Idle BLAS threads wait for more work, at the cost of whoever else computes on this machine.
    @one_blas_thread()
    def __init__(self, model: ReducedModel, mu: float, step: float) -> None:
        self.model, self.step, self.W = model, step, model.W
        check_unique(model, mu, step)
        flow = propagator(model.stiffness, model.damping, step)
        self.model_arrays = (flow, model.damping, model.normal.copy(), model.tangential.copy(), model.point_b)
        maps = regime_maps(model.K, model.C, self.W, mu, step)
        self.laws = tuple(float(x) for part in maps for x in np.ravel(part))
        # Without an element half the force of lasting contact is what a landing needs.
        self.landing = 1.0 if model.K.any() else 0.5
        self.at_rest = (-float(model.normal @ model.rest), float(model.tangential @ model.rest))


@lru_cache(maxsize=64)
def frozen_solver(model: ReducedModel, mu: float, step: float) -> Solver:
    """The solver of a contact point that stays, built once: such steps do not change it, whatever V and F."""
    return Solver(model, mu, step)


def kicked(solver: Solver, force: Array) -> Array:
    """How much further a steady force deflects the modes between two kicks than it does as a steady force."""
    model = solver.model
    modal = model.normal * (force[0] - 1.0) + model.tangential * force[1]
    z = 0.5 * solver.step * np.sqrt(model.stiffness)
    small = z < 1e-3
    safe = np.where(small, 1.0, z)
    # h / (2 omega sin(omega h / 2)) - 1 / omega^2 = h^2 / 4 (1 / (z sin z) - 1 / z^2), z = omega h / 2.
    excess = np.where(small, 1.0 / 6.0, 1.0 / (safe * np.sin(safe)) - 1.0 / safe**2)
    return np.asarray(0.25 * solver.step**2 * excess * modal)
