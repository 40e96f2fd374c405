"""Runs of one method with one setting at one scene: what they cost, and their figures."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray
from scipy import signal

from fivcore import Scene, simulate, simulate_many
from fivcore.transient.published import STEP
from studies.accuracy import solve_ivp
from studies.accuracy.settings import EVENTS, FAST, GIVEN, PAPER, Option, arguments, model_of
from studies.motion import ensembles, transients

Result = TypeVar("Result")

# After a run this long everything is compiled that an expensive method needs, and every basis built, s.
WARMING = 10e-3
# Figures kept of each repeat run besides the time that its figures are of.
KEPT = (
    "stick_fraction", "slip_fraction", "separation_fraction", "dominant_frequency", "velocity_rms",
    "mean_stick_time", "long_sticks", "first_slip_time", "first_separation_time",
)  # fmt: skip
# How long after the first slip, by the static law, solve_ivp goes on: its cost is that of vibration too, s.
VIBRATION = 20e-3
# Its relative tolerance.
TOLERANCE = 1e-6
# So many peaks of the reference are stored which have at least this share of the largest one's power; the rate at
# which the velocity of B is taken for them, Hz.
RIVALS, STRONG, RATE = 3, 0.5, 50e3
# On this machine one thread of one process holds it (a user's number is none on Windows, where the folder is
# their own): whatever is timed has no other point beside it.
TURN = FileLock(Path(tempfile.gettempdir(), f"fiv-accuracy-{getattr(os, 'getuid', int)()}.lock"))


def timed(compute: Callable[[], Result]) -> tuple[Result, float]:
    """A result and the thread's own CPU time, s, to which nothing else adds."""
    start = time.thread_time()
    return compute(), time.thread_time() - start


def measured(method: str, option: Option, scene: Scene, fixed: Mapping[str, Any]) -> dict[str, Any]:
    """Cost, model and figures of the runs of one scene; `fixed` are the study's settings."""
    options = arguments(method, option, scene)
    model = model_of(method, scene, options)
    own: dict[str, Any] = {"modes": len(model.stiffness)}
    if method == EVENTS:
        end = 0.5 * fixed["ramp"] + ensembles.loading_time(scene) + VIBRATION
        run, cpu = timed(lambda: solve_ivp.run(scene, model, end, fixed["ramp"], TOLERANCE, np.zeros(0)))
        firsts = {name: _padded([first], fixed["members"]) for name, first in run.summary.items()}
        return own | firsts | {"cpu_per_second": cpu / end}
    if method in (FAST, PAPER):
        own["step"] = options.get("step", STEP if method == PAPER else model.default_step)
    # An expensive method has fewer repeat runs.
    count, duration = fixed["members" if method == FAST else "members_expensive"], fixed["duration"]
    ramps = [ensembles.ramp_of(number, fixed["ramp"]) for number in range(1, count + 1)]
    simulate(scene, duration if method == FAST else WARMING, method, ramp=ramps[0], **options)
    runs, cpu = timed(lambda: simulate_many([scene] * count, duration, method, ramp=ramps, **options))
    if failed := [one for one in runs if isinstance(one, Exception)]:
        raise failed[0]
    every = [transients.figures_of(run) for run in runs if not isinstance(run, Exception)]
    figures = {name: _padded([each[name] for each in every], fixed["members"]) for name in KEPT}
    if (method, option.name) == GIVEN:
        own["rival_lines"] = rival_lines(scene, duration, {"ramp": ramps[0], **options})
    observed = duration - figures["first_slip_time"] - transients.SETTLING
    return own | figures | {"observed_time": observed, "cpu_per_second": cpu / (count * duration)}


def rival_lines(scene: Scene, duration: float, options: Mapping[str, Any]) -> NDArray[np.float64]:
    """Strongest peaks of the velocity of B outside long sticks, (RIVALS,), Hz; NaN where there are fewer."""
    run = simulate(scene, duration, record=True, sample_rate=transients.OVERSAMPLING * RATE, **options)
    times = transients.even_times(duration, RATE).values
    chosen = transients.settled(run, times) & ~transients.long_sticks(run, times)
    power = transients.spectrum(transients.velocity(run, times, RATE), chosen, RATE)
    peaks = signal.find_peaks(power, STRONG * np.max(power))[0]
    strongest = peaks[np.argsort(-power[peaks])][:RIVALS]
    return _padded(transients.frequencies(RATE).values[strongest], RIVALS)


def _padded(values: Any, count: int) -> NDArray[np.float64]:
    whole = np.full(count, np.nan)
    whole[: len(values)] = values
    return whole
