"""Figures of any result: quantities over one or two parameters, draws as scatter plots, recorded series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
import xarray as xr

from studies import paper
from studies.answering.results import PATHS, configuration, settings, structure_in
from studies.answering.summary import quantities
from studies.declaring import labels
from studies.declaring.parameters import RIG, SCENE
from studies.motion import regimes
from studies.motion.run import BAND
from studies.physics.quantities import MU_MAX
from studies.plotting import figures, planes, signals
from sweeps import DONE, FAILED

if TYPE_CHECKING:
    from studies.study import Study

# Points of the paper: its tests, and where it finds modes to become unstable.
POINT = {name: parameter.default for name, parameter in (SCENE | RIG).items()}
PAPER = [("*", "tests, paper", POINT | {"V": V}) for V in paper.SPEEDS]
PAPER += [("D", "first unstable μ, paper", POINT | {"mu": mu}) for mu, _ in paper.ONSETS]

# Panels of a figure: quantities down, values of a further parameter or parameters that are drawn across.
MOST_DOWN, MOST_CURVES = 4, 6
# Rows of recorded series, half of them where figures are narrow; the share of a run before its spectrum begins,
# and the segments of that.
MOST_SERIES, BEGIN, SEGMENTS = 6, 0.3, 8
# Below this part of its size a series is constant but for rounding.
CONSTANT = 1e-6
# Regimes and failed points of a map by index in `regimes.KINDS`; no parameter can be called so.
KIND = "kind of motion"
SERIES = ("velocity_B", "normal_force", "tangential_force", "slip_velocity")


def draw(dataset: xr.Dataset, study: Study | None = None) -> figures.Figure:
    """Draw the quantities of a map, or the first quantities of another result, over the parameters that vary."""
    dims = [str(dim) for dim in dataset["status"].dims]
    if is_map := _is_map(dataset):
        names, x, y = arranged(dataset)
        others, done = [y] if y else [], dataset
        if "regime" in dataset:
            other = planes.FAILED + (dataset["status"] != FAILED)
            done = dataset.assign({KIND: dataset["regime"].fillna(other).astype(int)})
    else:
        done = dataset.where(dataset["status"] == DONE)
        if "regime" in dataset and dataset["regime"].dims == dataset["status"].dims:
            done = done.assign({KIND: (dataset["status"].dims, regimes.kinds(dataset))})
        names = [name for name in quantities(dataset) if np.isfinite(dataset[name]).any()][:MOST_DOWN]
        varying = [dim for dim in dims if dataset.sizes[dim] > 1] or dims[:1]
        x, *others = sorted(varying, key=lambda dim: -dataset.sizes[dim])
        done = done.isel({dim: 0 for dim in dims if dim not in varying and dims[0] not in PATHS})
    title = str(dataset.attrs.get("title", ""))
    if is_map and study is not None:
        over = " and ".join(labels.title(name) for name in (x, *others))
        title = f"{study.title}: {', '.join(map(labels.title, names))} over {over}"
    thresholds = {} if study is None else study.thresholds
    if not names or not (is_map or bool((dataset["status"] == DONE).any())):
        return _draw_nothing(dataset, title)
    if dims[0] in PATHS:
        return _draw_scatter(done, names, title)
    if len(others) > 1 or (others and (is_map or dataset.sizes[others[0]] > MOST_CURVES)):
        return _draw_planes(done, names, x, others, title, thresholds)
    figure, panels = figures.panels(len(names), 1, 5.0, sharex=True)
    for axes, name in zip(panels, names, strict=True):
        _draw_curves(axes, done, name, x, others, thresholds)
        if is_map:
            _mark_paper(axes, dataset, [x])
    planes.set_side(panels[-1], "x", dataset[x])
    figures.legend_below(figure, panels, 3)
    figure.suptitle(title)
    return figure


def most_across() -> int:
    """The largest number of panels side by side."""
    return 3 if figures.is_wide() else 2


def _is_map(dataset: xr.Dataset) -> bool:
    return "quantities" in configuration(dataset).get("request", {}) and dataset["status"].dims[0] not in PATHS


def arranged(dataset: xr.Dataset) -> tuple[list[str], str, str | None]:
    """The requested quantities of a map, its horizontal parameter, and its vertical one."""
    request, dims = configuration(dataset).get("request", {}), [str(dim) for dim in dataset["status"].dims]
    x = request["x"] if request.get("x") in dims else dims[0]
    names = [name for name in request.get("quantities", ()) if name in dataset]
    return names or list(map(str, dataset.data_vars))[:1], x, next((dim for dim in dims if dim != x), None)


def _draw_nothing(dataset: xr.Dataset, title: str) -> figures.Figure:
    figure, (axes,) = figures.panels(1, 1, 3.0)
    axes.axis("off")
    why = "no point has a number to draw" if quantities(dataset) else "no output has one number a point"
    axes.text(0.5, 0.5, why, ha="center", va="center")
    figure.suptitle(title)
    return figure


def _draw_curves(
    axes: figures.Axes, done: xr.Dataset, name: str, x: str, others: Sequence[str], thresholds: Mapping[str, float]
) -> None:
    """A quantity along one parameter with its standard errors, a curve for each value of another."""
    values, curves = labels.readable(done[x]).values, labels.readable(done[name].transpose(x, *others))
    spread = labels.readable(done[f"{name}_se"]) if f"{name}_se" in done else None
    for k in range(done.sizes[others[0]] if others else 1):
        at = {others[0]: k} if others else {}
        error = None if spread is None else np.nan_to_num(spread.transpose(x, *others).isel(at).values)
        # One curve has its regimes in colour, several have their values.
        if KIND in done and not others:
            planes.along(axes, values, curves.isel(at).values, done[KIND].values, error)
        else:
            text = labels.named(others[0], done[others[0]][k]) if others else None
            # No line joins classes, nor onset frequencies, which belong to another pair wherever they jump.
            line = "" if name == "onset_frequency" or flags(done[name]) else "-"
            look: dict[str, Any] = {"marker": "o", "markersize": 3.0, "linestyle": line, "label": text}
            look |= {} if others else {"color": figures.BLUE}
            figures.curve(axes, values, curves.isel(at).values, error, **look)
        planes.draw_mixed(axes, done.isel(at), x, name)
        if error is not None and np.any(error > 0.0):
            axes.plot(
                [], [], color=figures.GREY, marker="|", markersize=8.0, linestyle="", label="bars: standard error"
            )
        lacks = ~np.isfinite(curves.isel(at).values.astype(float)) & (done["status"].isel(at).values == DONE)
        if lacks.any():
            text = f"no flutter up to μ = {MU_MAX:g}" if name.startswith("onset_") else f"no {labels.title(name)}"
            look = {
                "color": figures.GREY,
                "transform": axes.get_xaxis_transform(),
                "clip_on": False,
                "label": text,
            }
            axes.plot(values[lacks], np.zeros(lacks.sum()), "x", **look)
    if words := flags(done[name]):
        axes.set_yticks(*words)
    elif name in thresholds:
        axes.axhline(thresholds[name], color=figures.GREY, linewidth=0.8)
    axes.set_ylabel(labels.label(done[name], long=True))


def flags(array: xr.DataArray) -> tuple[list[int], list[str]] | None:
    """The values of a variable's classes and their meanings; None of numbers."""
    if "flag_meanings" not in array.attrs:
        return None
    meanings = [word.replace("_", " ") for word in str(array.attrs["flag_meanings"]).split()]
    return np.atleast_1d(array.attrs["flag_values"]).tolist(), meanings


