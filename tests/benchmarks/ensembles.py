"""Statistics of `fast`, with the published scheme's numerical damping, beside those of that scheme itself.

Over ensembles whose runs differ by the ramp.

The first four scenes and that of the aluminium P2 were looked at while the reduced model was made (the latter
for its default cut-off); the others were not.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd

from fivcore import Beam, Rig, Scene, simulate
from tests.benchmarks.tables import Column, Table

ALUMINIUM = Rig(
    Beam(0.04, 0.012, 0.0012, 200e9, 7800.0, 24),
    Beam(0.12, 0.020, 0.0030, 70e9, 2700.0, 60),
    contact_position=0.07,
    head_mass=1.5,
)
BRASS = Rig(
    Beam(0.06, 0.010, 0.0020, 185e9, 7900.0, 30),
    Beam(0.20, 0.015, 0.0040, 105e9, 8500.0, 80),
    contact_position=0.12,
    head_mass=4.0,
)
TITANIUM = Rig(
    Beam(0.045, 0.012, 0.0018, 110e9, 4430.0, 28),
    Beam(0.16, 0.018, 0.0035, 200e9, 7850.0, 80),
    contact_position=0.09,
    head_mass=2.0,
)
SHORT = Rig(
    Beam(0.030, 0.008, 0.0012, 185e9, 7900.0, 20),
    Beam(0.10, 0.012, 0.0025, 185e9, 7900.0, 60),
    contact_position=0.055,
    head_mass=1.0,
)
SCENES = {
    "1 mm/s": Scene(1e-3, 5.0, 0.20, 9.0),
    "2 mm/s": Scene(2e-3, 5.0, 0.20, 9.0),
    "3 mm/s": Scene(3e-3, 5.0, 0.20, 9.0),
    "5 mm/s": Scene(5e-3, 5.0, 0.20, 9.0),
    "theta 3": Scene(2.5e-3, 3.0, 0.18, 9.0),
    "theta 7": Scene(4e-3, 7.0, 0.25, 9.0),
    "theta 10": Scene(2e-3, 10.0, 0.30, 5.0),
    "theta 12": Scene(3e-3, 12.0, 0.35, 9.0),
    "theta 15": Scene(5e-3, 15.0, 0.40, 9.0),
    "mu 0.14, 20 N": Scene(2e-3, 5.0, 0.14, 20.0),
    "contact at 65 mm": Scene(3e-3, 6.0, 0.22, 9.0, Rig(contact_position=0.065)),
    "contact at 110 mm": Scene(2e-3, 8.0, 0.30, 9.0, Rig(contact_position=0.110)),
    "aluminium P2": Scene(3e-3, 6.0, 0.25, 6.0, ALUMINIUM),
    "brass P2": Scene(4e-3, 5.0, 0.25, 12.0, BRASS),
    "titanium P1": Scene(3e-3, 6.0, 0.28, 8.0, TITANIUM),
    "short beams": Scene(3e-3, 8.0, 0.30, 6.0, SHORT),
}
FRACTIONS = ("stick_fraction", "slip_fraction", "separation_fraction")


def members(name: str, method: str, count: int, duration: float = 2.4) -> list[dict]:
    """Summaries of runs of a scene that differ by the ramp."""
    ramps = [1e-3 * (1.0 + 0.013 * k) for k in range(count)]
    given = {"numerical_damping": "published"}
    return [simulate(SCENES[name], duration, method, ramp=ramp, **given).summary for ramp in ramps]


def mean(values: Iterable[float]) -> tuple[float, float]:
    """Mean of the finite values and its standard error."""
    finite = pd.Series(values, dtype=float)
    return finite.mean(), finite.sem()


def statistics(count: int = 3) -> Table:
    """Each cell `paper` / `fast`, of which there are twice as many members; shares with standard errors."""
    columns = [Column("scene"), *(Column(key.removesuffix("_fraction"), form=".3f") for key in FRACTIONS)]
    columns += [Column("dominant frequency", "Hz", ".0f"), Column("RMS", "mm/s", ".2f")]
    rows = []
    for name in SCENES:
        row, both = [name], (members(name, "paper", count), members(name, "fast", 2 * count))
        for key in FRACTIONS:
            pairs = [mean(run[key] for run in runs) for runs in both]
            row.append([{"mean": value, "se": error} for value, error in pairs])
        for key, unit in (("dominant_frequency", 1.0), ("velocity_rms", 1e3)):
            row.append([unit * mean(run[key] for run in runs)[0] for runs in both])
        gaps = ([run["first_separation_time"] - run["first_slip_time"] for run in runs[:count]] for runs in both)
        rows.append([*row, [1e3 * float(np.mean(each)) for each in gaps]])
    return Table([*columns, Column("slip to separation", "ms", ".2f")], rows)


TABLES = {"statistics": statistics}
