"""Commands that compute a result or one of its points again, from the request in its file."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from studies import config, registry, spec
from studies.maps import maps
from studies.study import constants
from sweeps import InputError

# A point alone goes to a folder of its own, whatever the results folder holds.
ELSEWHERE = " --out one-point --fresh"


class Again(NamedTuple):
    """Commands that make a result again, and one of its points, with {V} where the value of the axis V goes.

    A command is "" where the file has no request; `whole` also where its axes are too long.
    """

    whole: str = ""
    point: str = ""


def again(dataset: xr.Dataset, typed: str = "") -> Again:
    """The commands that ask for this file; `typed` is what they call the study, by default its name."""
    try:
        name = str(dataset.attrs["sweep"])
        return _map(dataset) if name == maps.NAME else _study(config.of_result(dataset), typed)
    except (KeyError, ValueError, TypeError):
        return Again()


def in_python(dataset: xr.Dataset, opened: str) -> str:
    """Lines that simulate the scene of a point, with slots as in a command; `opened` gives the dataset."""
    fixed = constants(dataset)
    point = ", ".join(f"{dim}={{{dim}}}" for dim in dataset["status"].dims)
    run = "**data.fiv.run_options(point)" if "method" in fixed else f"duration={fixed.get('duration', 1.0)!r}"
    return (
        f"import studies\nfrom fivcore import simulate\ndata, point = {opened}, dict({point})\n"
        f"print(simulate(data.fiv.scene(point), {run}).summary)"
    )


def _study(request: config.Config, typed: str) -> Again:
    own, command = registry.load(request.study), f"fiv run {shlex.quote(typed or request.study)}"
    changed = {name: value for name, value in request.settings.items() if value != own.settings[name].value}
    options = _options({name: spec.typed(value) for name, value in changed.items()})
    options += f" --record {shlex.quote(','.join(request.record))}" if request.record else ""
    options += f" --sample-rate {spec.typed(request.sample_rate)}" if request.sample_rate is not None else ""
    if request.points:
        # Too long for a command.
        return Again()
    if request.scatter:
        options += _options(request.scatter, "--scatter")
        options += (
            f" --samples {request.samples} --seed {request.seed} --sampling {shlex.quote(str(request.sampling))}"
        )
    axes = {n: _spec(v) for n, v in request.axes.items() if not np.array_equal(v, own.axes[n].values)}
    whole = f"{command}{_options(axes)}{options}" if all(axes.values()) else ""
    if request.scatter:
        return Again(whole)
    return Again(whole, f"{command}{_slots(request.axes)}{options}{ELSEWHERE}")


def _spec(values: Any) -> str:
    return ",".join(values) if isinstance(values[0], str) else spec.written(values)


def _map(dataset: xr.Dataset) -> Again:
    """The commands of a map, whose constants are its request."""
    constant = constants(dataset)
    refinement = json.loads(dataset.attrs["configuration"])["refinement"]
    quantity, levels, tolerance = str(constant["quantity"]), int(refinement["levels"]), refinement["tolerance"]
    x, y = map(str, dataset["status"].dims)
    fixed = {name: spec.typed(value) for name, value in maps.changed(quantity, constant).items()}
    options = f" --quantity {shlex.quote(quantity)}{_options(fixed, '--fix')}"
    x_spec, y_spec = (spec.written(dataset[name].values, levels) for name in (x, y))
    refine = f" --refine {levels}" if levels else ""
    whole = f"fiv map{_options({x: x_spec}, '--x')}{_options({y: y_spec}, '--y')}{options}{refine}"
    if levels and tolerance not in (None, maps.TOLERANCE):
        whole += f" --tolerance {spec.typed(tolerance)}"
    point = f"fiv map{_slots([x], '--x')}{_slots([y], '--y')}{options}{ELSEWHERE}"
    return Again(whole if x_spec and y_spec else "", point)


def _options(texts: Mapping[str, str], option: str = "--set") -> str:
    return "".join(f" {option} {shlex.quote(name)}={shlex.quote(text)}" for name, text in texts.items())


def _slots(names: Iterable[str], option: str = "--set") -> str:
    """Options with a slot for each value; a name that a shell would read as anything else is refused."""
    for name in names:
        if not name.isidentifier():
            raise InputError(f"axis = {name!r}: it is no name")
    return "".join(f" {option} {name}={{{name}}}" for name in names)
