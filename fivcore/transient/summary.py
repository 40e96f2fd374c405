"""The summary figures of a transient and its regime."""

from __future__ import annotations

import numpy as np

from fivcore.contact.reduced import default_cutoff
from fivcore.jit import Array
from fivcore.rig import Rig
from fivcore.structure import Structure
from fivcore.transient.normalised import displacement, loading_time, reference_energy, slip_distance
from fivcore.transient.observe import NORMAL_FORCE, SLIP_RATE, Observer, degrees_of_freedom, standard_errors
from fivcore.transient.statistics import ENERGIES, FIELDS, SETTLED
from fivcore.transient.stepped import Run


def summarise(run: Run, observer: Observer, sticks: Array) -> dict[str, object]:
    """Return the figures of a run in the units of its scene; NaN where there is no value.

    `sticks` (k, 2) are the long sticks that have ended. A speed or force is F times its normalised value, a single
    multiplication, so that equivalent scenes have the same bits whether computed or scaled.

    Times and frequencies given below hold for the beams; for a structure times are multiplied and frequencies
    divided by `time_scale`, which is 5 kHz divided by its highest frequency if that is lower, or by its lowest if
    that is higher.

    - `time_scale`: this factor; 1 for the beams.
    - `stick_fraction`, `slip_fraction`, `separation_fraction`: share of the time after settling.
    - `dominant_frequency`, `stuck_frequency`: Hz, largest Welch peak of the velocity of B from 200 Hz to 10 kHz
      outside and within long sticks (Hann windows of 20 ms). If most of the time in long sticks belongs to sticks
      no longer than a period, they are part of each cycle, and `dominant_frequency` refers to the whole signal.
      Steady sliding has neither dominant frequency nor periodicity.
    - `periodicity`: autocorrelation of the velocity of B after 20 periods of the dominant frequency, the
      largest within half a period of there.
    - `velocity_rms`: of the velocity of B about its mean, m/s.
    - `mean_normal_force`, `max_normal_force`, `normal_force_999`: N; the last is the 99.9 % quantile.
    - `max_slip_speed`, `slip_speed_999`: m/s, of the surfaces' relative tangential speed, in contact or not.
    - `switches_per_second`: contact transitions of the discretised model. Unlike shares and RMS, their number
      depends on the discretisation, because most statuses are shorter than the period of the contact oscillation:
      for the paper's rig at 2 mm/s it is 30 000 by default, 35 000 at a 16th of the step and 52 000 at a cut-off
      of 400 kHz.
    - `first_slip_time`, `first_separation_time`: s since the drive started; the latter is the first N = 0.
    - `stick_times`, `stick_starts`: s, duration and start of the long sticks (`min_stick`) begun after first slip
      and ended within the run; `mean_stick_time`: their mean; `censored_sticks`: number of those that go on
      at its end.
    - `regime`: see `regime_of`.
    - `energy_residual`: |work in - stored - damped - friction - impact| divided by the sum of their magnitudes or,
      if larger, by a reference (`normalised.reference_energy`): a thousandth of the energy that the load stores at
      rest, plus the kinetic energy of P2 at V and the energy of an initial state relative to rest. For "paper" the
      residual includes numerical damping and impact losses, which that method does not account for.
    - `cutoff`: Hz, cut-off frequency; for "paper" the highest frequency of all modes. `cutoff_error`: expected
      error of the shares of time due to the default cut-off; 0 if the contact sticks or slides steadily, NaN for
      another cut-off. For a structure from modes it is NaN and `cutoff_origin` is "highest mode", because the
      effect of higher modes is unknown.
    - `simulated_time`: s; `settled_early`: whether the rest of the run was filled with proved steady sliding.
    - With several contacts, separation means that no contact is closed, slip that at least one slips, and stick
      all else; N is the sum of the forces, the slip speed that of the fastest contact. For the contacts that the
      load closes at rest, `any_open_fraction` is the share of time with at least one of them open,
      `all_stick_fraction` that with all of them in stick and no other contact in slip. `contact_X`, (c,), is X of
      each contact: the three shares, `mean_normal_force`, `max_normal_force`, `max_slip_speed` and
      `switches_per_second`. `unsolved_steps` is the number of steps whose contact forces did not converge.
    - `X_se`: standard error of each X that is a share, mean, RMS, rate or quantile (`observe.standard_errors`). In
      the regimes "stuck" and "steady sliding" it is 0 for shares, which are constant, and NaN for all else,
      because a decay has no long-run value. It is NaN if statistics last for less than 16 loading times, and for
      `mean_stick_time` with fewer than 12 sticks.
    """
    scene, F, begun, end = run.scene, run.scene.load, run.begun, run.steps * run.step
    duration = end - begun
    counted = {name: float(run.record[name][0]) for name, _ in FIELDS}
    states, start = ("stick", "slip", "separation"), counted["settled_from"]
    total = sum(counted[f"{state}_time"] for state in states)
    if not (end > start and total > 0.0):
        counted, total = counted | dict.fromkeys(SETTLED, float("nan")), float("nan")
    share = {state: counted[f"{state}_time"] / total for state in states}
    slipped = not np.isnan(counted["first_slip"])
    censored = int(slipped and end - counted["stick_start"] >= counted["least_stick"])
    rms, spread = observer.rms, observer.spread(begun + 0.75 * duration)
    quiet = not rms > 1e-9 * scene.speed_per_load
    long = np.vstack([sticks, [counted["stick_start"], end]]) if censored else sticks
    # The whole of a run that never slips counts as a stick.
    observer.sticks = long if slipped else np.array([[0.0, np.inf]])
    whole = observer.correlation.peak() if len(long) else float("nan")
    # Sticks no longer than a period are part of the vibration.
    cycle = long[:, 1] - long[:, 0] <= 1.0 / whole
    counted_sticks = np.maximum(long[:, 1] - np.maximum(long[:, 0], start), 0.0)
    filled, within, long = float(counted_sticks[~cycle].sum()), counted_sticks[cycle].sum(), long[~cycle]
    dominant = whole if within > filled else observer.moving.peak()
    dominant = float("nan") if quiet else dominant
    periodicity = observer.periodicity(dominant)
    driven = float(np.diff(displacement(np.array([begun, end]), scene.speed_per_load, run.options.ramp))[0])
    distance = slip_distance(scene)
    regime = regime_of(
        slipped=slipped,
        drive=driven / max(distance, 1e-300),
        slip_share=share["slip"],
        steadiness=0.0 if observer.repeated and np.isnan(spread) else spread / scene.speed_per_load,
        stick_share=filled / max(end - start, 1e-300),
        last_stick=(float(long[-1, 0]) - begun) / duration if len(long) else 0.0,
        periodicity=periodicity,
    )
    if regime == "steady sliding":
        # The initial decay has a spectral peak, but there is no vibration any more.
        dominant = periodicity = float("nan")
    lengths, unit = sticks[:, 1] - sticks[:, 0], scene.rig.time_scale
    degrees = degrees_of_freedom((end - start) / unit, loading_time(scene) / unit)
    constant = observer.repeated > 0 or regime in ("stuck", "steady sliding")
    errors = standard_errors(observer, 0 if constant or regime == "undecided" else degrees, lengths)
    if constant:
        errors |= {f"{state}_fraction": 0.0 for state in states}
    released, work, *lost = run.released_energy(), *(counted[name] for name in ENERGIES)
    exchanged = max(float(np.abs([work, released, *lost]).sum()), reference_energy(scene, run.options.initial))
    # The largest standard error of a share over one second measures how rarely the kind of motion changes.
    unsteady = max(errors[f"{state}_fraction"] for state in states) * np.sqrt(max(end - start, 0.0) / unit)
    cutoff, origin = run.options.cutoff, "given"
    if run.options.method == "paper":
        cutoff, origin = float(np.sqrt(run.model.stiffness.max())) / (2.0 * np.pi), "all modes"
    elif cutoff is None:
        cutoff, origin = default_cutoff(scene.rig), "default"
        if isinstance(own := scene.rig, Structure) and not own.cutoff:
            cutoff, origin = float(own.motion.frequency[-1]), "default" if own.wider else "highest mode"
    least = CUTOFF_ERROR if isinstance(scene.rig, Rig) else OWN_CUTOFF_ERROR
    expected = 0.0 if constant else float(np.hypot(least, UNSTEADY * unsteady))
    expected = expected if origin == "default" else float("nan")
    figures = {
        **{f"{state}_fraction": value for state, value in share.items()},
        "dominant_frequency": dominant,
        "stuck_frequency": float("nan") if quiet else observer.stuck.peak(),
        "periodicity": periodicity,
        "velocity_rms": F * rms,
        "mean_normal_force": F * (counted["sum_N"] / total),
        "max_normal_force": F * counted["max_N"],
        "normal_force_999": F * observer.quantile(NORMAL_FORCE, 0.999),
        "max_slip_speed": F * counted["max_slip"],
        "slip_speed_999": F * observer.quantile(SLIP_RATE, 0.999),
        "switches_per_second": counted["switches"] / total,
        "first_slip_time": counted["first_slip"],
        "first_separation_time": counted["first_separation"],
        "mean_stick_time": float(lengths.mean()) if len(lengths) else float("nan"),
        "stick_times": lengths,
        "stick_starts": sticks[:, 0].copy(),
        "censored_sticks": censored,
        "energy_residual": abs(work + released - sum(lost)) / exchanged,
        "regime": regime,
        "cutoff": cutoff,
        "cutoff_error": expected,
        "simulated_time": duration,
        "settled_early": observer.repeated > 0,
        "time_scale": float(unit),
    }
    figures |= getattr(run, "by_contact", dict)()
    if origin == "highest mode":
        figures["cutoff_origin"] = origin
    scaled = ("velocity_rms", "mean_normal_force", "normal_force_999", "slip_speed_999")
    return figures | {f"{name}_se": F * error if name in scaled else error for name, error in errors.items()}


