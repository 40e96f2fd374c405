"""The normalised scene, the initial state, and the motion of P2's clamp.

A scene is homogeneous in V, F and the decay speed of friction, and (theta, V) mirrors (-theta, -V): every run is
computed for V > 0 and F = 1, with V / F and v_d / F rounded to 12 digits, and scaled back. Copies of a scene then
have the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.contact.reduced import ReducedModel, full_model
from fivcore.friction import COULOMB, Friction
from fivcore.jit import Array
from fivcore.rig import ContactModel, Scene


@dataclass(frozen=True)
class Normalised:
    """A scene for V > 0 and F = 1.

    `theta` is in degrees as seen from the drive, `speed_per_load` V / F in m/s/N, rounded to 12 digits. `load`, F
    in N, is the factor of velocities, displacements and forces, `sense`, the sign of V, that of all along x. For
    a structure F is the normal force at rest, and V < 0 is that of the mirrored structure. The decay speed of
    `friction` is in units of the load, too.
    """

    rig: ContactModel
    theta: float
    speed_per_load: float
    mu: float
    load: float
    sense: float
    friction: Friction = COULOMB

    @classmethod
    def of(cls, scene: Scene) -> Normalised:
        """The normalised form of a scene."""
        rig, load = scene.rig if scene.V > 0.0 else scene.rig.mirrored(), scene.F * scene.rig.preload
        sense = 1.0 if scene.V > 0 else -1.0
        speed = float(f"{abs(scene.V) / load:.11e}")
        return cls(rig, scene.drive_theta, speed, scene.mu, load, sense, scene.friction.normalised(load))


@dataclass(frozen=True, eq=False)
class State:
    """Modal displacements and velocities, and contact state, at the start or the end of a run.

    Attributes
    ----------
    displacement, velocity : ndarray, (modes,)
        In the order of `fivcore.beams.modes.contact_modes`, P1's modes first, of every mode of both beams; SI with
        mass-normalised modes. Displacements and velocities of P2 are relative to its clamp. A structure may have
        a static mode more, which stands for what its modes leave out.
    contact : int
        0 separation, 1 stick, 2 slip.
    running : bool
        Whether the drive runs at its speed already; else a run accelerates it from rest.
    time : float
        Of the end of a run: s since its drive started; else 0.
    """

    displacement: Array
    velocity: Array
    contact: int
    running: bool = False
    time: float = field(default=0.0, init=False)
    # The scene and the run whose end this is, which a run of the same scene continues, and its last row.
    origin: tuple[Normalised, Any, Array] | None = field(default=None, init=False, repr=False)

    @classmethod
    def of(cls, scene: Scene, displacement: Any, velocity: Any, contact: int | None = None) -> State:
        """A state of a scene whose drive runs at its speed V.

        Parameters
        ----------
        scene : Scene
        displacement, velocity : array_like, (modes,)
            As the attributes.
        contact : int, optional
            By default as gap and slip rate say: separation where it is open, stick where the rate is zero to 1e-9
            of V, else slip.

        Returns
        -------
        State
        """
        q, v = np.asarray(displacement), np.asarray(velocity)
        if contact is None:
            full = full_model(scene.rig, scene.theta)
            parts = full.normal[: len(q)] * q
            slip_rate = full.tangential[: len(v)] @ v - scene.V
            touches = parts.sum() <= 1e-9 * np.abs(parts).sum()
            contact = 0 if not touches else 1 if abs(slip_rate) <= 1e-9 * abs(scene.V) else 2
        return cls(q, v, contact, True)

    @classmethod
    def end_of(cls, scene: Normalised, run: Any, last_row: Array) -> State:
        """The state at the end of a run; without its ramp's end the drive does not run at its speed."""
        model, full = run.model, full_model(scene.rig, scene.theta)
        q, v, u = run.state()
        displacement, velocity = np.zeros((2, len(full.normal)))
        kept = np.flatnonzero(model.kept)
        displacement[kept], velocity[kept] = q + model.static_equilibrium, v
        if not model.kept.all():
            displacement += static_displacement(model, full, u)
        state = cls(scene.load * displacement, scene.load * velocity, int(run.record["contact"][0]))
        ended = run.time >= run.options.ramp * (1.0 - 1e-12)
        vars(state).update(running=ended, time=run.time, origin=(scene, run, last_row))
        return state


def static_displacement(model: ReducedModel, full: ReducedModel, u: Array) -> Array:
    """Displacements of the modes that `model` leaves out, (modes,), whose gaps are `u`: load and contact force."""
    lost = np.where(model.kept, 0.0, 1.0 / np.where(model.kept, 1.0, full.stiffness))
    force = model.K @ (u - full.shapes @ (lost * full.load))
    return np.asarray(lost * (full.load + force @ full.shapes))


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
    stored = 0.5 * float(np.sum(full.stiffness * full.static_equilibrium**2))
    return stored, 0.5 * scene.speed_per_load**2 * float(np.sum(full.inertia**2))


def reference_energy(scene: Normalised, initial: State | None) -> float:
    """Energy that a balance is relative to if it turns over less (`energy_residual`), for F = 1."""
    full, (stored, moving) = full_model(scene.rig, scene.theta), energies(scene)
    energy = 1e-3 * stored + moving
    if initial is not None:
        q = initial.displacement - full.static_equilibrium
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
