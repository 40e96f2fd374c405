"""Commands that compute a result or one of its points again, by what the file says it was asked for."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from studies import config, registry, spec
from studies.maps import maps
from studies.maps.quantities import AXES, QUANTITIES
from studies.motion import transients
from studies.plotting import planes
from studies.query.columns import settings
from studies.rig import BEAM_NUMBERS, RIG_NUMBERS
from studies.study import constants

# A list of more values than this is no command that anybody types.
MOST_VALUES = 60
# A point alone goes to a folder of its own, whatever the results folder holds.
ELSEWHERE = " --out one-point --fresh"
# Simulated where the file says nothing of how long a run is, s.
DURATION = 1.0


class Again(NamedTuple):
    """Commands that make a result again, and one of its points, with {V} where the value of the axis V goes.

    A command is "" where the file does not say what it was asked for; `whole` also where its axes are too long.
    """

    whole: str = ""
    point: str = ""


def again(dataset: xr.Dataset, typed: str = "") -> Again:
    """The commands that ask for this file; `typed` is what they call the study, by default its name."""
    try:
        name = str(dataset.attrs["sweep"])
        return _map(dataset) if name == maps.NAME else _study(config.of_result(dataset), typed or name)
    except (KeyError, ValueError, TypeError):
        return Again()


def spec_of(values: Any, halvings: int = 0) -> str:
    """The SPEC that stands for these values once its intervals are halved so often; "" if it would be too long."""
    values = np.asarray(values)
    if values.dtype.kind in "OU":
        return shlex.quote(",".join(values.tolist())) if len(values) <= MOST_VALUES else ""
    values = values.astype(float)
    coarse = values[:: 2**halvings]
    ends = f"{spec.typed(coarse[0])}:{spec.typed(coarse[-1])}:{len(coarse)}"
    ranges = [ends, f"log:{ends}"] if values[0] > 0.0 else [ends]
    listed = [",".join(map(spec.typed, coarse))] if len(coarse) <= MOST_VALUES else []
    for text in [*ranges, *listed] if len(coarse) > 3 else [*listed, *ranges]:
        if np.array_equal(spec.refined(text, "", halvings), values):
            return text
    return ""


def scene_lines(dataset: xr.Dataset) -> tuple[dict[str, str], dict[str, str]] | None:
    """What a cell of a plane of scenes stands for; None where the dataset is no such plane.

    Returns
    -------
    held : dict of str to str
        What is the same in all cells, for a reader: symbol, and value with unit.
    lines : dict of str to str
        What simulates the scene of a cell, with {V} where the value of the axis or variable V goes.
    """
    dims = [str(dim) for dim in dataset["status"].dims]
    if sum(dataset.sizes[dim] > 1 for dim in dims) < 2 or not set(dims) <= set(AXES):
        return None
    given = constants(dataset)
    known = {name: float(value) for name, value in settings(given).items() if name in AXES}
    numbers = {name: each.value for name, each in AXES.items()} | known
    slots = {name: f"{{{name}}}" if name in dims else spec.typed(value) for name, value in numbers.items()}
    odd = {name: slots[name] for name, each in AXES.items() if name in dims or numbers[name] != each.value}
    # What the results do not depend on is needed by a simulation all the same.
    matter = QUANTITIES[given["quantity"]].matter if "quantity" in given else (*dims, *known)
    held = {
        planes.SYMBOLS[name][0]: planes.named(name, numbers[name]).partition(" = ")[2]
        + (", of no influence here" if name in transients.SCENE and name not in matter else "")
        for name in AXES
        if name not in dims and (name in odd or name in transients.SCENE)
    }
    scene, run = {name: slots[name] for name in transients.SCENE}, _run(dataset, given)
    return held, {
        "Simulate this scene, on the command line": f"fiv run scenes{_options(scene | odd | run)}{ELSEWHERE}",
        "The same in Python": _python(scene, slots, odd, run),
    }


def _study(asked: config.Config, typed: str) -> Again:
    own, command = registry.load(asked.study), f"fiv run {shlex.quote(typed)}"
    options = _options(
        {name: value for name, value in asked.settings.items() if value != own.settings[name].value}
    )
    options += f" --record {shlex.quote(','.join(asked.record))}" if asked.record else ""
    options += f" --sample-rate {spec.typed(asked.sample_rate)}" if asked.sample_rate is not None else ""
    axes = {n: spec_of(v) for n, v in asked.axes.items() if not np.array_equal(v, own.axes[n].values)}
    whole = f"{command}{_options(axes)}{options}" if all(axes.values()) else ""
    return Again(whole, f"{command}{_options({name: f'{{{name}}}' for name in asked.axes})}{options}{ELSEWHERE}")


def _map(dataset: xr.Dataset) -> Again:
    """A map's constants are what it was asked for."""
    given = constants(dataset)
    refinement = json.loads(dataset.attrs["configuration"])["refinement"]
    quantity, levels, tolerance = str(given["quantity"]), int(refinement["levels"]), refinement["tolerance"]
    x, y = map(str, dataset["status"].dims)
    options = f" --quantity {quantity}{_options(maps.changed(quantity, given), '--fix')}"
    x_spec, y_spec = (spec_of(dataset[name].values, levels) for name in (x, y))
    whole = f"fiv map --x {x}={x_spec} --y {y}={y_spec}{options}{f' --refine {levels}' if levels else ''}"
    if levels and tolerance not in (None, maps.TOLERANCE):
        whole += f" --tolerance {spec.typed(tolerance)}"
    point = f"fiv map --x {x}={{{x}}} --y {y}={{{y}}}{options}{ELSEWHERE}"
    return Again(whole if x_spec and y_spec else "", point)


