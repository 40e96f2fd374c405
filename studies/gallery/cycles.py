"""Limit cycles over one parameter, stable or not, beside hysteresis and the knocks that start vibration."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import (
    CycleBranch,
    LimitCycle,
    Rig,
    Scene,
    SceneError,
    State,
    UnsolvedError,
    checks,
    equilibrium,
    follow_cycle,
    limit_cycle,
    sliding_onsets,
)
from studies.declaring import labels
from studies.declaring.parameters import RIG, RUN, SCENE, rig_numbers
from studies.declaring.spec import evenly
from studies.gallery import hysteresis, knock
from studies.motion import regimes, run, starts
from studies.motion.jobs import Job, run_all
from studies.plotting import figures, general, planes
from studies.study import Parameter, Study
from sweeps import Axis, InputError, Variable

# Settings of the search for a threshold that keep their usual values.
KNOCK = {name: knock.PARAMETERS[name].default for name in ("largest_knock", "resolution")}
# What is kept of each cycle.
KEPT = ("value", "frequency", "rms", "multiplier", "branch")
# Places that are kept, and onsets; points of a figure side by side.
PLACES, ONSETS, COLUMNS, TRIES = 96, 8, 3, 4
CYCLE = {
    "cycle_value": Variable("1", "value of the followed parameter, in its units", ("number",)),
    "cycle_branch": Variable("1", "number of the branch", ("number",)),
    "cycle_frequency": Variable("Hz", "frequency of the limit cycle", ("number",), digits=9),
    "cycle_rms": Variable("m s-1", "RMS of the velocity of B on the limit cycle", ("number",), digits=9),
    "cycle_multiplier": Variable("1", "largest Floquet multiplier, in magnitude", ("number",), digits=9),
}
PLACE = {
    "place_value": Variable("1", "value of the followed parameter where a branch changes", ("place",)),
    "place_text": Variable("1", "what happens there", ("place",), "str"),
    "place_number": Variable("1", "index of the cycle there", ("place",)),
}
OUTPUTS = {n: v for n, v in hysteresis.OUTPUTS.items() if n not in ("extremum", "mapping_error")} | {
    **{n: replace(v, dims=("followed",), scale="") for n, v in knock.OUTPUTS.items()},
    **CYCLE, **PLACE,
    "onset_value": Variable("1", "onset of flutter of steady sliding", ("onset",)),
}  # fmt: skip


def bifurcations(
    chains: Sequence[tuple[Scene, ...]], follow: str, hold: float, most: int, edges: int, **how: Any
) -> dict[str, Any]:
    """Hysteresis, knock thresholds and branches of limit cycles of each chain of scenes."""
    found = hysteresis.follow(chains, 1.0, hold, **how)
    rows = [of_chain(*each, follow, hold, most, edges, how) for each in zip(chains, found["regime"], strict=True)]
    return {n: v for n, v in found.items() if n in OUTPUTS or n == "error"} | {
        name: np.stack([row[name] for row in rows]) for name in rows[0]
    }


def of_chain(
    chain: Sequence[Scene], regime: Any, name: str, hold: float, most: int, edges: int, how: dict[str, Any]
) -> dict[str, Any]:
    """Thresholds and branches, from the edge where two motions are stable, and from a periodic vibration."""
    model = {key: how[key] for key in ("cutoff", "numerical_damping")}
    ends, vibrates = [value_of(chain[k], name) for k in (0, -1)], regimes.is_of(regime, *regimes.VIBRATING)
    both, periodic = vibrates[:, 1] != vibrates[:, 0], regimes.is_of(regime, "periodic")[:, 0]
    thresholds = {key: np.full(len(chain), np.nan) for key in knock.OUTPUTS}
    tried: list[tuple[int, Any]] = []
    for k in spread(np.flatnonzero(both), edges):
        scene, options = chain[k], model | {"duration": None, "step": None}
        for key, value in knock.threshold(scene, KNOCK["largest_knock"], KNOCK["resolution"], options).items():
            thresholds[key][k] = value
        if np.isfinite(hit := thresholds["knock_threshold"][k]):
            q, (_, v) = equilibrium(scene), starts.directions(scene, ["knock"])[0]
            tried.append((k, (State.of(scene, q, 1.5 * hit * v), State.of(scene, q, 0.0 * v))))
    usual = periodic if periodic.any() or tried else vibrates[:, 0]
    tried += [(k, None) for k in spread(np.flatnonzero(usual), 1)]
    branches, places = list[Any](), list[tuple[float, str, int]]()
    for k, guess in tried:
        at = value_of(chain[k], name)
        # A branch that passes here already, of stable cycles in the case of a run, is this one.
        if any(passes(branch, at, guess is None) for branch in branches):
            continue
        cycle = sought(chain[k], guess, hold, model)
        if cycle is None:
            continue
        (back, before), (forth, after) = (side(cycle, name, at, end, most) for end in ends)
        first = sum(map(len, branches)) + len(before) - 1
        places += [(value, text, first - index) for value, text, index in places_of(back, ends)]
        places += [(value, text, first + index) for value, text, index in places_of(forth, ends)]
        branches.append(np.array([*before[::-1], *after[1:]]))
    rows = [np.column_stack([branch, np.full(len(branch), j + 1.0)]) for j, branch in enumerate(branches)]
    table = np.vstack([*rows, np.full(((edges + 1) * 2 * most - sum(map(len, rows)), 5), np.nan)])
    padded = [*sorted(places), *[(np.nan, "", np.nan)] * PLACES][:PLACES]
    onsets = np.full(ONSETS, np.nan)
    if name in ("mu", "V", "F"):
        crossed = sliding_onsets(chain[0], name, max(ends[0], 1e-12), ends[1], run.BAND)
        rising = crossed.value[crossed.change > 0][:ONSETS]
        onsets[: len(rising)] = rising
    kept = {f"cycle_{key}": column for key, column in zip(KEPT, table.T, strict=True)}
    kept |= {
        key: np.array(column, dtype=kind)
        for key, kind, column in zip(PLACE, "fOf", zip(*padded, strict=True), strict=True)
    }
    return thresholds | kept | {"onset_value": onsets}


def sought(
    scene: Scene, ends: tuple[State, State] | None, hold: float, model: dict[str, Any]
) -> LimitCycle | None:
    """The cycle on the edge between a vibration and sliding, or that of a run; None where none is found.

    The edge between sliding and some state of a vibration may be long or short: further states are tried in turn.
    """
    for _ in range(TRIES if ends else 1):
        try:
            if ends:
                (motion,) = run_all([Job(scene, 2.0 * hold, {"initial": ends[0], **model})])
                if isinstance(motion, SceneError) or motion.final_state is None:
                    return None
                ends = motion.final_state, ends[1]
            return limit_cycle(scene, ends, duration=2.0 * hold, **model)
        except (UnsolvedError, SceneError):
            continue
    return None


def places_of(branch: CycleBranch, ends: Sequence[float]) -> Iterator[tuple[float, str, int]]:
    """Places on a branch with the index of the cycle there, and why it ends within the range."""
    values, k = np.asarray(branch.values), 0
    for value, text in branch.places:
        across = np.flatnonzero((values[k + 1 :] - value) * (values[k:-1] - value) <= 0.0)
        k += int(np.abs(values[k:] - value).argmin() if text == "fold" or not len(across) else across[0])
        yield float(value), text, k
    if min(ends) < values[-1] < max(ends) and not branch.end.startswith(("birth", branch.parameter)):
        reason = re.sub(rf" (at|beyond) {branch.parameter} = [^\s,]+", "", branch.end)
        yield float(values[-1]), f"end: {reason}", len(values) - 1


def value_of(scene: Scene, name: str) -> float:
    """The value of a parameter of a scene."""
    numbers = rig_numbers(scene.rig) if isinstance(scene.rig, Rig) else {}
    return float((vars(scene) | vars(scene.friction) | numbers)[name])


def spread(places: Any, count: int) -> list[int]:
    """At most `count` of the places, evenly within them."""
    shares = np.linspace(0.0, len(places) - 1.0, count + 2)[1:-1] if len(places) else ()
    return [*dict.fromkeys(int(places[round(share)]) for share in shares)]


def side(cycle: LimitCycle, name: str, at: float, end: float, most: int) -> tuple[CycleBranch, list[Any]]:
    """The branch to one side and what is kept of its cycles: parameter, frequency, RMS and largest multiplier."""
    branch = CycleBranch(name, np.array([at]), [cycle], [], name)
    if end != at:
        branch = follow_cycle(cycle, name, end, most=most)
    kept = [
        (float(value), one.frequency, one.summary["velocity_rms"], one.summary["largest_multiplier"])
        for value, one in zip(branch.values, branch.cycles, strict=True)
    ]
    return branch, kept


def passes(branch: Any, value: float, stable: bool) -> bool:
    """Whether a branch passes a value of the parameter, or with `stable` does so with a stable cycle."""
    across = (branch[1:, 0] - value) * (branch[:-1, 0] - value) <= 0.0
    return bool(np.any(across & (branch[1:, 3] < 1.0) if stable else across))


def check(V: Any, hold: Any, **others: Any) -> None:
    """Refuse what cannot be run."""
    if np.min(V) <= 0.0:
        raise InputError(f"V = {np.min(V):g}: it must be above 0; (-theta, -V) is the mirror image of (theta, V)")
    hysteresis.check(hold, V, member=1.0, **others)


def coords(most: int, edges: int) -> dict[str, Axis]:
    """The dimensions of branches, of places and of onsets."""
    checks.count("most", most, 1000)
    checks.count("edges", edges, 20)
    sizes = {"number": (edges + 1) * 2 * most, "place": PLACES, "onset": ONSETS}
    return {"direction": hysteresis.STUDY.coords["direction"]} | {  # type: ignore[index]
        name: Axis(np.arange(1, size + 1), "1", f"number of a {name}") for name, size in sizes.items()
    }


def each_point(dataset: xr.Dataset) -> Iterator[tuple[str, xr.Dataset]]:
    """Each point with the values by which it differs from the others."""
    dims = [str(dim) for dim in dataset["status"].dims]
    for place in np.ndindex(*(dataset.sizes[dim] for dim in dims)):
        point = dataset.isel(dict(zip(dims, place, strict=True)))
        yield ", ".join(labels.named(dim, point[dim]) for dim in dims), point


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Where there are stable and unstable cycles, where they begin and end, and what runs say beside them."""
    name, rows = hysteresis.followed(dataset), []
    unit, factor = labels.unit_of(dataset[name])
    for text, point in each_point(dataset):
        value, hertz, multiplier = (point[f"cycle_{key}"].values for key in ("value", "frequency", "multiplier"))
        onsets, parts = point["onset_value"].dropna("onset").values, []
        for kind, chosen in (("stable", multiplier < 1.0), ("unstable", multiplier >= 1.0)):
            if chosen.any():
                ends = " to ".join(f"{factor * end:.5g}" for end in (value[chosen].min(), value[chosen].max()))
                parts.append(f"{kind} ones from {ends}, {hertz[chosen].min():.0f} to {hertz[chosen].max():.0f} Hz")
        texts = point["place_text"].values.astype(str)
        rows += [
            (text, f"{factor * at:.5g}", what)
            for at, what in zip(point["place_value"].values, texts, strict=True)
            if what
        ]
        found = {"fold": point["place_value"].values[texts == "fold"], "onset of flutter": onsets}
        parts += [
            f"{what} at {', '.join(f'{factor * x:.5g}' for x in at)}" for what, at in found.items() if len(at)
        ]
        if both := hysteresis.interval(point):
            parts.append(f"runs up and down differ from {factor * both[0][0]:.4g} to {factor * both[1][0]:.4g}")
        knocks = labels.readable(point["knock_threshold"].dropna(name)).values
        if len(knocks):
            parts.append(f"knocks from {knocks.min():.3g} to {knocks.max():.3g} mN s start vibration")
        head = "Limit cycles" if np.isfinite(value).any() else "No limit cycle is found"
        over = f"over {labels.title(name)}{f' in {unit}' if unit else ''} at {text}"
        yield f"{head} {over}: {'; '.join(parts) or 'runs up and down are the same'}."
    yield "Places where a branch changes", pd.DataFrame(rows, columns=["point", labels.title(name), "what"])


