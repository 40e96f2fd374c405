"""What is kept of a run that is recorded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fivcore.drive import Canonical
from fivcore.kernel import Array


class Record:
    """Series of a run, gathered column by column in the scene's own units.

    Seconds of motion at every step are tens of MB: they are held once, whatever else is at work meanwhile.
    """

    def __init__(self, canonical: Canonical) -> None:
        F, along = canonical.load, canonical.load * canonical.sense
        # As the columns of `Chunk.rows` come; the time is the same in all units.
        self._factors = {
            "time": 1.0,
            "velocity_B": along,
            "normal_force": F,
            "tangential_force": along,
            "slip_velocity": along,
        }
        self._pieces: dict[str, list[NDArray[Any]]] = {name: [] for name in (*self._factors, "state")}

    def add(self, rows: Array) -> None:
        """Take the next rows."""
        if len(rows):
            for column, (name, factor) in enumerate(self._factors.items()):
                self._pieces[name].append(factor * rows[:, column])
            self._pieces["state"].append(rows[:, -1].astype(np.int8))

    def whole(self) -> dict[str, Any]:
        """Each series in one piece; nothing where nothing was recorded."""
        # One by one, so that of all but one there is only one copy.
        return {name: np.concatenate(pieces) for name in [*self._pieces] if (pieces := self._pieces.pop(name))}
