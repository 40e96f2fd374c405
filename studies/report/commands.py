"""Lines that compute a result or one of its points again, read from its configuration and checked against it."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from studies import registry, spec
from studies.maps import maps
from studies.maps.quantities import AXES, QUANTITIES
from studies.motion import transients
from studies.plotting import planes
from studies.rig import BEAM_NUMBERS, RIG_NUMBERS
from studies.study import Study, constants
from sweeps import Sweep, json_equal, plain

# A list of more values than this is no command that anybody types.
MOST_VALUES = 60
# A point alone goes to a folder of its own, whatever the results folder holds.
ELSEWHERE = " --out one-point --fresh"
# Simulated where the file says nothing of how long a run is, s.
DURATION = 1.0


class Again(NamedTuple):
    """Commands that make a result again, and one of its points, with {V} where the value of the axis V goes.

    A command is "" where there is none, or where the values of its axes are too many to be written.
    """

    whole: str = ""
    point: str = ""


def again(dataset: xr.Dataset) -> Again:
    """The commands that give this file's configuration."""
    try:
        study = registry.load(dataset.attrs["sweep"])
        return _map(dataset) if study is maps.STUDY else _study(study, dataset)
    except (KeyError, ValueError, TypeError, ArithmeticError):
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
    known = {name: float(value) for name, value in (given | _rig_numbers(given)).items() if name in AXES}
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


def _study(study: Study, dataset: xr.Dataset) -> Again:
    given = constants(dataset)
    known = given | _rig_numbers(given)
    if known.get("settle", 0.0) is None:
        known["settle"] = -1.0
    settings = {
        name: known[name]
        for name, own in study.settings.items()
        if isinstance(known.get(name), (int, float)) and known[name] != own.value
    }
    axes = {name: dataset[name].values for name in study.axes}
    record = tuple(given.get("record", ()))
    rate = given["sample_rate"] if record and "sample_rate" not in study.settings else None
    if not _gives(study.sweep(settings | axes, record=record, sample_rate=rate), dataset):
        return Again()
    options = _options(settings)
    options += f" --record {shlex.quote(','.join(record))}" if record else ""
    options += f" --sample-rate {spec.typed(rate)}" if rate is not None else ""
    changed = {n: spec_of(v) for n, v in axes.items() if not np.array_equal(v, study.axes[n].values)}
    command = f"fiv run {study.name}"
    whole = f"{command}{_options(changed)}{options}" if all(changed.values()) else ""
    return Again(whole, f"{command}{_options({name: f'{{{name}}}' for name in axes})}{options}{ELSEWHERE}")


def _map(dataset: xr.Dataset) -> Again:
    given = constants(dataset)
    refinement = json.loads(dataset.attrs["configuration"])["refinement"]
    quantity, levels = str(given["quantity"]), int(refinement["levels"])
    tolerance = refinement["tolerance"] if levels else None
    x, y = map(str, dataset["status"].dims)
    plane = maps.Plane(x, y, dataset[x].values, dataset[y].values)
    fixed = maps.changed(quantity, given)
    if not _gives(maps.sweep_of(plane, quantity, fixed, levels, tolerance), dataset):
        return Again()
    options = f" --quantity {quantity}{_options(fixed, '--fix')}"
    x_spec, y_spec = (spec_of(values, levels) for values in (plane.xs, plane.ys))
    whole = f"fiv map --x {x}={x_spec} --y {y}={y_spec}{options}"
    if levels:
        whole += f" --refine {levels}"
        whole += "" if tolerance in (None, maps.TOLERANCE) else f" --tolerance {spec.typed(tolerance)}"
    point = f"fiv map --x {x}={{{x}}} --y {y}={{{y}}}{options}{ELSEWHERE}"
    return Again(whole if x_spec and y_spec else "", point)


def _gives(sweep: Sweep, dataset: xr.Dataset) -> bool:
    """Whether a sweep is the one that a file holds."""
    same = json_equal(json.loads(json.dumps(plain(sweep.constants))), constants(dataset))
    return same and all(np.array_equal(axis.values, dataset[name]) for name, axis in sweep.grid.axes.items())


def _rig_numbers(given: Mapping[str, Any]) -> dict[str, float]:
    """Settings by name (`studies.study.rig_settings`) of the rig in a configuration, if it has one."""
    if "rig" not in given:
        return {}
    rig = given["rig"]
    beams = {f"{beam}_{name}": float(rig[beam][name]) for beam in ("p1", "p2") for name in BEAM_NUMBERS}
    return {name: float(rig[name]) for name in RIG_NUMBERS} | beams


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