def _options(values: Mapping[str, Any], option: str = "--set") -> str:
    texts = {name: value if isinstance(value, str) else spec.typed(value) for name, value in values.items()}
    return "".join(f" {option} {name}={text}" for name, text in texts.items())


def _run(dataset: xr.Dataset, given: Mapping[str, Any]) -> dict[str, str]:
    """How a run of the scene is asked for: as the file's own runs are, as far as it has any."""
    own = dataset.get("duration")
    each = own is not None and own.dims == dataset["status"].dims
    numbers = {
        "duration": given.get("duration", given.get("most", DURATION)),
        "ramp": given.get("ramp", 1e-3),
        "cutoff": given.get("cutoff") or None,
        "settle": given.get("settle"),
        "leap": None if given.get("leap", 1.0) else 0.0,
    }
    run = {name: spec.typed(value) for name, value in numbers.items() if value is not None}
    return run | ({"duration": "{duration}"} if each else {})


def _python(
    scene: Mapping[str, str], slots: Mapping[str, str], odd: Mapping[str, str], run: Mapping[str, str]
) -> str:
    rig = {name: text for name, text in odd.items() if name in RIG_NUMBERS}
    beams = [beam for beam in ("p1", "p2") if any(f"{beam}_{name}" in odd for name in BEAM_NUMBERS)]
    rig |= {beam: _call("Beam", {name: slots[f"{beam}_{name}"] for name in BEAM_NUMBERS}) for beam in beams}
    names = (["Beam"] if beams else []) + (["Rig"] if rig else []) + ["Scene", "simulate"]
    made = _call("Scene", {**scene, "rig": _call("Rig", rig)} if rig else scene)
    options = {**run, "leap": "False"} if "leap" in run else run
    return f"from fivcore import {', '.join(names)}\nprint({_call(f'simulate({made}, ', options, '')}.summary)"


def _call(name: str, arguments: Mapping[str, str], bracket: str = "(") -> str:
    return f"{name}{bracket}{', '.join(f'{key}={text}' for key, text in arguments.items())})"
