"""The stretches in which a run hands over what it heard."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fivcore.jit import Array


@dataclass
class Chunk:
    """What a stretch of a run leaves behind, canonical.

    Attributes
    ----------
    t, velocity, slip_rate : ndarray, (n,)
        Velocity of B and slip rate at about 50 kHz.
    sticks : ndarray, (k, 2)
        Long sticks ended within the stretch, begin and end.
    further : int
        How many more samples of the velocity of B and the slip rate follow, all like the last.
    """

    t: Array
    velocity: Array
    slip_rate: Array
    sticks: Array
    further: int = 0

    @classmethod
    def cut(
        cls,
        first: int,
        reached: int,
        step: float,
        offset: float,
        heard: Array,
        hearing: int,
        sticks: Array,
    ) -> Chunk:
        """Keep what was filled in steps `first` to `reached`; step i is at (i + offset) step."""
        start, stop = -(-first // hearing), -(-reached // hearing)
        times = np.asarray((np.arange(start, stop) * hearing + offset) * step, dtype=np.float64)
        count = max(stop - start, 0)
        return cls(times, heard[:count, 0].copy(), heard[:count, 1].copy(), sticks)

    @classmethod
    def steady(
        cls,
        first: int,
        last: int,
        step: float,
        row: tuple[float, ...],
        hearing: int,
    ) -> Chunk:
        """What steps `first` to `last` leave behind if each has the same `row`, but for its time."""
        start, stop = -(-first // hearing), -(-last // hearing)
        count = min(stop - start, 1)
        heard = np.tile([(start * hearing + 0.5) * step, row[0], row[3]], (count, 1))
        times, velocity, slip_rate = heard.T.copy()
        return cls(times, velocity, slip_rate, np.empty((0, 2)), stop - start - count)


def rows_in(first: int, last: int, recording: int) -> int:
    """How many rows of the record lie in steps `first` to `last`, one every `recording` steps (0: none)."""
    return max(-(-last // recording) - (-(-first // recording)), 0) if recording else 0
