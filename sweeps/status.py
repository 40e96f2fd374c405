"""Progress of a run, as the run reports it, and as other processes read it from its store."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sweeps.errors import UNREADABLE
from sweeps.grid import INTERPOLATED_FLAG, STATUS_FLAGS
from sweeps.storage.assemble import Table
from sweeps.storage.existing import opened, sources_of, unfinished
from sweeps.storage.store import Store, read_state


@dataclass(frozen=True)
class Snapshot:
    """The state of a run.

    Attributes
    ----------
    todo, done, failed : int
        Computations that the run requests, finished ones, also of earlier runs, and this run's that failed.
    elapsed, rate, left : float
        s since the run began; computations a second, 0 until measured; s to the end, at first the plan's, or NaN.
    now, stopping : tuple of str, bool
        The batches that are being computed; whether the run only finishes those that have begun.
    """

    todo: int
    done: int
    failed: int
    elapsed: float
    rate: float
    left: float
    now: tuple[str, ...]
    stopping: bool


Progress = Callable[[Snapshot], None]


@dataclass(frozen=True)
class Status:
    """The state of a store.

    Attributes
    ----------
    file, state : str
        State: "running", "interrupted", "incomplete" (points of its grid were never requested) or "complete".
    points, done, failed, pending, skipped, interpolated : int
        Points of the file's grid; by their status, of equal points only one until the file is whole.
    run : dict
        Of a run: `pid`, `host`, `started`, and the values of its last `Snapshot`; empty without one.
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
    """The state of a sweep's file: finished, running or interrupted.

    A FileNotFoundError or ValueError if there is no such file, or it is not the result of a sweep.
    """
    store = Store(path)
    running = [each for each in (store, *store.shares()) if each.is_locked()]
    run = read_state(running[0].progress) if running else {}
    codes, state = None, "interrupted"
    # Without a usable manifest the run has finished, perhaps meanwhile, or the file explains what is wrong.
    with suppress(*UNREADABLE):
        if (manifest := unfinished(store)) is not None:
            codes = Table(manifest, sources_of(store, manifest)).status
            points, first = codes.size, manifest.representative
            codes = codes if first is None else codes[(first < 0) | (first == np.arange(points))]
    if codes is None:
        points = (codes := opened(path, load=False)["status"].values).size
        state = "incomplete" if np.any(codes == 0) else "complete"
    words = STATUS_FLAGS | INTERPOLATED_FLAG
    counts = {word: int(np.count_nonzero(codes == code)) for code, word in words.items()}
    return Status(file=str(path), state="running" if running else state, points=points, run=run, **counts)


def check_free(path: str | Path) -> None:
    """Raise a LockedError that names the run if a run is writing the store."""
    if (store := Store(path)).is_locked():
        raise store.locked_error()
