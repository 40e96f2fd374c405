"""Spectra, autocorrelation, moments and quantiles of the samples of a run, in bounded memory.

Samples are gathered into blocks of fixed length, so that no figure depends on the segments in which a run is
computed. Power spectra are Welch's (Hann windows of 20 ms, half overlapping), one within long sticks and one
outside. The autocorrelation is the inverse transform of the power of zero-padded windows (Wiener-Khinchin).
Quantiles come from histograms whose bins have a constant ratio.
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from fivcore.jit import Array, kernel

WINDOW, HOP = 1024, 512
BAND = (200.0, 10e3)
# Windows of the autocorrelation; lags reach up to half of one. A block is a multiple of them.
LONG = 16384
PADDED, BLOCK = 3 * LONG // 2, 4 * LONG
# Bins of the histograms: exponent and seven bits of the mantissa, from 2^-120 to 2^60, so that a quantile is known
# to 0.4 %. N = 1, the commonest value of all, lies in the middle of one: rounding does not decide where it counts.
_SHIFT, _MIDDLE = 45, 1 << 44
_LOWEST, BINS = (1023 - 120) << 7, 180 << 7
_hann = lru_cache(WINDOW)(np.hanning)


@kernel
def _count(bits: NDArray[np.int64], weight: float, counts: Array) -> None:
    """Add `weight` to the bins of numbers without sign, given as bits."""
    for number in bits:
        index = ((number + _MIDDLE) >> _SHIFT) - _LOWEST
        counts[0 if index < 0 else index if index < BINS else BINS - 1] += weight


def _power(windows: Array, taper: Array | float, length: int) -> Array:
    """Sum over windows (k, n) of the power about their means, tapered and zero-padded to `length`."""
    centred = windows - windows.mean(axis=1, keepdims=True)
    spectrum = rfft(centred * taper, length, axis=1).view(float)
    squares = np.einsum("kn,kn->n", spectrum, spectrum)
    return np.asarray(squares[::2] + squares[1::2])


class Welch:
    """Power spectrum of parts of a signal; relative, not calibrated."""

    def __init__(self, rate: float) -> None:
        self.frequency = np.fft.rfftfreq(WINDOW, 1.0 / rate)
        self.power = np.zeros(WINDOW // 2 + 1)

    def add(self, samples: Array) -> None:
        """Add consecutive samples; fewer than a window count from an eighth of one on."""
        length = min(len(samples), WINDOW)
        if length >= WINDOW // 8:
            shape = (len(samples) - length) // HOP + 1, length
            windows = np.ndarray(shape, buffer=samples, strides=(8 * HOP, 8))
            self.power += _power(windows, _hann(length), WINDOW)

    def peak(self) -> float:
        """Frequency of the largest peak within the band, Hz, by a parabola through its logarithm."""
        power, frequency = self.power, self.frequency[1:-1]
        # Not the foot of something below or above the band.
        peaks = (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])
        peaks &= (frequency >= BAND[0]) & (frequency <= BAND[1])
        if not peaks.any():
            return float("nan")
        top = 1 + int(np.argmax(np.where(peaks, power[1:-1], -1.0)))
        below, at, above = np.log(np.maximum(power[top - 1 : top + 2], 1e-300))
        bend = below - 2.0 * at + above
        offset = 0.5 * (below - above) / bend if bend < 0.0 else 0.0
        return float(self.frequency[top] + offset * self.frequency[1])


class Correlation:
    """Autocorrelation up to a sixth of a second."""

    def __init__(self) -> None:
        self._power = np.zeros(PADDED // 2 + 1)
        # Number of windows of each length.
        self._windows: Counter[int] = Counter()
        self._remainder = np.zeros(0)

    def add(self, samples: Array) -> None:
        """Add consecutive samples; a remainder counts from half a window on, or if there is nothing longer."""
        whole = len(samples) // LONG * LONG
        remainder = samples[whole:]
        if whole:
            self._enter(samples[:whole].reshape(-1, LONG))
        if len(remainder) >= LONG // 2:
            self._enter(remainder[None])
        elif len(remainder) > len(self._remainder):
            self._remainder = remainder.copy()

    def repeat(self, count: int) -> None:
        """Add `count` samples of one value: they have no power."""
        self._windows[LONG] += count // LONG
        self._windows[count % LONG] += count % LONG >= LONG // 2

    def _enter(self, windows: Array) -> None:
        self._power += _power(windows, 1.0, PADDED)
        self._windows[windows.shape[1]] += len(windows)

    def near(self, lag: float, around: float) -> float:
        """Largest autocorrelation within `around` of `lag`, both in samples; NaN beyond the record."""
        longest = max(+self._windows, default=0)
        if not longest and len(self._remainder) > 1:
            self._enter(self._remainder[None])
            longest = len(self._remainder)
        product = irfft(self._power, PADDED)
        if not (lag + around < 0.5 * longest and product[0] > 0.0):
            return float("nan")
        lags = np.r_[0, int(lag - around) : int(lag + around) + 2]
        pairs = sum(count * np.maximum(length - lags, 0) for length, count in self._windows.items())
        unit, *others = product[lags] / pairs
        return float(np.max(others) / unit)


class Histogram:
    """Magnitudes of numbers, counted in bins."""

    def __init__(self) -> None:
        self.counts = np.zeros(BINS)
        self._sums = np.zeros(0)

    def add(self, values: Array, weight: float = 1.0) -> None:
        """Count values, each with a weight."""
        # Always of these types, for which the kernel is compiled once.
        _count(np.abs(values).view(np.int64), float(weight), self.counts)
        self._sums = np.zeros(0)

    def quantile(self, share: float) -> float:
        """Value below which a share of all lies, linear within a bin; NaN where nothing was counted."""
        sums = self._sums = self._sums if len(self._sums) else np.cumsum(self.counts)
        index = int(np.searchsorted(sums, share * sums[-1]))
        if index == 0:
            # This bin holds zero and all that is below 2^-120.
            return 0.0 if sums[-1] > 0.0 else float("nan")
        within = (share * sums[-1] - sums[index - 1]) / self.counts[index]
        edges = ((np.array([index, index + 1], dtype=np.int64) + _LOWEST) << _SHIFT) - _MIDDLE
        low, high = edges.view(np.float64)
        return float(low + min(within, 1.0) * (high - low))


class Monitor:
    """Statistics of a run after settling, from samples at `rate`, Hz.

    Of the velocity of B: spectra outside (`moving`) and within long sticks (`stuck`), autocorrelation and RMS; of
    N (`forces`) and |slip rate| (`speeds`): histograms.
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        # Times and velocities of blocks that are not processed, and their number.
        self._buffer, self.waiting = np.empty((2, 2 * BLOCK)), 0
        self._reset(0.0)

    def _reset(self, settled_from: float) -> None:
        self._settled_from = settled_from
        self.moving, self.stuck, self.correlation = Welch(self.rate), Welch(self.rate), Correlation()
        self.forces, self.speeds = Histogram(), Histogram()
        # Number, mean and sum of squares about it of the velocities of each block.
        self._parts: list[tuple[int, float, float]] = []

    def add(self, t: Array, velocity: Array, force: Array, slip_rate: Array, settled_from: float) -> None:
        """Take the next samples, (n,) each. If `settled_from` has moved, everything begins anew."""
        if settled_from != self._settled_from:
            self._reset(settled_from)
        first = int(np.searchsorted(t, settled_from))
        self.forces.add(force[first:])
        self.speeds.add(slip_rate[first:])
        end = self.waiting + len(t)
        if end > self._buffer.shape[1]:
            self._buffer = np.concatenate([self._buffer, np.empty((2, end))], axis=1)
        new = self._buffer[:, self.waiting : end]
        new[0], new[1], self.waiting = t, velocity, end

    def repeat(self, t: float, velocity: float, force: float, slip_rate: float, count: int) -> None:
        """Take `count` more samples like the last one, at `t`, outside of long sticks."""
        # They complete the block that is begun; of those after it only the number counts.
        begun = min(-self.waiting % BLOCK, count)
        times = t + np.arange(1, begun + 1) / self.rate
        v, N, slip_rates = np.tile([[velocity], [force], [slip_rate]], begun)
        self.add(times, v, N, slip_rates, self._settled_from)
        # Statistics may begin within a later block.
        unsettled = np.ceil((self._settled_from - t) * self.rate - 1e-6) - 1 - begun
        before = int(np.clip(unsettled, 0, count - begun))
        first = min(-before % BLOCK, count - begun - before)
        for number in (first, count - begun - before - first):
            if number:
                self.forces.add(np.array([force]), number)
                self.speeds.add(np.array([slip_rate]), number)
                self._parts.append((number, velocity, 0.0))
                self.correlation.repeat(number)

    def process(self, sticks: Array, known_until: float, least: int = BLOCK) -> None:
        """Work on blocks of at least `least` samples before `known_until`, given the long `sticks` (k, 2)."""
        while self.waiting >= least and self._buffer[0, min(self.waiting, BLOCK) - 1] < known_until:
            count = min(self.waiting, BLOCK)
            t, velocity = self._buffer[:, :count]
            first = int(np.searchsorted(t, self._settled_from))
            if first < count:
                self._analyse(t[first:], velocity[first:], sticks)
            self.waiting -= count
            self._buffer[:, : self.waiting] = self._buffer[:, count : count + self.waiting]

    def _analyse(self, t: Array, velocity: Array, sticks: Array) -> None:
        """Work on a block's samples after settling; between two edges of long sticks they lie on one side."""
        self._parts.append((len(t), float(velocity.mean()), len(t) * float(velocity.var())))
        self.correlation.add(velocity)
        within = sticks[(sticks[:, 1] > t[0]) & (sticks[:, 0] <= t[-1])]
        segments = np.split(velocity, np.searchsorted(t, within).ravel())
        for k, segment in enumerate(segments):
            (self.stuck if k % 2 else self.moving).add(segment)

    def close(self, sticks: Array) -> None:
        """Work on the samples that still wait."""
        self.process(sticks, np.inf, 1)

    @property
    def rms(self) -> float:
        """Root mean square of the velocity of B about its mean."""
        if not self._parts:
            return float("nan")
        count, mean, squares = np.array(self._parts).T
        about = mean - np.average(mean, weights=count)
        return float(np.sqrt(np.sum(squares + count * about**2) / np.sum(count)))
