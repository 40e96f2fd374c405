"""Standard errors of the statistics of one run, from sums over blocks of its samples.

The mean of n block sums has the variance S / n, where S is their spectral density at zero frequency. With the
cosine transform y_j = sqrt(2 / n) sum_i x_i cos(pi j (i + 1/2) / n), whose frequency is j / (2 T) over the time T,

    S = (y_1^2 + ... + y_K^2) / K.

Where the spectrum is flat up to K / (2 T), the y_j are independent and normal, and the error of the mean over its
standard error has Student's distribution with K degrees of freedom (U. K. Mueller, J. Econometrics 141, 2007; as
recommended by Lazarus, Lewis, Stock and Watson, J. Business and Economic Statistics 36, 2018, whose K grows with
T^(2/3), too). A standard error given here is multiplied by t_K(2) / 2, so that 2 of them always hold 95.4 %.

How long the motion remembers is not known beforehand: sticks of 30 to 80 ms between bursts, and shares that wander
for 0.1 s where bursts become rare. The time in which the drive loads a stuck contact until it slips (`load_up`)
scales the former, `SETTLING` the latter: K is 0.8 (T / load_up)^(2/3), at most T / SETTLING, and never below 6.
`tests/fivcore/transient/test_uncertainty.py` shows how often the long-run value lies within 2 standard errors.
What lasts for more than a third of a run cannot be seen in it: at 0.6 mm/s the paper's rig changes for seconds
between cycles with and without separation, which takes runs of 20 s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.special import ndtr, stdtrit

from fivcore.jit import Array, kernel
from fivcore.transient.spectra import Monitor
from fivcore.transient.statistics import SETTLING

# Samples in a block, some 2.6 ms.
BLOCK = 128
# Share of a normal distribution within two standard deviations.
HELD = 2.0 * float(ndtr(2.0)) - 1.0
# Fewest cosines, and their number per (T / load_up)^(2/3); load-ups below which a run is too short to say.
FEWEST, GROWTH, LOAD_UPS = 6, 0.8, 10.0
# Columns of the blocks: start; share of stick and of separation, mean N, changes of state per second, mean of the
# velocity of B and of its square; the slip rate's least and largest value, infinite unless the whole block slips.
START, STICK, SEPARATION, FORCE, SWITCHES, VELOCITY, SQUARE, LEAST, MOST = range(9)
# Number of samples of the block that is not complete; its other numbers are sums in place of means.
COUNT = 9
# Room for the largest samples at first, and what part of all there is room for at least.
ROOM, PART = 4096, 0.004


def errors_of_means(values: Array, cosines: int) -> Array:
    """Standard error of the mean of each column of `values` (n, m); NaN for fewer than 2 `cosines` values."""
    n = len(values)
    if not 0 < 2 * cosines <= n:
        return np.full(values.shape[1], np.nan)
    y = dct(np.ascontiguousarray((values - values[0]).T))[:, 1 : cosines + 1]
    # SciPy's transform is twice the sum.
    density = np.sum(y**2, axis=1) / (2.0 * n * cosines)
    return np.asarray(0.5 * stdtrit(cosines, 0.5 * (1.0 + HELD)) * np.sqrt(density / n))


def cosines_for(time: float, load_up: float) -> int:
    """Number of cosines for statistics over a time, s; 0 if it is too short for standard errors."""
    if not time >= LOAD_UPS * load_up:
        return 0
    return max(FEWEST, int(min(GROWTH * (time / max(load_up, 1e-9)) ** (2.0 / 3.0), time / SETTLING)))


def standard_errors(blocks: Blocks, cosines: int, monitor: Monitor, sticks: Array) -> dict[str, float]:
    """Standard errors of the statistics of a vibration, normalised; NaN where there is no value.

    That of the RMS is that of a mean to first order. The mean of N - 1 is the change of a momentum, which is
    stationary, over the time: twice its standard error is what 95.4 % of the changes within half a run stay below.
    A quantile's is half the distance between those at its share plus and minus the share's own (R. S. Woodruff,
    J. American Statistical Association 47, 1952). Durations of long `sticks` (k,) need twice the FEWEST cosines.
    """
    x, rms = blocks.values, monitor.rms
    mean = x[:, VELOCITY].mean() if len(x) else 0.0
    deviation = (x[:, SQUARE] - 2.0 * mean * x[:, VELOCITY]) / (2.0 * (rms or np.nan))
    names = ("stick_fraction", "slip_fraction", "separation_fraction", "switches_per_second", "velocity_rms")
    errors = errors_of_means(np.column_stack([blocks.shares(), x[:, SWITCHES], deviation]), cosines)
    found = dict(zip(names, errors.tolist(), strict=True))
    momentum, half = np.cumsum(x[:, FORCE] - 1.0), len(x) // 2
    changes = np.abs(momentum[half:] - momentum[: len(x) - half])
    within = np.quantile(changes, HELD) if cosines and half else np.nan
    found["mean_normal_force"] = 0.5 * float(within) / max(len(x), 1)
    for name, histogram, largest in (
        ("normal_force_999", monitor.forces, blocks.forces),
        ("slip_speed_999", monitor.speeds, blocks.speeds),
    ):
        (error,) = errors_of_means(largest.above(histogram.quantile(0.999), len(x)), cosines)
        if np.isnan(error):
            found[name] = np.nan
            continue
        error = min(float(error), 0.001)
        found[name] = 0.5 * (histogram.quantile(0.999 + error) - histogram.quantile(0.999 - error))
    found["mean_stick_time"] = float(errors_of_means(sticks[:, None], FEWEST)[0])
    return found


class Largest:
    """The largest magnitudes of many samples and their numbers: at least a PART of 1/2 of all."""

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
            half, room = self._count // 2, len(self._values)
            if PART * self._seen > room:
                self._values, self._numbers = np.resize(self._values, 2 * room), np.resize(self._numbers, 2 * room)
                continue
            self._limit = float(np.partition(self._values, half)[half])
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
                block[:] = part[:COUNT]
                for k in range(4):
                    block[STICK + k] = (samples[i, 3 + k] - part[STICK + k]) / time
                block[VELOCITY] /= BLOCK
                block[SQUARE] /= BLOCK
                if block[STICK] != 0.0 or block[SEPARATION] != 0.0:
                    block[LEAST], block[MOST] = -np.inf, np.inf
                done += 1
            part[START] = t[i]
            part[STICK : STICK + 4] = samples[i, 3:]
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
