"""Limit cycles over one parameter, stable or not, beside hysteresis and the knocks that start vibration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Scene
from studies.declaring import labels
from studies.declaring.parameters import RIG, RUN, SCENE
from studies.declaring.spec import evenly
from studies.motion import following, knock
from studies.physics import cycles
from studies.plotting import figures, general, planes
from studies.study import Parameter, Study
from sweeps import InputError

COLUMNS = 3
SIDES = ("RMS velocity\nof B / (mm/s)", "frequency / Hz", "largest multiplier", "knock / (mN s)")
# Of places by their texts, and the text of a birth.
BIRTH, ENDS, MARKERS = "birth from steady sliding", "branch not followed further", "oDs^<>phH8P"


def bifurcations(
    chains: Sequence[tuple[Scene, ...]], follow: str, hold: float, most: int, edges: int, **how: Any
) -> dict[str, Any]:
    """Hysteresis, knock thresholds and branches of limit cycles of each chain of scenes."""
    found = following.follow(chains, 1.0, hold, **how)
    points = zip(chains, found["regime"], strict=True)
    rows = [cycles.of_chain(*point, follow, hold, most, edges, how) for point in points]
    own = {n: v for n, v in found.items() if n in cycles.BRANCHES or n == "error"}
    return own | {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def check(V: Any, hold: Any, **others: Any) -> None:
    """Refuse parameters with which no scene can be simulated."""
    if np.min(V) <= 0.0:
        raise InputError(f"V = {np.min(V):g}: it must be above 0; (-theta, -V) is the mirror image of (theta, V)")
    following.check(hold, V, member=1.0, **others)


def each_point(dataset: xr.Dataset) -> Iterator[tuple[str, xr.Dataset]]:
    """Each point with the values by which it differs from the others."""
    dims = [str(dim) for dim in dataset["status"].dims]
    for place in np.ndindex(*(dataset.sizes[dim] for dim in dims)):
        point = dataset.isel(dict(zip(dims, place, strict=True)))
        yield ", ".join(labels.named(dim, point[dim]) for dim in dims), point


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Ranges of stable and unstable cycles, their folds and onsets, and what runs and knocks show."""
    name, rows = following.followed(dataset), []
    unit, factor = labels.unit_of(dataset[name])
    for text, point in each_point(dataset):
        value, hertz, multiplier = (point[f"cycle_{key}"].values for key in ("value", "frequency", "multiplier"))
        parts, texts = list[str](), point["place_text"].values.astype(str)
        for kind, chosen in (("stable", multiplier < 1.0), ("unstable", multiplier >= 1.0)):
            if chosen.any():
                ends = " to ".join(f"{factor * end:.5g}" for end in (value[chosen].min(), value[chosen].max()))
                band = f"{hertz[chosen].min():.0f} to {hertz[chosen].max():.0f} Hz"
                parts.append(f"{kind} ones exist from {ends} ({band})")
        ats = point["place_value"].values
        places = [(f"{factor * at:.5g}", what) for at, what in zip(ats, texts, strict=True)]
        rows += [(text, *place) for place in places if place[1]]
        onsets = [f"{factor * at:.5g}" for at in point["onset_value"].dropna("onset").values]
        found = {"branches fold": [at for at, what in places if what == "fold"], "flutter begins": onsets}
        parts += [f"{what} at {', '.join(at)}" for what, at in found.items() if at]
        if both := following.interval(point):
            ends = " to ".join(f"{factor * end[0]:.4g}" for end in both[:2])
            parts.append(f"upward and downward runs move differently from {ends}")
        knocks = labels.readable(point["knock_threshold"].dropna(name)).values
        if len(knocks):
            ends = f"{knocks.min():.3g} to {knocks.max():.3g} mN s"
            parts.append(f"the smallest knock that starts vibration is {ends}")
        head = "Limit cycles" if np.isfinite(value).any() else "No limit cycle is found"
        over = f"over {labels.title(name)}{f' in {unit}' if unit else ''} at {text}"
        yield f"{head} {over}: {'; '.join(parts) or 'upward and downward runs move alike'}."
    changes = pd.DataFrame(rows, columns=["point", labels.title(name), "change of the cycle"])
    yield "Points where a branch folds, ends, or changes its sequence of stick, slip and separation", changes


