"""The two modes of steady sliding that lock in first, followed over friction."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fivcore import Rig, SlidingModes, flutter_onsets, sliding_modes
from studies.motion import run
from sweeps import InputError

# The pair is followed from its onset, in steps so small that it is nearest to itself, over whole intervals of mu.
MU_MAX, STEP, INTERVAL, MOST_MU = 1.0, 2e-4, 0.2, 4.0


def pair(rig: Rig, theta: float, mu: np.ndarray) -> dict[str, np.ndarray]:
    """Frequency and growth rate of the two modes that lock in first; NaN where they have left the band."""
    followed = path(rig, theta, int(np.ceil(mu.max() / INTERVAL)))
    modes = sliding_modes(rig, theta, mu, run.BAND)
    frequency, growth = np.full((2, len(mu), 2), np.nan)
    for m, near in enumerate(np.rint(mu / STEP)):
        if len(both := closest_two(modes, m, followed[int(near)])):
            frequency[m], growth[m] = modes.frequency[m, both], modes.growth_rate[m, both]
    return {"frequency": frequency, "growth_rate": growth}


def lock_in(rig: Rig, theta: float) -> tuple[float, float, np.ndarray]:
    """Coefficient of friction, frequency and both eigenvalues where the first two modes lock in."""
    found = flutter_onsets(rig, theta, run.BAND, MU_MAX)
    if not len(found.mu):
        raise InputError(f"theta = {theta:g}: no two modes below {run.BAND:g} Hz lock in up to mu = {MU_MAX:g}")
    frequency = float(found.frequency[0])
    return float(found.mu[0]), frequency, np.full(2, complex((2.0 * np.pi * frequency) ** 2))


@lru_cache(maxsize=8)
def path(rig: Rig, theta: float, intervals: int) -> np.ndarray:
    """The pair's eigenvalues lambda at multiples of STEP, (mu, 2), over so many intervals or to its onset."""
    onset, _, near = lock_in(rig, theta)
    mu = STEP * np.arange(round(max(intervals, np.ceil(onset / INTERVAL)) * INTERVAL / STEP) + 1)
    modes, start = sliding_modes(rig, theta, mu, run.BAND), int(np.abs(mu - onset).argmin())
    followed = np.full((len(mu), 2), complex(np.nan, np.nan))
    for way in (range(start, len(mu)), range(start - 1, -1, -1)):
        for m in way:
            if not len(both := closest_two(modes, m, near)):
                break
            near = followed[m] = modes.eigenvalue[m, both]
        near = followed[start]
    return followed


def closest_two(modes: SlidingModes, m: int, near: np.ndarray) -> np.ndarray:
    """The two modes at the m-th mu nearest to `near`; the lower, or of a conjugate pair the decaying first."""
    coupled = np.nonzero(~modes.uncoupled[m] & np.isfinite(modes.frequency[m]))[0]
    values = modes.eigenvalue[m, coupled]
    cost = np.abs(values[:, None] - near[0]) + np.abs(values - near[1])
    np.fill_diagonal(cost, np.inf)
    if len(coupled) < 2 or not cost.min() <= 0.5 * np.abs(near).sum():
        return coupled[:0]
    both = coupled[list(np.unravel_index(cost.argmin(), cost.shape))]
    values = modes.eigenvalue[m, both]
    conjugate = np.abs(values.imag).max() > 1e-9 * np.abs(values).max()
    return np.asarray(both[np.argsort((modes.growth_rate if conjugate else modes.frequency)[m, both])])
