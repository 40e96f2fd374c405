"""The normalised scene, the initial state, and the motion of P2's clamp.

The equations are homogeneous in V, F and the decay speed of friction, and (-theta, -V) is the mirror image of
(theta, V). Every run is therefore computed for V > 0 and F = 1, with V / F and v_d / F rounded to 12 digits, and
scaled back, so that equivalent scenes give identical bits.
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

    `theta` is the inclination seen from the drive, degrees; `speed_per_load` is V / F, m/s/N, rounded to 12
    digits. Velocities, displacements and forces are scaled back by `load`, F in N, and those along x also by
    `sense`, the sign of V. For a structure F is the normal force at rest, and V < 0 means its mirror image. The
    decay speed of `friction` is divided by the load, too.
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
        if (gap := getattr(rig, "gap", None)) is not None and gap.any():
            rig = rig.with_gap(gap / load)
        return cls(rig, scene.drive_theta, speed, scene.mu, load, sense, scene.friction.normalised(load))


@dataclass(frozen=True, eq=False)
class State:
    """Modal displacements and velocities, and contact state, at the start or the end of a run.

    Attributes
    ----------
    displacement, velocity : ndarray, (modes,)
        Of all modes of both beams in the order of `fivcore.beams.modes.contact_modes`, P1 first; SI units with
        mass-normalised modes. P2 moves relative to its clamp. A structure may have additional static modes, which
        represent the modes that are not computed.
    contact : int
        0 separation, 1 stick, 2 slip.
    running : bool
        True if the drive already runs at its speed V; otherwise a run accelerates it from rest.
    statuses : ndarray of int, (c,), or None
        Statuses of several contacts, which `contact` summarises; None: each contact has the status `contact`.
    time : float
        Time of the end of a run, s since its drive started; 0 for other states.
    """

    displacement: Array
    velocity: Array
    contact: int
    running: bool = False
    statuses: Any = None
    time: float = field(default=0.0, init=False)
    # Scene and run that end in this state, with the last row; a run of the same scene continues that run.
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
            Default: separation if the gap is open, stick if the slip rate is below 1e-9 V, slip otherwise.

        Returns
        -------
        State
        """
        q, v = np.asarray(displacement), np.asarray(velocity)
        if scene.rig.several:
            return _of_several(cls, scene, q, v)
        if contact is None:
            full = full_model(scene.rig, scene.theta)
            parts = full.normal[: len(q)] * q
            slip_rate = full.tangential[: len(v)] @ v - scene.V
            touches = parts.sum() <= 1e-9 * np.abs(parts).sum()
            contact = 0 if not touches else 1 if abs(slip_rate) <= 1e-9 * abs(scene.V) else 2
        return cls(q, v, contact, True)

    @classmethod
    def end_of(cls, scene: Normalised, run: Any, last_row: Array) -> State:
        """The state at the end of a run; if that is within the ramp, the drive does not yet run at its speed."""
        model, full = run.model, full_model(scene.rig, scene.theta)
        q, v, u = run.state()
        displacement, velocity = np.zeros((2, len(full.stiffness)))
        kept = np.flatnonzero(model.kept)
        displacement[kept], velocity[kept] = q + model.static_equilibrium, v
        if not model.kept.all():
            displacement += static_displacement(model, full, u)
        statuses = getattr(run, "statuses", None)
        state = cls(
            scene.load * displacement, scene.load * velocity, int(run.record["contact"][0]), statuses=statuses
        )
        ended = run.time >= run.options.ramp * (1.0 - 1e-12)
        vars(state).update(running=ended, time=run.time, origin=(scene, run, last_row))
        return state


def _of_several(cls: type[State], scene: Scene, q: Array, v: Array) -> State:
    """`State.of` for several contacts; gaps and slip rates determine their statuses."""
    full, n = full_model(scene.rig, scene.theta), len(q)
    gaps, size = full.gap + full.normal[:, :n] @ q, np.abs(full.normal[:, :n]) @ np.abs(q)
    rates = full.tangential[:, : len(v)] @ v - scene.V
    statuses = np.where(gaps > 1e-9 * size, 0, np.where(np.abs(rates) <= 1e-9 * abs(scene.V), 1, 2))
    return cls(q, v, status_of_all(statuses), True, statuses)


def status_of_all(statuses: NDArray[Any]) -> int:
    """Overall contact state: separation if no contact is closed, slip if one slips, otherwise stick."""
    return 0 if not np.any(statuses) else 2 if np.any(statuses > 1) else 1


def static_displacement(model: ReducedModel, full: ReducedModel, u: Array) -> Array:
    """Static displacements of the truncated modes, (modes,), under load and contact force; their gaps are `u`."""
    lost = np.where(model.kept, 0.0, 1.0 / np.where(model.kept, 1.0, full.stiffness))
    force = model.K @ (u - full.shapes @ (lost * full.load))
    return np.asarray(lost * (full.load + force @ full.shapes))


def residual_gaps(scene: Normalised, kept: NDArray[np.bool_], initial: State) -> Array:
    """Gaps of the truncated modes, (2,), m per N of load: the initial u."""
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
    """Reference for `energy_residual` if a run exchanges less energy, for F = 1."""
    full, (stored, moving) = full_model(scene.rig, scene.theta), energies(scene)
    energy = 1e-3 * stored + moving
    if initial is not None:
        q = initial.displacement - full.static_equilibrium
        energy += 0.5 * float(np.sum(full.stiffness * q**2 + initial.velocity**2)) + float(
            np.abs(full.normal @ q).sum()
        )
    return energy


def loading_time(scene: Normalised) -> float:
    """Static loading time, s: how long the drive at V loads a stuck contact until it slips."""
    return slip_distance(scene) / scene.speed_per_load


def slip_distance(scene: Normalised) -> float:
    """Static displacement of the clamp at which the contact slips, m per N of load (F = 1, N = 1)."""
    full = full_model(scene.rig, scene.theta)
    elastic = full.stiffness > 0.0
    if full.forces is not None:
        closed = full.forces > 0.0
        moved = full.tangential[np.ix_(closed, elastic)]
        stiffness = np.linalg.pinv((moved / full.stiffness[elastic]) @ moved.T, hermitian=True).sum()
        return scene.mu * float(np.sum(full.friction * full.forces) / max(stiffness, 1e-300))
    return scene.mu * float(np.sum(full.tangential[elastic] ** 2 / full.stiffness[elastic]))
