"""A contact point D that moves along P2 while P2 slides under P1's tip (`contact_motion`).

D moves by X(t) towards P2's clamp or away from it. The gap shapes follow it in every step, linearly within a
segment of length `STRETCH`; the residual flexibility and the static equilibrium follow once a segment. The gap's
rate gains the rate of this motion times the slope of P2's deflection. The motion is not homogeneous in (V, F), for
the distance that D moves depends on V itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fivcore.beams.elements import hermite
from fivcore.beams.modes import lower_basis, residual_flexibility, rig_bases
from fivcore.contact.reduced import ReducedModel, full_model
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.transient.normalised import Normalised, displacement

# Length of a segment along P2, m.
STRETCH = 5e-6


@dataclass(frozen=True)
class ContactMotion:
    """Position of the contact point in time.

    Attributes
    ----------
    scene : Normalised
    ramp : float
        Of the drive, s.
    direction : int
        -1: towards P2's clamp, +1: away from it.
    """

    scene: Normalised
    ramp: float
    direction: int

    @property
    def speed(self) -> float:
        """Velocity of D along P2 after the ramp, away from the clamp, m/s."""
        return self.direction * self.scene.speed_per_load * self.scene.load

    def position(self, t: float) -> float:
        """Distance of D from P2's clamp, m."""
        moved = self.scene.load * float(displacement(np.array(t), self.scene.speed_per_load, self.ramp))
        return self.scene.rig.contact_position + self.direction * moved

    def check(self, duration: float) -> None:
        """Raise ValueError where D would leave P2 within `duration`, s, or has no room to move."""
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
    """Normal and tangential gap shapes of P2's modes, (modes of P2,), with D at `position`, m from the clamp."""
    basis = lower_basis(rig.p2, rig.contact_position)
    axial_row, bending_row = hermite(rig.p2, position)
    along, across, rotation = np.moveaxis(basis.shapes[1:], 0, 1)
    # Not matrix products: BLAS would round differently with the number of its threads.
    normal = np.einsum("i,in->n", bending_row[0::2], across) + np.einsum("i,in->n", bending_row[1::2], rotation)
    return -normal, -np.einsum("i,in->n", axial_row, along)


def moved_model(model: ReducedModel, scene: Normalised, position: float) -> ReducedModel:
    """Return the model with D at `position`, m from P2's clamp; its modes and tau stay."""
    kept, K, C = model.kept, model.K, model.C
    full, n1 = full_model(scene.rig, scene.theta), len(rig_bases(scene.rig, scene.theta)[0].stiffness)
    normal, tangential = shapes_at(scene.rig, position)
    normal, tangential = np.append(full.normal[:n1], normal), np.append(full.tangential[:n1], tangential)
    if K.any():
        residual = residual_flexibility(full.stiffness[~kept], normal[~kept], tangential[~kept])
        K = np.asarray(np.linalg.inv(residual))
        C = np.asarray(model.C[0, 0] / model.K[0, 0] * K)
    return replace(model, normal=normal[kept], tangential=tangential[kept], K=K, C=C)
