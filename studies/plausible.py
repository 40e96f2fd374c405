"""Values that a rig like this hardly has: most often a unit was forgotten. They raise a warning, not an error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

# Usual ranges in the units of each number; of V, theta by size. 0 is usual for all.
USUAL: Mapping[str, tuple[float, float]] = {
    "V": (1e-7, 0.5),
    "theta": (0.2, 80.0),
    "mu": (0.0, 10.0),
    "F": (1e-3, 1e4),
    "contact_position": (1e-3, 2.0),
    "head_mass": (1e-3, 1e3),
    "d1": (1e-6, 1e4),
    "d2": (1e-12, 1e-4),
    "length": (5e-3, 2.0),
    "width": (1e-3, 0.5),
    "thickness": (1e-4, 0.1),
    "young_modulus": (1e8, 1.5e12),
    "density": (100.0, 25e3),
}
# What a value out of range looks like.
HINTS = {
    "V": "mm/s without their unit?",
    "theta": "radians? it is in degrees",
    "young_modulus": "GPa without their unit?",
    "length": "mm without their unit?",
    "width": "mm without their unit?",
    "thickness": "mm without their unit?",
    "contact_position": "mm without their unit?",
    "density": "g/cm3 without their unit?",
}
# A beam at least so many times as long as it is thick has Euler and Bernoulli's stiffness.
SLENDER = 8.0


class UnusualWarning(UserWarning):
    """A value that a rig like this hardly has."""


def unusual(values: Mapping[str, Any], units: Mapping[str, str], names: Any = None) -> list[str]:
    """Find values of axes and settings that are unusual, and explain each in a line.

    Parameters
    ----------
    values : mapping of str to array_like
        Values of axes and settings, by name.
    units : mapping of str to str
    names : container of str, optional
        Names that are checked; by default all.
    """
    lines = []
    for name, value in values.items():
        kind = name.removeprefix("p1_").removeprefix("p2_")
        sizes = np.abs(np.atleast_1d(np.asarray(value))) if kind in USUAL else np.zeros(0)
        if not len(sizes) or sizes.dtype.kind not in "iuf" or (names is not None and name not in names):
            continue
        low, high = USUAL[kind]
        # A range may begin near zero.
        largest = sizes.max()
        if largest > high or 0.0 < largest < low:
            unit = "" if units.get(name, "1") == "1" else f" {units[name]}"
            line = f"{name} = {largest:g}{unit} is unusual: {low:g} to {high:g}{unit} is usual"
            lines.append(f"{line}; {HINTS[kind]}" if kind in HINTS else line)
    for beam in ("p1", "p2"):
        sides = [f"{beam}_length", f"{beam}_thickness"]
        if all(side in values for side in sides) and (names is None or any(side in names for side in sides)):
            ratio = float(np.min(values[sides[0]]) / np.max(values[sides[1]]))
            if ratio < SLENDER:
                lines.append(
                    f"{beam}_length / {beam}_thickness = {ratio:.3g} is unusual: below {SLENDER:g} a beam is "
                    "softer by shear, which this model has not"
                )
    return lines
