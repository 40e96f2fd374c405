"""From numbers to rigs and scenes, and which scenes are equivalent.

(a V, a F) moves a times as far as (V, F), and (-theta, -V) is the mirror image of (theta, V). (theta, V) and
(-theta, V) differ: theta turns with V, never by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Rig, Scene, Structure
from fivcore.transient.normalised import Normalised
from studies.parameters import RIG, SCENE
from sweeps import InputError


def rig_of(numbers: Mapping[str, Any]) -> Any:
    """The structure among `numbers`; else the rig of one value of each parameter, missing ones the paper's."""
    if (structure := numbers.get("structure")) is not None:
        return structure if isinstance(structure, Structure) else Structure.from_dict(structure)
    try:
        return Rig.of(**{name: numbers[name] for name in RIG if name in numbers})
    except ValueError as problem:
        raise InputError(str(problem)) from None


def scene_of(numbers: Mapping[str, Any], rig: Rig | Structure) -> Scene:
    """The scene of one value of V, theta, mu and F."""
    _check_drive(numbers["V"], rig)
    return Scene(**{name: float(numbers[name]) for name in SCENE}, rig=rig)


def scenes_of(numbers: Mapping[str, Any], count: int, normalised: bool = False) -> list[Scene]:
    """One scene for each point; every parameter is one value or has an entry for each of `count` points.

    With `normalised`, the scaled scenes with V > 0 and F = 1.
    """
    rig = rig_of(numbers)
    columns = {name: np.broadcast_to(np.asarray(numbers[name], dtype=float), count) for name in SCENE}
    _check_drive(columns["V"].min(), rig)
    if normalised:
        speed, theta, mu = coordinates(columns)
        columns = {"V": speed, "theta": theta, "mu": mu, "F": np.ones(count)}
    return [
        Scene(V, theta, mu, F, rig)
        for V, theta, mu, F in zip(*(columns[name].tolist() for name in SCENE), strict=True)
    ]


def _check_drive(V: float, rig: Rig | Structure) -> None:
    if isinstance(rig, Structure) and V < 0.0:
        raise InputError(f"V = {V:g}: it must be above 0 with a structure; turn the sign of its tangential row")


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


def key(points: Mapping[str, Any], *, fixed: Mapping[str, float], others: Sequence[str]) -> NDArray[Any]:
    """Equal rows for points whose scenes are equivalent and whose `others` are equal."""
    codes = [np.unique(points[name], return_inverse=True)[1] if points[name].dtype.kind == "U" else points[name]
             for name in others]  # fmt: skip
    return np.stack([*coordinates(_complete(points, fixed)), *(np.asarray(c, dtype=float) for c in codes)], axis=1)


def factors(points: Mapping[str, Any], *, fixed: Mapping[str, float]) -> dict[str, NDArray[Any]]:
    """Factors of the outputs of normalised scenes: `load`, and `along`, which has the sign of V too."""
    numbers = _complete(points, fixed)
    return {"load": numbers["F"], "along": numbers["F"] * np.sign(numbers["V"])}


def _complete(points: Mapping[str, Any], fixed: Mapping[str, float]) -> dict[str, NDArray[Any]]:
    count = len(next(iter(points.values())))
    return {
        name: np.broadcast_to(np.asarray(points.get(name, fixed.get(name)), dtype=float), count) for name in SCENE
    }
