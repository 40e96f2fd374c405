"""The cells of a grid's values: each reaches half-way to its neighbours."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# From this ratio of its ends on an axis is logarithmic.
WIDE = 20.0


def is_logarithmic(values: Any) -> bool:
    """Whether ascending values read better on a logarithmic axis: they span much, and their steps grow."""
    wide = values[0] > 0.0 and values[-1] >= WIDE * values[0]
    return bool(wide and (len(values) == 2 or values[-1] - values[-2] >= 2.0 * (values[1] - values[0])))


def edges(values: NDArray[Any]) -> NDArray[Any]:
    """Ends of the cell of each ascending value, half-way to its neighbours; in logarithms on such an axis."""
    if len(values) == 1:
        reach = 0.5 * abs(float(values[0])) or 0.5
        return np.array([values[0] - reach, values[0] + reach])
    if is_logarithmic(values):
        return np.asarray(np.exp(_half_way(np.log(values))))
    return _half_way(values)


def _half_way(values: NDArray[Any]) -> NDArray[Any]:
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])
