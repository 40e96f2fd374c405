"""What the steps of `method="fast"` need of a model, a friction and a step; made once and shared by scenes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from fivcore.beams.free_motion import propagator
from fivcore.beams.modes import one_blas_thread
from fivcore.contact.impulse import between_impulses
from fivcore.contact.law import regime_maps
from fivcore.contact.reduced import ReducedModel
from fivcore.errors import not_unique
from fivcore.jit import Array
from fivcore.transient import fast_scene as at

# Modes come in eights, so that vector registers are full.
EIGHT = 8


class Solver:
    """A model with everything that its steps need.

    Attributes
    ----------
    model : ReducedModel
    mu, step : float
    impulse : Impulse
        How impulses see the model.
    maps : RegimeMaps
    dissipation : ndarray, (2, 2)
        What the dashpot loses, from the mean rates of the gaps over a step.
    at_rest : tuple of float
        Penetration and tangential gap at rest.
    size : int
        Places for modes: their number rounded up.
    blocks : ndarray, (blocks, BLOCK_ROWS, BLOCK)
        Modes of a scene at rest.
    record : ndarray of SCENE, (1,)
        A scene with the numbers that this solver knows.
    """

    # Idle BLAS threads wait for more work, at the cost of whoever else computes on this machine.
    @one_blas_thread()
    def __init__(self, model: ReducedModel, mu: float, step: float) -> None:
        self.model, self.mu, self.step = model, mu, step
        critical = model.critical_mu(step, mu)
        if mu >= critical:
            raise not_unique(mu, critical)
        self.impulse = impulse = model.impulse(step)
        self.maps = regime_maps(impulse.stiffness, impulse.damping, impulse.mobility, mu, step)
        # The mean rate of a gap over an impulse is less than that of the element within it, by what impulses miss.
        element = bool(model.K.any())
        rates = np.linalg.solve(impulse.stiffness, model.K) if element else np.eye(2)
        self.dissipation = np.asarray(rates.T @ model.C @ rates)
        # Of the unit load impulses see what they see of a contact force.
        self.at_rest = (
            float(impulse.defect[0, 0] - model.normal @ model.rest),
            float(model.tangential @ model.rest - impulse.defect[1, 0]),
        )
        self.size = -(-len(model.rest) // EIGHT) * EIGHT
        self.blocks = np.zeros((-(-self.size // at.BLOCK), at.BLOCK_ROWS, at.BLOCK))
        flow = propagator(model.stiffness, model.damping, step)
        rows = {at.NORMAL: model.normal, at.TANGENTIAL: model.tangential}
        rows |= {at.POINT_B: model.point_b, at.DAMPING: model.damping}
        for row, values in (*zip((at.A, at.B, at.C, at.D), flow, strict=True), *rows.items()):
            put(self.blocks, row, values)
        self.record = self._record()

    def _record(self) -> Any:
        maps, model, step = self.maps, self.model, self.step
        record = np.zeros(1, at.SCENE)
        law = {
            "stick": maps.stick, "enter": maps.entering, "land": maps.landing, "ahead": maps.slip[0],
            "back": maps.slip[1],
        }  # fmt: skip
        for regime, values in law.items():
            fields = [name for name in at.SCENE.names or () if name.startswith(f"{regime}_") and len(name) <= 8]
            for name, value in zip(fields, values.ravel(), strict=True):
                record[name] = value
        symmetric = {"M": self.impulse.mobility, "K": self.impulse.stiffness, "C": self.dissipation}
        for letter, matrix in symmetric.items():
            for name, place in (("NN", (0, 0)), ("NT", (1, 0)), ("TT", (1, 1))):
                record[f"{letter}_{name}"] = matrix[place]
        (record["relax_NN"], record["relax_NT"]), (record["relax_TN"], record["relax_TT"]) = maps.separation
        record["enter_offset"], record["land_offset"] = maps.mean_offset, maps.landing_offset
        # In slip u_T has a rate of its own, which varies over the step.
        record["C_slip"] = self.impulse.damping[1, 1] * maps.square_ratio
        record["mu"], record["step"], record["per_step"] = self.mu, step, 1.0 / step
        # Without an element half the force of lasting contact is what a landing needs.
        record["rigid"] = not model.K.any()
        record["landing_share"] = 0.5 if record["rigid"] else 1.0
        record["B_N"], record["B_T"] = 0.5 * model.point_b @ model.normal, 0.5 * model.point_b @ model.tangential
        record["modes"], record["blocks"], record["skip_at"] = self.size, len(self.blocks), -1
        record["next_skip"] = at.NEVER
        return record

    def between_impulses(self, force: Array) -> Array:
        """How much further a steady contact force in impulses deflects the modes, midway between two of them."""
        model = self.model
        modal = model.normal * (force[0] - 1.0) + model.tangential * force[1]
        return between_impulses(model.stiffness, self.step) * modal


def put(blocks: Array, row: int, values: Array) -> None:
    """Write a row of modes into blocks."""
    padded = np.zeros(len(blocks) * at.BLOCK)
    padded[: len(values)] = values
    blocks[:, row] = padded.reshape(-1, at.BLOCK)


def take(blocks: Array, row: int, count: int) -> Array:
    """Read a row of modes from blocks."""
    return blocks[:, row].ravel()[:count].copy()


@lru_cache(maxsize=64)
def frozen_solver(model: ReducedModel, mu: float, step: float) -> Solver:
    """The solver of a contact point that stays, built once: such steps do not change it, whatever V and F."""
    return Solver(model, mu, step)
