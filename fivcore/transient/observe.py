"""Observers of a run: series, spectra, blocks of samples, and standard errors from that run alone.

Samples are gathered into blocks of fixed length, so that no figure depends on the segments in which a run is
computed. Power spectra are Welch's (Hann windows of 20 ms, half overlapping), one within long sticks and one
outside. The autocorrelation is the inverse transform of the power of zero-padded windows (Wiener-Khinchin).

The mean of n block sums has the variance S / n, where S is their spectral density at zero frequency. With the
cosine transform y_j = sqrt(2 / n) sum_i x_i cos(pi j (i + 1/2) / n), whose frequency is j / (2 T) over the time T,

    S = (y_1^2 + ... + y_K^2) / K,

which is the equal-weighted cosine (EWC) estimator of the long-run variance with K degrees of freedom. Where the
spectrum is flat up to K / (2 T), the y_j are independent and normal, and the error of the mean over its standard
error has Student's distribution with K degrees of freedom (U. K. Mueller, J. Econometrics 141, 2007; recommended
by Lazarus, Lewis, Stock and Watson, J. Business and Economic Statistics 36, 2018, whose K grows with T^(2/3)).
A standard error given here is multiplied by t_K(2) / 2, so that 2 of them always hold 95.4 %.

How long the motion is correlated is not known beforehand: sticks of 30 to 80 ms between bursts, and shares that
wander for 0.1 s where bursts become rare. The time to load a stuck contact until it slips (`loading_time`) scales
the former, `SETTLING` the latter: K is 0.8 (T / loading_time)^(2/3), at most T / SETTLING, and never below 6.
`tests/fivcore/test_uncertainty.py` shows how often the long-run value lies within 2 standard errors.
What lasts for more than a third of a run cannot be seen in it (at 0.6 mm/s the paper's rig changes for seconds
between cycles with and without separation), nor what it has not met, like a long burst once in five seconds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, irfft
from scipy.special import ndtr, stdtrit

from fivcore.jit import Array, Complex, kernel
from fivcore.transient.normalised import Normalised
from fivcore.transient.statistics import SAMPLE, SERIES, SETTLING

# Windows of the spectra, and the band of their peaks, Hz.
WINDOW, HOP = 1024, 512
BAND = (200.0, 10e3)
# Windows of the autocorrelation, whose lags reach up to half of one. Blocks of the spectra are a multiple of them.
LONG = 16384
PADDED, LONG_BLOCK = 3 * LONG // 2, 4 * LONG
# Windows of each kind that are transformed at once: few enough to stay in the cache.
WINDOWS, LONG_WINDOWS = 64, 4
# Samples in a block of means, some 2.6 ms, and the columns of these blocks: start; share of stick and of
# separation, mean N, contact transitions per second; mean of the velocity of B and its variance within the block;
# the slip rate's least and largest value, infinite unless the whole block slips.
BLOCK = 128
START, STICK, SEPARATION, FORCE, TRANSITIONS, VELOCITY, VARIANCE, LEAST, MOST = range(9)
# Number of the largest samples for which there is room in any case, and their least share of all. They are counted
# after FIRST samples, after twice as many, and so on, and at last after every NEXT samples.
ROOM, PART, FIRST, NEXT = 1024, 0.004, 2048, 65536
# Share of a normal distribution within two standard deviations.
HELD = 2.0 * float(ndtr(2.0)) - 1.0
# Fewest degrees of freedom, and their number per (T / loading_time)^(2/3); the fewest loading times that a run
# must last: where bursts are rare, with 12 the interval held in 80 % of all runs only.
FEWEST, GROWTH, LOADING_TIMES = 6, 0.8, 16.0
_hann = lru_cache(WINDOW)(np.hanning)


class Record:
    """Named series of a run in its scene's units: at the rows, or linear between them at `times` or a `rate`.

    The rows may follow the `last` (1, 6) of a run that they continue.
    """

    def __init__(
        self,
        normalised: Normalised,
        names: Sequence[str],
        times: Array | None = None,
        rate: float | None = None,
        start: float = 0.0,
        last: Array | None = None,
    ) -> None:
        factors = {"normal_force": normalised.load, "state": 1.0}
        self._factors = {name: factors.get(name, normalised.load * normalised.sense) for name in names}
        self._parts: dict[str, list[NDArray[Any]]] = {name: [] for name in ("time", *names)}
        self._times, self._rate = times, rate
        self.last = np.empty((0, 1 + len(SERIES))) if last is None else last
        self._taken = int(np.ceil(start * (rate or 0.0) * (1.0 - 1e-12)))

    def add(self, rows: Array) -> None:
        """Take the next rows of `Segment.rows`."""
        before, self.last = self.last, rows[-1:].copy() if len(rows) else self.last
        if self._times is None and self._rate is None:
            self._keep(rows)
        elif len(rows):
            self._keep(np.concatenate([before, rows]), self._due(rows[-1, 0]))

    def _due(self, until: float) -> Array:
        """Times up to `until`, s, at which series have not been kept yet."""
        if self._times is not None:
            t, self._times = np.split(self._times, [np.searchsorted(self._times, until, side="right")])
            return t
        first, rate = self._taken, self._rate or 0.0
        self._taken = max(int(until * rate * (1.0 + 1e-12)) + 1, first)
        return np.asarray(np.arange(first, self._taken) / rate)

    def _keep(self, rows: Array, t: Array | None = None) -> None:
        """Keep the series at the rows or at times `t`; outside of all rows the nearest one counts."""
        reached = rows[:, 0]
        self._parts["time"].append(reached.copy() if t is None else t)
        for name, factor in self._factors.items():
            values = factor * rows[:, SERIES[name]]
            if t is not None and name == "state":
                values = values[np.maximum(np.searchsorted(reached, t, side="right") - 1, 0)]
            elif t is not None:
                values = np.interp(t, reached, values)
            self._parts[name].append(values.astype(np.int8) if name == "state" else values)

    def whole(self, end: float) -> dict[str, Any]:
        """Each series of a run that ended at `end`, s, in one piece; nothing where nothing was recorded."""
        if self._times is not None:
            self._keep(self.last, self._times)
        elif self._rate is not None:
            t = self._due(end)
            self._keep(self.last, t[t < end * (1.0 - 1e-12)])
        # Each is removed before the next is joined, so that only one at a time has two copies in memory.
        return {name: np.concatenate(parts) for name in [*self._parts] if (parts := self._parts.pop(name))}


@kernel
def _taper(samples: Array, hop: int, means: Array, taper: Array, windows: Array) -> None:
    """Fill rows of `windows` (k, any) with windows of samples about their `means` (k,), tapered, a `hop` apart."""
    for k in range(len(windows)):
        for i in range(len(taper)):
            windows[k, i] = (samples[k * hop + i] - means[k]) * taper[i]


@lru_cache(16)
def _workspace(length: int, rows: int, thread: int) -> tuple[Array, Complex]:
    """Memory of a thread for windows of some length and their transforms; taken anew it costs as much as these."""
    return np.zeros((rows, length)), np.empty((rows, length // 2 + 1), dtype=complex)


class Power:
    """Sum of the power of windows about their means, tapered and zero-padded to `length`, `rows` at once."""

    def __init__(self, length: int, rows: int) -> None:
        self.sum, self._shape = np.zeros(length // 2 + 1), (length, rows)

    def add(self, samples: Array, hop: int, taper: Array) -> None:
        """Add all windows of the taper's length that begin `hop` after each other."""
        samples, length, rows = np.ascontiguousarray(samples), len(taper), self._shape[1]
        padded, spectra = _workspace(*self._shape, get_ident())
        count = (len(samples) - length) // hop + 1
        means = np.ndarray((count, length), buffer=samples, strides=(8 * hop, 8)).mean(axis=1)
        padded[:, length:] = 0.0
        for first in range(0, count, rows):
            windows = padded[: min(rows, count - first)]
            _taper(samples[first * hop :], hop, means[first:], taper, windows)
            parts = np.fft.rfft(windows, axis=1, out=spectra[: len(windows)]).view(float)
            squares = np.einsum("kn,kn->n", parts, parts)
            self.sum += squares[::2] + squares[1::2]


