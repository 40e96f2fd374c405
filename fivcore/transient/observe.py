"""Observers of a run: series, spectra, block means, and standard errors estimated from that run alone.

Samples are stored and evaluated once, at the end, so that no result depends on the segments of a run. They take
1.6 MB per simulated second of a rig, 2.2 MB including the evaluation. Beyond MOST_SAMPLES (0.5 GB, 5.6 minutes of
a rig) every second block of LONG_BLOCK samples is dropped, repeatedly if necessary, with a warning. Counters are
kept for all blocks.

Power spectra use Welch's method (Hann windows of 20 ms, 50 % overlap), within and outside long sticks. The
autocorrelation is the inverse transform of the power of zero-padded windows (Wiener-Khinchin).

The mean of n block sums has the variance S / n, where S is their spectral density at zero frequency. With the
cosine transform y_j = sqrt(2 / n) sum_i x_i cos(pi j (i + 1/2) / n), whose frequency is j / (2 T) over the time T,

    S = (y_1^2 + ... + y_K^2) / K,

which is the equal-weighted cosine (EWC) estimator of the long-run variance with K degrees of freedom. Where the
spectrum is flat up to K / (2 T), the y_j are independent and normal, and the error of the mean over its standard
error has Student's distribution with K degrees of freedom (U. K. Mueller, J. Econometrics 141, 2007; recommended
by Lazarus, Lewis, Stock and Watson, J. Business and Economic Statistics 36, 2018, whose K grows with T^(2/3)).
A standard error given here is multiplied by t_K(2) / 2, so that 2 of them always hold 95.4 %.

The correlation time of the motion is not known in advance: sticks between bursts last 30 to 80 ms, and shares
drift over 0.1 s where bursts become rare. The former scales with the time to load a stuck contact until it slips
(`loading_time`), the latter with `SETTLING`: K is 0.8 (T / loading_time)^(2/3), at most T / SETTLING and at least
6. `tests/fivcore/test_uncertainty.py` shows how often the long-run value lies within 2 standard errors. Variations
that last for more than a third of a run cannot be seen in it (at 0.6 mm/s the paper's rig alternates over seconds
between cycles with and without separation), nor can events that did not occur, such as a long burst once in five
seconds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, irfft
from scipy.special import ndtr, stdtrit

from fivcore.errors import ThinnedWarning
from fivcore.jit import Array
from fivcore.transient.normalised import Normalised
from fivcore.transient.statistics import CONTACT_SERIES, SAMPLE, SERIES, SETTLING

# Largest number of samples that are kept.
MOST_SAMPLES = 2**24
# Windows of the spectra, and the band of their peaks, Hz.
WINDOW, HOP = 1024, 512
PEAK_BAND = (200.0, 10e3)
# Windows of the autocorrelation, whose lags reach up to half of one. Blocks of the spectra are a multiple of them.
LONG = 16384
PADDED, LONG_BLOCK = 3 * LONG // 2, 4 * LONG
# Number of windows transformed at once, small enough to stay in the cache.
WINDOWS, LONG_WINDOWS = 64, 4
# Samples per block mean, about 2.6 ms.
MEANS_BLOCK = 128
# Rows of the stored samples; columns of blocks: start, s; share of stick and of separation; mean N; contact
# transitions per second.
TIME, VELOCITY, SLIP_RATE, NORMAL_FORCE = range(4)
START, STICK_SHARE, OPEN_SHARE, FORCE, TRANSITIONS = range(5)
# Quantiles are computed from at most this largest share of the samples.
UPPER = 0.002
# Share of a normal distribution within two standard deviations.
HELD = 2.0 * float(ndtr(2.0)) - 1.0
# Fewest degrees of freedom, and their number per (T / loading_time)^(2/3); the fewest loading times that a run
# must last: where bursts are rare, with 12 the interval held in 80 % of all runs only.
FEWEST, GROWTH, LOADING_TIMES = 6, 0.8, 16.0
_hann = lru_cache(WINDOW)(np.hanning)


class Record:
    """Named series of a run in its scene's units: at the rows, or linear between them at `times` (n,).

    The rows may continue those of a previous run, whose last row is `last`, (1, 6). With several contacts rows are
    wider, and the series of each contact, (n, c), are recorded under names with the prefix "contact_".
    """

    def __init__(
        self, normalised: Normalised, names: Sequence[str], times: Array | None = None, last: Array | None = None
    ) -> None:
        self._contacts = c = 0 if not normalised.rig.several else normalised.rig.contacts
        own = [f"contact_{name}" for name in CONTACT_SERIES if name in names and c]
        self._columns: dict[str, Any] = {name: SERIES[name] for name in names}
        for name in own:
            first = 1 + len(SERIES) + CONTACT_SERIES.index(name.removeprefix("contact_")) * c
            self._columns[name] = slice(first, first + c)
        factors = {"normal_force": normalised.load, "state": 1.0}
        scale = normalised.load * normalised.sense
        self._factors = {name: factors.get(name.removeprefix("contact_"), scale) for name in self._columns}
        self._parts: dict[str, list[NDArray[Any]]] = {name: [] for name in ("time", *self._columns)}
        width = 1 + len(SERIES) + len(CONTACT_SERIES) * c
        self._times, self.last = times, np.empty((0, width)) if last is None else last

    def add(self, rows: Array) -> None:
        """Take the next rows of `Segment.rows`."""
        before, self.last = self.last, rows[-1:].copy() if len(rows) else self.last
        if self._times is None:
            self._keep(rows)
        elif len(rows):
            t, self._times = np.split(self._times, [np.searchsorted(self._times, rows[-1, 0], side="right")])
            self._keep(np.concatenate([before, rows]), t)

    def _keep(self, rows: Array, t: Array | None = None) -> None:
        """Store the series at the rows or at times `t`; beyond the rows the nearest one is used."""
        reached = rows[:, 0]
        self._parts["time"].append(reached.copy() if t is None else t)
        for name, factor in self._factors.items():
            values, is_state = factor * rows[:, self._columns[name]], name.endswith("state")
            if t is not None and is_state:
                values = values[np.maximum(np.searchsorted(reached, t, side="right") - 1, 0)]
            elif t is not None:
                columns = np.atleast_2d(values.T)
                values = np.array([np.interp(t, reached, each) for each in columns]).T.reshape(
                    -1, *values.shape[1:]
                )
            self._parts[name].append(values.astype(np.int8) if is_state else values)

    def whole(self, end: float) -> dict[str, Any]:
        """Each series before `end`, s, as one array; empty if nothing was recorded."""
        if self._times is not None:
            self._keep(self.last, self._times[self._times < end])
        # Each is removed before the next is joined, so only one at a time is in memory twice.
        return {name: np.concatenate(parts) for name in [*self._parts] if (parts := self._parts.pop(name))}


def _add_power(power: Array, samples: Array, taper: Array, hop: int, at_once: int) -> None:
    """Add the power of all windows of the taper's length, after removal of the mean, tapering and zero padding.

    `power`, (n // 2 + 1,), belongs to transforms of length n, of which `at_once` are computed together.
    """
    samples, length = np.ascontiguousarray(samples), len(taper)
    # For short parts `sliding_window_view` takes as long as the transforms.
    shape = (len(samples) - length) // hop + 1, length
    windows: Array = np.ndarray(shape, buffer=samples, strides=(8 * hop, 8))
    for first in range(0, len(windows), at_once):
        part = windows[first : first + at_once]
        tapered = (part - part.mean(axis=1, keepdims=True)) * taper
        parts = np.fft.rfft(tapered, 2 * (len(power) - 1)).view(float)
        squares = np.einsum("kn,kn->n", parts, parts)
        power += squares[::2] + squares[1::2]


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Power (n,) at each frequency (n,), Hz; relative, not calibrated. Peaks are sought within the `band`, Hz."""

    frequency: Array
    power: Array
    band: tuple[float, float]

    def peak(self, band: tuple[float, float] | None = None) -> float:
        """Frequency of the largest peak within a band, Hz, by a parabola through its logarithm; or NaN."""
        power, (low, high) = self.power, band or self.band
        inner = self.frequency[1:-1]
        # Exclude the flank of a peak outside the band.
        peaks = (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]) & (inner >= low) & (inner <= high)
        if not peaks.any():
            return float("nan")
        top = 1 + int(np.argmax(np.where(peaks, power[1:-1], -1.0)))
        below, at, above = np.log(np.maximum(power[top - 1 : top + 2], 1e-300))
        bend = below - 2.0 * at + above
        offset = 0.5 * (below - above) / bend if bend < 0.0 else 0.0
        return float(self.frequency[top] + offset * self.frequency[1])


