"""The fingerprint of a sweep: results of two sweeps mix only if all of it is equal.

The values of the axes are not part of it, since grids grow. The code of constants' classes is.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from sweeps.fingerprint.code import digest, digests, plain
from sweeps.grid import Declaration, Grid

# Longer axes are summarised in the configuration.
LISTED = 20
ABSENT = object()
# Properties of a variable by which results are compared.
COMPARED = ("dtype", "dims", "digits", "scale", "units")


def configuration(sweep: Declaration, grid: Grid) -> str:
    """Name, axes of the file's grid, constants and request as one line of JSON; long axes by ends and length."""
    axes: dict[str, Any] = {name: axis.values[:LISTED].tolist() for name, axis in grid.axes.items()}
    for name, axis in grid.axes.items():
        if len(axis) > LISTED:
            axes[name] = {"first": axes[name][0], "last": axis.values[-1].item(), "count": len(axis)}
    request = {"request": plain(sweep.request)} if sweep.request else {}
    return json.dumps({"name": sweep.name, "axes": axes, "constants": plain(sweep.constants)} | request)


def functions_of(sweep: Declaration) -> list[Callable[..., Any]]:
    """The functions and classes whose code decides the values of a sweep."""
    classes = set[type]()
    plain(sweep.constants, classes)
    functions = (sweep.function, sweep.key, sweep.scale)
    return [*(each for each in functions if each is not None), *sorted(classes, key=repr)]


def fingerprint(sweep: Declaration, engine: tuple[Callable[..., Any], ...]) -> dict[str, Any]:
    """Everything by which results are compared, as JSON; `engine` are functions here that change values."""
    raw = {name: axis.values.dtype.str.encode() + axis.values.tobytes() for name, axis in sweep.coords.items()}
    coords = {name: f"{len(sweep.coords[name])} values {digest(each)}" for name, each in raw.items()}
    # In the order in which differences are reported.
    parts = {
        "constants": plain(sweep.constants),
        "axes": {k: {"units": a.units, "text": a.values.dtype.kind == "U"} for k, a in sweep.grid.axes.items()},
        "groups": sweep.grid.groups,
        "variables": {k: {what: getattr(v, what) for what in COMPARED} for k, v in sweep.stored.items()},
        "coords": coords,
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
    return digest(json.dumps(shown).encode())


def differences(stored: Mapping[str, Any], present: Mapping[str, Any]) -> str:
    """Describe how two fingerprints differ, in one line; "" if they are equal."""
    lines, names = list[str](), list[str]()
    for name, *both in _changed(stored, present):
        part, _, inner = name.partition(".")
        if part == "code":
            names.append(inner)
        else:
            texts = ["nothing" if value is ABSENT else json.dumps(value) for value in both]
            before, now = (text if len(text) <= 60 else f"{text[:57]}..." for text in texts)
            what = inner if part == "constants" else f"{part} {inner}".rstrip()
            lines.append(f"{what} = {before} there, {now} here")
    if names:
        others = " and others" if len(names) > 3 else ""
        lines.append(f"the code of {', '.join(sorted(names)[:3])}{others} has changed")
    return "; ".join(lines[:4])


def _changed(before: Any, now: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for key in dict.fromkeys([*now, *before]):
            yield from _changed(before.get(key, ABSENT), now.get(key, ABSENT), f"{name}.{key}".lstrip("."))
    elif before is ABSENT or now is ABSENT or not json_equal(before, now):
        yield name, before, now


def json_equal(one: Any, other: Any) -> bool:
    """Whether two values are equal as JSON; NaN equals NaN."""
    return json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)