def draw(dataset: xr.Dataset) -> figures.Figure:
    """A column for each point: size, frequency and multiplier of cycles, and knocks, over the parameter."""
    if not bool(np.isfinite(dataset["regime"]).any()):
        return general.draw(dataset)
    points = [*each_point(dataset)]
    chosen = planes.subset(len(points), COLUMNS)
    width = max(9.0 * len(chosen), 12.0)
    figure, panels = figures.panels(4, len(chosen), width, 21.0, sharex="col", sharey="row")
    grid = np.array(panels).reshape(4, len(chosen))
    for column, k in zip(grid.T, chosen, strict=True):
        _draw_point(column, points[k][1])
        column[0].set_title(points[k][0], fontsize=9.0)
    for axes, text in zip(grid[:, 0], SIDES, strict=True):
        axes.set_ylabel(text)
    figures.legend_below(figure, panels, 3 if len(chosen) > 1 else 2)
    name = hysteresis.followed(dataset)
    at = ", ".join(labels.named(n, dataset[n]) for n in SCENE if n in dataset.coords and not dataset[n].ndim)
    title = f"Limit cycles over {labels.title(name)}, {at}{planes.of_all(chosen, len(points))}"
    figure.suptitle(figures.fitted(title, width))
    return figure


SIDES = ("RMS velocity\nof B / (mm/s)", "frequency / Hz", "largest multiplier", "knock / (mN s)")
# Of places by their texts, and the text of a birth.
BIRTH, ENDS, MARKERS = "birth from steady sliding", "branch not followed further", "oDs^<>phH8P"


