"""Rigs and scenes from numbers, and equivalent scenes.

The motion at (a V, a F) with the decay speed a v_d is a times the motion at (V, F) with v_d. (-theta, -V) is the
mirror image of (theta, V). The motion at (-theta, V) is another one, since only a reversal of both changes
nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Friction, Rig, Scene, Structure, speed_per_load
from studies.declaring.parameters import FRICTION, RIG, SCENE
from sweeps import InputError


def rig_of(numbers: Mapping[str, Any]) -> Any:
    """The structure among `numbers`, else the rig of these numbers, with the paper's values for missing ones."""
    if (structure := numbers.get("structure")) is not None:
        return structure if isinstance(structure, Structure) else Structure.from_dict(structure)
    try:
        return Rig.of(**{name: numbers[name] for name in RIG if name in numbers})
    except ValueError as problem:
        raise InputError(str(problem)) from None


def friction_of(numbers: Mapping[str, Any]) -> Friction:
    """The law of friction of these numbers; by default friction does not depend on the speed."""
    try:
        return Friction(**{name: numbers[name] for name in FRICTION if name in numbers})
    except ValueError as problem:
        raise InputError(str(problem).replace("Friction: ", "")) from None


def scene_of(numbers: Mapping[str, Any]) -> Scene:
    """The scene of these numbers: V, theta, mu, F, and the parameters of rig and friction."""
    return scenes_of(numbers, 1)[0]


def scenes_of(numbers: Mapping[str, Any], count: int) -> list[Scene]:
    """One scene for each point; each parameter is one value or an array of `count` values."""
    rig, columns = rig_of(numbers), _columns(numbers, count)
    law = cache(lambda *values: friction_of(dict(zip(FRICTION, values, strict=True))))
    return [
        Scene(V, theta, mu, F, rig, law(*values))
        for V, theta, mu, F, *values in zip(*(column.tolist() for column in columns.values()), strict=True)
    ]


def normalised(numbers: Mapping[str, Any], count: int, *, steady: bool = False) -> dict[str, NDArray[Any]]:
    """Parameters of each point's scaled scene, which has V > 0 and F = 1; one value of those without effect.

    With `steady` they are those of steady sliding, which depends on V and F only where friction falls with the
    speed.
    """
    points = _columns(numbers, count)
    constant, jump = points["kinetic_ratio"] == 1.0, points["decay_speed"] == 0.0
    falls, usual = ~(constant | jump), {name: p.default for name, p in FRICTION.items()}
    speed, decay_speed = points["V"], np.where(falls, points["decay_speed"], 1.0)
    if steady:
        speed = np.where(falls, speed, np.sign(speed) * points["F"])
    return points | {
        "V": _per_load(speed, points["F"]),
        # Adding zero makes -0 of a turned 0 what it equals.
        "theta": np.where(speed > 0.0, points["theta"], -points["theta"]) + 0.0,
        "F": np.ones(count),
        "decay_speed": np.where(
            falls, _per_load(decay_speed, points["F"]), np.where(constant, usual["decay_speed"], 0.0)
        ),
        "decay": np.where(falls, points["decay"], usual["decay"]),
    }


def _per_load(speed: NDArray[Any], load: NDArray[Any]) -> NDArray[Any]:
    """Speeds per load, m/s/N, rounded as the solver rounds them."""
    # Each pair once, for a grid has far fewer pairs than points.
    pairs, place = np.unique(speed + 1j * load, return_inverse=True)
    values = [speed_per_load(pair.real, pair.imag) for pair in pairs.tolist()]
    return np.asarray(values)[place]


def key(
    points: Mapping[str, Any], *, fixed: Mapping[str, Any], others: Sequence[str], steady: bool
) -> NDArray[Any]:
    """Rows that are equal for points with equivalent scenes (or `steady` sliding) and equal `others`."""
    scaled = normalised({**fixed, **points}, len(next(iter(points.values()))), steady=steady)
    columns = [*scaled.values(), *(points[name] for name in others)]
    codes = [np.unique(c, return_inverse=True)[1] if c.dtype.kind == "U" else c for c in columns]
    return np.stack([np.asarray(code, dtype=float) for code in codes], axis=1)


def factors(points: Mapping[str, Any], *, fixed: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Factors of the outputs of normalised scenes: `load`, and `along`, which changes its sign with V."""
    numbers = _columns({**fixed, **points}, len(next(iter(points.values()))))
    return {"load": numbers["F"], "along": numbers["F"] * np.sign(numbers["V"])}


def _columns(numbers: Mapping[str, Any], count: int) -> dict[str, NDArray[Any]]:
    """Arrays of each parameter of a scene and its friction, defaults included, with one value for each point."""
    columns = {
        name: np.broadcast_to(np.asarray(numbers.get(name, p.default), dtype=None if p.choices else float), count)
        for name, p in (SCENE | FRICTION).items()
    }
    if numbers.get("structure") is not None and (V := columns["V"].min()) < 0.0:
        raise InputError(f"V = {V:g}: it must be above 0 with a structure; change the sign of its tangential row")
    return columns
