"""What makes two sweeps one and the same: their results may be mixed only if all of this is equal.

The values of the axes do not belong to it: they may grow.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from hashlib import blake2b
from typing import Any

import numpy as np

from sweeps.compute.values import rounded, scaled
from sweeps.fingerprint.sources import differing, sources
from sweeps.grid import Axis, Grid
from sweeps.plan.declaration import Declaration

LISTED = 20
# What differs is told in this order.
LEADING = ("constants", "axes", "groups", "variables", "coords")


def configuration(sweep: Declaration, grid: Grid) -> str:
    """Everything the values depend on, as one line of JSON; long axes by their ends and length.

    The axes are those of the file's grid; their values are the coordinates of the same file.
    """
    axes = {name: _summary(axis) for name, axis in grid.axes.items()}
    return json.dumps({"name": sweep.name, "axes": axes, "constants": plain(sweep.constants)})


def identity(sweep: Declaration) -> dict[str, Any]:
    """What stored results are compared by; JSON can hold it.

    Raises
    ------
    ValueError
        If the function depends on something that cannot be compared.
    """
    grid = sweep.grid
    # With what the engine itself does to a value.
    computing = [f for f in (sweep.function, sweep.key, sweep.scale, rounded, scaled) if f is not None]
    told = {
        "name": sweep.name,
        "axes": {
            name: {"units": axis.units, "text": axis.values.dtype.kind == "U"} for name, axis in grid.axes.items()
        },
        "groups": [list(group) for group in grid.groups],
        "constants": plain(sweep.constants),
        "variables": {
            name: {"dtype": v.dtype, "dims": list(v.dims), "digits": v.digits, "scale": v.scale, "units": v.units}
            for name, v in sweep.variables.items()
        },
        "coords": {name: _digest(axis.values) for name, axis in sweep.coords.items()},
        "sources": sources(*computing),
    }
    loaded: dict[str, Any] = json.loads(json.dumps(told))
    return loaded


def presentation(sweep: Declaration) -> str:
    """Digest of what else the file shows: names, titles, what is derived, and what counts as skipped."""
    shown: dict[str, Any] = {
        "title": sweep.title,
        "names": {
            name: each.long_name
            for group in (sweep.grid.axes, sweep.coords, sweep.variables)
            for name, each in group.items()
        },
        "units": {name: axis.units for name, axis in sweep.coords.items()},
        "code": [{} if f is None else sources(f) for f in (sweep.derive, sweep.grid.skip)],
    }
    return blake2b(json.dumps(shown).encode(), digest_size=8).hexdigest()


def differences(stored: Mapping[str, Any], present: Mapping[str, Any]) -> str:
    """What differs, in one line; "" if nothing does."""
    told = []
    for part in (*LEADING, *sorted({*stored, *present} - {*LEADING, "sources"})):
        for name, before, now in _changed(stored.get(part, ABSENT), present.get(part, ABSENT)):
            where = name.removeprefix(".")
            what = where if part == "constants" else f"{part} {where}".rstrip()
            told.append(f"{what} = {_short(before)} there, {_short(now)} here")
    modules = differing(stored.get("sources", {}), present["sources"])
    if modules:
        told.append(f"the code of {', '.join(modules[:3])}{' and others' if len(modules) > 3 else ''} has changed")
    return "; ".join(told[:4])


class _Absent:
    def __repr__(self) -> str:
        return "nothing"


ABSENT = _Absent()


def _changed(before: Any, now: Any, name: str = "") -> list[tuple[str, Any, Any]]:
    """Leaves that differ, with their dotted names."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        found = []
        for key in dict.fromkeys([*now, *before]):
            found += _changed(before.get(key, ABSENT), now.get(key, ABSENT), f"{name}.{key}")
        return found
    # JSON has no NaN that equals itself.
    return [] if json_equal(before, now) else [(name, before, now)]


def json_equal(one: Any, other: Any) -> bool:
    """Equality of what JSON holds, NaN included."""
    if isinstance(one, _Absent) or isinstance(other, _Absent):
        return one is other
    return json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)


def _short(value: Any) -> str:
    text = repr(value) if isinstance(value, _Absent) else json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _digest(values: np.ndarray) -> str:
    """Of the values of a coordinate, with its length."""
    content = str(values.dtype).encode() + np.ascontiguousarray(values).tobytes()
    return f"{len(values)} values {blake2b(content, digest_size=6).hexdigest()}"


def _summary(axis: Axis) -> Any:
    values = axis.values.tolist()
    return values if len(values) <= LISTED else {"first": values[0], "last": values[-1], "count": len(values)}


def plain(value: Any) -> Any:
    """A constant as JSON can hold it.

    Raises
    ------
    ValueError
        If it is nothing of the kind.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise ValueError(f"constants hold {value!r}, which cannot be written as JSON")
