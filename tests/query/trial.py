"""A small result that has everything a query can meet: 20 points, words, entries, texts, a failed point, gaps."""

import numpy as np
import xarray as xr

A, B = np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([1e-3, 1e-2, 0.1, 1.0])
FAILED = (3.0, 0.1)
KINDS = {"flag_values": np.array([4, 5, 7], np.int8), "flag_meanings": "calm steady_sliding wild"}
STATUS = {"flag_values": np.arange(3, dtype=np.int8), "flag_meanings": "pending done failed"}


def trial() -> xr.Dataset:
    a, b = np.meshgrid(A, B, indexing="ij")
    failed = (a == FAILED[0]) & (b == FAILED[1])
    codes, modes, members = np.array([4, 5, 7], np.float32), np.arange(1, 4), np.stack([a, a + 1], -1)
    sizes = a[..., None] + 10 * modes * b[..., None]
    sizes[(modes > a[..., None]) | failed[..., None]] = np.nan
    variables = {
        "mode_size": (("a", "b", "mode"), sizes, {"units": "Hz"}),
        "size": (("a", "b"), np.where(failed, np.nan, a * np.sqrt(b)), {"units": "m", "long_name": "how large"}),
        "share": (("a", "b"), np.where(failed | (a == 0), np.nan, b / 3).astype(np.float32), {"units": "1"}),
        "kind": (("a", "b"), np.where(failed, np.nan, codes[a.astype(int) % 3]), KINDS),
        "size_se": (("a", "b"), 0.1 * a, {"units": "m"}),
        "sure": (("a", "b"), a > 2),
        "top": ("a", A.astype(int) ** 2, {"long_name": "largest of all"}),
        "member_kind": (("a", "b", "member"), codes[members.astype(int) % 3], KINDS),
        "sided": (("a", "b", "side"), a[..., None] * [1.0, -1.0]),
        "peak_size": ("peak", [2.0, 3.0], {"units": "m"}),
        "status": (("a", "b"), np.where(failed, 2, 1).astype(np.int8), STATUS),
        "error": (("a", "b"), np.where(failed, 'ValueError: "really";\nnone', "").astype(object)),
        "wall_time": (("a", "b"), 0.5 + a, {"units": "s"}),
    }
    coords = {
        "a": ("a", A, {"units": "m s-1", "long_name": "speed of the drive"}),
        "b": ("b", B, {"units": "s"}),
        "name": ("a", np.array(["nil", "one_a", "two", "three", "four"], object)),
        **{"mode": modes, "member": [1, 2], "side": ["left", "right"]},
        **{"level": ((), 2.5, {"units": "m"}), "method": "fast"},
    }
    return xr.Dataset(variables, coords)


def places(frame) -> list[int]:
    """The numbers of the points of rows, which have a and b."""
    points = [(a, b) for a in A for b in B]
    return [points.index(pair) for pair in zip(frame["a"], frame["b"], strict=True)]
