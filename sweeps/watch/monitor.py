"""How far a run is: counted in one place, told to whoever listens, and left in a file for other processes."""

from __future__ import annotations

import json
import math
import os
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

from sweeps.errors import UNREADABLE
from sweeps.storage.checked import check_regular

# The file is written at most this often, s.
INTERVAL = 1.0
# What a file holds, by type.
OWNER = {"pid": int, "host": str, "started": str}
COUNTS, TIMES = ("todo", "done", "failed"), ("elapsed", "rate", "left")
SNAPSHOT: dict[str, Any] = {**dict.fromkeys(COUNTS, int), **dict.fromkeys(TIMES, (int, float)), "now": list}
# So many of the batches under way are described.
SHOWN = 4


@dataclass(frozen=True)
class Snapshot:
    """The state of a run.

    Attributes
    ----------
    todo, done, failed : int
        Computations to do in all, those done, and those of them that failed.
    elapsed : float
        s since the run began.
    rate : float
        Computations a second.
    left : float
        s to expect; NaN while nothing is known.
    now : tuple of str
        The batches under way.
    stopping : bool
        Whether the run has been told to stop and finishes what is under way.
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
    """Counts batches as they begin and end, and tells of it."""

    def __init__(self, todo: int, progress: Progress | None, file: Path | None) -> None:
        self.todo, self.done, self.failed, self.stopping = todo, 0, 0, False
        self._progress, self._file, self._owner = progress, file, owner()
        self._begun, self._written = time.monotonic(), -math.inf
        self._now: dict[int, str] = {}
        self._telling = False

    def begin(self, number: int, what: str) -> None:
        """A batch is under way."""
        self._now[number] = what
        self._tell()

    def end(self, number: int, done: int = 0, failed: int = 0) -> None:
        """A batch has ended, or has been taken back with nothing done."""
        del self._now[number]
        self.done += done
        self.failed += failed
        self._tell()

    def stop(self) -> None:
        """The run has been told to stop. Called by a signal's handler, which must not raise."""
        self.stopping = True
        # Whoever is telling just now sees the flag when that is done.
        if not self._telling:
            with suppress(Exception):
                self._tell()

    def close(self) -> None:
        """Leave the last state in the file."""
        self._write(self._snapshot())

    def _snapshot(self) -> Snapshot:
        elapsed = time.monotonic() - self._begun
        rate = self.done / elapsed if elapsed > 0.0 else 0.0
        left = (self.todo - self.done) / rate if rate > 0.0 else math.nan
        now = tuple(islice(self._now.values(), SHOWN))
        return Snapshot(self.todo, self.done, self.failed, elapsed, rate, left, now, self.stopping)

    def _tell(self) -> None:
        self._telling = True
        try:
            snapshot = self._snapshot()
            if self._progress is not None:
                self._progress(snapshot)
            if time.monotonic() - self._written >= INTERVAL:
                self._write(snapshot)
        finally:
            self._telling = False
        if self.stopping and not snapshot.stopping:
            self._tell()

    def _write(self, snapshot: Snapshot) -> None:
        if self._file is not None:
            self._written = time.monotonic()
            write_state(self._file, asdict(snapshot) | self._owner)


def owner() -> dict[str, Any]:
    """Who runs this, and since when."""
    return {"pid": os.getpid(), "host": socket.gethostname(), "started": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"}


def write_state(file: Path, state: dict[str, Any]) -> None:
    """Leave the state for others; a run does not fail for want of it."""
    temporary = file.with_name(f".{file.name}.tmp")
    with suppress(OSError):
        temporary.write_text(json.dumps(state | {"written": time.time()}))
        os.replace(temporary, file)


def read_state(file: Path) -> dict[str, Any]:
    """What a run has left; empty where there is nothing to be read."""
    try:
        check_regular(file)
        state = json.loads(file.read_text())
        # A store that is just taken has no more than its owner.
        kinds = OWNER if "todo" not in state else OWNER | SNAPSHOT
        sound = all(isinstance(state[name], kind) for name, kind in kinds.items())
    except UNREADABLE:
        return {}
    return state if sound else {}
