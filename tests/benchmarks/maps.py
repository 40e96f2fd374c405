"""How much of a full grid a refined map computes, and how well it has its boundaries.

The full one of the regime takes some ten minutes on two cores.
"""

import tempfile

import numpy as np

from fivcore import Rig, sliding_modes
from studies import runner
from sweeps import DONE
from tests.benchmarks.tables import Column, Table
from tests.helpers.boundaries import distances

# 65 x 65 points, from 9 x 9.
STABILITY = ("theta=-10:20:9", "mu=0:0.5:9")
PLANES = {"growth_rate": STABILITY, "unstable_modes": STABILITY, "regime": ("V=log:2e-4:1e-2:9", "mu=0.01:0.4:9")}
HALVINGS = 3


def mapped(quantity, folder, levels):
    """The map on the finest lattice, refined or on every point."""
    x, y = PLANES[quantity]
    if not levels:
        x, y = (f"{side.rpartition(':')[0]}:{8 * 2**HALVINGS + 1}" for side in (x, y))
    _, plan = runner.plan_map(x, y, [quantity], refine=levels, out=f"{folder}/{levels}")
    return plan.run()


def apart(one, other):
    """Largest distance of the boundary edges of one map from those of the other, and the share within a cell."""
    found = distances(one, other)
    return [float(found.max(initial=0.0)), float(np.mean(found <= 1.0))]


def planes():
    """Refined maps beside full ones; distances of boundaries are in cells."""
    sliding_modes(Rig(), 5.0, 0.2)  # compiled before it is timed
    rows = []
    for quantity in PLANES:
        with tempfile.TemporaryDirectory() as folder:
            full, refined = (mapped(quantity, folder, n) for n in (0, HALVINGS))
            computed, time = refined["status"].values == DONE, full["wall_time"].values
            there, found = (
                data[quantity].values > 0.0 if quantity == "growth_rate" else data[quantity].values
                for data in (full, refined)
            )
            shares = [float(computed.mean()), float(time[computed].sum() / time.sum())]
            wrong = int(np.count_nonzero(found != there))
            rows.append([f"`{quantity}`", int(computed.sum()), *shares, wrong])
            rows[-1] += [*apart(there, found), *apart(found, there)]
    heads = (Column(each, "%", ".1f") for each in ("of the points", "of the time"))
    ends = (Column("full to refined, cells", form=".1f"), Column("within one cell", "%", ".1f"))
    back = (Column("refined to full, cells", form=".1f"), Column("within one cell", "%", ".1f"))
    return Table([Column("map"), Column("computed"), *heads, Column("points wrong"), *ends, *back], rows)


TABLES = {"planes": planes}
