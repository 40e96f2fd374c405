"""Steady sliding that is unstable only above the band, which stability within the band does not show."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from fivcore import SceneError, growing_frequencies
from studies.declaring.parameters import FRICTION, RIG, RUN, SCENE
from studies.motion.run import BAND
from studies.motion.scenes import normalised, rig_of, scene_of
from sweeps import DONE

NAME = "growing_above_band"
MODEL = ("cutoff", "numerical_damping")


def with_growth_above(dataset: xr.Dataset, structure: Any) -> xr.Dataset:
    """Add the lowest frequency of an unstable mode above the band to each point of a result of scenes.

    It is NaN where all modes are stable, where a mode within the band is unstable, and where a point is not
    computed. A result that lacks a parameter of a scene, or in which friction is followed, gets no such variable.
    """
    status, found = dataset["status"], np.full(dataset["status"].size, np.nan)
    if not all(name in dataset.coords and {*dataset[name].dims} <= {*status.dims} for name in SCENE):
        return dataset
    parameters = SCENE | FRICTION | RIG | {name: RUN[name] for name in MODEL}
    columns = {
        name: dataset[name].broadcast_like(status).transpose(*status.dims).values.ravel()
        if name in dataset.coords
        else np.full(status.size, parameter.default)
        for name, parameter in parameters.items()
    }
    scaled = normalised(columns, status.size, steady=True)
    names = [name for name in parameters if structure is None or name not in RIG]
    rows = list(zip(*(scaled.get(name, columns[name]).tolist() for name in names), strict=True))
    known: dict[Any, float] = {}
    for k in np.flatnonzero(status.values.ravel() == DONE):
        row = tuple("" if each != each else each for each in rows[k])  # NaN equals nothing
        if row not in known:
            known[row] = _above(dict(zip(names, rows[k], strict=True)) | {"structure": structure})
        found[k] = known[row]
    text = f"lowest frequency of growing sliding, where that is above {BAND / 1e3:g} kHz"
    return dataset.assign({NAME: (status.dims, found.reshape(status.shape), {"units": "Hz", "long_name": text})})


def _above(numbers: dict[str, Any]) -> float:
    cutoff, damping = (numbers.pop(name) for name in MODEL)
    try:
        growing = growing_frequencies(
            scene_of(numbers), cutoff=None if cutoff is None or np.isnan(cutoff) else cutoff,
            numerical_damping=damping,
        )  # fmt: skip
    except SceneError:
        return np.nan
    return float(growing[0]) if len(growing) and growing[0] > BAND else np.nan


def told(dataset: xr.Dataset) -> Iterator[str]:
    """Yield a sentence on the points whose only unstable modes lie above the band."""
    above = dataset[NAME].values if NAME in dataset else np.empty(0)
    if count := int(np.isfinite(above).sum()):
        line = f"At {count} of {above.size} points sliding grows only above {BAND / 1e3:g} kHz, from"
        line += f" {np.nanmin(above) / 1e3:.3g} kHz on, which stability in the band does not show ({NAME})"
        numbers = {name: dataset[name].item() for name in RIG if name in dataset.coords and not dataset[name].ndim}
        if len(numbers) == len(RIG):
            line += f"; the beam model holds up to {rig_of(numbers).valid_up_to / 1e3:.3g} kHz"
        yield f"{line}."
