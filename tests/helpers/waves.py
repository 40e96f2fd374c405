"""Sweeps to store, resume, grow and refine; computed points are logged, and points can be made to fail."""

import numpy as np
import pytest

from sweeps import Axis, Grid, Refinement, Sweep, Variable, refined
from tests.helpers.state import Log, Told

# What was computed, and which points fail.
LOG, BROKEN = Log(), Told(points=set())
POWERS = Axis([1, 2, 3])


def number(values):
    """Axis values of any kind as numbers."""
    return np.array([sum(map(ord, v)) for v in values], float) if values.dtype.kind == "U" else values * 1.0


def wave(points, factor=1.0, rig=None):
    rows = list(zip(*(values.tolist() for values in points.values()), strict=True))
    LOG.extend(rows)
    if BROKEN["points"] & set(rows):
        raise ValueError(f"no result at {sorted(BROKEN['points'] & set(rows))}")
    total = factor * np.prod([number(values) + 1.0 for values in points.values()], axis=0)
    results = {"root": np.sqrt(total), "count": total.astype(int), "row": total[:, None] ** -POWERS.values}
    return results | {"word": [f"µ{each:g}" * int(each % 5) for each in total]}


def product(points):
    return np.prod([number(values) + 1.0 for values in points.values()], axis=0)


VARIABLES = {
    "root": Variable("m", "root"),
    "count": Variable("1", "count", dtype="int32"),
    "row": Variable("1", "row", ("power",), "float32"),
    "word": Variable(dtype="str"),
}
NAMES = list(VARIABLES)
GRID = {"x": [1.0, 2.0, 3.0], "y": [1.0, 3.0]}


def sweep(grid=None, function=wave, **changes):
    grid = grid or GRID
    if isinstance(grid, dict):
        grid = Grid({name: Axis(values, "m") for name, values in grid.items()})
    options = {"variables": VARIABLES, "coords": {"power": POWERS}}
    return Sweep("waves", function, grid, **(options | changes))


def stop_after(count):
    def progress(snapshot):
        if snapshot.done >= count:
            raise KeyboardInterrupt

    return progress


def interrupted(planned, count):
    with pytest.raises(KeyboardInterrupt):
        planned.run("sync", progress=stop_after(count))


# A sweep to refine.
HILLS = {"kind": Variable("1", "kind", dtype="int8"), "height": Variable("m", "height")}
SHOWN = [*HILLS, "status"]


def hill(points):
    rows = list(zip(*(values.tolist() for values in points.values()), strict=True))
    LOG.extend(rows)
    if BROKEN["points"] & set(rows):
        raise ValueError("no result")
    away = np.hypot(points["x"], points["y"])
    return {"kind": 1 * (away < 0.6), "height": np.exp(-4.0 * away**2)}


def cliff(points):
    return {"kind": 1 * (points["x"] > 0.0), "height": np.tanh(40.0 * (points["x"] - 0.3 * points["y"]))}


def hills(
    size=17, levels=2, variable="kind", ends=(-1.0, 1.25), tolerance=None, function=hill, skip=None, **changes
):
    axes = {"x": Axis(np.linspace(-1.0, 1.0, size), "m"), "y": Axis(np.linspace(*ends, size), "m")}
    options = {"variables": HILLS} | changes
    return refined(
        Sweep("hills", function, Grid(axes, skip=skip), **options), Refinement(variable, levels, tolerance)
    )


def truth_of(data):
    away = np.hypot(data["x"], data["y"])
    return (away < 0.6).astype(float), np.exp(-4.0 * away**2)
