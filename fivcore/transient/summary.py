"""The summary figures of a transient and the regime it is in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fivcore.jit import Array
from fivcore.transient.normalised import Normalised, displacement, slip_distance
from fivcore.transient.spectra import Monitor
from fivcore.transient.statistics import ENERGIES

# What decides a regime, in this order.
UNDECIDED_BELOW = 1.3  # no slip, and the drive below this times what slips
STEADY_SHARE, STEADY_WOBBLE = 0.999, 0.01  # share of time in slip; slip-rate fluctuation in units of V
LONG_SHARE, LONG_LATE = 0.1, 2.0 / 3.0  # share of time in long sticks; one begins after this share of the run
PERIODIC_COHERENCE = 0.9


@dataclass(frozen=True)
class Outcome:
    """What the summary is made of, normalised, apart from the counters and the monitor."""

    duration: float
    ramp: float
    sticks: Array
    steadiness: float
    released: float
    settled_early: bool


def summarise(scene: Normalised, run: Any, monitor: Monitor, outcome: Outcome) -> dict[str, object]:
    """The figures of a run, in the units of its scene; NaN where there is no value.

    What has a unit of speed or force is F times its normalised value, one multiplication: a copy of a scene has
    the same bits whether computed or scaled.

    - `stick_fraction`, `slip_fraction`, `separation_fraction`: share of the time after settling.
    - `dominant_frequency`, `stuck_frequency`: Hz, largest Welch peak of the velocity of B from 200 Hz to
      10 kHz outside and within long sticks (windows of 20 ms, Hann). Steady sliding has no dominant frequency.
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
    F, end, first_slip = scene.load, outcome.duration, float(run["first_slip"])
    settled = float(run["settled_from"])
    # Before settling what is counted counts for nothing.
    measured = end > settled
    time = np.array([float(run[f"{state}_time"]) for state in ("stick", "slip", "separation")])
    total = float(time.sum()) if measured else 0.0
    measured = total > 0.0
    share = dict(
        zip(("stick", "slip", "separation"), time / total if measured else np.full(3, np.nan), strict=True)
    )
    slipped = not np.isnan(first_slip)
    open_stick = end - float(run["stick_start"]) if run["stick_start"] >= 0.0 else 0.0
    censored = int(slipped and open_stick >= run["least_stick"])
    quiet = not monitor.rms > 1e-9 * scene.speed_per_load
    dominant = float("nan") if quiet else monitor.moving.peak()
    period = monitor.rate / dominant
    coherence = float("nan") if np.isnan(dominant) else monitor.correlation.near(20.0 * period, 0.5 * period)
    work, *lost = (float(run[name]) for name in ENERGIES)
    parts = np.array([work, outcome.released, *lost])
    max_N, max_slip = float(run["max_N"]), float(run["max_slip"])
    figures: dict[str, object] = {
        "stick_fraction": float(share["stick"]),
        "slip_fraction": float(share["slip"]),
        "separation_fraction": float(share["separation"]),
        "dominant_frequency": dominant,
        "stuck_frequency": float("nan") if quiet else monitor.stuck.peak(),
        "coherence": coherence,
        "velocity_rms": F * monitor.rms,
        "mean_normal_force": F * (float(run["sum_N"]) / total) if measured else float("nan"),
        "max_normal_force": F * max_N if measured else float("nan"),
        "normal_force_999": F * min(monitor.forces.quantile(0.999), max_N),
        "max_slip_speed": F * max_slip if measured else float("nan"),
        "slip_speed_999": F * min(monitor.speeds.quantile(0.999), max_slip),
        "switches_per_second": float(run["switches"]) / total if measured else float("nan"),
        "first_slip_time": first_slip,
        "first_separation_time": float(run["first_separation"]),
        "stick_times": outcome.sticks[:, 1] - outcome.sticks[:, 0],
        "stick_starts": outcome.sticks[:, 0].copy(),
        "censored_sticks": censored,
        "energy_residual": float(abs(work + outcome.released - sum(lost)) / max(np.abs(parts).sum(), 1e-300)),
        "settled_early": outcome.settled_early,
    }
    long = outcome.sticks
    if censored:
        long = np.vstack([long, [end - open_stick, end]])
    filled = float(np.sum(np.maximum(long[:, 1] - np.maximum(long[:, 0], settled), 0.0)))
    figures["regime"] = regime_of(
        slipped=slipped,
        measured=measured,
        drive=float(displacement(np.array(end), scene.speed_per_load, outcome.ramp))
        / max(slip_distance(scene), 1e-300),
        slip_share=float(share["slip"]),
        steadiness=outcome.steadiness,
        stick_share=filled / (end - settled) if end > settled else 0.0,
        last_stick=float(long[-1, 0]) / end if len(long) else 0.0,
        coherence=coherence,
    )
    if figures["regime"] == "steady sliding":
        # The decay at the start of the statistics has a largest peak, but nothing vibrates any more.
        figures["dominant_frequency"] = figures["coherence"] = float("nan")
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
