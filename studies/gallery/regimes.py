"""The regime of the vibration at each speed and friction, by an ensemble, beside linear stability."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from fivcore import Scene, Transient, loading_time
from studies import paper
from studies.answering.claims import is_papers_rig
from studies.answering.results import rig_of
from studies.declaring import labels
from studies.declaring.spec import evenly, logarithmically
from studies.motion import ensemble, mixed, regimes, run
from studies.motion.jobs import Job, outcomes
from studies.motion.regimes import KINDS
from studies.motion.stability import first_onsets, linear_stability, with_flags
from studies.plotting import figures, planes
from studies.study import Claim, Parameter, Study
from sweeps import DONE, FAILED, Variable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# What linear stability answers for.
BELOW = f"below {run.BAND / 1e3:g} kHz"
# Linear prediction and motion, and how a reader has each.
VERDICTS = {
    "agree": "prediction correct",
    "subcritical": f"missed: vibrates though stable {BELOW} and above",
    "unstable above the band": f"missed: vibrates, stable {BELOW}, unstable above",
    "quiet though unstable": "false alarm: slides steadily though unstable",
    "no verdict": "not compared: undecided, stuck, or too short for modes that decay or grow slowly",
    "failed": "failed",
}
VERDICT = "motion against linear stability of steady sliding"
# Below this a regime whose realisations differ is called uncertain.
CERTAIN = 0.95
# A mode decides by growing or decaying so many times e-fold, between the size of a vibration and what counts as
# steady, before the last quarter of a run, where that is judged.
E_FOLDS, JUDGED = 10.0, 0.75
CLAIMS = tuple(Claim("regime", {"V": V}, kind, "2, 3.5.3", cells=True) for V, kind in paper.VIBRATION.items())


def _plain(units: str, text: str) -> Variable:
    return Variable(units, text, (), "float32", 6)


OUTPUTS = ensemble.outputs() | {
    "growth_rate": _plain("s-1", f"growth rate of steady sliding's least stable mode {BELOW}"),
    "growth_frequency": _plain("Hz", f"frequency of steady sliding's least stable mode {BELOW}"),
    "unstable_modes": Variable("1", f"number of unstable modes of steady sliding {BELOW}", (), "int16"),
    "model_growth_rate": _plain("s-1", "growth rate of the least stable mode of all that are simulated"),
    "model_growth_frequency": _plain("Hz", "frequency of the least stable mode of all that are simulated"),
    "duration": _plain("s", "simulated time, mean over realisations"),
    "loading_time": _plain("s", "static stick time: the drive loads a stuck contact until it slips"),
}


def motions(scenes: Sequence[Scene], members: int, **options: Any) -> dict[str, Any]:
    """Regime, statistics and linear stability of each scene."""

    def values(jobs: Sequence[Job], runs: Sequence[Transient]) -> dict[str, Any]:
        scene = jobs[0].scene
        duration = np.mean([motion.summary["simulated_time"] for motion in runs])
        stability = linear_stability(scene, options["cutoff"], options["numerical_damping"])
        times = {"duration": duration, "loading_time": loading_time(scene)}
        return ensemble.statistics(runs) | stability | times

    return outcomes([ensemble.ensemble(scene, members, options) for scene in scenes], values)


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """Add where steady sliding loses its stability, and how the motion of each point compares with that."""
    dims, *onset = first_onsets(dataset, rig_of(dataset))
    text = f"lowest mu at which steady sliding flutters (modes {BELOW}), up to the largest mu of the grid"
    empty = {"dtype": "int8", "_FillValue": np.int8(np.iinfo(np.int8).min)}
    codes = xr.Variable(dataset["regime"].dims, compare_linear(dataset), {"long_name": VERDICT}, empty)
    dataset = dataset.assign(
        onset_mu=(dims, onset[0], {"units": "1", "long_name": text}),
        onset_frequency=(dims, onset[1], {"units": "Hz", "long_name": f"frequency at the {text}"}),
        verdict=codes,
    )
    return with_flags(dataset, tuple(VERDICTS), "verdict")


def compare_linear(dataset: xr.Dataset) -> NDArray[np.float32]:
    """The index in VERDICTS of each point; NaN where it is pending. The first that holds counts.

    Motion and stability that differ are not compared where the run is too short for a mode that decays or grows so
    slowly, nor where the contact sticks, so that there is no steady sliding.
    """
    kinds = regimes.kinds(dataset)
    vibrates, steady = regimes.is_of(kinds, *regimes.VIBRATING), regimes.is_of(kinds, regimes.STEADY)
    below, model = (dataset[name].values for name in ("growth_rate", "model_growth_rate"))
    grows, above = below > 0.0, model > 0.0
    time = JUDGED * dataset["duration"].values - dataset["first_slip_time"].values
    decides = np.abs(np.where(grows, below, np.fmax(below, model))) * time >= E_FOLDS
    cases: dict[str, Any] = {
        "agree": (vibrates & grows) | (steady & ~grows),
        "unstable above the band": vibrates & above,
        "quiet though unstable": steady & decides,
        "subcritical": vibrates & decides,
        "failed": dataset["status"].values == FAILED,
        "no verdict": regimes.is_of(kinds, *run.REGIMES),
    }
    codes = [np.float32([*VERDICTS].index(name)) for name in cases]
    return np.asarray(np.select([*cases.values()], codes, np.float32(np.nan)), dtype=np.float32)


def uncertain(dataset: xr.Dataset) -> NDArray[np.bool_]:
    """Points whose realisations are in different regimes, too few in one to be sure of it."""
    differ = dataset["regime_share"].max("kind").values < 1.0
    return np.asarray(differ & (dataset["regime_certainty"].values < CERTAIN))


def summarise(dataset: xr.Dataset) -> Iterator[Any]:
    """Regimes, the linear prediction, and where each lies."""
    done, codes = int((dataset["status"] == DONE).sum()), dataset["verdict"].values
    compared = np.isin(codes, [0, 1, 2, 3])
    told = f"No scene can be compared with linear stability {BELOW}"
    if compared.any():
        share = labels.number(100.0 * np.mean(codes[compared] == 0))
        told = f"Linear stability {BELOW} predicts whether the rig vibrates at {share} % of {compared.sum()}"
        told += " compared scenes"
    yield f"{told}, {regimes.damping_text(dataset)}."
    kinds = regimes.kinds(dataset)
    table = dataset.assign(dominant_frequency=regimes.dominant_frequency(dataset))
    names = ["stick_fraction", "velocity_rms", "dominant_frequency", "normal_force_999"]
    rows = []
    for code in np.unique(kinds):
        inside = xr.DataArray(kinds == code, dims=dataset["regime"].dims)
        medians = [float(labels.readable(table[name]).where(inside).median()) for name in names]
        rows.append(
            (KINDS[code], int(inside.sum()), 100.0 * float(inside.mean()), *medians, _where(dataset, inside))
        )
    heads = [f"{name} {labels.unit_of(table[name])[0]}".strip() for name in names]
    yield "Scenes by regime, with medians", pd.DataFrame(rows, columns=["regime", "scenes", "%", *heads, "where"])
    cases = {text: codes == k for k, text in enumerate(VERDICTS.values())}
    if int(dataset["members"]) > 1:
        cases["uncertain: realisations differ"] = uncertain(dataset)
    found = [(text, int(chosen.sum()), _where(dataset, xr.DataArray(chosen, dims=dataset["regime"].dims)))
             for text, chosen in cases.items() if chosen.any()]  # fmt: skip
    yield (
        f"Motion against linear stability, {done} scenes",
        pd.DataFrame(found, columns=["verdict", "scenes", "where"]),
    )
    if np.isfinite(dataset["onset_mu"]).any():
        onsets = labels.frame(dataset, [*map(str, dataset["onset_mu"].dims), "onset_mu", "onset_frequency"])
        yield f"Lowest mu at which steady sliding flutters (modes {BELOW})", onsets


def _where(dataset: xr.Dataset, chosen: xr.DataArray) -> str:
    """The range of each varying parameter that the chosen points span."""
    ranges = []
    for name in (str(dim) for dim in chosen.dims if dataset.sizes[dim] > 1):
        values = labels.readable(dataset[name]).values[chosen.any([d for d in chosen.dims if d != name]).values]
        if len(values):
            ends = dict.fromkeys(map(labels.number, (values.min(), values.max())))
            ranges.append(f"{labels.title(name)} {' to '.join(ends)}")
    return ", ".join(ranges)


# Quantities drawn beside the regimes; dominant frequency and RMS are those of a vibration.
QUANTITIES = {"stick_fraction": False, "dominant_frequency": True, "velocity_rms": True}
ONSET: dict[str, Any] = {"color": "black", "linestyle": "--", "linewidth": 1.0}
MARKS: dict[str, dict[str, Any]] = {
    "subcritical": {"marker": "s", "color": figures.RED, "label": "missed: vibrates\nthough stable"},
    "unstable above the band": {"marker": "P", "color": "white", "label": f"stable {BELOW},\nunstable above"},
    "quiet though unstable": {
        "marker": "X",
        "color": figures.ORANGE,
        "label": "false alarm: steady\nthough unstable",
    },
}
PAPER_MARKS = {"intermittent": "^", "periodic": "D"}
# A scale leaves out this share of the cells at either end; it is logarithmic where its ends are so many times
# apart.
RARE, WIDE = 0.02, 10.0


def draw(dataset: xr.Dataset) -> Figure:
    """Regimes and the motion over two parameters, planes of regimes over more, or all along one."""
    x, y, others = arranged(dataset)
    single = [labels.named(name, dataset[name][0]) for name in (*others, x, y) if dataset.sizes[name] == 1]
    count = int(dataset["members"])
    about = ", ".join(
        [*single, f"{count} realisation{'s' * (count > 1)} of a scene", regimes.damping_text(dataset)]
    )
    if dataset.sizes[y] == 1:
        return _draw_along(dataset.isel({name: 0 for name in (y, *others)}), x, about)
    if any(dataset.sizes[name] > 1 for name in others):
        return planes.over_others(dataset, x, y, others, f"Regimes: {about}", _draw_regimes)
    return _draw_plane(dataset.isel(dict.fromkeys(others, 0)).transpose(y, x, ...), x, y, about)


def arranged(dataset: xr.Dataset) -> tuple[str, str, list[str]]:
    """The parameters across and up, and the others: V and mu, unless only another has several values."""
    order = ["V", "mu", *sorted(("theta", "F"), key=lambda name: -dataset.sizes[name])]
    first, second, *others = sorted(order, key=lambda name: dataset.sizes[name] == 1)
    # Friction goes up if it is one of both.
    x, y = (second, first) if first == "mu" and dataset.sizes[second] > 1 else (first, second)
    return x, y, others


def _draw_plane(point: xr.Dataset, x: str, y: str, about: str) -> Figure:
    """A plane of regimes, and below it what the motion is like."""
    layout = [["regime", "regime", "key"], list(QUANTITIES)]
    figure, panels = figures.mosaic(layout, 17.0, 15.0, height_ratios=(1.5, 1.0))
    top, key = panels.pop("regime"), panels.pop("key")
    key.axis("off")
    key.text(0.0, 0.0, "white in (c), (d): no vibration", fontsize=8.0)
    key.legend(handles=_draw_regimes(top, point, x, y), loc="upper left", borderaxespad=0.0)
    top.set_title("(a) regime", loc="left", fontsize=9.0)
    for letter, (name, axes) in zip("bcd", panels.items(), strict=True):
        _draw_shades(axes, point, x, y, name)
        axes.set_title(f"({letter}) {labels.label(point[name])}", loc="left", fontsize=9.0)
        axes.label_outer()
    figure.suptitle(figures.fitted(f"Regimes: {about}", 17.0))
    return figure


def _draw_regimes(axes: Axes, point: xr.Dataset, x: str, y: str) -> list[Any]:
    """Draw the plane of regimes and the marks of its cells; return the handles of its legend."""
    from matplotlib.lines import Line2D

    codes = xr.DataArray(regimes.kinds(point), coords=point["regime"].coords, dims=point["regime"].dims)
    handles: list[Any] = [*planes.regimes(axes, codes, x, y)]
    if _draw_onset(axes, point, x, y):
        handles.append(Line2D([], [], **ONSET, label=f"onset of flutter\n{BELOW}"))
    xs, ys = (labels.readable(point[name]).values for name in (x, y))
    # Below the others, which are smaller.
    handles += planes.mark_mixed(axes, point, x, y)
    rim: dict[str, Any] = {"linestyle": "none", "markeredgecolor": "black", "markersize": 4.0}
    looks = MARKS | ({"uncertain": {"marker": "o", "color": "black", "label": "realisations differ"}})
    for name, look in looks.items():
        differ = uncertain(point) & ~mixed.several(point).values
        chosen = differ if name == "uncertain" else point["verdict"].values == [*VERDICTS].index(name)
        rows, columns = np.nonzero(chosen)
        handles += planes.marks(axes, list(zip(xs[columns], ys[rows], strict=True)), **rim, **look)
    if (x, y) == ("V", "mu") and is_papers_rig(point) and np.isclose(point["theta"], paper.THETA):
        for kind, marker in PAPER_MARKS.items() if np.isclose(point["F"], paper.LOAD) else ():
            places = [(1e3 * V, paper.MU) for V, regime in paper.VIBRATION.items() if regime == kind]
            look = rim | {"marker": marker, "color": "white", "markersize": 6.0, "label": f"paper: {kind}"}
            handles += planes.marks(axes, places, **look)
    return handles


def _draw_onset(axes: Axes, point: xr.Dataset, x: str, y: str) -> bool:
    """Draw where steady sliding loses its stability; false if that is not in the plane."""
    from matplotlib import patheffects

    onset = point["onset_mu"].values
    if "mu" not in (x, y) or not np.any(np.isfinite(onset)):
        return False
    # Seen on any colour.
    look = ONSET | {"path_effects": [patheffects.withStroke(linewidth=2.0, foreground="white")]}
    if y == "mu" and point["onset_mu"].dims == (x,):
        axes.plot(labels.readable(point[x]).values, onset, **look)
    elif onset.ndim == 0:
        (axes.axhline if y == "mu" else axes.axvline)(float(onset), **look)
    return True


def _draw_shades(axes: Axes, point: xr.Dataset, x: str, y: str, name: str) -> None:
    """One quantity over the plane, with its scale."""
    from matplotlib.colors import LogNorm, Normalize

    array = _quantity(point, name)
    finite = array.values[np.isfinite(array.values)]
    norm: Any = Normalize(0.0, 1.0)
    if name != "stick_fraction" and len(finite):
        low, high = np.quantile(finite, [RARE, 1.0 - RARE])
        norm = LogNorm(low, high) if 0.0 < WIDE * low < high else Normalize(low, high)
    mesh = planes.cells(axes, array, x, y, norm=norm)
    bar = axes.figure.colorbar(mesh, ax=axes, location="bottom", pad=0.02, aspect=25)
    bar.outline.set_visible(False)
    figures.one_two_five(bar.ax.xaxis)
    _draw_onset(axes, point, x, y)
    planes.mark_mixed(axes, point, x, y)


def _quantity(point: xr.Dataset, name: str) -> xr.DataArray:
    """A quantity in a reader's unit, NaN where the motion has no such thing."""
    array = labels.readable(point[name]).astype(float)
    return array.where(regimes.is_of(regimes.kinds(point), *regimes.VIBRATING)) if QUANTITIES[name] else array


