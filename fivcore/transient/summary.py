"""The summary figures of a transient and the regime it is in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fivcore.jit import Array
from fivcore.transient.drive import Canonical, displacement, slip_distance
from fivcore.transient.spectra import Listener
from fivcore.transient.statistics import (
    DAMPED,
    FIRST_SEPARATION,
    FIRST_SLIP,
    FRICTION,
    IMPACT,
    LEAST_STICK,
    MAX_N,
    MAX_SLIP,
    SEPARATION,
    SETTLED_FROM,
    SLIP,
    STICK,
    STICK_START,
    SUM_N,
    SWITCHES,
    TERMINATION,
    TIME_IN,
    WORK,
    Tally,
    quantile,
)

# What decides a regime, in this order.
UNDECIDED_BELOW = 1.3  # no slip, and the drive below this times what slips
STEADY_SHARE, STEADY_WOBBLE = 0.999, 0.01  # share of time in slip; slip-rate fluctuation in units of V
LONG_SHARE, LONG_LATE = 0.1, 2.0 / 3.0  # share of time in long sticks; one begins after this share of the run
PERIODIC_COHERENCE = 0.9


@dataclass(frozen=True)
class Outcome:
    """What the summary is made of, canonical, apart from the tally and the listener."""

    duration: float
    ramp: float
    sticks: Array
    steadiness: float
    released: float
    settled_early: bool


def summarise(scene: Canonical, tally: Tally, listener: Listener, outcome: Outcome) -> dict[str, object]:
    """The figures of a run, in the units of its scene; NaN where there is no value.

    What has a unit of speed or force is F times its canonical value, one multiplication: a copy of a scene has
    the same bits whether computed or scaled.

    - `stick_fraction`, `slip_fraction`, `separation_fraction`: share of the time after settling.
    - `dominant_frequency`, `stuck_frequency`: Hz, largest Welch peak of the velocity of B from 200 Hz to
      10 kHz outside and within long sticks (windows of 20 ms, Hann).
    - `coherence`: autocorrelation of the velocity of B after 20 periods of the dominant frequency, the
      largest within half a period of there.
    - `velocity_rms`: of the velocity of B about its mean, m/s.
    - `mean_normal_force`, `max_normal_force`, `normal_force_999`: N; the last is what N stays below for 99.9 %
      of the time.
    - `max_slip_speed`, `slip_speed_999`: m/s, likewise for the relative tangential speed of the two
      surfaces, in and out of contact.
    - `switches_per_second`: changes of contact state.
    - `first_slip_time`, `first_separation_time`: s since the drive started; the latter is the first N = 0.
    - `stick_times`: s, the sticks of at least `min_stick` begun after first slip and ended within the run;
      `stick_starts`: when each began, s since the drive started; `censored_sticks`: how many are long already
      but still going on at its end.
    - `regime`: see `regime_of`.
    - `energy_residual`: |work in - stored - damped - friction - impact| over the sum of their magnitudes,
      from the start.
    - `settled_early`: whether the run was ended before its time because nothing could happen any more.
    """
    moments, sums, F = tally.moments, tally.sums, scene.load
    time = sums[TIME_IN : TIME_IN + 3]
    total = float(time.sum())
    share = time / total if total > 0.0 else np.full(3, np.nan)
    end = outcome.duration
    slipped = not np.isnan(moments[FIRST_SLIP])
    open_stick = end - moments[STICK_START] if moments[STICK_START] >= 0.0 else 0.0
    censored = int(slipped and open_stick >= moments[LEAST_STICK])
    quiet = not listener.rms > 1e-9 * scene.pace
    dominant = float("nan") if quiet else listener.moving.peak()
    period = listener.rate / dominant
    coherence = float("nan") if np.isnan(dominant) else listener.correlation.near(20.0 * period, 0.5 * period)
    work, lost = float(sums[WORK]), sums[[DAMPED, FRICTION, TERMINATION, IMPACT]]
    parts = np.array([work, outcome.released, *lost])
    measured = total > 0.0
    figures: dict[str, object] = {
        "stick_fraction": float(share[STICK]),
        "slip_fraction": float(share[SLIP]),
        "separation_fraction": float(share[SEPARATION]),
        "dominant_frequency": dominant,
        "stuck_frequency": float("nan") if quiet else listener.stuck.peak(),
        "coherence": coherence,
        "velocity_rms": F * listener.rms,
        "mean_normal_force": F * (float(sums[SUM_N]) / total) if measured else float("nan"),
        "max_normal_force": F * float(sums[MAX_N]) if measured else float("nan"),
        "normal_force_999": F * min(quantile(tally.forces, 0.999), float(sums[MAX_N])),
        "max_slip_speed": F * float(sums[MAX_SLIP]) if measured else float("nan"),
        "slip_speed_999": F * min(quantile(tally.speeds, 0.999), float(sums[MAX_SLIP])),
        "switches_per_second": float(sums[SWITCHES]) / total if measured else float("nan"),
        "first_slip_time": float(moments[FIRST_SLIP]),
        "first_separation_time": float(moments[FIRST_SEPARATION]),
        "stick_times": outcome.sticks[:, 1] - outcome.sticks[:, 0],
        "stick_starts": outcome.sticks[:, 0].copy(),
        "censored_sticks": censored,
        "energy_residual": float(abs(work + outcome.released - lost.sum()) / max(np.abs(parts).sum(), 1e-300)),
        "settled_early": outcome.settled_early,
    }
    long = outcome.sticks
    if censored:
        long = np.vstack([long, [end - open_stick, end]])
    settled = float(moments[SETTLED_FROM])
    filled = float(np.sum(np.maximum(long[:, 1] - np.maximum(long[:, 0], settled), 0.0)))
    figures["regime"] = regime_of(
        slipped=slipped,
        measured=measured,
        drive=float(displacement(np.array(end), scene.pace, outcome.ramp)) / max(slip_distance(scene), 1e-300),
        slip_share=float(share[SLIP]),
        steadiness=outcome.steadiness,
        stick_share=filled / (end - settled) if end > settled else 0.0,
        last_stick=float(long[-1, 0]) / end if len(long) else 0.0,
        coherence=coherence,
    )
    return figures


def regime_of(
    *,
    slipped: bool,
    measured: bool,
    drive: float,
    slip_share: float,
    steadiness: float,
    stick_share: float,
    last_stick: float,
    coherence: float,
) -> str:
    """Decide the regime.

    Parameters
    ----------
    slipped : bool
        Whether the contact has slipped at all.
    measured : bool
        Whether the run went on after settling.
    drive : float
        How far the clamp has moved, in units of what slips statically.
    slip_share : float
        Share of the time after settling spent in slip.
    steadiness : float
        Half the range of the slip rate in the last quarter of the run, in units of V.
    stick_share : float
        Share of the time after settling filled by long sticks.
    last_stick : float
        When the last long stick begins, in units of the run's duration.
    coherence : float
        Autocorrelation of the velocity of B after 20 periods.

    Returns
    -------
    str
        "undecided" (too short a run: no slip yet and the drive below 1.3 times what slips, or ended before
        it settled), "stuck" (no slip
        though the drive is beyond), "steady sliding", "intermittent", "periodic" or "irregular".
    """
    if not slipped:
        return "undecided" if drive < UNDECIDED_BELOW else "stuck"
    if not measured:
        return "undecided"
    if slip_share > STEADY_SHARE and steadiness < STEADY_WOBBLE:
        return "steady sliding"
    if stick_share > LONG_SHARE and last_stick > LONG_LATE:
        return "intermittent"
    return "periodic" if coherence > PERIODIC_COHERENCE else "irregular"
