"""How the motion of each scene compares with linear stability of steady sliding, and how sure its regime is."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fivcore import Rig
from studies.gallery.stability import study as stability
from studies.motion import regimes, transients
from sweeps import FAILED

# What linear stability answers for.
BELOW = f"below {transients.BAND / 1e3:g} kHz"
VERDICTS = ("agree", "subcritical", "unstable above the band", "quiet though unstable", "no verdict", "failed")
# Below this a regime whose repeat runs differ is called uncertain.
CERTAIN = 0.95
# A mode tells by growing or dying so many times e-fold, between the size of a vibration and what is taken for
# steady, before the last quarter of a run, where that is judged.
TELLING, JUDGED = 10.0, 0.75


def with_verdicts(dataset: xr.Dataset, *, rig: Rig, **_: Any) -> xr.Dataset:
    """Add where steady sliding loses its stability, and each point's verdict."""
    highest, onset = float(dataset["mu"].max()), np.full((2, dataset.sizes["theta"]), np.nan)
    for k, theta in enumerate(dataset["theta"].values):
        if highest > 0.0:
            onset[:, k] = stability.first_growth(rig, float(theta), transients.BAND, highest)
    about = f"lowest friction from which a pair grows {BELOW}, up to the largest friction of the grid"
    codes = xr.Variable(
        dataset["regime"].dims,
        verdicts(dataset),
        {"long_name": "motion against linear stability of steady sliding"},
        {"dtype": "int8", "_FillValue": np.int8(np.iinfo(np.int8).min)},
    )
    whole = dataset.assign(
        onset_mu=("theta", onset[0], {"units": "1", "long_name": about}),
        onset_frequency=("theta", onset[1], {"units": "Hz", "long_name": f"frequency at the {about}"}),
        verdict=codes,
    )
    return transients.with_flags(whole, verdict=VERDICTS)


def verdicts(dataset: xr.Dataset) -> NDArray[np.float32]:
    """The place in VERDICTS of each point's verdict; NaN where it is pending.

    - "agree": it slides steadily and all modes below the band's end decay, or it vibrates and one grows;
    - "subcritical": it vibrates though no mode grows, neither in the band nor, as far as is known, above;
    - "unstable above the band": it vibrates, none in the band grows, but one of those simulated above does;
    - "quiet though unstable": it slides steadily though a mode in the band grows;
    - "no verdict": it is undecided; or stuck, so that steady sliding does not come about; or motion and
      stability differ, but the run is too short for a mode that dies or grows so slowly;
    - "failed".
    """
    kinds = regimes.kinds(dataset)
    vibrates, quiet = regimes.is_of(kinds, *regimes.VIBRATING), regimes.is_of(kinds, regimes.STEADY)
    below, model = (dataset[name].values for name in ("growth_rate", "model_growth_rate"))
    grows, above = below > 0.0, model > 0.0
    time = JUDGED * dataset["duration"].values - dataset["first_slip_time"].values
    tells = np.abs(np.where(grows, below, np.fmax(below, model))) * time >= TELLING
    # The first that holds counts.
    cases: dict[str, Any] = {
        "agree": (vibrates & grows) | (quiet & ~grows),
        "unstable above the band": vibrates & above,
        "quiet though unstable": quiet & tells,
        "subcritical": vibrates & tells,
        "failed": dataset["status"].values == FAILED,
        "no verdict": regimes.is_of(kinds, *transients.REGIMES),
    }
    codes = [np.float32(VERDICTS.index(name)) for name in cases]
    return np.asarray(np.select([*cases.values()], codes, np.float32(np.nan)), dtype=np.float32)


def uncertain(dataset: xr.Dataset) -> NDArray[np.bool_]:
    """Which points have repeat runs in different regimes, and too few in one to be sure of it."""
    differ = dataset["regime_share"].max("kind").values < 1.0
    return np.asarray(differ & (dataset["regime_certainty"].values < CERTAIN))
