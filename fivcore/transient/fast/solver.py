"""Coefficients of a model and a step for `method="fast"`, computed once and shared by scenes of any friction."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fivcore.beams.modes import one_blas_thread, propagator
from fivcore.contact.law import between_impulses
from fivcore.contact.reduced import ReducedModel
from fivcore.jit import Array
from fivcore.transient.fast import layout
from fivcore.transient.statistics import SEPARATION, SLIP, STICK


class Solver:
    """A model and all coefficients of its steps.

    `contact` is the discrete contact law, `at_rest` holds penetration and tangential gap at rest, m per N of load,
    and `places`, (n,), are the positions of the modes in rows of blocks. `blocks`, (any, BLOCK_ROWS, BLOCK), hold
    the modes of a scene at rest, and `record`, (1,), the fields of a scene that model and step determine.
    """

    # Idle BLAS threads keep waiting for work and slow other processes.
    @one_blas_thread()
    def __init__(self, model: ReducedModel, step: float) -> None:
        self.model, self.step = model, step
        gaps, lower = model.shapes, np.tril_indices(2)
        self.contact = contact = model.discrete(step)
        # The unit load also acts in impulses, so the gap at rest has the same defect.
        gap_N, gap_T = (float(gap @ model.static_equilibrium) for gap in gaps)
        self.at_rest = float(contact.defect[0, 0]) - (gap_N + model.load_gap), gap_T - float(contact.defect[1, 0])
        self.places, both, size = places_of(model)
        self.blocks = np.zeros((-(-size // layout.BLOCK), layout.BLOCK_ROWS, layout.BLOCK))
        rows = (*range(layout.Q), layout.OUTPUT, layout.DAMPING)
        flow = propagator(model.stiffness, model.damping, step)
        for row, values in zip(rows, (*flow, *gaps, model.output, model.damping), strict=True):
            put(self.blocks, self.places, row, values)
        self.record = record = np.zeros(1, layout.SCENE)
        # For each previous status; after a touchdown half a step remains.
        rigid, late = not model.K.any(), contact.mean_time
        half = 0.0 if rigid else 0.5 * step
        for status, begin, time in ((SEPARATION, half, half), (STICK, 0.0, late), (SLIP, late, late)):
            record["stick_law"][0, status] = (*contact.stick(begin).flat, time)
        # Change of the gaps and their rates over a step for unit impulses.
        for name, row in (("after_q", flow[1]), ("after_v", flow[3])):
            record[name] = ((gaps * row) @ gaps.T)[lower]
        # In slip u_T has its own rate, which varies during the step.
        varied = contact.tau * contact.stiffness[1, 1] * contact.square_ratio
        for name, values in (
            ("slip", contact.slip),
            ("M", contact.delassus[lower]),
            ("K", contact.stiffness[lower]),
            ("C", np.append(model.dissipation(contact)[lower], varied)),
            ("output", 0.5 * gaps @ model.output),
            ("damped_by", np.array([0.25, 0.5, 0.25]) * ((gaps * model.damping) @ gaps.T)[lower]),
            ("step", step),
            ("rigid", rigid),
        ):
            record[name] = values
        record["modes"], record["blocks"] = size, len(self.blocks)
        record["both"] = first = min(both, layout.BLOCK)
        record["others"] = min(size, layout.BLOCK) - first
        record["next_skip"] = layout.NEVER

    def between_impulses(self, force: Array) -> Array:
        """Additional modal deflection midway between two impulses under a constant contact force."""
        model = self.model
        modal = model.normal * (force[0] - 1.0) + model.tangential * force[1]
        return between_impulses(model.stiffness, self.step) * modal


def places_of(model: ReducedModel) -> tuple[NDArray[np.int64], int, int]:
    """Place of each mode in rows of blocks, number of places for modes that move the tangential gap, and of all.

    Modes that move the tangential gap come first; both kinds are padded to multiples of four for vector registers.
    """
    others = model.tangential == 0.0
    first, last = (-(-int(kind.sum()) // 4) * 4 for kind in (~others, others))
    places = np.where(others, first + np.cumsum(others), np.cumsum(~others)) - 1
    return places, first, first + last


def put(blocks: Array, places: NDArray[np.int64], row: int, values: Array) -> None:
    """Write a row of modes into blocks."""
    blocks[:, row].flat[places] = values


def take(blocks: Array, places: NDArray[np.int64], row: int) -> Array:
    """Read a row of modes from blocks."""
    return blocks[:, row].ravel()[places]


# Computed once for all mu, V and F.
solver_of = lru_cache(maxsize=64)(Solver)