class Welch:
    """Power spectrum of parts of a signal; relative, not calibrated."""

    def __init__(self, rate: float, band: tuple[float, float] = BAND) -> None:
        self._band = band
        self.frequency = np.fft.rfftfreq(WINDOW, 1.0 / rate)
        self._power = Power(WINDOW, WINDOWS)
        self.power = self._power.sum

    def add(self, samples: Array) -> None:
        """Add consecutive samples; fewer than a window count from an eighth of one on."""
        length = min(len(samples), WINDOW)
        if length >= WINDOW // 8:
            self._power.add(samples, HOP, _hann(length))

    def peak(self) -> float:
        """Frequency of the largest peak within the band, Hz."""
        return peak_of(self.frequency, self.power, self._band)


def peak_of(frequency: NDArray[Any], power: NDArray[Any], band: tuple[float, float]) -> float:
    """Frequency of the largest peak of a spectrum within a band, by a parabola through its logarithm; or NaN."""
    inner = frequency[1:-1]
    # Not the foot of something below or above the band.
    peaks = (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])
    peaks &= (inner >= band[0]) & (inner <= band[1])
    if not peaks.any():
        return float("nan")
    top = 1 + int(np.argmax(np.where(peaks, power[1:-1], -1.0)))
    below, at, above = np.log(np.maximum(power[top - 1 : top + 2], 1e-300))
    bend = below - 2.0 * at + above
    offset = 0.5 * (below - above) / bend if bend < 0.0 else 0.0
    return float(frequency[top] + offset * frequency[1])


