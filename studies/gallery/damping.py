"""The damping that gives the paper's motion: which of the paper's statements hold over (d1, d2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fivcore import Rig, Scene, Transient, checks, flutter_onsets
from studies import paper
from studies.answering.claims import PRINTED
from studies.declaring import labels
from studies.declaring.parameters import RIG, RUN, SCENE, Parameter, published
from studies.motion import ensemble, regimes, run
from studies.motion.jobs import Job, outcomes
from studies.plotting import figures, planes
from studies.study import Study
from sweeps import DONE, Axis, Variable

Motions = Mapping[str, Mapping[str, Any]]
Rule = Callable[[Motions], Any]
# Each scene by what differs from the paper's reference case, 2 mm/s. The paper says "lower" of friction and load,
# "greater than 12 degrees" and "negative angles".
STEADY = {"15 degrees": 15.0, "12.5 degrees": 12.5, "-5 degrees": -5.0}
SCENES: dict[str, dict[str, float]] = {
    **{f"{1e3 * V:g} mm/s": {"V": V} for V in paper.SPEEDS},
    "less friction": {"mu": 0.75 * paper.MU},
    "less load": {"F": 0.5 * paper.LOAD},
    **{name: {"theta": theta} for name, theta in {"10 degrees": 10.0, **STEADY}.items()},
}
PEAKS = ("normal_force", "slip_speed")
# How near a frequency and a ratio of sticks must be to the paper's, relatively.
NEAR_LINE, NEAR_RATIO = 0.05, 0.25
# Onsets are those of the paper's range of mu.
MU_MAX = 0.5


def _is(scene: str, *kinds: str) -> Rule:
    return lambda of: regimes.is_of(of[scene]["regime"], *kinds)


def _near(scene: str, other: str, name: str, value: float, within: float) -> Rule:
    """A quantity of a scene, over that of another if one is named, lies within a share of a value."""

    def rule(of: Motions) -> Any:
        found = of[scene][name] / (of[other][name] if other else 1.0)
        sticks = not other or _is(scene, "intermittent")(of) & _is(other, "intermittent")(of)
        return sticks & (np.abs(found - value) <= within * value)

    return rule


def _reaches(scene: str, name: str, value: float) -> Rule:
    """A run reaches a value, but exceeds it for less than a thousandth of the time."""
    return lambda of: (of[scene][f"{name}_999"] <= value) & (value <= of[scene][f"max_{name}"])


def _shorter(scene: str) -> Rule:
    """A scene vibrates, and the lasting sticks of 2 mm/s are shorter in it, or there are none."""

    def rule(of: Motions) -> Any:
        shorter = of[scene]["mean_stick_time"] < of["2 mm/s"]["mean_stick_time"]
        without = _is(scene, *regimes.WITHOUT_STICKS)(of)
        return _is("2 mm/s", "intermittent")(of) & (without | (_is(scene, "intermittent")(of) & shorter))

    return rule


# Section and rule of each statement; the rule says of each realisation whether the statement holds.
STATEMENTS: dict[str, tuple[str, Rule]] = {
    "intermittent at 1 mm/s": ("2, 3.5.3", _is("1 mm/s", "intermittent")),
    "intermittent at 2 mm/s": ("2, 3.5.3", _is("2 mm/s", "intermittent")),
    "no long sticks at 5 mm/s": ("2, 3.5.4.2", _is("5 mm/s", *regimes.WITHOUT_STICKS)),
    # Half the load moves as twice the speed.
    "intermittent at 4 mm/s": ("3.5.4.2", _is("less load", "intermittent")),
    "less friction, shorter sticks": ("3.5.4.2", _shorter("less friction")),
    "less load, shorter sticks": ("3.5.4.2", _shorter("less load")),
    "sticks at 2 mm/s half of 1 mm/s": (
        "3.5.4.2", _near("2 mm/s", "1 mm/s", "mean_stick_time", paper.STICK_RATIO, NEAR_RATIO),
    ),
    "no long sticks at 10 degrees": ("3.6", _is("10 degrees", *regimes.WITHOUT_STICKS)),
    **{f"steady at {name}": ("3.6", _is(name, regimes.STEADY)) for name in STEADY},
    **{
        f"{paper.SIMULATED_LINE:g} Hz at {scene}": (
            section, _near(scene, "", "dominant_frequency", paper.SIMULATED_LINE, NEAR_LINE),
        )
        for scene, section in {**dict.fromkeys([*SCENES][:3], "3.5.3"), "10 degrees": "3.6"}.items()
    },
    **{
        text: (section, _reaches(scene, name, value))
        for scene, section, (force, speed) in (
            ("2 mm/s", "3.5.4.2", paper.CONTACT_PEAKS[2e-3]), ("5 mm/s", "3.5.4.1", paper.CONTACT_PEAKS[5e-3]),
        )
        for text, name, value in (
            (f"{force:g} N at {scene}", PEAKS[0], force),
            (f"slip {1e3 * speed:g} mm/s at {scene}", PEAKS[1], speed),
        )
    },
}  # fmt: skip
QUANTITIES = ("stick_fraction", "mean_stick_time", "dominant_frequency", "periodicity", "normal_force_999",
              "max_normal_force", "slip_speed_999", "max_slip_speed")  # fmt: skip
OUTPUTS = {
    "truth": Variable("1", "share of the realisations in which a statement holds", ("statement",), "float32", 6),
    "held": Variable("1", "statements that hold in more than half of the realisations", (), "int16"),
    "regime": replace(run.SUMMARY["regime"], long_name="regime of most realisations", dims=("scene",)),
    **{
        name: replace(run.SUMMARY[name], long_name=f"{run.SUMMARY[name].long_name}, middle of the realisations",
                      dims=("scene",), dtype="float32", digits=4)
        for name in QUANTITIES
    },
    "onset_mu": Variable("1", "onset mu of flutter", ("onset",), digits=8),
    "onset_frequency": Variable("Hz", "frequency at the onset of flutter", ("onset",), digits=8),
}  # fmt: skip


def statements(rig: Rig, duration: float, members: int, **options: Any) -> dict[str, Any]:
    """Which statements hold for a rig, what its scenes are like, and its onsets."""
    ramps = [options["ramp"] * (1.0 + ensemble.STRETCH * k) for k in range(members)]
    point = {name: parameter.default for name, parameter in SCENE.items()}
    jobs = [
        run.job(Scene(**point | scene, rig=rig), duration, options | {"ramp": ramp})
        for scene in SCENES.values()
        for ramp in ramps
    ]

    def values(_: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        own = [ensemble.summaries(runs[k * members : (k + 1) * members]) for k in range(len(SCENES))]
        motions = dict(zip(SCENES, own, strict=True))
        truth = np.array([np.mean(holds(motions)) for _, holds in STATEMENTS.values()])
        onsets = flutter_onsets(rig, paper.THETA, run.BAND, MU_MAX)
        return {
            "truth": truth,
            "held": np.count_nonzero(truth > 0.5),
            "regime": [ensemble.majority(each["regime"])[0] for each in own],
            **{name: [ensemble.middle(each[name]) for each in own] for name in QUANTITIES},
            "onset_mu": onsets.mu[: len(paper.ONSETS)],
            "onset_frequency": onsets.frequency[: len(paper.ONSETS)],
        }

    return outcomes([jobs], values)


def check(duration: Any, members: int, ramp: Any, **others: Any) -> None:
    """Refuse what cannot be run."""
    checks.between("duration", np.min(duration), 0.1, 1e3, "s")
    ensemble.check(paper.SPEEDS, paper.LOAD, ramp, np.max(duration), 1e-3, members=members, **others)


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add the section of each statement."""
    sections = np.array([STATEMENTS[name][0] for name in dataset["statement"].values], dtype=object)
    return dataset.assign_coords(section=("statement", sections, {"long_name": "section of the paper"}))


