"""The motion up to the first separation, where trajectories can still be compared."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from fivcore import Scene, simulate
from fivcore.contact.reduced import default_cutoff, reduced_model
from fivcore.transient.published import STEP
from studies.accuracy import elements as accuracy_elements
from studies.accuracy import solve_ivp as accuracy_events
from studies.accuracy.runs import Cost, timed
from studies.accuracy.settings import ELEMENTS, EVENTS, FAST, PAPER, Option, model_of, tolerance_of
from studies.accuracy.trajectory import Track, errors, track_of
from studies.motion import ensembles

# How long after the first slip, by the static law, a run goes on that shall reach its first separation, s; and how
# long solve_ivp does, so that its cost is that of vibration too.
BURST, VIBRATION = 8e-3, 20e-3
# The published scheme's own converged motion: its step so many times finer, and no numerical damping.
FINER, UNDAMPED = 4, 0.5
# By how much the step of `fast`, of second order, is finer where there is no `exact`.
FINEST = 16
# At which motions are compared that have no step in common, Hz.
RATE = 1e6


def burst(
    method: int, option: Option, scene: Scene, given: Mapping[str, Any], ramp: float, most: int
) -> dict[str, Any]:
    """Errors up to the first separation; of what is no ensemble also its cost and its first times.

    `fast` and solve_ivp are held against `exact` on the same reduced model, without the finer model that `fast`
    takes for the onset by itself; `fast` with another element, which `exact` has not, and the published scheme
    against themselves, converged.
    """
    end = 0.5 * ramp + ensembles.load_up(scene) + BURST
    if method == FAST:
        return errors(*_fast_and_reference(scene, given, end, ramp)) if "contact_motion" not in given else {}
    if method == PAPER:
        run = simulate(scene, end, "paper", ramp=ramp, record=True, sample_rate=RATE, **given)
        return errors(track_of(run), converged(scene, end, ramp))
    if method == ELEMENTS:
        accuracy_elements.run(scene, ramp, ramp, RATE)
        found, cost = timed(lambda: accuracy_elements.run(scene, end, ramp, RATE))
        return errors(found, converged(scene, end, ramp)) | _alone(found, cost, end, most)
    if method == EVENTS:
        return _by_events(scene, option, end - BURST + VIBRATION, ramp, most)
    return {}


def _fast_and_reference(scene: Scene, given: Mapping[str, Any], end: float, ramp: float) -> tuple[Track, Track]:
    step = given.get("step", model_of(scene, given).default_step)
    # With a cut-off that is given there is no other model for the onset.
    common = {"cutoff": default_cutoff(scene.rig), **given, "ramp": ramp, "record": True, "step": step}
    fast = track_of(simulate(scene, end, "fast", sample_rate=1.0 / step, **common))
    if "termination" in given:
        finest = {**common, "step": step / FINEST, "sample_times": fast.time}
        return fast, track_of(simulate(scene, end, "fast", **finest))
    return fast, track_of(simulate(scene, end, "exact", sample_rate=1.0 / step, **common))


@lru_cache(maxsize=8)
def converged(scene: Scene, end: float, ramp: float) -> Track:
    """The published scheme with a finer step and without its numerical damping."""
    fine: dict[str, Any] = {"step": STEP / FINER, "beta2": UNDAMPED, "ramp": ramp}
    return track_of(simulate(scene, end, "paper", record=True, sample_rate=RATE, **fine))


def _by_events(scene: Scene, option: Option, end: float, ramp: float, most: int) -> dict[str, Any]:
    model = reduced_model(scene.rig, scene.drive_theta)
    common: dict[str, Any] = {"cutoff": default_cutoff(scene.rig), "ramp": ramp}
    exact = track_of(simulate(scene, end, "exact", record=True, sample_rate=RATE, **common))
    (found, reached), cost = timed(
        lambda: accuracy_events.run(scene, model, end, ramp, tolerance_of(option), exact.time)
    )
    gave_up = {"gave_up_time": reached if reached < end else np.nan}
    return errors(found, exact) | _alone(found, cost, reached, most) | gave_up


def _alone(found: Track, cost: Cost, length: float, most: int) -> dict[str, Any]:
    """Cost and first times of a run that is no ensemble, which is as the first member is."""
    firsts = np.full((2, most), np.nan)
    firsts[:, 0] = found.first_slip_time, found.first_separation_time
    return {
        "cpu_per_second": cost.cpu / length,
        "wall_per_second": cost.wall / length,
        "first_slip_time": firsts[0],
        "first_separation_time": firsts[1],
    }
