"""A small result that has something of everything a query can meet."""

import numpy as np

from sweeps import Axis, Grid, Sweep, Variable

A = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
B = np.array([1e-3, 1e-2, 0.1, 1.0])
WORDS = ("calm", "steady_sliding", "wild")
FAILS = (3.0, 0.1)


def points(keep):
    """The points that are to be kept, in the order of the file."""
    return [(a, b) for a in A for b in B if keep(a, b)]


def pairs(frame):
    """The points of the rows of a query."""
    return list(zip(frame["a"], frame["b"], strict=True))


def trial(points, level, note, rig):
    a, b = points["a"], points["b"]
    if np.any((a == FAILS[0]) & (b == FAILS[1])):
        raise ValueError('no result, "really";\nnone')
    modes = np.where(np.arange(1, 4) <= a[:, None], a[:, None] + 10.0 * np.arange(1, 4) * b[:, None], np.nan)
    return {
        "size": a * np.sqrt(b),
        "share": np.where(a > 0.0, b / 3.0, np.nan),
        "kind": (a % 3).astype(int),
        "count": (10 * a).astype(int),
        "mode_size": modes,
        "sided": a[:, None] * np.array([1.0, -1.0]),
        "member_kind": np.stack([a % 3, (a + 1) % 3], axis=1).astype(int),
    }


def finish(dataset):
    for name in ("kind", "member_kind"):
        dataset[name].attrs.pop("units")
        dataset[name].attrs |= {"flag_values": np.arange(3, dtype=np.int8), "flag_meanings": " ".join(WORDS)}
    return dataset.assign(
        a_name=("a", np.array(["nil", "one", "two", "three", "four"], dtype=object), {"long_name": "name of a"}),
        top=("a", A**2, {"units": "m", "long_name": "largest"}),
        peak_size=("peak", [2.0, 3.0], {"units": "m", "long_name": "peak"}),
        whole=((), 7.5, {"units": "s", "long_name": "one for all"}),
    )


def sweep(function=trial):
    variables = {
        "size": Variable("m", "size"),
        "share": Variable("1", "share", dtype="float32"),
        "kind": Variable("1", "kind", dtype="int8"),
        "count": Variable("1", "count", dtype="int16"),
        "mode_size": Variable("Hz", "size of a mode", ("mode",)),
        "sided": Variable("1", "of a side", ("side",)),
        "member_kind": Variable("1", "kind of a member", ("member",), "int8"),
    }
    coords = {
        "mode": Axis([1, 2, 3]),
        "side": Axis(["left", "right"]),
        "member": Axis([1, 2]),
    }
    constants = {"level": 2.5, "note": "dry", "rig": {"d1": 50.0, "p1": {"length": 0.05}}}
    grid = Grid({"a": Axis(A, "m", "a"), "b": Axis(B, "s", "b")})
    return Sweep("trial", function, grid, variables, constants, coords=coords, title="A trial", derive=finish)
