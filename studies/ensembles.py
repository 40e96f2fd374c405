"""Ensembles: runs of one scene that chaos makes independent, as long as the scene's own time scale asks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fivcore import Scene, Transient
from fivcore.drive import Canonical, slip_distance
from studies import transients

# Members differ by the ramp of the drive: each is longer than the one before by this share of the first. Motion
# forgets it within milliseconds of the first separation, but no two members then move alike.
STRETCH = 0.013


def ramp_of(member: float, ramp: float) -> float:
    """The ramp of a member, counted from 1, s."""
    return ramp * (1.0 + STRETCH * (member - 1.0))


def load_up(scene: Scene) -> float:
    """Time in which the drive loads a stuck contact from rest until it slips, s: mu F / (k_t V)."""
    canonical = Canonical.of(scene)
    return slip_distance(canonical) / canonical.pace


def own_duration(scene: Scene, ramp: float, least: float, load_ups: float, most: float) -> float:
    """How long a scene must run for its statistics, s.

    To the first slip, then until it has settled, then at least the time `least` and at least so many load-ups,
    during which a scene that sticks and slips does so as many times; but no longer than `most`.
    """
    once = load_up(scene)
    return min(0.5 * ramp + once + transients.SETTLING + max(least, load_ups * once), most)


def member(scene: Scene, number: float, fixed: Mapping[str, Any], duration: float, **more: Any) -> Transient:
    """One member of a scene's ensemble, by its number from 1 on."""
    return transients.motion(scene, {**fixed, "ramp": ramp_of(number, fixed["ramp"])}, duration, **more)
