"""The motion at the points of a result beside the prediction by linear stability of steady sliding."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.motion import regimes, run
from studies.motion.stability import with_flags
from sweeps import FAILED

# What linear stability answers for.
BELOW = f"below {run.BAND / 1e3:g} kHz"
# Linear prediction and motion, and how a reader has each.
VERDICTS = {
    "agree": "prediction correct",
    "subcritical": f"missed: vibrates though stable {BELOW} and above",
    "unstable above the band": f"missed: vibrates, stable {BELOW}, unstable above",
    "quiet though unstable": "false alarm: slides steadily though unstable",
    "no verdict": "not compared: undecided, stuck, or too short for modes that decay or grow slowly",
    "failed": "failed",
}
# Below this a regime whose realisations differ is called uncertain.
CERTAIN = 0.95
# A mode decides by growing or decaying so many times e-fold, between the size of a vibration and what counts as
# steady, before the last quarter of a run, where that is judged.
E_FOLDS, JUDGED = 10.0, 0.75


def with_verdicts(dataset: xr.Dataset) -> xr.Dataset:
    """Add the comparison of the motion of each point with linear stability."""
    about, codes = {"long_name": "motion against linear stability of steady sliding"}, compare_linear(dataset)
    stored = {"dtype": "int8", "_FillValue": np.int8(np.iinfo(np.int8).min)}
    verdict = xr.Variable(dataset["regime"].dims, codes, about, stored)
    return with_flags(dataset.assign(verdict=verdict), tuple(VERDICTS), "verdict")


def compare_linear(dataset: xr.Dataset) -> NDArray[np.float32]:
    """The index in VERDICTS of each point, the first that applies; NaN where the point is pending.

    A difference does not count where the run is too short for so small a growth rate, nor where the contact
    sticks, so that there is no steady sliding.
    """
    kinds = regimes.kinds(dataset)
    vibrates, steady = regimes.is_of(kinds, *regimes.VIBRATING), regimes.is_of(kinds, regimes.STEADY)
    below, model = (dataset[name].values for name in ("growth_rate", "model_growth_rate"))
    grows, above = below > 0.0, model > 0.0
    time = JUDGED * dataset["duration"].values - dataset["first_slip_time"].values
    decides = np.abs(np.where(grows, below, np.fmax(below, model))) * time >= E_FOLDS
    cases: dict[str, Any] = {
        "agree": (vibrates & grows) | (steady & ~grows),
        "unstable above the band": vibrates & above,
        "quiet though unstable": steady & decides,
        "subcritical": vibrates & decides,
        "failed": dataset["status"].values == FAILED,
        "no verdict": regimes.is_of(kinds, *run.REGIMES),
    }
    codes = [np.float32([*VERDICTS].index(name)) for name in cases]
    return np.asarray(np.select([*cases.values()], codes, np.float32(np.nan)), dtype=np.float32)


def uncertain(dataset: xr.Dataset) -> NDArray[np.bool_]:
    """Mark points whose realisations are in different regimes, none of them frequent enough to be certain."""
    differ = dataset["regime_share"].max("kind").values < 1.0
    return np.asarray(differ & (dataset["regime_certainty"].values < CERTAIN))
