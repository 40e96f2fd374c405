"""States in which a contact is released, caught or grazed (`fivcore.simulate`, `initial`).

All are built from modal shapes: P1 in free fall or at rest under a contact force, and velocities of some modes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from fivcore import Scene
from fivcore.beams.free_motion import propagator
from fivcore.contact.reduced import ReducedModel, default_cutoff, full_model
from fivcore.transient.statistics import SEPARATION, SLIP, STICK

Array = NDArray[np.float64]
Start = tuple[Array, Array, int]

# How far a tip rings whose path touches P2, m.
RINGING = 1e-6
# Half the duration of a blow, s.
BLOW = 2e-6


def first_state(name: str, scene: Scene, kept: NDArray[np.bool_]) -> Start:
    """Modal displacements, velocities and contact state, by the start's name.

    Parameters
    ----------
    name : str
        One of STARTS.
    scene : Scene
        With V > 0.
    kept : ndarray of bool, (all modes,)
        Modes that the method keeps: its own path is what has to graze.
    """
    start: Start = STARTS[name](scene, kept)
    return start


def _full(scene: Scene) -> ReducedModel:
    return full_model(scene.rig, scene.drive_theta)


def _load(full: ReducedModel) -> Array:
    """Modal force of the unit load on A."""
    return np.where(full.stiffness > 0.0, full.stiffness * full.rest - full.normal, -full.normal)


def held(scene: Scene, force: float, gap: float = 0.0) -> Array:
    """Displacements in equilibrium under the load and a normal contact force (N), with a gap (m)."""
    full = _full(scene)
    elastic = full.stiffness > 0.0
    q = np.zeros(len(full.stiffness))
    q[elastic] = (scene.F * _load(full) + force * full.normal)[elastic] / full.stiffness[elastic]
    rigid = int(np.flatnonzero(~elastic)[0])
    q[rigid] = (gap - full.normal @ q) / full.normal[rigid]
    return q


def _rest(scene: Scene, contact: int) -> Start:
    q = held(scene, scene.F)
    return q, np.zeros_like(q), contact


def _preloaded(scene: Scene, times: float) -> Start:
    q = held(scene, times * scene.F)
    return q, np.zeros_like(q), STICK


def _thrown(scene: Scene, gap: float, speed: float, contact: int = SEPARATION) -> Start:
    """P1 in free fall at a height, moving down as a whole."""
    full = _full(scene)
    q = held(scene, 0.0, gap)
    v = np.zeros_like(q)
    rigid = int(np.flatnonzero(full.stiffness == 0.0)[0])
    v[rigid] = -speed / full.normal[rigid]
    return q, v, contact


def _along(scene: Scene, speed: float) -> Start:
    """The lowest mode of P1 that moves its tip along P2, with the tip at that speed."""
    full = _full(scene)
    q = held(scene, scene.F)
    v = np.zeros_like(q)
    mode = int(np.flatnonzero(full.tangential)[0])
    v[mode] = speed / full.tangential[mode]
    return q, v, SLIP


def _struck(scene: Scene, shape: str, speed: float) -> Start:
    """All modes as after a blow on both surfaces that gives them a relative speed.

    The blow is a Gauss pulse: one without duration would put most of its energy into the mesh's fastest modes.
    """
    full = _full(scene)
    direction = getattr(full, shape)
    v = direction * np.exp(-0.5 * full.stiffness * BLOW**2)
    return held(scene, scene.F), speed / float(direction @ v) * v, SLIP


def _tangent(scene: Scene, kept: NDArray[np.bool_], above: float) -> Start:
    """P1 falling and ringing so that its first least gap is `above` times its amplitude.

    It rings in the mode below the usual cut-off that moves the tip most; what the method does not keep is at rest.
    """
    full = _full(scene)
    q = np.where(kept, held(scene, 0.0), 0.0)
    p1 = np.arange(len(q)) <= 3 * scene.rig.p1.elements
    low = full.stiffness < (2.0 * np.pi * default_cutoff(scene.rig)) ** 2
    rigid = int(np.flatnonzero(full.stiffness == 0.0)[0])
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
    return q, np.zeros_like(q), SEPARATION


def _spoilt(scene: Scene, how: str) -> Any:
    """Rest under the load with something that no state has."""
    q, v, contact = _rest(scene, STICK)
    if how == "short":
        return q[:-1], v, contact
    if how == "not a number":
        return q, np.full_like(v, np.nan), contact
    return q, v, 3


STARTS: dict[str, Callable[[Scene, NDArray[np.bool_]], Any]] = {
    "touching": lambda scene, kept: _thrown(scene, 0.0, 0.0),
    "vanishing impact": lambda scene, kept: _thrown(scene, 1e-12, 1e-9),
    "tangent": lambda scene, kept: _tangent(scene, kept, 0.0),
    "tangent, missed": lambda scene, kept: _tangent(scene, kept, 1e-12),
    "tangent, met": lambda scene, kept: _tangent(scene, kept, -1e-12),
    "preload 100 F": lambda scene, kept: _preloaded(scene, 1e2),
    "preload 10000 F": lambda scene, kept: _preloaded(scene, 1e4),
    "thrown at 1 m/s": lambda scene, kept: _thrown(scene, 1e-6, 1.0),
    "thrown at 100 m/s": lambda scene, kept: _thrown(scene, 1e-6, 100.0),
    "along at 10 m/s": lambda scene, kept: _along(scene, 10.0),
    "along at 1 km/s": lambda scene, kept: _along(scene, 1e3),
    "struck along": lambda scene, kept: _struck(scene, "tangential", 10.0),
    "struck across": lambda scene, kept: _struck(scene, "normal", 10.0),
    "rest, separation": lambda scene, kept: _rest(scene, SEPARATION),
    "rest, stick": lambda scene, kept: _rest(scene, STICK),
    "rest, slip": lambda scene, kept: _rest(scene, SLIP),
    "open, stick": lambda scene, kept: _thrown(scene, 1e-6, 0.0, STICK),
    "open, slip": lambda scene, kept: _thrown(scene, 1e-6, 0.0, SLIP),
    "too few modes": lambda scene, kept: _spoilt(scene, "short"),
    "not a number": lambda scene, kept: _spoilt(scene, "not a number"),
    "no such state": lambda scene, kept: _spoilt(scene, "no such state"),
}
