"""States in which a contact is released, caught or grazed (`fivcore.simulate`, `initial`).

All are built from modal shapes: P1 in free fall or at rest under a contact force, and velocities of some modes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from fivcore import Scene
from fivcore.beams.modes import propagator
from fivcore.contact.reduced import ReducedModel, default_cutoff, full_model
from fivcore.transient.statistics import SEPARATION, SLIP, STICK

Array = NDArray[np.float64]
State = tuple[Array, Array, int]  # modal displacements, velocities and contact state

# How far a tip rings whose path touches P2, m; half the duration of a blow, s.
RINGING, BLOW = 1e-6, 2e-6


@dataclass(frozen=True)
class Start:
    """A state: `build(scene, kept, *arguments)`, V > 0; it is the path of the modes kept that has to graze."""

    group: str
    asks: str  # for a reader
    build: Callable[..., Any]
    arguments: tuple[Any, ...]


def _equilibrium(scene: Scene, force: float, gap: float = 0.0) -> tuple[ReducedModel, int, Array, Array]:
    """All modes, the rigid one, and rest in equilibrium under the load and a contact force (N), with a gap (m)."""
    full = full_model(scene.rig, scene.drive_theta)
    elastic = full.stiffness > 0.0
    rigid = int(np.flatnonzero(~elastic)[0])
    # Modal force of the unit load on A.
    load = np.where(elastic, full.stiffness * full.rest - full.normal, -full.normal)
    q = np.zeros(len(full.stiffness))
    q[elastic] = (scene.F * load + force * full.normal)[elastic] / full.stiffness[elastic]
    q[rigid] = (gap - full.normal @ q) / full.normal[rigid]
    return full, rigid, q, np.zeros_like(q)


def _resting(scene: Scene, kept: Any, contact: int, times: float = 1.0) -> State:
    """Rest under the load times a number."""
    _, _, q, v = _equilibrium(scene, times * scene.F)
    return q, v, contact


def _thrown(scene: Scene, kept: Any, gap: float, speed: float, contact: int = SEPARATION) -> State:
    """P1 in free fall at a height, moving down as a whole."""
    full, rigid, q, v = _equilibrium(scene, 0.0, gap)
    v[rigid] = -speed / full.normal[rigid]
    return q, v, contact


def _along(scene: Scene, kept: Any, speed: float) -> State:
    """The lowest mode of P1 that moves its tip along P2, with the tip at that speed."""
    full, _, q, v = _equilibrium(scene, scene.F)
    mode = int(np.flatnonzero(full.tangential)[0])
    v[mode] = speed / full.tangential[mode]
    return q, v, SLIP


def _struck(scene: Scene, kept: Any, shape: str, speed: float) -> State:
    """All modes as after a blow on both surfaces that gives them a relative speed.

    The blow is a Gauss pulse: one without duration would put most of its energy into the mesh's fastest modes.
    """
    full, _, q, _ = _equilibrium(scene, scene.F)
    direction = getattr(full, shape)
    v = direction * np.exp(-0.5 * full.stiffness * BLOW**2)
    return q, speed / float(direction @ v) * v, SLIP


def _tangent(scene: Scene, kept: NDArray[np.bool_], above: float) -> State:
    """P1 falling and ringing so that its first least gap is `above` times its amplitude.

    It rings in the mode below the usual cut-off that moves the tip most; what the method does not keep is at rest.
    """
    full, rigid, q, v = _equilibrium(scene, 0.0)
    q = np.where(kept, q, 0.0)
    p1 = np.arange(len(q)) <= 3 * scene.rig.p1.elements
    low = full.stiffness < (2.0 * np.pi * default_cutoff(scene.rig)) ** 2
    mode = int(np.argmax(np.abs(full.normal) * (p1 & low & (full.stiffness > 0.0))))
    k, c = full.stiffness[[mode]], full.damping[[mode]]
    fall = scene.F * full.normal[rigid] ** 2

    def path(t: float) -> float:
        drag = full.damping[rigid] * t
        # To the fourth power of t, enough for a period of the ringing.
        fallen = 0.5 * fall * t * t * (1.0 - drag / 3.0 + drag * drag / 12.0)
        return float(RINGING * propagator(k, c, t)[0, 0] - fallen)

    period = 2.0 * np.pi / float(np.sqrt(k[0]))
    within = (0.25 * period, 0.75 * period)
    # The path is flat there: a time good to half of all digits is a place good to all.
    least = minimize_scalar(path, bounds=within, method="bounded", options={"xatol": 1e-9 * period})
    q[mode] += RINGING / full.normal[mode]
    q[rigid] = 0.0
    q[rigid] = ((1.0 + above) * RINGING - float(least.fun) - full.normal @ q) / full.normal[rigid]
    return q, v, SEPARATION


def _spoilt(scene: Scene, kept: Any, how: str) -> Any:
    """Rest under the load with something that no state has."""
    q, v, contact = _resting(scene, kept, STICK)
    nan = np.full_like(v, np.nan)
    return {"short": (q[:-1], v, contact), "not a number": (q, nan, contact), "no state": (q, v, 3)}[how]


GRAZING, CATCH, FIRST = "grazing", "catch", "first state"
# What no method may take.
NO_STATES = {
    "too few modes": Start(FIRST, "displacements of one mode less than the rig has", _spoilt, ("short",)),
    "not a number": Start(FIRST, "a modal velocity that is not a number", _spoilt, ("not a number",)),
    "no such state": Start(FIRST, "the contact state 3", _spoilt, ("no state",)),
}
STARTS = {
    "touching": Start(
        GRAZING, "P1 unloaded, just touching and at rest, when the load comes on", _thrown, (0.0, 0.0)),
    "vanishing impact": Start(GRAZING, "an impact at 1 nm/s from a gap of 1 pm", _thrown, (1e-12, 1e-9)),
    "tangent": Start(GRAZING, "a ringing tip whose path touches P2 without a closing speed", _tangent, (0.0,)),
    "tangent, missed": Start(GRAZING, "the same path a trillionth of its size higher", _tangent, (1e-12,)),
    "tangent, met": Start(GRAZING, "the same path a trillionth of its size lower", _tangent, (-1e-12,)),
    "preload 100 F": Start("release", "rest under a hundred times the load, released", _resting, (STICK, 1e2)),
    "preload 10000 F": Start(
        "release", "rest under ten thousand times the load, released", _resting, (STICK, 1e4)),
    "thrown at 1 m/s": Start(CATCH, "P1 thrown onto P2 at 1 m/s", _thrown, (1e-6, 1.0)),
    "thrown at 100 m/s": Start(CATCH, "P1 thrown onto P2 at 100 m/s", _thrown, (1e-6, 100.0)),
    "along at 10 m/s": Start(CATCH, "P1's tip moving along P2 at 10 m/s as contact is made", _along, (10.0,)),
    "along at 1 km/s": Start(CATCH, "P1's tip moving along P2 at 1 km/s as contact is made", _along, (1e3,)),
    "struck along": Start(
        CATCH, "all modes as after a blow of 4 us along P2 that leaves the contact slipping at 10 m/s",
        _struck, ("tangential", 10.0)),
    "struck across": Start(
        CATCH, "all modes as after a blow of 4 us across P2 that opens the contact at 10 m/s",
        _struck, ("normal", 10.0)),
    "rest, separation": Start(FIRST, "rest under the load, begun in separation", _resting, (SEPARATION,)),
    "rest, stick": Start(FIRST, "rest under the load, begun in stick", _resting, (STICK,)),
    "rest, slip": Start(FIRST, "rest under the load, begun in slip", _resting, (SLIP,)),
    "open, stick": Start(FIRST, "a gap of 1 um, begun in stick", _thrown, (1e-6, 0.0, STICK)),
    "open, slip": Start(FIRST, "a gap of 1 um, begun in slip", _thrown, (1e-6, 0.0, SLIP)),
    **NO_STATES,
}  # fmt: skip
