"""Rigs like the paper's with scattered numbers, for `flutter_onsets_many` and one at a time."""

from __future__ import annotations

import numpy as np

from fivcore import Beam, Rig
from fivcore.stability.many import BEAM, OWN


def scattered(n: int, seed: int = 0, width: float = 0.2) -> dict[str, np.ndarray]:
    """Numbers within `width` of the paper's, and theta from -20 to 40 degrees."""
    rng, rig = np.random.default_rng(seed), Rig()
    middle = {name: getattr(rig, name) for name in OWN}
    middle |= {f"{beam}_{name}": getattr(getattr(rig, beam), name) for beam in ("p1", "p2") for name in BEAM}
    numbers = {name: value * rng.uniform(1.0 - width, 1.0 + width, n) for name, value in middle.items()}
    return numbers | {"theta": rng.uniform(-20.0, 40.0, n)}


def rig_of(numbers: dict[str, np.ndarray], row: int) -> Rig:
    """The rig of one row."""
    given, rig = {name: float(values[row]) for name, values in numbers.items()}, Rig()
    beams = [
        Beam(*(given[f"{beam}_{name}"] for name in BEAM), elements=getattr(rig, beam).elements)
        for beam in ("p1", "p2")
    ]
    return Rig(*beams, **{name: given[name] for name in OWN})
