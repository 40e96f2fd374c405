"""The damping at which most of the paper's statements on motion hold, over (d1, d2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import checks
from studies import paper
from studies.answering.claims import PRINTED
from studies.declaring import labels
from studies.declaring.parameters import RIG, RUN, Parameter, published
from studies.motion import ensemble
from studies.physics import statements
from studies.physics.statements import QUANTITIES, SCENES, STATEMENTS, holding, identified, most
from studies.plotting import figures, planes
from studies.study import Study
from sweeps import DONE, Axis


def check(duration: Any, members: int, ramp: Any, **others: Any) -> None:
    """Refuse parameters with which no scene can be simulated."""
    checks.between("duration", np.min(duration), 0.1, 1e3, "s")
    ensemble.check(paper.SPEEDS, paper.LOAD, ramp, np.max(duration), 1e-3, members=members, **others)


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add the section of each statement."""
    sections = np.array([STATEMENTS[name][0] for name in dataset["statement"].values], dtype=object)
    return dataset.assign_coords(section=("statement", sections, {"long_name": "section of the paper"}))


def _named(damping: Any) -> str:
    return ", ".join(labels.named(name, float(damping[name]), RIG[name].units) for name in PRINTED)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """The number of statements that hold with the printed and with the best damping, motion and onsets."""
    dampings = {"printed": PRINTED, "identified": identified(dataset)}
    both = {name: dataset.sel(damping, method="nearest") for name, damping in dampings.items()}
    best, highest = most(dataset), labels.number(float(dataset["held"].max()))
    count = dataset.sizes["statement"]
    named = [
        f"{labels.number(float(each['held']))} of {count} statements on motion hold with {_named(each)}"
        for each in both.values()
    ]
    yield (
        f"{named[0]}, the printed damping; {named[1]}, the most with that d1. At no point do more than {highest}"
        f" hold, which do at {labels.counted(int(best.sum()), best.size)}."
    )
    table = {"statement": dataset["statement"].values, "section": dataset["section"].values}
    table |= {f"{name} %": 100.0 * each["truth"].values for name, each in both.items()}
    table["points %"] = 100.0 * holding(dataset).values
    text = "Statements: fraction of the realisations in which they hold, and of the points at which they do"
    yield text, pd.DataFrame(table).round(1)
    rows = [(float(each["d1"]), *np.sort(each["d2"][each.values].values)[[0, -1]]) for each in best if each.any()]
    yield "Where most statements hold", pd.DataFrame(rows, columns=["d1 1/s", "d2 from s", "to"])
    names = ["scene", "regime", *QUANTITIES[:5], QUANTITIES[6]]
    for each in both.values():
        yield f"Motion with {_named(each)}; middle of the realisations", labels.frame(each, names)
    pairs = product(both.items(), ("onset_mu", "onset_frequency"))
    yield "Onsets of flutter, Hz", pd.DataFrame({f"{name} {key}": each[key].values for (name, each), key in pairs})


# Small planes across, and the modal damping ratios at the paper's frequency that are drawn, %.
ACROSS, ACROSS_NARROW, RATIOS = 5, 3, (0.1, 0.2, 0.5, 1.0)
MARKS: dict[str, dict[str, Any]] = {
    "printed": {"marker": "D", "color": figures.RED, "markeredgecolor": "white", "markersize": 7.0},
    "identified": {"marker": "*", "color": "white", "markeredgecolor": "black", "markersize": 13.0},
}


