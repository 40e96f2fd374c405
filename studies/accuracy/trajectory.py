"""A motion up to its first separation, and how far it is from another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fivcore import Transient

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Track:
    """A motion at some times, and when its surfaces first slipped and parted.

    Attributes
    ----------
    time, velocity_B, normal_force : ndarray, (n,)
    first_slip_time, first_separation_time : float
        s; NaN if never.
    """

    time: Array
    velocity_B: Array
    normal_force: Array
    first_slip_time: float
    first_separation_time: float


def track_of(run: Transient) -> Track:
    """What `fivcore.simulate` recorded."""
    firsts = (float(run.summary[f"first_{what}_time"]) for what in ("slip", "separation"))
    return Track(run.time, run.velocity_B, run.normal_force, *firsts)


def errors(found: Track, reference: Track) -> dict[str, float]:
    """How far a motion is from a reference, up to whichever parts first.

    What grows until the surfaces part oscillates at up to 100 kHz, and a small error of its phase or of its rate
    is soon as large as the motion itself. So errors are taken over two stretches: to half-way between the
    reference's first slip and first separation, and to the separation.

    Returns
    -------
    dict
        `slip_velocity_error`, `slip_force_error` (half-way), `burst_velocity_error`, `burst_force_error`: the
        largest difference over the largest value; `burst_delay_error`: the difference of the times from first slip
        to first separation over that time. NaN where there is none.
    """
    ends = [found.first_separation_time, reference.first_separation_time, found.time[-1], reference.time[-1]]
    until = float(np.nanmin(ends))
    slip = reference.first_slip_time
    times = found.time[found.time < until]
    count, result = len(times), {}
    for name, own, known in (
        ("velocity", found.velocity_B, reference.velocity_B),
        ("force", found.normal_force, reference.normal_force),
    ):
        same = count <= len(reference.time) and np.allclose(times, reference.time[:count], rtol=1e-12)
        expected = known[:count] if same else CubicSpline(reference.time, known)(times)
        wrong = np.abs(own[:count] - expected)
        half = int(np.searchsorted(times, min(0.5 * (slip + reference.first_separation_time), until)))
        for stretch, stop in (("slip", half), ("burst", count)):
            largest = float(np.abs(expected[:stop]).max())
            result[f"{stretch}_{name}_error"] = float(wrong[:stop].max()) / largest
    delays = [each.first_separation_time - each.first_slip_time for each in (found, reference)]
    result["burst_delay_error"] = abs(delays[0] / delays[1] - 1.0)
    return result