def _draw_point(column: Any, point: xr.Dataset) -> None:
    """Branches, solid where stable; places on them; runs, onsets and thresholds."""
    name = hysteresis.followed(point)
    factor, x = labels.unit_of(point[name])[1], labels.readable(point[name]).values
    cycles = {each: point[f"cycle_{each}"].values for each in KEPT}
    value, stable, rms = factor * cycles["value"], cycles["multiplier"] < 1.0, 1e3 * cycles["rms"]
    for axes, y in zip(column, (rms, cycles["frequency"], cycles["multiplier"]), strict=False):
        for branch in np.unique(cycles["branch"][np.isfinite(cycles["branch"])]):
            on = cycles["branch"] == branch
            for kind, style, of_kind in (("stable", "-", stable), ("unstable", "--", ~stable)):
                # From the last cycle of the other kind on, so that the curve has no gap.
                shown = on & (of_kind | np.append(of_kind[1:] & on[1:], False))
                part = np.where(shown, value, np.nan)[on]
                axes.plot(part, y[on], style, color=figures.BLUE, label=f"{kind} cycle")
    texts, numbers = point["place_text"].values.astype(str), point["place_number"].values
    for k, text in enumerate(sorted({*texts} - {""})):
        at = numbers[(texts == text) & np.isfinite(numbers)].astype(int)
        edge = figures.BLACK if text in ("fold", BIRTH) else figures.ORANGE
        marker, label = ("x", ENDS) if text.startswith("end") else (MARKERS[k % len(MARKERS)], text)
        column[0].plot(value[at], rms[at], marker, mfc="none", mec=edge, markersize=5.0, label=label, zorder=3)
    for k, (way, colour, marker) in enumerate((("up", figures.GREEN, "^"), ("down", figures.RED, "v"))):
        run_rms, label = 1e3 * point["velocity_rms"].isel(direction=k).values, f"{labels.title(name)} going {way}"
        column[0].plot(x, run_rms, marker, color=colour, mfc="none", markersize=4.0, label=f"runs, {label}")
    column[2].axhline(1.0, color=figures.GREY, linewidth=0.8)
    knocks, errors = (labels.readable(point[each]).values for each in knock.OUTPUTS)
    look: dict[str, Any] = {"fmt": "o", "color": figures.BLACK, "markersize": 4.0}
    column[3].errorbar(x, knocks, errors, label="knock that starts vibration", **look)
    ends, onsets = hysteresis.interval(point), point["onset_value"].dropna("onset").values
    for axes in column:
        for onset in onsets:
            axes.axvline(factor * onset, color=figures.BLACK, linestyle=":", label="onset of flutter")
        if ends:
            low, high = (factor * end[0] for end in ends)
            axes.axvspan(low, high, color=figures.GREY, alpha=0.2, linewidth=0.0, label="runs up and down differ")
    planes.set_side(column[-1], "x", point[name])


STUDY = Study(
    name="cycles",
    title="Limit cycles over one parameter",
    question="Which periodic motions are there, stable or not, where do they begin and end, and do they bound "
    "what runs and knocks show?",
    paper="Section 3.5.4: vibration settles to a period of stick, slip and separation.",
    parameters={
        "d2": replace(RIG["d2"], default=np.array([1e-8, 1e-6])),
        "mu": Parameter(evenly(0.08, 0.125, 46), "1", SCENE["mu"].text, inner=True),
        "follow": Parameter("mu", "1", "parameter that is followed", hysteresis.FOLLOWED, common=True),
        "hold": Parameter(0.25, "s", "time of statistics at each value of the runs", common=True),
        "most": Parameter(60, "1", "most cycles of a branch to each side", common=True),
        "edges": Parameter(
            4, "1", "values at which knocks and the edge between two motions are sought", common=True
        ),
    }
    | RUN,
    outputs=OUTPUTS,
    function=bifurcations,
    coords=coords,
    derive=hysteresis.derive,
    summary=summarise,
    figure=draw,
    check=check,
    chaotic=True,
)