def welch(parts: Iterable[Array], rate: float, band: tuple[float, float] = PEAK_BAND) -> Spectrum:
    """Power spectrum of parts of a signal; parts shorter than a window count from an eighth of its length."""
    power = np.zeros(WINDOW // 2 + 1)
    for part in parts:
        if len(part) >= WINDOW // 8:
            _add_power(power, part, _hann(min(len(part), WINDOW)), HOP, WINDOWS)
    return Spectrum(np.asarray(np.fft.rfftfreq(WINDOW, 1.0 / rate)), power, band)


class Correlation:
    """Autocorrelation up to a sixth of a second, and spectrum, of all parts (n,) of a signal at `rate`, Hz.

    The remainder of a part after its whole windows counts if it is at least half a window long, or if nothing is
    longer. The signal continues without power for `still` samples.
    """

    def __init__(
        self, parts: Iterable[Array], rate: float, band: tuple[float, float] = PEAK_BAND, still: int = 0
    ) -> None:
        pieces = []
        for part in parts:
            whole, rest = np.split(part, [len(part) // LONG * LONG])
            pieces += [(whole, LONG), (rest, len(rest))]
        counted = [piece for piece in pieces if len(piece[0]) >= LONG // 2]
        # Numbers of the windows of each length.
        self._windows = Counter({LONG: still // LONG})
        self._windows[still % LONG] += still % LONG >= LONG // 2
        self._power, self._rate, self._band = np.zeros(PADDED // 2 + 1), rate, band
        for samples, length in counted or [max(pieces, key=lambda piece: len(piece[0]))]:
            if len(samples):
                _add_power(self._power, samples, np.ones(length), length, LONG_WINDOWS)
                self._windows[length] += len(samples) // length

    def peak(self) -> float:
        """Frequency of the largest peak of the whole signal in the band, Hz, at the resolution of `welch`."""
        smooth = np.convolve(self._power, _hann(2 * (PADDED // WINDOW) + 1), "same")
        return Spectrum(np.asarray(np.fft.rfftfreq(PADDED, 1.0 / self._rate)), smooth, self._band).peak()

    def near(self, lag: float, around: float) -> float:
        """Largest autocorrelation within `around` of `lag`, both in samples; NaN beyond the record."""
        longest = max(+self._windows, default=0)
        if not (lag + around < 0.5 * longest and self._power.any()):
            return float("nan")
        lags = np.r_[0, int(lag - around) : int(lag + around) + 2]
        pairs = sum(count * np.maximum(length - lags, 0) for length, count in self._windows.items())
        unit, *others = irfft(self._power, PADDED)[lags] / pairs
        return float(np.max(others) / unit)


class Observer:
    """Statistics of a run after settling, from at most `count` samples at `rate`, Hz.

    Peaks of spectra are located within the `band`, Hz. During the run `blocks`, `shares` and `spread` are
    available; all other results are for its end. The long `sticks`, (k, 2), start and end in s, separate the two
    spectra. Blocks of LONG_BLOCK samples are counted from the start of the run, blocks of MEANS_BLOCK samples from
    that of the statistics.
    """

    def __init__(self, rate: float, count: int, band: tuple[float, float] = PEAK_BAND) -> None:
        self.rate, self.band, self.sticks = rate, band, np.empty((0, 2))
        # The operating system allocates memory only for parts that are written.
        self._room = np.empty((4, max(min(count, MOST_SAMPLES), 2 * LONG_BLOCK)))
        self._origin = self._settled_from = np.nan
        # Number of samples filled in at the end, number of those not stored, and the last stored one.
        self.repeated, self._filled, self._sample = 0, 0, np.zeros(4)
        self._reset()

    def _reset(self) -> None:
        # Numbers of stored and of all samples; one of this many blocks is stored; time and counters at starts of
        # blocks.
        self._count, self._seen, self._every = 0, 0, 1
        self._starts = [np.empty((0, 1 + SAMPLE - 3))]

    def add(self, t: Array, samples: Array, settled_from: float) -> None:
        """Take the next `samples` (n, SAMPLE) at times t (n,); restart if `settled_from` has changed."""
        if settled_from != self._settled_from:
            self._settled_from = settled_from
            self._reset()
        if not len(t):
            return
        self._origin = self._origin if self._origin <= t[0] else float(t[0])
        first = int(np.searchsorted(t, settled_from))
        begun = slice(first + -self._seen % MEANS_BLOCK, None, MEANS_BLOCK)
        self._starts.append(np.column_stack([t[begun], samples[begun, 3:]]))
        self._seen += len(t) - first
        self._keep(t[first:], samples[first:])

    def _keep(self, t: Array, samples: Array) -> None:
        t, samples = self._thinned(t, samples)
        while self._count + len(t) > self._room.shape[1]:
            if self._every == 1:
                longest = f"{MOST_SAMPLES / self.rate:.3g} s, {MOST_SAMPLES} samples"
                what = f"statistics last longer than {longest}: spectra, RMS and"
                warn(f"{what} quantiles are those of evenly spaced parts of the run", ThinnedWarning, stacklevel=2)
            self._every *= 2
            t, samples = self._thinned(t, samples)
            times, others = self._thinned(self.kept[TIME], self.kept[VELOCITY:].T)
            self._count = len(times)
            self.kept[TIME], self.kept[VELOCITY:] = times, others.T
        new = slice(self._count, self._count + len(t))
        for row, values in zip(self._room, (t, *samples.T), strict=False):
            row[new] = values
        self._count += len(t)

    @property
    def kept(self) -> Array:
        """Times, velocities of B, slip rates and N of the stored samples, (4, n)."""
        return self._room[:, : self._count]

    def _thinned(self, t: Array, samples: Array) -> tuple[Array, Array]:
        """The samples at times t that lie in stored blocks."""
        if self._every == 1:
            return t, samples
        here = np.rint((t - self._origin) * self.rate) // LONG_BLOCK % self._every == 0
        return t[here], samples[here]

    def repeat(self, t: float, sample: Array, count: int) -> None:
        """Repeat the last sample, at `t`, `count` times at the end of the run, outside long sticks."""
        unsettled = int(np.clip(np.ceil((self._settled_from - t) * self.rate - 1e-6) - 1, 0, count))
        # They complete the present block; of later ones only the number is stored.
        begun = (round((t - self._origin) * self.rate) + 1 + unsettled) % LONG_BLOCK
        here = min(LONG_BLOCK - begun, count - unsettled)
        times = t + (unsettled + np.arange(1, here + 1)) / self.rate
        self._keep(times, np.broadcast_to(sample, (here, len(sample))))
        self.repeated, self._filled, self._sample = count, count - unsettled - here, np.r_[t, sample[:3]]

    def _spectrum(self, stuck: bool) -> Spectrum:
        t, velocity = self.kept[:SLIP_RATE]
        edges = np.searchsorted(t, self.sticks).ravel()
        cuts = np.union1d(edges, self._cuts)
        within = np.searchsorted(edges, np.r_[0, cuts], side="right") % 2 == stuck
        parts = zip(np.split(velocity, cuts), within, strict=True)
        return welch((part for part, chosen in parts if chosen), self.rate, self.band)

    @property
    def _cuts(self) -> NDArray[np.intp]:
        """Starts of the blocks within the stored samples."""
        t = self.kept[TIME]
        samples = np.arange(LONG_BLOCK, (t[-1] - self._origin) * self.rate + 1.0 if len(t) else 0.0, LONG_BLOCK)
        return np.unique(np.searchsorted(t, self._origin + (samples - 0.5) / self.rate))

    @cached_property
    def moving(self) -> Spectrum:
        """Spectrum outside long sticks."""
        return self._spectrum(False)

    @cached_property
    def stuck(self) -> Spectrum:
        """Spectrum within long sticks."""
        return self._spectrum(True)

    @cached_property
    def correlation(self) -> Correlation:
        """Autocorrelation of the velocity of B, within and outside long sticks."""
        return Correlation(np.split(self.kept[VELOCITY], self._cuts), self.rate, self.band, self._filled)

    def periodicity(self, frequency: float) -> float:
        """Autocorrelation after 20 periods of a frequency, Hz: its maximum within half a period of that lag."""
        period = self.rate / frequency
        return self.correlation.near(20.0 * period, 0.5 * period)

    @cached_property
    def rms(self) -> float:
        """Root mean square of the velocity of B about its mean."""
        velocity, filled, other = self.kept[VELOCITY], self._filled, self._sample[VELOCITY]
        if not (count := len(velocity) + filled):
            return float("nan")
        mean = (velocity.sum() + filled * other) / count
        about = velocity - mean
        about *= about
        return float(np.sqrt((about.sum() + filled * (other - mean) ** 2) / count))

    @cached_property
    def _magnitudes(self) -> dict[int, Array]:
        return {row: self._largest(row) for row in (SLIP_RATE, NORMAL_FORCE)}

    def _largest(self, row: int) -> Array:
        """The largest magnitudes of a row, which quantiles need, in descending order between infinities."""
        values, count = np.abs(self.kept[row]), min(self._count, int(UPPER * (self._count + self._filled)) + 2)
        peaks = np.sort(np.maximum.reduceat(values, np.arange(0, len(values), MEANS_BLOCK)))
        # This many are at least so large; those missing above it are equal to it.
        level = peaks[-count] if 0 < count <= len(peaks) else -1.0
        above = -np.sort(-values[values > level])[:count]
        return np.r_[np.inf, above, np.full(count - len(above), level), -np.inf]

    def quantile(self, row: int, share: float) -> float:
        """Value below which a share, at least 1 - UPPER, of |SLIP_RATE| or NORMAL_FORCE lies; NaN without samples.

        Linear between two samples.
        """
        count = self._count + self._filled
        if not count or np.isnan(share):
            return float("nan")
        largest, other = self._magnitudes[row], abs(self._sample[row])
        place = (1.0 - share) * (count - 1)
        # Counted from the largest. With repeated values, the value at a place is the median of this and two
        # others.
        places = 1 + np.minimum(int(place) + np.arange(2), count - 1)
        low, high = (np.clip(at, 0, len(largest) - 1) for at in (places, places - self._filled))
        one, next_one = np.clip(other, largest[low], largest[high])
        return float(one + (place % 1.0) * (next_one - one))

    def by_block(self, row: int) -> Array:
        """The samples of all complete blocks, (n, MEANS_BLOCK); the next sample completes one."""
        count = max(self._count - 1, 0) // MEANS_BLOCK
        return self.kept[row, : count * MEANS_BLOCK].reshape(count, MEANS_BLOCK)

    @property
    def blocks(self) -> Array:
        """Start, shares and means of the counters over all complete blocks, (n, 5)."""
        self._starts = [np.concatenate(self._starts)]
        (starts,) = self._starts
        rates = np.diff(starts[:, 1:], axis=0) / np.diff(starts[:, :1], axis=0)
        return np.column_stack([starts[: len(rates), 0], rates])

    def shares(self) -> Array:
        """Shares of stick, slip and separation of each block, (n, 3)."""
        stick, separation = self.blocks[:, [STICK_SHARE, OPEN_SHARE]].T
        return np.stack([stick, 1.0 - stick - separation, separation], axis=1)

    def spread(self, start: float) -> float:
        """Half the range of the slip rate since `start`, s; infinite if the contact did not always slip."""
        blocks = self.blocks
        begun = self._starts[0][:, START]
        if blocks[blocks[:, START] >= start][:, [STICK_SHARE, OPEN_SHARE]].any():
            return float("inf")
        t, late = self.kept[TIME], begun[begun >= start]
        late = self.kept[SLIP_RATE, np.searchsorted(t, late[0]) :] if len(late) else late
        return 0.5 * float(np.ptp(late)) if len(late) else float("nan")


def observed(signal: Array, rate: float, quiet: Array, band: tuple[float, float] = PEAK_BAND) -> Observer:
    """Observe one signal (n,) at `rate`, Hz, in place of the velocity of B.

    `quiet` (k, 2), s from its start, are intervals in place of long sticks. All other inputs of the observer are
    zero.
    """
    observer, t = Observer(rate, len(signal), band), np.arange(len(signal)) / rate
    observer.sticks = quiet
    for first in range(0, len(signal), LONG_BLOCK):
        part = slice(first, first + LONG_BLOCK)
        samples = np.zeros((len(t[part]), SAMPLE))
        samples[:, 0] = signal[part]
        observer.add(t[part], samples, 0.0)
    return observer


def errors_of_means(values: Array, degrees: int) -> Array:
    """Standard errors (m,) of the means of successive `values` (n, m); the estimator has `degrees` of freedom.

    NaN if there are fewer than 2 * `degrees` values.
    """
    n = len(values)
    if not 0 < 2 * degrees <= n:
        return np.full(values.shape[1], np.nan)
    y = dct(np.ascontiguousarray((values - values[0]).T))[:, 1 : degrees + 1]
    # SciPy's transform returns twice the sum.
    density = np.sum(y**2, axis=1) / (2.0 * n * degrees)
    return np.asarray(0.5 * stdtrit(degrees, 0.5 * (1.0 + HELD)) * np.sqrt(density / n))


def degrees_of_freedom(time: float, loading_time: float) -> int:
    """Degrees of freedom of the EWC estimator for statistics over a time, s; 0 if it is too short for errors."""
    if not time >= LOADING_TIMES * loading_time:
        return 0
    return max(FEWEST, int(min(GROWTH * (time / max(loading_time, 1e-9)) ** (2.0 / 3.0), time / SETTLING)))


def standard_errors(observer: Observer, degrees: int, sticks: Array) -> dict[str, float]:
    """Standard errors of the statistics of a vibration, normalised; NaN where there is no value.

    The error of the RMS is that of a mean to first order. The mean of N - 1 is the change of a stationary
    momentum, divided by the time; 95.4 % of the changes between 128 instants are below twice the standard error.
    The error of a quantile is half the distance between the quantiles at its share plus and minus the error of the
    share (R. S. Woodruff, J. American Statistical Association 47, 1952). Durations of long `sticks`, (k,), need
    twice the FEWEST degrees.
    """
    x, velocity = observer.blocks, observer.by_block(VELOCITY)
    mean = velocity.mean() if len(velocity) else 0.0
    deviation = np.mean((velocity - mean) ** 2, axis=1) / (2.0 * (observer.rms or np.nan))
    names = ("stick_fraction", "slip_fraction", "separation_fraction", "switches_per_second", "velocity_rms")
    errors = errors_of_means(np.column_stack([observer.shares(), x[:, TRANSITIONS]]), degrees)
    errors = np.append(errors, errors_of_means(deviation[:, None], degrees))
    values = dict(zip(names, errors.tolist(), strict=True))
    momentum = np.cumsum(x[:, FORCE] - 1.0)[:: max(len(x) // 128, 1)]
    within = np.quantile(np.abs(momentum[:, None] - momentum), HELD) if degrees and len(x) else np.nan
    values["mean_normal_force"] = 0.5 * float(within) / max(len(x), 1)
    for name, row in (("normal_force_999", NORMAL_FORCE), ("slip_speed_999", SLIP_RATE)):
        above = np.abs(observer.by_block(row)) > observer.quantile(row, 0.999)
        (error,) = np.minimum(errors_of_means(above.mean(axis=1, keepdims=True), degrees), 0.001)
        values[name] = 0.5 * (observer.quantile(row, 0.999 + error) - observer.quantile(row, 0.999 - error))
    values["mean_stick_time"] = float(errors_of_means(sticks[:, None], FEWEST)[0])
    return values
