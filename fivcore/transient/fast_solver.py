"""What the steps of `fivcore.transient.fast` need of a model, made once for it."""

from __future__ import annotations

from functools import lru_cache
from typing import cast

import numpy as np

from fivcore.beams.free_motion import propagator
from fivcore.beams.modes import one_blas_thread
from fivcore.contact.impulse import between_kicks
from fivcore.contact.law import regime_maps
from fivcore.contact.reduced import ReducedModel
from fivcore.contact.uniqueness import check_unique
from fivcore.jit import Array
from fivcore.transient.lane_rows import UNEVENNESS


class Solver:
    """A model with everything that its steps need."""

    # Idle BLAS threads wait for more work, at the cost of whoever else computes on this machine.
    @one_blas_thread()
    def __init__(self, model: ReducedModel, mu: float, step: float) -> None:
        self.model, self.mu, self.step = model, mu, step
        check_unique(model, mu, step)
        flow = propagator(model.stiffness, model.damping, step)
        self.model_arrays = (flow, model.damping, model.normal.copy(), model.tangential.copy(), model.point_b)
        self.missed, self.K, self.C, self.mobility = model.kicks(step)
        maps = regime_maps(self.K, self.C, self.mobility, mu, step)
        self.laws = tuple(float(x) for part in maps for x in np.ravel(part))
        # Without an element half the force of lasting contact is what a landing needs.
        self.landing = 1.0 if model.K.any() else 0.5
        self._lay_out(flow)
        # Penetration and tangential gap at rest: of the unit load kicks see what they see of a contact force.
        self.at_rest = (
            float(self.missed[0, 0] - model.normal @ model.rest),
            float(model.tangential @ model.rest - self.missed[1, 0]),
        )

    def _lay_out(self, flow: Array) -> None:
        """For `fivcore.transient.fast_kernel`: where each mode goes, and a lane's coefficients and numbers."""
        model = self.model
        felt = model.normal != 0.0, model.tangential != 0.0
        kinds = [np.flatnonzero(felt[0] & felt[1]), np.flatnonzero(felt[0] > felt[1]), np.flatnonzero(~felt[0])]
        self.sizes = cast(tuple[int, int, int], tuple(len(kind) + len(kind) % 2 for kind in kinds))
        starts = np.concatenate([[0], np.cumsum(self.sizes)])
        self.place = np.empty(len(model.normal), dtype=np.intp)
        for kind, start in zip(kinds, starts[:-1], strict=True):
            self.place[kind] = start + np.arange(len(kind))
        shapes = (model.normal, model.tangential)
        columns = []
        for kind, size, own in zip(kinds, self.sizes, (shapes, shapes[:1], shapes[1:]), strict=True):
            column = np.zeros((size, len(own) + 4))
            column[: len(kind)] = np.stack([*own, *flow])[:, kind].T
            columns.append(column.ravel())
        self.coefficients = np.concatenate(columns)
        M, K, step = self.mobility, self.K, self.step
        # What the dashpot loses: the mean rate of a gap over a kick is less than that of the element within it, by
        # what kicks miss. In slip u_T has a rate of its own.
        rates = np.linalg.solve(K, model.K) if K.any() else np.eye(2)
        loss = rates.T @ model.C @ rates
        on_b = 0.5 * float(model.point_b @ model.normal), 0.5 * float(model.point_b @ model.tangential)
        parts = [number for m in (M, K, loss) for number in (m[0, 0], m[1, 0], m[1, 1])]
        rigid = float(self.landing != 1.0)
        times = [step, 1.0 / step]
        self.given = np.array([*self.laws, self.mu, *times, *parts, *on_b, self.landing, rigid])
        if loss.any():
            self.given[UNEVENNESS] *= self.C[1, 1] / loss[1, 1]

    def placed(self, normal: Array, tangential: Array) -> Array:
        """Changes of the gap shapes, mode by mode in the order of the lanes: P2's, each in its own direction."""
        column = np.zeros(sum(self.sizes))
        column[self.place] = normal + tangential
        return column

    def between_kicks(self, force: Array) -> Array:
        """How much further a steady contact force in kicks deflects the modes, midway between two of them."""
        model = self.model
        modal = model.normal * (force[0] - 1.0) + model.tangential * force[1]
        return between_kicks(model.stiffness, self.step) * modal


@lru_cache(maxsize=64)
def frozen_solver(model: ReducedModel, mu: float, step: float) -> Solver:
    """The solver of a contact point that stays, built once: such steps do not change it, whatever V and F."""
    return Solver(model, mu, step)
