"""The smallest knock at the contact that starts vibration where steady sliding is stable."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore import Scene, checks
from studies.declaring.parameters import Parameter
from studies.motion import regimes, starts
from studies.motion.jobs import each_scene
from studies.motion.stability import linear_stability
from sweeps import Variable

# Shares of the largest knock that are tried in turn: starts of vibration may fill several intervals.
SCAN = 2.0 ** np.arange(-12.0, 0.125, 0.25)
# Factors of a knock that differ from 1 in the ninth digit: they change the regime only in chaotic transients.
NEARBY = 1.0 + 1e-9 * np.arange(1.0, 5.0)
PARAMETERS = {
    "largest_knock": Parameter(
        1e-3, "s", "largest knock per load, N s per N; negative: knocks that pull P1 away", common=True
    ),
    "resolution": Parameter(0.02, "1", "largest relative width of the interval that holds it", common=True),
} | starts.SETTINGS
OUTPUTS = {
    "knock_threshold": Variable(
        "N s", "smallest impulse on P1 at the contact, positive onto P2, that starts vibration", scale="load"
    ),
    "knock_threshold_se": Variable(
        "N s",
        "standard error of the knock threshold: width of the interval over root 12, and scatter of searches",
        scale="load",
    ),
}


def threshold(scene: Scene, largest_knock: float, resolution: float, options: dict[str, Any]) -> dict[str, float]:
    """Smallest knock that starts vibration: the middle of its bracket, and its standard error.

    Both are NaN where sliding is unstable, where the largest knock starts no vibration, and where the weakest
    knock of SCAN starts it. The search misses a threshold between two knocks of SCAN that start none. Where
    transients are chaotic, knocks that differ in the ninth digit lead to different motions: the search is then
    repeated with such knocks, and the result is the mean of the thresholds found, with their scatter in the
    standard error.
    """
    nothing = dict.fromkeys(OUTPUTS, np.nan)
    stability = linear_stability(scene, options["cutoff"], options["numerical_damping"])
    if np.fmax(stability["growth_rate"], stability["model_growth_rate"]) > 0.0:
        return nothing
    tried = scene.F * largest_knock * SCAN

    def vibrate(knocks: NDArray[np.float64]) -> NDArray[np.bool_]:
        labels = starts.labels_of(scene, starts.knocked(scene, *knocks), options)
        return regimes.is_of(labels, *regimes.VIBRATING)

    def search(factor: float) -> tuple[float, float]:
        first = next((k for k, knock in enumerate(tried) if vibrate(factor * tried[k : k + 1])[0]), 0)
        low, high = tried[first - 1 : first + 1] if first else (np.nan, np.nan)
        while abs(high - low) > resolution * abs(high):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if vibrate(np.array([factor * middle]))[0] else (middle, high)
        return low, high

    found = [search(1.0)]
    if np.isnan(found[0][0]):
        return nothing
    if any(vibrate(found[0][0] * NEARBY)) or not all(vibrate(found[0][1] * NEARBY)):
        found += [search(factor) for factor in NEARBY]
    low, high = np.array([ends for ends in found if ends[0] == ends[0]]).T
    middles, width = 0.5 * (low + high), np.abs(high - low).mean()
    scatter = middles.std(ddof=1) / np.sqrt(len(middles)) if len(middles) > 1 else 0.0
    return dict(zip(OUTPUTS, (middles.mean(), np.hypot(width / np.sqrt(12.0), scatter)), strict=True))


def knocks(scenes: Sequence[Scene], largest_knock: float, resolution: float, **options: Any) -> dict[str, Any]:
    """`threshold` of each scene."""
    return each_scene(scenes, lambda scene: threshold(scene, largest_knock, resolution, options))


def check(largest_knock: Any, resolution: Any, **others: Any) -> None:
    """Refuse parameters with which no threshold can be computed."""
    checks.number("largest_knock", largest_knock, "a number from 1e-12 to 1e6 s, or minus that",
                  lambda x: 1e-12 <= abs(x) <= 1e6)  # fmt: skip
    checks.between("resolution", resolution, 1e-6, 1.0, "1")
    starts.check(**{name: others[name] for name in ("V", "F", *starts.SETTINGS)})
