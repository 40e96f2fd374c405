"""Names, units and numbers as readers see them: symbols, millimetres, words of flags."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

if TYPE_CHECKING:
    import pandas as pd

# Units of files, and how a reader has them: unit and factor.
READABLE = {
    "1": ("", 1.0),
    "m s-1": ("mm/s", 1e3),
    "m": ("mm", 1e3),
    "Pa": ("GPa", 1e-9),
    "kg m-3": ("kg/m³", 1.0),
    "s-1": ("1/s", 1.0),
    "N s": ("mN s", 1e3),
    "degree": ("°", 1.0),
}
SYMBOLS = {"theta": "θ", "mu": "μ"}


def counted(count: int, size: int, noun: str = "point") -> str:
    """A count in words: "every point", "no point", or "3 of 8 points"."""
    words = {size: f"every {noun}", 0: f"no {noun}"}
    return words.get(count, f"{count} of {size} {noun}s")


def unit_of(array: xr.DataArray) -> tuple[str, float]:
    """The unit in which an array is shown to a reader, and the factor to it."""
    units = str(array.attrs.get("units", "1"))
    if units == "s" and str(array.name).removesuffix("_se").endswith("_time"):
        return "ms", 1e3
    return READABLE.get(units, (units, 1.0))


def title(name: str, array: xr.DataArray | None = None) -> str:
    """The name of a quantity for a reader: a symbol, or words."""
    if array is None:
        return SYMBOLS.get(
            name, re.sub(r"^p(?=[12] )|\brms\b", lambda found: found[0].upper(), name.replace("_", " "))
        )
    # Files have plain letters.
    text = str(array.attrs.get("long_name", name))
    return SYMBOLS.get(name) or re.sub(r"\b(mu|theta)\b", lambda found: SYMBOLS[found[1]], text)


def label(array: xr.DataArray, *, long: bool = False) -> str:
    """The label of an axis or a colour bar: "θ / °", "velocity rms / (mm/s)"; or with the long name."""
    name, (unit, _) = str(array.name), unit_of(array)
    text = title(name, array) if long else title(name)
    return f"{text} / ({unit})" if set("/ ") & set(unit) else f"{text} / {unit}" if unit else text


def readable(array: xr.DataArray) -> xr.DataArray:
    """An array in the unit of a reader."""
    factor = unit_of(array)[1]
    return array if factor == 1.0 or array.dtype.kind not in "iuf" else array.astype(float) * factor


def named(name: str, value: Any, units: str = "") -> str:
    """A parameter with its value: "V = 2 mm/s"; words are unchanged."""
    if isinstance(value, xr.DataArray):
        value, units = value.item(), units or str(value.attrs.get("units", "1"))
    if isinstance(value, str):
        return f"{title(name)} = {value}"
    if value is None or np.isnan(value):
        return f"{title(name)} = auto"
    unit, factor = READABLE.get(units, (units, 1.0))
    return f"{title(name)} = {number(factor * value)}{'' if unit in ('', '°') else ' '}{unit}"


def number(value: Any) -> str:
    """A number to four significant digits, a dash for NaN; words are unchanged."""
    if isinstance(value, (bool, np.bool_, str)):
        return str(value)
    if value is None or np.isnan(value):
        return "-"
    if isinstance(value, (int, np.integer)):
        return str(value)
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"


def words(array: xr.DataArray) -> np.ndarray:
    """The words of an array of flags; "-" for a missing one."""
    codes = np.atleast_1d(array.attrs["flag_values"]).tolist()  # netCDF returns a single one as a scalar
    texts = [text.replace("_", " ") for text in str(array.attrs["flag_meanings"]).split()]
    meanings = dict(zip(codes, texts, strict=True))
    found: np.ndarray = np.vectorize(lambda code: meanings.get(code, "-"), otypes=[object])(array.values)
    return found


def frame(dataset: xr.Dataset, names: Sequence[str], along: str | Sequence[str] | None = None) -> pd.DataFrame:
    """A table of variables and coordinates in readers' units: heads like "V mm/s", flags as words.

    `along` are the dimensions of the rows, by default those of the variables.
    """
    import pandas as pd

    arrays = [dataset[name] for name in names]
    dims = [along] if isinstance(along, str) else list(along or dict.fromkeys(d for a in arrays for d in a.dims))
    columns = {}
    for name, array in zip(names, xr.broadcast(*arrays), strict=True):
        values = array.transpose(*dims) if set(array.dims) == set(dims) else array
        if "flag_meanings" in array.attrs:
            column: Any = words(values)
        else:
            column = readable(values).values
        unit = unit_of(array)[0]
        columns[f"{SYMBOLS.get(name, name)} {unit}".strip()] = np.ravel(column)
    return pd.DataFrame(columns)
