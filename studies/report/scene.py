"""What a cell of a plane stands for: its scene, and the lines that simulate it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import xarray as xr

from studies.maps.quantities import AXES, QUANTITIES
from studies.motion import transients
from studies.plotting import planes
from studies.report.commands import ELSEWHERE, numbers_of_rig, written
from studies.rig import BEAM_NUMBERS, RIG_NUMBERS
from studies.study import constants

# Simulated where the file says nothing of how long a run is, s.
DURATION = 1.0


@dataclass(frozen=True)
class Recipe:
    """The scene behind each cell of a plane.

    Attributes
    ----------
    held : dict of str to str
        What is the same in all cells, for a reader: symbol, and value with unit.
    command, python : str
        The lines, with {V} where the value of the axis or figure V goes.
    """

    held: dict[str, str]
    command: str
    python: str


def recipe(dataset: xr.Dataset) -> Recipe | None:
    """The recipe; None where the dataset is no plane of scenes."""
    dims = [str(dim) for dim in dataset["status"].dims]
    if sum(dataset.sizes[dim] > 1 for dim in dims) < 2 or not set(dims) <= set(AXES):
        return None
    given = constants(dataset)
    rig = numbers_of_rig(given["rig"]) if "rig" in given else {}
    known = {name: float(value) for name, value in (given | rig).items() if name in AXES}
    numbers = {name: each.value for name, each in AXES.items()} | known
    slots = {name: f"{{{name}}}" if name in dims else written(value) for name, value in numbers.items()}
    odd = [name for name, each in AXES.items() if name in dims or numbers[name] != each.value]
    # What the results do not depend on is needed by a simulation all the same.
    matter = QUANTITIES[given["quantity"]].matter if "quantity" in given else (*dims, *known)
    shown = [name for name in AXES if name not in dims and (name in odd or name in transients.SCENE)]
    run = _run(dataset, given)
    return Recipe(
        {
            planes.SYMBOLS[name][0]: planes.named(name, numbers[name]).partition(" = ")[2]
            + (", of no influence here" if name in transients.SCENE and name not in matter else "")
            for name in shown
        },
        _command(slots, odd, run),
        _python(slots, odd, run),
    )


def _run(dataset: xr.Dataset, given: Mapping[str, Any]) -> dict[str, str]:
    """How a run of the scene is asked for: as the file's own runs are, as far as it has any."""
    own = dataset.get("duration")
    if own is not None and own.dims == dataset["status"].dims:
        duration = "{duration}"
    else:
        duration = written(given.get("duration", given.get("most", DURATION)))
    asked = {"duration": duration, "ramp": written(given.get("ramp", 1e-3))}
    if given.get("cutoff"):
        asked["cutoff"] = written(given["cutoff"])
    if given.get("settle") is not None:
        asked["settle"] = written(given["settle"])
    if not given.get("leap", 1.0):
        asked["leap"] = "0"
    return asked


def _command(slots: Mapping[str, str], odd: list[str], run: Mapping[str, str]) -> str:
    names = [*transients.SCENE, *(name for name in odd if name not in transients.SCENE)]
    every = {name: slots[name] for name in names} | dict(run)
    return "fiv run scenes" + "".join(f" --set {name}={value}" for name, value in every.items()) + f" {ELSEWHERE}"


def _python(slots: Mapping[str, str], odd: list[str], run: Mapping[str, str]) -> str:
    rig = [f"{name}={slots[name]}" for name in odd if name in RIG_NUMBERS]
    beams = [beam for beam in ("p1", "p2") if any(f"{beam}_{name}" in odd for name in BEAM_NUMBERS)]
    for beam in beams:
        numbers = [f"{name}=" + slots[f"{beam}_{name}"] for name in BEAM_NUMBERS]
        rig += [f"{beam}=Beam({', '.join(numbers)})"]
    names = ["Beam"] if beams else []
    names += ["Rig", "Scene"] if rig else ["Scene"]
    scene = ", ".join(f"{name}={slots[name]}" for name in transients.SCENE)
    scene += f", rig=Rig({', '.join(rig)})" if rig else ""
    options = {"leap": "False"} if "leap" in run else {}
    asked = ", ".join(f"{name}={value}" for name, value in (dict(run) | options).items())
    return f"from fivcore import {', '.join(names)}, simulate\nprint(simulate(Scene({scene}), {asked}).summary)"
