"""The rule by which a number is a value of an axis."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

# How far a number may be from the axis's value nearest to it: this share of that value's distance from its own
# nearest neighbour; on an axis with one value, this share of the value.
OF_SPACING, OF_VALUE = 1e-3, 1e-6


def nearest(values: ArrayLike, number: float) -> tuple[Any, bool]:
    """The value of an axis nearest to a number, and whether it is near enough to be meant.

    0.1 + 0.2 finds 0.3, and a value in six digits is found again, on even axes and on logarithmic ones.
    """
    ordered = np.unique(np.asarray(values))
    away = np.abs(ordered.astype(float) - number)
    place = int(np.argmin(away))
    gaps = np.diff(ordered[max(place - 1, 0) : place + 2].astype(float))
    allowed = OF_SPACING * gaps.min() if len(gaps) else OF_VALUE * abs(float(ordered[place]))
    return ordered[place], bool(away[place] <= allowed)
