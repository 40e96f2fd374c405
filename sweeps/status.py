"""How far a run is: counted in one place, reported to a callback, and written to a file for other processes."""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from sweeps.errors import UNREADABLE
from sweeps.grid import INTERPOLATED_FLAG, STATUS_FLAGS
from sweeps.storage.assemble import Table
from sweeps.storage.existing import opened, sources_of, unfinished
from sweeps.storage.shares import shares_of
from sweeps.storage.store import Store, owner, read_state, write_state

# The file is written at most this often, and a rate counts once it was measured for so long, s.
INTERVAL = 1.0
# Number of running batches that a snapshot describes.
SHOWN = 4


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


class Monitor:
    """Counts batches as they begin and end, and reports snapshots; `rate` is the expected one, NaN if unknown."""

    def __init__(self, cached: int, todo: int, progress: Progress | None, file: Path | None) -> None:
        self.todo, self.done, self.failed, self.stopping, self.rate = cached + todo, cached, 0, False, math.nan
        self._progress, self._file, self._owner = progress, file, owner()
        self._begun, self._written = time.monotonic(), -math.inf
        self._cached, self._since = cached, (cached, self._begun)  # the first batch, which compiles, is not timed
        self._now: dict[int, str] = {}
        self._reporting = False

    def begin(self, number: int, what: str) -> None:
        """Note that a batch begins."""
        self._now[number] = what
        self._report()

    def end(self, number: int, done: int = 0, failed: int = 0) -> None:
        """Note that a batch has ended, or was cancelled."""
        del self._now[number]
        if self.done == self._cached:
            self._since = self.done + done, time.monotonic()
        self.done, self.failed = self.done + done, self.failed + failed
        self._report()

    def stop(self) -> None:
        """Note that the run stops. Called by a signal's handler, which must not raise."""
        self.stopping = True
        # A report that is interrupted sees the flag at its end.
        if not self._reporting:
            with suppress(Exception):
                self._report()

    def _snapshot(self) -> Snapshot:
        now = time.monotonic()
        elapsed, counted = max(now - self._begun, 1e-9), now - self._since[1]
        rate = (self.done - self._since[0]) / max(counted, INTERVAL) or (self.done - self._cached) / elapsed
        left = (self.todo - self.done) / rate if rate > 0.0 else math.nan
        if self.rate > 0.0 and (counted < INTERVAL or self.done == self._cached):
            rate, left = 0.0, (self.todo - self.done) / self.rate
        batches = tuple(islice(self._now.values(), SHOWN))
        return Snapshot(self.todo, self.done, self.failed, elapsed, rate, left, batches, self.stopping)

    def _report(self) -> None:
        self._reporting = True
        try:
            snapshot = self._snapshot()
            if self._progress is not None:
                self._progress(snapshot)
            if time.monotonic() - self._written >= INTERVAL:
                self.write()
        finally:
            self._reporting = False
        if self.stopping and not snapshot.stopping:
            self._report()

    def write(self) -> None:
        """Write the present state."""
        self._written = time.monotonic()
        if self._file is not None:
            write_state(self._file, asdict(self._snapshot()) | self._owner)


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
    running = [each for each in (store, *shares_of(store)) if each.is_locked()]
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
    """Refuse a store that a run is writing: a LockedError names that run."""
    if (store := Store(path)).is_locked():
        raise store.locked_error()
