"""The request of a map, in which one or two parameters vary; it may be refined."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from typing import Any

import numpy as np

from fivcore import Structure, checks
from studies.answering.results import MAPS
from studies.asking.own import of_structure
from studies.asking.request import Request, assignment, is_distribution
from studies.declaring import spec
from studies.declaring.parameters import suggest
from studies.study import Study
from sweeps import InputError, Refinement, Sweep, refined

LONGEST_NAME = 60


def request_of(
    study: Study,
    x: str,
    y: str | None,
    quantities: Sequence[str],
    fix: Mapping[str, Any] | None = None,
    *,
    samples: int | None = None,
    seed: int | None = None,
    **how: Any,
) -> Request:
    """The request of a map: `x` and `y` are NAME=SPEC, `fix` has values of other parameters and distributions.

    Its other options are those of a `Request`.
    """
    study = of_structure(study, how.get("structure"))
    sides = dict(assignment(side, "x or y") for side in (x, y) if side)
    fixed = dict(fix or {}) | {name: n for name, n in (("samples", samples), ("seed", seed)) if n is not None}
    given = [("scatter" if is_distribution(value) else "fix", name) for name, value in fixed.items()]
    for option, name in [*zip(("x", "y"), sides, strict=False), *given]:
        if name not in study.parameters:
            known = study.known(how.get("structure"))
            near = f"{suggest(name, known)}choose from {', '.join(study.listed(how.get('structure')))}"
            raise InputError(f"{option} {name}: {quantities[0]} does not depend on it; {near}")
        if (y and len(sides) < 2) or (name in fixed and name in sides):
            raise InputError(f"{option} {name}: it varies already; give it once")
    request = Request(study.name, fixed | sides, sides=tuple(sides), quantities=tuple(quantities), **how)
    values = request.values_of(study)
    for name in fixed:
        if np.size(values[name]) > 1 or (hasattr(values[name], "ppf") and "samples" not in study.parameters):
            raise InputError(f"fix {name}: it must have one value; what varies is x or y")
    return request


def mapped(study: Study, request: Request, sweep: Sweep) -> Sweep:
    """The sweep of a map with its title, refined as requested."""
    first, tolerance = request.quantities[0], request.tolerance
    # A file is written again where its title changes: then it has this request, which is drawn.
    sweep = replace(sweep, title=f"{', '.join(request.quantities)} over {', '.join(request.sides)}")
    whole = np.dtype(study.outputs[first].dtype).kind == "i"
    if tolerance is not None and (whole or not request.refine):
        raise InputError(f"tolerance = {tolerance:g}: it is for numbers, with refine; leave it out")
    if not request.refine:
        return sweep
    limit = checks.between("tolerance", 0.02 if tolerance is None else tolerance, 1e-12, 1e12, "of the range")
    thresholds = tuple(value for name, value in study.thresholds.items() if name == first)
    return refined(sweep, Refinement(first, request.refine, None if whole else limit, thresholds))


def name_of(study: Study, request: Request, values: Mapping[str, Any]) -> str:
    """The name of a map's file: its quantities, its parameters, and settings that differ from the defaults."""
    study = of_structure(study, request.structure)
    default = {name: p.default for name, p in study.parameters.items() if name not in request.sides}
    numbers = {name: np.ravel(values.get(name, value))[0] for name, value in default.items()}
    # What a named rig has is said by its folder.
    default |= {name: value for name, value in (request.base or {}).items() if name in default}
    changed = [f"{n}{spec.typed(getattr(v, 'text', v))}" for n, v in sorted(numbers.items()) if v != default[n]]
    if request.structure is not None and not request.rig:
        changed.append(f"rig{Structure.from_dict(request.structure).digest[:8]}")
    parts = [request.quantities[0] if request.refine else study.name.removeprefix(f"{MAPS}_"), *request.sides]
    name = re.sub(r"[^\w.+-]", "_", "-".join([*parts, *changed]))
    return name if len(name) <= LONGEST_NAME else "-".join([*parts, sha256(name.encode()).hexdigest()[:8]])
