"""Which motion each start leads to, and the share of each motion among random starts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from fivcore import Scene, State, checks, equilibrium
from studies import paper
from studies.answering.results import rig_of
from studies.declaring import labels
from studies.declaring.spec import evenly
from studies.motion import knock as knocks
from studies.motion import regimes, starts
from studies.motion.jobs import each_scene
from studies.motion.run import REGIMES
from studies.motion.stability import first_onsets
from studies.motion.starts import COORDINATES
from studies.motion.uncertainty import wilson
from studies.plotting import figures, general, planes
from studies.study import Parameter, Study
from sweeps import Axis, Variable, unit_draws

# Draws between two looks at the shares; where a point has no more draws; values of a parameter with a plane each.
BATCH, NONE, PANELS = 16, -1, 4
VIBRATION = "share of starts that lead to vibration"
OUTPUTS = {
    "label": Variable("1", "motion that a start leads to", ("draw",), "int8",
                      flags={NONE: "not drawn"} | dict(enumerate(REGIMES))),
    **{f"start_{name}": (units, f"start: {text}", "draw") for name, (units, text) in COORDINATES.items()},
    "draws": Variable("1", "number of starts", (), "int32"),
    "share": ("1", "share of starts that lead to a motion", "kind"),
    "share_low": ("1", "lower end of its 95 % interval (Wilson)", "kind"),
    "share_high": ("1", "upper end of its 95 % interval (Wilson)", "kind"),
    **{name: replace(variable, scale="") for name, variable in knocks.OUTPUTS.items()},
    "vibration_share": ("1", VIBRATION),
    "vibration_share_low": ("1", "lower end of its 95 % interval (Wilson)"),
    "vibration_share_high": ("1", "upper end of its 95 % interval (Wilson)"),
}  # fmt: skip


def box(starts_are: str, most: int, seed: int, values: dict[str, Any]) -> NDArray[np.float64]:
    """The starts, (draws, coordinates), from the values of each coordinate.

    A plane has all their combinations, the last varying fastest; draws are uniform between the least and the
    greatest, each time the same.
    """
    if starts_are == "plane":
        return np.stack([each.ravel() for each in np.meshgrid(*values.values(), indexing="ij")], axis=1)
    low, high = (np.array([end(each) for each in values.values()]) for end in (np.min, np.max))
    drawn, unit = np.tile(low, (most, 1)), np.flatnonzero(high > low)
    if len(unit):
        drawn[:, unit] += (high - low)[unit] * unit_draws(len(unit), most, "sobol", seed)
    return np.asarray(drawn)


def motions(
    scenes: Sequence[Scene], about: str, starts_are: str, most: int, width: float, seed: int,
    mode: int, second_mode: int, largest_knock: float, resolution: float, **options: Any,
) -> dict[str, Any]:  # fmt: skip
    """Label of each start, and shares, for each scene."""
    places = box(starts_are, most, seed, {name: options.pop(name) for name in COORDINATES})
    moved = [name for name, column in zip(COORDINATES, places.T, strict=True) if column.any()]
    random = starts_are == "draws"

    def point(scene: Scene) -> dict[str, Any]:
        rest = equilibrium(scene, about)
        made = starts.directions(scene, moved, mode, second_mode)
        found, few = np.full(len(places), NONE, dtype=np.int8), np.zeros((2, len(REGIMES)))
        for first in range(0, len(places), BATCH):
            chosen = places[first : first + BATCH][:, [name in moved for name in COORDINATES]]
            states = [State.of(scene, rest + q, v) for q, v in np.einsum("ki,ijm->kjm", chosen, made)]
            found[first : first + BATCH] = starts.labels_of(scene, states, options)
            count = min(first + BATCH, len(places))
            shares = np.bincount(found[:count], minlength=len(REGIMES)) / count
            few = np.stack(wilson(shares, count))
            if random and np.all(few[1] - few[0] <= width):
                break
        vibrates = regimes.is_of(found[:count], *regimes.VIBRATING).mean()
        # A plane is no sample.
        ends, own = (few, wilson(vibrates, count)) if random else (np.nan * few, (np.nan, np.nan))
        drawn = np.where((found > NONE)[:, None], places, np.nan)
        return {
            "label": found,
            **{f"start_{name}": column for name, column in zip(COORDINATES, drawn.T, strict=True)},
            "draws": count,
            **{"share": shares, "share_low": ends[0], "share_high": ends[1]},
            **knocks.threshold(scene, largest_knock, resolution, options),
            **{"vibration_share": vibrates, "vibration_share_low": own[0], "vibration_share_high": own[1]},
        }

    return each_scene(scenes, point)


def coords(
    starts_are: str, most: int, displacement: Any, velocity: Any, second_displacement: Any, second_velocity: Any,
    velocity_C: Any, knock: Any,
) -> dict[str, Axis]:  # fmt: skip
    """The starts from 1 on, and the motions."""
    values = (displacement, velocity, second_displacement, second_velocity, velocity_C, knock)
    count = int(np.prod([len(each) for each in values])) if starts_are == "plane" else most
    checks.count("most" if starts_are == "draws" else "starts of the plane", count, 1_000_000)
    return {
        "draw": Axis(np.arange(1, count + 1), "1", "number of the start"),
        "kind": Axis(np.array(REGIMES), long_name="regime"),
    }


def check(width: Any, **others: Any) -> None:
    """Refuse what cannot be computed."""
    checks.between("width", width, 1e-3, 1.0, "1")
    knocks.check(**{name: others[name] for name in ("V", "F", *knocks.PARAMETERS)})


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The range of the share of vibration, and the shares along the longest parameter."""
    share, (x, *others) = dataset["vibration_share"], _axes(dataset)
    if not bool(share.notnull().any()):
        yield "No point has a value."
        return
    both = int(((share > 0.0) & (share < 1.0)).sum())
    yield (
        f"Of the starts, {100.0 * float(share.min()):.3g} to {100.0 * float(share.max()):.3g} % lead to vibration;"
        f" at {both} of {share.size} points some do and others do not."
    )
    at = dataset.isel({name: 0 for name in others})
    needed = 1e3 * at["knock_threshold"].dropna(x)
    if needed.size:
        ends = " to ".join(labels.number(float(end)) for end in (needed.max(), needed.min()))
        where = " to ".join(labels.number(float(labels.readable(needed[x])[k])) for k in (0, -1))
        where = f"{labels.title(x)} from {where} {labels.unit_of(at[x])[0]}".strip()
        yield f"Steady sliding is stable at {where}, yet a knock of {ends} mN s on P1 starts vibration there."
    columns = {f"{labels.SYMBOLS.get(x, x)} {labels.unit_of(at[x])[0]}".strip(): labels.readable(at[x]).values}
    columns |= {"starts": at["draws"].values}
    columns |= {str(kind): at["share"].sel(kind=kind).values for kind in _occurring(at)}
    columns |= {"least knock mN s": 1e3 * at["knock_threshold"].values}
    columns |= {"vibration, from": at["vibration_share_low"].values, "to": at["vibration_share_high"].values}
    yield "Share of each motion, and the 95 % interval of that of vibration", pd.DataFrame(columns)