def _draw_planes(
    done: xr.Dataset, names: Sequence[str], x: str, others: Sequence[str], title: str, limits: Mapping[str, float]
) -> figures.Figure:
    """Planes of the two longest parameters: a row for each quantity, a column for each value of a third."""
    y, *rest = others
    across = planes.subset(done.sizes[rest[0]], most_across()) if rest else [0]
    figure, panels = figures.panels(len(names), len(across), 7.0 if _is_map(done) else 5.5, stack=False)
    for k, axes in enumerate(panels):
        name, column = names[k // len(across)], across[k % len(across)]
        at = {dim: 0 for dim in done["status"].dims if dim not in (x, y)} | ({rest[0]: column} if rest else {})
        _draw_plane(axes, done.isel(at), name, x, y, limits.get(name))
        if rest:
            axes.set_title(labels.named(rest[0], done[rest[0]][column]), loc="left")
    figures.legend_below(figure, panels, 3)
    figure.suptitle(title)
    return figure


def _draw_plane(axes: figures.Axes, at: xr.Dataset, name: str, x: str, y: str, threshold: float | None) -> None:
    """A quantity over two parameters, its threshold along cell edges, failed points, and the paper's points."""
    values = labels.readable(at[name]).astype(float)
    if name == "regime":
        planes.classes(axes, at[KIND], x, y)
    else:
        log = {"norm": "log"} if at[name].attrs.get("units") == "N s" and values.min() > 0.0 else {}
        text = labels.label(at[name], long=True)
        # Where steady sliding is stable its growth rate is grey.
        mesh = planes.numbers(axes, values, x, y, text, values <= 0.0 if name == "growth_rate" else None, **log)
        if (words := flags(at[name])) and mesh.colorbar is not None:
            mesh.set_clim(words[0][0], words[0][-1])
            mesh.colorbar.set_ticks(words[0], labels=words[1])
        axes.set_title("" if values.notnull().any() else "no value")
        planes.hatch_failed(axes, at["status"] == FAILED, x, y)
    if threshold is not None and planes.outline(axes, (at[name] > threshold).where(at[name].notnull()), x, y):
        axes.plot([], [], color="black", label=f"{labels.title(name)} {threshold:g}")
    planes.mark_mixed(axes, at, x, y)
    if _is_map(at):
        _mark_paper(axes, at, [x, y])


def _mark_paper(axes: figures.Axes, dataset: xr.Dataset, dims: Sequence[str]) -> None:
    """Mark the points of the paper's rig and tests in a plane, or their values along one parameter."""
    fixed = settings(dataset)
    for marker, label, point in PAPER:
        beams = set(dims) <= set(point) and not structure_in(dataset)
        papers = beams and all(fixed.get(name, value) == value for name, value in point.items())
        if papers and (marker == "*" or ("mu" in dims and "regime" not in dataset)):
            place = tuple(labels.unit_of(dataset[dim])[1] * point[dim] for dim in dims)
            if len(dims) == 2:
                planes.marks(axes, [place], marker=marker, color="black", mfc="white", markersize=8.0, label=label)
            elif dataset[dims[0]].min() <= point[dims[0]] <= dataset[dims[0]].max():
                axes.axvline(*place, color=figures.ORANGE, linestyle=":" if marker == "*" else "--", label=label)


def _draw_scatter(done: xr.Dataset, names: Sequence[str], title: str) -> figures.Figure:
    """Each quantity over each parameter that is random or comes from a table."""
    dims = done["status"].dims
    varied = [
        str(n) for n, c in done.coords.items() if c.dims == dims[:1] and n not in PATHS and c.dtype.kind in "if"
    ]
    left_out = planes.of_all(varied[: most_across()], len(varied), "parameters")
    varied = varied[: most_across()]
    how: dict[str, Any] = {"stack": False, "sharey": "row", "sharex": "col"}
    figure, panels = figures.panels(len(names), max(len(varied), 1), 4.5, **how)
    for k, axes in enumerate(panels):
        name, over = names[k // max(len(varied), 1)], done[varied[k % len(varied)]] if varied else done[dims[0]]
        values = labels.readable(done[name]).transpose(dims[0], ...).values.reshape(done.sizes[dims[0]], -1)
        axes.plot(labels.readable(over).values, values, ".", color=figures.BLUE, markersize=3.0)
        axes.set(xlabel=labels.label(over), ylabel=labels.label(done[name], long=True))
        axes.label_outer()
    figure.suptitle(f"{title}{left_out}")
    return figure


def series_of(dataset: xr.Dataset) -> list[str]:
    """The recorded series of a result."""
    return [name for name in SERIES if name in dataset and "elapsed" in dataset[name].dims]


def draw_series(dataset: xr.Dataset, names: Sequence[str]) -> figures.Figure:
    """Whole series, ten periods of it, and its power spectral density, for each point and series."""
    points = dataset.stack(point=[dim for dim in dataset[names[0]].dims if dim != "elapsed"])
    rows_shown = MOST_SERIES if figures.is_wide() else MOST_SERIES // 2
    most = max(1, rows_shown // len(names))
    # Those that move most, where there is no room for all.
    moves = points[names[0]].std("elapsed").fillna(-1.0).values
    chosen = sorted(np.argsort(-moves, kind="stable")[:most].tolist())
    rows = [(points.isel(point=k), name) for k in chosen for name in names][:rows_shown]
    figure, panels = signals.series_panels(len(rows))
    elapsed = dataset["elapsed"].values
    rate = 1.0 / float(elapsed[1] - elapsed[0]) if len(elapsed) > 1 else 1.0
    for (at, name), (left, zoom, right) in zip(rows, panels, strict=True):
        values = labels.unit_of(dataset[name])[1] * at[name].values.astype(float)
        figures.trace(left, elapsed, values, color=figures.BLUE)
        left.set_ylabel(labels.label(dataset[name]))
        place = ", ".join(labels.named(dim, at[dim]) for dim in map(str, dataset["status"].dims))
        left.set_title(place, loc="left")
        later = values[int(BEGIN * len(values)) :]
        right.set_ylabel(f"PSD / dB re ({labels.unit_of(dataset[name])[0]})²/Hz")
        known = bool(np.isfinite(later).all()) and len(later) >= 2 * SEGMENTS
        if not known or np.std(later) <= CONSTANT * np.abs(values).max():
            for axes in (zoom, right):
                axes.text(
                    0.5,
                    0.5,
                    "constant" if known else "too short",
                    transform=axes.transAxes,
                    ha="center",
                    va="center",
                )
                axes.set(xticks=[], yticks=[])
            continue
        frequency, power = scipy.signal.welch(later, rate, nperseg=2 * len(later) // SEGMENTS)
        signals.spectrum(right, frequency, np.maximum(power, 1e-12 * power.max()))
        right.set_xlim(0.0, min(10.0, 0.5e-3 * rate))
        main = np.argmax(np.where(frequency <= BAND, power, 0.0))  # in what the spectrum shows
        signals.periods(zoom, elapsed, values, float(frequency[main]), color=figures.BLUE)
    signals.name_sides(panels)
    figure.suptitle(f"Recorded series{planes.of_all(chosen, points.sizes['point'], 'points, which move most')}")
    return figure