def draw(dataset: xr.Dataset) -> figures.Figure:
    """Number of statements that hold over the plane, and the regions of those that depend on the damping."""
    dataset = dataset.where(dataset["status"] == DONE)
    names, share = dataset["statement"].values, holding(dataset)
    varies = [str(name) for name in names[(share > 0.0) & (share < 1.0)]]
    across = ACROSS if figures.is_wide() else ACROSS_NARROW
    cells = [*varies, *("." * (-len(varies) % across))]
    layout = [["held"] * across, *(cells[k : k + across] for k in range(0, len(cells), across))]
    figure, panels = figures.mosaic(layout, 8.0, *[4.4] * (len(layout) - 1), stack=False)
    top = panels.pop("held")
    _draw_held(top, dataset)
    figures.legend_below(figure, [top])
    same = (("everywhere", names[share == 1.0]), ("nowhere", names[share == 0.0]))
    text = "; ".join(f"{where}: {', '.join(each)}" for where, each in same if len(each)).replace(" degrees", "°")
    for k, (name, axes) in enumerate(panels.items()):
        axes.set_title(name.replace(" degrees", "°"), loc="left")
        mesh = planes.numbers(axes, dataset["truth"].sel(statement=name), "d1", "d2", vmin=0.0, vmax=1.0)
        _mark(axes, dataset, 0.6)
        axes.tick_params(labelleft=k % across == 0, labelbottom=k + across >= len(varies))
        axes.set(**{"xlabel": ""} if k + across < len(varies) else {}, **{"ylabel": ""} if k % across else {})
    if varies:
        bar = figure.colorbar(mesh, ax=[*panels.values()], location="bottom", aspect=60, pad=0.02)
        bar.set_label("fraction of the realisations in which the statement holds")
    figure.suptitle(f"Damping and the paper's statements on motion: {int(dataset['members'])} realisations")
    figure.supxlabel(f"statements that hold {text}" if text else "")
    return figure


def _draw_held(axes: figures.Axes, dataset: xr.Dataset) -> None:
    """Number of statements that hold, lines of equal modal damping, and points."""
    held = dataset["held"].astype(float)
    low, high = np.nan_to_num([held.min(), held.max()])
    mesh = planes.numbers(axes, held, "d1", "d2", vmin=low, vmax=max(high, low + 1.0))
    axes.set_title(f"statements that hold, of {dataset.sizes['statement']}", loc="left")
    axes.figure.colorbar(mesh, ax=axes, location="bottom", aspect=40, pad=0.02)
    omega = 2.0 * np.pi * paper.SIMULATED_LINE
    ratio = 100.0 * (0.5 * dataset["d1"] / omega + 0.5 * dataset["d2"] * omega).transpose("d2", "d1")
    _mark(axes, dataset, 1.0)
    if min(ratio.shape) > 1:
        lines = axes.contour(dataset["d1"], dataset["d2"], ratio, RATIOS, colors="white", linewidths=0.8)
        axes.clabel(lines, fmt="%g %%")
        axes.plot([], [], color=figures.GREY, linewidth=0.8, label="modal damping\nat 2.7 kHz")
    best = planes.places(most(dataset), "d1", "d2")
    planes.marks(axes, best, marker=".", color="black", label=f"most statements: {high:.0f}")


def _mark(axes: figures.Axes, dataset: xr.Dataset, size: float) -> None:
    """Mark the printed damping and the identified one."""
    for name, damping in {"printed": PRINTED, "identified": identified(dataset)}.items():
        look = MARKS[name] | {"markersize": size * MARKS[name]["markersize"], "zorder": 4.0}
        text = f"{name}, {_named(damping)}".replace(", ", ",\n")
        planes.marks(axes, [(damping["d1"], damping["d2"])], label=text, **look)


def _around(printed: float, ratio: float, below: int, count: int) -> list[float]:
    """Values of equal ratio, to four digits, with the printed one among them."""
    return [float(f"{printed * ratio**k:.4g}") for k in range(-below, count - below)]


STUDY = Study(
    name="damping",
    title="Damping: which of the paper's statements on motion hold over d1 and d2",
    question="Which Rayleigh damping gives the motion that the paper describes, with the published scheme's "
    "numerical damping?",
    paper="Table 3: d1 = 50 1/s and d2 = 1e-8 s; Section 3.4.2: damping has a weak influence on stability. What "
    "Sections 2, 3.5.3, 3.5.4 and 3.6 say of the motion are the statements.",
    parameters={
        "d1": replace(RIG["d1"], default=np.array(_around(PRINTED["d1"], 2.0 ** (1.0 / 3.0), 5, 14))),
        "d2": replace(RIG["d2"], default=np.array(_around(PRINTED["d2"], 10.0**0.1, 1, 18))),
        "duration": Parameter(2.0, "s", "simulated time", common=True),
        **ensemble.members(5),
        **published(RUN),
    },
    outputs=statements.OUTPUTS, function=statements.statements,
    coords={
        "statement": Axis(list(STATEMENTS), long_name="statement of the paper"),
        "scene": Axis(list(SCENES), long_name="scene of the statements"),
        "onset": Axis(np.arange(1, len(paper.ONSETS) + 1), "1", "onset, ascending in mu"),
    },
    check=check, derive=derive, summary=summarise, figure=draw, chaotic=True, beams=True,
)  # fmt: skip
