"""Runs of one method with one setting at one scene: what they cost, their figures, and their first burst."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fivcore import Scene, Transient, simulate, simulate_many
from fivcore.contact.reduced import default_cutoff
from fivcore.transient.published import STEP
from studies.accuracy import elements, errors, solve_ivp
from studies.accuracy.settings import ELEMENTS, EVENTS, EXACT, FAST, PAPER, Option, model_of
from studies.motion import ensembles, transients

Array = NDArray[np.float64]
Result = TypeVar("Result")

# Long sticks kept of each member.
KEPT = 64
# After a run this long, which has a skip, everything is compiled and every basis built, s.
WARMING = 10e-3
# `paper` takes equal steps whatever moves, so that a short run tells its cost, s; so often are runs timed, but for
# `exact`, whose cost is that of the events of a whole run.
SHORT, TIMED = 0.1, 3
# What is kept of each member besides its long sticks.
FIGURES = [each.name for each in errors.FIGURES if each.name != "mean_stick_time"]
FIGURES += ["first_slip_time", "first_separation_time"]
# How long after the first slip, by the static law, a run goes on that shall reach its first separation, s; and how
# long solve_ivp does, so that its cost is that of vibration too.
BURST, VIBRATION = 8e-3, 20e-3
# The published scheme's own converged motion: its step so many times finer, and no numerical damping.
FINER, UNDAMPED = 4, 0.5
# At which first bursts are compared that have no step in common, Hz.
RATE = 1e6
# Relative tolerance of solve_ivp by default.
TOLERANCE = 1e-6
# On this machine one thread of one process holds it (a user's number is none on Windows, where the folder is their
# own): whatever is timed has no other point beside it.
TURN = FileLock(Path(tempfile.gettempdir(), f"fiv-accuracy-{getattr(os, 'getuid', int)()}.lock"))


def timed(compute: Callable[[], Result]) -> tuple[Result, float]:
    """A result and the thread's own processor time, s, to which nothing else adds."""
    start = time.thread_time()
    return compute(), time.thread_time() - start


def most_members(fixed: Mapping[str, Any]) -> int:
    """Of any ensemble."""
    return int(max(fixed["members"], fixed["reference_members"], fixed["variant_members"]))


def ensemble(
    method: str, option: Option, scene: Scene, options: Mapping[str, Any], fixed: Mapping[str, Any]
) -> dict[str, Any]:
    """Costs and figures of the ensemble of one scene, by `fast`, `paper` or `exact`.

    `options` are arguments of `fivcore.simulate`; `fixed` are the study's settings.
    """
    # What is dear has fewer and shorter runs.
    variant = method == PAPER and option.kind != "default"
    kind = "variant_" if variant or method == EXACT else "reference_" if method == PAPER else ""
    # The figures are compared with those of the published scheme.
    options = dict(options) if method == PAPER else {**options, "numerical_damping": "published"}
    count, duration = fixed[f"{kind}members"], fixed["variant_duration" if variant else "duration"]
    members: list[Any]
    ramps = [ensembles.ramp_of(number, fixed["ramp"]) for number in range(1, count + 1)]

    def run(ramp: float, length: float = duration) -> Transient:
        return simulate(scene, length, method, ramp=ramp, **options)

    run(ramps[0], WARMING)
    length = min(SHORT, duration) if method == PAPER else duration
    costs = [timed(lambda: run(ramps[0], length))[1] for _ in range(1 if method == EXACT else TIMED)]
    cpu = np.median(costs) / length
    if method == FAST:
        members, batch = timed(lambda: simulate_many([scene] * count, duration, method, ramp=ramps, **options))
        batch /= count * duration
    else:
        # Members are computed one by one: each costs what one alone does. What is not timed has all cores.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            members, batch = list(pool.map(run, ramps)), cpu
    if failed := [one for one in members if isinstance(one, Exception)]:
        raise failed[0]
    most = most_members(fixed)
    figures = {name: _padded([each.summary[name] for each in members], most) for name in FIGURES}
    sticks = [_padded(each.summary["stick_times"][:KEPT], KEPT) for each in members]
    return figures | {
        "stick_time": _padded(sticks, most, KEPT),
        "observed_time": np.fmax(duration - figures["first_slip_time"] - transients.SETTLING, 0.0),
        "cpu_per_second": cpu,
        "batch_cpu_per_second": batch,
    }


def _padded(parts: Any, *shape: int) -> Array:
    whole = np.full(shape, np.nan)
    whole[: len(parts)] = np.reshape(parts, (len(parts), *shape[1:]))
    return whole


def burst(
    method: str, option: Option, scene: Scene, options: Mapping[str, Any], fixed: Mapping[str, Any]
) -> dict[str, Any]:
    """Error of the first burst; where a method has no ensemble also its cost and its first times.

    `fast` and solve_ivp are compared with `exact` on the same reduced model, without the finer model that `fast`
    takes for the onset by itself; `exact` has no other element. The published scheme is compared with itself,
    converged.
    """
    ramp: float = fixed["ramp"]
    end = 0.5 * ramp + ensembles.load_up(scene) + BURST
    common: dict[str, Any] = {"record": True, "sample_rate": RATE, "ramp": ramp}
    if method == PAPER:
        return slip_error(simulate(scene, end, "paper", **common, **options), converged(scene, end, ramp))
    # With a cut-off that is given there is no other model for the onset.
    common["cutoff"] = default_cutoff(scene.rig)
    if method == FAST and "termination" not in options:
        step = options.get("step", model_of(scene, options).default_step)
        common |= {**options, "step": step, "sample_rate": 1.0 / step}
        return slip_error(*(simulate(scene, end, each, **common) for each in ("fast", "exact")))
    if method == ELEMENTS:
        elements.run(scene, ramp, ramp, RATE)
        run, cpu = timed(lambda: elements.run(scene, end, ramp, RATE))
        reference = converged(scene, end, ramp)
    elif method == EVENTS:
        end += VIBRATION - BURST
        reference, model = simulate(scene, end, "exact", **common), model_of(scene, {})
        tolerance = float(option.value) if option.kind == "tolerance" else TOLERANCE
        run, cpu = timed(lambda: solve_ivp.run(scene, model, end, ramp, tolerance, reference.time))
    else:
        return {}
    # The run is that of the first member.
    firsts = {name: _padded([first], most_members(fixed)) for name, first in run.summary.items()}
    return {"cpu_per_second": cpu / end} | firsts | slip_error(run, reference)


@lru_cache(maxsize=8)
def converged(scene: Scene, end: float, ramp: float) -> Transient:
    """The published scheme with a finer step and without its numerical damping."""
    fine: dict[str, Any] = {"step": STEP / FINER, "beta2": UNDAMPED, "ramp": ramp}
    return simulate(scene, end, "paper", record=True, sample_rate=RATE, **fine)


def slip_error(run: Transient, reference: Transient) -> dict[str, float]:
    """Largest difference of the velocity of B over its largest value, from the start to half-way through slip.

    That is half-way between the reference's first slip and first separation: what grows until the surfaces part
    oscillates at up to 100 kHz, and a small error of its phase or of its rate is soon as large as the motion.
    """
    slip, parting = (reference.summary[f"first_{event}_time"] for event in ("slip", "separation"))
    ends = (0.5 * (slip + parting), run.summary["first_separation_time"], run.time[-1], reference.time[-1])
    times = run.time[run.time < np.nanmin(ends)]
    expected = CubicSpline(reference.time, reference.velocity_B)(times)
    wrong = np.abs(run.velocity_B[: len(times)] - expected)
    return {"slip_velocity_error": float(wrong.max() / np.abs(expected).max())}
