"""Spectra, coherence, spread and quantiles of what is sampled of a run, in bounded memory.

Samples are gathered and worked on in blocks of fixed length, so that the figures do not depend on the segments in
which a run is computed. Long sticks and what lies between them have power spectra of their own (Welch's method:
Hann windows of 20 ms, half overlapping). The autocorrelation comes from the power spectrum of zero-padded
stretches.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from scipy.fft import irfft, rfft

from fivcore.jit import Array

WINDOW = 1024
BAND = (200.0, 10e3)
# Stretches of the autocorrelation; what is asked for is no farther than half of one. A block is some of them.
LONG = 16384
PADDED = 3 * LONG // 2
BLOCK = 4 * LONG
# Bins of the histograms: exponent and seven bits of the mantissa, from 2^-120 to 2^60, so that a quantile is known
# to 0.4 %. N = 1, the commonest value of all, lies in the middle of one: rounding does not decide where it counts.
_SHIFT, _MIDDLE = 45, 1 << 44
_LOWEST = (1023 - 120) << 7
BINS = 180 << 7
_HANN = np.hanning(WINDOW)


class Welch:
    """Mean power spectrum of stretches of a signal; relative, not calibrated."""

    def __init__(self, rate: float) -> None:
        self.frequency = np.fft.rfftfreq(WINDOW, 1.0 / rate)
        self.power = np.zeros(WINDOW // 2 + 1)

    def add(self, samples: Array) -> None:
        """Enter a stretch; one shorter than a window counts if it is an eighth of one or more."""
        if len(samples) >= WINDOW:
            pieces, window = np.lib.stride_tricks.sliding_window_view(samples, WINDOW)[:: WINDOW // 2], _HANN
        elif len(samples) >= WINDOW // 8:
            pieces, window = samples[None], np.hanning(len(samples))
        else:
            return
        pieces = (pieces - pieces.mean(axis=1, keepdims=True)) * window
        spectrum = rfft(pieces, WINDOW, axis=1)
        self.power += (spectrum.real**2 + spectrum.imag**2).sum(axis=0)

    def peak(self) -> float:
        """Frequency of the largest peak within the band, Hz, by a parabola through its logarithm."""
        power = self.power
        inside = (self.frequency[1:-1] >= BAND[0]) & (self.frequency[1:-1] <= BAND[1])
        # A peak, not the foot of something below or above the band.
        peaks = inside & (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])
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
        self._lengths: Counter[int] = Counter()
        self._rest = np.zeros(0)

    def add(self, samples: Array) -> None:
        """Enter a stretch; its rest counts if it is half of LONG or more, or if there is nothing else."""
        whole = len(samples) // LONG
        if whole:
            self._enter(samples[: whole * LONG].reshape(whole, LONG))
        rest = samples[whole * LONG :]
        if len(rest) >= LONG // 2:
            self._enter(rest[None])
        elif len(rest) > len(self._rest):
            self._rest = rest.copy()

    def repeat(self, count: int) -> None:
        """Enter a stretch of `count` samples of one value: only their number counts."""
        if count >= LONG:
            self._lengths[LONG] += count // LONG
        if count % LONG >= LONG // 2:
            self._lengths[count % LONG] += 1

    def _enter(self, pieces: Array) -> None:
        """Enter stretches of one length, (k, length)."""
        spectrum = rfft(pieces - pieces.mean(axis=1, keepdims=True), PADDED, axis=1)
        self._power += (spectrum.real**2 + spectrum.imag**2).sum(axis=0)
        self._lengths[pieces.shape[1]] += len(pieces)

    def near(self, lag: float, around: float) -> float:
        """Largest autocorrelation within `around` of `lag`, both in samples; NaN beyond the record."""
        if not self._lengths and len(self._rest) > 1:
            self._enter(self._rest[None])
        if not self._lengths or lag + around >= 0.5 * max(self._lengths):
            return float("nan")
        lags = np.arange(int(lag - around), int(lag + around) + 2)
        pairs = sum(number * np.maximum(length - lags, 0) for length, number in self._lengths.items())
        samples = sum(number * length for length, number in self._lengths.items())
        product = irfft(self._power, PADDED)
        if product[0] <= 0.0:
            return float("nan")
        return float(np.max(product[lags] / pairs) / (product[0] / samples))


class Histogram:
    """How often numbers of zero or more occur."""

    def __init__(self) -> None:
        self.counts = np.zeros(BINS)

    def add(self, values: Array, weight: float = 1.0) -> None:
        """Enter values, each with a weight."""
        if not len(values):
            return
        bins = np.clip(((np.ascontiguousarray(values).view(np.int64) + _MIDDLE) >> _SHIFT) - _LOWEST, 0, BINS - 1)
        low, high = bins.min(), bins.max() + 1
        self.counts[low:high] += weight * np.bincount(bins - low)

    def quantile(self, share: float) -> float:
        """The value that a share of all entries stays below, linear within a bin; NaN where there is none.

        The first bin holds zero and all that is below 2^-120.
        """
        filled = np.flatnonzero(self.counts)
        if not len(filled):
            return float("nan")
        sums = np.cumsum(self.counts[filled])
        place = int(np.searchsorted(sums, share * sums[-1]))
        index = int(filled[place])
        if index == 0:
            return 0.0
        within = (share * sums[-1] - (sums[place - 1] if place else 0.0)) / self.counts[index]
        edges = ((np.array([index, index + 1], dtype=np.int64) + _LOWEST) << _SHIFT) - _MIDDLE
        low, high = edges.view(np.float64)
        return float(low + min(max(within, 0.0), 1.0) * (high - low))


class Monitor:
    """What is sampled of a run after settling: the velocity of B, N and the slip rate.

    Attributes
    ----------
    rate : float
        Of the samples, Hz.
    moving, stuck : Welch
        Spectra of the velocity of B outside and within long sticks.
    correlation : Correlation
        Of the velocity of B.
    forces, speeds : Histogram
        Of N and of |slip rate|.
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._held: list[tuple[Array, ...]] = []
        self._count_held = 0
        self._reset(0.0)

    def _reset(self, settled_from: float) -> None:
        self._settled_from = settled_from
        self.moving, self.stuck, self.correlation = Welch(self.rate), Welch(self.rate), Correlation()
        self.forces, self.speeds = Histogram(), Histogram()
        self._count, self._mean, self._squares = 0, 0.0, 0.0

    def add(self, t: Array, velocity: Array, force: Array, slip_rate: Array, settled_from: float) -> None:
        """Take the next samples, (n,) each. If `settled_from` has moved, everything begins anew."""
        if settled_from != self._settled_from:
            self._reset(settled_from)
        settled = slice(int(np.searchsorted(t, settled_from)), None)
        self.forces.add(force[settled])
        self.speeds.add(np.abs(slip_rate[settled]))
        self._held.append((t, velocity.copy()))
        self._count_held += len(t)

    def repeat(self, t: float, velocity: float, force: float, slip_rate: float, count: int) -> None:
        """Take `count` more samples like the last one, at `t`, outside of long sticks."""
        settled = count - self._unsettled(t, count)
        if settled > 0:
            self.forces.add(np.array([force]), settled)
            self.speeds.add(np.abs([slip_rate]), settled)
        # The block that has begun, whole blocks of which only their number counts, and the one that is left.
        begun = min(-self._count_held % BLOCK, count)
        whole = (count - begun) // BLOCK
        self._hold(t, velocity, 0, begun)
        for k in range(whole):
            first = begun + k * BLOCK
            inside = BLOCK - self._unsettled(t + first / self.rate, BLOCK)
            if inside == BLOCK:
                self._merge((whole - k) * BLOCK, velocity, 0.0)
                self.correlation.repeat((whole - k) * BLOCK)
                break
            if inside > 0:
                self._merge(inside, velocity, 0.0)
                self.correlation.repeat(inside)
        self._hold(t, velocity, begun + whole * BLOCK, count)

    def _unsettled(self, t: float, count: int) -> int:
        """How many of the `count` samples after time t come before statistics begin."""
        return int(np.clip(np.ceil((self._settled_from - t) * self.rate - 1e-6) - 1, 0, count))

    def _hold(self, t: float, velocity: float, first: int, last: int) -> None:
        """Hold samples number `first` to `last` after time t, all of one value."""
        if last > first:
            times = t + np.arange(first + 1, last + 1) / self.rate
            self._held.append((times, np.full(last - first, velocity)))
            self._count_held += last - first

    def process(self, sticks: Array, known_until: float) -> None:
        """Work on whole blocks of samples.

        Parameters
        ----------
        sticks : ndarray, (k, 2)
            Long sticks, begin and end; one that goes on ends at infinity.
        known_until : float
            From here on it is not yet known whether a stick is a long one.
        """
        while self._count_held >= BLOCK and self._join()[0][BLOCK - 1] < known_until:
            self._block(BLOCK, sticks)

    def close(self, sticks: Array) -> None:
        """Work on what is left."""
        self.process(sticks, np.inf)
        self._block(self._count_held, sticks)

    def _join(self) -> tuple[Array, ...]:
        """Times and velocities that are held, each in one piece."""
        if len(self._held) != 1:
            pieces = self._held or [(np.zeros(0), np.zeros(0))]
            self._held = [(np.concatenate([piece[0] for piece in pieces]), np.concatenate([p[1] for p in pieces]))]
        return self._held[0]

    def _block(self, count: int, sticks: Array) -> None:
        t, velocity = (part[:count] for part in self._join())
        self._held = [tuple(part[count:].copy() for part in self._held[0])]
        self._count_held -= count
        settled = int(np.searchsorted(t, self._settled_from))
        t, velocity = t[settled:], velocity[settled:]
        if not len(t):
            return
        mean = float(velocity.mean())
        self._merge(len(velocity), mean, float(np.sum((velocity - mean) ** 2)))
        self.correlation.add(velocity)
        done = 0
        for first, last in np.searchsorted(t, sticks):
            self.moving.add(velocity[done:first])
            self.stuck.add(velocity[max(first, done) : last])
            done = max(done, last)
        self.moving.add(velocity[done:])

    @property
    def rms(self) -> float:
        """Root mean square of the velocity of B about its mean."""
        return float(np.sqrt(self._squares / self._count)) if self._count else float("nan")

    def _merge(self, count: int, mean: float, squares: float) -> None:
        """Count samples of which number, mean and squares about it are known."""
        total = self._count + count
        difference = mean - self._mean
        self._squares += squares + difference**2 * self._count * count / total
        self._mean += difference * count / total
        self._count = total
