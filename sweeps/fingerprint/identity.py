"""The fingerprint of a sweep: results of two sweeps mix only if all of it is equal.

The values of the axes are not part of it, since grids grow. The code of constants' classes is.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from hashlib import blake2b
from typing import Any

from sweeps.declaration import Declaration
from sweeps.fingerprint.code import digests, libraries, plain
from sweeps.grid import Axis, Grid

# Longer axes are summarised in the configuration.
LISTED = 20
ABSENT = object()


def configuration(sweep: Declaration, grid: Grid) -> str:
    """Name, axes, constants and request of a sweep as one line of JSON; long axes by their ends and length.

    The axes are those of the file's grid, whose values are coordinates in the same file.
    """
    axes = {name: _summary(axis) for name, axis in grid.axes.items()}
    request = {"request": plain(sweep.request)} if sweep.request else {}
    return json.dumps({"name": sweep.name, "axes": axes, "constants": plain(sweep.constants)} | request)


def _summary(axis: Axis) -> Any:
    values = axis.values.tolist()
    return values if len(values) <= LISTED else {"first": values[0], "last": values[-1], "count": len(values)}


def functions_of(sweep: Declaration) -> list[Callable[..., Any]]:
    """The functions and classes whose code decides the values of a sweep."""
    classes = set[type]()
    plain(sweep.constants, classes)
    functions = (sweep.function, sweep.key, sweep.scale)
    return [*(each for each in functions if each is not None), *sorted(classes, key=repr)]


def libraries_of(sweep: Declaration) -> list[str]:
    """Names of the installed packages that the code of a sweep imports."""
    return libraries(functions_of(sweep), sweep.code)


def fingerprint(sweep: Declaration, engine: tuple[Callable[..., Any], ...]) -> dict[str, Any]:
    """Everything by which results are compared, as JSON represents it.

    Parameters
    ----------
    sweep : Declaration
    engine : tuple of callable
        Functions of this package that change a value.

    Raises
    ------
    InputError
        If the function depends on a value that cannot be compared, or the declared code does not exist.
    """
    # In the order in which differences are reported.
    parts = {
        "constants": plain(sweep.constants),
        "axes": {
            name: {"units": axis.units, "text": axis.values.dtype.kind == "U"}
            for name, axis in sweep.grid.axes.items()
        },
        "groups": sweep.grid.groups,
        "variables": {
            name: {"dtype": v.dtype, "dims": v.dims, "digits": v.digits, "scale": v.scale, "units": v.units}
            for name, v in sweep.stored.items()
        },
        "coords": {
            name: f"{len(axis)} values {_digest(axis.values.dtype.str.encode() + axis.values.tobytes())}"
            for name, axis in sweep.coords.items()
        },
        "name": sweep.name,
        "code": digests([*functions_of(sweep), *engine], sweep.code),
    }
    parts |= {"sample": plain(sweep.grid.sampling)} if sweep.grid.sampling else {}
    loaded: dict[str, Any] = json.loads(json.dumps(parts))
    return loaded


def metadata_digest(sweep: Declaration) -> str:
    """Digest of everything else in the file: names, titles, and the code that derives variables or skips."""
    groups = (sweep.grid.axes, sweep.coords, sweep.variables)
    shown = {
        "title": sweep.title,
        "names": {name: each.long_name for group in groups for name, each in group.items()},
        "units": {name: axis.units for name, axis in sweep.coords.items()},
        "flags": {name: list(v.flags.items()) for name, v in sweep.variables.items() if v.flags},
        "code": [{} if f is None else digests([f]) for f in (sweep.derive, sweep.grid.skip)],
    }
    return _digest(json.dumps(shown).encode())


def differences(stored: Mapping[str, Any], present: Mapping[str, Any]) -> str:
    """Describe how two fingerprints differ, in one line; "" if they are equal."""
    lines, names = list[str](), list[str]()
    for name, before, now in _changed(stored, present):
        part, _, inner = name.partition(".")
        if part == "code":
            names.append(inner)
        else:
            what = inner if part == "constants" else f"{part} {inner}".rstrip()
            lines.append(f"{what} = {_short(before)} there, {_short(now)} here")
    if names:
        others = " and others" if len(names) > 3 else ""
        lines.append(f"the code of {', '.join(sorted(names)[:3])}{others} has changed")
    return "; ".join(lines[:4])


def _changed(before: Any, now: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Leaves that differ, with their dotted names."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for key in dict.fromkeys([*now, *before]):
            yield from _changed(before.get(key, ABSENT), now.get(key, ABSENT), f"{name}.{key}".lstrip("."))
    elif before is ABSENT or now is ABSENT or not json_equal(before, now):
        yield name, before, now


def json_equal(one: Any, other: Any) -> bool:
    """Whether two values are equal as JSON; NaN equals NaN."""
    return json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)


def _short(value: Any) -> str:
    text = "nothing" if value is ABSENT else json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _digest(content: bytes) -> str:
    return blake2b(content, digest_size=8).hexdigest()
