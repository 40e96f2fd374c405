"""One parameter followed up and down, each motion from the end of the last: where two motions are stable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.signal import find_peaks

from fivcore import Scene, State, Transient, checks, equilibrium, full_model, loading_time
from studies.declaring import labels
from studies.declaring.parameters import FRICTION, RIG, RUN, SCENE
from studies.declaring.spec import evenly
from studies.motion import ensemble, regimes, starts
from studies.motion import run as runs
from studies.motion.jobs import Job, balanced, run_all
from studies.motion.stability import linear_stability
from studies.plotting import figures, general, planes
from studies.study import Parameter, Study
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
    """The motion at each value of the parameter, up and down, of each point."""
    numbers = np.broadcast_to(member, len(chains)).tolist()
    found = [loop(chain, number, hold, knock, run) for chain, number in zip(chains, numbers, strict=True)]
    errors = [each if isinstance(each, Exception) else None for each in found]
    done = [each for each in found if isinstance(each, dict)]
    if not done:
        assert errors[0] is not None
        raise errors[0]
    return {name: np.stack([(e if isinstance(e, dict) else done[0])[name] for e in found]) for name in done[0]} | {
        "error": errors
    }


def loop(chain: Sequence[Scene], number: float, hold: float, knock: float, run: dict[str, Any]) -> Any:
    """Outputs of one realisation, or the error of the first scene that has none."""
    sense, settling = np.sign(chain[0].V), runs.SETTLING * chain[0].rig.time_scale
    chain = [scene if scene.V > 0.0 else scene.mirrored() for scene in chain]
    values: dict[str, Any] = {
        name: np.full((len(chain), 2), np.nan) for name in ("regime", *KEPT, "mapping_error")
    }
    values["extremum"] = np.full((len(chain), 2, EXTREMA), np.nan)
    run = run | {"ramp": run["ramp"] * (1.0 + ensemble.STRETCH * (number - 1.0))}
    state, before = None, chain[0]
    for place, way in [(k, 0) for k in range(len(chain))] + [(k, 1) for k in reversed(range(len(chain)))]:
        scene, error = chain[place], 0.0
        if state is None:
            loading = 0.5 * run["ramp"] + loading_time(scene)
            job = runs.job(scene, loading + settling + hold, run)
            if knock:
                q, (_, v) = equilibrium(scene), starts.directions(scene, ["knock"])[0]
                job = runs.job(scene, settling + hold, run, initial=State.of(scene, q, knock * v))
        else:
            # A change of V is a jump of the slip rate, which knocks a vibration: it is made in small ones.
            for speed in np.linspace(before.V, scene.V, SPEEDS + 1)[1:-1] if scene.V != before.V else ():
                between = replace(scene, V=float(speed))
                state, before = mapped(state, before, between)[0], between
                (moved,) = run_all([runs.job(between, hold / SPEEDS, run, initial=state)])
                if isinstance(moved, Exception):
                    return moved
                state = moved.final_state or state
            state, error = mapped(state, before, scene)
            job = runs.job(scene, settling + hold, run | {"settle": settling}, initial=state)
        motion = balanced(job, run_all([job])[0])
        end = motion if isinstance(motion, Exception) else run_all([tail(job, motion)])[0]
        if isinstance(end, Exception):
            return end
        assert isinstance(motion, Transient)
        summary = runs.summary_of(motion)
        for name in ("regime", *KEPT):
            values[name][place, way] = summary[name]
        values["extremum"][place, way] = sense * extrema(end.velocity_B)
        values["mapping_error"][place, way] = error
        state, before = end.final_state, scene
    stability = [linear_stability(scene, run["cutoff"], run["numerical_damping"]) for scene in chain]
    growth = {name: [each[name] for each in stability] for name in ("growth_rate", "model_growth_rate")}
    return {name: np.asarray(value) for name, value in (values | growth).items()}


def tail(job: Job, motion: Transient) -> Job:
    """The run that goes on with a motion and records the velocity of B."""
    options = {**job.options, "initial": motion.final_state, "settle": None, "record": ("velocity_B",)}
    return Job(job.scene, WINDOW * job.scene.rig.time_scale, options)


def mapped(state: State | None, before: Scene, after: Scene) -> tuple[State, float]:
    """The state of one scene for another, and the jump of the gaps' rates relative to V.

    Every mode keeps its deviation from the equilibrium under the load, and its velocity relative to the clamp:
    steady sliding at one speed becomes that at another.
    """
    assert state is not None
    old, new = (full_model(scene.rig, scene.drive_theta) for scene in (before, after))
    q = state.displacement + _load(after) * new.static_equilibrium - _load(before) * old.static_equilibrium
    jump = np.abs(new.shapes @ state.velocity - old.shapes @ state.velocity).max() / abs(after.V)
    return State(q, state.velocity, state.contact, running=True), float(jump)


def _load(scene: Scene) -> float:
    return float(scene.F * scene.rig.preload)


def extrema(velocity: Any) -> Any:
    """Local maxima and minima, (EXTREMA,), evenly chosen of all; NaN where there are fewer."""
    places = np.sort(np.concatenate([find_peaks(velocity)[0], find_peaks(-velocity)[0]]))
    chosen = places[np.unique(np.linspace(0, len(places) - 1, EXTREMA).astype(int))] if len(places) else places
    return np.pad(velocity[chosen], (0, EXTREMA - len(chosen)), constant_values=np.nan)


def check(hold: Any, V: Any, F: Any, member: Any, **others: Any) -> None:
    """Refuse what cannot be run."""
    checks.between("hold", float(np.min(hold)), 1e-3, 1e6, "s")
    checks.between("member", float(np.min(member)), 1.0, 1e6, "a number counted from 1")
    if np.min(V) < 0.0 < np.max(V):
        raise InputError("V: it changes its sign; follow speeds of one sign")
    runs.check(V, F, others["ramp"], **{name: others[name] for name in RUN if name != "ramp"})


def followed(dataset: xr.Dataset) -> str:
    """The parameter that was followed."""
    return str(dataset["growth_rate"].dims[-1])


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add where both directions differ: one vibrates and the other does not, or both are at rest differently."""
    name, vibrates = followed(dataset), xr.zeros_like(dataset["regime"], dtype=bool)
    vibrates.values = regimes.is_of(dataset["regime"].values, *regimes.VIBRATING)
    differ = vibrates.isel(direction=0) != vibrates.isel(direction=1)
    ends = planes.edges(dataset[name].values)
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


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Where the motion depends on the direction, and the motion at each value."""
    name = followed(dataset)
    factor, unit = labels.unit_of(dataset[name])[1], labels.unit_of(dataset[name])[0]
    ends = [
        f"{'beyond ' if is_open else ''}{factor * value:.4g} ± {factor * error:.2g}"
        for value, error, is_open in interval(dataset)
    ]
    where = f"{labels.title(name)} from {' to '.join(ends)}{f' {unit}' if unit else ''}"
    count = int(np.isfinite(dataset["bistable_low"]).sum())
    loops = dataset["bistable_low"].size
    if ends:
        yield f"Sliding and vibration are both stable at {where}, in {count} of {loops} loops."
    else:
        yield "Up and down the motion is the same, steady or vibrating, at each value: there is no hysteresis."
    at = dataset.isel({dim: 0 for dim in dataset["status"].dims})
    table = pd.DataFrame({name: labels.readable(dataset[name]).values})
    for k, way in enumerate(DIRECTIONS):
        codes = at["regime"].isel(direction=k).values
        table[f"{way}"] = [regimes.KINDS[int(code)] if np.isfinite(code) else "-" for code in codes]
        table[f"{way}, rms mm/s"] = (1e3 * at["velocity_rms"].isel(direction=k)).round(4).values
    table["growth rate 1/s"] = at["growth_rate"].values
    yield "Motion at each value, first loop", table


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Extrema of the velocity of B both ways, and growth rates."""
    if not bool(np.isfinite(dataset["regime"]).any()):
        return general.draw(dataset)
    name, ends = followed(dataset), interval(dataset)
    figure, (top, middle, below) = figures.panels(3, 1, 16.0, 19.0, sharex=True, height_ratios=(2.0, 1.2, 1.0))
    x, factor = labels.readable(dataset[name]), labels.unit_of(dataset[name])[1]
    looks = (("up", figures.BLUE, "^", -1.0), ("down", figures.ORANGE, "v", 1.0))
    shift = 0.12 * np.diff(planes.edges(x.values))
    rest = [dim for dim in dataset["status"].dims]
    for k, (way, colour, marker, side) in enumerate(looks):
        at = dataset.isel(direction=k).transpose(name, ...)
        points = 1e3 * at["extremum"].values.reshape(len(x), -1)
        along = np.broadcast_to((x.values + side * shift)[:, None], points.shape)
        top.plot(along.ravel(), points.ravel(), ".", color=colour, markersize=1.5, alpha=0.5)
        rms = 1e3 * at["velocity_rms"].values.reshape(len(x), -1)
        middle.plot(x, rms, color=colour, linewidth=0.6)
        middle.plot(x, rms, marker, color=colour, markersize=4.0, mfc="none", label=None)
        middle.plot([], [], color=colour, marker=marker, mfc="none", label=f"{way}ward")
    at = dataset.isel({dim: 0 for dim in rest if dim in dataset["growth_rate"].dims})
    below.plot(x, at["growth_rate"], color=figures.BLACK, label="modes below 10 kHz")
    below.plot(x, at["model_growth_rate"], ":", color=figures.GREY, label="all modes that are simulated")
    below.axhline(0.0, color=figures.GREY, linewidth=0.8)
    for axes in (top, middle, below) if ends else ():
        axes.axvspan(factor * ends[0][0], factor * ends[1][0], color=figures.GREY, alpha=0.2, linewidth=0.0)
    top.set_ylabel("extrema of the velocity of B / (mm/s)")
    middle.set_ylabel("RMS velocity of B / (mm/s)")
    below.set_ylabel("growth rate / (1/s)")
    planes.set_side(below, "x", dataset[name])
    figures.letter((top, middle, below), ("motion", "its size", "linear stability of steady sliding"))
    figures.legend_below(figure, [middle, below], 4)
    where = [labels.named(each, dataset[each]) for each in ("V", "theta", "mu", "F") if dataset[each].ndim == 0]
    both = "; grey: sliding and vibration are both stable" if ends else ""
    figure.suptitle(figures.fitted(f"{labels.title(name)} followed up and down, {', '.join(where)}{both}", 16.0))
    return figure


STUDY = Study(
    name="hysteresis",
    title="Hysteresis: one parameter followed up and down",
    question="Where a parameter rises and falls again, does the rig begin and cease to vibrate at one value?",
    paper="Each test starts from rest at one set of parameters.",
    parameters={
        "mu": Parameter(evenly(0.08, 0.13, 26), "1", SCENE["mu"].text, inner=True),
        "member": Parameter(np.arange(1, 4), "1", "realisation, by the ramp of the drive"),
        "follow": Parameter("mu", "1", "parameter that is followed", FOLLOWED, common=True),
        "hold": Parameter(0.5, "s", "time of statistics at each value", common=True),
        "knock": Parameter(
            0.0, "N s", "start by this impulse on sliding P1, positive onto P2; 0: start of the drive", common=True
        ),
    }
    | RUN,
    outputs=OUTPUTS,
    function=follow,
    coords={
        "direction": Axis(np.array(DIRECTIONS), long_name="direction in which the parameter changes"),
        "number": Axis(np.arange(1, EXTREMA + 1), "1", "number of an extremum"),
    },
    derive=derive,
    summary=summarise,
    figure=draw,
    check=check,
    chaotic=True,
)
