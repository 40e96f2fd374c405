"""The fingerprint of a sweep: results of two sweeps are combined only if their fingerprints are equal.

The values of the axes are not part of it, since grids grow.
"""

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from enum import Enum
from typing import Any

import numpy as np
import pandas as pd

from sweeps.errors import InputError, StoreError
from sweeps.fingerprint.bytecode import COMPILER, digest
from sweeps.fingerprint.code import Covered, covered, digests, settle
from sweeps.grid import Declaration, Grid

# Longer axes are summarised in the configuration, and longer arrays.
LISTED, LONG = 20, 1000
# Parts of a fingerprint that are of code.
CODE = {"code", "sources", "compiler", "functions"}
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


def plain(value: Any) -> Any:
    """A constant in the form of JSON, with long arrays as their digest.

    An `InputError` for a type other than numbers, strings, arrays, tables, dataclasses and containers of these.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, pd.Series):
        value = value.to_frame()
    if isinstance(value, pd.DataFrame):
        value = {"index": value.index.to_numpy(), **{str(k): column.to_numpy() for k, column in value.items()}}
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if isinstance(value, (complex, np.complexfloating)):
        return [value.real, value.imag]
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, np.ndarray) and value.size > LONG and not value.dtype.hasobject:
        return f"array of shape {value.shape}, {digest(np.ascontiguousarray(value).tobytes())}"
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise InputError(f"constants contain {value!r}, which cannot be written as JSON")


def _is_exact(value: Any) -> bool:
    """Whether `plain` keeps all of a constant, its type and the types of its keys included."""
    if isinstance(value, (list, tuple)):
        return all(map(_is_exact, value))
    if isinstance(value, dict):
        return all(isinstance(key, str) and _is_exact(each) for key, each in value.items())
    return value is None or isinstance(value, (bool, int, float, str, np.integer, np.bool_))


def coverage(sweep: Declaration, engine: Sequence[Callable[..., Any]] = ()) -> Covered:
    """The code on which the values of a sweep depend, and the contents of constants that JSON does not keep."""
    values = {name: each for name, each in sweep.constants.items() if not _is_exact(each)}
    own = [each for each in (sweep.function, sweep.key, sweep.scale) if each is not None]
    return covered([*own, *engine], sweep.code, values)


def fingerprint(sweep: Declaration, reached: Covered) -> dict[str, Any]:
    """All properties in which results are compared, as JSON."""
    raw = {name: axis.values.dtype.str.encode() + axis.values.tobytes() for name, axis in sweep.coords.items()}
    coords = {name: f"{len(sweep.coords[name])} values {digest(each)}" for name, each in raw.items()}
    # In the order in which differences are reported.
    parts = {
        "constants": plain(sweep.constants),
        "values": reached.values,
        "axes": {k: {"units": a.units, "text": a.values.dtype.kind == "U"} for k, a in sweep.grid.axes.items()},
        "groups": sweep.grid.groups,
        "variables": {k: {what: getattr(v, what) for what in COMPARED} for k, v in sweep.stored.items()},
        "coords": coords,
        "name": sweep.name,
        "code": reached.code,
        "sources": reached.sources,
        "compiler": COMPILER,
    }
    parts |= {"sample": plain(sweep.grid.sampling)} if sweep.grid.sampling else {}
    alone = {name: covered([each]) for name, each in sweep.functions.items()}
    parts |= {"functions": {k: {"code": v.code, "sources": v.sources} for k, v in alone.items()}} if alone else {}
    return dict(json.loads(json.dumps(parts)))


@contextmanager
def steady(sweep: Declaration, engine: Sequence[Callable[..., Any]], planned: str) -> Iterator[None]:
    """Refuse to compute with other code or constants than planned; a StoreError names the change.

    Changes that the code makes while it runs, such as a cache, do not count.
    """

    def codes(reached: Covered) -> list[dict[str, str]]:
        return [reached.code, *(digests([each]) for each in sweep.functions.values())]

    reached = coverage(sweep, engine)
    if changed := differences(json.loads(planned), fingerprint(sweep, reached)):
        raise StoreError(f"{sweep.name} has changed since this was planned ({changed}); plan again")
    before = codes(reached)
    try:
        yield
    finally:
        with suppress(InputError):
            for each in zip(before, codes(coverage(sweep, engine)), strict=True):
                settle(*each)


def metadata_digest(sweep: Declaration) -> str:
    """Digest of all other parts of the file: names, titles, and the code that derives variables or skips."""
    shown = {
        "title": sweep.title,
        "names": {k: v.long_name for k, v in {**sweep.grid.axes, **sweep.coords, **sweep.variables}.items()},
        "units": {name: axis.units for name, axis in sweep.coords.items()},
        "flags": {name: list(v.flags.items()) for name, v in sweep.variables.items() if v.flags},
        "code": [{} if f is None else digests([f]) for f in (sweep.derive, sweep.grid.skip)],
    }
    return digest(json.dumps(shown).encode())


def differences(stored: Mapping[str, Any], present: Mapping[str, Any], *, code: bool = True) -> str:
    """Describe how two fingerprints differ, in one line; "" if they are equal.

    Differences of code are left out without `code`, and where constants differ, which code may depend on.
    """
    before, now = ({name: each for name, each in both.items() if name not in CODE} for both in (stored, present))
    if "compiler" not in stored:  # of an earlier version, which had no digests of values
        now.pop("values", None)
    lines, shown = list[str](), set[str]()
    for name, *values in _changed(before, now):
        part, _, inner = name.partition(".")
        if (part == "values" and inner in shown) or (part == "coords" and shown):  # with its numbers
            continue
        shown |= {inner.partition(".")[0]} if part == "constants" else set()
        there, here = ("nothing" if value is ABSENT else json.dumps(value) for value in values)
        what = {"constants": inner, "values": f"the content of {inner}"}.get(part, f"{part} {inner}".rstrip())
        lines.append(f"{what} = {_shortened(there)} there, {_shortened(here)} here")
    if code and not shown and (line := _code_difference(stored, present)):
        lines.insert(3, line)
    return "; ".join(lines[:4])


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."


def recompiled(attributes: Mapping[str, str], present: Mapping[str, Any]) -> str:
    """A note that stored results come from the same sources compiled by another Python; "" if they do not."""
    compiler = json.loads(attributes.get("fingerprint", "{}")).get("compiler")
    if compiler in (None, present.get("compiler")):
        return ""
    return f"results are computed by code that {compiler} has compiled; the sources are the same"


def restricted(present: Mapping[str, Any], stored: Mapping[str, Any]) -> dict[str, Any]:
    """A fingerprint without the variables that a stored one lacks, their dimensions and their functions."""
    parts = {part: present.get(part, {}) for part in ("variables", "coords", "functions")}
    kept = {part: {k: v for k, v in each.items() if k in stored.get(part, {})} for part, each in parts.items()}
    return {**present, **kept}


def _code_difference(stored: Mapping[str, Any], present: Mapping[str, Any]) -> str:
    compiler = stored.get("compiler")
    if compiler is None:
        return "the fingerprint of its code is of an earlier version of sweeps"
    if compiler != present["compiler"]:
        # Another Python compiles otherwise, so the sources decide.
        sources = [_functions(each, "sources") | {"": each["sources"]} for each in (stored, present)]
        same = sources[0] == sources[1]
        return "" if same else f"the sources have changed since {compiler} compiled them"
    names = sorted(name for name, *_ in _changed(stored["code"], present["code"]))
    others = " and others" if len(names) > 3 else ""
    if names:
        return f"the code of {', '.join(names[:3])}{others} has changed"
    alone = sorted(name for name, *_ in _changed(_functions(stored, "code"), _functions(present, "code")))
    return f"the function of {', '.join(alone)} has changed" if alone else ""


def _functions(each: Mapping[str, Any], what: str) -> dict[str, Any]:
    """Digests of the variables with a function of their own."""
    return {name: json.dumps(own[what]) for name, own in each.get("functions", {}).items()}


def _changed(before: Any, now: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for key in dict.fromkeys([*now, *before]):
            yield from _changed(before.get(key, ABSENT), now.get(key, ABSENT), f"{name}.{key}".lstrip("."))
    elif before is ABSENT or now is ABSENT or not json_equal(before, now):
        yield name, before, now


def json_equal(one: Any, other: Any) -> bool:
    """Whether two values are equal as JSON; NaN equals NaN."""
    return json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)
