"""One run a store: a lock that the system releases if its holder dies."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from filelock import lock_descriptor, unlock_descriptor

from sweeps.errors import LockedError, StoreError, reason
from sweeps.storage.checked import check_regular
from sweeps.storage.store import Store
from sweeps.watch.monitor import owner, read_state, write_state

# s. A reader who asks whether there is a run holds the lock for a moment.
PATIENCE = 0.2


@contextmanager
def locked(store: Store) -> Iterator[None]:
    """Hold the store.

    Raises
    ------
    LockedError
        If another run does; the message names it.
    StoreError
        If nothing can be written there.
    """
    try:
        store.check_parts()
        store.file.parent.mkdir(parents=True, exist_ok=True)
        file = _acquired(store.lock)
    except OSError as problem:
        raise StoreError(f"{store.file} cannot be written: {reason(problem)}; choose another folder") from None
    if file is None:
        raise taken(store)
    with file:
        try:
            # Only a message needs it, so a full disk is no matter.
            with suppress(OSError):
                store.parts.mkdir(exist_ok=True)
            write_state(store.progress, owner())
            yield
        finally:
            # Without a manifest the folder is nothing.
            if not store.manifest.exists():
                store.clear()
            with suppress(OSError):
                if _names(store.lock, file):
                    store.lock.unlink()
            # A process that was forked meanwhile has the file open too.
            unlock_descriptor(file.fileno())


def _acquired(path: Path) -> BinaryIO | None:
    """The lock's file, locked; None if somebody else has it."""
    with suppress(FileNotFoundError):
        check_regular(path)
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        with ExitStack() as stack:
            file = stack.enter_context(open(path, "ab"))
            # A holder removes the file at its end: whoever opened it before has locked what nobody else will find.
            if lock_descriptor(file.fileno(), blocking=False) and _names(path, file):
                stack.pop_all()
                return file
        time.sleep(PATIENCE / 10)
    return None


def _names(path: Path, file: BinaryIO) -> bool:
    """Whether a path leads to an open file."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.stat(path), os.fstat(file.fileno()))
    return False


def is_locked(store: Store) -> bool:
    """Whether a run holds the store now."""
    if not os.path.isfile(store.lock):
        return False
    try:
        with open(store.lock, "r+b") as file:
            return not lock_descriptor(file.fileno(), blocking=False)
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        return True


def taken(store: Store) -> LockedError:
    """The refusal of a store that a run is writing; it names the run."""
    state, run = read_state(store.progress), "another run"
    if "pid" in state:
        run = f"process {state['pid']} on {state['host']}, begun {state.get('started', 'just now')}"
    return LockedError(f"{store.file} is being written by {run}; wait for it, or choose another folder")
