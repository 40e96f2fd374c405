"""Limit cycles: found near a run and followed to a damping, or on the edge between two motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fivcore import (
    LimitCycle,
    Rig,
    Scene,
    SceneError,
    State,
    Transient,
    UnsolvedError,
    follow_cycle,
    limit_cycle,
    with_numerical_damping,
)
from studies.motion import regimes, run
from studies.motion.jobs import Job, run_all
from studies.physics.phases import SAMPLES, SEPARATION, SERIES
from sweeps import Variable

FORCES = ("normal_force", "tangential_force", "slip_velocity")
# A run of so many seconds finds a cycle at this d2, s; it is followed from there to that of the rig.
SEARCH, SOUGHT = 1.0, 1.5e-7
# Samples of a cycle that a motion is compared with; it is near up to this share of their deviations.
COMPARED, NEAR = 64, 0.5
# States of a vibration from which the edge is sought in turn.
TRIES = 4
CYCLE_SERIES = {
    f"cycle_{name}": Variable(each.units, f"{each.long_name}, on the limit cycle", ("phase",), "float32")
    for name, each in SERIES.items()
}
CYCLE = {
    "cycle_frequency": Variable("Hz", "frequency of the limit cycle"),
    "cycle_max_normal_force": Variable("N", "largest normal force on the limit cycle"),
    "cycle_max_slip_speed": Variable("m s-1", "largest slip speed on the limit cycle"),
    "cycle_multiplier": Variable("1", "largest Floquet multiplier of the limit cycle, in magnitude"),
    "cycle_near": Variable("1", "part of the overview, from the first slip on, that is near the limit cycle"),
    "cycle_d2": Variable("s", "d2 nearest to that of the rig to which the limit cycle is followed"),
}


def followed(scene: Scene, cutoff: float | None, most: int) -> tuple[LimitCycle | None, float]:
    """The limit cycle of a scene, if one is found, and the d2 to which it was followed.

    It is sought near a run without long sticks: of beams at d2 = SOUGHT, at which it repeats itself best.
    """
    own = getattr(scene.rig, "d2", np.nan)
    first = replace(scene, rig=replace(scene.rig, d2=SOUGHT)) if isinstance(scene.rig, Rig) else scene
    duration = SEARCH * scene.rig.time_scale
    try:
        (motion,) = run_all([Job(first, duration, {"cutoff": cutoff})])
        if isinstance(motion, SceneError) or motion.summary["regime"] not in regimes.WITHOUT_STICKS:
            return None, np.nan
        cycle = limit_cycle(first, duration=duration, cutoff=cutoff)
        if own == SOUGHT or not np.isfinite(own):
            return cycle, own
        branch = follow_cycle(cycle, "d2", own, most=most)
        nearest = int(np.abs(branch.values - own).argmin())
        if not branch.values.min() <= own <= branch.values.max():
            return None, float(branch.values[nearest])
        return limit_cycle(scene, branch.cycles[nearest]), own
    except (UnsolvedError, SceneError):
        return None, np.nan


def on_edge(scene: Scene, ends: Sequence[State] | None, hold: float, model: dict[str, Any]) -> LimitCycle | None:
    """The cycle on the edge between a vibration and sliding, or that of a run; None where none is found.

    The edge between sliding and some state of a vibration may be long or short: further states are tried in turn.
    """
    for _ in range(TRIES if ends else 1):
        try:
            if ends:
                (motion,) = run_all([Job(scene, 2.0 * hold, {"initial": ends[0], **model})])
                if isinstance(motion, SceneError) or motion.final_state is None:
                    return None
                ends = [motion.final_state, ends[1]]
            return limit_cycle(scene, ends and (ends[0], ends[1]), duration=2.0 * hold, **model)
        except (UnsolvedError, SceneError):
            continue
    return None


def values(
    scene: Scene, motion: Transient, most: int, numerical_damping: str, cutoff: float | None
) -> dict[str, Any]:
    """CYCLE and CYCLE_SERIES of a scene, from the longest stick on, and how near a motion is; NaN without one."""
    damped = replace(scene, rig=with_numerical_damping(scene.rig, run.METHOD, numerical_damping))
    cycle, d2 = followed(damped, cutoff, most) if most else (None, np.nan)
    values: dict[str, Any] = dict.fromkeys(CYCLE, np.nan) | {"cycle_d2": d2}
    if cycle is None:
        return values | {name: np.full(SAMPLES, np.nan) for name in CYCLE_SERIES}
    begins = np.cumsum([0.0, *(time for _, time in cycle.states)])
    stick = max(range(len(cycle.states)), key=lambda k: (cycle.states[k][0] == "stick", cycle.states[k][1]))
    time = (begins[stick] + cycle.period * np.arange(SAMPLES) / SAMPLES) % cycle.period
    N, T, slip = (np.interp(time, cycle.time, getattr(cycle, name)) for name in FORCES)
    state = cycle.state[np.searchsorted(cycle.time, time, side="right") - 1]
    ratio = np.divide(T, N, out=np.zeros_like(N), where=state != SEPARATION)
    moved = np.cumsum(slip) * cycle.period / SAMPLES
    summary = {name: cycle.summary[name.removeprefix("cycle_")] for name in list(CYCLE)[:3]}
    summary |= {"cycle_multiplier": cycle.summary["largest_multiplier"], "cycle_near": near(motion, cycle)}
    return values | summary | dict(zip(CYCLE_SERIES, (N, ratio, slip, moved - moved[0], state), strict=True))


def near(motion: Transient, cycle: LimitCycle) -> float:
    """The part of the time in which a motion is near a cycle.

    Near it is a period in which normal force and velocity of B differ from the cycle's, at the best phase, by
    less than NEAR of their deviations on it (root mean square).
    """
    step, names = cycle.period / COMPARED, ("normal_force", "velocity_B")
    times = np.arange(motion.summary["first_slip_time"], motion.time[-1], step)
    moved = np.stack([np.interp(times, motion.time, getattr(motion, name)) for name in names])
    one = np.stack([np.interp(step * np.arange(COMPARED), cycle.time, getattr(cycle, name)) for name in names])
    middle, spread = one.mean(axis=1, keepdims=True), one.std(axis=1, keepdims=True)
    one = (one - middle) / spread
    parts = np.lib.stride_tricks.sliding_window_view((moved - middle) / spread, COMPARED, axis=1)
    parts = parts[:, :: COMPARED // 8]
    # Products of each part with the cycle at all phases.
    products = np.fft.irfft(np.fft.rfft(parts) * np.fft.rfft(one).conj()[:, None], COMPARED).sum(axis=0)
    squares = (parts**2).sum(axis=(0, 2)) + (one**2).sum() - 2.0 * products.max(axis=-1)
    return float(np.mean(squares < NEAR**2 * len(names) * COMPARED))
