"""Standard errors of the statistics of one run, from sums over blocks of its samples.

The mean of n block sums has the variance S / n, where S is their spectral density at zero frequency. With the
cosine transform y_j = sqrt(2 / n) sum_i x_i cos(pi j (i + 1/2) / n), whose frequency is j / (2 T) over the time T,

    S = (y_1^2 + ... + y_K^2) / K.

Where the spectrum is flat up to K / (2 T), the y_j are independent and normal, and the error of the mean over its
standard error has Student's distribution with K degrees of freedom (U. K. Mueller, J. Econometrics 141, 2007; as
recommended by Lazarus, Lewis, Stock and Watson, J. Business and Economic Statistics 36, 2018, whose K grows with
T^(2/3), too). A standard error given here is multiplied by t_K(2) / 2, so that 2 of them always hold 95.4 %.

How long the motion is correlated is not known beforehand: sticks of 30 to 80 ms between bursts, and shares that
wander for 0.1 s where bursts become rare. The time to load a stuck contact until it slips (`loading_time`) scales
the former, `SETTLING` the latter: K is 0.8 (T / loading_time)^(2/3), at most T / SETTLING, and never below 6.
`tests/fivcore/test_uncertainty.py` shows how often the long-run value lies within 2 standard errors.
What lasts for more than a third of a run cannot be seen in it (at 0.6 mm/s the paper's rig changes for seconds
between cycles with and without separation), nor what it has not met, like a long burst once in five seconds.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import dct
from scipy.special import ndtr, stdtrit

from fivcore.jit import Array
from fivcore.transient.spectra import Monitor
from fivcore.transient.statistics import SETTLING
from fivcore.transient.uncertainty.blocks import FORCE, SQUARE, SWITCHES, VELOCITY, Blocks

# Share of a normal distribution within two standard deviations.
HELD = 2.0 * float(ndtr(2.0)) - 1.0
# Fewest cosines, and their number per (T / loading_time)^(2/3); the fewest loading times that a run must last:
# where bursts are rare, with 12 the interval held in 80 % of all runs only.
FEWEST, GROWTH, LOADING_TIMES = 6, 0.8, 16.0


def errors_of_means(values: Array, cosines: int) -> Array:
    """Standard error of the mean of each column of `values` (n, m); NaN for fewer than 2 `cosines` values."""
    n = len(values)
    if not 0 < 2 * cosines <= n:
        return np.full(values.shape[1], np.nan)
    y = dct(np.ascontiguousarray((values - values[0]).T))[:, 1 : cosines + 1]
    # SciPy's transform is twice the sum.
    density = np.sum(y**2, axis=1) / (2.0 * n * cosines)
    return np.asarray(0.5 * stdtrit(cosines, 0.5 * (1.0 + HELD)) * np.sqrt(density / n))


def cosines_for(time: float, loading_time: float) -> int:
    """Number of cosines for statistics over a time, s; 0 if it is too short for standard errors."""
    if not time >= LOADING_TIMES * loading_time:
        return 0
    return max(FEWEST, int(min(GROWTH * (time / max(loading_time, 1e-9)) ** (2.0 / 3.0), time / SETTLING)))


def standard_errors(blocks: Blocks, cosines: int, monitor: Monitor, sticks: Array) -> dict[str, float]:
    """Standard errors of the statistics of a vibration, normalised; NaN where there is no value.

    That of the RMS is that of a mean to first order. The mean of N - 1 is the change of a momentum, which is
    stationary, over the time: 95.4 % of the changes between 128 instants are below twice the standard error. A
    quantile's is half the distance between those at its share plus and minus the share's own (R. S. Woodruff, J.
    American Statistical Association 47, 1952). Durations of long `sticks` (k,) need twice the FEWEST cosines.
    """
    x, rms = blocks.values, monitor.rms
    mean = x[:, VELOCITY].mean() if len(x) else 0.0
    deviation = (x[:, SQUARE] - 2.0 * mean * x[:, VELOCITY]) / (2.0 * (rms or np.nan))
    names = ("stick_fraction", "slip_fraction", "separation_fraction", "switches_per_second", "velocity_rms")
    errors = errors_of_means(np.column_stack([blocks.shares(), x[:, SWITCHES], deviation]), cosines)
    values = dict(zip(names, errors.tolist(), strict=True))
    momentum = np.cumsum(x[:, FORCE] - 1.0)[:: max(len(x) // 128, 1)]
    within = np.quantile(np.abs(momentum[:, None] - momentum), HELD) if cosines and len(x) else np.nan
    values["mean_normal_force"] = 0.5 * float(within) / max(len(x), 1)
    for name, histogram, largest in (
        ("normal_force_999", monitor.forces, blocks.forces),
        ("slip_speed_999", monitor.speeds, blocks.speeds),
    ):
        (error,) = errors_of_means(largest.above(histogram.quantile(0.999), len(x)), cosines)
        if np.isnan(error):
            values[name] = np.nan
            continue
        error = min(float(error), 0.001)
        values[name] = 0.5 * (histogram.quantile(0.999 + error) - histogram.quantile(0.999 - error))
    values["mean_stick_time"] = float(errors_of_means(sticks[:, None], FEWEST)[0])
    return values
