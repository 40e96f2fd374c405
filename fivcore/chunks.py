"""The stretches in which a run hands over what it heard."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fivcore.kernel import Array


@dataclass
class Chunk:
    """What a stretch of a run leaves behind, canonical.

    Attributes
    ----------
    t, velocity, slip_rate : ndarray, (n,)
        Velocity of B and slip rate at about 50 kHz.
    rows : ndarray, (m, 6)
        What is recorded: t, velocity of B, N, T, slip rate, contact state.
    sticks : ndarray, (k, 2)
        Long sticks ended within the stretch, begin and end.
    """

    t: Array
    velocity: Array
    slip_rate: Array
    rows: Array
    sticks: Array

    @classmethod
    def cut(
        cls,
        first: int,
        reached: int,
        step: float,
        offset: float,
        heard: Array,
        hearing: int,
        rows: Array,
        recording: int,
        sticks: Array,
    ) -> Chunk:
        """Keep what was filled in steps `first` to `reached`; step i is at (i + offset) step."""
        start, stop = -(-first // hearing), -(-reached // hearing)
        times = np.asarray((np.arange(start, stop) * hearing + offset) * step, dtype=np.float64)
        written = max(-(-reached // recording) - (-(-first // recording)), 0) if recording else 0
        count = max(stop - start, 0)
        return cls(times, heard[:count, 0].copy(), heard[:count, 1].copy(), rows[:written].copy(), sticks)
