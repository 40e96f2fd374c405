"""How far a sweep is, as another process sees it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sweeps.errors import UNREADABLE
from sweeps.grid import INTERPOLATED_FLAG, STATUS_FLAGS
from sweeps.storage.existing import sources_of
from sweeps.storage.lock import is_locked, taken
from sweeps.storage.manifest import Manifest
from sweeps.storage.merge import surveyed
from sweeps.storage.netcdf import open_results
from sweeps.storage.store import Store
from sweeps.watch.monitor import read_state


@dataclass(frozen=True)
class Status:
    """The state of a store.

    Attributes
    ----------
    file : str
    state : str
        "running", "interrupted" or "complete".
    points, done, failed, pending, skipped, interpolated : int
        Points of the file's grid, and how many are in which state.
    run : dict
        Of a run: `pid`, `host`, `started`, and once it is under way what a `Snapshot` holds; empty if there is
        none.
    """

    file: str
    state: str
    points: int
    done: int
    failed: int
    pending: int
    skipped: int
    interpolated: int
    run: dict[str, Any]


def status(path: str | Path) -> Status:
    """The state of a sweep's file, whole, running or interrupted.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it is not the result of a sweep.
    """
    store = Store(path)
    running = is_locked(store)
    run = read_state(store.progress) if running else {}
    try:
        manifest = Manifest.load(store.manifest)
        codes = surveyed(manifest, sources_of(store, manifest)).status
        state = "running" if running else "interrupted"
    except UNREADABLE:
        # There is none, or the run has finished meanwhile.
        codes = open_results(path)["status"].values
        state = "running" if running else "complete"
    words = STATUS_FLAGS | INTERPOLATED_FLAG
    counts = {word: int(np.count_nonzero(codes == code)) for code, word in words.items()}
    return Status(file=str(path), state=state, points=codes.size, run=run, **counts)


def check_free(path: str | Path) -> None:
    """Refuse a store that a run is writing.

    Raises
    ------
    LockedError
        Naming that run.
    """
    store = Store(path)
    if is_locked(store):
        raise taken(store)
