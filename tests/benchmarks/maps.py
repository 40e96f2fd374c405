"""How much of a full grid a refined map computes, and how well it has its boundaries.

python -m tests.benchmarks.maps [--out FOLDER] [--members N] [--most SECONDS]

The maps are kept in the folder and completed from there; the full one of the regime takes some ten minutes on two
cores.
"""

import argparse
import tempfile

import numpy as np

from fivcore import Rig, sliding_modes
from studies.maps import maps
from studies.maps.quantities import RUN
from sweeps import DONE
from tests.helpers.boundaries import distances

# 65 x 65 points, from 9 x 9.
STABILITY = ("theta=-10:20:9", "mu=0:0.5:9")
PLANES = {"growth_rate": STABILITY, "unstable_modes": STABILITY, "regime": ("V=log:2e-4:1e-2:9", "mu=0.01:0.4:9")}
HALVINGS = 3


def mapped(quantity, folder, fixed, halvings):
    """The map on the finest lattice, refined or on every point."""
    plane = maps.plane_of(*PLANES[quantity], HALVINGS)
    sweep = maps.sweep_of(plane, quantity, fixed, halvings)
    return sweep.plan(maps.file_of(plane, quantity, f"{folder}/{halvings}")).run()


def apart(one, other):
    """Largest distance of the boundary edges of one map from those of the other, and the share within a cell."""
    found = distances(one, other)
    return f"{found.max(initial=0.0):.1f} ({100.0 * np.mean(found <= 1.0):.1f} %)"


def main():
    sliding_modes(Rig(), 5.0, 0.2)  # compiled before it is timed
    told = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    told.add_argument("--out", help="folder of the maps")
    told.add_argument("--members", type=int, default=int(RUN["members"].value))
    told.add_argument("--most", type=float, default=RUN["most"].value)
    asked = told.parse_args()
    print("| map | computed | of the time | points wrong | full to refined | refined to full |")
    print("| --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as temporary:
        for quantity in PLANES:
            fixed = {"members": asked.members, "most": asked.most} if quantity == "regime" else {}
            full, refined = (mapped(quantity, asked.out or temporary, fixed, n) for n in (0, HALVINGS))
            computed, time = refined["status"].values == DONE, full["wall_time"].values
            there, found = (
                data[quantity].values > 0.0 if quantity == "growth_rate" else data[quantity].values
                for data in (full, refined)
            )
            print(
                f"| `{quantity}` | {computed.sum()} ({100.0 * computed.mean():.1f} %) "
                f"| {100.0 * time[computed].sum() / time.sum():.1f} % | {np.count_nonzero(found != there)} "
                f"| {apart(there, found)} | {apart(found, there)} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
