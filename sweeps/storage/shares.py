"""The files of shares: jobs that compute a plan together, each into parts of its own beside the file they become.

STUDY.nc.3-of-16.parts/     of the third of sixteen; as the parts of a run
.STUDY.nc.3-of-16.lock      locked by its job
"""

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from sweeps.storage.store import LOCK_TIMEOUT, Store


class Share(Store):
    """The paths of share `number` of `count`."""

    def __init__(self, file: str | Path, number: int, count: int) -> None:
        super().__init__(file)
        self.number, self.count = number, count
        name = f"{self.file.name}.{number}-of-{count}"
        self.parts, self.lock = self.file.with_name(f"{name}.parts"), self.file.with_name(f".{name}.lock")
        self.manifest, self.progress = self.parts / "manifest", self.parts / "progress.json"

    def version(self) -> tuple[Any, ...]:
        """A value that changes whenever the file, or this share's parts, are written; not by other shares."""
        return (*Store(self.file).version(), *self.part_names())


def shares_of(store: Store) -> list[Share]:
    """The shares that lie beside a file, by number."""
    name, names = re.compile(rf"{re.escape(store.file.name)}\.(\d+)-of-(\d+)\.parts"), list[str]()
    with suppress(OSError):
        names = os.listdir(store.file.parent)
    numbers = sorted((int(found[2]), int(found[1])) for found in map(name.fullmatch, names) if found)
    return [Share(store.file, number, count) for count, number in numbers]


@contextmanager
def locked(store: Store) -> Iterator[None]:
    """Hold the lock of a store while no share of it computes, or that of a share while no whole run does."""
    with store.locked():
        for other in [Store(store.file)] if isinstance(store, Share) else shares_of(store):
            # Others test locks too, and hold them for a moment.
            until = time.monotonic() + LOCK_TIMEOUT
            while other.is_locked():
                if time.monotonic() > until:
                    raise other.locked_error()
                time.sleep(0.1 * LOCK_TIMEOUT)
        yield


def clear(store: Store) -> None:
    """Remove the parts of a locked store and of its shares."""
    store.clear()
    for share in shares_of(store):
        share.clear()
        with suppress(OSError):
            share.lock.unlink(missing_ok=True)
