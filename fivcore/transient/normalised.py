"""The normalised scene, the initial state, and the motion of P2's clamp.

A scene is homogeneous in V, F and the decay speed of friction, and (theta, V) mirrors (-theta, -V): every run is
computed for V > 0 and F = 1, with V / F and v_d / F rounded to 12 digits, and scaled back. Copies of a scene then
have the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fivcore.contact.reduced import full_model
from fivcore.friction import COULOMB, Friction
from fivcore.jit import Array
from fivcore.rig import Scene, Structural
from fivcore.structure import Structure


@dataclass(frozen=True)
class Normalised:
    """A scene for V > 0 and F = 1.

    `theta` is in degrees as seen from the drive, `speed_per_load` V / F in m/s/N, rounded to 12 digits. `load`, F
    in N, is the factor of velocities, displacements and forces, `sense`, the sign of V, that of all along x. For
    a structure F is the normal force at rest, and V < 0 is that of the mirrored structure. The decay speed of
    `friction` is in units of the load, too.
    """

    rig: Structural
    theta: float
    speed_per_load: float
    mu: float
    load: float
    sense: float
    friction: Friction = COULOMB

    @classmethod
    def of(cls, scene: Scene) -> Normalised:
        """The normalised form of a scene."""
        rig, load = scene.rig, scene.F * scene.rig.preload
        if isinstance(rig, Structure) and scene.V < 0.0:
            rig = rig.mirrored()
        sense = 1.0 if scene.V > 0 else -1.0
        speed = float(f"{abs(scene.V) / load:.11e}")
        return cls(rig, scene.drive_theta, speed, scene.mu, load, sense, scene.friction.normalised(load))


@dataclass(frozen=True)
class State:
    """Initial modal displacements and velocities, and contact state.

    Attributes
    ----------
    displacement, velocity : ndarray, (modes,)
        In the order of `fivcore.beams.modes.contact_modes`, P1's modes first, of every mode of both beams; SI with
        mass-normalised modes. Velocities of P2 are relative to its clamp.
    contact : int
        0 separation, 1 stick, 2 slip.
    """

    displacement: Array
    velocity: Array
    contact: int


def residual_gaps(scene: Normalised, kept: NDArray[np.bool_], initial: State) -> Array:
    """Gaps of the modes that are not `kept`, (2,), m per N of load: u at the start."""
    full = full_model(scene.rig, scene.theta)
    return np.asarray(full.shapes * ~kept @ initial.displacement)


def displacement(t: Array, speed: float, ramp: float) -> Array:
    """Displacement of the clamp: speed t^2 / (2 ramp), then speed (t - ramp / 2)."""
    if ramp == 0.0:
        return np.asarray(speed * t)
    return np.where(t < ramp, 0.5 * speed * np.square(t) / ramp, speed * (t - 0.5 * ramp))


def energies(scene: Normalised) -> tuple[float, float]:
    """Energy stored in static equilibrium, and P2's kinetic energy at its clamp's speed, for F = 1."""
    full = full_model(scene.rig, scene.theta)
    stored = 0.5 * float(np.sum(full.stiffness * full.rest**2))
    return stored, 0.5 * scene.speed_per_load**2 * float(np.sum(full.inertia**2))


def reference_energy(scene: Normalised, initial: State | None) -> float:
    """Energy that a balance is relative to if it turns over less (`energy_residual`), for F = 1."""
    full, (stored, moving) = full_model(scene.rig, scene.theta), energies(scene)
    energy = 1e-3 * stored + moving
    if initial is not None:
        q = initial.displacement - full.rest
        energy += 0.5 * float(np.sum(full.stiffness * q**2 + initial.velocity**2)) + abs(float(full.normal @ q))
    return energy


def loading_time(scene: Normalised) -> float:
    """Time in which the drive at its speed loads a stuck contact until it slips, statically, s."""
    return slip_distance(scene) / scene.speed_per_load


def slip_distance(scene: Normalised) -> float:
    """Static displacement of the clamp at which the contact slips, m per N of load (F = 1, N = 1)."""
    full = full_model(scene.rig, scene.theta)
    elastic = full.stiffness > 0.0
    return scene.mu * float(np.sum(full.tangential[elastic] ** 2 / full.stiffness[elastic]))
