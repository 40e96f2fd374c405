"""Damage to a file, and netCDF files of another shape than ours, by chance; each is described in a few words."""

import copy
import json
from contextlib import suppress

import netCDF4
import numpy as np

HOSTILE = "\x1b]0;owned\x07\x1b[2J\u202eowned"
DEEP = "[" * 100_000
# What may stand where JSON has something else, or what an attribute may be.
JSON = [None, True, 0, -1, 10**30, 1e308, float("nan"), "", "x", HOSTILE, [], [[]], {}, {"x": {}}, {"": [None]}]
ATTRIBUTES = [
    "",
    HOSTILE,
    DEEP,
    "{}",
    "[]",
    "null",
    "x" * 1_000_000,
    3.0,
    np.int8(-1),
    np.array([]),
    np.arange(4.0),
]
ATTRIBUTES += [np.nan, ["one", "two"], b"\xff\xfe\x00", "m" * 300, "\x00", "1e400 m", "seconds since 0"]
NUMBERS = [np.nan, np.inf, -np.inf, 0.0, -1.0, 1e300, -1e-300, 127.0]
PLAIN = ["f4", "f8", "i1", "i2", "i4", "i8", "u1", "u8"]
TYPES = [*PLAIN, "S1", str, "vlen", "compound", "enum"]


def harmed(rng, whole: bytes, kinds=None) -> tuple[str, bytes]:
    """The content of a file with a bit changed, or with one of larger damages, of all `kinds` or of these."""
    size, content = len(whole), bytearray(whole)
    place, length = int(rng.integers(size)), int(min(rng.choice([1, 16, 512, 4096]), size))
    # Often at the end, where a seal is.
    begin, other = (int(rng.choice([rng.integers(size - length + 1), size - length], p=[0.7, 0.3])) for _ in "ab")
    kind = drawn(rng, kinds or ["bit"] * 5 + ["end", "zeros", "exchange", "more"])
    if kind == "bit":
        bit = int(rng.integers(8))
        content[place] ^= 1 << bit
        return f"bit {bit} of byte {place}", bytes(content)
    if kind == "end":
        return f"cut at {place}", whole[:place]
    if kind == "zeros":
        content[begin : begin + length] = bytes(length)
        return f"zeros from {begin}, {length}", bytes(content)
    if kind == "exchange":
        first, second = whole[begin : begin + length], whole[other : other + length]
        content[begin : begin + length], content[other : other + length] = second, first
        return f"{begin} and {other} exchanged, {length}", bytes(content)
    return f"{length} bytes more", whole + rng.bytes(length)


def reshaped(rng, value):
    """JSON with something else at one place."""
    value = copy.deepcopy(value)
    inside = isinstance(value, (dict, list)) and len(value) > 0
    if not inside or rng.random() < 0.15:
        return drawn(rng, JSON)
    keys = list(value) if isinstance(value, dict) else range(len(value))
    key = drawn(rng, list(keys))
    if rng.random() < 0.15:
        del value[key]
    else:
        value[key] = reshaped(rng, value[key])
    return value


def drawn(rng, entries):
    """One of a list."""
    return entries[int(rng.integers(len(entries)))]


def crafted(rng, path, whole: bytes) -> str:
    """Write a netCDF file that has something else in one or two places than the one whose content is `whole`."""
    while True:
        path.unlink(missing_ok=True)
        # What the library itself does not write is drawn again.
        with suppress(RuntimeError):
            return _copied(rng, path, whole) if rng.random() < 0.35 else _changed(rng, path, whole)


def _changed(rng, path, whole):
    """The file with other attributes, values or names."""
    told = []
    path.write_bytes(whole)
    for _ in range(int(rng.integers(1, 3))):
        with _raw(netCDF4.Dataset(path, "a")) as file:
            told.append(drawn(rng, [_attribute, _attribute, _json, _values, _values, _renamed])(rng, file))
    return "; ".join(told)


def _raw(file):
    """A file whose values are given and taken as they are stored."""
    file.set_auto_maskandscale(False)
    file.set_auto_chartostring(False)
    return file


def _attribute(rng, file):
    where = drawn(rng, [file, *file.variables.values()])
    name = drawn(rng, [*where.ncattrs(), "flag_values", "flag_meanings", "units", "scale_factor", "coordinates"])
    if name in where.ncattrs() and rng.random() < 0.2:
        where.delncattr(name)
        return f"{where.name}.{name} left out"
    value = drawn(rng, ATTRIBUTES)
    if name == "_FillValue":
        return "as it was"
    where.setncattr(name, value)
    return f"{where.name}.{name} = {str(value)[:40]!r}"


