"""A plan as data: what will be done, and its report. Nothing here decides or executes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sweeps.compute.batch import Task
from sweeps.grid import Embedding
from sweeps.plan.declaration import Declaration
from sweeps.storage.manifest import Manifest
from sweeps.storage.sources import Source


@dataclass(frozen=True, eq=False, kw_only=True)
class Selection:
    """Which computations are requested, and which of them are still to be done.

    Attributes
    ----------
    due : ndarray of bool, (points of the file,)
        Where there is something to compute: True at the point that is computed for all of its copies.
    wanted, distinct, cached, failed, todo : int
        Points requested, different computations of these, those at hand, those of them that failed, those to do.
    seconds : float
        Computing time that earlier runs tell for what is to do; NaN if they tell nothing.
    damaged : tuple of str
        Parts that cannot be used; what was in them is to do.
    """

    due: NDArray[np.bool_]
    wanted: int
    distinct: int
    cached: int
    failed: int
    todo: int
    seconds: float
    damaged: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PlanData(Selection):
    """What a sweep will cost and do. Its repr is the report.

    What is selected of a refined sweep is what the results so far make worth computing.

    Attributes
    ----------
    sweep : Declaration
    store : Path or None
        The netCDF file.
    points, skipped : int
        Points of the grid, and those needing nothing.
    bytes : int
        Expected size of the file.
    manifest : Manifest
        The file that will be.
    task : Task
        What is done to every batch.
    embedding : Embedding
        Where the points of the sweep's grid lie in the file's.
    requested : ndarray of bool, (points of the file,)
        The sweep's own points that are not skipped.
    sources : tuple of Source
        Where what is at hand is kept.
    stamp : tuple
        The state of the store when this was planned.
    whole : bool
        Whether the file is already all that is requested.
    versions : str
        Which libraries have other versions than those that made what is at hand; "" if none has.
    """

    sweep: Declaration
    store: Path | None
    points: int
    skipped: int
    bytes: int
    manifest: Manifest
    task: Task
    embedding: Embedding
    requested: NDArray[np.bool_]
    sources: tuple[Source, ...]
    stamp: tuple[Any, ...]
    whole: bool
    versions: str

    @property
    def most_seconds(self) -> float:
        """Estimated time on one core; of a refined sweep if every point were requested in the end."""
        if self.sweep.refinement is None or not self.todo:
            return self.seconds
        return self.seconds / self.todo * (self.points - self.skipped - self.cached)

    def __repr__(self) -> str:
        time = "unknown: no earlier run tells" if math.isnan(self.seconds) else duration(self.seconds)
        shape = " x ".join(f"{d} {n}" for d, n in zip(self.sweep.grid.dims, self.sweep.grid.shape, strict=True))
        rows = [
            ("sweep", self.sweep.name),
            ("grid", shape),
            ("points", f"{self.points}"),
            ("skipped", f"{self.skipped}"),
            ("refined", self._chosen()),
            ("distinct", f"{self.distinct}"),
            ("cached", f"{self.cached}" + (f", {self.failed} of them failed" if self.failed else "")),
            ("to do", f"{self.todo}"),
            ("file size", size(self.bytes)),
            ("estimated time", f"{time} on one core" if self.seconds > 0 else time),
            ("at most", f"{duration(most)} for all points" if (most := self.most_seconds) > self.seconds else ""),
            ("file", str(self.store or "")),
            (
                "versions",
                self.versions and f"{self.versions}; what is there is kept, for it agrees but for rounding",
            ),
            *(("damaged", f"{name}: its points are computed again") for name in self.damaged),
        ]
        return "\n".join(f"{name:<15} {text}" for name, text in rows if text)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    def _chosen(self) -> str:
        """How far a refined sweep has got; nothing of any other."""
        if self.sweep.refinement is None:
            return ""
        text = f"to {self.wanted} points ({100.0 * self.wanted / self.points:.3g} %)"
        return f"{text} so far; what they show may ask for more" if self.todo else text


def duration(seconds: float) -> str:
    """Seconds for a reader."""
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"


def size(count: float) -> str:
    """Bytes for a reader."""
    for unit in ("B", "kB", "MB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} GB"