def most(dataset: xr.Dataset) -> xr.DataArray:
    """Points at which as many statements hold as anywhere."""
    held: xr.DataArray = dataset["held"].where(dataset["status"] == DONE)
    return held == held.max()


def holding(dataset: xr.Dataset) -> xr.DataArray:
    """Share of the points at which each statement holds."""
    share: xr.DataArray = (dataset["truth"] > 0.5).where(dataset["status"] == DONE).mean(["d1", "d2"])
    return share


def identified(dataset: xr.Dataset) -> dict[str, float]:
    """The damping by one rule: d1 as printed; of d2, where most statements hold there.

    Where that are several d2, the one at which the statements hold in most realisations; then the smallest.
    """
    column = dataset.sel(d1=PRINTED["d1"], method="nearest").transpose("d2", ...)
    held = column["held"] + column["truth"].sum("statement") / (1.0 + column.sizes["statement"])
    place = np.argmax(held.where(column["status"] == DONE).fillna(-1.0).values)
    return {"d1": float(column["d1"]), "d2": float(column["d2"][place])}


def _named(damping: Any) -> str:
    return ", ".join(labels.named(name, float(damping[name]), RIG[name].units) for name in PRINTED)


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """How many statements hold with the printed damping and at most; the motion and the onsets there."""
    dampings = {"printed": PRINTED, "identified": identified(dataset)}
    both = {name: dataset.sel(damping, method="nearest") for name, damping in dampings.items()}
    best, highest = most(dataset), labels.number(float(dataset["held"].max()))
    count = dataset.sizes["statement"]
    named = [f"{labels.number(float(each['held']))} of {count} hold with {_named(each)}" for each in both.values()]
    yield (
        f"Of the paper's statements on motion {named[0]}, the printed damping. {named[1].capitalize()}, the most "
        f"with that d1; nowhere do more than {highest}, which do at {int(best.sum())} of {best.size} points."
    )
    table = {"statement": dataset["statement"].values, "section": dataset["section"].values}
    table |= {f"{name} %": 100.0 * each["truth"].values for name, each in both.items()}
    table["points %"] = 100.0 * holding(dataset).values
    text = "Statements: share of the realisations in which they hold, and of the points at which they do"
    yield text, pd.DataFrame(table).round(1)
    rows = [(float(each["d1"]), *np.sort(each["d2"][each.values].values)[[0, -1]]) for each in best if each.any()]
    yield "Where most statements hold", pd.DataFrame(rows, columns=["d1 1/s", "d2 from s", "to"])
    names = ["scene", "regime", *QUANTITIES[:5], QUANTITIES[6]]
    for each in both.values():
        yield f"Motion with {_named(each)}; middle of the realisations", labels.frame(each, names)
    pairs = product(both.items(), ("onset_mu", "onset_frequency"))
    yield "Onsets of flutter, Hz", pd.DataFrame({f"{name} {key}": each[key].values for (name, each), key in pairs})


