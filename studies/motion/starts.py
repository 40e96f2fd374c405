"""Initial states at the full speed of the drive: steady sliding or rest, displaced along modes or by a knock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fivcore
from fivcore import InputError, Scene, State, Structure, checks, sliding_modes, sliding_shape
from studies.declaring.parameters import RUN, Parameter
from studies.motion import run as runs
from studies.motion.jobs import run_one

Array = NDArray[np.float64]

ABOUT = ("sliding", "rest")
# Coordinates of a start, with units and text; B is that of the rig, or the output of a structure.
COORDINATES = {
    "displacement": ("m", "displacement of B along the drive, in the shape of the mode"),
    "velocity": ("m s-1", "velocity of B along the drive, in the shape of the mode"),
    "second_displacement": ("m", "displacement of B along the drive, in the shape of the second mode"),
    "second_velocity": ("m s-1", "velocity of B along the drive, in the shape of the second mode"),
    "velocity_C": ("m s-1", "velocity of C as P1 moves as a whole, positive away from P2"),
    "knock": ("N s", "impulse on P1 at the contact, normal, positive onto P2"),
}
# Duration of a run that has none, s; of a structure in units of its time.
DURATION = 0.5
SETTINGS = {
    "duration": Parameter(None, "s", "simulated time, the second half of which decides; auto: 0.5 s", common=True),
    "step": Parameter(None, "s", "time step; auto: the method's default", common=True),
    **{name: RUN[name] for name in ("cutoff", "numerical_damping")},
}


def directions(scene: Scene, names: Sequence[str], mode: int = 0, second_mode: int = 0) -> Array:
    """Modal displacements and velocities for a unit of each coordinate, (names, 2, modes), with V > 0.

    The modes are the oscillating modes of steady sliding below 10 kHz, numbered from 1 in ascending frequency; 0
    is the least stable one. Their shapes keep the contact closed. A knock acts on P1. On a structure from matrices
    it acts on the loaded bodies, on a structure from modes on both sides of the contact.
    """
    fivcore.one_contact(scene.rig, "starts are those of one contact")
    own = fivcore.modal_structure(scene.rig, scene.theta).motion
    made = np.zeros((len(names), 2, len(own.stiffness)))
    for k, name in enumerate(names):
        if name == "knock":
            moved, m = own.struck, len(own.frequency)
            made[k, 1, :m] -= moved[:m]
        elif name == "velocity_C":
            rigid = own.stiffness == 0.0
            if not rigid.any():
                raise InputError(f"{name}: without a rigid motion of the structure it must be 0; use velocity")
            made[k, 1, rigid] = 1.0 / own.normal[rigid]
        else:
            second = name.startswith("second_")
            phi, shape = _mode(scene, own, second_mode if second else mode, "second_mode" if second else "mode")
            # B moves as Re(a exp(phi t)).
            a = complex(1.0, phi.real / phi.imag) if name.endswith("displacement") else -1j / phi.imag
            made[k] = (a * shape).real, (a * phi * shape).real
    return made


def knocked(scene: Scene, *impulses: float) -> list[State]:
    """Steady sliding at the moment after each impulse on P1, N s."""
    q, (_, v) = fivcore.equilibrium(scene), directions(scene, ["knock"])[0]
    return [State.of(scene, q, impulse * v) for impulse in impulses]


def _mode(scene: Scene, own: Structure, number: int, name: str) -> tuple[complex, Any]:
    """Exponent and modal shape of a mode of steady sliding, in which B moves by 1."""
    law: dict[str, Any] = {"friction": scene.friction, "V": scene.V, "F": scene.F}
    modes = sliding_modes(scene.rig, scene.theta, scene.mu, runs.BAND, **law)
    found = np.flatnonzero(modes.frequency > 0.0)
    if not 0 <= number <= len(found) or not len(found):
        raise InputError(f"{name} = {number}: steady sliding has {len(found)} modes that oscillate below 10 kHz")
    k = found[number - 1] if number else found[np.argmax(modes.growth_rate[found])]
    phi = complex(modes.growth_rate[k], 2.0 * np.pi * modes.frequency[k])
    shape = sliding_shape(own, phi, bool(modes.uncoupled[k]))
    at_B = own.output @ shape
    if not abs(at_B) > 1e-9 * np.abs(own.output * shape).sum():
        raise InputError(f"{name} = {number}: B does not move in this mode; choose another")
    return phi, shape / at_B


def labels_of(scene: Scene, states: Sequence[State], options: Mapping[str, Any]) -> NDArray[np.int8]:
    """The regime to which each state leads, an index in `run.REGIMES`; `options` are those of SETTINGS."""
    duration = options["duration"] or DURATION * scene.rig.time_scale
    how = {"ramp": RUN["ramp"].default, "skip_long_sticks": 1, "settle": 0.5 * duration, **options}
    jobs = (runs.job(scene, duration, how, step=options["step"], initial=state) for state in states)
    return np.array([runs.REGIMES.index(run_one(job).summary["regime"]) for job in jobs], dtype=np.int8)


def check(V: Any, F: Any, duration: Any, step: Any, cutoff: Any, numerical_damping: Any) -> None:
    """Refuse settings with which no scene can be simulated."""
    for name, value, least in (("duration", duration, 1e-6), ("step", step, 1e-12)):
        if value is not None:
            checks.between(name, value, least, 1e6, "s, or auto")
    runs.check(V, F, RUN["ramp"].default, cutoff, 1, numerical_damping)
