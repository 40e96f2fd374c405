"""Runs of one method with one setting at one scene: what they cost, their figures, and their first burst."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fivcore import Scene, Transient, simulate, simulate_many
from fivcore.contact.reduced import default_cutoff
from fivcore.transient.published import STEP
from studies.accuracy import elements, solve_ivp
from studies.accuracy.settings import ELEMENTS, EVENTS, EXACT, FAST, PAPER, Option, model_of
from studies.motion import ensembles, transients

Array = NDArray[np.float64]
Result = TypeVar("Result")

# Long sticks kept of each member.
KEPT = 64
# Third-octave bands by their number n, centred at 10^(n / 10) Hz (IEC 61260): 251 Hz to 7.9 kHz.
BANDS = np.arange(24, 40)
# Of the velocity of B whose spectrum is taken, Hz.
SAMPLE_RATE = 25e3
# After a run this long, which has a skip, everything is compiled and every basis built, s.
WARMING = 10e-3
# `paper` takes equal steps whatever moves, so that a short run tells its cost, s; so often are runs timed, but for
# `exact`, whose cost is that of the events of a whole run.
SHORT, TIMED = 0.1, 3
# Figures of each member; mean sticks are compared by single sticks.
FIGURES = [
    name for name, each in transients.SUMMARY.items() if each.dtype == "float64" and name != "mean_stick_time"
]
# How long after the first slip, by the static law, a run goes on that shall reach its first separation, s; and how
# long solve_ivp does, so that its cost is that of vibration too.
BURST, VIBRATION = 8e-3, 20e-3
# The published scheme's own converged motion: its step so many times finer, and no numerical damping.
FINER, UNDAMPED = 4, 0.5
# By how much the step of `fast`, of second order, is finer where there is no `exact`.
FINEST = 16
# At which first bursts are compared that have no step in common, Hz.
RATE = 1e6
# Relative tolerance of solve_ivp by default.
TOLERANCE = 1e-6


class Cost(NamedTuple):
    """Processor time of the thread that computes, and wall time, s."""

    cpu: float
    wall: float


def turn() -> FileLock:
    """A lock for the computation of one point: on this machine one thread of one process holds it.

    So whatever is timed has no other point beside it, whether points are computed on threads or on processes.
    """
    # Windows has no user's number, and a folder for each user.
    user = getattr(os, "getuid", int)()
    return FileLock(Path(tempfile.gettempdir(), f"fiv-accuracy-{user}.lock"))


def timed(compute: Callable[[], Result]) -> tuple[Result, Cost]:
    """A result and what it took; other processes on the machine do not count in processor time."""
    cpu, wall = time.thread_time(), time.perf_counter()
    result = compute()
    return result, Cost(time.thread_time() - cpu, time.perf_counter() - wall)


def together(scene: Scene, ramps: Sequence[float], duration: float, **options: Any) -> list[Transient]:
    """Simulate members of an ensemble, which differ by the ramp, in one batch; raise the first error."""
    runs = []
    for run in simulate_many([scene] * len(ramps), duration, ramp=list(ramps), **options):
        if not isinstance(run, Transient):
            raise run
        runs.append(run)
    return runs


def most_members(fixed: Mapping[str, Any]) -> int:
    """Of any ensemble."""
    return int(max(fixed["members"], fixed["reference_members"], fixed["variant_members"]))


def extent(method: str, option: Option, fixed: Mapping[str, Any]) -> tuple[int, float]:
    """How many members an ensemble has, and how long each runs, s: what is dear has fewer and shorter ones."""
    variant = method == PAPER and option.kind != "default"
    # Where the contact moves, its shapes are made anew all the time.
    dear = method == PAPER or option.kind == "contact"
    members = "variant_members" if variant or method == EXACT else "reference_members" if dear else "members"
    return fixed[members], fixed["variant_duration" if variant else "duration"]


def ensemble(
    method: str, option: Option, scene: Scene, options: Mapping[str, Any], fixed: Mapping[str, Any]
) -> dict[str, Any]:
    """Costs and figures of the ensemble of one scene, by `fast`, `paper` or `exact`.

    `options` are arguments of `fivcore.simulate`; `fixed` are the study's settings.
    """
    count, duration = extent(method, option, fixed)
    most = most_members(fixed)
    ramps = [ensembles.ramp_of(number, fixed["ramp"]) for number in range(1, count + 1)]
    run: Callable[..., list[Transient]] = partial(together, scene, method=method, **options)

    def recorded(ramp: float) -> tuple[dict[str, Any], Array]:
        """Summary and band powers of a member."""
        (one,) = run([ramp], duration, record=True, sample_rate=transients.OVERSAMPLING * SAMPLE_RATE)
        return one.summary, band_powers(one)

    run(ramps[:1], WARMING)
    length = min(SHORT, duration) if method == PAPER else duration
    costs = [timed(lambda: run(ramps[:1], length))[1] for _ in range(1 if method == EXACT else TIMED)]
    cpu, wall = np.median(costs, axis=0) / length
    # What is not timed has all cores.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(recorded, ramps[: fixed["recorded"]] if method == FAST else ramps))
    # Members of `exact` and `paper` are computed one by one: each costs what one alone does.
    summaries, batch = [summary for summary, _ in found], cpu
    if method == FAST:
        every, cost = timed(lambda: run(ramps, duration))
        summaries, batch = [one.summary for one in every], cost.cpu / (count * duration)
    figures = {name: _padded([each[name] for each in summaries], most) for name in FIGURES}
    sticks = [_padded(each["stick_times"][:KEPT], KEPT) for each in summaries]
    return figures | {
        "stick_time": _padded(sticks, most, KEPT),
        "observed_time": np.fmax(duration - figures["first_slip_time"] - transients.SETTLING, 0.0),
        "band_power": _padded([power for _, power in found], most, len(BANDS)),
        "cpu_per_second": cpu,
        "wall_per_second": wall,
        "batch_cpu_per_second": batch,
    }


def _padded(parts: Any, *shape: int) -> Array:
    whole = np.full(shape, np.nan)
    whole[: len(parts)] = np.reshape(parts, (len(parts), *shape[1:]))
    return whole


def band_powers(run: Transient) -> Array:
    """Mean square of the velocity of B in each band after settling, m2/s2; NaN where the run has no spectrum."""
    times = transients.even_times(float(run.time[-1]), SAMPLE_RATE).values
    series = transients.velocity(run, times, SAMPLE_RATE)
    density = transients.spectrum(series, transients.settled(run, times), SAMPLE_RATE)
    frequency = transients.frequencies(SAMPLE_RATE).values
    edges = 10.0 ** ((np.append(BANDS, BANDS[-1] + 1) - 0.5) / 10.0)
    # A band's share of each bin: below 1 kHz bins are not much narrower than bands.
    half = 0.5 * frequency[1]
    inside = np.minimum(frequency + half, edges[1:, None]) - np.maximum(frequency - half, edges[:-1, None])
    return np.asarray(np.maximum(inside, 0.0) @ density)


def burst(
    method: str, option: Option, scene: Scene, options: Mapping[str, Any], ramp: float, members: int
) -> dict[str, Any]:
    """Errors up to the first separation; where a method has no ensemble also its cost and its first times.

    `fast` and solve_ivp are compared with `exact` on the same reduced model, without the finer model that `fast`
    takes for the onset by itself; `fast` with another element, which `exact` has not, and the published scheme
    with themselves, converged.
    """
    end = 0.5 * ramp + ensembles.load_up(scene) + BURST
    common: dict[str, Any] = {"record": True, "sample_rate": RATE, "ramp": ramp}
    if method == PAPER:
        return errors(simulate(scene, end, "paper", **common, **options), converged(scene, end, ramp))
    # With a cut-off that is given there is no other model for the onset.
    common["cutoff"] = default_cutoff(scene.rig)
    if method == FAST and "contact_motion" not in options:
        step = options.get("step", model_of(scene, options).default_step)
        common |= {**options, "step": step, "sample_rate": 1.0 / step}
        fast = simulate(scene, end, "fast", **common)
        if "termination" not in options:
            return errors(fast, simulate(scene, end, "exact", **common))
        return errors(
            fast, simulate(scene, end, "fast", **common | {"step": step / FINEST, "sample_times": fast.time})
        )
    if method == ELEMENTS:
        elements.run(scene, ramp, ramp, RATE)
        run, cost = timed(lambda: elements.run(scene, end, ramp, RATE))
        reached, values = end, errors(run, converged(scene, end, ramp))
    elif method == EVENTS:
        end += VIBRATION - BURST
        exact, model = simulate(scene, end, "exact", **common), model_of(scene, {})
        tolerance = float(option.value) if option.kind == "tolerance" else TOLERANCE
        (run, reached), cost = timed(lambda: solve_ivp.run(scene, model, end, ramp, tolerance, exact.time))
        values = errors(run, exact) | {"gave_up_time": reached if reached < end else np.nan}
    else:
        return {}
    # The run is that of the first member.
    firsts = {name: _padded([first], members) for name, first in run.summary.items()}
    return values | firsts | {"cpu_per_second": cost.cpu / reached, "wall_per_second": cost.wall / reached}


@lru_cache(maxsize=8)
def converged(scene: Scene, end: float, ramp: float) -> Transient:
    """The published scheme with a finer step and without its numerical damping."""
    fine: dict[str, Any] = {"step": STEP / FINER, "beta2": UNDAMPED, "ramp": ramp}
    return simulate(scene, end, "paper", record=True, sample_rate=RATE, **fine)


def errors(run: Transient, reference: Transient) -> dict[str, Any]:
    """How far a motion is from a reference, up to whichever parts first.

    What grows until the surfaces part oscillates at up to 100 kHz, and a small error of its phase or of its rate
    is soon as large as the motion itself. So the largest difference over the largest value is taken over two
    stretches: to half-way between the reference's first slip and first separation (`slip_...`), and to the
    separation (`burst_...`); `burst_delay_error` is that of the time from slip to separation, over it.
    """
    slips, partings = (
        [each.summary[f"first_{event}_time"] for each in (run, reference)] for event in ("slip", "separation")
    )
    until = float(np.nanmin([*partings, run.time[-1], reference.time[-1]]))
    times = run.time[run.time < until]
    count = len(times)
    half = int(np.searchsorted(times, min(0.5 * (slips[1] + partings[1]), until)))
    same = count <= len(reference.time) and np.allclose(times, reference.time[:count], rtol=1e-12)
    values: dict[str, Any] = {}
    for name, series in (("velocity", "velocity_B"), ("force", "normal_force")):
        own, known = getattr(run, series), getattr(reference, series)
        expected = known[:count] if same else CubicSpline(reference.time, known)(times)
        wrong = np.abs(own[:count] - expected)
        for stretch, stop in (("slip", half), ("burst", count)):
            values[f"{stretch}_{name}_error"] = float(wrong[:stop].max() / np.abs(expected[:stop]).max())
    return values | {"burst_delay_error": abs((partings[0] - slips[0]) / (partings[1] - slips[1]) - 1.0)}
