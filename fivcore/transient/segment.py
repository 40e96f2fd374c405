"""The results of a segment, which every method hands to the driver, and the room that they need."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fivcore.jit import Array

# Target time between two samples, s.
INTERVAL = 20e-6


@dataclass
class Segment:
    """Results of a segment, normalised (F = 1).

    Attributes
    ----------
    t : ndarray, (n,)
        Times of the samples, s.
    samples : ndarray, (n, 3)
        Velocity of B, slip rate and N.
    sticks : ndarray, (k, 2)
        Begin and end of the long sticks that ended.
    rows : ndarray, (m, 6)
        Record: time, velocity of B, N, T, slip rate, contact state.
    further : int
        Number of further samples, all like the last.
    """

    t: Array
    samples: Array
    sticks: Array = field(default_factory=lambda: np.empty((0, 2)))
    rows: Array = field(default_factory=lambda: np.empty((0, 6)))
    further: int = 0

    @property
    def slip_rate(self) -> Array:
        """Slip rate, (n,)."""
        return self.samples[:, 1]


def count_in(first: int, last: int, every: int) -> int:
    """Number of multiples of `every` from step `first` up to step `last`, excluded; none if `every` is zero."""
    return max(-(-last // every) - (-(-first // every)), 0) if every else 0


def room_for_sticks(begin: float, end: float, least: float, step: float) -> int:
    """Largest number of long sticks that end between two times, s; `least` is NaN before the first slip."""
    # Until the first slip there are none, and after it the least is a fifth of the time since the start.
    shortest = max(0.2 * begin if np.isnan(least) else least, step)
    return int((end - begin) / shortest) + 2
