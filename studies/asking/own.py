"""Studies of a user's structure whose numbers are parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fivcore import Structure
from studies.declaring.own import parameters, varied
from studies.study import Study


def of_structure(study: Study, structure: Mapping[str, Any] | None) -> Study:
    """The study with the numbers of a structure as further parameters."""
    if structure is None or not study.takes_structure:
        return study
    own = Structure.from_dict(structure)
    beside = study.for_structure(own) if study.for_structure else {}
    # d1 and d2 are of a structure that is damped by them.
    left_out = {"d1", "d2"} if own.rayleigh is None else ()
    numbers = {name: each for name, each in parameters(own).items() if name not in left_out}
    return replace(study, parameters={**study.parameters, **beside, **numbers}, own=tuple(numbers))


def compute(
    inner: Callable[..., Mapping[str, Any]], names: tuple[str, ...], points: Mapping[str, Any], **fixed: Any
) -> dict[str, Any]:
    """Call the function of a sweep for each group of points that have the same structure, and join the results."""
    structure, count = Structure.from_dict(fixed.pop("structure")), len(next(iter(points.values())))
    rest = {name: value for name, value in points.items() if name not in names}
    numbers = {name: fixed.pop(name) for name in names if name in fixed}
    columns = {name: points[name] for name in names if name in points}
    rows = np.stack([np.zeros(count), *columns.values()], axis=1)
    joined: dict[str, Any] = {}
    for row in np.unique(rows, axis=0):
        chosen = np.flatnonzero((rows == row).all(axis=1))
        own = varied(structure, numbers | dict(zip(columns, row[1:].tolist(), strict=True)))
        part = {name: value[chosen] for name, value in rest.items()} or {"point": chosen}
        for name, value in inner(part, **fixed, structure=own).items():
            values = np.asarray(value)
            none = None if name == "error" else 0
            joined.setdefault(name, np.full((count, *values.shape[1:]), none, values.dtype))[chosen] = values
    return joined
