"""Differences between a result and the reference in `results/reference`, which runs only read."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from studies.answering.results import configuration

if TYPE_CHECKING:
    from studies.study import Study

# By a part of a variable's name: tolerance of two values of a chaotic motion, absolute and relative; from
# ensembles that differ by the ramp only.
TOLERANCE = {
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
# Variables that a comparison names, those that differ most.
NAMED = 3
# Processors and their BLAS differ by some 1e-12 of the largest value.
ROUNDING = 1e-9


def tolerance(name: str) -> tuple[float, float] | None:
    """Absolute and relative tolerance of a chaotic variable; None if it has no tolerance."""
    # The spread of four runs is as uncertain as it is large, and so is a standard error.
    if name.startswith(("member_", "motion_")) or name.endswith(("_std", "_se")):
        return None
    return next((limits for part, limits in TOLERANCE.items() if part in name), None)


def compared(study: Study, dataset: xr.Dataset, reference: xr.Dataset) -> str:
    """A sentence on the difference between a result and the reference; "" without common points.

    The difference of a variable is the largest at a common point, in units of the variable's largest value or,
    where the motion is chaotic, of its tolerance.
    """
    ours, theirs = (_constants(each) for each in (dataset, reference))
    differ = [name for name in ours if name in theirs and ours[name] != theirs[name]]
    own, runs = (each.sizes.get("member", 1) for each in (dataset, reference))
    if "member" in reference.sizes and own != runs:
        return f"not compared with the reference: it has {runs} realisations, this result has {own}"
    if differ or ours.keys() != theirs.keys():
        return ""
    # Entries without a coordinate, such as onsets, have partners only where there are as many.
    paired = {d for d, size in reference.sizes.items() if d in reference.indexes or dataset.sizes.get(d) == size}
    names = [
        str(name)
        for name, variable in reference.data_vars.items()
        if variable.dtype.kind == "f"
        and name in dataset
        and name != "wall_time"
        and 0 not in (variable.size, dataset[name].size)
        and paired.issuperset(variable.dims)
        and dataset[name].dims == variable.dims
        and (not study.chaotic or tolerance(str(name)))
    ]
    both = xr.align(dataset[names], reference[names], join="inner")
    if not names or 0 in both[0].sizes.values():
        return ""
    differences = {name: _distance(study, name, *(each[name].values for each in both)) for name in names}
    largest = [
        name for name in sorted(differences, key=lambda name: -differences[name])[:NAMED] if differences[name]
    ]
    if not largest:
        return "beside the reference: no difference"
    if max(differences.values()) < ROUNDING:
        return "beside the reference: no difference beyond rounding"
    unit = "the tolerance" if study.chaotic else "the largest value"
    listed = ", ".join(f"{name} {differences[name]:.2g}" for name in largest)
    return f"beside the reference: largest differences, in units of {unit}: {listed}"


def _distance(study: Study, name: str, ours: Any, theirs: Any) -> float:
    """Largest difference of two arrays where both are finite."""
    both = np.isfinite(ours) & np.isfinite(theirs)
    distance, size = np.abs(ours - theirs)[both], np.abs(theirs)[both]
    if not np.any(distance):
        return 0.0
    absolute, relative = (tolerance(name) if study.chaotic else None) or (float(np.max(size)), 0.0)
    return float(np.max(distance / np.maximum(absolute + relative * size, np.finfo(float).tiny)))


def _constants(dataset: xr.Dataset) -> dict[str, Any]:
    """Constants to nine digits; constants computed from a request may differ by rounding."""
    values = configuration(dataset).get("constants", {})
    text = json.dumps(values)
    rounded: dict[str, Any] = json.loads(text, parse_float=lambda n: f"{float(n):.9g}", parse_constant=str)
    return rounded