def draw(dataset: xr.Dataset) -> figures.Figure:
    """A column for each point: size, frequency and multiplier of cycles, and knocks, over the parameter."""
    if not bool(np.isfinite(dataset["regime"]).any()):
        return general.draw(dataset)
    points = [*each_point(dataset)]
    chosen = planes.subset(len(points), COLUMNS)
    figure, panels = figures.panels(4, len(chosen), 4.5, stack=False, sharex="col", sharey="row")
    grid = np.array(panels).reshape(4, len(chosen))
    for column, k in zip(grid.T, chosen, strict=True):
        _draw_point(column, points[k][1])
        column[0].set_title(points[k][0], loc="left")
    for axes, text in zip(grid[:, 0], SIDES, strict=True):
        axes.set_ylabel(text)
    figures.legend_below(figure, panels, 3 if len(chosen) > 1 else 2)
    left_out = planes.of_all(chosen, len(points), "points")
    figure.suptitle(f"Limit cycles over {labels.title(following.followed(dataset))}{left_out}")
    return figure


def _draw_point(column: Any, point: xr.Dataset) -> None:
    """Branches, solid where stable; places on them; runs, onsets and thresholds."""
    name = following.followed(point)
    factor, x = labels.unit_of(point[name])[1], labels.readable(point[name]).values
    kept = {each: point[f"cycle_{each}"].values for each in cycles.KEPT}
    value, stable, rms = factor * kept["value"], kept["multiplier"] < 1.0, 1e3 * kept["rms"]
    for axes, y in zip(column, (rms, kept["frequency"], kept["multiplier"]), strict=False):
        for branch in np.unique(kept["branch"][np.isfinite(kept["branch"])]):
            on = kept["branch"] == branch
            for kind, style, of_kind in (("stable", "-", stable), ("unstable", "--", ~stable)):
                # From the last cycle of the other kind on, so that the curve has no gap.
                shown = on & (of_kind | np.append(of_kind[1:] & on[1:], False))
                axes.plot(
                    np.where(shown, value, np.nan)[on], y[on], style, color=figures.BLUE, label=f"{kind} cycle"
                )
    texts, numbers = point["place_text"].values.astype(str), point["place_number"].values
    for k, text in enumerate(sorted({*texts} - {""})):
        at = numbers[(texts == text) & np.isfinite(numbers)].astype(int)
        edge = figures.BLACK if text in ("fold", BIRTH) else figures.ORANGE
        marker, label = ("x", ENDS) if text.startswith("end") else (MARKERS[k % len(MARKERS)], text)
        column[0].plot(value[at], rms[at], marker, mfc="none", mec=edge, markersize=5.0, label=label, zorder=3)
    for way, (colour, marker) in figures.WAYS.items():
        run_rms, label = 1e3 * point["velocity_rms"].sel(direction=way), f"{labels.title(name)} going {way}"
        column[0].plot(x, run_rms, marker, color=colour, mfc="none", markersize=4.0, label=f"runs, {label}")
    column[2].axhline(1.0, color=figures.GREY, linewidth=0.8)
    knocks, errors = (labels.readable(point[each]).values for each in knock.OUTPUTS)
    look: dict[str, Any] = {"fmt": "o", "color": figures.BLACK, "label": "knock that starts vibration"}
    figures.curve(column[3], x, knocks, errors, **look, capsize=0.0)
    for axes in column:
        for onset in point["onset_value"].dropna("onset").values:
            axes.axvline(factor * onset, color=figures.BLACK, linestyle=":", label="onset of flutter")
        figures.spans(axes, [[factor * end[0] for end in following.interval(point)]], "runs up and down differ")
    planes.set_side(column[-1], "x", point[name])


STUDY = Study(
    name="cycles",
    title="Limit cycles over one parameter",
    question="Which periodic motions exist, stable or unstable, where do they begin and end, and do they explain "
    "hysteresis and the smallest knocks?",
    paper="Section 3.5.4: vibration settles to a period of stick, slip and separation.",
    parameters={
        "d2": replace(RIG["d2"], default=np.array([1e-8, 1e-6])),
        "mu": Parameter(evenly(0.08, 0.125, 46), "1", SCENE["mu"].text, inner=True),
        "follow": Parameter("mu", "1", "parameter that is followed", following.FOLLOWED, common=True),
        "hold": Parameter(0.25, "s", "time of statistics at each value of the runs", common=True),
        "most": Parameter(60, "1", "most cycles of a branch to each side", common=True),
        "edges": Parameter(
            4, "1", "values at which knocks and the edge between two motions are sought", common=True
        ),
    }
    | RUN,
    outputs=cycles.BRANCHES, function=bifurcations, coords=cycles.coords, derive=following.derive,
    summary=summarise, figure=draw, check=check, chaotic=True,
)  # fmt: skip
