"""Normalised scenes, with V > 0 and F = 1: which points are copies of one, and what multiplies its figures.

(a V, a F) moves a times as far as (V, F), and (-theta, -V) is the mirror image of (theta, V). (theta, V) and
(-theta, V) are different physics: theta is turned with V, never by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Rig, Scene
from fivcore.transient.normalised import Normalised
from studies.motion.jobs import BATCH_MULTIPLE

# Summary figures that F multiplies; the others are the same for every copy of a scene.
SCALED = (
    "velocity_rms",
    "mean_normal_force",
    "max_normal_force",
    "normal_force_999",
    "max_slip_speed",
    "slip_speed_999",
    *(f"{name}_se" for name in ("velocity_rms", "mean_normal_force", "normal_force_999", "slip_speed_999")),
)


def coordinates(points: Mapping[str, Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Speed per load (m/s/N), theta (degrees) and mu of the normalised scene of each point."""
    V, F, mu = (np.asarray(points[name], dtype=float) for name in ("V", "F", "mu"))
    # V / F is rounded as the solver rounds it; each pair once, for a grid has far fewer pairs than points.
    speeds, which = np.unique(V, return_inverse=True)
    loads, under = np.unique(F, return_inverse=True)
    pairs, place = np.unique(which * len(loads) + under, return_inverse=True)
    speed_per_load = [
        Normalised.of(
            Scene(float(speeds[pair // len(loads)]), 0.0, 0.0, float(loads[pair % len(loads)]))
        ).speed_per_load
        for pair in pairs
    ]
    # Adding zero makes -0 of a turned 0 what it equals.
    theta = np.where(V > 0.0, points["theta"], -np.asarray(points["theta"], dtype=float)) + 0.0
    return np.asarray(speed_per_load)[place], theta, mu


def scenes(points: Mapping[str, Any], rig: Rig) -> list[Scene]:
    """The normalised scene of each point."""
    return [
        Scene(float(V), float(theta), float(mu), 1.0, rig)
        for V, theta, mu in zip(*coordinates(points), strict=True)
    ]


def key(points: Mapping[str, Any]) -> NDArray[Any]:
    """Equal rows for points that are copies of one scene."""
    return np.stack(coordinates(points), axis=1)


def scale(points: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Factors of a normalised scene's figures at each point; `along` has the sense of x besides."""
    load = np.asarray(points["F"], dtype=float)
    return {"load": load, "along": load * np.sign(points["V"])}


# Options of a sweep over V, theta, mu and F: P1's modes and the contact law are made anew for each theta.
OPTIONS = {"key": key, "scale": scale, "order_by": ("theta",), "batch_multiple": BATCH_MULTIPLE}
