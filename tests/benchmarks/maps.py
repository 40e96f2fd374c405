"""How much of a full grid a refined map computes, and how well it has its boundaries.

python -m tests.benchmarks.maps [--out FOLDER] [--members N] [--most SECONDS]

The full grids are kept in the folder and completed from there; the regime's two take some ten minutes each on two
cores. A regime is decided by an ensemble of chaotic motions, so that near a boundary another ensemble decides
otherwise here and there: the last lines compare the full grid with one of other ramps.
"""

import argparse
import tempfile
from dataclasses import replace

import numpy as np

from fivcore import Rig, sliding_modes
from studies.maps import maps
from studies.maps.quantities import QUANTITIES, RUN
from studies.motion import ensembles
from sweeps import Refinement
from tests.helpers.boundaries import distances, explored

# 65 x 65 points, and the halvings that begin with 5, 9 and 17 values along each axis.
PLANES = {
    "growth_rate": ("theta=-10:20:9", "mu=0:0.5:9"),
    "unstable_modes": ("theta=-10:20:9", "mu=0:0.5:9"),
    "regime": ("V=log:2e-4:1e-2:9", "mu=0.01:0.4:9"),
}
HALVINGS = 3
STARTS = (4, 3, 2)


def full(quantity, folder, fixed):
    """Every point of the finest lattice."""
    plane = maps.plane_of(*PLANES[quantity], HALVINGS)
    sweep = maps.sweep_of(plane, quantity, fixed)
    return sweep.plan(maps.file_of(plane, quantity, folder)).run()


def classes(quantity, data):
    """What the boundaries lie between."""
    values = data[quantity].values
    return values > 0.0 if quantity == "growth_rate" else values


def apart(one, other):
    """Largest distance of the boundary edges of one map from those of the other, and the share within a cell."""
    found = distances(one, other)
    return f"{found.max(initial=0.0):.1f} ({100.0 * np.mean(found <= 1.0):.1f} %)"


def rows(quantity, data, tolerance):
    """A line for each start."""
    there = classes(quantity, data)
    time = data["wall_time"].values
    for levels in STARTS:
        limit = None if QUANTITIES[quantity].whole else tolerance
        refinement = Refinement(quantity, levels, limit, QUANTITIES[quantity].thresholds)
        values, computed, passes = explored(
            data[quantity].values, levels, replace(refinement, whole=QUANTITIES[quantity].whole)
        )
        found = values > 0.0 if quantity == "growth_rate" else values
        start = 2 ** (6 - levels) + 1
        what = quantity if limit is None else f"{quantity}, tolerance {limit:g}"
        yield (
            f"| {what} | {start} x {start} | {computed.sum()} ({100.0 * computed.mean():.1f} %) "
            f"| {100.0 * time[computed].sum() / time.sum():.1f} % | {passes} | {np.count_nonzero(found != there)} "
            f"| {apart(there, found)} | {apart(found, there)} |"
        )


def main():
    sliding_modes(Rig(), 5.0, 0.2)  # compiled before it is timed
    told = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    told.add_argument("--out", help="folder of the full grids")
    told.add_argument("--members", type=int, default=int(RUN["members"].value))
    told.add_argument("--most", type=float, default=RUN["most"].value)
    asked = told.parse_args()
    print("| map, 65 x 65 | start | computed | of the time | passes | wrong | full to refined | refined to full |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as temporary:
        folder = asked.out or temporary
        for quantity, tolerance in (
            ("growth_rate", 1.0),
            ("growth_rate", maps.TOLERANCE),
            ("unstable_modes", None),
        ):
            print(*rows(quantity, full(quantity, folder, {}), tolerance), sep="\n")
        run = {"members": asked.members, "most": asked.most}
        one = full("regime", f"{folder}/one", run)
        print(*rows("regime", one, None), sep="\n", flush=True)
        # As if the ensemble went on.
        ramp = ensembles.ramp_of(asked.members + 1, RUN["ramp"].value)
        other = full("regime", f"{folder}/other", run | {"ramp": ramp})
    differ = np.count_nonzero(one["regime"].values != other["regime"].values)
    print(
        f"\nregime, another full grid, ramp {1e3 * ramp:g} ms: {differ} points differ; boundaries apart, in cells:"
    )
    for here, there in ((one, other), (other, one)):
        print(apart(classes("regime", here), classes("regime", there)))


if __name__ == "__main__":
    main()
