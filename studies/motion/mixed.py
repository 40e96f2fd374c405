"""Realisations that follow different motions: their mean and its standard error describe none of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr
from scipy.special import fdtrc

from fivcore.transient.observe import FEWEST
from studies import labels
from sweeps import DONE

# Quantities by which motions are told apart, and the probability of telling a single motion for several anywhere
# in a result.
QUANTITIES, LEVEL = ("stick_fraction", "velocity_rms"), 0.01
# Points that are named.
NAMED = 3


def mixed(dataset: xr.Dataset) -> xr.DataArray:
    """At which points the realisations differ by more than their standard errors explain.

    With the standard deviation s of n realisations and the mean's standard error e, s^2 / (n e^2) has Fisher's F
    distribution where all follow one motion, with n - 1 and at least n FEWEST degrees of freedom.
    """
    n, found = float(dataset["members"]), xr.zeros_like(dataset["status"], dtype=bool)
    for name in QUANTITIES:
        spread, error = dataset[f"{name}_std"].astype(float), dataset[f"{name}_se"].astype(float)
        ratio = (spread / error.where(error > 0.0, 1e-300)) ** 2 / n
        known = (spread > 0.0) & error.notnull()
        chance = fdtrc(n - 1.0, FEWEST * n, ratio.where(known, 0.0))
        found = found | (chance < LEVEL / (len(QUANTITIES) * max(found.size, 1)))
    return found & (dataset["status"] == DONE)


def told(dataset: xr.Dataset) -> Iterator[str]:
    """One line on the points whose realisations follow different motions."""
    needed = {"members", *(f"{name}_{part}" for name in QUANTITIES for part in ("std", "se"))}
    if not needed <= {*dataset.variables} or dataset["members"].ndim or not float(dataset["members"]) > 1.0:
        return
    places = np.argwhere(mixed(dataset).values)
    if len(places):
        dims = dataset["status"].dims
        points = [dataset.isel(dict(zip(dims, place, strict=True))) for place in places[:NAMED]]
        each = [", ".join(labels.named(str(dim), point[dim]) for dim in dims) for point in points]
        more = f"; and {len(places) - NAMED} more" * (len(places) > NAMED)
        yield (
            f"At {len(places)} of {dataset['status'].size} points the realisations follow different motions, so"
            f" that a mean describes none of them: {'; '.join(each)}{more}."
        )
