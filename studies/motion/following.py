"""Sweeps of one parameter up and down, in which each run starts from the final state of the previous one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from scipy.signal import find_peaks

from fivcore import Scene, SceneError, State, Transient, checks, full_model, loading_time
from studies.declaring.parameters import FRICTION, RIG, RUN, SCENE
from studies.declaring.spec import edges
from studies.motion import ensemble, regimes, starts
from studies.motion import run as runs
from studies.motion.jobs import Job, run_one, stacked
from studies.motion.stability import linear_stability
from sweeps import Axis, InputError, Variable

DIRECTIONS = ("up", "down")
# Extrema of the velocity of B that are kept, and how long they are looked for, s.
EXTREMA, WINDOW = 48, 0.04
# Speeds from one value to the next where V is followed.
SPEEDS = 8
KEPT = ("stick_fraction", "separation_fraction", "velocity_rms", "dominant_frequency")
ALONG = ("followed", "direction")
# Parameters that can be followed: those with numbers, but for the elements.
FOLLOWED = tuple(n for n in (*SCENE, *FRICTION, *RIG) if n != "decay" and not n.endswith("elements"))
OUTPUTS: dict[str, Any] = {
    "regime": replace(runs.SUMMARY["regime"], dims=ALONG),
    **{name: replace(runs.SUMMARY[name], dims=ALONG, dtype="float32", digits=6) for name in KEPT},
    "extremum": Variable("m s-1", "local extrema of the velocity of B", (*ALONG, "number"), "float32", digits=5),
    "mapping_error": ("1", "largest jump of the gaps' rates, per V, where the rig changes", *ALONG),
    "growth_rate": ("s-1", "growth rate of steady sliding's least stable mode below 10 kHz", "followed"),
    "model_growth_rate": ("s-1", "growth rate of the least stable mode of all that are simulated", "followed"),
}


def follow(
    chains: Sequence[tuple[Scene, ...]], member: Any, hold: float, knock: float = 0.0, **run: Any
) -> dict[str, Any]:
    """The motion of each point at each value of the parameter, upwards and downwards."""
    found: list[Any] = []
    for chain, number in zip(chains, np.broadcast_to(member, len(chains)).tolist(), strict=True):
        try:
            found.append(loop(chain, number, hold, knock, run))
        except SceneError as error:
            found.append(error)
    return stacked(found)


def loop(chain: Sequence[Scene], number: float, hold: float, knock: float, run: dict[str, Any]) -> dict[str, Any]:
    """Outputs of one realisation."""
    sense, settling = np.sign(chain[0].V), runs.SETTLING * chain[0].rig.time_scale
    chain = [scene if scene.V > 0.0 else scene.mirrored() for scene in chain]
    shape = len(chain), 2
    values: dict[str, Any] = {name: np.full(shape, np.nan) for name in ("regime", *KEPT, "mapping_error")}
    values["extremum"] = np.full((*shape, EXTREMA), np.nan)
    run = run | {"ramp": run["ramp"] * (1.0 + ensemble.STRETCH * (number - 1.0))}
    state, before = None, chain[0]
    for place, way in [(k, 0) for k in range(len(chain))] + [(k, 1) for k in reversed(range(len(chain)))]:
        scene, error = chain[place], 0.0
        if state is None:
            loading = 0.5 * run["ramp"] + loading_time(scene)
            job = runs.job(scene, loading + settling + hold, run)
            if knock:
                job = runs.job(scene, settling + hold, run, initial=starts.knocked(scene, knock)[0])
        else:
            # A change of V is a jump of the slip rate, which knocks a vibration: it is made in small ones.
            for speed in np.linspace(before.V, scene.V, SPEEDS + 1)[1:-1] if scene.V != before.V else ():
                between = replace(scene, V=float(speed))
                state, before = mapped(state, before, between)[0], between
                moved = run_one(runs.job(between, hold / SPEEDS, run, initial=state), balance=False)
                state = moved.final_state or state
            state, error = mapped(state, before, scene)
            job = runs.job(scene, settling + hold, run | {"settle": settling}, initial=state)
        motion = run_one(job)
        end = run_one(tail(job, motion), balance=False)
        found = runs.summary_of(motion) | {"extremum": sense * extrema(end.velocity_B), "mapping_error": error}
        for name, value in values.items():
            value[place, way] = found[name]
        state, before = end.final_state, scene
    stability = [linear_stability(scene, run["cutoff"], run["numerical_damping"]) for scene in chain]
    growth = {name: [each[name] for each in stability] for name in ("growth_rate", "model_growth_rate")}
    return {name: np.asarray(value) for name, value in (values | growth).items()}


def tail(job: Job, motion: Transient) -> Job:
    """Continue a motion, and record the velocity of B."""
    options = {**job.options, "initial": motion.final_state, "settle": None, "record": ("velocity_B",)}
    return Job(job.scene, WINDOW * job.scene.rig.time_scale, options)


def mapped(state: State | None, before: Scene, after: Scene) -> tuple[State, float]:
    """Map a state of one scene to another; return it with the jump of the gap rates relative to V.

    Each mode keeps its deviation from the equilibrium under the load and its velocity relative to the clamp, so
    that steady sliding at one speed becomes steady sliding at the other.
    """
    assert state is not None
    if np.any(getattr(after.rig, "gap", None)):
        raise InputError("structure: with initial gaps a state at another load is not mapped; give gap = 0")
    old, new = (full_model(scene.rig, scene.drive_theta) for scene in (before, after))
    q = state.displacement + _load(after) * new.static_equilibrium - _load(before) * old.static_equilibrium
    jump = np.abs(new.shapes @ state.velocity - old.shapes @ state.velocity).max() / abs(after.V)
    return State(q, state.velocity, state.contact, running=True, statuses=state.statuses), float(jump)


def _load(scene: Scene) -> float:
    return float(scene.F * scene.rig.preload)


def extrema(velocity: Any) -> Any:
    """Local maxima and minima, (EXTREMA,), selected evenly; padded with NaN."""
    places = np.sort(np.concatenate([find_peaks(velocity)[0], find_peaks(-velocity)[0]]))
    chosen = places[np.unique(np.linspace(0, len(places) - 1, EXTREMA).astype(int))] if len(places) else places
    return np.pad(velocity[chosen], (0, EXTREMA - len(chosen)), constant_values=np.nan)


COORDS = {
    "direction": Axis(np.array(DIRECTIONS), long_name="direction in which the parameter changes"),
    "number": Axis(np.arange(1, EXTREMA + 1), "1", "number of an extremum"),
}


def check(hold: Any, V: Any, F: Any, member: Any, **others: Any) -> None:
    """Refuse parameters with which no scene can be simulated."""
    checks.between("hold", float(np.min(hold)), 1e-3, 1e6, "s")
    checks.between("member", float(np.min(member)), 1.0, 1e6, "a number counted from 1")
    if np.min(V) < 0.0 < np.max(V):
        raise InputError("V: it changes its sign; follow speeds of one sign")
    runs.check(V, F, others["ramp"], **{name: others[name] for name in RUN if name != "ramp"})


def followed(dataset: xr.Dataset) -> str:
    """The parameter that was followed."""
    return str(dataset["growth_rate"].dims[-1])


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add the ends of the interval in which one direction vibrates and the other does not."""
    name, vibrates = followed(dataset), xr.zeros_like(dataset["regime"], dtype=bool)
    vibrates.values = regimes.is_of(dataset["regime"].values, *regimes.VIBRATING)
    differ = vibrates.isel(direction=0) != vibrates.isel(direction=1)
    ends = edges(dataset[name].values)
    units, low, high = dataset[name].attrs.get("units", "1"), ends[:-1], ends[1:]
    texts = {"low": ("least", low, "min"), "high": ("greatest", high, "max")}
    for side, (text, cells, which) in texts.items():
        found = getattr(xr.DataArray(cells, dims=name).where(differ), which)(name)
        text = f"{text} {name} at which the motion depends on the direction, half-way to the next value"
        dataset[f"bistable_{side}"] = found.assign_attrs(units=units, long_name=text)
    return dataset


def interval(dataset: xr.Dataset) -> list[tuple[float, float, bool]]:
    """Mean ends of the interval, their uncertainty (half a step and the scatter), and whether each is open."""
    values, found = dataset[followed(dataset)].values, []
    for side, beyond in (("low", 0), ("high", len(values))):
        ends = dataset[f"bistable_{side}"].values.ravel()
        ends = ends[np.isfinite(ends)]
        if not len(ends):
            return []
        place = int(np.clip(np.searchsorted(values, ends.mean()), 1, len(values) - 1))
        scatter = float(ends.std(ddof=1)) if len(ends) > 1 else 0.0
        error = float(np.hypot(0.5 * (values[place] - values[place - 1]), scatter))
        found.append((float(ends.mean()), error, bool((np.searchsorted(values, ends) == beyond).any())))
    return found
