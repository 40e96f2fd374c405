"""Run time against error: all methods and settings at the same scenes."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from filelock import FileLock
from numpy.typing import NDArray

from fivcore import Rig, Scene, checks, loading_time, published, simulate, simulate_many
from studies.accuracy.errors import with_errors
from studies.accuracy.presentation import figure, summary
from studies.accuracy.settings import EXACT, FAST, GIVEN, METHODS, PAPER, SCENES, SETTINGS, model_of, scene_of
from studies.declaring.parameters import RUN
from studies.motion import ensemble, series
from studies.motion.run import SETTLING, SUMMARY
from studies.study import Parameter, Study
from sweeps import Axis

Array = NDArray[Any]

MOST_MEMBERS, RIG = 100, Rig()
# After a run this long everything that an expensive method needs is compiled, and every basis built, s.
WARMING = 10e-3
# So many spectral peaks of the reference are stored, of this share of the largest one's power; sampling rate, Hz.
RIVALS, STRONG, RATE = 3, 0.5, 50e3
# One thread of one process holds it: while a run is timed this user's machine computes no other point.
TURN = FileLock(Path(tempfile.gettempdir(), f"fiv-accuracy-{getattr(os, 'getuid', int)()}.lock"))
STATISTICS = (
    *("stick_fraction", "slip_fraction", "separation_fraction", "dominant_frequency", "velocity_rms"),
    *("first_slip_time", "first_separation_time", "long_sticks", "mean_stick_time"),
)
COSTS = ("cpu_per_second",)  # differs whenever it is computed
OUTPUTS = {
    "cpu_per_second": ("1", "CPU time of a run per simulated second, with nothing beside it"),
    "step": ("s", "time step"),
    "modes": ("1", "number of modes"),
    **{name: (SUMMARY[name].units, f"{SUMMARY[name].long_name}, of each run", "member") for name in STATISTICS},
    "observed_time": ("s", "time simulated after settling, of each run", "member"),
    "rival_peaks": ("Hz", "peaks of the reference at least half as strong as the dominant one", "rival"),
}


def compare(method: Array, setting: Array, scene: Array, rig: Rig, members: int, **others: Any) -> dict[str, Any]:
    """Simulate one point at a time on one thread; NaN where a method lacks the setting or is too expensive."""
    sizes = {"member": members, "rival": RIVALS}
    shapes = {name: [len(method), *(sizes[dim] for dim in dims)] for name, (_, _, *dims) in OUTPUTS.items()}
    values = {name: np.full(shape, np.nan) for name, shape in shapes.items()}
    values["wall_time"] = np.zeros(len(method))
    for k, (of, name, at) in enumerate(zip(method.tolist(), setting.tolist(), scene.tolist(), strict=True)):
        if at in SETTINGS[name].scenes.get(of, ()):
            with TURN:
                start = time.perf_counter()
                found = measure(of, name, scene_of(at, rig), members=members, **others)
                found["wall_time"] = time.perf_counter() - start
            for output, value in found.items():
                values[output][k, ...].flat[: np.size(value)] = value
    return values


def measure(
    method: str, setting: str, scene: Scene, duration: float, ramp: float, members: int, members_expensive: int
) -> dict[str, Any]:
    """Cost, model and statistics of the runs of one scene."""
    options = SETTINGS[setting].options(scene)
    model = model_of(method, scene, options)
    values: dict[str, Any] = {"modes": len(model.stiffness)}
    if method != EXACT:
        values["step"] = options.get("step", published.PAPER_STEP if method == PAPER else model.default_step)
    ramps = [ramp * (1.0 + ensemble.STRETCH * k) for k in range(members if method == FAST else members_expensive)]
    simulate_many([scene], duration if method == FAST else WARMING, method, ramp=ramps[0], **options)
    start = time.thread_time()  # of this thread alone
    runs: list[Any] = simulate_many([scene] * len(ramps), duration, method, ramp=ramps, **options)
    cpu = time.thread_time() - start
    if failed := [run for run in runs if isinstance(run, Exception)]:
        raise failed[0]
    found = ensemble.summaries(runs)
    values |= {name: found[name] for name in STATISTICS}
    if (method, setting) == GIVEN:
        values["rival_peaks"] = rival_peaks(scene, duration, {"ramp": ramp, **options})
    observed = duration - values["first_slip_time"] - SETTLING
    return values | {"observed_time": observed, "cpu_per_second": cpu / (len(ramps) * duration)}


def rival_peaks(scene: Scene, duration: float, options: Mapping[str, Any]) -> Array:
    """Frequencies of the strongest spectral peaks of the velocity of B outside long sticks, Hz, at most RIVALS."""
    rate = series.OVERSAMPLING * RATE
    run = simulate(scene, duration, record=True, sample_rate=rate, **options)
    times = series.even_times(duration, RATE).values
    chosen = series.after_settling(run, times) & ~series.long_sticks(run, times)
    power = series.spectrum(series.velocity(run, times, RATE), chosen, RATE)
    peaks = scipy.signal.find_peaks(power, STRONG * np.max(power))[0]
    return np.asarray(series.frequencies(RATE).values[peaks[np.argsort(-power[peaks])][:RIVALS]])


def coords(members: int) -> dict[str, Axis]:
    """The runs and the rival peaks, numbered from 1."""
    runs = np.arange(1, checks.count("members", members, MOST_MEMBERS) + 1)
    peaks = Axis(np.arange(1, RIVALS + 1), "1", "peak by strength")
    return {"member": Axis(runs, "1", "run, by the ramp of its drive"), "rival": peaks}


def check(scene: Array, duration: Any, members: int, members_expensive: Any, ramp: Any, rig: Rig = RIG) -> None:
    """Refuse runs that are too short, or all equal."""
    checks.count("members_expensive", np.max(members_expensive), members)
    checks.between("ramp", np.min(ramp), 1e-6, 1.0, "s, for the runs of a scene differ by it")
    loading = max(loading_time(scene_of(name, rig)) for name in scene.tolist())
    # After settling the slowest has some windows of its spectrum.
    least = np.max(ramp) + loading + SETTLING + 4.0 * series.WINDOW
    checks.between("duration", np.min(duration), least, 1e3, "s, for the slowest scene to have settled")


STUDY = Study(
    "accuracy",
    "Run time against error",
    "What does each method cost, how wrong is it, and which setting is the cheapest that is right?",
    {
        "method": Parameter(np.array(METHODS), "1", "method of integration"),
        "setting": Parameter(np.array(list(SETTINGS)), "1", "what differs from the default, and its value"),
        "scene": Parameter(np.array(SCENES), "1", "scene: the paper's rig by speed, random rigs by number"),
        "duration": Parameter(1.2, "s", "simulated time of each run", common=True),
        "members": Parameter(10, "1", "runs of each scene and setting of fast", common=True),
        "members_expensive": Parameter(1, "1", "runs of each scene and setting of paper and exact", common=True),
        "ramp": RUN["ramp"],
    },
    OUTPUTS,
    compare,
    paper="Section 3.3: one scheme, in finite elements, at a step of 2e-8 s with beta2 = 0.8; no cost, no error.",
    derive=with_errors, summary=summary, figure=figure, coords=coords, check=check, chaotic=True, beams=True,
)  # fmt: skip
