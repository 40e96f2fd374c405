"""A contact point D that moves along P2 while P2 slides under P1's tip (`contact_motion`).

D moves by X(t) towards P2's clamp or away from it. The gap shapes follow it in every step, linearly within a
segment; the residual flexibility and the static equilibrium follow once a segment. The gap's rate gains the rate
of this motion times the slope of P2's deflection. The motion is not homogeneous in (V, F), for the distance that D
moves depends on V itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fivcore.beams.elements import hermite
from fivcore.beams.modes import lower_basis, residual_flexibility
from fivcore.contact.reduced import ReducedModel, full_model
from fivcore.errors import InputError
from fivcore.transient.normalised import Normalised, displacement

# A segment lasts SEGMENT_TIME, s, but is no shorter than LEAST and no longer than MOST along P2, m. A fast D takes
# some 30 s of computing time per metre; segments of 5 um would change the velocity of B by less than 0.4 %.
SEGMENT_TIME, LEAST, MOST = 1e-4, 5e-6, 50e-6


@dataclass(frozen=True)
class ContactMotion:
    """Position of the contact point in time; `ramp` in s, `direction` -1 (towards P2's clamp) or 1 (away)."""

    scene: Normalised
    ramp: float
    direction: int

    @property
    def speed(self) -> float:
        """Velocity of D along P2 after the ramp, away from the clamp, m/s."""
        return self.direction * self.scene.speed_per_load * self.scene.load

    def segment_steps(self, step: float) -> int:
        """Steps of a segment."""
        speed = abs(self.speed)
        return max(int(min(max(speed * SEGMENT_TIME, LEAST), MOST) / (speed * step)), 1)

    def position(self, t: float) -> float:
        """Distance of D from P2's clamp, m."""
        moved = self.scene.load * float(displacement(np.array(t), self.scene.speed_per_load, self.ramp))
        return self.scene.rig.contact_position + self.direction * moved

    def check(self, duration: float) -> None:
        """Raise ValueError where D would leave P2 within `duration`, s, or has no room to move."""
        beam, start = self.scene.rig.p2, self.scene.rig.contact_position
        # The element next to the clamp hardly moves: contact there is contact with the wall.
        distance = start - beam.length / beam.elements if self.direction < 0 else beam.length - start
        if distance <= 0.0:
            raise InputError(
                f"contact_motion = {self.direction}: it must be 0 for a contact at P2's end, {start:g} m"
            )
        # D moves by speed t^2 / (2 ramp) within the ramp and by speed (t - ramp / 2) after it.
        half, longest = 0.5 * self.ramp, distance / abs(self.speed)
        longest = longest + half if longest > half else 2.0 * float(np.sqrt(half * longest))
        if duration > longest:
            end = "P2's clamp" if self.direction < 0 else "P2's free end"
            raise InputError(f"duration = {duration:g}: it must be at most {longest:.6g} s, when D reaches {end}")


def moved_model(model: ReducedModel, scene: Normalised, position: float) -> ReducedModel:
    """Return the model with D at `position`, m from P2's clamp; its modes and tau stay."""
    rig, kept, K, C = scene.rig, model.kept, model.K, model.C
    full, shapes = full_model(rig, scene.theta), lower_basis(rig.p2, rig.contact_position).shapes[1:]
    axial_row, bending_row = hermite(rig.p2, position)
    # Not matrix products: BLAS would round differently with the number of its threads.
    bending = np.einsum("ij,ijn->n", -bending_row.reshape(-1, 2), shapes[:, 1:])
    normal = np.append(full.normal[: -len(bending)], bending)
    tangential = np.append(full.tangential[: -len(bending)], np.einsum("i,in->n", -axial_row, shapes[:, 0]))
    if K.any():
        residual = residual_flexibility(full.stiffness[~kept], normal[~kept], tangential[~kept])
        K = np.asarray(np.linalg.inv(residual))
        C = np.asarray(model.C[0, 0] / model.K[0, 0] * K)
    return replace(model, normal=normal[kept], tangential=tangential[kept], K=K, C=C)