def _json(rng, file):
    name = drawn(rng, ["configuration", "identity", "environments"])
    try:
        value = reshaped(rng, json.loads(file.getncattr(name)))
    except (AttributeError, ValueError, TypeError):
        return "as it was"
    file.setncattr(name, json.dumps(value))
    return f"{name} = {json.dumps(value)[:300]}"


def _values(rng, file):
    each = drawn(rng, list(file.variables.values()))
    values = np.array(each[...])
    if values.dtype.kind == "S":
        values = np.frombuffer(rng.bytes(values.size), "S1").reshape(values.shape)
        each[...] = values
        return f"{each.name} has letters by chance"
    how = drawn(rng, ["one", "all", "reversed", "equal"])
    with np.errstate(all="ignore"):
        value = np.asarray(drawn(rng, NUMBERS)).astype(values.dtype)
    if how == "one" and values.size:
        values.reshape(-1)[int(rng.integers(values.size))] = value
    elif how == "all":
        values[...] = value
    elif how == "reversed":
        values = values[::-1]
    elif values.size:
        values[...] = values.reshape(-1)[0]
    each[...] = values
    return f"{each.name}: {how}, {value}"


def _renamed(rng, file):
    what = drawn(rng, ["Dimension", "Variable", "Attribute"])
    entries = {"Dimension": file.dimensions, "Variable": file.variables, "Attribute": file.ncattrs()}[what]
    old = drawn(rng, list(entries))
    new = drawn(rng, ["else", "status", "x", "else\u202e", "configuration"])
    if new not in entries:
        getattr(file, f"rename{what}")(old, new)
    return f"{what} {old} is called {new!r}"


def _copied(rng, path, whole):
    """The file written anew, with one variable of another type or shape, or in another format."""
    with _raw(netCDF4.Dataset("whole", memory=whole)) as old:
        name = drawn(rng, list(old.variables))
        how = drawn(rng, ["type", "type", "dims", "dims", "without", "group", "format", "besides"])
        form = drawn(rng, ["NETCDF3_CLASSIC", "NETCDF3_64BIT_DATA", "NETCDF4_CLASSIC"])
        with netCDF4.Dataset(path, "w", format=form if how == "format" else "NETCDF4") as new:
            told = _fill(rng, old, new, name, how)
    return f"{form if how == 'format' else how} of {name}{told}"


def _fill(rng, old, new, name, how):
    told = ""
    for dim in old.dimensions.values():
        new.createDimension(dim.name, None if how == "dims" and rng.random() < 0.1 else len(dim))
    for length in (0, 50_000):
        new.createDimension(f"long{length}", length)
    for each in old.variables.values():
        kind, dims, where = each.dtype, each.dimensions, new
        if each.name == name:
            if how == "without":
                continue
            if how == "type":
                kind = drawn(rng, TYPES)
                told = f": {kind}"
            elif how == "dims":
                dims = _other_dims(rng, dims)
                told = f": {dims}"
            elif how == "group":
                where = new.createGroup(drawn(rng, ["of", "computed"]))
        _variable(where, each, kind, dims)
    if how == "besides":
        kind, dims = drawn(rng, TYPES), _other_dims(rng, ("x",))
        new.createVariable("besides", _type(new, kind), dims)
        told = f": {kind} {dims}"
    attributes = {key: old.getncattr(key) for key in old.ncattrs()}
    new.setncatts(attributes)
    return told


def _other_dims(rng, dims):
    others = ["x", "kind", "power", "long0", "long50000"]
    return drawn(
        rng,
        [
            dims[::-1],
            dims[1:],
            dims[:-1],
            (),
            (*dims, drawn(rng, others)),
            (drawn(rng, others), *dims),
            (others[4],) * 2,
        ],
    )


def _type(file, kind):
    """A type of a variable, which may be one of the file's own."""
    if kind == "vlen":
        return file.createVLType(np.int32, "vlen")
    if kind == "compound":
        return file.createCompoundType(np.dtype([("a", "f8"), ("b", "i4")]), "compound")
    if kind == "enum":
        return file.createEnumType(np.uint8, "enum", {"calm": 0, "wild": 1})
    return kind


def _variable(where, each, kind, dims):
    """A variable of another file, with its values as far as they fit."""
    same = kind == each.dtype
    if same and where.data_model != "NETCDF4" and kind.kind == "i":
        kind = "i4"
    made = where.createVariable(each.name, _type(where, kind), dims)
    made.set_auto_maskandscale(False)
    made.setncatts({key: each.getncattr(key) for key in each.ncattrs() if key != "_FillValue"})
    if made.shape == each.shape and (same or (kind in PLAIN and each.dtype.kind in "fi")):
        with np.errstate(all="ignore"):
            made[...] = each[...].astype(made.dtype)
