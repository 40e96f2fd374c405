"""Ensembles of `studies.accuracy.study`: what each costs, and the figures of its members."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fivcore import Scene, Transient
from studies.accuracy.settings import EXACT, FAST, SIMULATED, Option
from studies.motion import ensembles, transients
from studies.motion.jobs import Job, run_all

Array = NDArray[np.float64]
Result = TypeVar("Result")

# Long sticks kept of each member.
KEPT = 64
# Third-octave bands by their number n, centred at 10^(n / 10) Hz (IEC 61260): 251 Hz to 7.9 kHz.
BANDS = np.arange(24, 40)
# Of the velocity of B whose spectrum is taken, Hz.
SAMPLE_RATE = 25e3
# After a run this long, which has a skip, everything is compiled and every basis built, s; so often is a short
# run timed.
WARMING, TIMED = 10e-3, 3
# Figures of each member, of `studies.motion.transients.SUMMARY`.
FIGURES = (
    "stick_fraction",
    "slip_fraction",
    "separation_fraction",
    "dominant_frequency",
    "velocity_rms",
    "mean_normal_force",
    "normal_force_999",
    "slip_speed_999",
    "switches_per_second",
    "first_slip_time",
    "first_separation_time",
    "energy_residual",
)


@dataclass(frozen=True)
class Cost:
    """Processor time of the thread that computes, and wall time, s."""

    cpu: float
    wall: float


def together(jobs: Sequence[Job]) -> list[Transient]:
    """Simulate jobs side by side and raise the first error of a scene."""
    runs = []
    for run in run_all(jobs):
        if not isinstance(run, Transient):
            raise run
        runs.append(run)
    return runs


def timed(compute: Callable[[], Result]) -> tuple[Result, Cost]:
    """A result and what it took.

    Processor time is the thread's own: neighbours on the machine, and other threads of the sweep, do not count.
    """
    cpu, wall = time.thread_time(), time.perf_counter()
    result = compute()
    return result, Cost(time.thread_time() - cpu, time.perf_counter() - wall)


def most_members(fixed: Mapping[str, Any]) -> int:
    """Of any ensemble."""
    return int(max(fixed["members"], fixed["reference_members"], fixed["variant_members"]))


def extent(method: int, option: Option, fixed: Mapping[str, Any]) -> tuple[int, float]:
    """How many members an ensemble has, and how long each runs, s: what is dear has fewer and shorter ones."""
    if method == FAST:
        # Where the contact moves, its shapes are made anew all the time.
        return fixed["reference_members" if option.kind == "contact" else "members"], fixed["duration"]
    if method == EXACT:
        return fixed["variant_members"], fixed["duration"]
    if option.kind == "default":
        return fixed["reference_members"], fixed["duration"]
    return fixed["variant_members"], fixed["variant_duration"]


def shortest(scene: Scene, fixed: Mapping[str, Any]) -> float:
    """Of what duration a run must be to have as much after settling as there are windows in a spectrum, s."""
    return float(fixed["ramp"] + ensembles.load_up(scene) + transients.SETTLING + 4.0 * transients.WINDOW)


def ensemble(
    method: int, option: Option, scene: Scene, given: Mapping[str, Any], fixed: Mapping[str, Any]
) -> dict[str, Any]:
    """Costs and figures of the ensemble of one scene.

    Parameters
    ----------
    method : int
        FAST, PAPER or EXACT.
    given : mapping
        What the setting asks of `fivcore.simulate`.
    fixed : mapping
        `ramp`, `duration`, `members`, `recorded`, `reference_members`, `variant_members`, `variant_duration`.
    """
    count, duration = extent(method, option, fixed)

    def jobs(length: float, **more: Any) -> list[Job]:
        ramps = [ensembles.ramp_of(number, fixed["ramp"]) for number in range(1, count + 1)]
        options = {"method": SIMULATED[method], **given, **more}
        return [Job(scene, length, {**options, "ramp": ramp}) for ramp in ramps]

    together(jobs(WARMING)[:1])
    recorded = jobs(duration, record=True, sample_rate=transients.OVERSAMPLING * SAMPLE_RATE)
    if method == FAST:
        runs, batch = timed(lambda: together(jobs(duration)))
        costs = [timed(lambda: together(jobs(duration)[:1]))[1] for _ in range(TIMED)]
        summaries = [run.summary for run in runs]
        powers = [band_powers(*together([job])) for job in recorded[: fixed["recorded"]]]
    else:
        # A record adds nothing to speak of to what these cost, but too much memory for all at once.
        found = [timed(lambda job=job: _heard(job)) for job in recorded]  # type: ignore[misc]
        costs = [cost for _, cost in found]
        batch = Cost(*np.sum([(cost.cpu, cost.wall) for cost in costs], axis=0))
        summaries = [summary for (summary, _), _ in found]
        powers = [power for (_, power), _ in found]
    most = most_members(fixed)
    return _figures(summaries, most, duration) | {
        "band_power": _padded(powers, most, (len(BANDS),)),
        "cpu_per_second": float(np.median([cost.cpu for cost in costs])) / duration,
        "wall_per_second": float(np.median([cost.wall for cost in costs])) / duration,
        "batch_cpu_per_second": batch.cpu / (count * duration),
    }


def _heard(job: Job) -> tuple[dict[str, Any], Array]:
    (run,) = together([job])
    return run.summary, band_powers(run)


def _figures(summaries: Sequence[Mapping[str, Any]], most: int, duration: float) -> dict[str, Any]:
    """Figures, long sticks and the time observed of each member, padded with NaN."""
    found: dict[str, Any] = {
        name: _padded([np.array(each[name], dtype=float) for each in summaries], most, ()) for name in FIGURES
    }
    sticks = [np.asarray(each["stick_times"], dtype=float)[:KEPT] for each in summaries]
    found["stick_time"] = _padded([_padded(list(each), KEPT, ()) for each in sticks], most, (KEPT,))
    found["observed_time"] = np.fmax(duration - found["first_slip_time"] - transients.SETTLING, 0.0)
    return found


def _padded(parts: Sequence[Any], most: int, shape: tuple[int, ...]) -> Array:
    whole = np.full((most, *shape), np.nan)
    for k, part in enumerate(parts):
        whole[k] = part
    return whole


def band_powers(run: Transient) -> Array:
    """Mean square of the velocity of B in each band after settling, m2/s2; NaN where the run has no spectrum."""
    times = transients.even_times(float(run.time[-1]), SAMPLE_RATE).values
    series = transients.velocity(run, times, SAMPLE_RATE)
    density = transients.spectrum(series, transients.settled(run, times), SAMPLE_RATE)
    frequency = transients.frequencies(SAMPLE_RATE).values
    edges = 10.0 ** ((np.append(BANDS, BANDS[-1] + 1) - 0.5) / 10.0)
    # A band's share of each bin: below 1 kHz bins are not much narrower than bands.
    width = frequency[1]
    inside = np.minimum(frequency + 0.5 * width, edges[1:, None]) - np.maximum(
        frequency - 0.5 * width, edges[:-1, None]
    )
    return np.asarray(np.maximum(inside, 0.0) @ density)
