"""Means over blocks of a run's samples, on a grid that no segment, company or record moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fivcore.jit import Array, kernel

# Samples in a block, some 2.6 ms.
BLOCK = 128
# Columns of the blocks: start; share of stick and of separation, mean N, changes of state per second, mean of the
# velocity of B and of its square; the slip rate's least and largest value, infinite unless the whole block slips.
START, STICK, SEPARATION, FORCE, SWITCHES, VELOCITY, SQUARE, LEAST, MOST = range(9)
# Number of samples of the block that is not complete; its other numbers are sums in place of means.
COUNT = 9
# Room for the largest samples at first, and what part of all there is room for at least.
ROOM, PART = 4096, 0.016


class Largest:
    """The largest magnitudes of many samples, with the samples' numbers: at least an eighth of PART of them."""

    def __init__(self) -> None:
        self._limit, self._count, self._seen = 0.0, 0, 0
        self._values, self._numbers = np.empty(ROOM), np.empty(ROOM, dtype=np.int64)

    def add(self, samples: Array) -> None:
        """Take the next samples, (n,)."""
        while True:
            taken, self._count = _keep(samples, self._seen, self._limit, self._values, self._numbers, self._count)
            self._seen += taken
            samples = samples[taken:]
            if not len(samples):
                return
            room = len(self._values)
            if PART * self._seen > room:
                self._values, self._numbers = np.resize(self._values, 2 * room), np.resize(self._numbers, 2 * room)
                continue
            self._limit = float(np.partition(self._values, 7 * room // 8)[7 * room // 8])
            kept = np.flatnonzero(self._values > self._limit)
            self._count = len(kept)
            self._values[: len(kept)], self._numbers[: len(kept)] = self._values[kept], self._numbers[kept]

    def above(self, level: float, blocks: int) -> Array:
        """Share of the samples of each of the first `blocks` blocks that lies above a level, (blocks, 1)."""
        numbers = self._numbers[: self._count][self._values[: self._count] > level] // BLOCK
        return np.bincount(numbers[numbers < blocks], minlength=blocks)[:, None] / BLOCK


@kernel
def _keep(
    samples: Array, seen: int, limit: float, values: Array, numbers: NDArray[np.int64], count: int
) -> tuple[int, int]:
    """Keep magnitudes above a limit until there is no room; return how many are done, and how many are kept."""
    for i in range(len(samples)):
        if abs(samples[i]) > limit:
            if count == len(values):
                return i, count
            values[count], numbers[count] = abs(samples[i]), seen + i
            count += 1
    return len(samples), count


class Blocks:
    """Means over blocks of samples after settling, on a grid that does not depend on segments."""

    def __init__(self) -> None:
        self._reset(0.0)

    def _reset(self, settled_from: float) -> None:
        self._settled_from = settled_from
        self._parts, self._open = [np.empty((0, COUNT))], np.zeros(COUNT + 1)
        self.forces, self.speeds = Largest(), Largest()

    def add(self, t: Array, samples: Array, settled_from: float) -> None:
        """Take the next `samples` (n, SAMPLE) at times t (n,). If `settled_from` has moved, all begins anew."""
        if settled_from != self._settled_from:
            self._reset(settled_from)
        first = int(np.searchsorted(t, settled_from))
        t, samples = t[first:], samples[first:]
        blocks = np.empty((len(t) // BLOCK + 1, COUNT))
        self._parts.append(blocks[: _gather(t, samples, self._open, blocks)])
        self.speeds.add(samples[:, 1])
        self.forces.add(samples[:, 2])

    @property
    def values(self) -> Array:
        """All blocks, (n, 9)."""
        self._parts = [np.concatenate(self._parts)]
        return self._parts[0]

    def shares(self) -> Array:
        """Shares of stick, slip and separation of each block, (n, 3)."""
        stick, separation = self.values[:, [STICK, SEPARATION]].T
        return np.stack([stick, 1.0 - stick - separation, separation], axis=1)

    def spread(self, start: float) -> float:
        """Half the range of the slip rate since `start`, s; infinite where the contact did not always slip."""
        late = np.vstack([self.values, self._open[None, :COUNT]])
        late = late[late[:, START] >= start]
        return 0.5 * float(late[:, MOST].max() - late[:, LEAST].min()) if len(late) else float("nan")


@kernel
def _gather(t: Array, samples: Array, part: Array, blocks: Array) -> int:
    """Add samples to the open block `part` (COUNT + 1,), write those that are complete; return their number."""
    done, i = 0, 0
    while i < len(t):
        if part[COUNT] % BLOCK == 0.0:
            # The first sample of the next block completes a block.
            if part[COUNT] > 0.0:
                block, time = blocks[done], t[i] - part[START]
                # Slices would compile the text of their shape error.
                for k in range(COUNT):
                    block[k] = part[k]
                for k in range(4):
                    block[STICK + k] = (samples[i, 3 + k] - part[STICK + k]) / time
                block[VELOCITY] /= BLOCK
                block[SQUARE] /= BLOCK
                if block[STICK] != 0.0 or block[SEPARATION] != 0.0:
                    block[LEAST], block[MOST] = -np.inf, np.inf
                done += 1
            part[START] = t[i]
            for k in range(4):
                part[STICK + k] = samples[i, 3 + k]
            part[VELOCITY], part[SQUARE], part[LEAST], part[MOST], part[COUNT] = 0.0, 0.0, np.inf, -np.inf, 0.0
        end = min(i + BLOCK - int(part[COUNT]), len(t))
        part[COUNT] += end - i
        sums, squares, least, most = part[VELOCITY], part[SQUARE], part[LEAST], part[MOST]
        for j in range(i, end):
            velocity, slip_rate = samples[j, 0], samples[j, 1]
            sums += velocity
            squares += velocity * velocity
            least, most = min(least, slip_rate), max(most, slip_rate)
        part[VELOCITY], part[SQUARE], part[LEAST], part[MOST], i = sums, squares, least, most, end
    return done