# Small planes across, and the modal damping ratios at the paper's frequency that are drawn, %.
ACROSS, RATIOS = 5, (0.1, 0.2, 0.5, 1.0)
MARKS: dict[str, dict[str, Any]] = {
    "printed": {"marker": "D", "color": figures.RED, "markeredgecolor": "white", "markersize": 7.0},
    "identified": {"marker": "*", "color": "white", "markeredgecolor": "black", "markersize": 13.0},
}


def draw(dataset: xr.Dataset) -> figures.Figure:
    """How many statements hold over the plane, and where each of those holds that depend on the damping."""
    dataset = dataset.where(dataset["status"] == DONE)
    names, share = dataset["statement"].values, holding(dataset)
    varies = [str(name) for name in names[(share > 0.0) & (share < 1.0)]]
    cells = [*varies, *("." * (-len(varies) % ACROSS))]
    layout = [["held"] * (ACROSS - 1) + ["key"], *(cells[k : k + ACROSS] for k in range(0, len(cells), ACROSS))]
    rows = len(layout) - 1
    figure, panels = figures.mosaic(layout, 18.0, 12.0 + 4.0 * rows, height_ratios=[8.5] + [4.0] * rows)
    top, key = panels.pop("held"), panels.pop("key")
    key.axis("off")
    key.legend(handles=_draw_held(top, dataset), loc="upper left", borderaxespad=0.0, borderpad=0.0)
    same = (("everywhere", names[share == 1.0]), ("nowhere", names[share == 0.0]))
    text = "; ".join(f"{where}: {', '.join(each)}" for where, each in same if len(each))
    figure.supxlabel(fill(f"Statements that hold {text}." if text else "", 115), fontsize=7.5)
    for k, (name, axes) in enumerate(panels.items()):
        mesh = planes.cells(axes, dataset["truth"].sel(statement=name), "d1", "d2", vmin=0.0, vmax=1.0)
        axes.set_title(fill(f"({chr(ord('b') + k)}) {name}", 19), loc="left", fontsize=7.0)
        _mark(axes, dataset, 0.6)
        axes.tick_params(labelsize=6.5, labelleft=k % ACROSS == 0, labelbottom=k + ACROSS >= len(varies))
        axes.set(**{"xlabel": ""} if k + ACROSS < len(varies) else {}, **{"ylabel": ""} if k % ACROSS else {})
    if varies:
        bar = figure.colorbar(mesh, ax=[*panels.values()], location="bottom", aspect=60, pad=0.02)
        bar.set_label("share of the realisations in which the statement holds")
    about = f"{int(dataset['members'])} realisations, {regimes.damping_text(dataset)}"
    figure.suptitle(figures.fitted(f"Damping and the paper's statements on motion: {about}", 17.0))
    return figure