def _axes(dataset: xr.Dataset) -> list[str]:
    """The parameters along which points lie, the longest first."""
    return sorted(map(str, dataset["status"].dims), key=lambda name: -dataset.sizes[name])


def _occurring(dataset: xr.Dataset) -> list[str]:
    """The motions that some start leads to."""
    others = [dim for dim in dataset["share"].dims if dim != "kind"]
    return [str(kind) for kind in dataset["kind"].values[(dataset["share"] > 0.0).any(others).values]]


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Shares along the longest parameter; below, the starts by their motion.

    Starts along one coordinate stand over the parameter, those in a plane in panels for up to four values of it.
    """
    x, *others = _axes(dataset)
    if dataset.sizes[others[0]] > 1 or not bool(dataset["vibration_share"].notnull().any()):
        return general.draw(dataset[["vibration_share", "status"]])
    at = dataset.isel({name: 0 for name in others})
    moved = [name for name in COORDINATES if np.ptp(np.atleast_1d(dataset[name].values)) > 0.0][:2]
    chosen = planes.subset(at.sizes[x], PANELS) if len(moved) == 2 else []
    below = [f"plane {k}" for k in chosen] or ["starts"] * bool(moved)
    rows = [below[k : k + 2] for k in range(0, len(below), 2)]
    rows = [row * (2 // len(row)) for row in [["share"], *rows]]
    figure, panels = figures.mosaic(rows, 16.0, 8.0 + 7.0 * (len(rows) - 1))
    _draw_shares(panels["share"], at, x)
    titles = ["share of the starts that lead to each motion"]
    if len(moved) == 1:
        titles += ["motion that each start leads to"]
        planes.set_side(panels["starts"], "x", at[x])
        across = labels.readable(at[x]).broadcast_like(at["label"]).values
        _draw_starts(panels["starts"], across, at[f"start_{moved[0]}"], at["label"])
    for k in chosen:
        axes, one = panels[f"plane {k}"], at.isel({x: k})
        titles += [labels.named(x, one[x])]
        sides = [one[f"start_{name}"] for name in moved]
        grid = [dataset.sizes[name] for name in moved]
        if str(dataset["starts_are"].values) == "plane" and np.prod(grid) == one.sizes["draw"]:
            codes = one["label"].values.astype(float).reshape(grid)
            plane = xr.DataArray(codes, coords={name: dataset[name] for name in moved}, dims=moved)
            planes.classes(axes, plane.where(plane >= 0, planes.FAILED), *moved)
        else:
            _draw_starts(axes, labels.readable(sides[0]).values, sides[1], one["label"])
            axes.set_xlabel(labels.label(dataset[moved[0]]))
        axes.set_ylabel(labels.label(dataset[moved[1]]))
    if moved and not chosen:
        panels["starts"].set_ylabel(labels.label(dataset[moved[0]]))
    figures.letter(panels.values(), titles)
    handles: list[Any] = planes.patches([REGIMES.index(name) for name in _occurring(at)])
    if x == "mu" and np.isfinite(onset := first_onsets(dataset, rig_of(dataset))[1].ravel()[0]):
        handles += [panels["share"].axvline(onset, color="black", linestyle="--", label="onset of flutter")]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    fixed = [labels.named(name, dataset[name].values.ravel()[0], str(dataset[name].attrs.get("units", "1")))
             for name in ("V", "theta", "mu", "F") if name != x and name in dataset.coords]  # fmt: skip
    about = "steady sliding" if str(dataset["about"].values) == "sliding" else "rest"
    figure.suptitle(figures.fitted(f"Starts about {about} by their motion: {', '.join(fixed)}", 16.0))
    return figure


def _draw_shares(axes: Any, at: xr.Dataset, x: str) -> None:
    """Shares as a stacked area, each value over its cell, and the interval of the share of vibration."""
    sides = np.repeat(planes.set_side(axes, "x", at[x]), 2)[1:-1]
    names = _occurring(at)
    # Vibrations lie below, so that their share has one axis with its interval.
    names = sorted(names, key=lambda name: (name not in regimes.VIBRATING, name))
    shares = [np.repeat(np.nan_to_num(at["share"].sel(kind=name).values), 2) for name in names]
    axes.stackplot(sides, *shares, colors=[planes.COLOURS[REGIMES.index(name)] for name in names])
    share, low, high = (at[f"vibration_share{end}"].values for end in ("", "_low", "_high"))
    known = np.isfinite(low)
    ends = np.stack([share - low, high - share])[:, known]
    look = {"color": "black", "linestyle": "none", "capsize": 2.0, "linewidth": 0.8}
    axes.errorbar(labels.readable(at[x]).values[known], share[known], ends, **look)
    axes.set(ylim=(0.0, 1.0), ylabel="share")


def _draw_starts(axes: Any, across: Any, up: xr.DataArray, codes: xr.DataArray) -> None:
    """Starts as points in the colours of their motions."""
    heights, words = labels.readable(up).values, codes.values.astype(float)
    for code in np.unique(words[words >= 0.0]).astype(int):
        here = words == code
        axes.plot(across[here], heights[here], planes.MARKERS[code], color=planes.COLOURS[code], markersize=4.0,
                  markeredgecolor="black", markeredgewidth=0.2)  # fmt: skip


LIMITS = {name: Parameter(np.array([0.0]), units, f"start: {text}; a range, or one value", inner=True)
          for name, (units, text) in COORDINATES.items()}  # fmt: skip
STUDY = Study(
    name="basins",
    title="Basins: the motion that each start leads to",
    question="Which share of starts leads to steady sliding, and which to a vibration, where the rig has both?",
    paper="Each scene has one start; where vibration begins is judged by the stability of steady sliding.",
    parameters={
        "V": Parameter(np.array([paper.SPEEDS[1]]), "m s-1", "speed of the drive"),
        "theta": Parameter(np.array([paper.THETA]), "degree", "inclination of P1"),
        "mu": Parameter(evenly(0.085, 0.115, 16), "1", "coefficient of friction"),
        "F": Parameter(np.array([paper.LOAD]), "N", "load on A"),
        "about": Parameter("sliding", "1", "what starts are relative to: steady sliding, or rest under the load",
                           starts.ABOUT, common=True),
        "starts_are": Parameter("draws", "1", "draws: random within the ranges; plane: all their combinations",
                                ("draws", "plane"), common=True),
    }
    | LIMITS
    | {
        "knock": Parameter(np.array([-6e-4, 6e-4]), "N s", LIMITS["knock"].text, inner=True),
        "mode": Parameter(0, "1", "number of the mode, ascending in frequency; 0: the least stable", common=True),
        "second_mode": Parameter(0, "1", "second mode, likewise", common=True),
        "most": Parameter(64, "1", "largest number of draws", common=True),
        "width": Parameter(0.2, "1", "width of the 95 % intervals of all shares at which draws end", common=True),
        "seed": Parameter(0, "1", "seed of the draws, which all points share", common=True),
    }
    | knocks.PARAMETERS,
    outputs=OUTPUTS, function=motions, coords=coords, check=check, summary=summarise, figure=draw, chaotic=True,
)  # fmt: skip
