"""The points of a result as the page's script reads them: axes, variables, status and errors, bounded in size."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from studies.gallery.regimes import figure as regimes_figure
from studies.maps.figure import STABLE
from studies.maps.quantities import AXES
from studies.motion import transients
from studies.plotting import planes
from studies.query.columns import MAKING, Column, column_of, settings
from studies.study import constants

# So many numbers of one result are embedded: some 600 kB of text.
MOST_NUMBERS = 120_000
# Variables with a second dimension, such as modes, are shown in full where there are no others.
MOST_BESIDE = 10
DIGITS = 6
# What marks a column that has another name in the file, with a dimension of its own.
BESIDE = {"beside": True}


class Points(NamedTuple):
    """Data of a result embedded as JSON, `axes`, `columns`, `settings`, `plane`; and the number of points."""

    data: dict[str, Any]
    size: str


def points_of(dataset: xr.Dataset, lines: Mapping[str, str] | None = None) -> Points:
    """Values of every point for the page, or of a coarser grid; `lines` are those of a cell of a plane."""
    status = _rows(dataset)
    dims = [str(dim) for dim in status.dims]
    variables = _variables(dataset, status)
    strides = dict(zip(dims, _strides(status.shape, len(variables) + len(dims)), strict=True))
    coarse = {dim: slice(None, None, stride) for dim, stride in strides.items()}
    columns = [_column(name, each.isel(coarse).transpose(*dims)) for name, each in variables.items()]
    held = settings(constants(dataset))
    data = {
        "axes": [_axis(dataset[dim].isel({dim: coarse[dim]})) for dim in dims],
        # Where nothing failed there is no column of errors.
        "columns": [each for each in columns if each["name"] != "error" or any(each["values"])],
        "settings": {
            name: None if value in (math.inf, -math.inf) or value != value else value
            for name, value in held.items()
        },
        "plane": _plane(dataset, dims, held, list(variables), lines or {}),
    }
    size = f"{status.size} points"
    if thinned := [f"one in {stride} values of {dim}" for dim, stride in strides.items() if stride > 1]:
        size = f"{status[coarse].size} of {size}, {' and '.join(thinned)}, to keep this page small"
    return Points(data, size)


def within(dataset: xr.Dataset) -> list[str]:
    """Axes of the study that are within its results alone: one point has a value at each of theirs."""
    request = json.loads(dataset.attrs["configuration"]).get("request") or {}
    own = dataset["status"].dims
    return [name for name in request.get("axes", ()) if name in dataset.dims and name not in own]


def _rows(dataset: xr.Dataset) -> xr.DataArray:
    """The status of every row: of each point, and at each value of an axis that is within the results alone."""
    status = dataset["status"]
    more = {name: dataset.sizes[name] for name in within(dataset)}
    if not more:
        return status
    return status.expand_dims(more, axis=list(range(-len(more), 0))).assign_coords({n: dataset[n] for n in more})


def _variables(dataset: xr.Dataset, status: xr.DataArray) -> dict[str, xr.DataArray]:
    """Status, names of axes' values, what has one value a row in the file's order, time and error."""
    own = {str(name): each for name, each in dataset.data_vars.items() if set(each.dims) == set(status.dims)}
    names = [f"{dim}_name" for dim in status.dims]
    variables = {name: dataset[name].broadcast_like(status) for name in names if name in dataset}
    # What varies together with an axis.
    along = {str(name): each for name, each in dataset.coords.items() if name not in each.dims}
    variables |= {n: e.broadcast_like(status) for n, e in along.items() if set(e.dims) <= set(status.dims)}
    variables |= {name: each for name, each in own.items() if name not in MAKING}
    if variables and status.ndim > dataset["status"].ndim:
        # What is one for many rows, time besides.
        several = {str(name): each for name, each in dataset.data_vars.items() if name not in (*own, "status")}
        alike = {
            n: e.broadcast_like(status) for n, e in several.items() if set(e.dims) == set(dataset["status"].dims)
        }
        variables |= {n: e for n, e in alike.items() if n not in MAKING}
        own |= alike
    if not set(own) - set(MAKING):
        for name, each in dataset.data_vars.items():
            beside = [dim for dim in each.dims if dim not in status.dims]
            if each.ndim == status.ndim + 1 and len(beside) == 1 and each.sizes[beside[0]] <= MOST_BESIDE:
                for k, label in enumerate(each[beside[0]].values):
                    # A name that an expression can have.
                    own_name = re.sub(r"\W", "_", f"{name}_{beside[0]}_{label}")
                    variables[own_name] = each.isel({beside[0]: k}, drop=True).assign_attrs(BESIDE)
    return {"status": status} | variables | {name: own[name] for name in ("wall_time", "error") if name in own}


def _strides(sizes: Sequence[int], columns: int) -> list[int]:
    """The smallest strides with which a grid is small enough, the longest axis thinned first."""
    strides, counts = [1] * len(sizes), list(sizes)
    while math.prod(counts) * columns > MOST_NUMBERS:
        longest = int(np.argmax(counts))
        strides[longest] += 1
        counts[longest] = -(-sizes[longest] // strides[longest])
    return strides


def _axis(axis: xr.DataArray) -> dict[str, Any]:
    """Values of an axis in full, and how a reader sees them."""
    name = str(axis.name)
    own = {"factor": planes.SYMBOLS[name][2], "label": planes.label(name)} if name in planes.SYMBOLS else {}
    return _described(column_of(name, axis), axis) | {"values": axis.values.tolist()} | own


def _column(name: str, variable: xr.DataArray) -> dict[str, Any]:
    """The values of a variable, in the order of the grid."""
    column = column_of(name, variable)
    words = {} if column.words is None else {"words": list(column.words.values())}
    return _described(column, variable) | words | {"values": _values(column.shown(variable.values.ravel()))}


def _described(column: Column, variable: xr.DataArray) -> dict[str, Any]:
    about = str(variable.attrs.get("long_name", ""))
    return {"name": column.name, "units": column.units, "about": about, "kind": column.kind} | {
        name: True for name in BESIDE if name in variable.attrs
    }


def _values(values: NDArray[Any]) -> list[Any]:
    """Numbers as read, None where there is none; texts."""
    if values.dtype.kind == "f":
        return [float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()]
    return values.tolist() if values.dtype.kind in "iub" else [None if v != v else str(v) for v in values.tolist()]


def _plane(
    dataset: xr.Dataset,
    dims: Sequence[str],
    fixed: Mapping[str, Any],
    columns: Sequence[str],
    lines: Mapping[str, str],
) -> dict[str, Any] | None:
    """How a plane of scenes is shown: across, up, colours, what its scenes have in common, and a cell's lines."""
    wide = [dim for dim in dims if dataset.sizes[dim] > 1]
    if len(wide) < 2 or not set(dims) <= set(AXES):
        return None
    x, y = regimes_figure.arranged(dataset)[:2] if set(dims) == set(transients.SCENE) else wide[:2]
    numbers = {name: fixed.get(name, each.value) for name, each in AXES.items() if name not in dims}
    return {
        "x": dims.index(x),
        "y": dims.index(y),
        "first": next((name for name in ("regime", *columns) if name in columns and name not in MAKING), "status"),
        "held": {
            planes.label(name): f"{planes.shown(name, value):.4g}"
            for name, value in numbers.items()
            if name in transients.SCENE or value != AXES[name].value
        },
        "lines": lines,
        "shades": [to_hex(shade) for shade in matplotlib.colormaps["cividis"](np.linspace(0.0, 1.0, 24))],
        "stable": STABLE,
        "colours": dict(zip(transients.REGIMES, planes.COLOURS, strict=False)),
    }