def _draw_held(axes: figures.Axes, dataset: xr.Dataset) -> list[Any]:
    """Number of statements that hold, lines of equal modal damping, and points; the handles of the legend."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.lines import Line2D

    held = dataset["held"].astype(float)
    low, high = np.nan_to_num([held.min(), held.max()])
    mesh: ScalarMappable = planes.cells(axes, held, "d1", "d2", vmin=low, vmax=max(high, low + 1.0))
    axes.set_title(f"(a) statements that hold, of {dataset.sizes['statement']}", loc="left", fontsize=9.0)
    axes.figure.colorbar(mesh, ax=axes, location="bottom", aspect=40, pad=0.02)
    omega = 2.0 * np.pi * paper.SIMULATED_LINE
    ratio = 100.0 * (0.5 * dataset["d1"] / omega + 0.5 * dataset["d2"] * omega).transpose("d2", "d1")
    handles: list[Any] = _mark(axes, dataset, 1.0)
    if min(ratio.shape) > 1:
        lines = axes.contour(dataset["d1"], dataset["d2"], ratio, RATIOS, colors="white", linewidths=0.8)
        axes.clabel(lines, fmt="%g %%", fontsize=7.5)
        handles.append(Line2D([], [], color=figures.GREY, linewidth=0.8, label="modal damping\nat 2.7 kHz"))
    d1, d2 = xr.broadcast(dataset["d1"], dataset["d2"])
    best = most(dataset).transpose(*d1.dims).values
    look: dict[str, Any] = {"marker": ".", "color": "black", "linestyle": "none", "label": f"most: {high:.0f}"}
    return handles + planes.marks(axes, zip(d1.values[best], d2.values[best], strict=True), **look)


def _mark(axes: figures.Axes, dataset: xr.Dataset, size: float) -> list[Any]:
    """Mark the printed damping and the identified one."""
    handles = []
    for name, damping in {"printed": PRINTED, "identified": identified(dataset)}.items():
        look = MARKS[name] | {"markersize": size * MARKS[name]["markersize"], "linestyle": "none", "zorder": 4.0}
        text = f"{name}, {_named(damping)}".replace(", ", ",\n")
        handles += planes.marks(axes, [(damping["d1"], damping["d2"])], label=text, **look)
    return handles


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
    outputs=OUTPUTS, function=statements,
    coords={
        "statement": Axis(list(STATEMENTS), long_name="statement of the paper"),
        "scene": Axis(list(SCENES), long_name="scene of the statements"),
        "onset": Axis(np.arange(1, len(paper.ONSETS) + 1), "1", "onset, ascending in mu"),
    },
    check=check, derive=derive, summary=summarise, figure=draw, chaotic=True, beams=True,
)  # fmt: skip
