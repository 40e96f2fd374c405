"""Fractions of the starts, drawn at random or on a plane, that lead to each motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Scene, State, checks, equilibrium
from studies.motion import knock, regimes, starts
from studies.motion.jobs import each_scene
from studies.motion.run import REGIMES
from studies.motion.starts import COORDINATES
from studies.motion.uncertainty import wilson
from sweeps import Axis, Variable, unit_draws

# Draws between two looks at the shares; where a point has no more draws.
BATCH, NONE = 16, -1
VIBRATION = "share of starts that lead to vibration"
OUTPUTS = {
    "label": Variable("1", "motion that a start leads to", ("draw",), "int8",
                      flags={NONE: "not drawn"} | dict(enumerate(REGIMES))),
    **{f"start_{name}": (units, f"start: {text}", "draw") for name, (units, text) in COORDINATES.items()},
    "draws": Variable("1", "number of starts", (), "int32"),
    "share": ("1", "share of starts that lead to a motion", "kind"),
    "share_low": ("1", "lower end of its 95 % interval (Wilson)", "kind"),
    "share_high": ("1", "upper end of its 95 % interval (Wilson)", "kind"),
    **{name: replace(variable, scale="") for name, variable in knock.OUTPUTS.items()},
    "vibration_share": ("1", VIBRATION),
    "vibration_share_low": ("1", "lower end of its 95 % interval (Wilson)"),
    "vibration_share_high": ("1", "upper end of its 95 % interval (Wilson)"),
}  # fmt: skip


def box(starts_are: str, most: int, seed: int, values: dict[str, Any]) -> NDArray[np.float64]:
    """The starts, (draws, coordinates), from the values of each coordinate.

    On a plane these are all combinations, the last coordinate varying fastest. Random starts are uniform between
    the least and the greatest value, the same in each call.
    """
    if starts_are == "plane":
        return np.stack([each.ravel() for each in np.meshgrid(*values.values(), indexing="ij")], axis=1)
    low, high = (np.array([end(each) for each in values.values()]) for end in (np.min, np.max))
    drawn, unit = np.tile(low, (most, 1)), np.flatnonzero(high > low)
    if len(unit):
        drawn[:, unit] += (high - low)[unit] * unit_draws(len(unit), most, "sobol", seed)
    return np.asarray(drawn)


def motions(
    scenes: Sequence[Scene], about: str, starts_are: str, most: int, width: float, seed: int,
    mode: int, second_mode: int, largest_knock: float, resolution: float, **options: Any,
) -> dict[str, Any]:  # fmt: skip
    """The motion to which each start leads, and the fraction of each motion, for each scene."""
    places = box(starts_are, most, seed, {name: options.pop(name) for name in COORDINATES})
    moved = [name for name, column in zip(COORDINATES, places.T, strict=True) if column.any()]
    random = starts_are == "draws"

    def point(scene: Scene) -> dict[str, Any]:
        rest = equilibrium(scene, about)
        made = starts.directions(scene, moved, mode, second_mode)
        found, few = np.full(len(places), NONE, dtype=np.int8), np.zeros((2, len(REGIMES)))
        for first in range(0, len(places), BATCH):
            chosen = places[first : first + BATCH][:, [name in moved for name in COORDINATES]]
            states = [State.of(scene, rest + q, v) for q, v in np.einsum("ki,ijm->kjm", chosen, made)]
            found[first : first + BATCH] = starts.labels_of(scene, states, options)
            count = min(first + BATCH, len(places))
            shares = np.bincount(found[:count], minlength=len(REGIMES)) / count
            few = np.stack(wilson(shares, count))
            if random and np.all(few[1] - few[0] <= width):
                break
        vibrates = regimes.is_of(found[:count], *regimes.VIBRATING).mean()
        # A plane is no sample.
        ends, own = (few, wilson(vibrates, count)) if random else (np.nan * few, (np.nan, np.nan))
        drawn = np.where((found > NONE)[:, None], places, np.nan)
        return {
            "label": found,
            **{f"start_{name}": column for name, column in zip(COORDINATES, drawn.T, strict=True)},
            "draws": count,
            **{"share": shares, "share_low": ends[0], "share_high": ends[1]},
            **knock.threshold(scene, largest_knock, resolution, options),
            **{"vibration_share": vibrates, "vibration_share_low": own[0], "vibration_share_high": own[1]},
        }

    return each_scene(scenes, point)


def coords(
    starts_are: str, most: int, displacement: Any, velocity: Any, second_displacement: Any, second_velocity: Any,
    velocity_C: Any, knock: Any,
) -> dict[str, Axis]:  # fmt: skip
    """The starts, numbered from 1, and the motions."""
    values = (displacement, velocity, second_displacement, second_velocity, velocity_C, knock)
    count = int(np.prod([len(each) for each in values])) if starts_are == "plane" else most
    checks.count("most" if starts_are == "draws" else "starts of the plane", count, 1_000_000)
    return {
        "draw": Axis(np.arange(1, count + 1), "1", "number of the start"),
        "kind": Axis(np.array(REGIMES), long_name="regime"),
    }


def check(width: Any, **others: Any) -> None:
    """Refuse parameters with which no start can be simulated."""
    checks.between("width", width, 1e-3, 1.0, "1")
    knock.check(**{name: others[name] for name in ("V", "F", *knock.PARAMETERS)})
