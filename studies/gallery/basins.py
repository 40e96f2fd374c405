"""The motion to which each start leads, and the fraction of random starts that lead to each motion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from studies import paper
from studies.answering.results import rig_of
from studies.declaring import labels
from studies.declaring.spec import evenly
from studies.motion import knock, starts
from studies.motion.regimes import VIBRATING
from studies.motion.run import REGIMES
from studies.motion.stability import first_onsets
from studies.motion.starts import COORDINATES
from studies.physics import shares
from studies.plotting import figures, general, planes
from studies.study import Parameter, Study

# Values of a parameter with a plane each.
PANELS = 4


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The range of the fraction of starts that vibrate, and the fractions along the longest parameter."""
    share, (x, *others) = dataset["vibration_share"], _axes(dataset)
    if not bool(share.notnull().any()):
        yield "No point has a value."
        return
    both = int(((share > 0.0) & (share < 1.0)).sum())
    low, high = 100.0 * float(share.min()), 100.0 * float(share.max())
    if low == high and high in (0.0, 100.0):
        yield f"{'Every' if low else 'No'} start leads to vibration."
    else:
        yield (
            f"{low:.3g} to {high:.3g} % of the starts lead to vibration; at {labels.counted(both, share.size)} the"
            " start decides."
        )
    at = dataset.isel({name: 0 for name in others})
    needed = 1e3 * at["knock_threshold"].dropna(x)
    if needed.size:
        ends = " to ".join(labels.number(float(end)) for end in (needed.max(), needed.min()))
        where = " to ".join(labels.number(float(labels.readable(needed[x])[k])) for k in (0, -1))
        where = f"{labels.title(x)} from {where} {labels.unit_of(at[x])[0]}".strip()
        yield f"Steady sliding is stable at {where}, yet a knock of {ends} mN s on P1 starts vibration there."
    table = labels.frame(at, [x, "draws"]).rename(columns={"draws": "starts"})
    columns = {kind: at["share"].sel(kind=kind) for kind in _occurring(at)}
    columns |= {"least knock mN s": 1e3 * at["knock_threshold"]}
    columns |= {"vibration, from": at["vibration_share_low"], "to": at["vibration_share_high"]}
    caption = "Fraction of starts that lead to each motion, with the 95 % interval of vibration"
    yield caption, table.assign(**{name: column.values for name, column in columns.items()})


def _axes(dataset: xr.Dataset) -> list[str]:
    """The parameters along which points lie, the longest first."""
    return sorted(map(str, dataset["status"].dims), key=lambda name: -dataset.sizes[name])


def _occurring(dataset: xr.Dataset) -> list[str]:
    """The motions to which at least one start leads."""
    others = [dim for dim in dataset["share"].dims if dim != "kind"]
    return [str(kind) for kind in dataset["kind"].values[(dataset["share"] > 0.0).any(others).values]]


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Fractions of starts along the longest parameter; below, the starts coloured by their motion.

    Starts along one coordinate are drawn over the parameter, those on a plane for up to four of its values.
    """
    x, *others = _axes(dataset)
    if dataset.sizes[others[0]] > 1 or not bool(dataset["vibration_share"].notnull().any()):
        return general.draw(dataset[["vibration_share", "status"]])
    at = dataset.isel({name: 0 for name in others})
    moved = [name for name in COORDINATES if np.ptp(np.atleast_1d(dataset[name].values)) > 0.0][:2]
    chosen = planes.subset(at.sizes[x], PANELS) if len(moved) == 2 else []
    below = [f"plane {k}" for k in chosen] or ["starts"] * bool(moved)
    rows = [["share"], *(below[k : k + 2] for k in range(0, len(below), 2))]
    figure, panels = figures.mosaic([row * (max(map(len, rows)) // len(row)) for row in rows], *[6.5] * len(rows))
    _draw_shares(panels["share"], at, x)
    titles = ["fraction of starts that lead to each motion"]
    if len(moved) == 1:
        titles += ["motion that each start leads to"]
        _draw_starts(panels["starts"], at[x].broadcast_like(at["label"]), at[f"start_{moved[0]}"], at["label"])
        planes.set_side(panels["starts"], "x", at[x])
    for k in chosen:
        axes, one = panels[f"plane {k}"], at.isel({x: k})
        titles += [labels.named(x, one[x])]
        grid = [dataset.sizes[name] for name in moved]
        if str(dataset["starts_are"].values) == "plane" and np.prod(grid) == one.sizes["draw"]:
            codes = one["label"].values.astype(float).reshape(grid)
            plane = xr.DataArray(codes, coords={name: dataset[name] for name in moved}, dims=moved)
            planes.classes(axes, plane.where(plane >= 0, planes.FAILED), *moved)
        else:
            _draw_starts(axes, one[f"start_{moved[0]}"], one[f"start_{moved[1]}"], one["label"])
            axes.set_xlabel(labels.label(dataset[moved[0]]))
    for name in below:
        panels[name].set_ylabel(labels.label(dataset[moved[-1]]))
    figures.entitle(panels.values(), titles)
    if x == "mu" and np.isfinite(onset := first_onsets(dataset, rig_of(dataset))[1].ravel()[0]):
        panels["share"].axvline(onset, color="black", linestyle="--", label="onset of flutter")
    figures.legend_below(figure, [panels["share"]], 4)
    about = "steady sliding" if str(dataset["about"].values) == "sliding" else "rest"
    figure.suptitle(f"Starts about {about} by their motion")
    return figure


def _draw_shares(axes: figures.Axes, at: xr.Dataset, x: str) -> None:
    """Stacked fractions over the cell of each value, and the interval of the fraction of vibration."""
    # Vibrations lie below, so that their share has one axis with its interval.
    names = sorted(_occurring(at), key=lambda name: (name not in VIBRATING, name))
    parts = {name: at["share"].sel(kind=name).values for name in names}
    planes.stack(axes, planes.set_side(axes, "x", at[x]), parts, [planes.COLOURS[REGIMES.index(n)] for n in names])
    share, *ends = (at[f"vibration_share{end}"].values for end in ("", "_low", "_high"))
    share = np.where(np.isfinite(ends[0]), share, np.nan)
    figures.curve(axes, labels.readable(at[x]).values, share, ends=ends, color="black", linestyle="none")
    axes.set(ylim=(0.0, 1.0), ylabel="fraction of starts")


def _draw_starts(axes: figures.Axes, across: xr.DataArray, up: xr.DataArray, codes: xr.DataArray) -> None:
    """Starts as points in the colours of their motions."""
    places, found = (labels.readable(across).values, labels.readable(up).values), codes.values.astype(float)
    for code in np.unique(found[found >= 0.0]).astype(int):
        look: dict[str, Any] = {"color": planes.COLOURS[code], "markeredgecolor": "black", "markeredgewidth": 0.2}
        axes.plot(*(each[found == code] for each in places), planes.MARKERS[code], markersize=4.0, **look)


LIMITS = {name: Parameter(np.array([0.0]), units, f"start: {text}; a range, or one value", inner=True)
          for name, (units, text) in COORDINATES.items()}  # fmt: skip
STUDY = Study(
    name="basins",
    title="Basins: the motion that each start leads to",
    question="Which fraction of starts leads to steady sliding, and which to vibration, where both are stable?",
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
    | knock.PARAMETERS,
    outputs=shares.OUTPUTS, function=shares.motions, coords=shares.coords, check=shares.check,
    summary=summarise, figure=draw, chaotic=True,
)  # fmt: skip
