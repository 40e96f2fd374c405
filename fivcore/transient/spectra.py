"""Spectra and statistics of the velocity of B, gathered while a run goes on.

Samples arrive in pieces; what is kept does not grow with the run. Long sticks and what lies between them
have spectra of their own (Welch: Hann windows of 20 ms, half overlapping; a shorter stretch counts with what
it has).
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache

import numpy as np

from fivcore.jit import Array

# Samples are taken at about 50 kHz.
INTERVAL = 20e-6
WINDOW = 1024
LONG = 16384
BAND = (200.0, 10e3)
AT_ONCE = 16
# What is asked for is no farther than half a stretch.
PADDED = 3 * LONG // 2


@lru_cache(maxsize=WINDOW)
def hann(length: int) -> Array:
    """Hann window; not to be changed."""
    return np.hanning(length)


class Welch:
    """Mean power spectrum of stretches of a signal; relative, not calibrated."""

    def __init__(self, rate: float) -> None:
        self.frequency = np.fft.rfftfreq(WINDOW, 1.0 / rate)
        self._power = np.zeros(WINDOW // 2 + 1)
        self._open = np.zeros(0)
        # Transforms of many windows at once cost a quarter of what they cost one by one.
        self._windows = np.zeros((AT_ONCE, WINDOW))
        self._filled = 0

    def add(self, samples: Array) -> None:
        """Continue the present stretch."""
        data = np.concatenate([self._open, samples]) if len(self._open) else samples
        half = WINDOW // 2
        count = max((len(data) - half) // half, 0)
        # Every other window, from the first and from the second on.
        for first in (0, 1):
            pieces = (count + 1 - first) // 2
            if pieces:
                self._take(data[first * half : first * half + pieces * WINDOW].reshape(pieces, WINDOW))
        self._open = data[count * half :].copy()

    def close(self) -> None:
        """End the present stretch; what is left of it counts if it is an eighth of a window or more."""
        if len(self._open) >= WINDOW // 8:
            self._take(self._open[None])
        self._open = np.zeros(0)

    def _take(self, pieces: Array) -> None:
        """Enter pieces of equal length, (n, at most WINDOW)."""
        length = pieces.shape[1]
        while len(pieces):
            first, last = self._filled, min(self._filled + len(pieces), AT_ONCE)
            now, pieces = pieces[: last - first], pieces[last - first :]
            mean = np.add.reduce(now, axis=1, keepdims=True) / length
            np.multiply(now - mean, hann(length), out=self._windows[first:last, :length])
            self._windows[first:last, length:] = 0.0
            self._filled = last
            if last == AT_ONCE:
                self._transform()

    def _transform(self) -> None:
        power = np.abs(np.fft.rfft(self._windows[: self._filled], axis=1)) ** 2
        self._power += power.sum(axis=0)
        self._filled = 0

    @property
    def power(self) -> Array:
        """Of all windows so far, (WINDOW // 2 + 1,)."""
        if self._filled:
            self._transform()
        return self._power

    def hold(self, value: float, count: int) -> None:
        """Continue with the same value `count` times: a window that holds nothing else has no power."""
        self.add(np.full(min(count, WINDOW), value))

    def peak(self) -> float:
        """Frequency of the largest peak within the band, Hz, by a parabola through its logarithm."""
        inside = (self.frequency[1:-1] >= BAND[0]) & (self.frequency[1:-1] <= BAND[1])
        power = self.power
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
    """Autocorrelation up to a sixth of a second, by the power spectrum of zero-padded stretches."""

    def __init__(self) -> None:
        self._power = np.zeros(PADDED // 2 + 1)
        self._lengths: Counter[int] = Counter()
        self._open = np.zeros(0)

    def add(self, samples: Array) -> None:
        """Continue the signal."""
        data = np.concatenate([self._open, samples]) if len(self._open) else samples
        while len(data) >= LONG:
            self._take(data[:LONG])
            data = data[LONG:]
        self._open = data.copy()

    def close(self) -> None:
        """End the signal; its rest counts if it is half a stretch or all there is."""
        if len(self._open) >= LONG // 2 or (not self._lengths and len(self._open) > 1):
            self._take(self._open)
        self._open = np.zeros(0)

    def hold(self, value: float, count: int) -> None:
        """Continue with the same value `count` times; of whole stretches of it only the number counts."""
        begun = min(count, LONG - len(self._open))
        self.add(np.full(begun, value))
        whole, rest = divmod(count - begun, LONG)
        if whole:
            self._lengths[LONG] += whole
        self._open = np.concatenate([self._open, np.full(rest, value)])

    def _take(self, piece: Array) -> None:
        self._power += np.abs(np.fft.rfft(piece - piece.mean(), PADDED)) ** 2
        self._lengths[len(piece)] += 1

    def near(self, lag: float, around: float) -> float:
        """Largest autocorrelation within `around` of `lag`, both in samples; NaN beyond the record."""
        if not self._lengths or lag + around >= 0.5 * max(self._lengths):
            return float("nan")
        lags = np.arange(int(lag - around), int(lag + around) + 2)
        pairs = sum(number * np.maximum(length - lags, 0) for length, number in self._lengths.items())
        samples = sum(number * length for length, number in self._lengths.items())
        product = np.fft.irfft(self._power, PADDED)
        if product[0] <= 0.0:
            return float("nan")
        return float(np.max(product[lags] / pairs) / (product[0] / samples))


class Listener:
    """Velocity of B after settling: its spread, its spectra outside and within long sticks, its coherence."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._held_t = np.zeros(0)
        self._held = np.zeros(0)
        self._reset(0.0)

    def _reset(self, settled_from: float) -> None:
        self.settled_from = settled_from
        self.moving, self.stuck = Welch(self.rate), Welch(self.rate)
        self.correlation = Correlation()
        self._count, self._mean, self._squares = 0, 0.0, 0.0
        self._within: bool | None = None

    def hear(self, t: Array, samples: Array, sticks: Array, unsure_from: float, settled_from: float) -> None:
        """Take the next samples.

        Parameters
        ----------
        t, samples : ndarray, (n,)
        sticks : ndarray, (any, 2)
            Long sticks, begin and end; a running one ends at infinity.
        unsure_from : float
            From here on it is not yet known whether a stick is a long one: held back until it is.
        settled_from : float
            If it has moved, everything begins anew.
        """
        if settled_from != self.settled_from:
            self._reset(settled_from)
        if len(self._held):
            t, samples = np.concatenate([self._held_t, t]), np.concatenate([self._held, samples])
        sure = int(np.searchsorted(t, unsure_from))
        self._held_t, self._held = t[sure:].copy(), samples[sure:].copy()
        start = int(np.searchsorted(t[:sure], settled_from))
        t, samples = t[start:sure], samples[start:sure]
        if not len(t):
            return
        self._spread(samples)
        self.correlation.add(samples)
        done = 0
        for first, last in np.searchsorted(t, sticks):
            self._part(samples[done:first], within=False)
            self._part(samples[first:last], within=True)
            done = max(done, last)
        self._part(samples[done:], within=False)

    def _part(self, samples: Array, *, within: bool) -> None:
        """Samples within a long stick, or outside of them all."""
        if not len(samples):
            return
        if within != self._within:
            self.moving.close()
            self.stuck.close()
            self._within = within
        (self.stuck if within else self.moving).add(samples)

    def hold(self, t: float, value: float, count: int) -> None:
        """Take `count` more samples of the same value, outside of long sticks, after the last one, at `t`."""
        early = max(int(np.ceil((self.settled_from - t) * self.rate)) - 1, 0)
        count -= early
        if count > 0:
            self._merge(count, value, 0.0)
            self.correlation.hold(value, count)
            (self.stuck if self._within else self.moving).hold(value, count)

    def close(self) -> None:
        """No more samples come; what is held back was no long stick."""
        held_t, held = self._held_t, self._held
        self._held_t, self._held = np.zeros(0), np.zeros(0)
        self.hear(held_t, held, np.zeros((0, 2)), np.inf, self.settled_from)
        self.moving.close()
        self.stuck.close()
        self.correlation.close()

    @property
    def rms(self) -> float:
        """Root mean square about the mean."""
        return float(np.sqrt(self._squares / self._count)) if self._count else float("nan")

    def _spread(self, samples: Array) -> None:
        mean = float(samples.mean())
        apart = samples - mean
        self._merge(len(samples), mean, float(np.add.reduce(np.multiply(apart, apart, out=apart))))

    def _merge(self, count: int, mean: float, squares: float) -> None:
        """Count samples of which number, mean and squares about it are known."""
        total = self._count + count
        apart = mean - self._mean
        self._squares += squares + apart**2 * self._count * count / total
        self._mean += apart * count / total
        self._count = total
