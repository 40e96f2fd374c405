"""The points of a result as the page's script reads them: axes, figures, status and errors, bounded in size."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from studies.gallery.regimes import figure as regimes_figure
from studies.maps.figure import STABLE
from studies.motion import transients
from studies.plotting import planes
from studies.query.columns import NUMBER, TEXT, WORDS, settings
from studies.report.scene import recipe
from studies.study import constants

# So many numbers of one result are embedded: some 600 kB of text.
MOST_NUMBERS = 120_000
# Figures with a second dimension, such as modes, are shown in full where there are no others.
MOST_BESIDE = 10
PLAIN = ("status", "error", "wall_time")
DIGITS = 6


@dataclass(frozen=True)
class Points:
    """What is embedded of a result.

    Attributes
    ----------
    data : dict
        For JSON: `axes`, `columns`, `settings`, and `plane` where the points are a plane of scenes.
    embedded, total : int
        Points.
    strides : dict of str to int
        Of which axes only every so many-th value is embedded.
    """

    data: dict[str, Any]
    embedded: int
    total: int
    strides: dict[str, int]


def points_of(dataset: xr.Dataset, point_command: str = "") -> Points:
    """What the page shows of every point; of a large grid a coarser one."""
    dims = [str(dim) for dim in dataset["status"].dims]
    figures = _figures(dataset)
    strides = _strides([dataset.sizes[dim] for dim in dims], len(figures) + len(dims))
    coarse = {dim: slice(None, None, stride) for dim, stride in zip(dims, strides, strict=True)}
    columns = [_column(name, each.isel(coarse).transpose(*dims)) for name, each in figures.items()]
    axes = [_axis(dataset, dim, coarse[dim]) for dim in dims]
    data: dict[str, Any] = {"axes": axes, "columns": [each for each in columns if not _silent(each)]}
    data["settings"] = {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in settings(constants(dataset)).items()
    }
    plane = _plane(dataset, [each["name"] for each in data["columns"]], point_command)
    if plane:
        data["plane"] = plane
    total = math.prod(dataset.sizes[dim] for dim in dims)
    embedded = math.prod(len(each["values"]) for each in axes)
    return Points(data, embedded, total, {d: s for d, s in zip(dims, strides, strict=True) if s > 1})


def _figures(dataset: xr.Dataset) -> dict[str, xr.DataArray]:
    """Everything that has one value a point, in the file's order, the status first and the error last."""
    dims = dataset["status"].dims
    own = {str(name): each for name, each in dataset.data_vars.items() if set(each.dims) == set(dims)}
    figures = {name: each for name, each in own.items() if name not in PLAIN}
    if not figures:
        for name, each in dataset.data_vars.items():
            beside = [dim for dim in each.dims if dim not in dims]
            if len(each.dims) == len(dims) + 1 and len(beside) == 1 and each.sizes[beside[0]] <= MOST_BESIDE:
                labels = dataset[beside[0]].values if beside[0] in dataset.coords else range(each.sizes[beside[0]])
                for k, label in enumerate(labels):
                    # A name that an expression can have.
                    own_name = re.sub(r"\W", "_", f"{name}_{beside[0]}_{label}")
                    figures[own_name] = each.isel({beside[0]: k}, drop=True)
    return (
        {"status": own["status"]} | figures | {name: own[name] for name in ("wall_time", "error") if name in own}
    )


def _silent(column: dict[str, Any]) -> bool:
    """Whether it is that of the errors, and there are none."""
    return column["name"] == "error" and column.get("fill") == "" and not column["at"]


def _strides(sizes: Sequence[int], columns: int) -> list[int]:
    """The smallest strides with which a grid is small enough, the longest axis thinned first."""
    strides = [1] * len(sizes)

    def counts() -> list[int]:
        return [-(-size // stride) for size, stride in zip(sizes, strides, strict=True)]

    while math.prod(counts()) * columns > MOST_NUMBERS:
        strides[int(np.argmax(counts()))] += 1
    return strides


def _axis(dataset: xr.Dataset, dim: str, coarse: slice) -> dict[str, Any]:
    """Values of an axis in full, how a reader sees them, and names that stand for them."""
    axis = dataset[dim][coarse]
    data: dict[str, Any] = {"name": dim, "units": _units(axis), "about": str(axis.attrs.get("long_name", ""))}
    data["kind"] = _kind(axis)
    data["values"] = axis.values.tolist()
    if dim in planes.SYMBOLS:
        _, _, data["factor"] = planes.SYMBOLS[dim]
        data["label"] = planes.label(dim)
    named = dataset.get(f"{dim}_name")
    if named is not None and named.dims == (dim,):
        data["names"] = [str(name) for name in named.values[coarse]]
    return data


def _column(name: str, variable: xr.DataArray) -> dict[str, Any]:
    """The values of a figure, in the order of the grid; what most of them are is written once."""
    data: dict[str, Any] = {"name": name, "units": _units(variable), "about": variable.attrs.get("long_name", "")}
    values = _values(variable.values.ravel())
    data["kind"] = _kind(variable)
    if data["kind"] == WORDS:
        words = str(variable.attrs["flag_meanings"]).split()
        codes = {
            int(code): word.replace("_", " ")
            for code, word in zip(np.atleast_1d(variable.attrs["flag_values"]), words, strict=False)
        }
        values = [None if value is None else codes.get(int(value), str(value)) for value in values]
        data["words"] = list(codes.values())
    common, count = Counter(values).most_common(1)[0] if values else (None, 0)
    if 2 * count > len(values):
        return data | {"fill": common, "at": {str(k): v for k, v in enumerate(values) if v != common}}
    return data | {"values": values}


def _values(values: NDArray[Any]) -> list[Any]:
    """Numbers as read, None where there is none; texts."""
    if values.dtype.kind == "f":
        return [float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()]
    return values.tolist() if values.dtype.kind in "iub" else [str(value) for value in values]


def _kind(variable: xr.DataArray) -> str:
    """What an expression takes the values for."""
    if "flag_meanings" in variable.attrs:
        return WORDS
    return TEXT if variable.dtype.kind in "OU" else NUMBER


def _units(variable: xr.DataArray) -> str:
    units = str(variable.attrs.get("units", ""))
    return "" if units == "1" else units


def _plane(dataset: xr.Dataset, columns: list[str], point_command: str) -> dict[str, Any] | None:
    """How a plane of scenes is shown: across, up, colours, and the lines for a cell."""
    how = recipe(dataset)
    if how is None:
        return None
    dims = [str(dim) for dim in dataset["status"].dims]
    if set(dims) == set(transients.SCENE):
        x, y, _ = regimes_figure.arranged(dataset)
    else:
        x, y = [dim for dim in dims if dataset.sizes[dim] > 1][:2]
    first = next((name for name in ("regime", *columns) if name in columns and name not in PLAIN), "status")
    shades = matplotlib.colormaps["cividis"](np.linspace(0.0, 1.0, 24))
    lines = {"Simulate this scene, on the command line": how.command, "The same in Python": how.python}
    if point_command and dataset.attrs["sweep"] != "scenes":
        lines = {"This point again": point_command} | lines
    return {
        "x": dims.index(x),
        "y": dims.index(y),
        "first": first,
        "held": how.held,
        "lines": lines,
        "shades": [to_hex(shade) for shade in shades],
        "stable": STABLE,
        "colours": dict(zip(transients.REGIMES, planes.COLOURS, strict=False)),
    }
