"""The command that makes a result again: read from the file's configuration, and checked against it."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from studies import registry, spec
from studies.maps import maps
from studies.maps.quantities import AXES, QUANTITIES
from studies.rig import BEAM_NUMBERS, RIG_NUMBERS
from studies.study import Study, constants
from sweeps import Sweep, json_equal, plain

# A list of more values than this is no command that anybody types.
MOST_VALUES = 60
# A point alone goes to a folder of its own, whatever the results folder holds.
ELSEWHERE = "--out one-point --fresh"


@dataclass(frozen=True)
class Again:
    """How a result is made again.

    Attributes
    ----------
    whole : str
        The command; "" if its axes have too many values to be written.
    point : str
        The command for one of its points, with {V} where the value of the axis V goes.
    """

    whole: str
    point: str


def again(dataset: xr.Dataset) -> Again | None:
    """The commands, or None where none gives this file's configuration."""
    try:
        study = registry.load(dataset.attrs["sweep"])
        return _map(dataset) if study.name == maps.NAME else _study(study, dataset)
    except (KeyError, ValueError, TypeError, ArithmeticError):
        return None


def written(value: float) -> str:
    """A number as one types it, all its digits kept."""
    return repr(float(value)).removesuffix(".0")


def spec_of(values: Any, halvings: int = 0) -> str:
    """The SPEC that stands for these values once its intervals are halved so often; "" if it would be too long."""
    values = np.asarray(values)
    if values.dtype.kind in "OU":
        return shlex.quote(",".join(values.tolist())) if len(values) <= MOST_VALUES else ""
    values = values.astype(float)
    coarse = values[:: 2**halvings]
    ends = f"{written(coarse[0])}:{written(coarse[-1])}:{len(coarse)}"
    ranges = [ends, f"log:{ends}"] if values[0] > 0.0 else [ends]
    listed = [",".join(map(written, coarse))] if len(coarse) <= MOST_VALUES else []
    for text in [*ranges, *listed] if len(coarse) > 3 else [*listed, *ranges]:
        if np.array_equal(spec.refined(text, "", halvings), values):
            return text
    return ""


def numbers_of_rig(rig: Mapping[str, Any]) -> dict[str, float]:
    """Settings by name (`studies.study.rig_settings`) of a rig as a configuration holds it."""
    found = {name: float(rig[name]) for name in RIG_NUMBERS}
    return found | {f"{beam}_{name}": float(rig[beam][name]) for beam in ("p1", "p2") for name in BEAM_NUMBERS}


def _study(study: Study, dataset: xr.Dataset) -> Again | None:
    held = constants(dataset)
    known = {name: value for name, value in held.items() if isinstance(value, (int, float))}
    known |= numbers_of_rig(held["rig"]) if "rig" in held else {}
    if "settle" in held:
        known["settle"] = -1.0 if held["settle"] is None else held["settle"]
    settings = {
        name: known[name] for name, own in study.settings.items() if name in known and known[name] != own.value
    }
    axes = {name: dataset[name].values for name in study.axes}
    record = tuple(held.get("record", ()))
    rate = held["sample_rate"] if record and "sample_rate" not in study.settings else None
    if not _gives(study.sweep(settings | axes, record=record, sample_rate=rate), dataset):
        return None
    told = "".join(f" --set {name}={written(value)}" for name, value in settings.items())
    told += f" --record {shlex.quote(','.join(record))}" if record else ""
    told += f" --sample-rate {written(rate)}" if rate is not None else ""
    changed = {n: spec_of(v) for n, v in axes.items() if not np.array_equal(v, study.axes[n].values)}
    whole = f"fiv run {study.name}" + "".join(f" --set {name}={text}" for name, text in changed.items()) + told
    point = f"fiv run {study.name}" + "".join(f" --set {name}={{{name}}}" for name in axes)
    return Again(whole if all(changed.values()) else "", f"{point}{told} {ELSEWHERE}")


def _map(dataset: xr.Dataset) -> Again | None:
    held = constants(dataset)
    refinement = json.loads(dataset.attrs["configuration"])["refinement"]
    quantity, levels = str(held["quantity"]), int(refinement["levels"])
    x, y = map(str, dataset["status"].dims)
    plane = maps.Plane(x, y, dataset[x].values, dataset[y].values)
    own = {name: each.value for name, each in (AXES | dict(QUANTITIES[quantity].settings)).items()}
    fixed = {name: held[name] for name in own if name in held and held[name] != own[name]}
    tolerance = refinement["tolerance"] if levels else None
    if not _gives(maps.sweep_of(plane, quantity, fixed, levels, tolerance), dataset):
        return None
    told = f" --quantity {quantity}" + "".join(f" --fix {name}={written(v)}" for name, v in fixed.items())
    specs = [spec_of(values, levels) for values in (plane.xs, plane.ys)]
    whole = f"fiv map --x {x}={specs[0]} --y {y}={specs[1]}{told}"
    if levels:
        whole += f" --refine {levels}"
        whole += "" if tolerance in (None, maps.TOLERANCE) else f" --tolerance {written(tolerance)}"
    point = f"fiv map --x {x}={{{x}}} --y {y}={{{y}}}{told} {ELSEWHERE}"
    return Again(whole if all(specs) else "", point)


def _gives(sweep: Sweep, dataset: xr.Dataset) -> bool:
    """Whether a sweep is the one that a file holds."""
    same = json_equal(json.loads(json.dumps(plain(sweep.constants))), constants(dataset))
    return same and all(np.array_equal(axis.values, dataset[name]) for name, axis in sweep.grid.axes.items())
