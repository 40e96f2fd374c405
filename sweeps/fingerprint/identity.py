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
from sweeps.grid import Grid

# Longer axes are summarised in the configuration.
LISTED = 20
ABSENT = object()
# Properties of a variable by which results are compared.
COMPARED = ("dtype", "dims", "digits", "scale", "units")


def configuration(sweep: Declaration, grid: Grid) -> str:
    """Name, axes of the file's grid, constants and request as one line of JSON; long axes by ends and length."""
    axes: dict[str, Any] = {}
    for name, axis in grid.axes.items():
        values = axis.values.tolist()
        ends = {"first": values[0], "last": values[-1], "count": len(values)}
        axes[name] = values if len(values) <= LISTED else ends
    request = {"request": plain(sweep.request)} if sweep.request else {}
    return json.dumps({"name": sweep.name, "axes": axes, "constants": plain(sweep.constants)} | request)


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
    """Everything by which results are compared, as JSON; `engine` are functions here that change values."""
    # In the order in which differences are reported.
    parts = {
        "constants": plain(sweep.constants),
        "axes": {k: {"units": a.units, "text": a.values.dtype.kind == "U"} for k, a in sweep.grid.axes.items()},
        "groups": sweep.grid.groups,
        "variables": {k: {what: getattr(v, what) for what in COMPARED} for k, v in sweep.stored.items()},
        "coords": {
            k: f"{len(a)} values {_digest(a.values.dtype.str.encode(), a.values.tobytes())}"
            for k, a in sweep.coords.items()
        },
        "name": sweep.name,
        "code": digests([*functions_of(sweep), *engine], sweep.code),
    }
    parts |= {"sample": plain(sweep.grid.sampling)} if sweep.grid.sampling else {}
    return dict(json.loads(json.dumps(parts)))


def metadata_digest(sweep: Declaration) -> str:
    """Digest of everything else in the file: names, titles, and the code that derives variables or skips."""
    shown = {
        "title": sweep.title,
        "names": {k: v.long_name for k, v in {**sweep.grid.axes, **sweep.coords, **sweep.variables}.items()},
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


def _digest(*content: bytes) -> str:
    return blake2b(b"".join(content), digest_size=8).hexdigest()
