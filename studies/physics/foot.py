"""Steady sliding on a foot of several contacts: its onset, the contacts that are closed, and how fast it grows."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fivcore import InputError, Structure, flutter_onsets, on_foot, steady_forces
from studies.motion.stability import largest_growth

foot = lru_cache(maxsize=64)(on_foot)


@lru_cache(maxsize=64)
def onset(own: Structure) -> tuple[float, float]:
    """The lowest friction at which steady sliding is unstable, and its frequency, Hz, 0 where it diverges."""
    found = flutter_onsets(own, 0.0)
    flutter = *found.mu[:1].tolist(), *found.frequency[:1].tolist()
    return flutter if flutter and not found.divergence_mu < flutter[0] else (found.divergence_mu, 0.0)


def closed(own: Structure, mu: float) -> float:
    """Number of contacts that are closed in steady sliding; NaN where there is none."""
    try:
        return float((steady_forces(own, mu) > 0.0).sum()) if own.several and mu >= 0.0 else 1.0
    except InputError:
        return np.nan


def growth(own: Structure, mu: float) -> float:
    """Growth rate of steady sliding's least stable mode, 1/s; NaN where there is no steady sliding."""
    return float(largest_growth(own, 0.0, mu)[0]) if closed(own, mu) > 0.0 else np.nan