# Error of a share due to the default cut-off: constant part, and part per standard error of the share over a
# second. In 74 % of 104 random scenes the error agrees with this estimate within a factor of 2 or two standard
# errors.
CUTOFF_ERROR, UNSTEADY = 0.0085, 0.65
# The constant part for structures (`python -m tests.benchmarks constants`).
OWN_CUTOFF_ERROR = 0.012


# Thresholds of the regimes, as `regime_of` states them.
SLIP_DRIVE = 1.3
STEADY_SHARE, STEADY_SPREAD = 0.999, 0.01
LONG_SHARE, LAST_STICK = 0.1, 2.0 / 3.0
LEAST_PERIODICITY = 0.9


def regime_of(
    *,
    slipped: bool,
    drive: float,
    slip_share: float,
    steadiness: float,
    stick_share: float,
    last_stick: float,
    periodicity: float,
) -> str:
    """Decide the regime, in this order.

    - "undecided": no slip, and the clamp has moved less than 1.3 times the static slip distance (`drive`); or the
      run ended before it settled (`slip_share` is NaN).
    - "stuck": no slip, though the clamp has moved further.
    - "steady sliding": more than 99.9 % of the time after settling in slip (`slip_share`), and half the range of
      the slip rate in the last quarter of the run below 1 % of V (`steadiness`).
    - "intermittent": long sticks that outlast a period of the vibration fill more than 10 % of the time after
      settling (`stick_share`), and one begins in the last third of the run (`last_stick`, in units of the run's
      duration).
    - "periodic": an autocorrelation of the velocity of B after 20 periods above 0.9 (`periodicity`).
    - "irregular": everything else.
    """
    if not slipped:
        return "undecided" if drive < SLIP_DRIVE else "stuck"
    if np.isnan(slip_share):
        return "undecided"
    if slip_share > STEADY_SHARE and steadiness < STEADY_SPREAD:
        return "steady sliding"
    if stick_share > LONG_SHARE and last_stick > LAST_STICK:
        return "intermittent"
    return "periodic" if periodicity > LEAST_PERIODICITY else "irregular"
