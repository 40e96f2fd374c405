"""The identity of a sweep: results of two may be mixed only if all of it is equal.

The values of the axes do not belong to it: they may grow. The code of constants' classes does.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from sweeps.errors import InputError
from sweeps.fingerprint.code import differing, digest, digests
from sweeps.grid import Axis, Grid
from sweeps.plan.declaration import Declaration

# Longer axes are summarised.
LISTED = 20
ABSENT = object()
# Constants that follow from one request differ by less, relative, on processors and with libraries of any kind.
ROUNDING = 1e-9


def configuration(sweep: Declaration, grid: Grid) -> str:
    """Everything the values depend on, as one line of JSON; long axes by their ends and length.

    The axes are those of the file's grid; their values are the coordinates of the same file.
    """
    axes = {name: _summary(axis) for name, axis in grid.axes.items()}
    asked = {"request": plain(sweep.request)} if sweep.request else {}
    return json.dumps({"name": sweep.name, "axes": axes, "constants": plain(sweep.constants)} | asked)


def _summary(axis: Axis) -> Any:
    values = axis.values.tolist()
    return values if len(values) <= LISTED else {"first": values[0], "last": values[-1], "count": len(values)}


def fingerprint(sweep: Declaration, engine: tuple[Callable[..., Any], ...]) -> dict[str, Any]:
    """The identity by which results are compared, as JSON holds it; `engine` is what the engine does to a value.

    Raises
    ------
    ValueError
        If the function depends on something that cannot be compared.
    """
    axes, classes = sweep.grid.axes.items(), set[type]()
    functions = [each for each in (sweep.function, sweep.key, sweep.scale, *engine) if each is not None]
    # In the order in which differences are told.
    parts = {
        "constants": plain(sweep.constants, classes),
        "axes": {name: {"units": axis.units, "text": axis.values.dtype.kind == "U"} for name, axis in axes},
        "groups": sweep.grid.groups,
        "variables": {
            name: {"dtype": v.dtype, "dims": v.dims, "digits": v.digits, "scale": v.scale, "units": v.units}
            for name, v in sweep.variables.items()
        },
        "coords": {
            name: f"{len(axis.values)} values {digest(axis.values.dtype.str.encode() + axis.values.tobytes())}"
            for name, axis in sweep.coords.items()
        },
        "name": sweep.name,
        "sources": digests(*functions, *sorted(classes, key=repr)),
    }
    parts |= {"sample": plain(sweep.grid.drawn)} if sweep.grid.drawn else {}
    parts |= {"request": plain(sweep.request)} if sweep.request else {}
    loaded: dict[str, Any] = json.loads(json.dumps(parts))
    return loaded


def metadata_digest(sweep: Declaration) -> str:
    """Digest of what else the file shows: names, titles, what is derived, and what counts as skipped."""
    groups = (sweep.grid.axes, sweep.coords, sweep.variables)
    shown = {
        "title": sweep.title,
        "names": {name: each.long_name for group in groups for name, each in group.items()},
        "units": {name: axis.units for name, axis in sweep.coords.items()},
        "flags": {name: list(v.flags.items()) for name, v in sweep.variables.items() if v.flags},
        "code": [{} if f is None else digests(f) for f in (sweep.derive, sweep.grid.skip)],
    }
    return digest(json.dumps(shown).encode())


def differences(stored: Mapping[str, Any], present: Mapping[str, Any]) -> str:
    """The differences, in one line; "" if there are none.

    A constant may have been computed from what was asked for. Where both sides were asked for the same, constants
    differ if they do so by more than ROUNDING; what was asked for itself is compared by the constants.
    """
    found = []
    alike = "request" in present and stored.get("request") == present["request"]
    for name, before, now in _changed(stored, present):
        part, _, inner = name.partition(".")
        if part == "constants" and alike and _is_close(before, now):
            continue
        if part not in ("sources", "request"):
            what = inner if part == "constants" else f"{part} {inner}".rstrip()
            found.append(f"{what} = {_short(before)} there, {_short(now)} here")
    modules = differing(stored.get("sources", {}), present["sources"])
    if modules:
        others = " and others" if len(modules) > 3 else ""
        found.append(f"the code of {', '.join(modules[:3])}{others} has changed")
    return "; ".join(found[:4])


def _changed(before: Any, now: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Leaves that differ, with their dotted names."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for key in dict.fromkeys([*now, *before]):
            yield from _changed(before.get(key, ABSENT), now.get(key, ABSENT), f"{name}.{key}".lstrip("."))
    elif before is ABSENT or now is ABSENT or not json_equal(before, now):
        yield name, before, now


def _is_close(before: Any, now: Any) -> bool:
    """Whether numbers, or lists of them, are equal but for rounding."""
    if isinstance(before, list) and isinstance(now, list):
        return len(before) == len(now) and all(map(_is_close, before, now))
    if isinstance(before, float) and isinstance(now, float):
        return math.isclose(before, now, rel_tol=ROUNDING)
    return json_equal(before, now)


def json_equal(one: Any, other: Any) -> bool:
    """Equality of what JSON holds, NaN included, of which JSON has none that equals itself."""
    return json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)


def _short(value: Any) -> str:
    text = "nothing" if value is ABSENT else json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def plain(value: Any, classes: set[type] | None = None) -> Any:
    """A constant as JSON can hold it; the classes of what it holds are added to `classes`.

    Raises
    ------
    ValueError
        If it is nothing of the kind.
    """
    if classes is not None and type(value).__module__ != "builtins":
        classes.add(type(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(each, classes) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each, classes) for each in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise InputError(f"constants hold {value!r}, which cannot be written as JSON")
