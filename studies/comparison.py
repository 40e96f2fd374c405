"""How far a result is from the reference."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr

# Studies whose motion is chaotic: on another processor or with another compiler their bits differ, and only
# statistics can be compared.
CHAOTIC = ("fig7", "contact", "fig11", "table6", "stick_time", "regimes", "scenes", "accuracy")
# By a part of a variable's name: how far two values lie apart then, absolute and relative; from ensembles that
# differ by the ramp only.
SCATTER = {
    "fraction": (0.05, 0.0),
    "share": (0.05, 0.0),
    "velocity_rms": (0.0, 0.25),
    "mean_normal_force": (0.0, 0.02),
    "normal_force_999": (0.0, 0.25),
    "slip_speed_999": (0.0, 0.25),
    "switches_per_second": (0.0, 0.25),
    # At 1 mm/s, where bursts are rare, 40 runs of 2.5 s range from 2453 to 2615 Hz.
    "dominant_frequency": (0.0, 0.07),
    "first_slip_time": (0.0, 0.01),
    "first_separation_time": (5e-4, 0.01),
    "mean_stick_time": (0.0, 0.1),
    "exponent": (0.06, 0.0),
    "start_up_ratio": (0.03, 0.0),
    "intermittence_end": (0.0, 0.08),
}
# So many variables are named in the comparison, those that differ most.
NAMED = 3


def scatter(name: str) -> tuple[float, float] | None:
    """Limits on the difference of two values of a chaotic variable; None where it has none."""
    # The spread of four runs is as uncertain as it is large, and so is a standard error.
    if name.startswith("member_") or name.endswith(("_std", "_se")):
        return None
    return next((limits for part, limits in SCATTER.items() if part in name), None)


def compared(study: str, dataset: xr.Dataset, reference: xr.Dataset) -> str:
    """How far a result is from the reference, in a line; "" where they have no points in common.

    Of each variable the largest difference at a common point counts, in units of its largest value, or of its
    scatter where the motion is chaotic.
    """
    if _constants(dataset) != _constants(reference):
        return ""
    # Entries without a coordinate, such as onsets, have partners only where there are as many.
    paired = {
        dim for dim, size in reference.sizes.items() if dim in reference.indexes or dataset.sizes.get(dim) == size
    }
    names = [
        str(name)
        for name, variable in reference.data_vars.items()
        if variable.dtype.kind == "f"
        and name in dataset
        and name != "wall_time"
        and paired.issuperset(variable.dims)
    ]
    if study in CHAOTIC:
        names = [name for name in names if scatter(name)]
    ours, theirs = xr.align(dataset[names], reference[names], join="inner")
    if not names or 0 in ours.sizes.values():
        return ""
    differences = {name: _distance(study, name, ours[name].values, theirs[name].values) for name in names}
    largest = sorted(differences, key=lambda name: -differences[name])[:NAMED]
    if not differences[largest[0]]:
        return "beside the reference: no difference"
    unit = "its scatter" if study in CHAOTIC else "its largest value"
    listed = ", ".join(f"{name} {differences[name]:.2g}" for name in largest if differences[name])
    return f"beside the reference: largest differences, each in units of {unit}: {listed}"


def _distance(study: str, name: str, ours: Any, theirs: Any) -> float:
    """Largest difference of two arrays; where one has no value there is none."""
    both = np.isfinite(ours) & np.isfinite(theirs)
    apart, size = np.abs(ours - theirs)[both], np.abs(theirs)[both]
    if not np.any(apart):
        return 0.0
    absolute, relative = (scatter(name) if study in CHAOTIC else None) or (float(np.max(size)), 0.0)
    return float(np.max(apart / np.maximum(absolute + relative * size, np.finfo(float).tiny)))


def _constants(dataset: xr.Dataset) -> Any:
    """Constants of the function to nine digits, for those computed from a request may differ by rounding."""
    text = dataset.attrs["configuration"]
    return json.loads(text, parse_float=lambda number: f"{float(number):.9g}", parse_constant=str)["constants"]
