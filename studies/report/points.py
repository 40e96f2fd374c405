"""The points of a result as the page's script reads them: axes, variables, status and errors, bounded in size."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from studies.gallery.regimes import figure as regimes_figure
from studies.maps.figure import STABLE
from studies.motion import transients
from studies.plotting import planes
from studies.query.columns import MAKING, Column, column_of, settings
from studies.report.commands import scene_lines
from studies.study import constants

# So many numbers of one result are embedded: some 600 kB of text.
MOST_NUMBERS = 120_000
# Variables with a second dimension, such as modes, are shown in full where there are no others.
MOST_BESIDE = 10
DIGITS = 6


class Points(NamedTuple):
    """What a page embeds of a result, as JSON: `axes`, `columns`, `settings`, `plane`; and how many points."""

    data: dict[str, Any]
    size: str


def points_of(dataset: xr.Dataset, point_command: str = "") -> Points:
    """What the page shows of every point; of a large grid a coarser one."""
    status = dataset["status"]
    dims = [str(dim) for dim in status.dims]
    variables = _variables(dataset)
    strides = dict(zip(dims, _strides(status.shape, len(variables) + len(dims)), strict=True))
    coarse = {dim: slice(None, None, stride) for dim, stride in strides.items()}
    columns = [_column(name, each.isel(coarse).transpose(*dims)) for name, each in variables.items()]
    # Where nothing failed there is no column of errors.
    columns = [each for each in columns if each["name"] != "error" or each.get("fill") != "" or each["at"]]
    axes = [_axis(dataset, dim, coarse[dim]) for dim in dims]
    plane = _plane(dataset, [each["name"] for each in columns], point_command)
    size = f"{status.size} points"
    if any(stride > 1 for stride in strides.values()):
        ordinals = {2: "second", 3: "third"}
        every = " and ".join(f"{ordinals.get(n, f'{n}th')} value of {dim}" for dim, n in strides.items() if n > 1)
        size = f"{status[coarse].size} of {size}, every {every}, to keep this page small"
    held = settings(constants(dataset)).items()
    finite = {
        name: None if isinstance(value, float) and not math.isfinite(value) else value for name, value in held
    }
    return Points({"axes": axes, "columns": columns, "settings": finite, "plane": plane}, size)


def _variables(dataset: xr.Dataset) -> dict[str, xr.DataArray]:
    """Everything that has one value a point, in the file's order, the status first and the error last."""
    dims = dataset["status"].dims
    own = {str(name): each for name, each in dataset.data_vars.items() if set(each.dims) == set(dims)}
    variables = {name: each for name, each in own.items() if name not in MAKING}
    if not variables:
        for name, each in dataset.data_vars.items():
            beside = [dim for dim in each.dims if dim not in dims]
            if len(each.dims) == len(dims) + 1 and len(beside) == 1 and each.sizes[beside[0]] <= MOST_BESIDE:
                labels = dataset[beside[0]].values if beside[0] in dataset.coords else range(each.sizes[beside[0]])
                for k, label in enumerate(labels):
                    # A name that an expression can have.
                    own_name = re.sub(r"\W", "_", f"{name}_{beside[0]}_{label}")
                    variables[own_name] = each.isel({beside[0]: k}, drop=True)
    last = {name: own[name] for name in ("wall_time", "error") if name in own}
    return {"status": own["status"]} | variables | last


def _strides(sizes: Sequence[int], columns: int) -> list[int]:
    """The smallest strides with which a grid is small enough, the longest axis thinned first."""
    strides, counts = [1] * len(sizes), list(sizes)
    while math.prod(counts) * columns > MOST_NUMBERS:
        longest = int(np.argmax(counts))
        strides[longest] += 1
        counts[longest] = -(-sizes[longest] // strides[longest])
    return strides


def _axis(dataset: xr.Dataset, dim: str, coarse: slice) -> dict[str, Any]:
    """Values of an axis in full, how a reader sees them, and names that stand for them."""
    axis = _described(column_of(dim, dataset[dim]), dataset[dim]) | {
        "values": dataset[dim].values[coarse].tolist()
    }
    if dim in planes.SYMBOLS:
        axis |= {"factor": planes.SYMBOLS[dim][2], "label": planes.label(dim)}
    named = dataset.get(f"{dim}_name")
    if named is not None and named.dims == (dim,):
        axis["names"] = [str(name) for name in named.values[coarse]]
    return axis


def _column(name: str, variable: xr.DataArray) -> dict[str, Any]:
    """The values of a variable, in the order of the grid; what most of them are is written once."""
    column = column_of(name, variable)
    described = _described(column, variable)
    values = _values(column.shown(variable.values.ravel()))
    if column.words is not None:
        described["words"] = list(column.words.values())
    common, count = Counter(values).most_common(1)[0] if values else (None, 0)
    if 2 * count > len(values):
        return described | {"fill": common, "at": {str(k): v for k, v in enumerate(values) if v != common}}
    return described | {"values": values}


def _described(column: Column, variable: xr.DataArray) -> dict[str, Any]:
    about = str(variable.attrs.get("long_name", ""))
    return {"name": column.name, "units": column.units, "about": about, "kind": column.kind}


def _values(values: NDArray[Any]) -> list[Any]:
    """Numbers as read, None where there is none; texts."""
    if values.dtype.kind == "f":
        return [float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()]
    return values.tolist() if values.dtype.kind in "iub" else [None if v != v else str(v) for v in values.tolist()]


def _plane(dataset: xr.Dataset, columns: list[str], point_command: str) -> dict[str, Any] | None:
    """How a plane of scenes is shown: across, up, colours, and the lines for a cell."""
    scene = scene_lines(dataset)
    if scene is None:
        return None
    held, lines = scene
    dims = [str(dim) for dim in dataset["status"].dims]
    if set(dims) == set(transients.SCENE):
        x, y, _ = regimes_figure.arranged(dataset)
    else:
        x, y = [dim for dim in dims if dataset.sizes[dim] > 1][:2]
    if point_command and dataset.attrs["sweep"] != "scenes":
        lines = {"This point again": point_command} | lines
    return {
        "x": dims.index(x),
        "y": dims.index(y),
        "first": next((name for name in ("regime", *columns) if name in columns and name not in MAKING), "status"),
        "held": held,
        "lines": lines,
        "shades": [to_hex(shade) for shade in matplotlib.colormaps["cividis"](np.linspace(0.0, 1.0, 24))],
        "stable": STABLE,
        "colours": dict(zip(transients.REGIMES, planes.COLOURS, strict=False)),
    }
