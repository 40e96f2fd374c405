"""Windows of inclination in which steady sliding is unstable: as roots, in a file and in a table."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import Rig, unstable_windows
from studies.motion import transients
from studies.tables import Column, Part, Table

# How a window ends: there the pair grows no more, leaves the band or oscillates no more; or the range ends.
ENDS = ("pair grows no more", "end of the range")
# By their names here: names in `fivcore.UnstableWindows`, units and meaning.
WINDOWS = {
    "from": ("theta_from", "degree", "inclination from which a pair is unstable"),
    "to": ("theta_to", "degree", "inclination up to which the pair is unstable"),
    "frequency_from": ("frequency_from", "Hz", "frequency of the pair where the window begins"),
    "frequency_to": ("frequency_to", "Hz", "frequency of the pair where the window ends"),
    "open_from": ("open_from", "1", "what the window begins with"),
    "open_to": ("open_to", "1", "what the window ends with"),
    "peak_growth_rate": ("peak_growth_rate", "s-1", "largest growth rate of the pair within the window"),
    "peak_theta": ("peak_theta", "degree", "inclination at which the pair grows fastest"),
    "peak_frequency": ("peak_frequency", "Hz", "frequency of the pair where it grows fastest"),
}
OTHER_END = {"from": "to", "to": "from"}


def with_windows(dataset: xr.Dataset, rig: Rig, mu: float, V: float) -> xr.Dataset:
    """Add the windows within the range of theta, ascending in frequency, then theta.

    Where they cannot be found there are none, and the `comment` of `window_from` gives the reason.
    """
    theta, comment = dataset["theta"].values, ""
    try:
        values = windows(rig, mu, V, float(theta.min()), float(theta.max()))
    except ArithmeticError as problem:
        values, comment = _no_windows(), str(problem)
    dataset = dataset.assign(
        {
            f"window_{name}": ("window", values[name], {"units": units, "long_name": long_name})
            for name, (_, units, long_name) in WINDOWS.items()
        }
    )
    if comment:
        dataset["window_from"].attrs["comment"] = comment
    return transients.with_flags(dataset, window_open_from=ENDS, window_open_to=ENDS)


def windows(rig: Rig, mu: float, V: float, low: float, high: float) -> dict[str, NDArray[Any]]:
    """Compute the variables of WINDOWS for each window between two angles; a single angle has none.

    Of V only the sign matters: with V < 0 the windows are those of -theta. Windows that cannot be told apart raise
    `ArithmeticError`.
    """
    if low == high:
        return _no_windows()
    solved = unstable_windows(rig, mu, *((low, high) if V > 0.0 else (-high, -low)), transients.BAND)
    values = {name: np.asarray(getattr(solved, field)) for name, (field, _, _) in WINDOWS.items()}
    if V < 0.0:
        # In the mirror a window begins where it ended; 0 - theta, for -theta makes -0 of 0.
        values = {name: values["_".join(OTHER_END.get(part, part) for part in name.split("_"))] for name in values}
        values |= {name: 0.0 - values[name] for name in ("from", "to", "peak_theta")}
    order = np.lexsort((values["from"], values["frequency_from"]))
    return {name: each[order].astype(np.int8 if "open" in name else float) for name, each in values.items()}


def _no_windows() -> dict[str, NDArray[Any]]:
    return {name: np.empty(0, np.int8 if "open" in name else float) for name in WINDOWS}


def report(dataset: xr.Dataset, mu: float) -> list[Part]:
    """The windows as a table; a bound with < or > is the end of the range."""
    theta, comment = dataset["theta"].values, dataset["window_from"].attrs.get("comment", "")
    if len(theta) == 1:
        return ["A single inclination has no window of instability; give a range of theta."]
    where = f"at mu = {mu:g}, theta from {theta.min():g} to {theta.max():g} degrees"
    if comment:
        return [f"Windows of instability {where} could not be found: {comment}."]
    if not dataset.sizes["window"]:
        return [f"No pair is unstable {where}."]
    columns: dict[str, Column] = {
        "from deg": partial(_bound, end="from", mark="< "),
        "to deg": partial(_bound, end="to", mark="> "),
        "from Hz": ("window_frequency_from", ".0f"),
        "to Hz": ("window_frequency_to", ".0f"),
        "largest growth 1/s": ("window_peak_growth_rate", ".0f"),
        "at deg": ("window_peak_theta", ".2f"),
        "at Hz": ("window_peak_frequency", ".0f"),
    }
    return [f"Windows of instability {where}, as roots:", Table.of(dataset, "window", columns)]


def _bound(window: xr.Dataset, end: str, mark: str) -> str:
    return f"{mark if int(window[f'window_open_{end}']) else ''}{float(window[f'window_{end}']):.3f}"
