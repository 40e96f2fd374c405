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
    further : int
        How many more samples of the velocity of B and the slip rate follow, all like the last.
    """

    t: Array
    velocity: Array
    slip_rate: Array
    rows: Array
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
        rows: Array,
        recording: int,
        sticks: Array,
    ) -> Chunk:
        """Keep what was filled in steps `first` to `reached`; step i is at (i + offset) step."""
        start, stop = -(-first // hearing), -(-reached // hearing)
        times = np.asarray((np.arange(start, stop) * hearing + offset) * step, dtype=np.float64)
        written = max(-(-reached // recording) - (-(-first // recording)), 0) if recording else 0
        count = max(stop - start, 0)
        return cls(times, heard[:count, 0].copy(), heard[:count, 1].copy(), rows[:written], sticks)

    @classmethod
    def steady(
        cls,
        first: int,
        last: int,
        step: float,
        row: tuple[float, ...],
        hearing: int,
        recording: int,
    ) -> Chunk:
        """What steps `first` to `last` leave behind if each has the same `row`, but for its time."""
        start, stop = -(-first // hearing), -(-last // hearing)
        count = min(stop - start, 1)
        begin, end = (-(-first // recording), -(-last // recording)) if recording else (0, 0)
        rows = np.empty((end - begin, 6))
        rows[:, 0] = (np.arange(begin, end) * recording + 0.5) * step
        rows[:, 1:] = row
        heard = np.tile([(start * hearing + 0.5) * step, row[0], row[3]], (count, 1))
        times, velocity, slip_rate = heard.T.copy()
        return cls(times, velocity, slip_rate, rows, np.empty((0, 2)), stop - start - count)
