"""How far a run is: counted in one place, told to whoever listens, and left in a file for other processes."""

from __future__ import annotations

import json
import math
import os
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

# The file is written at most this often, s.
INTERVAL = 1.0
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
    """Counts batches as they begin and end; may be told from any thread. `progress` is called by one at a time."""

    def __init__(self, todo: int, progress: Progress | None, file: Path | None) -> None:
        self.todo, self.done, self.failed, self.stopping = todo, 0, 0, False
        self._progress, self._file = progress, file
        self._lock = threading.Lock()
        self._begun = time.monotonic()
        self._owner = owner()
        self._written = -math.inf
        self._now: dict[int, str] = {}
        self._closed = False

    def more(self, todo: int) -> None:
        """What was found asks for so many computations more."""
        self.todo += todo

    def begin(self, number: int, what: str) -> None:
        """A batch is under way."""
        with self._lock:
            self._now[number] = what
            self._tell()

    def end(self, number: int, done: int, failed: int) -> None:
        """A batch has ended, or has been taken back with nothing done."""
        with self._lock:
            self._now.pop(number, None)
            self.done += done
            self.failed += failed
            self._tell()

    def stop(self) -> None:
        """The run has been told to stop. Called by a signal's handler, which must neither wait nor raise."""
        self.stopping = True
        # Where the lock is taken, whoever has it sees the flag when it is done; it may be this very thread.
        if self._lock.acquire(blocking=False):
            try:
                with suppress(Exception):
                    self._tell()
            finally:
                self._lock.release()

    def close(self) -> None:
        """Leave the last state in the file; what threads tell after this is not heard."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._write(self.snapshot())

    def snapshot(self) -> Snapshot:
        """The state now."""
        elapsed = time.monotonic() - self._begun
        rate = self.done / elapsed if elapsed > 0.0 else 0.0
        left = (self.todo - self.done) / rate if rate > 0.0 else math.nan
        now = tuple(list(self._now.values())[:SHOWN])
        return Snapshot(self.todo, self.done, self.failed, elapsed, rate, left, now, self.stopping)

    def _tell(self) -> None:
        if self._closed:
            return
        snapshot = self.snapshot()
        if self._progress is not None:
            self._progress(snapshot)
        if time.monotonic() - self._written >= INTERVAL:
            self._write(snapshot)
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
        state = json.loads(file.read_text())
    except (OSError, ValueError):
        return {}
    return state if isinstance(state, dict) else {}