def _draw_along(point: xr.Dataset, x: str, about: str) -> Figure:
    """The same along one parameter: the spread of the realisations, marked by the regime."""
    figure, panels = figures.panels(len(QUANTITIES), 1, 15.0, 16.0, sharex=True)
    values, codes = labels.readable(point[x]).values, regimes.kinds(point)
    for axes, name in zip(panels, QUANTITIES, strict=True):
        spread = labels.readable(point[f"{name}_std"]).values
        planes.along(axes, values, _quantity(point, name).values, codes, spread)
        planes.draw_mixed(axes, point, x, name)
        if x == "mu" and np.isfinite(point["onset_mu"]):
            axes.axvline(float(point["onset_mu"]), **ONSET, label=f"onset of flutter {BELOW}")
        axes.set_ylabel(figures.fitted(labels.label(point[name]), 6.0))
    panels[0].set_ylim(0.0, 1.0)
    planes.set_side(panels[-1], "x", point[x])
    figures.legend_below(figure, panels, 4)
    note = "mean (of the frequency: middle) and standard deviation of the realisations"
    figure.suptitle(figures.fitted(f"Regimes: {about}\n{note}", 15.0))
    return figure


STUDY = Study(
    name="regimes",
    title="Regimes: kind of vibration over V and mu",
    question="Where does the rig slide steadily, vibrate, or stick and burst, with the published scheme's "
    "numerical damping, and does linear stability predict it?",
    paper="Sections 2 and 3.5.3, at mu = 0.2: intermittent vibration at 1 and 2 mm/s, periodic at 5 mm/s; by "
    "Section 3.4.2 steady sliding is unstable from mu = 0.12 on. A plane of regimes is not in it.",
    parameters={
        "V": Parameter(logarithmically(2e-4, 1e-2, 40), "m s-1", "speed of the drive"),
        "mu": Parameter(evenly(0.01, 0.4, 40), "1", "coefficient of friction"),
        "theta": Parameter(np.array([paper.THETA]), "degree", "inclination of P1"),
        "F": Parameter(np.array([paper.LOAD]), "N", "load on A"),
    }
    | ensemble.members(1)
    # Beside the paper's regimes, and stability below 10 kHz: without that damping modes above it grow first.
    | ensemble.until(0.3, 16.0, "published"),
    outputs=OUTPUTS, function=motions, coords=ensemble.coords, check=ensemble.check, derive=derive,
    summary=summarise, figure=draw, claims=CLAIMS, normalised=True, chaotic=True,
)  # fmt: skip