class Correlation:
    """Autocorrelation up to a sixth of a second, and spectrum, of the whole signal."""

    def __init__(self, rate: float, band: tuple[float, float] = BAND) -> None:
        self._frequency = np.fft.rfftfreq(PADDED, 1.0 / rate)
        self._band = band
        self._power = Power(PADDED, LONG_WINDOWS)
        # Number of windows of each length.
        self._windows: Counter[int] = Counter()
        self._remainder = np.zeros(0)

    def add(self, samples: Array) -> None:
        """Add consecutive samples; a remainder counts from half a window on, or if there is nothing longer."""
        whole = len(samples) // LONG * LONG
        remainder = samples[whole:]
        if whole:
            self._enter(samples[:whole], LONG)
        if len(remainder) >= LONG // 2:
            self._enter(remainder, len(remainder))
        elif len(remainder) > len(self._remainder):
            self._remainder = remainder.copy()

    def repeat(self, count: int) -> None:
        """Add `count` samples of one value: they have no power."""
        self._windows[LONG] += count // LONG
        self._windows[count % LONG] += count % LONG >= LONG // 2

    def _enter(self, samples: Array, length: int) -> None:
        self._power.add(samples, length, np.ones(length))
        self._windows[length] += len(samples) // length

    def _longest(self) -> int:
        """Length of the longest window; of a record without a whole one that of the remainder."""
        longest = max(+self._windows, default=0)
        if not longest and len(self._remainder) > 1:
            self._enter(self._remainder, len(self._remainder))
            longest = len(self._remainder)
        return longest

    def peak(self) -> float:
        """Frequency of the largest peak of the whole signal within the band, Hz, as resolved as by `Welch`."""
        if not self._longest():
            return float("nan")
        width = 2 * (PADDED // WINDOW) + 1
        smooth = np.convolve(self._power.sum, _hann(width), "same")
        return peak_of(self._frequency, smooth, self._band)

    def near(self, lag: float, around: float) -> float:
        """Largest autocorrelation within `around` of `lag`, both in samples; NaN beyond the record."""
        longest = self._longest()
        product = irfft(self._power.sum, PADDED)
        if not (lag + around < 0.5 * longest and product[0] > 0.0):
            return float("nan")
        lags = np.r_[0, int(lag - around) : int(lag + around) + 2]
        pairs = sum(count * np.maximum(length - lags, 0) for length, count in self._windows.items())
        unit, *others = product[lags] / pairs
        return float(np.max(others) / unit)


class Largest:
    """The largest of many magnitudes with their numbers, and every so many of all.

    At least PART of all are kept where the distribution does not change. Where the largest came early, a quantile
    may lie below what is kept; it is then one of every so many.
    """

    def __init__(self) -> None:
        self._seen, self._due, self._every, self._limit, self._kept = 0, FIRST, 1, 0.0, 0
        self._values, self._numbers = [np.empty(0)], [np.empty(0, dtype=np.int64)]
        self._thinned, self._filled = [np.empty(0)], (0.0, 0)
        self._ranks: tuple[Array, Array] | None = None

    def add(self, magnitudes: Array) -> None:
        """Take the next magnitudes, (n,)."""
        self._ranks = None
        while len(magnitudes):
            count = self._due - self._seen
            part, magnitudes = magnitudes[:count], magnitudes[count:]
            self._thinned.append(part[-self._seen % self._every :: self._every].copy())
            found = np.flatnonzero(part > self._limit)
            self._values.append(part[found])
            self._numbers.append(found + self._seen)
            self._seen, self._kept = self._seen + len(part), self._kept + len(found)
            if self._seen == self._due:
                self._due += min(self._seen, NEXT)
                self._drop()

    def _drop(self) -> None:
        """Keep no more than there is room for."""
        thinned = np.concatenate(self._thinned)
        while len(thinned) > 4 * ROOM:
            thinned, self._every = thinned[::2], 2 * self._every
        self._thinned = [thinned]
        if self._kept > max(ROOM, 2 * PART * self._seen):
            least = self._kept - max(ROOM // 8, int(PART * self._seen))
            self._limit = float(np.partition(self._joined()[0], least)[least])
            values, numbers = self._above(self._limit)
            self._values, self._numbers, self._kept = [values], [numbers], len(values)

    def repeat(self, magnitude: float, count: int) -> None:
        """Take one magnitude `count` times, after all others."""
        self._filled, self._ranks = (magnitude, count), None

    def _ranked(self) -> tuple[Array, Array]:
        """The magnitudes that are kept, largest first, and how many each and all before it count for."""
        if self._ranks is None:
            kept, others = self._joined()[0], np.concatenate(self._thinned)
            others = others[others <= self._limit]
            each = (self._seen - len(kept)) / max(len(others), 1)
            values = np.concatenate([kept, others, self._filled[:1]])
            weights = np.repeat([1.0, each, self._filled[1]], [len(kept), len(others), 1])
            order = np.argsort(-values)
            self._ranks = values[order], np.cumsum(weights[order])
        return self._ranks

    def _joined(self) -> tuple[Array, NDArray[np.int64]]:
        """All magnitudes that are kept, and their numbers."""
        self._values, self._numbers = [np.concatenate(self._values)], [np.concatenate(self._numbers)]
        return self._values[0], self._numbers[0]

    def _above(self, level: float) -> tuple[Array, NDArray[np.int64]]:
        """The magnitudes above a level that are kept, and their numbers."""
        values, numbers = self._joined()
        above = values > level
        return values[above], numbers[above]

    def quantile(self, share: float) -> float:
        """Value below which a share of all lies, linear between two magnitudes; NaN where there is none."""
        count = self._filled[1]
        if not self._seen + count:
            return float("nan")
        values, counts = self._ranked()
        place = (1.0 - share) * (self._seen + count - 1)
        # The magnitudes of two places, counted from the largest one on.
        ends = np.searchsorted(counts, [np.floor(place), np.floor(place) + 1.0], side="right")
        high, low = values[np.minimum(ends, len(values) - 1)]
        return float(high + (place % 1.0) * (low - high))

    def above(self, level: float, blocks: int) -> Array:
        """Share of each of the first `blocks` blocks above a level, (blocks, 1); NaN where it is not known."""
        numbers = self._above(level)[1] // BLOCK
        share = np.bincount(numbers[numbers < blocks], minlength=blocks)[:, None] / BLOCK
        return share if level >= self._limit else np.full_like(share, np.nan)


@kernel
def _gather(samples: Array, velocities: Array, speeds: Array, forces: Array, part: Array, means: Array) -> int:
    """Copy the columns of samples and take means over blocks; return the number of blocks that are complete.

    `part` (6,) belongs to the block that is open: first velocity, sum and sum of squares about it, least and
    largest slip rate, number of samples. The first sample of the next block completes it.
    """
    first, sums, squares, least, most, count = part[0], part[1], part[2], part[3], part[4], int(part[5])
    done = begin = 0
    while begin < len(samples):
        if count == BLOCK:
            mean = sums / BLOCK
            means[done, 0], means[done, 1] = first + mean, squares / BLOCK - mean * mean
            means[done, 2], means[done, 3] = least, most
            done, count = done + 1, 0
        if count == 0:
            first, sums, squares, least, most = samples[begin, 0], 0.0, 0.0, np.inf, -np.inf
        end = begin + BLOCK - count
        if end > len(samples):
            end = len(samples)
        for i in range(begin, end):
            velocity, slip_rate = samples[i, 0], samples[i, 1]
            velocities[i], speeds[i], forces[i] = velocity, abs(slip_rate), samples[i, 2]
            about = velocity - first
            sums += about
            squares += about * about
            least = slip_rate if slip_rate < least else least
            most = slip_rate if slip_rate > most else most
        begin, count = end, count + end - begin
    part[0], part[1], part[2], part[3], part[4], part[5] = first, sums, squares, least, most, count
    return done


class Observer:
    """Statistics of a run after settling, from samples at `rate`, Hz.

    Peaks of spectra are sought within the `band`, Hz. Of the velocity of B: spectra outside (`moving`)
    and within long sticks (`stuck`), autocorrelation and RMS; of N (`forces`) and |slip rate| (`speeds`):
    quantiles; means over blocks. Blocks of LONG_BLOCK samples are counted from the start of the run, those of
    BLOCK samples from the start of the statistics.
    """

    def __init__(self, rate: float, band: tuple[float, float] = BAND) -> None:
        self.rate, self._band = rate, band
        # Times and velocities whose spectra have not been taken; number of all samples since the start of the run.
        self._buffer, self._columns, self._seen = np.empty((2, 2 * LONG_BLOCK)), np.empty((2, 0)), 0
        self._reset(0.0)

    def _reset(self, settled_from: float) -> None:
        self._settled_from = settled_from
        self.moving, self.stuck, self.correlation = (
            *(Welch(self.rate, self._band) for _ in range(2)),
            Correlation(self.rate, self._band),
        )
        self.speeds, self.forces = Largest(), Largest()
        # Start and counters of all blocks that have begun; columns from VELOCITY on of those that are complete.
        self._starts, self._means = [np.empty((0, VELOCITY))], [np.empty((0, 4))]
        # Number of samples that wait in the buffer, and what `_gather` knows of the block that is open.
        self._waiting, self._open = 0, np.zeros(6)
        self._blocks: Array | None = None
        # Of the samples that were filled in: number, time before the first, and one of them.
        self._filled, self._since, self._sample = 0, 0.0, np.zeros(3)

    def add(self, t: Array, samples: Array, settled_from: float) -> None:
        """Take the next `samples` (n, SAMPLE) at times t (n,). If `settled_from` has moved, all begins anew."""
        if settled_from != self._settled_from:
            self._reset(settled_from)
        self._seen, self._blocks = self._seen + len(t), None
        first = int(np.searchsorted(t, settled_from))
        t, samples = t[first:], samples[first:]
        begun = slice(-int(self._open[5]) % BLOCK, None, BLOCK)
        self._starts.append(np.column_stack([t[begun], samples[begun, 3:]]))
        end = self._waiting + len(t)
        if end > self._buffer.shape[1]:
            self._buffer = np.concatenate([self._buffer, np.empty((2, end))], axis=1)
        self._buffer[0, self._waiting : end] = t
        means, velocity = np.empty((len(t) // BLOCK + 1, 4)), self._buffer[1, self._waiting : end]
        if len(t) > self._columns.shape[1]:
            self._columns = np.empty((2, len(t)))
        speed, force = self._columns[:, : len(t)]
        self._means.append(means[: _gather(samples, velocity, speed, force, self._open, means)])
        self._waiting = end
        self.speeds.add(speed)
        self.forces.add(force)

    def periodicity(self, frequency: float) -> float:
        """Autocorrelation after 20 periods of a frequency, Hz: the largest within half a period of there."""
        period = self.rate / frequency
        return self.correlation.near(20.0 * period, 0.5 * period)

    def repeat(self, t: float, sample: Array, count: int) -> None:
        """Take `count` samples more like the last one, at `t`, outside of long sticks; they end the run."""
        unsettled = np.ceil((self._settled_from - t) * self.rate - 1e-6) - 1
        before = int(np.clip(unsettled, 0, count))
        self._seen += before
        self._filled, self._since, self._sample = count - before, t, sample[:3]

    def process(self, sticks: Array, known_until: float) -> None:
        """Work on the blocks that are complete and end before `known_until`, given the long `sticks` (k, 2)."""
        while True:
            count = LONG_BLOCK - (self._seen - self._waiting) % LONG_BLOCK
            if count > self._waiting or self._buffer[0, count - 1] >= known_until:
                return
            self._analyse(self._buffer[:, :count], sticks)
            self._waiting -= count
            self._buffer[:, : self._waiting] = self._buffer[:, count : count + self._waiting]

    def _analyse(self, samples: Array, sticks: Array) -> None:
        """Work on times and velocities (2, n) of a block; between two edges of sticks they lie on one side."""
        t, velocity = samples
        self.correlation.add(velocity)
        within = sticks[(sticks[:, 1] > t[0]) & (sticks[:, 0] <= t[-1])]
        segments = np.split(velocity, np.searchsorted(t, within).ravel())
        for k, segment in enumerate(segments):
            (self.stuck if k % 2 else self.moving).add(segment)

    def close(self, sticks: Array) -> None:
        """Work on the samples that still wait, and on those that were filled in."""
        self.process(sticks, np.inf)
        # These complete the block that is begun; of those after it only the number counts.
        filled = min(LONG_BLOCK - self._seen % LONG_BLOCK, self._filled)
        times = self._since + np.arange(1, filled + 1) / self.rate
        others = np.stack([times, np.full(filled, self._sample[0])])
        if self._waiting + filled:
            self._analyse(np.hstack([self._buffer[:, : self._waiting], others]), sticks)
        self.correlation.repeat(self._filled - filled)
        self.speeds.repeat(abs(self._sample[1]), self._filled)
        self.forces.repeat(abs(self._sample[2]), self._filled)

    @property
    def blocks(self) -> Array:
        """Means over all complete blocks, (n, 9)."""
        if self._blocks is not None:
            return self._blocks
        self._starts, self._means = [np.concatenate(self._starts)], [np.concatenate(self._means)]
        (starts,), (means,) = self._starts, self._means
        rates = np.diff(starts[:, 1:], axis=0) / np.diff(starts[:, :1], axis=0)
        values = np.column_stack([starts[: len(means), 0], rates, means])
        values[(values[:, STICK] != 0.0) | (values[:, SEPARATION] != 0.0), LEAST:] = -np.inf, np.inf
        self._blocks = values
        return values

    def shares(self) -> Array:
        """Shares of stick, slip and separation of each block, (n, 3)."""
        stick, separation = self.blocks[:, [STICK, SEPARATION]].T
        return np.stack([stick, 1.0 - stick - separation, separation], axis=1)

    def spread(self, start: float) -> float:
        """Half the range of the slip rate since `start`, s; infinite where the contact did not always slip."""
        blocks = self.blocks
        late = blocks[blocks[:, START] >= start, LEAST:]
        if self._open[5] and self._starts[0][-1, START] >= start:
            late = np.vstack([late, self._open[3:5]])
        return 0.5 * float(late.max() - late.min()) if len(late) else float("nan")

    @property
    def rms(self) -> float:
        """Root mean square of the velocity of B about its mean."""
        blocks, (first, sums, squares, _, _, number) = self.blocks, self._open
        count = np.r_[np.full(len(blocks), BLOCK), number, self._filled]
        if not count.any():
            return float("nan")
        about = sums / max(number, 1.0)
        mean = np.r_[blocks[:, VELOCITY], first + about, self._sample[0]]
        variance = np.r_[blocks[:, VARIANCE], squares / max(number, 1.0) - about**2, 0.0]
        whole = np.average(mean, weights=count)
        return float(np.sqrt(max(np.average(variance + (mean - whole) ** 2, weights=count), 0.0)))


def observed(signal: Array, rate: float, quiet: Array, band: tuple[float, float] = BAND) -> Observer:
    """Observe one signal (n,) at `rate`, Hz, in place of a velocity of B.

    `quiet` (k, 2), s from its start, are spells in place of long sticks. All of the observer that is not of the
    velocity of B is zero.
    """
    observer, t = Observer(rate, band), np.arange(len(signal)) / rate
    for first in range(0, len(signal), LONG_BLOCK):
        part = slice(first, first + LONG_BLOCK)
        samples = np.zeros((len(t[part]), SAMPLE))
        samples[:, 0] = signal[part]
        observer.add(t[part], samples, 0.0)
        observer.process(quiet, np.inf)
    observer.close(quiet)
    return observer


def errors_of_means(values: Array, degrees: int) -> Array:
    """Standard error of the mean of each column.

    Parameters
    ----------
    values : ndarray, (n, m)
        Successive values.
    degrees : int
        Degrees of freedom of the equal-weighted cosine (EWC) long-run variance estimator.

    Returns
    -------
    ndarray, (m,)
        NaN where there are fewer than 2 `degrees` values.
    """
    n = len(values)
    if not 0 < 2 * degrees <= n:
        return np.full(values.shape[1], np.nan)
    y = dct(np.ascontiguousarray((values - values[0]).T))[:, 1 : degrees + 1]
    # SciPy's transform is twice the sum.
    density = np.sum(y**2, axis=1) / (2.0 * n * degrees)
    return np.asarray(0.5 * stdtrit(degrees, 0.5 * (1.0 + HELD)) * np.sqrt(density / n))


def degrees_of_freedom(time: float, loading_time: float) -> int:
    """Degrees of freedom of the EWC estimator for statistics over a time, s; 0 if it is too short for errors."""
    if not time >= LOADING_TIMES * loading_time:
        return 0
    return max(FEWEST, int(min(GROWTH * (time / max(loading_time, 1e-9)) ** (2.0 / 3.0), time / SETTLING)))


def standard_errors(observer: Observer, degrees: int, sticks: Array) -> dict[str, float]:
    """Standard errors of the statistics of a vibration, normalised; NaN where there is no value.

    That of the RMS is that of a mean to first order. The mean of N - 1 is the change of a momentum, which is
    stationary, over the time: 95.4 % of the changes between 128 instants are below twice the standard error. A
    quantile's is half the distance between those at its share plus and minus the share's own (R. S. Woodruff, J.
    American Statistical Association 47, 1952). Durations of long `sticks` (k,) need twice the FEWEST degrees.
    """
    x, rms = observer.blocks, observer.rms
    mean = x[:, VELOCITY].mean() if len(x) else 0.0
    deviation = (x[:, VARIANCE] + (x[:, VELOCITY] - mean) ** 2) / (2.0 * (rms or np.nan))
    names = ("stick_fraction", "slip_fraction", "separation_fraction", "switches_per_second", "velocity_rms")
    errors = errors_of_means(np.column_stack([observer.shares(), x[:, TRANSITIONS], deviation]), degrees)
    values = dict(zip(names, errors.tolist(), strict=True))
    momentum = np.cumsum(x[:, FORCE] - 1.0)[:: max(len(x) // 128, 1)]
    within = np.quantile(np.abs(momentum[:, None] - momentum), HELD) if degrees and len(x) else np.nan
    values["mean_normal_force"] = 0.5 * float(within) / max(len(x), 1)
    for name, largest in (("normal_force_999", observer.forces), ("slip_speed_999", observer.speeds)):
        (error,) = errors_of_means(largest.above(largest.quantile(0.999), len(x)), degrees)
        error = np.minimum(error, 0.001)
        values[name] = 0.5 * (largest.quantile(0.999 + error) - largest.quantile(0.999 - error))
    values["mean_stick_time"] = float(errors_of_means(sticks[:, None], FEWEST)[0])
    return values
