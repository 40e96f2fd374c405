"""Standard errors of single runs: their estimator, what they leave out, and how often they hold."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from fivcore import Beam, Rig, Scene, simulate, simulate_many
from fivcore.transient.uncertainty import BLOCK, FEWEST, Blocks, Largest, cosines_for, errors_of_means

STATISTICS = (
    "stick_fraction", "slip_fraction", "separation_fraction", "velocity_rms", "mean_normal_force",
    "normal_force_999", "slip_speed_999", "switches_per_second", "mean_stick_time",
)  # fmt: skip
SHARES = STATISTICS[:3]
PAPER = Rig()
OTHER = replace(PAPER, p1=Beam(0.060, 0.010, 0.002, 185e9, 7900.0, 30))
# Intermittent are 1 and 1.3 mm/s and the other rig; at 1.3 mm/s, where intermittence ends, shares wander.
SCENES = {f"{V} mm/s": Scene(V * 1e-3, 5.0, 0.2, 9.0) for V in (1, 1.3, 2, 5)} | {
    "other rig": Scene(3e-3, 6.0, 0.3, 15.0, OTHER)
}
RUNS, DURATION = 200, 3.5


def runs_of(scene, duration, count=RUNS):
    """Summaries of runs that differ by their ramp."""
    for first in range(0, count, 40):
        ramps = [1e-3 * (1.0 + 0.013 * k) for k in range(first, min(first + 40, count))]
        yield from (run.summary for run in simulate_many([scene] * len(ramps), duration, ramp=ramps))


def coverage(figures, errors):
    """Share of the runs whose figure lies within 2 standard errors of the mean of all others."""
    known = np.isfinite(figures)
    others = (np.nansum(figures) - figures) / (known.sum() - 1)
    known &= np.isfinite(errors)
    return np.mean(np.abs(figures - others)[known] <= 2.0 * errors[known]), known.sum()
