"""Probability of instability of uncertain rigs, and the Sobol indices of their lowest onset."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from fivcore import Rig
from studies.declaring.parameters import RIG, rig_numbers
from studies.motion import uncertainty
from studies.motion.uncertainty import MU_MAX, USUAL
from sweeps import Variable

OUTPUTS = {
    "probability_unstable": ("1", "probability of instability", "mu"),
    "nominal_unstable": Variable("1", "nominal stability", ("mu",), "int8", flags={0: "stable", 1: "unstable"}),
    "nominal_onset_mu": ("1", "lowest onset mu of the nominal rig"),
    "nominal_onset_frequency": ("Hz", "frequency at the nominal rig's lowest onset"),
    "onset_mu": Variable("1", "lowest onset mu of a rig", ("sample",), digits=6),
    "onset_frequency": Variable("Hz", "frequency at a rig's lowest onset", ("sample",), digits=6),
    "sobol_first": ("1", "first Sobol index of the lowest onset", "parameter"),
    "sobol_total": ("1", "total Sobol index of the lowest onset", "parameter"),
    "sobol_first_se": ("1", "standard error of the first Sobol index", "parameter"),
    "sobol_total_se": ("1", "standard error of the total Sobol index", "parameter"),
}


def probabilities(
    rig: Rig, theta: Any, mu: Any, samples: int, sobol_samples: int, seed: int, distributions: Mapping[str, str]
) -> dict[str, Any]:
    """The outputs at each inclination, for the same rigs; the indices of a certain parameter are 0."""
    texts = distributions or uncertainty.usual(rig_numbers(rig))
    draws, uncertain = uncertainty.draws(texts, samples, seed), uncertainty.distributions(texts)
    places, rows = [list(USUAL).index(name) for name in uncertain], []
    for angle in theta:
        nominal, onsets = (uncertainty.onsets(rig, {"theta": angle, **numbers}) for numbers in ({}, draws))
        indices, lowest = np.zeros((4, len(USUAL))), partial(_lowest, rig, angle)
        indices[:, places] = uncertainty.sobol_indices(lowest, uncertain, sobol_samples, seed)
        unstable = onsets.unstable(mu).mean(axis=0), nominal.unstable(mu)[0]
        first = np.ravel(uncertainty.lowest(nominal, np.nan))
        rows.append((*unstable, *first, *uncertainty.lowest(onsets, np.nan), *indices))
    return dict(zip(OUTPUTS, map(np.array, zip(*rows, strict=True)), strict=True))


def _lowest(rig: Rig, theta: float, numbers: Mapping[str, Any]) -> np.ndarray:
    """The lowest onset of many rigs; MU_MAX for those without one."""
    return uncertainty.lowest(uncertainty.onsets(rig, {"theta": theta, **numbers}), MU_MAX)[0]


def with_draws(dataset: xr.Dataset, texts: Mapping[str, str], seed: int) -> xr.Dataset:
    """Add Wilson's interval of the probability, and the draws as coordinates."""
    share, count = dataset["probability_unstable"], dataset.sizes["sample"]
    for end, values in zip(("low", "high"), uncertainty.wilson(share.values, count), strict=True):
        text = f"{end} end of Wilson's 95 % interval of probability_unstable"
        dataset[f"probability_{end}"] = (share.dims, values, {"units": "1", "long_name": text})
    draws = uncertainty.draws(texts, count, seed)
    for name, distribution in uncertainty.distributions(texts).items():
        about = {"units": RIG[name].units, "long_name": RIG[name].text, "distribution": distribution.text}
        dataset = dataset.assign_coords({name: ("sample", draws[name], about | {"truncated": distribution.cut})})
    return dataset
