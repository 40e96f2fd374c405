"""A contact point that moves along P2 (`contact_motion`), while P2 slides under P1's tip.

D then moves by X(t) towards P2's clamp or away from it. Gap shapes, residual flexibility and static
equilibrium follow it, the shapes in every step (linearly within stretches of STRETCH), the others once a
stretch; the gap's rate gains the rate of the motion times the slope of P2's deflection. This breaks the
homogeneity in (V, F): how far D moves depends on V itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fivcore.beams.elements import hermite
from fivcore.beams.modes import lower_basis, residual_flexibility, rig_bases
from fivcore.contact.reduced import ReducedModel, equilibrium, full_model, unit_load
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.transient.normalised import Normalised, displacement

# Length of a stretch along P2, m.
STRETCH = 5e-6


@dataclass(frozen=True)
class ContactMotion:
    """Where the contact point is.

    Attributes
    ----------
    scene : Normalised
    ramp : float
    direction : int
        -1: towards P2's clamp, +1: away from it.
    """

    scene: Normalised
    ramp: float
    direction: int

    @property
    def speed(self) -> float:
        """Of D along P2 after the ramp, m/s, signed."""
        return self.direction * self.scene.speed_per_load * self.scene.load

    def position(self, t: float) -> float:
        """Distance of D from P2's clamp, m."""
        moved = self.scene.load * float(displacement(np.array(t), self.scene.speed_per_load, self.ramp))
        return self.scene.rig.contact_position + self.direction * moved

    def check(self, duration: float) -> None:
        """Refuse a run that would leave the beam."""
        beam, start = self.scene.rig.p2, self.scene.rig.contact_position
        # The element next to the clamp hardly moves: contact there is contact with the wall.
        room = start - beam.length / beam.elements if self.direction < 0 else beam.length - start
        if room <= 0.0:
            raise ValueError(
                f"contact_motion = {self.direction}: it must be 0, for at {start:g} m the contact is at P2's end"
            )
        # Within the ramp D moves by speed t^2 / (2 ramp), after it by speed (t - ramp / 2).
        longest = room / abs(self.speed) + 0.5 * self.ramp
        if longest < self.ramp:
            longest = float(np.sqrt(2.0 * self.ramp * room / abs(self.speed)))
        if duration > longest:
            end = "P2's clamp" if self.direction < 0 else "P2's free end"
            raise ValueError(
                f"duration = {duration:g}: it must be at most {longest:.6g} s, when contact_motion ="
                f" {self.direction} reaches {end}"
            )


def shapes_at(rig: Rig, position: float) -> tuple[Array, Array]:
    """Gap shapes of P2's modes with D at `position`: normal and tangential, (modes of P2,)."""
    basis = lower_basis(rig.p2, rig.contact_position)
    axial_row, bending_row = hermite(rig.p2, position)
    along, across, rotation = np.moveaxis(basis.shapes[1:], 0, 1)
    # Not matrix products: BLAS would round differently with the number of its threads.
    normal = np.einsum("i,in->n", bending_row[0::2], across) + np.einsum("i,in->n", bending_row[1::2], rotation)
    return -normal, -np.einsum("i,in->n", axial_row, along)


def moved_model(model: ReducedModel, scene: Normalised, position: float) -> ReducedModel:
    """The model with D elsewhere; tau stays."""
    full = full_model(scene.rig, scene.theta)
    upper, _ = rig_bases(scene.rig, scene.theta)
    n1 = len(upper.stiffness)
    normal, tangential = full.normal.copy(), full.tangential.copy()
    normal[n1:], tangential[n1:] = shapes_at(scene.rig, position)
    kept = model.kept
    K, C, flexibility = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2))
    if model.K.any():
        flexibility = residual_flexibility(full.stiffness[~kept], normal[~kept], tangential[~kept])
        K = np.asarray(np.linalg.inv(flexibility))
        C = np.asarray(model.C[0, 0] / model.K[0, 0] * K)
    load = unit_load(scene.rig, scene.theta)
    rest = equilibrium(model.stiffness, normal[kept], load[kept], float(flexibility[0, 0]))
    return replace(model, normal=normal[kept], tangential=tangential[kept], rest=rest, K=K, C=C)
